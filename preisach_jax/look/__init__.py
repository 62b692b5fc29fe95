"""A first look at a record, before any fit: what it holds, and what it can tell."""

from preisach_jax.look.result import ColumnView, Look, columns_of, look, look_at_table

__all__ = ["ColumnView", "Look", "columns_of", "look", "look_at_table"]

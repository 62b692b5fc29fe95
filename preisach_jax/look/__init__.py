"""A first look at a record, before any fit: what it holds, and what it can tell."""

from preisach_jax.look.columns import ColumnView, columns_of
from preisach_jax.look.examination import look, look_at_table, look_at_tables
from preisach_jax.look.result import Look

__all__ = ["ColumnView", "Look", "columns_of", "look", "look_at_table", "look_at_tables"]

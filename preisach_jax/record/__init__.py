"""Measured records: load them from files, check them, cut them.

From below: `units` (names and units), `table` (columns as read), `delimited`, `micromag` and
`containers` (the formats), `reading` (which format), `columns` (which column is what), `core`.
"""

from preisach_jax.record.channels import Channel
from preisach_jax.record.columns import ReadOptions
from preisach_jax.record.core import Record
from preisach_jax.record.samples import AS_FITTED, INITIAL_MEMORIES, MIN_MEASURED, Samples

__all__ = [
    "AS_FITTED",
    "INITIAL_MEMORIES",
    "MIN_MEASURED",
    "Channel",
    "ReadOptions",
    "Record",
    "Samples",
]

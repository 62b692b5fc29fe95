"""Measured records: load them from files, check them, cut them.

From below: `units` (names and units), `table` (columns as read), `delimited`, `micromag` and
`containers` (the formats), `reading` (which format), `columns` (which column is what), `core`.
Names are imported from where they are defined: a child that reads one file loads no more.
"""

"""Columns as a file holds them, before any of them is given a role."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from preisach_jax.errors import InputError


@dataclass(frozen=True, eq=False)
class Table:
    """Named columns of a file, with the place of each entry for messages.

    Arguments:
        source: the file as the user named it.
        columns: by name in the file's order; (K,) float64 with NaN for empty cells, or (K,) objects
            (texts, and NaN for empty cells) where a column is not all numbers.
        rows: (K,) row of the file, counted from 1, in which an entry stands.
        named: False where the file has no names and the columns go by position `"1"`, `"2"`, ...
        decimal: the decimal sign of numbers still held as text.
        units: units by column, where the format or a line of units states them.
        left_aside: what the file holds and the table does not, by name, with the reason.
        roles: the column of each role, where the format fixes it.
        initial_memory: the state at the first sample, where the format knows it.
        notes: what the reader assumed, in sentences for the user.
    """

    source: str
    columns: Mapping[str, np.ndarray]
    rows: np.ndarray
    named: bool = True
    decimal: str = "."
    units: Mapping[str, str] = field(default_factory=dict)
    left_aside: Mapping[str, str] = field(default_factory=dict)
    roles: Mapping[str, str] = field(default_factory=dict)
    initial_memory: str = "free"
    notes: tuple[str, ...] = ()

    def listing(self) -> str:
        """The columns' names for a message, shortened where there are very many."""
        names = list(self.columns)
        more = f", ... ({len(names)} in all)" if len(names) > 20 else ""
        return ", ".join(names[:20]) + more

    def place(self, column: str, k: int) -> str:
        """Where entry `k` of `column` stands: file, column and row."""
        return f"{self.source}, column {column}, row {self.rows[k]}"

    def numbers(self, column: str, remedy: str) -> np.ndarray:
        """A column as numbers.

        Arguments:
            column: its name.
            remedy: what the user can do about an entry that is not a number.

        Returns:
            (K,) float64, NaN where the cell is empty.

        Raises:
            InputError: an entry is text.
        """
        values, bad = self._parsed(column)
        if bad.size:
            entry = str(self.columns[column][bad[0]]).strip()
            more = f" (and {bad.size - 1} more)" if bad.size > 1 else ""
            raise InputError(
                f"{self.place(column, bad[0])}: {entry[:60]!r} is not a number{more}; {remedy}"
            )
        return values

    def lenient_numbers(self, column: str) -> np.ndarray | None:
        """A column as numbers with NaN for stray texts, or None if most entries are text."""
        values, bad = self._parsed(column)
        return None if 2 * bad.size > np.sum(~np.isnan(values)) + bad.size else values

    def _parsed(self, column: str) -> tuple[np.ndarray, np.ndarray]:
        """Numbers of a column, and the indices of the entries that are text."""
        cells = self.columns[column]
        if cells.dtype != object:
            return cells, np.empty(0, dtype=int)
        values = np.full(cells.shape, np.nan)
        bad = []
        for k, cell in enumerate(cells):
            try:
                values[k] = _number(cell, self.decimal)
            except (TypeError, ValueError):
                bad.append(k)
        return values, np.array(bad, dtype=int)


def _number(cell: object, decimal: str) -> float:
    """One cell as a number; NaN if empty; ValueError or TypeError if it is text."""
    if not isinstance(cell, str):
        if isinstance(cell, bool | np.bool_):
            raise TypeError("a truth value")
        return float(cell)  # pyright: ignore[reportArgumentType]
    text = cell.strip()
    if decimal == ",":
        text = text.replace(",", ".")
    if "_" in text:
        raise ValueError("Python reads 1_000 as a number, nobody else does")
    return float(text) if text else float("nan")

"""Columns as a file holds them, before any of them is given a role."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from decimal import Decimal

import numpy as np

from preisach_jax.errors import InputError
from preisach_jax.record.clock import clock_seconds

GREAT = 1e8
"""Numbers from which on float64 may cut the decimals of a time: columns are kept exactly too."""


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
        exact: columns of numbers so great that float64 cuts them: (K,) int64, or the texts.
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
    exact: Mapping[str, np.ndarray] = field(default_factory=dict)

    def listing(self) -> str:
        """The columns' names for a message, shortened where there are very many."""
        return shortened(list(self.columns))

    def place(self, column: str, k: int) -> str:
        """Where entry `k` of `column` stands: file, column and row."""
        return f"{self.source}, column {column}, row {self.rows[k]}"

    def check_rows(self) -> None:
        """Check that there are rows enough for a record.

        Raises:
            InputError: there are fewer than two.
        """
        if self.rows.size == 0:
            raise InputError(f"{self.source}: there are no rows; give at least 2")
        if self.rows.size == 1:
            raise InputError(
                f"{self.source}, row {self.rows[0]}: one sample is no record; give at least 2"
            )

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

    def from_first(self, column: str) -> np.ndarray:
        """What numbers are above the first one, without the rounding of great numbers.

        Arguments:
            column: its name; all its entries are numbers.

        Returns:
            (K,) float64.
        """
        cells = self.exact.get(column)
        if cells is None:
            return self.columns[column] - self.columns[column][0]
        if cells.dtype != object:
            return (cells - cells[0]).astype(np.float64)
        numbers = [Decimal(text.strip().replace(self.decimal, ".")) for text in cells]
        return np.array([float(number - numbers[0]) for number in numbers])

    def with_clocks(self) -> Table:
        """The same with dates and clock times as seconds from the first row."""
        columns, units, notes = dict(self.columns), dict(self.units), list(self.notes)
        for name, cells in self.columns.items():
            found = clock_seconds(cells) if cells.dtype == object else None
            if found is not None:
                columns[name], assumed = found
                units[name] = "s"
                of = f", {assumed}" if assumed else ""
                notes.append(f"{self.source}: column {name} read as time from its first row{of}")
        return replace(self, columns=columns, units=units, notes=tuple(notes))

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


def shortened(names: Sequence[str]) -> str:
    """Names for a message, the first twenty where there are more.

    Example:
        >>> shortened(["t", "u", "z"])
        't, u, z'
    """
    more = f", ... ({len(names)} in all)" if len(names) > 20 else ""
    return ", ".join(names[:20]) + more


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

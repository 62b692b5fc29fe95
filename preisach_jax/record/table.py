"""Columns as a file holds them, before any of them is given a role."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from decimal import Decimal

import numpy as np

from preisach_jax.errors import ContentError, InputError
from preisach_jax.escape import distinct, printable, unit
from preisach_jax.record.clock import clock_seconds

GREAT = 1e8
"""Numbers from which on float64 may cut the decimals of a time: columns are kept exactly too."""

MOST_COLUMNS = 2**14
"""As many as a sheet of a workbook has."""

LONGEST_NAME = 300
"""Characters of the longest name of a column: paths of channels in test stands have a hundred."""


@dataclass(frozen=True, eq=False)
class Table:
    """Named columns of a file, with the place of each entry for messages.

    Arguments:
        columns: by name in the file's order; (K,) float64 with NaN for empty cells, or (K,) objects
            (texts, and NaN for empty cells) where a column is not all numbers.
        rows: (K,) row of the file, counted from 1, in which an entry stands.
        units: units by column, where the format or a line of units states them.
        is_record: whether it was made of a record, whose times stay what they are: in a file, great
            ones count from an epoch.
        sheets: names of the other sheets of a workbook that hold the same columns.
        makes_time: whether its first column is a time that was made, and stands in no file.
        exact: columns of numbers so great that float64 cuts them: (K,) integers, or the texts.
    """

    source: str
    columns: Mapping[str, np.ndarray]
    rows: np.ndarray
    named: bool = True
    decimal: str = "."
    units: Mapping[str, str] = field(default_factory=dict[str, str])
    left_aside: Mapping[str, str] = field(default_factory=dict[str, str])
    roles: Mapping[str, str] = field(default_factory=dict[str, str])
    initial_memory: str = "free"
    notes: tuple[str, ...] = ()
    is_record: bool = False
    makes_time: bool = False
    exact: Mapping[str, np.ndarray] = field(default_factory=dict[str, np.ndarray])
    torn_row: int | None = None
    sheets: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        # Names of files reach terminals, figures and generated code: here they become harmless.
        clean: dict[str, str] = {}
        for name in self.columns:
            clean[name] = distinct(printable(name), clean.values())
        for what in ("columns", "units", "left_aside", "exact"):
            given = getattr(self, what).items()
            object.__setattr__(self, what, {clean.get(k, printable(k)): one for k, one in given})
        object.__setattr__(self, "units", {key: unit(one) for key, one in self.units.items()})
        roles = {role: clean.get(name, printable(name)) for role, name in self.roles.items()}
        object.__setattr__(self, "roles", roles)
        object.__setattr__(self, "notes", tuple(map(printable, self.notes)))

    def listing(self) -> str:
        """The columns' names for a message, shortened where there are very many."""
        return shortened(list(self.columns))

    def place(self, column: str, k: int) -> str:
        """Where entry `k` of `column` stands: file, column and row."""
        return f"{self.source}, column {column}, row {self.rows[k]}"

    def check_rows(self) -> None:
        """Check that there are rows enough for a record."""
        if self.rows.size == 0:
            raise InputError(f"{self.source}: there are no rows; give at least 2")
        if self.rows.size == 1:
            raise InputError(
                f"{self.source}, row {self.rows[0]}: one sample is no record; give at least 2"
            )

    def numbers(self, column: str, remedy: str) -> np.ndarray:
        """A column as numbers."""
        values, bad = self._parsed(column)
        if bad.size:
            entry = str(self.columns[column][bad[0]]).strip()
            if entry == column:
                raise InputError(
                    f"{self.place(column, bad[0])}: the names stand here again, so that another "
                    "table begins; give each table as a file of its own"
                )
            others = ", ".join(map(str, self.rows[bad[1:6]]))
            more = f" and {bad.size - 6} more" if bad.size > 6 else ""
            also = f", nor is what stands in row(s) {others}{more}" if others else ""
            raise InputError(
                f"{self.place(column, bad[0])}: {entry[:60]!r} is not a number{also}; {remedy}"
            )
        return values

    def from_first(self, column: str) -> np.ndarray:
        """What numbers are above the first one, without the rounding of great numbers."""
        cells = self.exact.get(column, self.columns[column])
        if cells.dtype != object:
            if cells.dtype.kind in "iu":  # differences of uint64 wrap around to those of int64
                cells = cells.astype(np.int64)
            return (cells - cells[0]).astype(np.float64)
        numbers = [Decimal(str(cell).strip().replace(self.decimal, ".")) for cell in cells]
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
        bad: list[int] = []
        for k, cell in enumerate(cells):
            try:
                values[k] = _number(cell, self.decimal)
            except (TypeError, ValueError, OverflowError):
                bad.append(k)
        return values, np.array(bad, dtype=int)


def told_apart(names: Sequence[str], place: str) -> tuple[list[str], tuple[str, ...]]:
    """Checked names with a number behind those that stand again, and a note that says so."""
    found, count, given = list[str](), Counter[str](), set(names)
    for name in names:
        count[name] += 1
        found.append(distinct(f"{name} ({count[name]})", given) if count[name] > 1 else name)
    check_names(found, place)
    again = [name for name, times in count.items() if times > 1]
    if not again:
        return found, ()
    more = f" (and {len(again) - 1} names more so)" if len(again) > 1 else ""
    name = again[0][:60]
    return found, (
        f"{place}: {count[again[0]]} columns are called {name}{more}; after the first they are "
        f"{name} (2) and so on",
    )


def check_names(names: Sequence[str], place: str) -> None:
    """Refuse more columns than a record could have, names that stand twice, and endless ones."""
    if len(names) > MOST_COLUMNS:
        raise InputError(
            f"{place}: there are {len(names):,} columns, and up to {MOST_COLUMNS:,} are read; give "
            "each channel a column of its own, not a row"
        )
    for name in names:
        if len(name) > LONGEST_NAME:
            raise InputError(
                f"{place}: a column's name has {len(name):,} characters ({name[:40]!r}...); give "
                f"names of up to {LONGEST_NAME}"
            )
    twice = next((name for name, count in Counter(names).items() if count > 1), None)
    if twice is not None:
        raise InputError(
            f"{place}: the column name {twice!r} stands {names.count(twice)} times; give every "
            "column its own name"
        )


def shortened(names: Sequence[str]) -> str:
    """Names for a message: the first twenty where there are more, and not all of a long one."""
    more = f", ... ({len(names)} in all)" if len(names) > 20 else ""
    return ", ".join(n if len(n) <= 60 else f"{n[:60]}..." for n in names[:20]) + more


def _number(cell: object, decimal: str) -> float:
    """One cell as a number; NaN if empty; ValueError or TypeError if it is text."""
    if not isinstance(cell, str):
        if isinstance(cell, bool | np.bool_):
            raise ContentError("a truth value")
        return float(cell)  # pyright: ignore[reportArgumentType]
    text = cell.strip()
    if decimal == ",":
        text = text.replace(",", ".")
    if "_" in text:
        raise ContentError("1_000 is a number in Python alone")
    return float(text) if text else float("nan")

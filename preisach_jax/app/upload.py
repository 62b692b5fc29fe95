"""A file that came into the page: kept as its bytes, previewed, never trusted."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np

from preisach_jax.errors import InputError
from preisach_jax.record.columns import (
    QuestionError,
    ReadOptions,
    all_runs,
    assign_roles,
    could_be_time,
    is_clock,
    unit_of,
)
from preisach_jax.record.core import Record
from preisach_jax.record.readers import BINARY
from preisach_jax.record.reading import read_tables
from preisach_jax.record.sampling import on_one_clock
from preisach_jax.record.table import Table

MOST_BYTES = 200_000_000
"""Largest file that the page takes; the command line reads larger ones."""

PREVIEWED_ROWS = 8
PREVIEWED_COLUMNS = 30
OFFERED_COLUMNS = 500


@dataclass(frozen=True, eq=False)
class Upload:
    """A file that can be read as a table.

    Attributes:
        name: what the file was called, as it came.
        content: its bytes, of which all that is said of it is read.
        read: its tables as they were read.
        tables: what they are cut into where nothing is chosen, as `--table` counts them.
        guess: the column of each role, None where names and units do not tell.
        question: why the guess is not whole; empty if it is.
        is_open: whether it is a question, and not a refusal.
        said: what was made of the columns where the guess is whole.
    """

    name: str
    content: bytes
    read: tuple[Table, ...]
    tables: tuple[Table, ...]
    guess: Mapping[str, str | None]
    question: str
    is_open: bool
    said: tuple[str, ...]

    @staticmethod
    def of(name: str, content: bytes) -> Upload:
        """Read what came; messages call it by its name."""
        if len(content) > MOST_BYTES:
            raise InputError(
                f"{name} has {len(content) / 1e6:.0f} MB; the page takes {MOST_BYTES / 1e6:.0f} MB "
                "at most: use the command line, 'preisach diagnose FILE'"
            )
        read = tuple(tables_of(name, content))
        tables = tuple(map(on_one_clock, all_runs(read, {})))
        return Upload(name, content, read, tables, *_guessed(tables[0]))

    @property
    def table(self) -> Table:
        """The first table, whose columns are those of all."""
        return self.tables[0]

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(self.table.columns)

    def offered(self) -> list[str]:
        """The columns that menus offer: of very many the first, and those that were guessed."""
        guessed = {name for name in self.guess.values() if name}
        first = self.columns[:OFFERED_COLUMNS]
        return [*first, *(name for name in self.columns[len(first) :] if name in guessed)]

    def unit(self, column: str) -> str:
        """The unit that the file states for a column, empty if none."""
        return unit_of(self.table, column)

    def first_rows(self) -> tuple[list[str], list[list[str]]]:
        """The first columns and rows as texts, as a preview."""
        names = list(self.columns[:PREVIEWED_COLUMNS])
        count = min(PREVIEWED_ROWS, len(self.table.rows))
        return names, [[_cell(self.table.columns[name][k]) for name in names] for k in range(count)]

    def records(self, choice: ReadOptions) -> list[Record]:
        """The records of the chosen columns: that of the chosen table, or one of each."""
        return Record.of_tables(all_runs(self.read, choice), self.name, **choice)


def tables_of(name: str, content: bytes) -> list[Table]:
    """The tables of a file that came as its bytes; messages call it by its name.

    Readers want a file: it lies in a folder that is new and gone afterwards, and can be no other's.
    """
    with tempfile.TemporaryDirectory(prefix="preisach-app-") as folder:
        path = Path(folder) / harmless_name(name)
        path.write_bytes(content)
        return read_tables(path, name)


_TEXT_ENDINGS = {"csv", "txt", "dat", "tsv", "asc", "lvm", "forc", "frc", "gz", "zip"}
_ENDINGS = _TEXT_ENDINGS | {
    suffix.removeprefix(".") for reader in BINARY for suffix in reader.suffixes
}


def harmless_name(name: str) -> str:
    """A name for a file in a folder of ours, whatever the file was called."""
    last = re.split(r"[/\\]", name)[-1]
    stem, dot, ending = last.rpartition(".")
    stem, ending = (stem, ending.lower()) if dot else (ending, "csv")
    if ending not in _ENDINGS:
        stem, ending = last, "csv"
    return f"{re.sub(r'[^A-Za-z0-9_-]', '_', stem)[:80] or 'record'}.{ending}"


def _guessed(table: Table) -> tuple[dict[str, str | None], str, bool, tuple[str, ...]]:
    """The columns by role; why they are not all known, whether that is a question; what is said."""
    try:
        roles = assign_roles(
            table, time=None, input=None, output=None, aux=(), has_rate=False, need_output=True
        )
        guess = {"time": roles.time, "input": roles.input, "output": roles.output}
        return guess, "", False, roles.said
    except QuestionError:
        question, is_open = "Names and units do not tell which column is which: choose them.", True
    except InputError as refusal:
        question, is_open = f"{refusal}.", False
    is_time = could_be_time if table.named else is_clock
    times = [name for name in table.columns if is_time(table, name)]
    time = table.roles.get("time") or (times[0] if len(times) == 1 else None)
    return {"time": time, "input": None, "output": None}, question, is_open, ()


def _cell(value: object) -> str:
    if isinstance(value, float | np.floating):
        return "" if np.isnan(cast(float, value)) else f"{value:.6g}"
    return str(value)[:40]

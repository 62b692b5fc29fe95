"""From a path to a table, whatever the format."""

from __future__ import annotations

import difflib
import os
import re
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from preisach_jax.errors import InputError
from preisach_jax.record.apart import read_apart, read_here
from preisach_jax.record.delimited import HEAD_BYTES, check_text, decode, is_text
from preisach_jax.record.layouts import read_known
from preisach_jax.record.readers import BINARY, HDF5, NPZ, TEXT, WORKBOOK
from preisach_jax.record.readers.base import Reader
from preisach_jax.record.readers.packed import ZIP, is_npz, packed_kind, unpack
from preisach_jax.record.readers.workbook import OLE, SHEET
from preisach_jax.record.table import Table
from preisach_jax.record.units import is_known_unit, plain_unit

MAX_TEXT_BYTES = 2**29
"""Greatest text file that is read, in bytes: it takes ten times as much memory."""


# Numbers with a unit beside each, and with exponents as Fortran writes them.
_NUMBER = re.compile(
    r"(?P<number>[+-]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eEdD][+-]?\d+)?)\s*(?P<unit>[^\d\s.,+-]\S*)?"
)
_LOOKED_AT = 20  # cells by which a column is known

_MARKUP = (b"<!doctype", b"<html", b"<?xml", b"<table", b"<head", b"<body")


def read_table(path: str | os.PathLike[str], source: str | None = None) -> Table:
    """Read the columns of a file: of several tables the first."""
    tables = read_tables(path, source)
    if len(tables) > 1:
        sheets = tables[0].sheets
        by_name = f"; for another ({', '.join(sheets)}): {Path(path).name}{SHEET}NAME" * bool(
            sheets
        )
        note = (
            f"{tables[0].source}: of {len(tables)} tables the first was read; --table 2 takes the "
            f"second, and fit and diagnose take all of them, as several records{by_name}"
        )
        return replace(tables[0], notes=(note, *tables[0].notes))
    return tables[0]


def read_tables(path: str | os.PathLike[str], source: str | None = None) -> list[Table]:
    """Read the tables of a file that are records of one kind."""
    source = str(path) if source is None else source
    path, sheet = _without_sheet(Path(path))
    _check_file(path, source)
    if sheet is not None:
        return read_apart(WORKBOOK, path, source.removesuffix(f"{SHEET}{sheet}"), sheet)
    try:
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES)
        if kind := packed_kind(path, head):
            with tempfile.TemporaryDirectory() as folder:
                inside, left = unpack(path, kind, Path(folder), source)
                _check_file(inside, f"{source}, the file inside")
                with inside.open("rb") as file:
                    tables = _read(inside, file.read(HEAD_BYTES), source)
                return [replace(t, notes=(left, *t.notes)) if left else t for t in tables]
        return _read(path, head, source)
    except OSError as error:
        raise InputError(
            f"{source}: cannot be read ({error.strerror}); check its permissions"
        ) from None


def _without_sheet(path: Path) -> tuple[Path, str | None]:
    """A workbook and the sheet that is named behind it; of any other path itself, and None."""
    name, mark, sheet = path.name.rpartition(SHEET)
    book = path.parent / name if name else path
    if mark and sheet and book.suffix.lower() in WORKBOOK.suffixes and not path.exists():
        return book, sheet
    return path, None


def _read(path: Path, head: bytes, source: str) -> list[Table]:
    reader = _reader(path, head)
    if reader is None or reader.read is None:
        return [with_plain_numbers(table) for table in _read_text(path, head, source)]
    is_foreign = reader.foreign or head[512:].startswith(HDF5.starts)  # MATLAB 7.3 is HDF5
    read = read_apart if is_foreign else read_here
    return [with_plain_numbers(table) for table in read(reader, path, source)]


def _reader(path: Path, head: bytes) -> Reader | None:
    """The reader of a binary file, by how it begins, else by its ending; None for text."""
    if packed_kind(path, head):
        return None  # packed twice: refused as binary
    if head.startswith(ZIP):
        return NPZ if is_npz(path, head) or path.suffix.lower() == ".npz" else WORKBOOK
    for reader in BINARY:
        if head.startswith(reader.starts or (b"\0no beginning",)):
            return reader
    found = next((reader for reader in BINARY if path.suffix.lower() in reader.suffixes), None)
    # Many instruments write text, or a web page, and call it a workbook.
    is_named_so = found is WORKBOOK and not head.startswith(OLE)
    return None if is_named_so and is_text(head) else found


def _check_file(path: Path, source: str) -> None:
    if path.is_dir():
        raise InputError(f"{source}: this is a folder; give a file in it")
    if path.is_symlink() and not path.exists():
        raise InputError(f"{source}: this link leads nowhere; give the file itself")
    if not path.exists():
        raise InputError(f"{source}: there is no such file{_near(path)}; check the path")
    if not path.is_file():
        raise InputError(f"{source}: this is a device or a pipe; save its data as a file first")
    if path.stat().st_size == 0:
        raise InputError(f"{source}: the file is empty; give a file with columns of data")


def _read_text(path: Path, head: bytes, source: str) -> list[Table]:
    size = path.stat().st_size
    check_text(head, source)
    if head.removeprefix(b"\xef\xbb\xbf").lstrip()[:14].lower().startswith(_MARKUP):
        raise InputError(
            f"{source}: the file is a web page or XML, not a table; if it is what you meant, open "
            "it in a spreadsheet program and save it as CSV, else fetch the file itself again"
        )
    if size > MAX_TEXT_BYTES:
        raise InputError(
            f"{source}: the file has {size:,} bytes, and texts of up to {MAX_TEXT_BYTES:,} are "
            "read; cut or thin it, or save its columns with numpy.savez"
        )
    text, assumed = decode(path.read_bytes())
    begin = text[:HEAD_BYTES]
    reads = (reader.read_text for reader in TEXT if reader.is_text and reader.is_text(begin))
    own = next(reads, None)
    tables = read_known(text, source) if own is None else [own(text, source)]
    note = (f"{source}: {assumed}",) if assumed else ()
    return [replace(table, notes=(*note, *table.notes)) for table in tables]


def _near(path: Path) -> str:
    """A hint to a file of a similar name in the same folder, if there is one."""
    try:
        names = [entry.name for entry in path.parent.iterdir() if entry.is_file()]
    except (OSError, ValueError):  # a name may hold what none can
        return ""
    near = difflib.get_close_matches(path.name, names, n=1)
    return f" (there is {near[0]})" if near else ""


def with_plain_numbers(table: Table) -> Table:
    """The same with `12.5 V` and `1.25D+01` as numbers, and the unit as that of the column.

    A cell that is spelt otherwise than those at the beginning of its column stays as it is, and is
    refused where a number is needed.
    """
    columns, units, notes = dict(table.columns), dict(table.units), list(table.notes)
    for name, cells in table.columns.items():
        unit = _unit_beside(cells)
        if unit is None:
            continue
        columns[name] = _numbers(cells, unit)
        if unit:
            units.setdefault(name, plain_unit(unit))
            notes.append(f"{table.source}: column {name} read without the {unit} in its cells")
    return replace(table, columns=columns, units=units, notes=tuple(notes))


def _unit_beside(cells: np.ndarray) -> str | None:
    """What stands beside the numbers, `""` if nothing; None if a column holds no such numbers."""
    if cells.dtype != object:
        return None
    texts = [cell for cell in cells[:_LOOKED_AT] if isinstance(cell, str) and cell.strip()]
    matches = [_NUMBER.fullmatch(text.strip()) for text in texts]
    found = {None if match is None else match["unit"] or "" for match in matches}
    if len(found) != 1:
        return None
    unit = found.pop()
    is_odd = unit or any("D" in text.upper() for text in texts)
    return unit if unit is not None and is_odd and is_known_unit(unit) else None


def _numbers(cells: np.ndarray, unit: str) -> np.ndarray:
    """Numbers where cells are spelt so, the cell itself where one is not."""
    plain: list[object] = []
    for cell in cells:
        match = _NUMBER.fullmatch(cell.strip()) if isinstance(cell, str) else None
        if match is None or (match["unit"] or "") != unit:
            plain.append(cell)
        else:
            plain.append(float(match["number"].upper().replace("D", "E").replace(",", ".")))
    if all(isinstance(cell, float) for cell in plain):
        return np.array(plain, np.float64)
    column = np.empty(len(plain), dtype=object)
    column[:] = plain
    return column

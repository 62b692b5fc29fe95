"""Workbooks: Excel (.xlsx, .xls, .xlsb) and OpenDocument (.ods)."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from datetime import date, datetime, time, timedelta
from pathlib import Path
from typing import Any, cast

import numpy as np

from preisach_jax.errors import InputError
from preisach_jax.record.readers.base import Reader, library, not_readable
from preisach_jax.record.readers.packed import check_members
from preisach_jax.record.sampling import with_stated_time
from preisach_jax.record.settings import header_start, is_row_of_numbers, sampling_of, settings_of
from preisach_jax.record.table import Table, told_apart
from preisach_jax.record.units import is_unit, plain_unit

OLE = b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1"
"""Beginning of old workbooks, and of new ones that are protected by a password."""

_ENCRYPTED = "EncryptedPackage".encode("utf-16-le")
_MACROS = ("xl/vbaProject.bin", "xl/macrosheets")
SHEET = "#"
"""Stands between the name of a workbook and that of a sheet in it."""

_REMEDY = "open it in the spreadsheet program and save it again, or save the sheet as CSV"
_COMMA = re.compile(r"[+-]?\d*,\d+")


def read_workbook(path: Path, source: str, sheet: str | None = None) -> list[Table]:
    """Read one sheet, or the longest and those of the same columns; needs python-calamine."""
    _check_harmless(path, source)
    calamine = library("python_calamine", "python-calamine", "workbooks", source)
    try:
        book = calamine.CalamineWorkbook.from_path(str(path))
        sheets = {
            name: book.get_sheet_by_name(name).to_python(skip_empty_area=False)
            for name in book.sheet_names
        }
    except Exception as error:  # calamine raises many kinds on a broken file
        raise not_readable("workbook", error, source, _REMEDY) from None
    filled = {name: rows for name, rows in sheets.items() if len(rows) > 1}
    if not filled:
        raise InputError(f"{source}: no sheet holds a table; give names above columns of numbers")
    if sheet is not None and sheet not in filled:
        raise InputError(
            f"{source}: there is no sheet {sheet!r} with a table; give one of {', '.join(filled)}"
        )
    name = sheet or max(filled, key=lambda each: len(filled[each]))
    table = _table_of_sheet(filled[name], f"{source}, sheet {name}", source)
    if len(filled) == 1 or sheet is not None:
        return [table]
    same = _same_columns(filled, name, table, source)
    others = ", ".join(each for each in filled if each != name and each not in same)
    if others:
        note = (
            f"{source}: of {len(filled)} sheets, {name!r} was read, which has the most rows; for "
            f"another ({others}) put its name behind the file's: {Path(source).name}{SHEET}NAME"
        )
        table = replace(table, notes=(note, *table.notes))
    return [replace(table, sheets=tuple(same)), *same.values()]


def _same_columns(filled: dict[str, Any], name: str, first: Table, source: str) -> dict[str, Table]:
    """The other sheets whose columns have the same names, which are records of one kind."""
    same: dict[str, Table] = {}
    for each in filled if first.named else ():
        if each == name:
            continue
        with suppress(InputError):
            table = _table_of_sheet(filled[each], f"{source}, sheet {each}", source)
            if table.named and list(table.columns) == list(first.columns):
                same[each] = table
    return same


def _check_harmless(path: Path, source: str) -> None:
    """Refuse passwords, macros, and what unpacks to far more than records do."""
    with path.open("rb") as file:
        is_old = file.read(len(OLE)) == OLE
    if is_old:
        if _ENCRYPTED in path.read_bytes():
            raise InputError(
                f"{source}: the workbook is protected by a password; save it without one, or save "
                "the sheet as CSV"
            )
        return
    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.namelist()
            has_macros = any(name.startswith(_MACROS) for name in members)
            if not has_macros:
                check_members(archive, archive.infolist(), path.stat().st_size, source)
    except InputError:
        raise
    except Exception as error:  # zipfile and its decompressors raise many kinds
        raise not_readable("workbook", error, source, _REMEDY) from None
    if has_macros:
        raise InputError(
            f"{source}: the workbook has macros, which are programs; save it as .xlsx without "
            "them, or save the sheet as CSV"
        )


def _table_of_sheet(rows: Sequence[Sequence[Any]], place: str, source: str) -> Table:
    """The table in the cells of a sheet, below settings and with a row of units, if there are."""
    kept = [k for k, row in enumerate(rows) if any(cell != "" for cell in row)]
    texts = ([_text(cell) for cell in rows[k]] for k in kept)
    used = max((len(rows[k]) for k in kept), default=0)
    begin = header_start(texts) or 0
    first = [_text(cell) for cell in rows[kept[begin]]]
    named = not is_row_of_numbers(first)
    names = first if named else [str(k + 1) for k in range(used)]
    names = [name or f"column {k + 1}" for k, name in enumerate(names)]
    data = begin + int(named)
    units: dict[str, str] = {}
    names, again = told_apart(names, f"{place}, row {kept[begin] + 1}")
    if named and data < len(kept):
        below = [_text(cell) for cell in rows[kept[data]]]
        if any(below) and all(is_unit(cell) for cell in below if cell):
            units = {n: plain_unit(u) for n, u in zip(names, below, strict=True) if u not in "-"}
            data += 1
    body = kept[data:]
    if not body:
        raise InputError(
            f"{place}: there is no row below row {kept[begin] + 1}; give a sheet with data"
        )
    columns = {k: [rows[i][k] if k < len(rows[i]) else "" for i in body] for k in range(used)}
    columns = {
        k: cells
        for k, cells in columns.items()
        if (k < len(first) and first[k]) or any(cell != "" for cell in cells)
    }
    values = {names[k]: _column(cells) for k, cells in columns.items()}
    lines = ["\t".join(_text(cell) for cell in rows[k]) for k in range(kept[begin])]
    table = Table(
        source,
        values,
        np.array(body) + 1,
        named=named,
        decimal="," if any(_has_comma(column) for column in values.values()) else ".",
        units={name: unit for name, unit in units.items() if name in values}
        | {names[k]: "s" for k, cells in columns.items() if isinstance(cells[0], timedelta)},
        notes=again,
    )
    return with_stated_time(table, sampling_of(settings_of(lines, "\t")))


def _text(cell: Any) -> str:
    """A cell as it would stand in a CSV."""
    if isinstance(cell, datetime):
        return cell.isoformat(" ")
    return str(cell).strip()


def _column(cells: list[Any]) -> np.ndarray:
    """(K,) float64 of numbers and durations, texts and NaN of anything else."""
    if all(cell == "" or type(cell) in (float, int) for cell in cells):
        return np.array([np.nan if cell == "" else cell for cell in cells], np.float64)
    plain = [cell.total_seconds() if isinstance(cell, timedelta) else cell for cell in cells]
    if all(cell == "" or type(cell) in (float, int) for cell in plain):
        return np.array([np.nan if cell == "" else cell for cell in plain], np.float64)
    made = [np.nan if c == "" else _text(c) if isinstance(c, date | time) else c for c in plain]
    column = np.empty(len(made), dtype=object)
    column[:] = made
    return column


def _has_comma(column: np.ndarray) -> bool:
    """Whether numbers are kept as texts with decimal commas."""
    if column.dtype != object:
        return False
    return any(isinstance(cell, str) and _COMMA.fullmatch(cell) for cell in cast(Any, column[:100]))


WORKBOOK = Reader(
    "Excel, OpenDocument",
    (".xlsx", ".xls", ".xlsb", ".xlsm", ".ods"),
    (OLE,),
    read_workbook,
    note="the sheet with the most rows; settings above the names and a row of units are understood",
    foreign=True,
)

"""Numbers that are spelt in another way: a unit beside each, exponents as Fortran writes them."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from preisach_jax.record.table import Table
from preisach_jax.record.units import is_known_unit, plain_unit

_NUMBER = re.compile(
    r"(?P<number>[+-]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eEdD][+-]?\d+)?)\s*(?P<unit>[^\d\s.,+-]\S*)?"
)
_LOOKED_AT = 20  # cells by which a column is known


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

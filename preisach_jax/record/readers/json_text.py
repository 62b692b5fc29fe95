"""JSON: an object of arrays, an array of objects or of rows, or one object a line."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from typing import Any, cast

import numpy as np

from preisach_jax.errors import InputError
from preisach_jax.record.containers import table_of_arrays
from preisach_jax.record.readers.base import Reader, not_readable
from preisach_jax.record.table import Table

_BEGIN = re.compile(r'\s*(\{\s*"|\[\s*[\[{])')
_REMEDY = 'write {"t_s": [...], "u_V": [...], "z_um": [...]}, or give the record as CSV'
_DEEPEST = 8
"""Objects within objects in which arrays are looked for."""


def is_json(text: str) -> bool:
    """Whether a text begins as JSON of objects or arrays does, and as no row of a table does."""
    return bool(_BEGIN.match(text))


def read_json(text: str, source: str) -> Table:
    """Read the arrays of a JSON text; those within objects go by their dotted names."""
    units: dict[str, str] = {}
    try:
        content = _parsed(text)
        arrays = _arrays(content, "", _DEEPEST, units)
    except Exception as error:  # of texts cut short, numbers beyond any, and nests without end
        raise not_readable("JSON", error, source, _REMEDY) from None
    if not arrays:
        raise InputError(f"{source}: the JSON holds no arrays of numbers; {_REMEDY}")
    return table_of_arrays(arrays, source, units=units)


def _parsed(text: str) -> Any:
    try:
        return json.loads(text)
    except json.JSONDecodeError:
        lines = [line for line in text.split("\n") if line.strip()]
        if len(lines) < 2 or not lines[0].rstrip().endswith(("}", "]")):
            raise
        return [json.loads(line) for line in lines]


def _arrays(content: Any, name: str, depth: int, units: dict[str, str]) -> dict[str, np.ndarray]:
    """The vectors and matrices in a value, by the names that lead to them; and units of them."""
    if isinstance(content, Mapping) and depth:
        inside = cast(Mapping[str, Any], content)
        if (named := _named_rows(inside, units)) is not None:
            return named
        found: dict[str, np.ndarray] = {}
        for key, inner in inside.items():
            found |= _arrays(inner, f"{name}.{key}" if name else key, depth - 1, units)
        return found
    if not isinstance(content, list) or len(cast(list[Any], content)) < 2:
        return {}
    values = cast(list[Any], content)
    if all(isinstance(value, Mapping) for value in values):
        rows = cast(list[Mapping[str, Any]], values)
        keys = dict.fromkeys(key for row in rows for key in row)
        columns = {key: [row.get(key) for row in rows] for key in keys}
        return _arrays(columns, name, depth, units)
    array = _array(values)
    return {} if array is None else {name or "data": array}


def _named_rows(content: Mapping[str, Any], units: dict[str, str]) -> dict[str, np.ndarray] | None:
    """Columns of an object that holds rows, and their names and units as lists beside them."""
    lists: dict[str, list[Any]] = {k: each for k, each in content.items() if isinstance(each, list)}
    rows = next((each for each in lists.values() if len(each) > 1 and _is_matrix(each)), None)
    if rows is None:
        return None
    width = len(rows[0])
    texts = {key: each for key, each in lists.items()
             if len(each) == width and all(isinstance(text, str) for text in each)}  # fmt: skip
    names = next((each for key, each in texts.items() if "unit" not in key.lower()), None)
    columns = [_array([row[k] for row in rows]) for k in range(width)]
    if names is None or len(set(names)) < width or width < 2:
        return None
    found = {n: c for n, c in zip(names, columns, strict=True) if c is not None}
    stated = next((each for key, each in texts.items() if "unit" in key.lower()), [""] * width)
    units |= {n: u for n, u in zip(names, stated, strict=True) if n in found and u}
    return found


def _is_matrix(values: list[Any]) -> bool:
    """Whether a list holds lists of one length."""
    return len({len(cast(list[Any], v)) if isinstance(v, list) else -1 for v in values}) == 1 and (
        isinstance(values[0], list)
    )


def _array(values: Sequence[Any]) -> np.ndarray | None:
    """Numbers as float64 with NaN for null, rows of numbers as a matrix, texts as objects."""
    if all(isinstance(value, list) for value in values):
        rows = cast(Sequence[list[Any]], values)
        numbers = all(_is_number(entry) for row in rows for entry in row)
        return np.array(rows, np.float64) if numbers else None
    if all(isinstance(value, int) and not isinstance(value, bool) for value in values):
        exact = np.array(values)  # stamps in ns; objects where they are beyond 64 bits
        return exact if exact.dtype.kind in "iu" else exact.astype(np.float64)
    if all(_is_number(value) for value in values):
        return np.array([np.nan if value is None else value for value in values], np.float64)
    if all(isinstance(value, str) or _is_number(value) for value in values):
        array = np.empty(len(values), dtype=object)
        array[:] = [np.nan if value is None else value for value in values]
        return array
    return None


def _is_number(value: Any) -> bool:
    return value is None or (isinstance(value, int | float) and not isinstance(value, bool))


JSON = Reader(
    "JSON",
    is_text=is_json,
    read_text=read_json,
    note="an object of arrays, an array of objects or of rows, rows beside a list of their names, "
    "or one object a line",
)

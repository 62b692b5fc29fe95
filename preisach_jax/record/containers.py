"""Named arrays as the columns of a table: vectors, the columns of matrices, dates."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from preisach_jax.errors import InputError
from preisach_jax.record.table import Table, check_names, shortened

MOST_CHANNELS = 1000
"""Columns of a matrix that are channels; more are a picture or a grid."""

_SECONDS = {
    "W": (604800.0, 1.0),
    "D": (86400.0, 1.0),
    "h": (3600.0, 1.0),
    "m": (60.0, 1.0),
    "s": (1.0, 1.0),
    "ms": (1.0, 1e3),
    "us": (1.0, 1e6),
    "ns": (1.0, 1e9),
    "ps": (1.0, 1e12),
    "fs": (1.0, 1e15),
    "as": (1.0, 1e18),
}


def table_of_arrays(
    arrays: Mapping[str, np.ndarray],
    source: str,
    *,
    units: Mapping[str, str] | None = None,
    roles: Mapping[str, str] | None = None,
    initial_memory: str = "free",
) -> Table:
    """A table of those arrays that are vectors of the greatest length, or matrices as long.

    The columns of a matrix go by its name and their number, those of a single matrix by number
    alone; its longer side is that of the samples.

    Arguments:
        units, roles, initial_memory: what is known of the columns, as in `Table`.
    """
    check_names(list(arrays), source)
    vectors, named, notes = _vectors(arrays, source)
    if not vectors:
        held = shortened(list(arrays)) or "nothing"
        raise InputError(
            f"{source}: the file holds no vectors (it holds {held}); "
            "give time, input and output as one-dimensional arrays of one length"
        )
    length = max(vector.size for vector in vectors.values())
    kept = {name: vector for name, vector in vectors.items() if vector.size == length}
    left_aside = {
        name: f"it has {v.size} values where others have {length}; give arrays of one length"
        for name, v in vectors.items()
        if v.size != length
    }
    return Table(
        source,
        {name: _as_cells(vector) for name, vector in kept.items()},
        np.arange(1, length + 1),
        named=named,
        notes=notes,
        units=dict(units or {})
        | {name: "s" for name, vector in kept.items() if vector.dtype.kind in "mM"},
        left_aside=left_aside,
        roles=roles or {},
        initial_memory=initial_memory,
        exact={name: vector for name, vector in kept.items() if vector.dtype.kind in "iu"},
    )


def _vectors(
    arrays: Mapping[str, np.ndarray], source: str
) -> tuple[dict[str, np.ndarray], bool, tuple[str, ...]]:
    """The vectors and the columns of matrices, whether they have names, and what was assumed."""
    squeezed = {name: np.squeeze(array) for name, array in arrays.items()}
    vectors = {name: array for name, array in squeezed.items() if array.ndim == 1}
    matrices = {
        name: array if array.shape[0] > array.shape[1] else array.T
        for name, array in squeezed.items()
        if array.ndim == 2 and array.dtype.kind in "iuf" and array.shape[0] != array.shape[1]
        and min(array.shape) <= MOST_CHANNELS
    }  # fmt: skip
    longest = max((vector.size for vector in vectors.values()), default=0)
    is_alone = len(matrices) == 1 and longest < len(next(iter(matrices.values())))
    notes: list[str] = []
    split: dict[str, np.ndarray] = {}
    for name, matrix in matrices.items():
        if not is_alone and longest > len(matrix):
            continue
        for k, column in enumerate(matrix.T, start=1):
            split[str(k) if is_alone else f"{name} {k}"] = np.ascontiguousarray(column)
        if squeezed[name].shape != matrix.shape:
            rows, columns = squeezed[name].shape
            notes.append(f"{source}: {name} is {rows} by {columns}; its rows are the channels")
    if is_alone:
        return split, False, tuple(notes)
    return {**vectors, **split}, True, tuple(notes)


def _as_cells(vector: np.ndarray) -> np.ndarray:
    """Numbers as float64, durations as seconds, dates as seconds since the first, else objects."""
    if vector.dtype.kind in "iuf":
        with np.errstate(all="ignore"):  # what is beyond float64 is infinite, and refused as such
            values = vector.astype(np.float64, copy=False)
        if (missing := np.isnan(values)).any():
            values = np.where(missing, np.nan, values)  # of many patterns some signal an error
        return values
    if vector.dtype.kind in "mM":
        return as_seconds(vector)
    return vector.astype(object)


def as_seconds(vector: np.ndarray) -> np.ndarray:
    """Durations as seconds, dates as seconds since the first, NaN where there is none."""
    unit = np.datetime_data(vector.dtype)[0]
    if unit in {"Y", "M"} and vector.dtype.kind == "M":
        vector, unit = vector.astype("M8[D]"), "D"
    if unit not in _SECONDS:  # years and months are no durations, nor are numbers without a unit
        counts = vector.astype(np.int64)
        texts = [f"{count} {unit}" for count in counts.tolist()]
        return np.where(np.isnat(vector), np.nan, np.array(texts, object))
    steps = vector - vector[:1] if vector.dtype.kind == "M" else vector
    multiplier, divisor = _SECONDS[unit]
    counted = steps.astype(np.int64) * float(np.datetime_data(vector.dtype)[1])
    return np.where(np.isnat(steps), np.nan, counted * multiplier / divisor)

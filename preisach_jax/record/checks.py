"""What must hold of the arrays of a record, whatever they come from."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from preisach_jax.errors import InputError, require_no_record
from preisach_jax.record.containers import as_seconds


def as_vector(values: ArrayLike, key: str, name: str) -> np.ndarray:
    """`values` as (K,) float64; `key` and `name` say in messages what they are."""
    require_no_record(f"{name}, {key}", values)
    try:
        vector: np.ndarray = np.asarray(values)
        if vector.dtype.kind == "c":
            raise InputError(
                f"{name}, {key}: complex numbers; give their real part or their magnitude"
            )
        if vector.dtype.kind in "mM":
            vector = as_seconds(vector)
        vector = np.asarray(vector, dtype=np.float64)
        if np.ma.isMaskedArray(values):
            vector = np.where(np.ma.getmaskarray(cast(Any, values)), np.nan, vector)
    except InputError:
        raise
    except (TypeError, ValueError) as error:
        raise InputError(f"{name}, {key}: {error}; give an array of numbers") from None
    if vector.ndim != 1:
        raise InputError(
            f"{name}, {key}: an array of shape {vector.shape}; give one of shape (samples,)"
            + ", and of several records a list of Records" * (vector.ndim == 2)
        )
    return vector


def check_finite(values: np.ndarray, place: Callable[[int], str]) -> None:
    """Refuse NaN and infinity; `place(k)` is where entry k stands."""
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size:
        more = f" ({bad.size} such values)" if bad.size > 1 else ""
        raise InputError(
            f"{place(int(bad[0]))}: the value is {values[bad[0]]}{more}; give finite numbers"
        )


def check_not_infinite(values: np.ndarray, place: Callable[[int], str]) -> None:
    """Refuse infinity in an output, whose NaN say that nothing was measured."""
    bad = np.flatnonzero(np.isinf(values))
    if bad.size:
        raise InputError(
            f"{place(int(bad[0]))}: the value is {values[bad[0]]}; leave it empty (NaN) if the "
            "output was not measured there"
        )


def check_increasing(seconds: np.ndarray, shown: np.ndarray, place: Callable[[int], str]) -> None:
    """Refuse times that are not at least two, finite, each above the one before.

    `seconds` are checked, `shown` are the same times as the file has them.
    """
    if seconds.size < 2:
        raise InputError(f"{place(0)}: one sample is no record; give at least 2")
    check_finite(seconds, place)
    bad = np.flatnonzero(np.diff(seconds) <= 0)
    if bad.size:
        k = int(bad[0]) + 1
        repeats = seconds[k] == seconds[k - 1]
        verb, remedy = ("repeats", "remove") if repeats else ("runs backward", "cut the file at")
        more = f" (and {bad.size - 1} more such rows)" if bad.size > 1 else ""
        raise InputError(
            f"{place(k)}: time {verb}, {shown[k]:.12g} after {shown[k - 1]:.12g}{more}; "
            f"{remedy} this row, or give the sampling rate with --rate HZ"
        )


def check_aux_names(names: Iterable[str], source: str) -> None:
    """Refuse auxiliary columns that go by the name of a role."""
    for name in names:
        if name in {"time", "input", "output"}:
            raise InputError(
                f"{source}: an auxiliary column is called {name!r}, as a role is; rename it"
            )


def check_unit_keys(units: Mapping[str, str] | None, known: Collection[str], source: str) -> None:
    """Refuse units for what is neither a role nor a column."""
    for key in units or {}:
        if key not in known:
            raise InputError(
                f"{source}: a unit is given for {key!r}, which is neither time, input, output nor "
                "a column; correct the name"
            )

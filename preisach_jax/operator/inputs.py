"""What inputs and numbers must be, before they are computed with."""

from __future__ import annotations

import warnings
from typing import Any, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.typing import ArrayLike

from preisach_jax.errors import InputError, PrecisionWarning, require_no_record

SPARE = 0.05
"""Share of the usual step of a signal from sample to sample by which it may be rounded."""

HYSTERONS = ("relay", "ramp")


def require_hysteron(hysteron: str) -> None:
    """Refuse a kind of hysteron that does not exist."""
    if hysteron not in HYSTERONS:
        raise InputError(f"hysteron is {hysteron!r}: it must be 'relay' or 'ramp'")


def as_float(values: ArrayLike, name: str) -> jax.Array:
    """Convert real numbers to a floating array.

    Whole numbers written in Python are real numbers. An array of integers is refused, because it
    usually holds a converter's raw counts.
    """
    require_no_record(name, values)
    given: Any = values
    if isinstance(values, np.ndarray):
        if values.dtype.kind not in "biufc":
            raise InputError(f"{name} has the type {values.dtype}: give real numbers")
        # `jnp.asarray` would compile a program for each shape; `device_put` may share memory.
        given = jax.device_put(cast(Any, np).array(values))
    array = jnp.asarray(given)
    if jnp.issubdtype(array.dtype, jnp.floating):
        # A Python number is weakly typed; a fixed type saves compiling everything twice.
        return array.astype(array.dtype) if array.weak_type else array
    if not jnp.issubdtype(array.dtype, jnp.integer):
        raise InputError(f"{name} has the type {array.dtype}: give real numbers")
    if hasattr(values, "dtype"):
        raise InputError(
            f"{name} has the type {getattr(values, 'dtype', None)}: convert it first, as in "
            f"{name.rsplit(maxsplit=1)[-1]}.astype(float)"
        )
    return array.astype(jnp.result_type(float))


def as_signal(values: ArrayLike, name: str) -> jax.Array:
    """Convert a measured signal to a floating array, and warn where that takes digits it needs."""
    array = as_float(values, name)
    if isinstance(values, np.ndarray) and values.dtype == np.float64 and array.dtype != np.float64:
        rounding = np.abs(values - values.astype(array.dtype))
        steps = np.abs(np.diff(values))
        steps = steps[np.isfinite(steps) & (steps > 0)]
        if steps.size and np.nanmean(rounding) > SPARE * np.median(steps):
            # The text and the place are the same each time, so that Python shows it once.
            warnings.warn(
                f"{name} is rounded to {array.dtype}, by more than {SPARE:.0%} of its usual step "
                "from sample to sample: compute in double precision, by "
                "jax.config.update('jax_enable_x64', True), or take a constant off it",
                PrecisionWarning,
                stacklevel=1,
            )
    return array


def require_finite(values: ArrayLike, name: str, *, missing: bool = False) -> None:
    """Refuse values that are not finite, but for NaN if some may be `missing`; traced ones pass."""
    if isinstance(values, Tracer):
        return
    flat = np.ravel(np.asarray(values))
    wrong = np.isinf(flat) if missing else ~np.isfinite(flat)
    if wrong.any():
        first = int(np.argmax(wrong))
        remedy = "give NaN where the output is missing" if missing else "give finite numbers"
        raise InputError(f"{name} is {flat[first]}{at_sample(first, flat.size)}: {remedy}")


def at_sample(sample: int, samples: int) -> str:
    """Where a value stands among several, for a message; nothing for a single one."""
    return f" at sample {sample}" if samples > 1 else ""

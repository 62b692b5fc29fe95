"""Keys, limits, spectral lines and places of samples: what all excitations need."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from preisach_jax.errors import InputError


def index_of(samples: int) -> jax.Array:
    """(samples,) 0, 1, ... as floating numbers; refused where the count is none."""
    if samples != int(samples) or samples < 1:
        raise InputError(f"samples is {samples}: give a whole number of at least 1")
    return jnp.arange(samples, dtype=jnp.result_type(float))


def uniform(key: jax.Array, count: int) -> jax.Array:
    """Numbers in [0, 1); drawn in single precision, so that a key means one signal in both."""
    return jax.random.uniform(as_key(key), (count,), jnp.float32).astype(jnp.result_type(float))


def known(drawn: jax.Array) -> tuple[Any, Any]:
    """NumPy, for which nothing is compiled, and the numbers in it; JAX where they are traced."""
    if isinstance(drawn, Tracer):
        return jnp, cast(Any, drawn)
    return np, np.asarray(drawn)


def as_key(key: jax.Array) -> jax.Array:
    """A random key, or an error that says how to make one.

    Arguments:
        key: a key of `jax.random.key`, or the older kind of `jax.random.PRNGKey`.

    Returns:
        A key of the newer kind.

    Raises:
        InputError: it is no key.

    Example:
        >>> import jax
        >>> as_key(jax.random.PRNGKey(0)) == jax.random.key(0)
        Array(True, dtype=bool)
    """
    kind = getattr(key, "dtype", None)
    if kind is not None and jnp.issubdtype(kind, jax.dtypes.prng_key):
        return key
    if kind == jnp.uint32 and key.shape == (2,):
        return cast(jax.Array, jax.random.wrap_key_data(key))
    raise InputError(f"the key is {key!r}: make one by jax.random.key(0)")


def ordered(low: float, high: float) -> None:
    """Refuse a range whose ends are not finite and ascending."""
    if not -math.inf < low < high < math.inf:
        raise InputError(
            f"the range is {low!r} to {high!r}: low must be below high, and both finite"
        )


def checked_lines(lines: Sequence[int], period: int) -> np.ndarray:
    """Lines of a periodic excitation, for those who play it and those who measure its response.

    Arguments:
        lines: whole cycles a period of each sine.
        period: samples of a period.

    Returns:
        (lines,) whole numbers, in the order given.

    Raises:
        InputError: there is no line, or one is not whole, is below 1, is not below half the number
            of samples or occurs twice.

    Example:
        >>> checked_lines((3, 5), 64).tolist()
        [3, 5]
    """
    given = np.asarray(lines).reshape(-1)
    rows = given.astype(int)
    if rows.size == 0 or np.any(rows != given) or rows.min() < 1 or 2 * rows.max() >= period:
        raise InputError(
            f"lines are {given.tolist()}: give whole numbers from 1 to below {period / 2:g}"
        )
    if np.unique(rows).size < rows.size:
        raise InputError(f"lines are {given.tolist()}: name each only once")
    return rows

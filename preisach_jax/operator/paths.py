"""Inputs on a plane, and the states before them."""

from __future__ import annotations

from typing import cast

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.typing import ArrayLike

from preisach_jax.errors import InputError
from preisach_jax.operator.checks import (
    as_float,
    as_signal,
    at_sample,
    require_finite,
    require_hysteron,
)
from preisach_jax.operator.plane import Plane

# An input may lie so far beyond the limits of the plane, in parts of their distance: rounding.
LIMIT_TOLERANCE = 1e-6


def require_plane(plane: Plane) -> None:
    """Refuse what is no plane."""
    if not isinstance(plane, Plane):
        raise InputError(
            f"the plane is {plane!r}: give a Plane, as in Plane(levels=37, low=0.0, high=75.0)"
        )


def require_on_plane(plane: Plane, x: ArrayLike) -> None:
    """Refuse an input that is not finite or leaves the plane; a traced one passes and saturates.

    Arguments:
        x: () or (time,) floating input, in the unit of the plane.
    """
    if isinstance(x, Tracer):
        return
    require_finite(x, "the input x")
    values = np.asarray(x)
    flat = values.ravel()
    eps = cast(np.floating, jnp.finfo(values.dtype).eps)
    rounding = float(eps) * max(abs(plane.low), abs(plane.high))
    reach = max(LIMIT_TOLERANCE * (plane.high - plane.low), rounding)
    beyond = (flat < plane.low - reach) | (flat > plane.high + reach)
    if beyond.any():
        first = int(np.argmax(beyond))
        raise InputError(
            f"the input x is {flat[first]:.8g}{at_sample(first, flat.size)}, and the plane "
            f"reaches from {plane.low} to {plane.high}: make the plane wider, or clip the input"
        )


def as_path(plane: Plane, x: ArrayLike) -> jax.Array:
    """Check an input: a row of numbers on the plane.

    Values are checked where there are any: inside a compiled function an input beyond the plane
    passes, and the hysterons saturate.

    Arguments:
        x: (time,) input, in the unit of the plane.

    Returns:
        (time,) input with a floating type.
    """
    x = as_signal(x, "the input x")
    if x.ndim != 1 or x.shape[0] == 0:
        several = ", and several inputs one by one with jax.vmap" if x.ndim > 1 else ""
        raise InputError(
            f"the input x has the shape {x.shape}: give (time,), with time > 0{several}"
        )
    require_on_plane(plane, x)
    return x


def path_and_start(
    plane: Plane, x: ArrayLike, initial_states: ArrayLike | str, hysteron: str
) -> tuple[jax.Array, jax.Array]:
    """Check an input and the states before it, and bring both to one floating type.

    Arguments:
        x: (time,) input, in the unit of the plane.
        initial_states: (cells,) states in [0, 1], or the name of an initial memory.

    Returns:
        `(x, states)`: (time,) and (cells,).
    """
    require_hysteron(hysteron)
    x = as_path(plane, x)
    if isinstance(initial_states, str):
        return x, plane.initial_states(initial_states, x[0], hysteron)
    states = as_float(initial_states, "initial_states").astype(x.dtype)
    if states.shape != (plane.cells,):
        raise InputError(f"initial_states has the shape {states.shape}: give ({plane.cells},)")
    return x, states

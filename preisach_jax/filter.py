"""The adaptive hysteresis filter and the Preisach model's output, eq. (5)-(12)."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike

from preisach_jax.hysteron import as_float, hysteron_step, path_and_start
from preisach_jax.plane import Plane


def simulate(
    plane: Plane,
    weights: ArrayLike,
    x: ArrayLike,
    hysteron: str = "ramp",
    initial: ArrayLike | str = "low",
) -> jax.Array:
    """Simulate the Preisach model.

    z(k) = Σ R_i y_i(k), eq. (6), with states 0 and 1 (relays) or between (ramps).

    Args:
        plane: the Preisach plane.
        weights: (cells,) weights R, in the unit of the output.
        x: (time,) input, in the unit of the plane.
        hysteron: "relay" or "ramp".
        initial: (cells,) states before the first sample, or the name of an initial memory (see
            `Plane.initial_states`).

    Returns:
        (time,) output; differentiable in `weights`, and with ramps in `x`.

    Raises:
        ValueError: a shape, a type or a name is wrong.

    Example:
        >>> plane = Plane(levels=2, low=0.0, high=2.0)
        >>> simulate(plane, [1.0, 2.0, 4.0], [0.0, 2.0, 1.0, 0.0]).tolist()
        [0.0, 7.0, 3.0, 0.0]
    """
    x, start = path_and_start(plane, x, initial, hysteron)
    weights = as_float(weights, "weights")
    if weights.shape != (plane.cells,):
        raise ValueError(f"weights has the shape {weights.shape}; ({plane.cells},) is needed")

    def advance(carry, value):
        states, previous = carry
        states = hysteron_step(plane, states, previous, value, hysteron)
        return (states, value), jnp.sum(weights * states)

    return jax.lax.scan(advance, (start, x[0]), x)[1]

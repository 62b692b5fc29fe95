"""Hysterons: the paper's relay, eq. (1)-(4), and its ramp, from one closed form."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from preisach_jax.operator.grid import Grid


def position_on(plane: Grid, x: Any) -> Any:
    """Position of an input on an axis of the plane, 0 to levels: (x - low)/δx for equal cells.

    Between thresholds of one's own it is linear: i + 1/2 at threshold i, 0 at low and the number of
    thresholds that there are at high.

    Arguments:
        plane: the Preisach plane.
        x: inputs in the unit of the plane, a floating array of JAX or NumPy.

    Returns:
        Positions, of the kind, type and shape of `x`; exactly 0 at low and exactly `levels` at
        high, and beyond the plane beyond these, or there at thresholds of one's own.
    """
    if plane.own_thresholds is None:
        low, high = x.dtype.type(plane.low), x.dtype.type(plane.high)
        return (x - low) / (high - low) * plane.levels
    xp, knots, places = _knots(plane, x)
    return xp.interp(x, knots, places).astype(x.dtype)


def input_at(plane: Grid, position: Any) -> Any:
    """Input at a position on an axis of the plane, 0 to levels: the inverse of `position_on`.

    Arguments:
        plane: the Preisach plane.
        position: positions, a floating array of JAX or NumPy.

    Returns:
        Inputs in the unit of the plane, of the kind, type and shape of `position`.
    """
    if plane.own_thresholds is None:
        return plane.low + plane.delta_x * position
    xp, knots, places = _knots(plane, position)
    return xp.interp(position, places, knots).astype(position.dtype)


def _knots(plane: Grid, like: Any) -> tuple[Any, Any, Any]:
    """NumPy or JAX, and (levels + 2,) inputs and the positions at them, between which it is linear.

    They are the lower limit, the thresholds that there are, and the upper limit.
    """
    own, dtype = plane.own_thresholds, like.dtype
    known = isinstance(like, np.ndarray | np.generic) and isinstance(own, np.ndarray)
    xp: Any = np if known else jnp
    own = xp.asarray(own, dtype)
    used, number = xp.sum(xp.isfinite(own)), xp.arange(plane.levels + 2)
    knots = xp.concatenate([xp.full(1, plane.low, dtype), own, xp.full(1, np.inf, dtype)])
    knots = xp.where(number == used + 1, plane.high, knots)
    return xp, knots.astype(dtype), xp.clip(number - 0.5, 0.0, used).astype(dtype)


def thresholds_reached(
    plane: Grid, previous: jax.Array, x: jax.Array, hysteron: str
) -> tuple[jax.Array, jax.Array]:
    """Tell how far the input has reached each hysteron's two thresholds.

    Relay: χ(x - α) and χ(x - β) of (3), (4) in 0/1 form. A rising input reaches a threshold on
    which it rests exactly (3), a falling one has left it (4). An input that does not move decides
    nothing at equality, so that the state is kept there; by rule (1), so it is at the first sample.

    Ramp: ρ_i(x) = clip((x - low)/δx - i, 0, 1), a ramp of width δx centred on threshold i.

    Arguments:
        plane: the Preisach plane.
        previous: () input one sample before; equal to `x` at the first sample.
        x: () input.
        hysteron: "relay" or "ramp".

    Returns:
        `(on_alpha, on_beta)`, (cells,) each, in [0, 1], with the type of `x`.
    """
    if hysteron == "ramp":
        position = position_on(plane, x)
        on_alpha = jnp.clip(position - jnp.asarray(plane.alpha_index, x.dtype), 0.0, 1.0)
        on_beta = jnp.clip(position - jnp.asarray(plane.beta_index, x.dtype), 0.0, 1.0)
        return on_alpha, on_beta
    alpha, beta = jnp.asarray(plane.alpha, x.dtype), jnp.asarray(plane.beta, x.dtype)
    on_alpha = jnp.where(x > previous, x >= alpha, x > alpha)
    on_beta = jnp.where(x < previous, x > beta, x >= beta)
    return on_alpha.astype(x.dtype), on_beta.astype(x.dtype)


def hysteron_step(
    plane: Grid, states: jax.Array, previous: jax.Array, x: jax.Array, hysteron: str = "ramp"
) -> jax.Array:
    """Advance all hysterons by one sample of the input.

    Eq. (2) in 0/1 form, y(k) = min(on_β, max(y(k-1), on_α)), for relays and ramps alike.

    Arguments:
        plane: the Preisach plane.
        states: (cells,) states y(k-1) in [0, 1].
        previous: () input x(k-1), in the unit of the plane; pass x(k) at the first sample, so that
            only the hysterons whose state x(k) forces are changed, rule (1).
        x: () input x(k), same unit.
        hysteron: "relay" or "ramp".

    Returns:
        (cells,) states y(k) in [0, 1].

    Example:
        >>> import jax.numpy as jnp
        >>> from preisach_jax.operator.plane import Plane
        >>> plane = Plane(levels=2, low=0.0, high=2.0)
        >>> hysteron_step(plane, jnp.zeros(3), jnp.asarray(0.0), jnp.asarray(1.25)).tolist()
        [1.0, 0.25, 0.25]
    """
    on_alpha, on_beta = thresholds_reached(plane, previous, x, hysteron)
    return jnp.minimum(on_beta, jnp.maximum(states, on_alpha))

"""States of all hysterons along an input, and bounds of them where its past is not known."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike

from preisach_jax.operator.hysteron import hysteron_step, position_on, thresholds_reached
from preisach_jax.operator.paths import path_and_start
from preisach_jax.operator.plane import Plane


def hysteron_states(
    plane: Plane,
    x: ArrayLike,
    initial_states: ArrayLike | str = "low",
    hysteron: str = "ramp",
    falling: ArrayLike | None = None,
    reversible: ArrayLike | None = None,
) -> jax.Array:
    """Follow the states of all hysterons along an input, eq. (1)-(4).

    Arguments:
        plane: the Preisach plane.
        x: (time,) input, in the unit of the plane.
        initial_states: (cells,) states in [0, 1] before the first sample, or the name of an initial
            memory (see `Plane.initial_states`).
        hysteron: "relay" or "ramp".
        falling: (time,) input of the thresholds β, where it is not that of the thresholds α: where
            thresholds move outward by δ, `x` is the input less δ, and `falling` the input plus δ.
        reversible: (time,) input of the hysterons on the diagonal α = β, where these do not follow
            the other two.

    Returns:
        (time, cells) states in [0, 1]; the first row is the state after x[0].

    Raises:
        InputError: `x` is not a row of real numbers on the plane, or a name is unknown.

    Example:
        >>> from preisach_jax.operator.plane import Plane
        >>> plane = Plane(levels=2, low=0.0, high=2.0)
        >>> hysteron_states(plane, [0.0, 0.75, 0.25], "low", "ramp")[:, 0].tolist()
        [0.0, 0.75, 0.25]
    """
    x, start = path_and_start(plane, x, initial_states, hysteron)
    if falling is not None:
        paths = _paths(x, falling, reversible)
        return _states_of_paths(plane, paths, start, hysteron)

    def advance(
        carry: tuple[jax.Array, jax.Array], value: jax.Array
    ) -> tuple[tuple[jax.Array, jax.Array], jax.Array]:
        states, previous = carry
        states = hysteron_step(plane, states, previous, value, hysteron)
        return (states, value), states

    return jax.lax.scan(advance, (start, x[0]), x)[1]


Paths = tuple[jax.Array, ...]
"""Inputs of thresholds α, of thresholds β and, if it is another, of both on the diagonal."""


def _paths(x: jax.Array, falling: ArrayLike, reversible: ArrayLike | None) -> Paths:
    others = (falling,) if reversible is None else (falling, reversible)
    return (x, *(jnp.asarray(other, x.dtype) for other in others))


def step_of_paths(
    plane: Plane, states: jax.Array, previous: Paths, now: Paths, hysteron: str
) -> jax.Array:
    """`hysteron_step` where thresholds α see the first of several inputs, and β the second."""
    on_alpha, _ = thresholds_reached(plane, previous[0], now[0], hysteron)
    _, on_beta = thresholds_reached(plane, previous[1], now[1], hysteron)
    if len(now) > 2:
        diagonal = jnp.asarray(plane.alpha_index == plane.beta_index)
        own_alpha, own_beta = thresholds_reached(plane, previous[2], now[2], hysteron)
        on_alpha = jnp.where(diagonal, own_alpha, on_alpha)
        on_beta = jnp.where(diagonal, own_beta, on_beta)
    return jnp.minimum(on_beta, jnp.maximum(states, on_alpha))


def _states_of_paths(plane: Plane, paths: Paths, start: jax.Array, hysteron: str) -> jax.Array:
    def advance(
        carry: tuple[jax.Array, Paths], now: Paths
    ) -> tuple[tuple[jax.Array, Paths], jax.Array]:
        states, previous = carry
        states = step_of_paths(plane, states, previous, now, hysteron)
        return (states, now), states

    return jax.lax.scan(advance, (start, tuple(path[0] for path in paths)), paths)[1]


def weighted_states(
    plane: Plane,
    weights: jax.Array,
    memory: jax.Array,
    x: jax.Array,
    hysteron: str = "ramp",
    falling: jax.Array | None = None,
    reversible: jax.Array | None = None,
) -> jax.Array:
    """Weigh the states along an input whose earlier history is known by its effect alone.

    h(k) = Σ_i R_i low_i(k) + m_i (high_i(k) - low_i(k)) with the `state_bounds`, and without
    keeping these.

    Arguments:
        plane: the Preisach plane.
        weights: (cells,) weights R, in output units.
        memory: (cells,) output m that each unknown start adds until the input forces it.
        x: (time,) input, in the unit of the plane.
        hysteron: "relay" or "ramp".
        falling, reversible: (time,) other inputs, see `hysteron_states`.

    Returns:
        (time,) output h, in output units.

    Example:
        >>> import jax.numpy as jnp
        >>> from preisach_jax.operator.plane import Plane
        >>> ones = jnp.ones(3)
        >>> plane, x = Plane(levels=2, low=0.0, high=2.0), jnp.array([1.0, 2.0])
        >>> weighted_states(plane, ones, 0.5 * ones, x, "relay").tolist()
        [1.5, 3.0]
    """
    paths = _paths(x, x if falling is None else falling, reversible)
    if hysteron == "ramp":
        return _weighted_ramps(plane, weights, memory, paths)

    def advance(
        carry: tuple[jax.Array, jax.Array, Paths], now: Paths
    ) -> tuple[tuple[jax.Array, jax.Array, Paths], jax.Array]:
        low, high, previous = carry
        low = step_of_paths(plane, low, previous, now, hysteron)
        high = step_of_paths(plane, high, previous, now, hysteron)
        return (low, high, now), low @ weights + (high - low) @ memory

    zero = jnp.zeros(plane.cells, x.dtype)
    start = (zero, zero + 1.0, tuple(path[0] for path in paths))
    return jax.lax.scan(advance, start, paths)[1]


def _weighted_ramps(plane: Plane, weights: jax.Array, memory: jax.Array, paths: Paths) -> jax.Array:
    """`weighted_states` of ramps: what thresholds of a row or a column reach is computed once."""
    cells = (plane.alpha_index, plane.beta_index)
    laid_out = jnp.zeros((2, plane.levels, plane.levels), weights.dtype)
    laid_out = laid_out.at[0, *cells].set(weights - memory).at[1, *cells].set(memory)
    index = jnp.arange(plane.levels, dtype=weights.dtype)
    reached = tuple(
        jnp.clip(position_on(plane, path)[:, None] - index[None, :], 0.0, 1.0) for path in paths
    )
    diagonal = jnp.eye(plane.levels, dtype=bool)

    def advance(states: jax.Array, now: tuple[jax.Array, ...]) -> tuple[jax.Array, jax.Array]:
        on_alpha, on_beta = now[0][None, :, None], now[1][None, None, :]
        states = jnp.minimum(on_beta, jnp.maximum(states, on_alpha))
        if len(now) > 2:
            states = jnp.where(diagonal[None], now[2][None, :, None], states)
        return states, jnp.vdot(states, laid_out)

    start = jnp.stack([jnp.zeros_like(laid_out[0]), jnp.ones_like(laid_out[0])])
    return jax.lax.scan(advance, start, reached)[1]


def state_bounds(
    plane: Plane,
    x: ArrayLike,
    hysteron: str = "ramp",
    falling: ArrayLike | None = None,
    reversible: ArrayLike | None = None,
) -> tuple[jax.Array, jax.Array]:
    """Bound the states of all hysterons along an input whose earlier history is unknown.

    Eq. (2) with fixed input maps y(k-1) by a clamp, and clamps compose to clamps, so that the state
    from any initial state y0 is exactly clip(y0, low, high).

    Arguments:
        plane: the Preisach plane.
        x: (time,) input, in the unit of the plane.
        hysteron: "relay" or "ramp".
        falling, reversible: (time,) other inputs, see `hysteron_states`.

    Returns:
        `(low, high)`, (time, cells) each: the states with all hysterons initially off and with all
        initially on. Their difference is what the unknown initial memory leaves open.

    Raises:
        InputError: `x` is not a row of real numbers on the plane, or the kind of hysteron is
            unknown.

    Example:
        >>> from preisach_jax.operator.plane import Plane
        >>> low, high = state_bounds(Plane(levels=2, low=0.0, high=2.0), [1.0, 2.0], "relay")
        >>> (high - low).sum(axis=1).tolist()
        [1.0, 0.0]
    """
    low = hysteron_states(plane, x, "low", hysteron, falling, reversible)
    return low, hysteron_states(plane, x, "high", hysteron, falling, reversible)

"""States of all hysterons along an input, and outputs of them: cost time x cells.

With bounds where the past is not known, and with inputs that depend on the output.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.typing import ArrayLike

from preisach_jax.errors import InputError
from preisach_jax.operator.inputs import (
    as_float,
    as_signal,
    at_sample,
    require_finite,
    require_hysteron,
)
from preisach_jax.operator.plane import Plane, hysteron_step, namespace_of, thresholds_reached

LIMIT_TOLERANCE = 1e-6
"""Share of the plane's range by which rounding may take an input beyond it."""


def require_plane(plane: Plane) -> None:
    """Refuse what is no plane."""
    if not isinstance(plane, Plane):
        raise InputError(
            f"the plane is {plane!r}: give a Plane, as in Plane(levels=37, low=0.0, high=75.0)"
        )


def require_on_plane(plane: Plane, x: ArrayLike) -> None:
    """Refuse an input that is not finite or leaves the plane; a traced one passes and saturates."""
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
    """Check an input, a row of numbers on the plane; a traced one passes, and states saturate."""
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
    """Check an input and the states before it, and bring both to one floating type."""
    require_hysteron(hysteron)
    x = as_path(plane, x)
    if isinstance(initial_states, str):
        return x, plane.initial_states(initial_states, x[0], hysteron)
    states = as_float(initial_states, "initial_states").astype(x.dtype)
    if states.shape != (plane.cells,):
        raise InputError(f"initial_states has the shape {states.shape}: give ({plane.cells},)")
    return x, states


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
        x: (time,) input, in the unit of the plane.
        initial_states: (cells,) states in [0, 1] before the first sample, or the name of an initial
            memory (see `Plane.initial_states`).
        falling: (time,) input of the thresholds β, where it is not that of the thresholds α: where
            thresholds move outward by δ, `x` is the input less δ, and `falling` the input plus δ.
        reversible: (time,) input of the hysterons on the diagonal α = β, where these do not follow
            the other two.

    Returns:
        (time, cells) states in [0, 1]; the first row is the state after x[0].

    Example:
        >>> plane = Plane(levels=2, low=0.0, high=2.0)
        >>> hysteron_states(plane, [0.0, 0.75, 0.25], "low", "ramp")[:, 0].tolist()
        [0.0, 0.75, 0.25]
    """
    x, start = path_and_start(plane, x, initial_states, hysteron)
    if falling is not None:
        paths = _paths(x, falling, reversible)
        return _states_of_paths(plane, paths, start, hysteron)
    return _states(plane, x, start, hysteron)


# Compiled, so that the next input of this length finds it there.
@eqx.filter_jit
def _states(plane: Plane, x: jax.Array, start: jax.Array, hysteron: str) -> jax.Array:
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
    xp = namespace_of(states, on_beta)
    if len(now) > 2:
        diagonal = xp.asarray(plane.alpha_index == plane.beta_index)
        own_alpha, own_beta = thresholds_reached(plane, previous[2], now[2], hysteron)
        on_alpha = xp.where(diagonal, own_alpha, on_alpha)
        on_beta = xp.where(diagonal, own_beta, on_beta)
    return xp.minimum(on_beta, xp.maximum(states, on_alpha))


@eqx.filter_jit
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
    keeping these; `falling` and `reversible` as of `hysteron_states`. `memory` is the output m that
    each unknown start adds until the input forces it.

    Example:
        >>> import jax.numpy as jnp
        >>> ones = jnp.ones(3)
        >>> plane, x = Plane(levels=2, low=0.0, high=2.0), jnp.array([1.0, 2.0])
        >>> weighted_states(plane, ones, 0.5 * ones, x, "relay").tolist()
        [1.5, 3.0]
    """
    paths = _paths(x, x if falling is None else falling, reversible)

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


def state_bounds(
    plane: Plane,
    x: ArrayLike,
    hysteron: str = "ramp",
    falling: ArrayLike | None = None,
    reversible: ArrayLike | None = None,
) -> tuple[jax.Array, jax.Array]:
    """Bound the states of all hysterons along an input whose earlier history is unknown.

    Eq. (2) with fixed input maps y(k-1) by a clamp, and clamps compose to clamps, so that the state
    from any initial state y0 is exactly clip(y0, low, high), where low and high, (time, cells)
    each, are the states with all hysterons initially off and with all initially on.

    Example:
        >>> low, high = state_bounds(Plane(levels=2, low=0.0, high=2.0), [1.0, 2.0], "relay")
        >>> (high - low).sum(axis=1).tolist()
        [1.0, 0.0]
    """
    low = hysteron_states(plane, x, "low", hysteron, falling, reversible)
    return low, hysteron_states(plane, x, "high", hysteron, falling, reversible)


MOST_TRIALS = 60
"""Trials by which an output is found that agrees with itself; two or three are usual."""

_Bounds = tuple[jax.Array, jax.Array]
_FedBack = tuple[_Bounds, Paths, jax.Array]
_Trial = tuple[jax.Array | int, jax.Array, jax.Array, jax.Array, jax.Array]


def _first(course: jax.Array) -> jax.Array:
    return course[0]


def fed_back_states(
    plane: Plane,
    weights: jax.Array,
    memory: jax.Array,
    course: Any,
    seen: Callable[[Any, jax.Array, jax.Array], Paths],
    hysteron: str = "ramp",
) -> jax.Array:
    """Weigh the states of hysterons whose inputs depend on the output, as `weighted_states` does.

    At every sample the output is found that agrees with itself, by Newton steps kept inside a
    bracket: a hysteresis never falls with its input, and its output has bounds.

    Arguments:
        weights, memory: (cells,) as of `weighted_states`, not negative.
        course: arrays whose first axis is time: what drives the hysterons with their output.
        seen: inputs of thresholds α, of β, and of the diagonal, from a sample of the course, the
            output before it, and a trial of the output at it.

    Example:
        >>> plane, ones = Plane(levels=2, low=0.0, high=3.0), jnp.ones(3)
        >>> half = lambda x, before, output: (x - 0.5 * output,) * 3
        >>> fed_back_states(plane, ones, 0 * ones, jnp.array([0.0, 1.0]), half).tolist()
        [0.0, 0.5]
    """
    most = weights.sum() + memory.sum()
    close = 8 * cast(np.floating, jnp.finfo(weights.dtype).eps) * most

    def advance(carry: _FedBack, sample: Any) -> tuple[_FedBack, jax.Array]:
        states, previous, before = carry

        def moved(output: jax.Array) -> tuple[jax.Array, tuple[_Bounds, Paths]]:
            now = seen(sample, before, output)
            low, high = (step_of_paths(plane, each, previous, now, hysteron) for each in states)
            return low @ weights + (high - low) @ memory, ((low, high), now)

        def improved(trial: _Trial) -> _Trial:
            count, output, bottom, top, _ = trial
            answer, slope, _ = jax.jvp(moved, (output,), (jnp.ones_like(output),), has_aux=True)
            excess = answer - output
            bottom, top = jnp.where(excess > 0, output, bottom), jnp.where(excess > 0, top, output)
            newton = output + excess / jnp.where(slope < 1, 1 - slope, 1.0)
            # Where steps or corners keep Newton's from converging, halving the bracket does.
            good = (slope < 1) & (newton > bottom) & (newton < top) & (count % 4 != 3)
            after = jnp.where(good, newton, (bottom + top) / 2)
            done = (jnp.abs(excess) <= close) | (top - bottom <= close)
            return count + 1, jnp.where(done, output, after), bottom, top, done

        def unfinished(trial: _Trial) -> jax.Array:
            return ~trial[-1] & (trial[0] < MOST_TRIALS)

        begin: _Trial = (0, before, jnp.zeros_like(most), most, jnp.asarray(False))
        output = jax.lax.while_loop(unfinished, improved, begin)[1]
        output, after = moved(output)
        return (*after, output), output

    zero = jnp.zeros(plane.cells, weights.dtype)
    nothing = jnp.zeros((), weights.dtype)
    first = jax.tree.map(_first, course)
    paths: Paths = jax.eval_shape(seen, first, nothing, nothing)
    # An input before the first that is no number compares as one that does not move.
    previous = tuple(jnp.full_like(path, jnp.nan) for path in paths)
    return jax.lax.scan(advance, ((zero, zero + 1.0), previous, nothing), course)[1]

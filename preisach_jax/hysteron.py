"""Hysterons: the paper's relay, eq. (1)-(4), and its ramp, from one closed form."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.typing import ArrayLike

from preisach_jax.errors import InputError

if TYPE_CHECKING:
    from preisach_jax.plane import Plane

HYSTERONS = ("relay", "ramp")

# An input may lie so far beyond the limits of the plane, in parts of their distance: rounding.
LIMIT_TOLERANCE = 1e-6

MOST_TRIALS = 60
"""Trials by which an output is found that agrees with itself; two or three are usual."""


def require_hysteron(hysteron: str) -> None:
    """Refuse a kind of hysteron that does not exist.

    Raises:
        InputError: `hysteron` is neither "relay" nor "ramp".
    """
    if hysteron not in HYSTERONS:
        raise InputError(f"hysteron is {hysteron!r}: it must be 'relay' or 'ramp'")


def as_float(values: ArrayLike, name: str) -> jax.Array:
    """Convert real numbers to a floating array.

    Whole numbers written in Python are real numbers. An array of integers is refused, because it
    usually holds a converter's raw counts.

    Args:
        values: real numbers of any shape.
        name: what they are, for the message; its last word is the name of the variable.

    Returns:
        Array of the same shape; float32 and float64 are kept where JAX allows them.

    Raises:
        InputError: the values are an array of integers, complex or not numbers.
    """
    array = jnp.asarray(values)
    if jnp.issubdtype(array.dtype, jnp.floating):
        # A Python number is weakly typed; a fixed type saves compiling everything twice.
        return array.astype(array.dtype)
    if not jnp.issubdtype(array.dtype, jnp.integer):
        raise InputError(f"{name} has the type {array.dtype}: give real numbers")
    if hasattr(values, "dtype"):
        raise InputError(
            f"{name} has the type {getattr(values, 'dtype', None)}: convert it first, as in "
            f"{name.rsplit(maxsplit=1)[-1]}.astype(float)"
        )
    return array.astype(jnp.result_type(float))


def require_finite(values: ArrayLike, name: str, *, missing: bool = False) -> None:
    """Refuse values that are not finite; traced values have none yet and pass.

    Args:
        values: numbers of any shape.
        name: what they are, for the message.
        missing: whether NaN is allowed, for a value that is missing.

    Raises:
        InputError: a value is not finite.
    """
    if isinstance(values, Tracer):
        return
    flat = np.ravel(np.asarray(values))
    wrong = np.isinf(flat) if missing else ~np.isfinite(flat)
    if wrong.any():
        first = int(np.argmax(wrong))
        remedy = "give NaN where the output is missing" if missing else "give finite numbers"
        raise InputError(f"{name} is {flat[first]}{_at(first, flat.size)}: {remedy}")


def require_on_plane(plane: Plane, x: ArrayLike) -> None:
    """Refuse an input that is not finite or leaves the plane; a traced one passes and saturates.

    Args:
        plane: the Preisach plane.
        x: () or (time,) floating input, in the unit of the plane.

    Raises:
        InputError: an input is not finite, or beyond the plane's limits by more than rounding.
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
            f"the input x is {flat[first]:.8g}{_at(first, flat.size)}, and the plane reaches from "
            f"{plane.low} to {plane.high}: make the plane wider, or clip the input"
        )


def _at(sample: int, samples: int) -> str:
    return f" at sample {sample}" if samples > 1 else ""


def position_on(plane: Plane, x: Any) -> Any:
    """Position of an input on an axis of the plane, (x - low)/δx, 0 to levels.

    Args:
        plane: the Preisach plane.
        x: inputs in the unit of the plane, a floating array of JAX or NumPy.

    Returns:
        Positions, of the kind, type and shape of `x`; exactly 0 at low and exactly `levels` at
        high, and beyond the plane beyond these.
    """
    low, high = x.dtype.type(plane.low), x.dtype.type(plane.high)
    return (x - low) / (high - low) * plane.levels


def thresholds_reached(
    plane: Plane, previous: jax.Array, x: jax.Array, hysteron: str
) -> tuple[jax.Array, jax.Array]:
    """Tell how far the input has reached each hysteron's two thresholds.

    Relay: χ(x - α) and χ(x - β) of (3), (4) in 0/1 form. A rising input reaches a threshold on
    which it rests exactly (3), a falling one has left it (4). An input that does not move decides
    nothing at equality, so that the state is kept there; by rule (1), so it is at the first sample.

    Ramp: ρ_i(x) = clip((x - low)/δx - i, 0, 1), a ramp of width δx centred on threshold i.

    Args:
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
    plane: Plane, states: jax.Array, previous: jax.Array, x: jax.Array, hysteron: str = "ramp"
) -> jax.Array:
    """Advance all hysterons by one sample of the input.

    Eq. (2) in 0/1 form, y(k) = min(on_β, max(y(k-1), on_α)), for relays and ramps alike.

    Args:
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
        >>> from preisach_jax.plane import Plane
        >>> plane = Plane(levels=2, low=0.0, high=2.0)
        >>> hysteron_step(plane, jnp.zeros(3), jnp.asarray(0.0), jnp.asarray(1.25)).tolist()
        [1.0, 0.25, 0.25]
    """
    on_alpha, on_beta = thresholds_reached(plane, previous, x, hysteron)
    return jnp.minimum(on_beta, jnp.maximum(states, on_alpha))


def hysteron_states(
    plane: Plane,
    x: ArrayLike,
    initial_states: ArrayLike | str = "low",
    hysteron: str = "ramp",
    falling: ArrayLike | None = None,
    reversible: ArrayLike | None = None,
) -> jax.Array:
    """Follow the states of all hysterons along an input, eq. (1)-(4).

    Args:
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
        >>> from preisach_jax.plane import Plane
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


def _step_of_paths(
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
        states = _step_of_paths(plane, states, previous, now, hysteron)
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

    Args:
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
        >>> from preisach_jax.plane import Plane
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
        low = _step_of_paths(plane, low, previous, now, hysteron)
        high = _step_of_paths(plane, high, previous, now, hysteron)
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

    Args:
        plane: the Preisach plane.
        weights: (cells,) weights R, not negative.
        memory: (cells,) output m that each unknown start adds, not negative.
        course: arrays whose first axis is time: what drives the hysterons beside their output.
        seen: inputs of thresholds α, of β, and of the diagonal, from a sample of the course, the
            output before it, and a trial of the output at it.
        hysteron: "relay" or "ramp".

    Returns:
        (time,) output h, in output units.

    Example:
        >>> from preisach_jax.plane import Plane
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
            low, high = (_step_of_paths(plane, each, previous, now, hysteron) for each in states)
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

    Args:
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
        >>> from preisach_jax.plane import Plane
        >>> low, high = state_bounds(Plane(levels=2, low=0.0, high=2.0), [1.0, 2.0], "relay")
        >>> (high - low).sum(axis=1).tolist()
        [1.0, 0.0]
    """
    low = hysteron_states(plane, x, "low", hysteron, falling, reversible)
    return low, hysteron_states(plane, x, "high", hysteron, falling, reversible)


def as_path(plane: Plane, x: ArrayLike) -> jax.Array:
    """Check an input: a row of numbers on the plane.

    Values are checked where there are any: inside a compiled function an input beyond the plane
    passes, and the hysterons saturate.

    Args:
        plane: the Preisach plane.
        x: (time,) input, in the unit of the plane.

    Returns:
        (time,) input with a floating type.

    Raises:
        InputError: it is not such a row.
    """
    x = as_float(x, "the input x")
    if x.ndim != 1 or x.shape[0] == 0:
        raise InputError(f"the input x has the shape {x.shape}: give (time,), with time > 0")
    require_on_plane(plane, x)
    return x


def path_and_start(
    plane: Plane, x: ArrayLike, initial_states: ArrayLike | str, hysteron: str
) -> tuple[jax.Array, jax.Array]:
    """Check an input and the states before it, and bring both to one floating type.

    Args:
        plane: the Preisach plane.
        x: (time,) input, in the unit of the plane.
        initial_states: (cells,) states in [0, 1], or the name of an initial memory.
        hysteron: "relay" or "ramp".

    Returns:
        `(x, states)`: (time,) and (cells,).

    Raises:
        InputError: a shape, a type or a name is wrong, or the input leaves the plane.
    """
    require_hysteron(hysteron)
    x = as_path(plane, x)
    if isinstance(initial_states, str):
        return x, plane.initial_states(initial_states, x[0], hysteron)
    states = as_float(initial_states, "initial_states").astype(x.dtype)
    if states.shape != (plane.cells,):
        raise InputError(f"initial_states has the shape {states.shape}: give ({plane.cells},)")
    return x, states

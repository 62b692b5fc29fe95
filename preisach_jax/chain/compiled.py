"""What effects and the Preisach operator compute, compiled once for all records of a size."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache, partial, wraps
from typing import Any, Concatenate, ParamSpec, TypeVar, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.dtypes import canonicalize_dtype
from jax.typing import ArrayLike
from jaxtyping import Array

from preisach_jax.chain.signals import Drive
from preisach_jax.effects.base import (
    AddedEffect,
    Effect,
    HysteresisEffect,
    InputEffect,
    OutputEffect,
    SensorEffect,
    Signals,
    Stepped,
    Values,
    WeightEffect,
    mistakes_named,
)
from preisach_jax.effects.linear import StateSpace, filtered, over_steps
from preisach_jax.errors import EffectError
from preisach_jax.operator.plane import Plane
from preisach_jax.operator.simulation import output_after
from preisach_jax.operator.states import hysteron_states, state_bounds, weighted_states

Given = ParamSpec("Given")

Result = TypeVar("Result")

Kind = TypeVar("Kind", bound=Effect)

Course = TypeVar("Course")

SENSOR_ROUNDS = 16
"""Steps by which a sensor's map is inverted."""

LEAST_SLOPE = 0.05
"""Slope of a sensor's map below which it is taken to fold, where there is no inverse."""

LENGTH_DIGITS = 9
"""Digits to which the length of a step counts, over the usual one."""

LEAST_LENGTHS = 16
"""Lengths of steps over which a linear effect is computed at once, at least."""

ROUND_COLUMNS = 64
"""Unit of the number of columns that an effect of the output is compiled for."""


def _expect(effect: Effect, method: str, got: Array, shape: tuple[int, ...]) -> Array:
    # Checked because a wrong shape can also fit somewhere by broadcasting or cutting.
    if jnp.shape(got) != shape:
        raise EffectError(
            f"the effect {effect.name!r} returns the shape {jnp.shape(got)} from {method}; make it "
            f"return {shape}"
        )
    return got


def as_array(leaf: Any) -> Any:
    # Python floats would be compiled in as constants; NumPy makes arrays of them in no time.
    return np.asarray(leaf, canonicalize_dtype(float)) if isinstance(leaf, float) else leaf


def is_traced(*given: Any) -> bool:
    """Whether numbers of some trees are those of a program: known ones need none compiled."""
    return any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(given))


def in_numpy(values: Any) -> Any:
    """An array in NumPy, unless it is traced."""
    return values if is_traced(values) else np.asarray(values)


def _jitted(function: Callable[..., Result]) -> Callable[..., Result]:
    """`equinox.filter_jit` at a third of the time of a call, of which short records need many."""

    @partial(jax.jit, static_argnums=0)
    def compiled(known: tuple[Any, tuple[Any, ...]], numbers: list[Array]) -> Result:
        structure, plain = known
        left = iter(numbers)
        leaves = [next(left) if leaf is _NUMBERS else leaf for leaf in plain]
        arguments, named = jax.tree.unflatten(structure, leaves)
        return function(*arguments, **named)

    def call(*arguments: Any, **named: Any) -> Result:
        leaves, structure = cast(tuple[list[Any], Any], jax.tree.flatten((arguments, named)))
        plain = tuple(_NUMBERS if isinstance(leaf, _ARRAYS) else leaf for leaf in leaves)
        numbers: list[Any] = [leaf for leaf in leaves if isinstance(leaf, _ARRAYS)]
        return cast(Result, compiled((structure, plain), numbers))

    return call


_ARRAYS = (np.ndarray, np.generic, jax.Array)

_NUMBERS = object()
"""What stands for an array among the leaves that a program is compiled for."""


def _compiled(
    function: Callable[Concatenate[Kind, Given], Result],
) -> Callable[Concatenate[Kind, Given], Result]:
    """Compile a function of an effect once for all records: its numbers become arguments."""
    compiled = _jitted(function)

    @wraps(function)
    def call(effect: Kind, *arguments: Given.args, **named: Given.kwargs) -> Result:
        with mistakes_named(effect):
            return compiled(jax.tree.map(as_array, effect), *arguments, **named)

    return call


def apply_effect(
    effect: InputEffect | OutputEffect, values: Values, signal: Array, time: Array
) -> Array:
    if _by_state_space(effect) and not is_traced(effect, values, signal, time):
        return cast(Array, _filtered(effect, values, np.asarray(signal)[:, None], time)[:, 0])
    return _applied(effect, values, signal, time)


@_compiled
def _applied(
    effect: InputEffect | OutputEffect, values: Values, signal: Array, time: Array
) -> Array:
    return _expect(effect, "apply", effect.at(values).apply(signal, time), time.shape)


def _by_state_space(effect: InputEffect | OutputEffect) -> bool:
    """Whether all samples of an effect are those of its state space."""
    return effect.is_linear and type(effect).apply is Stepped.apply


def _filtered(
    effect: InputEffect | OutputEffect, values: Values, signals: np.ndarray, time: Array
) -> np.ndarray:
    """Known `(time, signal)` signals behind a linear effect."""
    lengths, step = _lengths_of_steps(np.asarray(time).tobytes(), np.dtype(time.dtype))
    return np.asarray(_behind_law(effect, values, signals, lengths, step))


@_compiled
def _behind_law(
    effect: InputEffect | OutputEffect,
    values: Values,
    signals: ArrayLike,
    lengths: ArrayLike,
    step: ArrayLike,
) -> Array:
    law = over_steps(effect.at(values).state_space, jnp.asarray(lengths))
    return filtered(law, jnp.asarray(step), jnp.asarray(signals))


@lru_cache(8)
def _lengths_of_steps(time: bytes, kind: np.dtype) -> tuple[np.ndarray, np.ndarray]:
    """The lengths of the steps of a time, each once, and which of them leads to each sample."""
    dt = np.diff(np.frombuffer(time, kind), prepend=np.frombuffer(time, kind)[:1])
    usual = float(np.median(dt[1:])) if len(dt) > 1 else 1.0
    # What the rounding of times does to equal steps is no other length.
    lengths, step = np.unique(np.round(dt / usual, LENGTH_DIGITS), return_inverse=True)
    # Few numbers of them, so that few programs are compiled.
    room = max(LEAST_LENGTHS, 1 << (len(lengths) - 1).bit_length())
    return np.pad(lengths * usual, (0, room - len(lengths)), "edge"), step


@_compiled
def law_over_steps(effect: InputEffect | OutputEffect, values: Values, dt: ArrayLike) -> StateSpace:
    """A linear effect over steps of some lengths, `(length,)`."""
    return over_steps(effect.at(values).state_space, jnp.asarray(dt))


@_compiled
def _apply_to_padded(effect: OutputEffect, values: Values, matrix: ArrayLike, time: Array) -> Array:
    acting = effect.at(values)

    def apply(column: Array) -> Array:
        return _expect(effect, "apply", acting.apply(column, time), time.shape)

    return jax.vmap(apply, in_axes=1, out_axes=1)(jnp.asarray(matrix))


def apply_to_columns(
    effect: OutputEffect, values: Values, matrix: np.ndarray, time: Array
) -> np.ndarray:
    count = matrix.shape[1]
    # How many columns the initial memory takes differs from record to record.
    if lacking := -count % ROUND_COLUMNS:
        matrix = np.pad(matrix, ((0, 0), (0, lacking)))
    linear = _by_state_space(effect) and not is_traced(effect, values)
    apply = _filtered if linear else _apply_to_padded
    return np.asarray(apply(effect, values, matrix, time))[:, :count]


@_compiled
def factor_of(effect: WeightEffect, values: Values, signals: Signals) -> Array:
    return _expect(effect, "factor", effect.at(values).factor(signals), signals.time.shape)


@_compiled
def added_columns_of(
    effect: AddedEffect | WeightEffect, count: int, values: Values, signals: Signals
) -> Array:
    shape = (*signals.time.shape, count)
    return _expect(effect, "columns", effect.at(values).columns(signals), shape)


@_compiled
def widening_of(effect: HysteresisEffect, values: Values, path: Array, time: Array) -> Array:
    return _expect(effect, "widening", effect.at(values).widening(path, time), time.shape)


@_compiled
def fed_back_along(
    effect: HysteresisEffect, values: Values, path: Array, output: Array, time: Array
) -> Array:
    seen = effect.at(values).fed_back(path, output, time)
    return _expect(effect, "fed_back", seen, path.shape)


@_compiled
def free_response_of(effect: OutputEffect, count: int, signals: Signals) -> Array:
    shape = (*signals.time.shape, count)
    return _expect(effect, "free_response", effect.free_response(signals), shape)


@_compiled
def sensor_columns_of(effect: SensorEffect, count: int, values: Values, reading: Array) -> Array:
    shape = (*reading.shape, count)
    return _expect(effect, "columns", effect.at(values).columns(reading), shape)


@_compiled
def reading_of(effect: SensorEffect, values: Values, coefficients: Array, signal: Array) -> Array:
    """The reading z of a sensor before its converter: z - columns(z) @ coefficients = signal.

    Newton steps that bisect instead where they leave what is known to hold the reading (`rtsafe`
    in W. H. Press et al., Numerical Recipes, 3rd ed., Cambridge 2007, sec. 9.4).
    """
    sensor = (effect.at(values), coefficients, signal)
    # The last step has the derivatives of the solution, by the implicit function theorem.
    reading = _near_reading(*jax.lax.stop_gradient(sensor))
    value, slope = _excess(*sensor, reading)
    return reading - value / jax.lax.stop_gradient(jnp.maximum(slope, LEAST_SLOPE))


def _excess(
    sensor: SensorEffect, coefficients: Array, signal: Array, reading: Array
) -> tuple[Array, Array]:
    """z - columns(z) @ coefficients - signal, and its slope over z."""

    def excess(reading: Array) -> Array:
        return reading - sensor.columns(reading) @ coefficients - signal

    return jax.jvp(excess, (reading,), (jnp.ones_like(reading),))


def _near_reading(sensor: SensorEffect, coefficients: Array, signal: Array) -> Array:
    """The reading of a sensor, so near that one more step leaves the rounding."""

    def is_far(state: tuple[Array, ...]) -> Array:
        count, moved, *_ = state
        return (count < SENSOR_ROUNDS) & (moved > near * reach)

    def closer(state: tuple[Array, ...]) -> tuple[Array, ...]:
        count, _, low, high, reading = state
        value, slope = _excess(sensor, coefficients, signal, reading)
        low, high = jnp.where(value < 0, reading, low), jnp.where(value < 0, high, reading)
        step = reading - value / jnp.where(slope > LEAST_SLOPE, slope, LEAST_SLOPE)
        step = jnp.where((step >= low) & (step <= high), step, (low + high) / 2)
        return count + 1, jnp.max(jnp.abs(step - reading)), low, high, step

    near = float(np.sqrt(np.finfo(np.dtype(signal.dtype)).eps))
    reach = 2 * jnp.max(jnp.abs(_excess(sensor, coefficients, signal, signal)[0]))
    far = jnp.full_like(reach, jnp.inf)
    start = (jnp.asarray(0), far, signal - reach, signal + reach, signal)
    return jax.lax.while_loop(is_far, closer, start)[-1]


@_compiled
def converted_reading(effect: SensorEffect, values: Values, reading: Array) -> Array:
    """A reading in steps, whose derivatives are those of what is fitted, the reading before."""
    return reading + jax.lax.stop_gradient(effect.at(values).converted(reading) - reading)


# Compiled apart: inside other functions, what is computed of one path may differ in the last bit.
@jax.jit
def _scaled(path: Array, low: Array, width: Array) -> Array:
    return (path - low) / width


def compiled_on_a_plane(
    function: Callable[Concatenate[Plane, Course, Given], Result],
) -> Callable[Concatenate[Plane, Course, Given], Result]:
    """Compile a function of a plane and a drive once for all planes of a number of levels."""

    compiled = _jitted(function)

    @wraps(function)
    def call(plane: Plane, course: Course, *arguments: Given.args, **named: Given.kwargs) -> Result:
        low, width = as_array(float(plane.low)), as_array(float(plane.high - plane.low))

        def scaled(path: Array) -> Array:
            return cast(Array, _scaled(path, low, width))

        unit = plane.scaled()
        return compiled(unit, jax.tree.map(scaled, course), *arguments, **named)

    return call


@compiled_on_a_plane
def bounds_along(plane: Plane, drive: Drive, hysteron: str) -> tuple[Array, Array]:
    return state_bounds(plane, drive.rising, hysteron, drive.falling, drive.reversible)


@compiled_on_a_plane
def states_from_low(plane: Plane, drive: Drive, hysteron: str) -> Array:
    others = (drive.falling, drive.reversible)
    return hysteron_states(plane, drive.rising, "low", hysteron, *others)


def operator_along(plane: Plane, drive: Drive, weights: Any, memory: Any, hysteron: str) -> Array:
    weights, memory = in_numpy(weights), in_numpy(memory)
    if drive.falling is None and hysteron == "ramp":
        # Unknown starts add what they leave open: high less low states, weighed by the memory.
        high = plane.initial_turns("high")
        from_high = in_numpy(_ramps_along(plane, drive, memory, high))
        rest = _ramps_along(plane, drive, weights - memory, np.zeros_like(high))
        return from_high + in_numpy(rest)
    return in_numpy(_weighted_along(plane, drive, weights, memory, hysteron))


@compiled_on_a_plane
def _ramps_along(plane: Plane, drive: Drive, weights: Array, past: ArrayLike) -> Array:
    return output_after(plane, weights, past, drive.rising)


@compiled_on_a_plane
def _weighted_along(
    plane: Plane, drive: Drive, weights: Array, memory: Array, hysteron: str
) -> Array:
    others = (drive.falling, drive.reversible)
    return weighted_states(plane, weights, memory, drive.rising, hysteron, *others)


def as_arrays(values: Mapping[str, Any]) -> Values:
    return {
        name: as_array(float(value) if isinstance(value, int) else value)
        for name, value in values.items()
    }

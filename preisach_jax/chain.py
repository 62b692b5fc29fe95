"""The signal chain: input effects, Preisach operator, weight, output, added and sensor effects."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import wraps
from typing import Any, Concatenate, NamedTuple, ParamSpec, TypeVar, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Int

from preisach_jax.cores import on_all_cores
from preisach_jax.effects.base import (
    AddedEffect,
    Effect,
    HysteresisEffect,
    InputEffect,
    OutputEffect,
    Parameter,
    SensorEffect,
    Signals,
    Values,
    WeightEffect,
)
from preisach_jax.operator.branches import output_along_branches
from preisach_jax.operator.feedback import fed_back_states
from preisach_jax.operator.plane import Plane
from preisach_jax.operator.states import Paths, hysteron_states, state_bounds, weighted_states
from preisach_jax.record import Record

Given = ParamSpec("Given")
Result = TypeVar("Result")
Kind = TypeVar("Kind", bound=Effect)
Course = TypeVar("Course")

PLACES = (
    InputEffect,
    HysteresisEffect,
    WeightEffect,
    OutputEffect,
    AddedEffect,
    SensorEffect,
)

PLACE_NAMES = ("input", "hysterons", "weights", "output", "sum", "sensor")

SENSOR_ROUNDS = 16
"""Steps by which a sensor's map is inverted."""

LEAST_SLOPE = 0.05
"""Slope of a sensor's map below which it is taken to fold, where there is no inverse."""

MIDDLE = "middle"
"""Initial memory of which all that the first sample leaves open is halfway: that of a prediction
whose past is not known."""

EffectValues = Mapping[str, Mapping[str, float]]
"""Values of the nonlinear parameters, by effect and by name."""


class Chain(eqx.Module):
    """What is in a model and in which order, without its numbers.

    Arguments:
        plane: the Preisach plane.
        effects: effects; they act in the order of their places, and within a place in this order.
        hysteron: `"ramp"` or `"relay"`.
        polarity: sign of the weights: 1 where the output rises with the input, -1 where it falls.
        signed: whether there are weights of both signs, as in butterfly loops.

    Raises:
        ValueError: if two effects have one name, or one has a place that no chain has.

    Example:
        >>> from preisach_jax.effects.creep import Creep
        >>> chain = Chain(Plane(levels=5, low=0.0, high=1.0), (Creep(),))
        >>> [effect.name for effect in chain.at(OutputEffect)]
        ['creep']
    """

    plane: Plane
    effects: tuple[Effect, ...] = ()
    hysteron: str = eqx.field(static=True, default="ramp")
    polarity: int = eqx.field(static=True, default=1)
    signed: bool = eqx.field(static=True, default=False)

    def __check_init__(self) -> None:
        names = [effect.name for effect in self.effects]
        if len(set(names)) < len(names):
            raise ValueError(f"the effects {names} have a name twice; give each its own")
        for effect in self.effects:
            if not isinstance(effect, PLACES):
                raise ValueError(
                    f"the effect {effect.name!r} is a {type(effect).__name__}: derive it from "
                    + ", ".join(place.__name__ for place in PLACES)
                )

    def at(self, place: type[Kind]) -> list[Kind]:
        """The effects of one place, in order."""
        return [effect for effect in self.effects if isinstance(effect, place)]

    @property
    def stations(self) -> list[tuple[str, Effect]]:
        """Place and effect of all effects, in the order in which a signal passes them."""
        named = zip(PLACE_NAMES, PLACES, strict=True)
        return [(name, effect) for name, place in named for effect in self.at(place)]

    @property
    def coefficients(self) -> list[tuple[str, Parameter]]:
        """Effect and coefficient of each column behind the offset, in order."""
        beside = [*self.at(AddedEffect), *self.at(WeightEffect), *self.at(OutputEffect)]
        linear = [*beside, *self.at(SensorEffect)]
        return [(effect.name, each) for effect in linear for each in effect.coefficients()]

    @property
    def sensor_coefficients(self) -> int:
        """How many of the coefficients, the last ones, belong to the sensor."""
        return sum(len(effect.coefficients()) for effect in self.at(SensorEffect))

    @property
    def feeds_back(self) -> bool:
        """Whether an effect makes the input of the hysterons depend on their output."""
        return any(effect.feeds_back for effect in self.at(HysteresisEffect))

    def with_effects(self, effects: tuple[Effect, ...]) -> Chain:
        """The same plane and hysterons with other effects."""
        return replace(self, effects=effects)


@dataclass(frozen=True)
class Columns:
    """The regressors of a chain at given parameters: what its linear coefficients multiply.

    Attributes:
        matrix: (time, column), in the order cells, initial memory, offset, added effects.
        cells: how many columns belong to the cells of the plane.
        groups: for each column of the initial memory, the cells whose unknown start it carries;
            none for those of the first run.  Of several runs, cells count on from run to run.
        start: (cells,) stated initial memory, see `stated_start`; zero where it is unknown; of
            several runs one behind the other.
        first_run: (2 levels,) bool: which of the hysterons that switch in the first run only the
            last groups are, see `first_run_output`; of several runs one behind the other.
        added: names of the effects of the last columns, one each: added effects, free responses of
            output effects, and effects of the sensor.
        loose: (column,) whether it is there only for a past that is not known.
        polarity: sign of the weights, which the columns of the hysteresis carry.
        signed: whether the weights may have both signs.
        vectors: (hysteresis column, vector) combinations of the columns of the hysteresis, which
            stand in the matrix in their place; None where they stand there themselves.
        own: run and place of the columns just behind the offset, which are those of one run: place
            zero for what its offset differs by from the last run's, else from one on that of the
            coefficient.
    """

    matrix: np.ndarray
    cells: int
    groups: tuple[np.ndarray, ...]
    start: np.ndarray
    first_run: np.ndarray
    added: tuple[str, ...]
    loose: np.ndarray
    polarity: int = 1
    signed: bool = False
    vectors: np.ndarray | None = None
    own: tuple[tuple[int, int], ...] = ()

    @property
    def nonnegative(self) -> np.ndarray:
        """(column,) whether the coefficient must not be negative: weights and initial memory."""
        kinds = np.zeros(self.matrix.shape[1], dtype=bool)
        kinds[: self.offset] = self.vectors is None and not self.signed
        return kinds

    @property
    def offset(self) -> int:
        """Index of the constant column."""
        whole = self.cells + len(self.groups)
        return whole if self.vectors is None else self.vectors.shape[1]

    @property
    def first_added(self) -> int:
        """Index of the column of the first of the chain's coefficients."""
        return self.offset + 1 + len(self.own)

    def of_effect(self, effect: str) -> list[int]:
        """Indices of the columns of an effect, in all runs."""
        names, edge = self.added, self.offset + 1
        alone = [k for k, (_, place) in enumerate(self.own) if place and names[place - 1] == effect]
        common = [k for k, name in enumerate(names) if name == effect]
        return [*(edge + k for k in alone), *(self.first_added + k for k in common)]


def coarsened(plane: Plane, coefficients: Coefficients, levels: int) -> Coefficients:
    """The same density on a coarser plane over the same range.

    Each coarse cell gets the shares of the fine cells that lie in it.

    Arguments:
        plane: the plane of the coefficients.
        coefficients: the linear numbers of a model.
        levels: levels of the coarser plane.

    Returns:
        The coefficients on the coarser plane; weights keep their sum.
    """
    fine, coarse = np.arange(plane.levels + 1) / plane.levels, np.arange(levels + 1) / levels
    low = np.maximum(coarse[:-1, None], fine[None, :-1])
    high = np.minimum(coarse[1:, None], fine[None, 1:])
    shares = np.maximum(high - low, 0.0) * plane.levels
    rows, columns = np.tril_indices(plane.levels)

    def of_cells(values: np.ndarray) -> np.ndarray:
        laid_out = np.zeros((plane.levels, plane.levels))
        laid_out[rows, columns] = values
        square = shares @ laid_out @ shares.T
        # Of a fine cell on the diagonal some falls on the wrong side of that of the coarse plane.
        square = np.tril(square) + np.triu(square, 1).T
        return square[np.tril_indices(levels)]

    both = coefficients.first_run
    parts = np.split(both, len(both) // plane.levels) if len(both) else ()
    memories = np.split(coefficients.memory, len(coefficients.memory) // plane.cells)
    return replace(
        coefficients,
        weights=of_cells(coefficients.weights),
        memory=np.concatenate([of_cells(memory) for memory in memories]),
        first_run=np.concatenate([shares @ part for part in parts]) if parts else np.zeros(0),
    )


@dataclass(frozen=True)
class Coefficients:
    """The linear numbers of a model.

    Attributes:
        weights: (cells,) weights R, in output units; of one sign, that of the chain's polarity,
            unless the chain is signed.
        memory: (cells,) output that each hysteron's unknown start adds until the input forces it.
        offset: output with all hysterons off, but those of the first run as it leaves them.
        added: (column,) coefficients of the added effects, of free responses, and of the sensor.
        first_run: (2 levels,) weights of the hysterons that switch in the first run only, see
            `first_run_output`; empty if there are none.
        own: (run, 1 + column) offset and coefficients of the runs before the last one, whose
            `offset` and `added` are those above; empty for a single run.

    Of several runs, memory and first run stand one behind the other (see `runs`).
    """

    weights: np.ndarray
    memory: np.ndarray
    offset: float
    added: np.ndarray
    first_run: np.ndarray = field(default_factory=lambda: np.zeros(0))
    own: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))

    @staticmethod
    def from_columns(columns: Columns, solution: np.ndarray) -> Coefficients:
        """Sort a solution vector over the columns into its parts."""
        if columns.vectors is not None:
            behind = columns.vectors.shape[1]
            solution = np.concatenate([columns.vectors @ solution[:behind], solution[behind:]])
            columns = replace(columns, vectors=None)
        sign, weights = columns.polarity, solution[: columns.cells]
        memory = np.tile(weights, len(columns.start) // columns.cells) * columns.start
        for group, total in zip(columns.groups, solution[columns.cells :], strict=False):
            # The column fixes only the sum over the group: each cell gets its share by weight.
            each = weights[group % columns.cells]
            share = np.maximum(each, 0) + 1e-12 * (1 + np.abs(weights).max())
            if len(group):
                memory[group] = total * share / share.sum()
        first_run = np.zeros(len(columns.first_run))
        count = columns.first_run.sum()
        first_run[columns.first_run] = solution[columns.offset - count : columns.offset]
        offset, added = float(solution[columns.offset]), solution[columns.first_added :]
        runs = 1 + max((run for run, _ in columns.own), default=-1)
        own = np.tile(np.concatenate([[offset], added]), (runs, 1))
        for value, place in zip(solution[columns.offset + 1 :], columns.own, strict=False):
            own[place] = value + (offset if place[1] == 0 else 0.0)
        return Coefficients(sign * weights, sign * memory, offset, added, sign * first_run, own)

    def raised(self, level: float) -> Coefficients:
        """The same with all offsets greater by a level."""
        own = self.own.copy()
        own[:, :1] += level
        return replace(self, offset=self.offset + level, own=own)


def signals_of(record: Record, origin_s: float | None = None) -> Signals:
    """What of a record drives a model, on the device.

    Arguments:
        record: the record.
        origin_s: time of the record that is zero for the effects; its first sample by default.
    """
    origin = record.time[0] if origin_s is None else origin_s
    return Signals(
        jnp.asarray(record.time - origin),
        jnp.asarray(record.input),
        {name: jnp.asarray(values) for name, values in record.aux.items()},
    )


class ThinnedSignals(Signals):
    """Signals of some samples of a record, with all of them for the effects of the input.

    Attributes:
        whole: the signals of all samples.
        kept: (time,) indices of the samples that are kept.
    """

    whole: Signals
    kept: Int[Array, " time"]


ROUND_COLUMNS = 64
"""Unit of the number of columns that an effect of the output is compiled for."""

MOST_COLUMNS = 192
"""Columns to which an effect of the output is applied at once: more take memory and no less time
each, fewer take more."""


GATHERED_ROWS = 256
"""Rows that are gathered at once: they stay in the processor's cache on their way."""


def _expect(effect: Effect, method: str, got: Array, shape: tuple[int, ...]) -> Array:
    # Checked because a wrong shape can also fit somewhere by broadcasting or cutting.
    if jnp.shape(got) != shape:
        raise ValueError(
            f"the effect {effect.name!r} returns the shape {jnp.shape(got)} from {method}, and it "
            f"must be {shape}"
        )
    return got


def _as_array(leaf: Any) -> Any:
    # Python floats would be compiled in as constants; NumPy makes arrays of them in no time.
    return np.asarray(leaf, jnp.result_type(float)) if isinstance(leaf, float) else leaf


def _compiled(
    function: Callable[Concatenate[Kind, Given], Result],
) -> Callable[Concatenate[Kind, Given], Result]:
    """Compile a function of an effect once for all records: its numbers become arguments."""
    compiled = eqx.filter_jit(function)

    @wraps(function)
    def call(effect: Kind, *arguments: Given.args, **named: Given.kwargs) -> Result:
        return compiled(jax.tree.map(_as_array, effect), *arguments, **named)

    return call


@_compiled
def _apply(effect: InputEffect | OutputEffect, values: Values, signal: Array, time: Array) -> Array:
    return _expect(effect, "apply", effect.apply(values, signal, time), time.shape)


@_compiled
def _apply_to_padded(effect: OutputEffect, values: Values, matrix: ArrayLike, time: Array) -> Array:
    def apply(column: Array) -> Array:
        return _expect(effect, "apply", effect.apply(values, column, time), time.shape)

    return jax.vmap(apply, in_axes=1, out_axes=1)(jnp.asarray(matrix))


def _apply_to_columns(
    effect: OutputEffect, values: Values, matrix: np.ndarray, time: Array
) -> np.ndarray:
    count = matrix.shape[1]
    # How many columns the initial memory takes differs from record to record.
    if lacking := -count % ROUND_COLUMNS:
        matrix = np.pad(matrix, ((0, 0), (0, lacking)))
    return np.asarray(_apply_to_padded(effect, values, matrix, time))[:, :count]


@_compiled
def _gain(effect: WeightEffect, values: Values, signals: Signals) -> Array:
    return _expect(effect, "gain", effect.gain(values, signals), signals.time.shape)


@_compiled
def _added_columns(
    effect: AddedEffect | WeightEffect, count: int, values: Values, signals: Signals
) -> Array:
    shape = (*signals.time.shape, count)
    return _expect(effect, "columns", effect.columns(values, signals), shape)


@_compiled
def _widening(effect: HysteresisEffect, values: Values, path: Array, time: Array) -> Array:
    return _expect(effect, "widening", effect.widening(values, path, time), time.shape)


@_compiled
def _fed_back(
    effect: HysteresisEffect, values: Values, path: Array, output: Array, time: Array
) -> Array:
    seen = effect.fed_back(values, path, output, time)
    return _expect(effect, "fed_back", seen, path.shape)


@_compiled
def _free_response(effect: OutputEffect, count: int, signals: Signals) -> Array:
    shape = (*signals.time.shape, count)
    return _expect(effect, "free_response", effect.free_response(signals), shape)


@_compiled
def _sensor_columns(effect: SensorEffect, count: int, values: Values, reading: Array) -> Array:
    shape = (*reading.shape, count)
    return _expect(effect, "columns", effect.columns(values, reading), shape)


@_compiled
def _reading(effect: SensorEffect, values: Values, coefficients: Array, signal: Array) -> Array:
    """The reading z of a sensor, which solves z - columns(z) @ coefficients = signal.

    Newton steps that bisect instead where they leave what is known to hold the reading (`rtsafe`
    in W. H. Press et al., Numerical Recipes, 3rd ed., Cambridge 2007, sec. 9.4).
    """

    def excess(reading: Array) -> Array:
        return reading - effect.columns(values, reading) @ coefficients - signal

    def value_and_slope(reading: Array) -> tuple[Array, Array]:
        return jax.jvp(excess, (reading,), (jnp.ones_like(reading),))

    def closer(_: Array, state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        low, high, reading = state
        value, slope = value_and_slope(reading)
        low, high = jnp.where(value < 0, reading, low), jnp.where(value < 0, high, reading)
        step = reading - value / jnp.where(slope > LEAST_SLOPE, slope, LEAST_SLOPE)
        inside = (step >= low) & (step <= high)
        return low, high, jnp.where(inside, step, (low + high) / 2)

    reach = 2 * jnp.max(jnp.abs(excess(signal)))
    start = (signal - reach, signal + reach, signal)
    found = cast(tuple[Array, Array, Array], jax.lax.fori_loop(0, SENSOR_ROUNDS, closer, start))
    reading = jax.lax.stop_gradient(found[2])
    # The last step has the derivatives of the solution, by the implicit function theorem.
    value, slope = value_and_slope(reading)
    reading = reading - value / jax.lax.stop_gradient(jnp.maximum(slope, LEAST_SLOPE))
    # Steps have no slope: derivatives are those of what is fitted, the reading before them.
    return reading + jax.lax.stop_gradient(effect.converted(values, reading) - reading)


def _compiled_on_a_plane(
    function: Callable[Concatenate[Plane, Course, Given], Result],
) -> Callable[Concatenate[Plane, Course, Given], Result]:
    """Compile a function of a plane and a drive once for all planes of equal levels."""
    compiled = eqx.filter_jit(function)

    @wraps(function)
    def call(plane: Plane, course: Course, *arguments: Given.args, **named: Given.kwargs) -> Result:
        unit = Plane(plane.levels, 0.0, 1.0)
        low, width = plane.low, plane.high - plane.low

        def scaled(path: Array) -> Array:
            return (path - low) / width

        return compiled(unit, jax.tree.map(scaled, course), *arguments, **named)

    return call


@_compiled_on_a_plane
def _state_bounds(plane: Plane, drive: Drive, hysteron: str) -> tuple[Array, Array]:
    return state_bounds(plane, drive.rising, hysteron, drive.falling, drive.reversible)


@_compiled_on_a_plane
def _states_from_low(plane: Plane, drive: Drive, hysteron: str) -> Array:
    others = (drive.falling, drive.reversible)
    return hysteron_states(plane, drive.rising, "low", hysteron, *others)


@_compiled_on_a_plane
def _operator(plane: Plane, drive: Drive, weights: Array, memory: Array, hysteron: str) -> Array:
    if drive.falling is None and hysteron == "ramp":
        # Unknown starts add what they leave open: high less low states, weighed by the memory.
        from_high = output_along_branches(plane, memory, drive.rising, hysteron, "high")
        return from_high + output_along_branches(
            plane, weights - memory, drive.rising, hysteron, "low"
        )
    others = (drive.falling, drive.reversible)
    return weighted_states(plane, weights, memory, drive.rising, hysteron, *others)


def _arrays(values: Mapping[str, Any]) -> Values:
    return {
        name: _as_array(float(value) if isinstance(value, int) else value)
        for name, value in values.items()
    }


def driven_path(chain: Chain, values: EffectValues, signals: Signals) -> jax.Array:
    """The input behind the effects of the input, `(time,)`."""
    if isinstance(signals, ThinnedSignals):
        return driven_path(chain, values, signals.whole)[signals.kept]
    path = signals.input
    for effect in chain.at(InputEffect):
        path = _apply(effect, _arrays(values[effect.name]), path, signals.time)
    return path


class Drive(NamedTuple):
    """What the hysterons see, `(time,)`: at their thresholds α, and at β where that differs.

    Those on the diagonal, which are reversible, see `reversible` where that differs too.
    """

    rising: jax.Array
    falling: jax.Array | None = None
    reversible: jax.Array | None = None


def drive(
    chain: Chain, values: EffectValues, signals: Signals, output: ArrayLike | None = None
) -> Drive:
    """What the hysterons see, behind the effects of the input and with those inside.

    Arguments:
        chain: what is in the model.
        values: its nonlinear parameters.
        signals: what drives it.
        output: (time,) output of the Preisach operator, for an effect that feeds it back; without
            it nothing is fed back.
    """
    path, widened = _path_and_widening(chain, values, signals)
    if output is not None:
        for effect in chain.at(HysteresisEffect):
            own = _arrays(values[effect.name])
            rising = chain.polarity * jnp.asarray(output)
            path = _fed_back(effect, own, path, rising, signals.time)
    if widened is None:
        return Drive(path)
    return Drive(path - widened, path + widened, None if _all_widen(chain) else path)


def _path_and_widening(
    chain: Chain, values: EffectValues, signals: Signals
) -> tuple[jax.Array, jax.Array | None]:
    """The input behind the effects of the input, and by how much thresholds move outward."""
    # The speed of the input is that of all samples, also where some are left out.
    thinned = isinstance(signals, ThinnedSignals)
    whole = signals.whole if thinned else signals
    course, widened = driven_path(chain, values, whole), None
    for effect in chain.at(HysteresisEffect):
        shift = _widening(effect, _arrays(values[effect.name]), course, whole.time)
        shift = shift[signals.kept] if thinned else shift
        widened = shift if widened is None else widened + shift
    return course[signals.kept] if thinned else course, widened


def _all_widen(chain: Chain) -> bool:
    return any(effect.widens_reversible for effect in chain.at(HysteresisEffect))


@dataclass(frozen=True)
class HysteresisColumns:
    """States of the hysterons along a path, and what their unknown start leaves open.

    Attributes:
        states: (time, cell + group) states, then a column for each group of cells of the initial
            memory.
        switched: (time, column) course of the hysterons of the first run.
        groups: the cells of each group; none for those of the first run, which come last.
        start: (cells,) stated initial memory, see `stated_start`; zero where it is unknown.
        first_run: (2 levels,) bool: which hysterons of the first run have a column.
        vectors: (column, vector) combinations of states and switched, which stand in their place
            as states; None where these stand there themselves.
    """

    states: np.ndarray
    switched: np.ndarray
    groups: tuple[np.ndarray, ...]
    start: np.ndarray
    first_run: np.ndarray
    vectors: np.ndarray | None = None

    @property
    def cells(self) -> int:
        """How many columns belong to the cells of the plane."""
        return self.states.shape[1] - sum(1 for group in self.groups if len(group))

    def some(self, first: int) -> np.ndarray:
        """Up to `MOST_COLUMNS` columns from a first one on; those of the first run come last."""
        edge, last = self.states.shape[1], first + MOST_COLUMNS
        if last <= edge:
            return self.states[:, first:last]
        beyond = self.switched[:, max(first - edge, 0) : last - edge]
        return np.concatenate([self.states[:, first:], beyond], axis=1)

    def combined(self, vectors: np.ndarray) -> HysteresisColumns:
        """Combinations, `(column, vector)`, in place of the columns."""
        plane = self.states.shape[1]
        states = self.states @ vectors[:plane] + self.switched @ vectors[plane:]
        return replace(self, states=states, switched=self.switched[:, :0], vectors=vectors)


def hysteresis_columns(
    chain: Chain, course: Drive, initial_memory: str, open_course: Drive | None = None
) -> HysteresisColumns:
    """Columns of the Preisach operator along what drives it.

    Arguments:
        chain: what is in the model.
        course: what the hysterons see.
        initial_memory: `"free"`, or `"low"`, `"high"`, `"demagnetised"`, `MIDDLE`.
        open_course: the same without what is fed back, by default the same.
    """
    states, groups, start = _plane_columns(chain, course, initial_memory)
    if initial_memory in ("low", "high", MIDDLE):  # saturated: no threshold lies beyond the range
        none = np.zeros(2 * chain.plane.levels, dtype=bool)
        return HysteresisColumns(states, np.zeros((len(states), 0)), groups, start, none)
    rising, falling = _extremes(open_course or course)
    switched = np.concatenate([_reached(chain, rising) - 1, _reached(chain, falling)], axis=1)
    seen = np.ptp(switched, axis=0) > 0
    groups = (*groups, *[np.zeros(0, dtype=int)] * seen.sum())
    return HysteresisColumns(states, switched[:, seen], groups, start, seen)


def _plane_columns(
    chain: Chain, course: Drive, initial_memory: str
) -> tuple[np.ndarray, tuple[np.ndarray, ...], np.ndarray]:
    nothing = np.zeros(chain.plane.cells)
    first_low, first_high = _state_bounds(chain.plane, _first(course), chain.hysteron)
    start = nothing if initial_memory == "free" else stated_start(chain, course, initial_memory)
    if not (first_high > first_low).any() or (initial_memory != "free" and not start.any()):
        # The first sample forces all hysterons, or those it leaves open are off.
        states = _states_from_low(chain.plane, course, chain.hysteron)
        return np.asarray(states), (), start
    bounds = _state_bounds(chain.plane, course, chain.hysteron)
    low, high = (np.asarray(bound) for bound in bounds)
    if initial_memory == "free":
        return *_with_memory_columns(low, high), nothing
    return low + start[None, :] * (high - low), (), start


@eqx.filter_jit
def _extremes(course: Drive) -> tuple[jax.Array, jax.Array]:
    """Greatest input so far at the thresholds α, and least one at the thresholds β."""
    falling = course.rising if course.falling is None else course.falling
    return course.rising[_last_records(course.rising)], falling[_last_records(-falling)]


def _last_records(path: jax.Array) -> jax.Array:
    """Where the greatest value so far was reached, `(time,)`.

    The derivative of a value taken from there is a gather; that of `cummax` is a tree of slices,
    which took twenty times as long.
    """
    path = jax.lax.stop_gradient(path)
    reached = jnp.where(path == jax.lax.cummax(path), jnp.arange(len(path)), 0)
    return jax.lax.cummax(reached)


def _reached(chain: Chain, path: jax.Array) -> np.ndarray:
    """How far a path has reached each threshold, `(time, levels)`."""
    plane = chain.plane
    if chain.hysteron == "relay":
        return (np.asarray(path)[:, None] >= plane.thresholds).astype(float)
    position = (np.asarray(path) - plane.low) / plane.delta_x
    return np.clip(position[:, None] - np.arange(plane.levels), 0.0, 1.0)


def first_run_output(chain: Chain, course: Drive, first_run: np.ndarray) -> jax.Array:
    r"""What hysterons add whose other threshold lies beyond the range of the input, `(time,)`.

    Those with β below it that are off at the start switch on when the input first reaches α, and
    never off again; those with α above it that are on switch off for good at β.  They make the
    virgin curve: \(\sum_i h_i (\rho_i(\max_{s \le t} x_s) - 1) +
    \sum_j g_j \rho_j(\min_{s \le t} x_s)\), zero when the input has been through all its range.

    Arguments:
        chain: what is in the model.
        course: what the hysterons see, without what is fed back.
        first_run: (2 levels,) weights h of the former, then g of the latter; empty for none.
    """
    if not len(first_run):
        return jnp.zeros_like(course.rising)
    return _switched_output(chain.plane, _extremes(course), jnp.asarray(first_run), chain.hysteron)


@_compiled_on_a_plane
def _switched_output(
    plane: Plane, extremes: tuple[Array, Array], first_run: Array, hysteron: str
) -> Array:
    steps = jnp.arange(plane.levels + 1, dtype=first_run.dtype)

    def switched(path: Array, weights: Array) -> Array:
        whole = jnp.concatenate([jnp.zeros(1), jnp.cumsum(weights)])
        position = (path - plane.low) / plane.delta_x
        if hysteron == "relay":
            position = jnp.floor(position + 0.5)
        return jnp.interp(position, steps, whole)

    highest, lowest = extremes
    rising, falling = first_run[: plane.levels], first_run[plane.levels :]
    return switched(highest, rising) - rising.sum() + switched(lowest, falling)


def stated_start(chain: Chain, course: Drive, initial_memory: str) -> np.ndarray:
    """Share of what the first sample leaves open that a stated initial memory switches on.

    Arguments:
        chain: what is in the model.
        course: what the hysterons see.
        initial_memory: `"low"`, `"high"`, `"demagnetised"` or `MIDDLE`.

    Returns:
        (cells,) shares: zero or one, and a half for ramps on the line of demagnetisation.
    """
    low, high = (
        np.asarray(bound[0]) for bound in _state_bounds(chain.plane, _first(course), chain.hysteron)
    )
    first, gap = course.rising[0], high - low
    if initial_memory == MIDDLE:
        return np.where(gap > 0, 0.5, 0.0)
    states = np.asarray(chain.plane.initial_states(initial_memory, first, chain.hysteron))
    return np.where(gap > 0, (states - low) / np.where(gap > 0, gap, 1.0), 0.0)


def _first(course: Drive) -> Drive:
    def first(path: Array) -> Array:
        return path[:1]

    return jax.tree.map(first, course)


def hysteresis_output(
    chain: Chain, values: EffectValues, signals: Signals, coefficients: Coefficients
) -> jax.Array:
    """Output of the Preisach operator (6) and of the first run, without offset, `(time,)`.

    Where it is fed back, the output that agrees with itself is found sample by sample.
    """
    course = drive(chain, values, signals)
    first_run = first_run_output(chain, course, coefficients.first_run)
    if not chain.feeds_back:
        return _operator_output(chain, course, coefficients) + first_run
    path, widened = _path_and_widening(chain, values, signals)
    inside = [effect for effect in chain.at(HysteresisEffect) if effect.feeds_back]
    low, width = chain.plane.low, chain.plane.high - chain.plane.low
    sign = chain.polarity  # what is fed back rises with the input
    shift = jnp.zeros_like(path) if widened is None else widened
    output = _fed_back_operator(
        Plane(chain.plane.levels, 0.0, 1.0),
        jax.tree.map(_as_array, inside),
        [_arrays(values[effect.name]) for effect in inside],
        (path, signals.time, shift, sign * first_run),
        (jnp.asarray(low), jnp.asarray(width)),
        (jnp.asarray(sign * coefficients.weights), jnp.asarray(sign * coefficients.memory)),
        _all_widen(chain),
        chain.hysteron,
    )
    return sign * output + first_run


@eqx.filter_jit
def _fed_back_operator(
    plane: Plane,
    effects: list[HysteresisEffect],
    values: list[Values],
    course: tuple[Array, Array, Array, Array],
    scale: tuple[Array, Array],
    coefficients: tuple[Array, Array],
    all_widen: bool,
    hysteron: str,
) -> Array:
    """Output of the operator on a plane from 0 to 1, whose inputs are scaled to it."""

    def seen(sample: list[Array], before: Array, output: Array) -> Paths:
        pair, time, shift, beside = sample
        whole = jnp.stack([before, output]) + beside
        for effect, own in zip(effects, values, strict=True):
            pair = effect.fed_back(own, pair, whole, time)
        path, shift = (pair[-1] - scale[0]) / scale[1], shift[-1] / scale[1]
        return (path - shift, path + shift, *([] if all_widen else [path]))

    pairs = [jnp.stack([jnp.roll(each, 1).at[0].set(each[0]), each], axis=1) for each in course]
    weights, memory = coefficients
    return fed_back_states(plane, weights, memory, pairs, seen, hysteron)


def _operator_output(chain: Chain, course: Drive, coefficients: Coefficients) -> jax.Array:
    weights, memory = jnp.asarray(coefficients.weights), jnp.asarray(coefficients.memory)
    return _operator(chain.plane, course, weights, memory, chain.hysteron)


def behind_hysteresis(
    chain: Chain,
    values: EffectValues,
    signals: Signals,
    hysteresis: jax.Array,
    coefficients: Coefficients,
    known: Mapping[str, jax.Array] | None = None,
) -> jax.Array:
    """From the output of the Preisach operator to that of the model, `(time,)`.

    Arguments:
        chain: what is in the model.
        values: its nonlinear parameters.
        signals: what drives it.
        hysteresis: (time,) output of the operator.
        coefficients: its linear coefficients.
        known: those of the `_columns_beside` that need not be computed again.
    """
    signal = hysteresis
    for factor in _gains(chain, values, signals):
        signal = signal * factor
    for effect in chain.at(OutputEffect):
        signal = _apply(effect, _arrays(values[effect.name]), signal, signals.time)
    signal = signal + coefficients.offset
    start = 0
    for columns in _columns_beside(chain, values, signals, known or {}).values():
        stop = start + columns.shape[1]
        signal = signal + columns @ jnp.asarray(coefficients.added[start:stop])
        start = stop
    return sensed(chain, values, signal, coefficients)


def sensed(
    chain: Chain, values: EffectValues, signal: jax.Array, coefficients: Coefficients
) -> jax.Array:
    """What the sensor reads of the output of the rest of the model, `(time,)`."""
    start = len(coefficients.added) - chain.sensor_coefficients
    for effect in chain.at(SensorEffect):
        stop = start + len(effect.coefficients())
        share = jnp.asarray(coefficients.added[start:stop])
        signal = _reading(effect, _arrays(values[effect.name]), share, signal)
        start = stop
    return signal


def _columns_beside(
    chain: Chain, values: EffectValues, signals: Signals, known: Mapping[str, jax.Array]
) -> dict[str, jax.Array]:
    """What adds to the output beside the hysteresis, by effect: added ones, and free responses."""
    others = [*chain.at(WeightEffect), *chain.at(OutputEffect)]
    beside: dict[str, jax.Array] = {}
    for effect in (*chain.at(AddedEffect), *(other for other in others if other.coefficients())):
        count = len(effect.coefficients())
        if effect.name in known:
            beside[effect.name] = known[effect.name]
        elif isinstance(effect, OutputEffect):
            beside[effect.name] = _free_response(effect, count, signals)
        else:
            own = _arrays(values[effect.name])
            columns = _added_columns(effect, count, own, signals)
            if isinstance(effect, AddedEffect) and effect.scaled:
                for factor in _gains(chain, values, signals):
                    columns = columns * factor[:, None]
            beside[effect.name] = columns
    return beside


def _gains(chain: Chain, values: EffectValues, signals: Signals) -> list[jax.Array]:
    """Factors of the effects of the weights, `(time,)` each."""
    return [
        _gain(effect, _arrays(values[effect.name]), signals) for effect in chain.at(WeightEffect)
    ]


def _unmoved(chain: Chain, beside: Mapping[str, jax.Array], moved: str) -> dict[str, jax.Array]:
    """Those of the `_columns_beside` that stay while the parameters of an effect move."""
    gone = {moved}
    if moved in [effect.name for effect in chain.at(WeightEffect)]:
        gone |= {effect.name for effect in chain.at(AddedEffect) if effect.scaled}
    return {name: columns for name, columns in beside.items() if name not in gone}


def response(
    chain: Chain, values: EffectValues, signals: Signals, coefficients: Coefficients
) -> jax.Array:
    """The output of a model, `(time,)`."""
    hysteresis = hysteresis_output(chain, values, signals, coefficients)
    return behind_hysteresis(chain, values, signals, hysteresis, coefficients)


def tangents(
    chain: Chain,
    values: EffectValues,
    signals: Signals,
    coefficients: Coefficients,
    parameters: list[tuple[str, str]],
) -> np.ndarray:
    """Derivatives of the output with respect to nonlinear parameters, `(time, parameters)`.

    Forward-mode derivatives; the Preisach operator is differentiated only for effects of the input
    and inside it.  What is fed back is held fixed, as it is in the `regressors`.
    """
    if not parameters:
        return np.zeros((len(signals.time), 0))
    before = {effect.name for place in PLACES[:2] for effect in chain.at(place)}
    hysteresis = None
    if chain.feeds_back or any(effect not in before for effect, _ in parameters):
        hysteresis = hysteresis_output(chain, values, signals, coefficients)
    beside = _columns_beside(chain, values, signals, {})

    def along(effect: str, names: list[str]) -> np.ndarray:
        others = _unmoved(chain, beside, effect)

        def output(own: dict[str, Array]) -> Array:
            moved: Mapping[str, Mapping[str, Any]] = {**values, effect: {**values[effect], **own}}
            if effect in before:
                plain = course = drive(chain, moved, signals)
                if chain.feeds_back:
                    course = drive(chain, moved, signals, hysteresis)
                given = _operator_output(chain, course, coefficients)
                given = given + first_run_output(chain, plain, coefficients.first_run)
            else:
                assert hysteresis is not None
                given = hysteresis
            return behind_hysteresis(chain, moved, signals, given, coefficients, others)

        at = {name: jnp.asarray(values[effect][name], dtype=float) for name in names}
        each = dict(zip(names, jnp.eye(len(names)), strict=True))

        def derivative(step: dict[str, Array]) -> Array:
            return jax.jvp(output, (at,), (step,))[1]

        return np.asarray(jax.vmap(derivative)(each))

    effects = dict.fromkeys(effect for effect, _ in parameters)
    columns: dict[tuple[str, str], np.ndarray] = {}
    for effect in effects:
        names = [name for of, name in parameters if of == effect]
        columns |= zip(((effect, name) for name in names), along(effect, names), strict=True)
    return np.stack([columns[parameter] for parameter in parameters], axis=1)


def responses(
    chain: Chain,
    values: EffectValues,
    signals: Signals,
    coefficients: Coefficients,
    effect: str,
    many: list[dict[str, float]],
) -> np.ndarray:
    """Outputs of a model at several values of one effect's parameters, `(values, time)`.

    Arguments:
        chain: what is in the model.
        values: nonlinear parameters of the other effects.
        signals: what drives it.
        coefficients: its linear coefficients.
        effect: the effect's name.
        many: values of its parameters.
    """
    before = {each.name for place in PLACES[:2] for each in chain.at(place)}
    if effect in before or chain.feeds_back:
        everything = [{**values, effect: own} for own in many]
        outputs = [response(chain, each, signals, coefficients) for each in everything]
        return np.stack([np.asarray(output) for output in outputs])
    hysteresis = hysteresis_output(chain, values, signals, coefficients)
    others = _columns_beside(chain, {**values, effect: many[0]}, signals, {})
    others = _unmoved(chain, others, effect)

    def output(own: dict[str, Array]) -> Array:
        moved = cast(EffectValues, {**values, effect: own})
        return behind_hysteresis(chain, moved, signals, hysteresis, coefficients, others)

    stacked = {name: jnp.asarray([own[name] for own in many], dtype=float) for name in many[0]}
    if not stacked:
        return np.stack([np.asarray(output({}))] * len(many))
    return np.asarray(jax.vmap(output)(stacked))


def regressors(
    chain: Chain,
    values: EffectValues,
    signals: Signals,
    hysteresis: HysteresisColumns,
    rows: np.ndarray | None = None,
    measured: np.ndarray | None = None,
) -> Columns:
    """The columns that the linear coefficients multiply, at given nonlinear parameters.

    Arguments:
        chain: what is in the model.
        values: its nonlinear parameters.
        signals: what drives it.
        hysteresis: the `hysteresis_columns` along its `driven_path`.
        rows: (row,) samples to keep, in their order; all by default.
        measured: (row,) measured output at these samples, for the effects of the sensor.

    Returns:
        The columns, `(row, column)`.
    """
    rows = np.arange(len(signals.time)) if rows is None else rows
    behind_it = [np.ones((len(signals.time), 1))]
    behind_it += columns_behind(chain, values, signals, rows, measured)
    of_hysteresis = hysteresis.states.shape[1] + hysteresis.switched.shape[1]
    whole = of_hysteresis + sum(part.shape[1] for part in behind_it)
    matrix = np.empty((len(rows), whole), dtype=hysteresis.states.dtype)

    def place(start: int, part: np.ndarray) -> None:
        stop = start + part.shape[1]
        for first in range(0, len(rows), GATHERED_ROWS):
            some = slice(first, first + GATHERED_ROWS)
            matrix[some, start:stop] = part[rows[some]]

    through = _behind(chain, values, signals)
    if through is None:
        place(0, hysteresis.states)
        place(hysteresis.states.shape[1], hysteresis.switched)
    else:
        starts = range(0, of_hysteresis, MOST_COLUMNS)
        deque(on_all_cores(lambda at: place(at, through(hysteresis.some(at))), starts), maxlen=0)
    start = of_hysteresis
    for part in behind_it:
        place(start, part)
        start += part.shape[1]
    if chain.polarity < 0:
        matrix[:, :of_hysteresis] *= -1
    behind = chain.coefficients
    loose = np.zeros(matrix.shape[1], dtype=bool)
    loose[len(loose) - len(behind) :] = [not each.amount for _, each in behind]
    names = tuple(effect for effect, _ in behind)
    groups, start, first_run = hysteresis.groups, hysteresis.start, hysteresis.first_run
    cells, sign = chain.plane.cells, chain.polarity
    return Columns(
        matrix,
        cells,
        groups,
        start,
        first_run,
        names,
        loose,
        sign,
        chain.signed,
        hysteresis.vectors,
    )


def _behind(
    chain: Chain, values: EffectValues, signals: Signals
) -> Callable[[np.ndarray], np.ndarray] | None:
    """What the effects of weights and output make of some columns; None if there are none."""
    gains = [np.asarray(factor) for factor in _gains(chain, values, signals)]
    filters = chain.at(OutputEffect)
    if not gains and not filters:
        return None

    def behind(columns: np.ndarray) -> np.ndarray:
        for gain in gains:
            columns = columns * gain[:, None]
        for effect in filters:
            own = _arrays(values[effect.name])
            columns = _apply_to_columns(effect, own, columns, signals.time)
        return columns

    return behind


def columns_behind(
    chain: Chain,
    values: EffectValues,
    signals: Signals,
    rows: np.ndarray,
    measured: np.ndarray | None,
) -> list[np.ndarray]:
    """What the coefficients of added, output and sensor effects multiply, `(time, column)` each.

    Arguments:
        chain: what is in the model.
        values: its nonlinear parameters.
        signals: what drives it.
        rows: (row,) samples at which the output was measured.
        measured: (row,) measured output at these samples, for the effects of the sensor.
    """
    beside = _columns_beside(chain, values, signals, {})
    parts = [np.asarray(columns) for columns in beside.values()]
    for effect in chain.at(SensorEffect):
        reading = np.full(len(signals.time), np.nan)
        reading[rows] = measured
        columns = _sensor_columns(
            effect, len(effect.coefficients()), _arrays(values[effect.name]), jnp.asarray(reading)
        )
        parts.append(np.asarray(columns))
    return parts


def _with_memory_columns(
    low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, tuple[np.ndarray, ...]]:
    """Columns of the cells, and one for each group of them whose unknown start goes alike.

    A hysteron that has not been forced since the start adds an unknown constant, a share of what
    its start leaves open.  Of those whose opening has one course, one column serves the group;
    those whose opening stays as it was add to the offset.
    """
    gap = high - low
    free = np.flatnonzero(gap[0] > 0)
    # Equal courses have equal projections on any direction, and different ones hardly ever.
    direction = np.random.default_rng(0).normal(size=len(gap))
    course = np.unique(np.round(direction @ gap[:, free], 9), return_inverse=True)[1]
    groups: list[np.ndarray] = []
    columns: list[np.ndarray] = []
    for one in range(course.max(initial=-1) + 1):
        group = free[course == one]
        column = gap[:, group[0]]
        if np.ptp(column) > 0:
            groups.append(group)
            columns.append(column)
    return np.concatenate([low, *[column[:, None] for column in columns]], axis=1), tuple(groups)

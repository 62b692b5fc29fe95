"""The Preisach operator in a chain: its columns, its first run, and its output."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from preisach_jax.chain.coefficients import Coefficients
from preisach_jax.chain.compiled import (
    as_array,
    as_arrays,
    bounds_along,
    compiled_on_a_plane,
    is_traced,
    operator_along,
    states_from_low,
)
from preisach_jax.chain.description import MIDDLE, Chain, EffectValues
from preisach_jax.chain.driven import all_widen, drive, path_and_widening
from preisach_jax.chain.signals import Drive
from preisach_jax.effects.base import HysteresisEffect, Signals, Values
from preisach_jax.operator.plane import Plane, hysteron_step, position_on
from preisach_jax.operator.simulation import outputs_after
from preisach_jax.operator.states import Paths, fed_back_states, step_of_paths

MOST_COLUMNS = 192
"""Columns to which an effect of the output is applied at once: more take memory and no less time
each, fewer take more."""


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
    """Columns of the Preisach operator along what drives it."""
    states, groups, start = _plane_columns(chain, course, initial_memory)
    if initial_memory in ("low", "high", MIDDLE):  # saturated: no threshold lies beyond the range
        none = np.zeros(2 * chain.plane.levels, dtype=bool)
        return HysteresisColumns(states, np.zeros((len(states), 0)), groups, start, none)
    rising, falling = _extremes(open_course or course)
    switched = np.concatenate([_reached(chain, rising) - 1, _reached(chain, falling)], axis=1)
    seen = np.ptp(switched, axis=0) > 0
    groups = (*groups, *[np.zeros(0, dtype=int)] * seen.sum())
    return HysteresisColumns(states, switched[:, seen], groups, start, seen)


def combinations_along(
    chain: Chain, course: Drive, initial_memory: str, shares: tuple[np.ndarray, ...]
) -> tuple[np.ndarray, np.ndarray]:
    """Combinations of the columns along one path of ramps, `(time, vector)`, and the stated start.

    Arguments:
        shares: (cells, vector) of the hysterons, (cells, vector) of what their unknown starts leave
            open, and (2 levels, vector) of the hysterons of the first run.
    """
    cells, memory, first_run = shares
    start = np.zeros(len(cells))
    if initial_memory != "free":
        start = stated_start(chain, course, initial_memory)
        memory = memory + start[:, None] * cells
    x, high = np.asarray(course.rising), chain.plane.initial_turns("high")
    states = outputs_after(chain.plane, cells - memory, np.zeros_like(high), x)
    if memory.any():
        states += outputs_after(chain.plane, memory, high, x)
    if first_run.any():
        rising, falling = np.split(first_run, 2)
        highest, lowest = _extremes(course)
        states += (_reached(chain, highest) - 1) @ rising + _reached(chain, lowest) @ falling
    return states, start


def _plane_columns(
    chain: Chain, course: Drive, initial_memory: str
) -> tuple[np.ndarray, tuple[np.ndarray, ...], np.ndarray]:
    nothing = np.zeros(chain.plane.cells)
    first_low, first_high = _bounds_at_start(chain, course)
    start = nothing if initial_memory == "free" else stated_start(chain, course, initial_memory)
    if not (first_high > first_low).any() or (initial_memory != "free" and not start.any()):
        # The first sample forces all hysterons, or those it leaves open are off.
        states = states_from_low(chain.plane, course, chain.hysteron)
        return np.asarray(states), (), start
    bounds = bounds_along(chain.plane, course, chain.hysteron)
    low, high = (np.asarray(bound) for bound in bounds)
    if initial_memory == "free":
        return *_with_memory_columns(low, high), nothing
    return low + start[None, :] * (high - low), (), start


def _extremes(course: Drive) -> tuple[Any, Any]:
    """Greatest input so far at the thresholds α, and least one at the thresholds β."""
    falling = course.rising if course.falling is None else course.falling
    if is_traced(course):
        return _traced_extremes(course.rising, falling)
    greatest = np.maximum.accumulate(np.asarray(course.rising))
    return greatest, np.minimum.accumulate(np.asarray(falling))


@eqx.filter_jit
def _traced_extremes(rising: jax.Array, falling: jax.Array) -> tuple[jax.Array, jax.Array]:
    return rising[_last_records(rising)], falling[_last_records(-falling)]


def _last_records(path: jax.Array) -> jax.Array:
    """Where the greatest value so far was reached, `(time,)`.

    The derivative of a value taken from there is a gather; that of `cummax` is a tree of slices,
    which took twenty times as long.
    """
    path = jax.lax.stop_gradient(path)
    index = jnp.arange(len(path))
    return _greatest_so_far(jnp.where(path == _greatest_so_far(path), index, 0))


def _greatest_so_far(values: jax.Array) -> jax.Array:
    """The greatest of each value and those before it, over a reach that doubles in each round.

    `cummax` unrolls its rounds, which takes ten times as long to compile.
    """
    index = jnp.arange(len(values))

    def reach_further(greatest: jax.Array, by: jax.Array) -> tuple[jax.Array, None]:
        return jnp.maximum(greatest, greatest[jnp.maximum(index - by, 0)]), None

    reaches = 2 ** jnp.arange(max(len(values) - 1, 1).bit_length())
    return jax.lax.scan(reach_further, values, reaches)[0]


def _reached(chain: Chain, path: jax.Array) -> np.ndarray:
    """How far a path has reached each threshold, `(time, levels)`."""
    plane = chain.plane
    if chain.hysteron == "relay":
        return (np.asarray(path)[:, None] >= plane.thresholds).astype(float)
    position = position_on(plane, np.asarray(path))
    return np.clip(position[:, None] - np.arange(plane.levels), 0.0, 1.0)


def first_run_output(chain: Chain, course: Drive, first_run: np.ndarray) -> jax.Array:
    r"""What hysterons add whose other threshold lies beyond the range of the input, `(time,)`.

    Those with β below it that are off at the start switch on when the input first reaches α, and
    never off again; those with α above it that are on switch off for good at β.  They make the
    virgin curve: \(\sum_i h_i (\rho_i(\max_{s \le t} x_s) - 1) +
    \sum_j g_j \rho_j(\min_{s \le t} x_s)\), zero when the input has been through all its range.

    Arguments:
        first_run: (2 levels,) weights h of the former, then g of the latter; empty for none.
    """
    if not len(first_run):
        xp: Any = jnp if is_traced(course) else np
        return xp.zeros_like(course.rising)
    extremes = _extremes(course)
    if not is_traced(extremes, first_run):
        return _switched_output(np, chain.plane, extremes, np.asarray(first_run), chain.hysteron)
    return _traced_output(chain.plane, extremes, jnp.asarray(first_run), chain.hysteron)


@compiled_on_a_plane
def _traced_output(
    plane: Plane, extremes: tuple[Array, Array], first_run: Array, hysteron: str
) -> Array:
    return _switched_output(jnp, plane, extremes, first_run, hysteron)


def _switched_output(
    xp: Any, plane: Plane, extremes: tuple[Any, Any], first_run: Any, hysteron: str
) -> Any:
    """What hysterons of the first run add, by NumPy or JAX."""
    last = plane.levels - 1

    def switched(path: Any, weights: Any) -> Any:
        whole = xp.concatenate([xp.zeros(1, weights.dtype), xp.cumsum(weights)])
        position = position_on(plane, path)
        if hysteron == "relay":
            position = xp.floor(position + 0.5)
        position = xp.clip(position, 0.0, plane.levels)
        level = xp.minimum(position.astype(np.int32), last)
        return whole[level] + (position - level) * (whole[level + 1] - whole[level])

    highest, lowest = extremes
    rising, falling = first_run[: plane.levels], first_run[plane.levels :]
    return switched(highest, rising) - rising.sum() + switched(lowest, falling)


def stated_start(chain: Chain, course: Drive, initial_memory: str) -> np.ndarray:
    """Share of what the first sample leaves open that a stated initial memory switches on.

    Returns:
        (cells,) shares: zero or one, and a half for ramps on the line of demagnetisation.
    """
    low, high = _bounds_at_start(chain, course)
    first, gap = np.asarray(course.rising)[0], high - low
    if initial_memory == MIDDLE:
        return np.where(gap > 0, 0.5, 0.0)
    states = np.asarray(chain.plane.initial_states(initial_memory, first, chain.hysteron))
    return np.where(gap > 0, (states - low) / np.where(gap > 0, gap, 1.0), 0.0)


def _bounds_at_start(chain: Chain, course: Drive) -> tuple[np.ndarray, np.ndarray]:
    """States after the first sample from all off and from all on, `(cells,)`: nothing is compiled.

    What the input of the thresholds α forces, and then one step, as in `hysteron_states`.
    """
    plane, unit = chain.plane, chain.plane.scaled()
    width = plane.high - plane.low
    now: Any = tuple((np.asarray(x)[0] - plane.low) / width for x in course if x is not None)

    def after(states: Any) -> Any:
        states = hysteron_step(unit, states, now[0], now[0], chain.hysteron)
        several = len(now) > 1
        return step_of_paths(unit, states, now, now, chain.hysteron) if several else states

    off = np.zeros(plane.cells, now[0].dtype)
    return after(off), after(off + 1)


def hysteresis_output(
    chain: Chain, values: EffectValues, signals: Signals, coefficients: Coefficients
) -> jax.Array:
    """Output of the Preisach operator (6) and of the first run, without offset, `(time,)`.

    Where it is fed back, the output that agrees with itself is found sample by sample.
    """
    course = drive(chain, values, signals)
    first_run = first_run_output(chain, course, coefficients.first_run)
    if not chain.feeds_back:
        return operator_output(chain, course, coefficients) + first_run
    path, widened = path_and_widening(chain, values, signals)
    inside = [effect for effect in chain.at(HysteresisEffect) if effect.feeds_back]
    low, width = chain.plane.low, chain.plane.high - chain.plane.low
    sign = chain.polarity  # what is fed back rises with the input
    shift = jnp.zeros_like(path) if widened is None else widened
    output = _fed_back_operator(
        chain.plane.scaled(),
        jax.tree.map(as_array, inside),
        [as_arrays(values[effect.name]) for effect in inside],
        (path, signals.time, shift, sign * first_run),
        (jnp.asarray(low), jnp.asarray(width)),
        (jnp.asarray(sign * coefficients.weights), jnp.asarray(sign * coefficients.memory)),
        all_widen(chain),
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
            pair = effect.at(own).fed_back(pair, whole, time)
        path, shift = (pair[-1] - scale[0]) / scale[1], shift[-1] / scale[1]
        return (path - shift, path + shift, *([] if all_widen else [path]))

    pairs = [jnp.stack([jnp.roll(each, 1).at[0].set(each[0]), each], axis=1) for each in course]
    weights, memory = coefficients
    return fed_back_states(plane, weights, memory, pairs, seen, hysteron)


def operator_output(chain: Chain, course: Drive, coefficients: Coefficients) -> jax.Array:
    weights, memory = coefficients.weights, coefficients.memory
    return operator_along(chain.plane, course, weights, memory, chain.hysteron)


def _with_memory_columns(
    low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, tuple[np.ndarray, ...]]:
    """Columns of the cells, and one for each group of them whose unknown start goes alike.

    A hysteron that has not been forced since the start adds an unknown constant, a share of what
    its start leaves open.  Of those whose opening has one course, one column serves the group;
    those whose opening stays as it was add to the offset.
    """
    free = np.flatnonzero(high[0] > low[0])
    # Equal courses have equal projections on any direction, and different ones hardly ever.
    direction = np.random.default_rng(0).normal(size=len(low))
    gap = (direction @ high - direction @ low)[free]
    course = np.unique(np.round(gap, 9), return_inverse=True)[1]
    groups: list[np.ndarray] = []
    columns: list[np.ndarray] = []
    for one in range(course.max(initial=-1) + 1):
        members = np.flatnonzero(course == one)
        first = free[members[0]]
        column = high[:, first] - low[:, first]
        if np.ptp(column) > 0:
            groups.append(free[members])
            columns.append(column)
    return np.concatenate([low, *[column[:, None] for column in columns]], axis=1), tuple(groups)

"""Switching events of relays: which hysterons an input switches, and when, as lines of the plane.

Where the input passes a threshold upward it switches on a stretch of one row of the plane, and
where it passes one downward it switches off a stretch of one column. Few samples pass any, so that
a recursion over events with their cells does in O(N) what costs O(N²) at every sample. Events
depend on the input alone: one list serves every noise level and every initial weight.
"""

from __future__ import annotations

import math
from typing import cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.typing import ArrayLike

from preisach_jax.operator.hysteron import position_on
from preisach_jax.operator.paths import path_and_start
from preisach_jax.operator.plane import Plane
from preisach_jax.operator.switching import Switching

EVENTS_TO_REFRESH = 1024
"""After so many events at most, an output that is summed up along them is summed afresh over the
plane, so that rounding does not pile up in it."""


def switching_events(
    plane: Plane, x: ArrayLike, events: int | None = None, width: int | None = None
) -> Switching:
    """Find the switching events along an input that starts from saturated low.

    S⁺(k) and S⁻(k) of eq. (8), from the level of the input, quantised by (3), (4). A rise from
    level q to q' switches on, in each row i = q ... q'-1, the relays from the lowest level since
    the row was last passed upward; a fall switches off, in each column, those below the highest
    level since that column was last passed downward.

    Arguments:
        plane: the Preisach plane.
        x: (time,) input, in the unit of the plane.
        events: room for so many events.
        width: room for so many thresholds passed in one sample. Without both, the input must be
            concrete, and just its events are returned.

    Returns:
        The events, in order. Events beyond the room, or thresholds beyond the width, are lost: take
        both from `room_for_events`.

    Raises:
        InputError: `x` is not a row of real numbers.

    Example:
        >>> plane = Plane(levels=3, low=0.0, high=3.0)
        >>> found = switching_events(plane, [0.0, 1.0, 2.0, 1.0, 0.0])
        >>> found.sample.tolist(), found.area.tolist(), found.sign.tolist()
        ([1, 2, 3, 4], [1, 2, 1, 2], [1, 1, -1, -1])
    """
    x, _ = path_and_start(plane, x, "low", "relay")
    if events is not None and width is not None:
        return _switching_events(plane, x, events, width)
    found, _ = events_and_states(plane, x)
    count = max(1, int(jnp.count_nonzero(found.area)))

    def without_fillings(rows: jax.Array) -> jax.Array:
        return jnp.asarray(np.asarray(rows)[:count])

    return jax.tree.map(without_fillings, found)


def room_for_events(plane: Plane, x: ArrayLike, step: int = 1) -> tuple[int, int]:
    """Bound the events along inputs, and the thresholds that one sample passes.

    A stretch between two turning points passes at most one threshold more than its length holds
    cells, and so does a step.

    Arguments:
        plane: the Preisach plane.
        x: (..., time) inputs, in the unit of the plane; concrete.
        step: what the bound on the events is rounded up to a multiple of, so that other inputs
            rarely need a compilation.

    Returns:
        `(events, width)`, at least 1 each, enough for each of the inputs.

    Example:
        >>> room_for_events(Plane(levels=3, low=0.0, high=3.0), [0.0, 3.0, 1.2])
        (2, 3)
    """
    x = np.asarray(x, float)
    steps = np.diff(x.reshape(-1, x.shape[-1]), axis=-1) / plane.delta_x
    # A rest is no turning point; to count it as one does no harm.
    turns = np.sum(np.diff(np.sign(steps), axis=-1) != 0, axis=-1)
    lengths = np.abs(steps)
    events = int(np.max(lengths.sum(axis=-1) + turns, initial=0.0)) + 2
    width = int(lengths.max(initial=0.0) * (1.0 + 1e-9)) + 1
    events = max(1, min(events, x.shape[-1] - 1))
    return -(-events // step) * step, min(width, plane.levels)


def events_and_states(plane: Plane, x: jax.Array) -> tuple[Switching, jax.Array]:
    """Find the switching events along an input, and the states of the relays at its end.

    Inputs of equal length, and about as many events, share what is compiled for them.

    Arguments:
        plane: the Preisach plane.
        x: (time,) input on the plane, in its unit; concrete, starting from saturated low.

    Returns:
        `(switching, states)`: the events, of which the last ones may be fillings whose sample is
        `time`, and (cells,) states, 0 or 1.

    Example:
        >>> plane = Plane(levels=2, low=0.0, high=2.0)
        >>> events_and_states(plane, jnp.asarray([0.0, 2.0, 1.0]))[1].tolist()
        [1.0, 1.0, 0.0]
    """
    levels = np.asarray(relay_levels(plane, x))
    sample, to = moves_of(levels)
    width = int(np.abs(np.diff(to, prepend=levels[0])).max(initial=1))
    found, lowest = _crossings_at_once(plane, to, int(levels[0]), 1 << (width - 1).bit_length())
    # Fillings stay where the input ends.
    sample = np.where(sample < 0, len(levels), sample)
    on = plane.beta_index < lowest[plane.alpha_index]
    crossings = (jnp.asarray(rows) for rows in found)
    return Switching(jnp.asarray(sample), *crossings), jnp.asarray(on, x.dtype)


def _crossings_at_once(
    plane: Plane, to: np.ndarray, start: int, width: int
) -> tuple[tuple[np.ndarray, ...], np.ndarray]:
    """What `_crossings` finds, for levels that are known: NumPy needs no loop over the events."""
    before = np.append(start, to[:-1])
    rising, count = to > before, np.abs(to - before)
    event = np.repeat(np.arange(len(to)), count)
    passed = np.arange(len(event)) - np.repeat(np.cumsum(count) - count, count)
    upward = rising[event]
    line = np.where(upward, before[event] + passed, before[event] - 1 - passed)
    index = np.arange(plane.levels)

    up, down = upward.nonzero()[0], (~upward).nonzero()[0]
    below = np.where(index < start, start, 0)
    low, lowest = _extremes(np.minimum, to, event[up], line[up], below)
    high, _ = _extremes(np.maximum, to, event[down], line[down], np.full(plane.levels, start))
    bounds = np.zeros((3, len(to), width), np.int32)
    bounds[:, event[up], passed[up]] = line[up], low, line[up] + 1
    bounds[:, event[down], passed[down]] = line[down], line[down], high
    return (rising, *bounds), lowest


def _extremes(
    extreme: np.ufunc, to: np.ndarray, event: np.ndarray, line: np.ndarray, start: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Lowest or highest level since a line was last passed: at each crossing, and at the end.

    `start` holds what counts for each line until it is first passed.
    """
    since_start = extreme.accumulate(to)
    until_end = extreme.accumulate(to[::-1])[::-1]
    end = extreme(start, since_start[-1])
    if not len(event):
        return event, end
    order = np.lexsort((event, line))
    at, of = event[order], line[order]
    first = np.append(True, of[1:] != of[:-1])
    # Of a crossing, the extreme from the one before on the same line; each stretch is seen once.
    since = np.append(to[:1], extreme.reduceat(to, at)[:-1])
    begun = np.where(at > 0, extreme(start[of], since_start[at - 1]), start[of])
    found = np.empty_like(at)
    found[order] = np.where(first, begun, since)
    last = np.append(first[1:], True)
    end[of[last]] = until_end[at[last]]
    return found, end


def relays_between(
    plane: Plane, x: jax.Array, switching: Switching
) -> tuple[np.ndarray, np.ndarray]:
    """Find the relays that are on before some of the events, from which sums can begin afresh.

    Arguments:
        plane: the Preisach plane.
        x: (time,) input on the plane, in its unit; concrete, starting from saturated low.
        switching: its events, as `events_and_states` finds them.

    Returns:
        `(first, lowest)`: (stretches,) the events at which stretches of equal length begin, of
        `EVENTS_TO_REFRESH` events or somewhat fewer, and (stretches, levels) how many relays of
        each row α are on before them, those of the lowest β.

    Example:
        >>> plane, x = Plane(levels=2, low=0.0, high=2.0), jnp.asarray([0.0, 2.0, 1.0])
        >>> first, lowest = relays_between(plane, x, events_and_states(plane, x)[0])
        >>> first.tolist(), lowest.tolist()
        ([0], [[0, 0]])
    """
    levels = np.asarray(relay_levels(plane, x))
    _, to = moves_of(levels)
    before = np.append(levels[0], to[:-1])
    # Of two sizes that are both rounded up, the one divides the other in few parts.
    size = math.gcd(len(to), EVENTS_TO_REFRESH) if len(to) > EVENTS_TO_REFRESH else len(to)
    index = np.arange(plane.levels)
    lowest = [np.where(index < levels[0], levels[0], 0)]
    for begin in range(size, len(to), size):
        part, came = to[begin - size : begin], before[begin - size : begin]
        since = np.minimum.accumulate(part[::-1])[::-1]
        row = np.minimum(lowest[-1], since[0])
        up = np.flatnonzero(part > came)
        count: np.ndarray = (part - came)[up]
        passed = np.arange(int(count.sum())) - np.repeat(np.cumsum(count) - count, count)
        # Of a row that is passed upward more than once, the last time is assigned last.
        row[np.repeat(came[up], count) + passed] = np.repeat(since[up], count)
        lowest.append(row)
    return np.arange(0, len(to), size), np.asarray(lowest, np.int32)


def relay_levels(plane: Plane, x: ArrayLike, before: int = 0) -> np.ndarray | jax.Array:
    """Quantise an input to the levels that relays see, with the rest it may start with.

    As `Plane.quantise`, but a threshold on which the input rests at its start is not passed, as the
    states there are those of the initial memory by rule (1).

    Arguments:
        plane: the Preisach plane.
        x: (time,) input, in the unit of the plane.
        before: the level at which the initial memory ends.

    Returns:
        (time,) integers in 0 ... levels; a NumPy array if the input is known, which is quicker.

    Example:
        >>> plane = Plane(levels=3, low=0.0, high=3.0)
        >>> [relay_levels(plane, np.asarray([1.5, 1.5, 2.5]), end).tolist() for end in (0, 3)]
        [[1, 1, 3], [2, 2, 3]]
    """
    if isinstance(x, Tracer):
        thresholds = jnp.asarray(plane.thresholds, x.dtype)
        least, most = (jnp.searchsorted(thresholds, x[0], side=side) for side in ("left", "right"))
        resting = jnp.cumsum(x != x[0]) == 0
        levels = jnp.where(
            resting, jnp.clip(before, least, most), plane.quantise(cast(ArrayLike, x))
        )
        return levels.astype(jnp.int32)
    x = np.asarray(x)
    thresholds = plane.thresholds.astype(x.dtype)
    last, following = np.append(-np.inf, thresholds), np.append(thresholds, np.inf)
    count = np.clip(np.rint(position_on(plane, x)), 0, plane.levels).astype(np.int32)
    count += (following[count] <= x).astype(np.int32) - (last[count] > x)
    on_threshold = last[count] == x
    if on_threshold.any():  # rule (3), (4): a rising input has passed it, a falling one not yet
        moved_at = np.maximum.accumulate(np.where(np.diff(x, prepend=x[0]), np.arange(len(x)), 0))
        falling = (moved_at > 0) & (x < x[moved_at - 1])
        count -= on_threshold & (falling | ((moved_at == 0) & (before < count)))
    return count


def moves_of(levels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pick the samples at which a level moves.

    Arguments:
        levels: (time,) integers.

    Returns:
        `(sample, to)`, (moves,) each: where, and to which level. They are filled up, so that inputs
        of like length share what is compiled, with samples -1 at which the level stays as it ends.

    Example:
        >>> sample, to = moves_of(np.asarray([0, 0, 2, 1]))
        >>> len(sample), sample[:3].tolist(), to[:3].tolist()
        (16, [2, 3, -1], [2, 1, 1])
    """
    sample = np.flatnonzero(levels[1:] != levels[:-1]) + 1
    filling = rounded_up(len(sample)) - len(sample)
    to = np.append(levels[sample], np.full(filling, levels[-1]))
    return np.append(sample, np.full(filling, -1)).astype(np.int32), to.astype(np.int32)


@eqx.filter_jit
def _switching_events(plane: Plane, x: jax.Array, events: int, width: int) -> Switching:
    levels = jnp.asarray(relay_levels(plane, x))
    before = jnp.concatenate([levels[:1], levels[:-1]])
    sample = jnp.nonzero(levels != before, size=events, fill_value=x.shape[0])[0]
    to = levels.at[sample].get(mode="fill", fill_value=-1)
    return _crossings(plane, sample, to, levels[0], width)[0]


@eqx.filter_jit
def _crossings(
    plane: Plane, sample: jax.Array, to: jax.Array, start: jax.Array, width: int
) -> tuple[Switching, jax.Array]:
    index = jnp.arange(plane.levels, dtype=jnp.int32)
    passed = jnp.arange(width, dtype=jnp.int32)

    def cross(
        carry: tuple[jax.Array, jax.Array, jax.Array], goal: jax.Array
    ) -> tuple[tuple[jax.Array, jax.Array, jax.Array], tuple[jax.Array, ...]]:
        lowest, highest, level = carry
        goal = jnp.where(goal < 0, level, goal)  # a filling stays where it is
        rising = goal > level
        line = jnp.where(rising, level + passed, level - 1 - passed)
        first = jnp.where(rising, lowest.at[line].get(mode="clip"), line)
        last = jnp.where(rising, line + 1, highest.at[line].get(mode="clip"))
        last = jnp.where(passed < jnp.abs(goal - level), last, first)
        upward = (level <= index) & (index < goal)
        downward = (goal <= index) & (index < level)
        lowest = jnp.where(upward, goal, jnp.minimum(lowest, goal))
        highest = jnp.where(downward, goal, jnp.maximum(highest, goal))
        return (lowest, highest, goal), (rising, line, first, last)

    # Of each row, the lowest level since the input last passed it upward; of each column, the
    # highest since it last passed that downward.
    lowest, highest = jnp.where(index < start, start, 0), jnp.full_like(index, start)
    (lowest, _, _), found = jax.lax.scan(cross, (lowest, highest, start), to)
    return Switching(sample, *found), lowest


def rounded_up(count: int) -> int:
    """Round up to one of eight sizes an octave: inputs of like length share what is compiled.

    Arguments:
        count: how many there are.

    Returns:
        How many there are room for, at least 16.

    Example:
        >>> rounded_up(3), rounded_up(1000)
        (16, 1024)
    """
    step = 1 << max(count.bit_length() - 4, 0)
    return max(-(-count // step) * step, 16)

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

from preisach_jax.hysteron import path_and_start, position_on
from preisach_jax.plane import Plane
from preisach_jax.update import UpdateRule

EVENTS_TO_REFRESH = 1024
"""After so many events at most, an output that is summed up along them is summed afresh over the
plane, so that rounding does not pile up in it."""


class Switching(eqx.Module):
    """The switching events of a plane's relays along an input (a pytree).

    An event is a sample at which the input passes `width` thresholds or fewer, all in one
    direction. Its crossing c switches, upward, the cells (line, j) of a row with first ≤ j < last,
    and downward the cells (i, line) of a column with first ≤ i < last. Where there is no event or
    crossing, first = last; such events have the sample `time`.

    Attributes:
        sample: (events,) index of the sample of each event.
        rising: (events,) whether relays switch on there (S⁺), or off (S⁻).
        line: (events, width) α index of a row, or β index of a column.
        first: (events, width) first cell on the line.
        last: (events, width) cell after the last one on the line.
    """

    sample: jax.Array
    rising: jax.Array
    line: jax.Array
    first: jax.Array
    last: jax.Array

    @property
    def area(self) -> jax.Array:
        """(events,) A(k), eq. (11): how many relays switch; 0 where there is no event."""
        return jnp.sum(self.last - self.first, axis=-1)

    @property
    def sign(self) -> jax.Array:
        """(events,) +1 where relays switch on, -1 where they switch off."""
        return jnp.where(self.rising, 1, -1)

    def cells(self, plane: Plane) -> jax.Array:
        """Flat indices of the relays that switch.

        Args:
            plane: the Preisach plane that the events are of.

        Returns:
            (events, width · levels) indices; `plane.cells`, which is out of range, as a filling.
        """
        steps = jnp.arange(plane.levels).reshape((1,) * self.first.ndim + (-1,))
        line, last = jnp.expand_dims(self.line, -1), jnp.expand_dims(self.last, -1)
        along = jnp.expand_dims(self.first, -1) + steps
        rising = jnp.expand_dims(self.rising, (-1, -2))
        flat = jnp.where(rising, flat_index(line, along), flat_index(along, line))
        flat = jnp.where(along < last, flat, plane.cells)
        return flat.reshape(*self.sample.shape, -1)


def flat_index(alpha_index: ArrayLike, beta_index: ArrayLike) -> jax.Array:
    """Flat index i(i+1)/2 + j of a cell.

    Args:
        alpha_index: row i of the plane, any shape.
        beta_index: column j ≤ i, a shape that broadcasts with it.

    Returns:
        Index of the cell, in the common shape.

    Example:
        >>> int(flat_index(2, 1)), int(Plane(levels=5, low=0.0, high=1.0).alpha_index[4])
        (4, 2)
    """
    i = jnp.asarray(alpha_index)
    return i * (i + 1) // 2 + jnp.asarray(beta_index)


def switching_events(
    plane: Plane, x: ArrayLike, events: int | None = None, width: int | None = None
) -> Switching:
    """Find the switching events along an input that starts from saturated low.

    S⁺(k) and S⁻(k) of eq. (8), from the level of the input, quantised by (3), (4). A rise from
    level q to q' switches on, in each row i = q ... q'-1, the relays from the lowest level since
    the row was last passed upward; a fall switches off, in each column, those below the highest
    level since that column was last passed downward.

    Args:
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

    Args:
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

    Args:
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

    Args:
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

    Args:
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

    Args:
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

    Args:
        count: how many there are.

    Returns:
        How many there are room for, at least 16.

    Example:
        >>> rounded_up(3), rounded_up(1000)
        (16, 1024)
    """
    step = 1 << max(count.bit_length() - 4, 0)
    return max(-(-count // step) * step, 16)


def laid_out(plane: Plane, values: ArrayLike) -> jax.Array:
    """Lay values of the cells out on the plane, for sums along its rows and columns.

    Args:
        plane: the Preisach plane.
        values: (cells,) one value a cell.

    Returns:
        (levels, levels) matrix, row α index, column β index; 0 where α < β.

    Example:
        >>> laid_out(Plane(levels=2, low=0.0, high=1.0), [1.0, 2.0, 3.0]).tolist()
        [[1.0, 0.0], [2.0, 3.0]]
    """
    values = jnp.asarray(values)
    matrix = jnp.zeros((plane.levels, plane.levels), values.dtype)
    return matrix.at[plane.alpha_index, plane.beta_index].set(values)


def _sums_of_rows(matrix: jax.Array) -> jax.Array:
    """(levels, levels + 1) sums of the first q cells of each row."""
    return jnp.cumsum(jnp.pad(matrix, ((0, 0), (1, 0))), axis=1)


def output_rises(plane: Plane, switching: Switching, weights: ArrayLike) -> jax.Array:
    """Rise of the model's output (6) at each event, Σ R on S⁺ less Σ R on S⁻.

    Sums along a line of the plane are differences of cumulated weights, so that an event costs as
    much as it has lines.

    Args:
        plane: the Preisach plane.
        switching: the events.
        weights: (cells,) weights R, in the unit of the output.

    Returns:
        (events,) rises, same unit; 0 where there is no event.

    Example:
        >>> plane = Plane(levels=2, low=0.0, high=2.0)
        >>> switching = switching_events(plane, [0.0, 2.0, 1.0])
        >>> output_rises(plane, switching, jnp.asarray([1.0, 2.0, 4.0])).tolist()
        [7.0, -4.0]
    """
    matrix = laid_out(plane, jnp.asarray(weights))
    rows, columns = _sums_of_rows(matrix), _sums_of_rows(matrix.T).T
    line, first, last = switching.line, switching.first, switching.last
    on = rows.at[line, last].get(mode="clip") - rows.at[line, first].get(mode="clip")
    off = columns.at[first, line].get(mode="clip") - columns.at[last, line].get(mode="clip")
    rises = jnp.where(jnp.expand_dims(switching.rising, -1), on, off)
    return jnp.sum(jnp.where(last > first, rises, 0.0), axis=-1)


def measured_rises(switching: Switching, z: jax.Array) -> jax.Array:
    """Rise of measured outputs from event to event, as `adapt_over_events` takes it.

    Args:
        switching: the events.
        z: (time, lanes) outputs.

    Returns:
        (events, lanes) rises; the first one since the start, and 0 where there is no event.

    Example:
        >>> switching = switching_events(Plane(levels=2, low=0.0, high=2.0), [0.0, 2.0, 1.0])
        >>> measured_rises(switching, jnp.asarray([[1.0], [8.0], [5.0]]))[:, 0].tolist()
        [7.0, -3.0]
    """
    return jnp.diff(jnp.concatenate([z[:1], z.at[switching.sample].get(mode="clip")]), axis=0)


def adapt_over_events(
    plane: Plane,
    switching: Switching,
    increments: ArrayLike,
    weights: ArrayLike,
    rule: UpdateRule | None = None,
) -> tuple[jax.Array, jax.Array]:
    """Run the paper's recursion over switching events, for many outputs of one input at once.

    At each event e = Δz - (Σ R̂ on S⁺ - Σ R̂ on S⁻), eq. (7), and then R̂ ← R̂ ± e/A on S±, eq. (8),
    (12), which touches only the cells that switch: O(N) an event. The same as `AdaptiveFilter`.

    Args:
        plane: the Preisach plane.
        switching: the events of the input that all lanes share.
        increments: (events, lanes) rise of the measured output since the event before (at the first
            one, since the start), in the unit of the output.
        weights: (cells, lanes) weights to start from, same unit.
        rule: what an error does; without it, the paper's rule.

    Returns:
        `(weights, errors)`: (cells, lanes) weights after the last event, and (events, lanes) errors
        e(k), 0 where there is no event.

    Example:
        >>> plane = Plane(levels=3, low=0.0, high=3.0)
        >>> switching = switching_events(plane, [0.0, 1.0, 2.0, 1.0, 0.0])
        >>> rises = jnp.asarray([[1.0], [2.0], [-2.0], [-1.0]])
        >>> weights, errors = adapt_over_events(plane, switching, rises, jnp.zeros((6, 1)))
        >>> weights[:, 0].tolist()
        [0.5, 0.5, 2.0, 0.0, 0.0, 0.0]
    """
    weights, errors, _ = adapt_and_share(plane, switching, increments, weights, rule)
    return weights, errors


def adapt_and_share(
    plane: Plane,
    switching: Switching,
    increments: ArrayLike,
    weights: ArrayLike,
    rule: UpdateRule | None = None,
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Do what `adapt_over_events` does, and tell what the updates add to the weights in sum.

    Args:
        plane: the Preisach plane.
        switching: the events of the input that all lanes share.
        increments: (events, lanes) rise of the measured output since the event before.
        weights: (cells, lanes) weights to start from, in the unit of the output.
        rule: what an error does; without it, the paper's rule.

    Returns:
        `(weights, errors, shares)`, the last one (events, lanes): the sum of what each event adds
        to the weights of its cells, 0 where it adds nothing.

    Example:
        >>> plane = Plane(levels=2, low=0.0, high=2.0)
        >>> switching = switching_events(plane, [0.0, 2.0, 1.0])
        >>> rises, rule = jnp.asarray([[6.0], [-2.0]]), UpdateRule(0.5)
        >>> adapt_and_share(plane, switching, rises, jnp.zeros((3, 1)), rule)[2].tolist()
        [[3.0], [0.5]]
    """
    rule = UpdateRule() if rule is None else rule
    weights = jnp.asarray(weights)
    increments = jnp.asarray(increments, weights.dtype)
    sign, area = switching.sign.astype(weights.dtype), switching.area.astype(weights.dtype)

    def adapt(
        weights: jax.Array, event: tuple[Switching, jax.Array, jax.Array, jax.Array]
    ) -> tuple[jax.Array, tuple[jax.Array, jax.Array | None]]:
        crossing, increment, sign, area = event
        cells = crossing.cells(plane)
        there = weights.at[cells].get(mode="fill", fill_value=0.0)
        error = jnp.where(area > 0, increment - sign * jnp.sum(there, axis=0), 0.0)
        move = sign * rule.rate(error, jnp.maximum(area, 1.0))
        if rule.dead_zone is not None:
            move = jnp.where(rule.learns(error), move, 0.0)
        move = jnp.broadcast_to(move, (cells.shape[0], move.shape[0]))
        # Fillings repeat an index, so that indices are not unique; they are dropped.
        if rule.nonnegative:
            new = jnp.maximum(there + move, 0.0)
            share = jnp.sum(jnp.where((cells < plane.cells)[:, None], new - there, 0.0), axis=0)
            return weights.at[cells].set(new, mode="drop"), (error, share)
        return weights.at[cells].add(move, mode="drop"), (error, None)

    events = (switching, increments, sign, area)
    weights, (errors, shares) = jax.lax.scan(adapt, weights, events)
    if shares is None:
        learns = rule.learns(errors) & (area > 0)[:, None]
        shares = jnp.where(learns, sign[:, None] * rule.rate(errors, 1.0), 0.0)
    return weights, errors, shares

"""Events of relays: the levels of the input that they see, and which of them each sample switches.

Where the input passes a threshold upward it switches on a stretch of one row of the plane, and
where it passes one downward it switches off a stretch of one column, in blocks of a few cells. Few
samples pass any, so that a recursion over such blocks does in O(N) what costs O(N²) at every
sample. Blocks depend on the input alone: one list serves every noise level and every initial
weight.
"""

from __future__ import annotations

from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.typing import ArrayLike

from preisach_jax.operator.plane import Plane, flat_index, position_on
from preisach_jax.operator.states import path_and_start


def relay_levels(plane: Plane, x: ArrayLike, before: int = 0) -> np.ndarray | jax.Array:
    """Quantise an input to the levels that relays see, with the rest it may start with.

    As `Plane.quantise`, but a threshold on which the input rests at its start is not passed, as the
    states there are those of the initial memory by rule (1).

    The result is NumPy's if the input is known, which is quicker.
    """
    if isinstance(x, Tracer) or isinstance(plane.thresholds, Tracer):
        course = jnp.asarray(x)
        thresholds, first = jnp.asarray(plane.thresholds, course.dtype), course[0]
        least, most = (jnp.searchsorted(thresholds, first, side=side) for side in ("left", "right"))
        resting = jnp.cumsum(course != first) == 0
        levels = jnp.where(resting, jnp.clip(before, least, most), plane.quantise(course))
        return levels.astype(jnp.int32)
    x = np.asarray(x)
    thresholds = np.asarray(plane.thresholds, x.dtype)
    last, following = np.append(-np.inf, thresholds), np.append(thresholds, np.inf)
    if plane.own_thresholds is None:  # quicker than a search; rounding is mended
        count = np.clip(np.rint(position_on(plane, x)), 0, plane.levels).astype(np.int32)
    else:
        count = np.searchsorted(thresholds, x).astype(np.int32)
    count += (following[count] <= x).astype(np.int32) - (last[count] > x)
    on_threshold = last[count] == x
    if on_threshold.any():  # rule (3), (4): a rising input has passed it, a falling one not yet
        moved_at = np.maximum.accumulate(np.where(np.diff(x, prepend=x[0]), np.arange(len(x)), 0))
        falling = (moved_at > 0) & (x < x[moved_at - 1])
        count -= on_threshold & (falling | ((moved_at == 0) & (before < count)))
    return count


def moves_of(levels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Samples at which (time,) levels move, and to which level, (moves,) each.

    They are filled up, so that inputs of like length share what is compiled, with samples -1 at
    which the level stays as it ends.
    """
    sample = np.flatnonzero(levels[1:] != levels[:-1]) + 1
    filling = rounded_up(len(sample)) - len(sample)
    to = np.append(levels[sample], np.full(filling, levels[-1]))
    return np.append(sample, np.full(filling, -1)).astype(np.int32), to.astype(np.int32)


def rounded_up(count: int) -> int:
    """Round up to one of eight sizes an octave: inputs of like length share what is compiled."""
    step = 1 << max(count.bit_length() - 4, 0)
    return max(-(-count // step) * step, 16)


WIDTH = 16
"""Cells of a block; measured on a CPU: most stretches have fewer, and the scatter costs by cell."""


class Blocks(NamedTuple):
    """The relays that switch along an input, `(blocks,)` each, in order of time.

    NumPy's if the input is known.

    Attributes:
        line: row that is passed upward, or column that is passed downward.
        rising: which of the two.
        begin, end: first cell of the block on its line, and the one after its last.
        first: whether the line is passed that way for the first time.
        extreme: lowest level since the start, of a row, or highest, of a column.
        until: (time,) how many blocks by the end of each sample; more than there is room for, from
            the sample on that had no room.
        up, down: (1 + levels,) number of the last passage of each row upward and of each column
            downward, or -1.
    """

    line: Any
    rising: Any
    begin: Any
    end: Any
    first: Any
    extreme: Any
    until: Any
    up: Any
    down: Any

    def cells(self, plane: Plane, states: Any) -> jax.Array:
        """(blocks, WIDTH) flat indices of the relays, from (cells,) states before the first sample.

        They are filled up with `plane.cells`, which is out of range.
        """
        line, rising, begin, end, first, extreme = (jnp.asarray(one)[:, None] for one in self[:6])
        along = begin + jnp.arange(WIDTH)[jnp.newaxis]
        index = jnp.where(rising, flat_index(line, along), flat_index(along, line))
        kept = along < extreme
        was_on = jnp.asarray(states).at[index].get(mode="fill", fill_value=0.0) > 0.5
        on = jnp.where(rising, kept & was_on, kept | was_on)
        switches = (along < end) & (~first | (on != rising))
        return jnp.where(switches, index, plane.cells)

    def states_after(self, plane: Plane, states: jax.Array) -> jax.Array:
        """(cells,) states after the last sample, from those before the first."""
        up = jnp.asarray(self.up)[plane.alpha_index]
        down = jnp.asarray(self.down)[plane.beta_index]
        return jnp.where(up == down, states, (up > down).astype(states.dtype))


class Room(NamedTuple):
    """For how much there is room along a traced input; compiled functions are of one room."""

    passages: int
    blocks: int
    visits: int

    @classmethod
    def of(cls, count: int) -> Room:
        """The same of each."""
        return cls(count, count, count)


def relay_blocks(plane: Plane, levels: Any, room: Room | None = None) -> Blocks:
    """Find the relays that an input switches, S⁺(k) and S⁻(k) of eq. (8).

    A rise through row i switches on its cells from the lowest level since the row was last passed
    upward, a fall through column j switches off those below the highest since that was last passed
    downward. `levels`, (1 + time,), are those before each sample and after the last.
    """
    xp: Any = np if room is None else jnp
    size, change = plane.levels, xp.diff(levels)
    passed = xp.cumsum(xp.abs(change))
    passages = max(int(passed[-1]), 1) if room is None else room.passages
    number, samples = xp.arange(passages, dtype=np.int32), len(change)
    sample = xp.searchsorted(passed, number, side="right")
    at = xp.minimum(sample, samples - 1)
    place, rising = number - (passed[at] - abs(change[at])), change[at] > 0
    line = xp.where(rising, levels[at] + place, levels[at] - 1 - place)
    line = xp.where(sample < samples, line, size)
    before = _passed_before(xp, line)
    extreme = _extremes(xp, line, before, rising, size)
    first = before < 0
    low = xp.where(rising, xp.where(first, 0, extreme), line)
    high = xp.where(rising, line + 1, xp.where(first, size, extreme))
    count = xp.where(line < size, -(-(high - low) // WIDTH), 0)
    total = xp.cumsum(count)
    until = xp.where(passed > 0, total[xp.minimum(passed, passages) - 1], 0)
    if room is None:
        of = np.repeat(number, count)
        of = np.append(of, np.zeros(rounded_up(len(of)) - len(of), of.dtype))
    else:
        of = xp.minimum(xp.searchsorted(total, xp.arange(room.blocks), side="right"), passages - 1)
        until = xp.where(passed > passages, room.blocks + 1, until)
    begin = low[of] + WIDTH * (xp.arange(len(of)) - (total - count)[of])
    end = xp.where(xp.arange(len(of)) < total[-1], high[of], 0)
    last = (_last_at(xp, xp.where(way, line, size), size + 1) for way in (rising, ~rising))
    return Blocks(line[of], rising[of], begin, end, first[of], extreme[of], until, *last)


class Event(NamedTuple):
    """The relays that switch at a sample, all one way: +1 on, S⁺(k), or -1 off, S⁻(k)."""

    sample: int
    sign: int
    cells: np.ndarray


def switching(plane: Plane, x: ArrayLike) -> list[Event]:
    """List the switching events of an input that starts from saturated low.

    S⁺(k) and S⁻(k) of eq. (8), from the level of the input, quantised by (3), (4).
    """
    x, states = path_and_start(plane, x, "low", "relay")
    levels = np.asarray(relay_levels(plane, np.asarray(x)))
    blocks = relay_blocks(plane, np.append(levels[0], levels))
    cells: np.ndarray = np.asarray(cast(Any, jax.jit)(Blocks.cells)(blocks, plane, states))
    begin, events = 0, list[Event]()
    for k in np.flatnonzero(np.diff(blocks.until, prepend=0)):
        own = cells[begin : blocks.until[k]]
        sign = 1 if blocks.rising[begin] else -1
        events.append(Event(int(k), sign, own[own < plane.cells]))
        begin = blocks.until[k]
    return events


def _passed_before(xp: Any, line: Any) -> Any:
    """(passages,) which passage went through the same line the same way before, or -1.

    The passages of a line go up and down by turns.
    """
    order = xp.argsort(line, stable=True)
    two_before = xp.append(xp.full(2, -1), order[:-2])[: len(line)]
    same = line[order] == xp.append(xp.full(2, -1), line[order][:-2])[: len(line)]
    before = xp.where(same, two_before, -1)
    if xp is np:
        found = np.empty_like(before)
        found[order] = before
        return found
    return jnp.zeros_like(before).at[order].set(before)


def _extremes(xp: Any, line: Any, before: Any, rising: Any, size: int) -> Any:
    """Lowest level that falls have led to since the passage before, or highest of rises.

    Extremes over 1, 2, 4, ... passages are found once; any stretch is covered by two of them.
    """
    number = xp.arange(len(line))
    fallen = xp.where(rising | (line == size), size, line)
    risen = xp.where(rising, size - 1 - line, size)  # counted from above: both are least
    none = xp.full(1, size)
    least = xp.stack([xp.append(none, fallen[:-1]), xp.append(none, risen[:-1])])
    start = xp.where(before < 0, 0, before + 2)
    tables, powers, half = [least], xp.zeros_like(number), 1
    while half < len(line):
        ahead = xp.concatenate([least[:, half:], xp.repeat(least[:, -1:], half, axis=1)], axis=1)
        least, half = xp.minimum(least, ahead), 2 * half
        tables.append(least)
        powers = powers + (number + 1 - start >= half)
    table, side = xp.stack(tables), xp.where(rising, 0, 1)
    ends = (table[powers, side, at] for at in (start, number + 1 - (1 << powers)))
    found = xp.minimum(*ends)
    return xp.where(rising, found, size - found)


def _last_at(xp: Any, place: Any, places: int) -> Any:
    """(places,) number of the last passage of each, or -1."""
    number = xp.arange(len(place))
    if xp is jnp:
        return jnp.full(places, -1).at[place].max(number)
    last = np.full(places, -1)
    last[place] = number
    return last

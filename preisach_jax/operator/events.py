"""Switching events of relays: which hysterons an input switches, and when, as lines of the plane.

Where the input passes a threshold upward it switches on a stretch of one row of the plane, and
where it passes one downward it switches off a stretch of one column. Few samples pass any, so that
a recursion over events with their cells does in O(N) what costs O(N²) at every sample. Events
depend on the input alone: one list serves every noise level and every initial weight.
"""

from __future__ import annotations

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
    found = _switching_events(plane, x, *room_for_events(plane, x, 64))
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
    return _crossings(plane, sample, to, levels[0], width)


@eqx.filter_jit
def _crossings(
    plane: Plane, sample: jax.Array, to: jax.Array, start: jax.Array, width: int
) -> Switching:
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
    return Switching(sample, *jax.lax.scan(cross, (lowest, highest, start), to)[1])


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

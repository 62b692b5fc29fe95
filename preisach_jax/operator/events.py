"""Levels of the input that relays see, and how lists of events are filled up."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.typing import ArrayLike

from preisach_jax.operator.hysteron import position_on
from preisach_jax.operator.plane import Plane


def relay_levels(plane: Plane, x: ArrayLike, before: int = 0) -> np.ndarray | jax.Array:
    """Quantise an input to the levels that relays see, with the rest it may start with.

    As `Plane.quantise`, but a threshold on which the input rests at its start is not passed, as the
    states there are those of the initial memory by rule (1).

    Arguments:
        x: (time,) input, in the unit of the plane.

    Returns:
        (time,) integers in 0 ... levels; a NumPy array if the input is known, which is quicker.
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
    """Pick the samples at which a level moves.

    Arguments:
        levels: (time,) integers.

    Returns:
        `(sample, to)`, (moves,) each: where, and to which level. They are filled up, so that inputs
        of like length share what is compiled, with samples -1 at which the level stays as it ends.
    """
    sample = np.flatnonzero(levels[1:] != levels[:-1]) + 1
    filling = rounded_up(len(sample)) - len(sample)
    to = np.append(levels[sample], np.full(filling, levels[-1]))
    return np.append(sample, np.full(filling, -1)).astype(np.int32), to.astype(np.int32)


def rounded_up(count: int) -> int:
    """Round up to one of eight sizes an octave: inputs of like length share what is compiled."""
    step = 1 << max(count.bit_length() - 4, 0)
    return max(-(-count // step) * step, 16)

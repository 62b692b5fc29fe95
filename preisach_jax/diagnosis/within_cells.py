"""What the cells of the plane leave: errors that come back wherever the input passes a cell."""

from __future__ import annotations

import numpy as np

from preisach_jax.operator.plane import Plane, position_on
from preisach_jax.record import Record
from preisach_jax.record.course import last_move

BINS = 8
"""Parts of a cell over which errors are averaged along a pass."""

LEAST_ROWS = 4
"""Rows of a pass below which it tells nothing."""

LEAST_TOLD = 0.2
"""Share of the passes that must have a pair for the estimate to count."""


def within_cells_rms(
    record: Record, residual: np.ndarray, plane: Plane
) -> tuple[float, float] | None:
    r"""RMS of the part of a residual that is finer than a cell and comes back pass after pass.

    Along one pass of the input through a cell of the plane, a model of even ramps can follow the
    output no further than by a straight line.  What is left around such a line, averaged over
    parts of the cell, is a profile \(p_b\).  Of two passes \(m, n\) of the same cell in the same
    direction, with the most similar inputs at the last reversal, the products have the mean
    \(\langle p_b^{(m)} p_b^{(n)} \rangle\): the mean square of what both share.  Noise, and
    physics that act at other times in each pass, share nothing.

    Arguments:
        residual: (time,) measured minus predicted output.

    Returns:
        The RMS in output units and the most that it may be, by two deviations of the mean over
        pairs; None where too few passes have enough rows, or none of a pair pass the same parts of
        a cell.
    """
    rows = np.flatnonzero(record.measured)
    values = record.input[rows]
    moved = np.diff(values, prepend=values[:1]) != 0
    rising = last_move(values) > 0
    place = position_on(plane, values)
    cell = np.clip(place.astype(int), 0, plane.levels - 1)
    turned = np.diff(rising, prepend=not rising[0])
    starts = np.searchsorted(rows, record.starts)
    turned[starts[starts < len(rows)]] = True  # behind some start nothing may be measured
    begins = turned | (np.diff(cell, prepend=-1) != 0)
    number = np.cumsum(begins) - 1
    counts, profiles = _profiles(number, moved, place, cell, residual[rows])
    first = np.flatnonzero(begins)
    last_turn = np.maximum.accumulate(np.where(turned, np.arange(len(rows)), 0))[first]
    one, two = _pairs(2 * cell[first] + rising[first], values[last_turn], counts)
    if len(one) < LEAST_TOLD * len(first):
        return None
    weights = np.minimum(counts[one], counts[two])
    if not weights.any():
        return None
    total = float(weights.sum())
    products = np.sum(weights * profiles[one] * profiles[two], axis=1)
    shared = float(products.sum()) / total
    deviation = float(np.linalg.norm(products - shared * weights.sum(axis=1))) / total
    return float(np.sqrt(max(shared, 0.0))), float(np.sqrt(max(shared + 2 * deviation, 0.0)))


def _profiles(
    number: np.ndarray, moved: np.ndarray, place: np.ndarray, cell: np.ndarray, error: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(pass, part) rows in each part of a cell, and the mean there around a straight line."""
    passes, weight = int(number[-1]) + 1, moved.astype(float)
    rows = np.maximum(np.bincount(number, weight, passes), 1.0)

    def centred(values: np.ndarray) -> np.ndarray:
        return values - (np.bincount(number, weight * values, passes) / rows)[number]

    x, y = centred(place), centred(error)
    power = np.bincount(number, weight * x * x, passes)
    slope = np.bincount(number, weight * x * y, passes) / np.where(power > 0, power, 1.0)
    part = BINS * number + np.clip((BINS * (place - cell)).astype(int), 0, BINS - 1)
    shape = (passes, BINS)
    counts = np.bincount(part, weight, passes * BINS).reshape(shape)
    sums = np.bincount(part, weight * (y - slope[number] * x), passes * BINS).reshape(shape)
    return counts, sums / np.maximum(counts, 1.0)


def _pairs(kind: np.ndarray, turn: np.ndarray, counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Passes of one cell and direction, each with that of the next input at its last reversal."""
    told = np.flatnonzero(counts.sum(axis=1) >= LEAST_ROWS)
    order = told[np.lexsort((turn[told], kind[told]))]
    same = kind[order[:-1]] == kind[order[1:]]
    return order[:-1][same], order[1:][same]

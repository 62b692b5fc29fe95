"""Closed cycles of an input, and the areas of loops over them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from preisach_jax.record import Record
from preisach_jax.record.course import reversals

CLOSES = 0.02
"""Share of a cycle's swing by which the input may miss its first turning point at the end."""

LEAST_SAMPLES = 16
"""Samples of the shortest cycle that is counted: the polygon of a sine of so many lacks 2.6 %."""

BRIDGED = 0.1
"""Greatest share of a cycle's samples without a measured output that is bridged."""


@dataclass(frozen=True, eq=False)
class ClosedPath:
    """A closed cycle of the input.

    Attributes:
        start, stop: where it begins and ends, in samples of the record.
        path: (corner,) samples in between, without cycles that lie inside; the last one, where the
            input comes back, lies between two samples.
    """

    start: float
    stop: float
    path: np.ndarray

    def along(self, values: np.ndarray) -> np.ndarray:
        """(corner,) a signal on its path, straight between samples."""
        low = np.floor(self.path).astype(int)
        high = np.minimum(low + 1, len(values) - 1)
        share = self.path - low
        # A neighbour that was not measured says nothing where its share is nought.
        return np.where(share > 0, (1 - share) * values[low] + share * values[high], values[low])


def closed_cycles(record: Record) -> list[ClosedPath]:
    """The cycles of a record's input that close, by counting rainflow.

    From a turning point, a cycle goes to the next one and back to the value of the first, with an
    allowance of `CLOSES`.  A cycle inside another one is taken out of its path, as a Preisach
    operator forgets it, so that each stretch of the input belongs to one cycle (S. D. Downing,
    D. F. Socie, Int. J. Fatigue 4 (1982) 31-40).
    """
    found: list[ClosedPath] = []
    band = 0.01 * float(np.ptp(record.input))
    for rows in record.stretches:
        turns = rows.start + reversals(record.input[rows], band)
        found += _rainflow(record.input, [rows.start, *turns.tolist(), rows.stop - 1])
    return sorted(
        (loop for loop in found if len(loop.path) >= LEAST_SAMPLES), key=lambda loop: loop.stop
    )


def _rainflow(values: np.ndarray, corners: list[int]) -> list[ClosedPath]:
    """Closed cycles between corners, of which the first and the last one are ends and no turns."""
    found: list[ClosedPath] = []
    points, paths = [corners[0]], [np.array([float(corners[0])])]
    for corner in corners[1:]:
        paths[-1] = np.arange(points[-1], corner, dtype=float)
        points.append(corner)
        paths.append(np.array([float(corner)]))
        while len(points) >= 3:
            first, turn, last = points[-3:]
            swing = abs(values[turn] - values[first])
            if abs(values[last] - values[turn]) < (1 - CLOSES) * swing:
                break
            if first == corners[0]:  # it is an end, at which no cycle begins
                del points[0], paths[0]
                continue
            back = _crossing(values, paths[-2], last, values[first])
            there = paths[-2][paths[-2] < back]
            found.append(ClosedPath(float(first), back, np.concatenate([paths[-3], there, [back]])))
            rest = paths[-2][paths[-2] > back]
            del points[-3:-1], paths[-3:-1]
            if points[:-1]:
                paths[-2] = np.concatenate([paths[-2], [float(first), back], rest])
    return found


def _crossing(values: np.ndarray, path: np.ndarray, last: int, level: float) -> float:
    """Where a branch first comes to a level, between samples; its end if it stays below."""
    places = np.append(path, float(last))
    along = np.interp(places, np.arange(len(values)), values)
    rising = along[-1] > along[0]
    passed = np.flatnonzero((along >= level) if rising else (along <= level))
    if not len(passed):
        return float(last)
    k = int(passed[0])
    share = (level - along[k - 1]) / (along[k] - along[k - 1])
    return float(places[k - 1] + share * (places[k] - places[k - 1]))


def enclosed(x: np.ndarray, y: np.ndarray) -> float:
    r"""Area that a closed path encloses, positive where it runs counterclockwise.

    \[ \oint x\,dy = \tfrac12 \sum_k (x_k\,y_{k+1} - x_{k+1}\,y_k) \]

    Arguments:
        x, y: (corner,) coordinates; from the last corner the path goes straight to the first.

    Returns:
        The area, in units of x times y.
    """
    x, y = x - x.mean(), y - y.mean()
    return 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))

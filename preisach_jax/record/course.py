"""The course of a signal: its rate, where it turns, and how its samples scatter."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

DEAD_BAND = 0.01
"""Share of its range that the input must come back by to count as reversed."""

SAME = 1e-12
"""Difference of two readings, over their range, that is rounding of the computer."""

OFF_THE_LATTICE = 0.02
"""Steps by which a reading may lie off the lattice."""


def input_rate(time: np.ndarray, values: np.ndarray, starts: Sequence[int] = ()) -> np.ndarray:
    """Rate of a signal by central differences with the actual time steps."""
    parts = zip(np.split(values, starts), np.split(time, starts), strict=True)
    return np.concatenate([np.gradient(part, when) for part, when in parts])


def last_move(values: np.ndarray) -> np.ndarray:
    """Direction of the last move of a signal."""
    step = np.sign(np.diff(values, prepend=values[:1]))
    moved = np.maximum.accumulate(np.where(step != 0, np.arange(len(step)), 0))
    return np.where(step[moved] == 0, 1.0, step[moved])


def reversals(
    values: np.ndarray, dead_band: float | None = None, starts: Sequence[int] = ()
) -> np.ndarray:
    """Samples at which a signal turns.

    A turn counts once the signal has come back by more than the dead band, so that noise does not
    turn; where it rests at its extreme, the turn is where it arrived.
    """
    values = np.asarray(values, dtype=float)
    if dead_band is None:
        dead_band = DEAD_BAND * float(np.ptp(values))
    if len(starts):
        edges = [0, *starts, len(values)]
        parts = [start + reversals(values[start:stop], dead_band)
                 for start, stop in itertools.pairwise(edges)]  # fmt: skip
        return np.concatenate(parts)
    arrivals = np.flatnonzero(np.diff(values, prepend=np.nan) != 0)
    slope = np.sign(np.diff(values[arrivals]))
    corners = arrivals[np.flatnonzero(np.diff(slope, prepend=0, append=0) != 0)]
    return np.array(_turns(values[corners].tolist(), corners.tolist(), dead_band), dtype=int)


def _turns(extremes: Sequence[float], places: Sequence[int], dead_band: float) -> list[int]:
    """Places of those of alternating extremes that differ by more than the dead band."""
    found: list[int] = []
    direction = 0  # unknown until the signal has moved by the dead band
    highest = lowest = 0
    for k, value in enumerate(extremes):
        if value > extremes[highest]:
            highest = k
        if value < extremes[lowest]:
            lowest = k
        if direction >= 0 and extremes[highest] - value > dead_band:
            if direction > 0:
                found.append(places[highest])
            direction, lowest, highest = -1, k, k
        elif direction <= 0 and value - extremes[lowest] > dead_band:
            if direction < 0:
                found.append(places[lowest])
            direction, lowest, highest = 1, k, k
    return found


def last_reversal(
    values: np.ndarray, dead_band: float | None = None, starts: Sequence[int] = ()
) -> np.ndarray:
    """Sample at which a signal last turned; before its first turn, the first one."""
    turns = np.sort(np.concatenate([[0], starts, reversals(values, dead_band, starts)]).astype(int))
    return turns[np.searchsorted(turns, np.arange(len(values)), side="right") - 1]


def time_since_reversal(
    time: np.ndarray, values: np.ndarray, dead_band: float | None = None, starts: Sequence[int] = ()
) -> np.ndarray:
    """Time since a signal last turned; before its first turn, since the start."""
    return time - time[last_reversal(values, dead_band, starts)]


def spread(sizes: np.ndarray) -> float:
    """Standard deviation of normal numbers of these sizes, whatever the greatest are."""
    # The ninth tenth of normal numbers lies 1.645 standard deviations out; spikes are fewer.
    return float(np.quantile(sizes, 0.9)) / 1.645


def resolution(values: np.ndarray) -> float:
    """Least step between different values: of a converter, if one made them."""
    steps = np.diff(np.unique(values))
    return float(steps.min()) if len(steps) else 0.0


def lattice_step(values: np.ndarray) -> float:
    """Step of the converter behind some readings, 0 if they lie on no lattice.

    On a lattice all differences between readings are multiples of one step, which is the least of
    them; numbers closer than a millionth of a millionth of the range are one reading.
    """
    distinct = np.unique(values)
    if len(distinct) < 2:
        return 0.0
    reach = float(distinct[-1] - distinct[0])
    apart: np.ndarray = np.diff(distinct)
    least = float(apart[apart > SAME * reach].min())
    places: np.ndarray = (distinct - distinct[0]) / least
    whole = np.round(places)
    if np.abs(places - whole).max() > OFF_THE_LATTICE:
        return 0.0
    return reach / float(whole[-1])


def middle_range(values: np.ndarray) -> float:
    """Range of the values but the greatest and the least hundredth."""
    low, high = np.quantile(values, [0.01, 0.99])
    return float(high - low)

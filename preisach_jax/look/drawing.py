"""A record in few columns: for pictures in a terminal, and for figures of a million samples."""

from __future__ import annotations

import numpy as np

_DOTS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]])
"""Bits of the dots of a Braille sign, from its top, left and right."""


def extremes(
    time: np.ndarray, values: np.ndarray, columns: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Least and greatest value in each of many equal stretches of time.

    Arguments:
        time: (K,) s, increasing.
        values: (K,) signal, NaN where there is none.

    Returns:
        (columns,) middle of each stretch, least and greatest value; NaN where there is no sample.
    """
    edges: np.ndarray = np.linspace(float(time[0]), float(time[-1]), columns + 1)
    there = np.isfinite(values)
    place = np.clip(np.searchsorted(edges, time[there], side="right") - 1, 0, columns - 1)
    low: np.ndarray = np.full(columns, np.inf)
    high: np.ndarray = np.full(columns, -np.inf)
    np.minimum.at(low, place, values[there])
    np.maximum.at(high, place, values[there])
    empty = ~np.isfinite(low)
    low[empty] = high[empty] = np.nan
    return 0.5 * (edges[:-1] + edges[1:]), low, high


def braille(
    time: np.ndarray,
    values: np.ndarray,
    width: int,
    height: int,
    limits: tuple[float, float] | None = None,
) -> list[str]:
    """A signal over time as lines of Braille signs, two dots wide and four high each.

    Arguments:
        time: (K,) s, increasing.
        values: (K,) signal, NaN where there is none.
        limits: values at the lowest and the highest dots; by default those of the signal.
    """
    columns, dots = 2 * width, 4 * height
    _, low, high = extremes(time, values, columns)
    least, most = limits or (float(np.nanmin(low)), float(np.nanmax(high)))
    scale = (dots - 1) / (most - least or 1.0)
    first: list[float] = np.clip(np.round((low - least) * scale), 0, dots - 1).tolist()
    last: list[float] = np.clip(np.round((high - least) * scale), 0, dots - 1).tolist()
    grid = np.zeros((dots, columns), dtype=bool)
    before: tuple[float, float] | None = None
    for k in range(columns):
        if first[k] != first[k]:  # NaN: no sample
            before = None
            continue
        bottom, top = first[k], last[k]
        if before is not None:  # one line, without holes between two columns
            bottom, top = min(bottom, before[1] + 1), max(top, before[0] - 1)
        grid[int(bottom) : int(top) + 1, k] = True
        before = (first[k], last[k])
    return _signs(grid)


def braille_curve(x: np.ndarray, y: np.ndarray, width: int, height: int) -> list[str]:
    """A curve in the plane, such as a loop, as lines of Braille signs.

    Arguments:
        x: (K,) to the right, without NaN.
        y: (K,) upward, without NaN.
    """
    places: list[np.ndarray] = []
    for values, dots in ((x, 2 * width), (y, 4 * height)):
        low, high = float(values.min()), float(values.max())
        scaled = (values - low) * ((dots - 1) / (high - low or 1.0))
        # Points between two samples close the holes of a fast course.
        between = np.linspace(0, len(scaled) - 1, 8 * len(scaled))
        places.append(np.round(np.interp(between, np.arange(len(scaled)), scaled)).astype(int))
    grid = np.zeros((4 * height, 2 * width), dtype=bool)
    grid[places[1], places[0]] = True
    return _signs(grid)


def _signs(grid: np.ndarray) -> list[str]:
    """Dots, the lowest line first, as lines of Braille signs from above."""
    height, width = grid.shape[0] // 4, grid.shape[1] // 2
    cells = grid[::-1].reshape(height, 4, width, 2).transpose(0, 2, 1, 3)
    codes = 0x2800 + (cells * _DOTS).sum(axis=(2, 3))
    return ["".join(chr(code) for code in line).rstrip("\u2800") for line in codes]

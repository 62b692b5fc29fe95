"""A record in few columns: for pictures in a terminal, and for figures of a million samples."""

from __future__ import annotations

import numpy as np

_DOTS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]])
"""Bits of the dots of a Braille sign, from its top, left and right."""


def extremes(
    time: np.ndarray, values: np.ndarray, columns: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Least and greatest value in each of many equal stretches of time."""
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


def braille(time: np.ndarray, values: np.ndarray, width: int, height: int) -> list[str]:
    """A signal over time as lines of Braille signs, two dots wide and four high each."""
    columns, dots = 2 * width, 4 * height
    _, low, high = extremes(time, values, columns)
    least = float(np.nanmin(low))
    span = float(np.nanmax(high)) - least or 1.0
    first: list[float] = np.round((low - least) / span * (dots - 1)).tolist()
    last: list[float] = np.round((high - least) / span * (dots - 1)).tolist()
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
    cells = grid[::-1].reshape(height, 4, width, 2).transpose(0, 2, 1, 3)
    codes = 0x2800 + (cells * _DOTS).sum(axis=(2, 3))
    return ["".join(chr(code) for code in line).rstrip("\u2800") for line in codes]

"""What the views draw of a record and of a residual, computed once beside the figures."""

from __future__ import annotations

from typing import Any

import numpy as np

from preisach_jax.diagnosis import residuals as stats
from preisach_jax.fit import double_precision
from preisach_jax.operator.plane import Plane, position_on
from preisach_jax.operator.simulation import branch_starts
from preisach_jax.record import Record

MOST_ROWS = 100_000
"""Rows that are drawn; of a longer record every n-th, the extremes of the input kept."""


def drawn_rows(record: Record) -> np.ndarray:
    """(row,) the rows that are drawn: all, or every n-th and the turning points."""
    count = len(record)
    if count <= MOST_ROWS:
        return np.arange(count)
    regular = np.arange(0, count, -(-count // MOST_ROWS))
    return np.union1d(regular, stats.reversals(record.input))


def plane_course(record: Record, plane: Plane) -> tuple[np.ndarray, np.ndarray]:
    """(time,) position of the input on the plane, and that from which its branch departs.

    Returns:
        Both from 0 (lowest) to N (highest).
    """
    position = position_on(plane, record.input)
    path = np.concatenate([[0.0], position])
    with double_precision():
        start = np.asarray(branch_starts(path))
    return position, path[start][1:]


def amplitude_spectrum(record: Record, values: np.ndarray, bins: int = 800) -> dict[str, Any]:
    """Amplitude of a residual's waves over frequency; of close frequencies the greatest.

    Arguments:
        values: (time,) the residual, NaN where nothing was measured.

    Returns:
        `x` in Hz and `y` in the unit of the residual.
    """
    filled = stats.in_sequence(record, values, stats.longest_lag(record))
    there = np.isfinite(filled)
    centred = np.where(there, filled - filled[there].mean(), 0.0)
    amplitude = 2 * np.abs(np.fft.rfft(centred))[1:] / max(there.sum(), 1)
    frequency = np.fft.rfftfreq(len(centred), record.step_s)[1:]
    edges = np.unique(np.geomspace(1, len(frequency), bins).astype(int)) - 1
    highest = np.maximum.reduceat(amplitude, edges)
    stretches = zip(edges, [*edges[1:], len(amplitude)], strict=True)
    at = [begin + int(np.argmax(amplitude[begin:end])) for begin, end in stretches]
    return {"x": frequency[at], "y": np.maximum(highest, 1e-300)}


def bins_of(position: np.ndarray, values: np.ndarray) -> dict[str, Any]:
    """Median and 95 % band of values along a position, as the columns of a source."""
    found = stats.binned(position, values)
    return {name: getattr(found, name) for name in ("centre", "low", "median", "high")}


def no_bins() -> dict[str, Any]:
    """The same columns without rows."""
    return {name: [] for name in ("centre", "low", "median", "high")}

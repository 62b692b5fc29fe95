r"""How far the loss of a measured cycle may be from that of a model's.

What a prediction misses, e(t), changes the area of a loop by \(\oint e\,du\).  Its variance is a
sum of parts, whose sizes are those of the `Law` of the prediction's band, and which differ in how
far e is alike along the path:

- of other models that the record could have led to, each has a loop of its own, and its area is
  taken as it is;
- what goes with the speed has one sign on each branch, so that it adds up along the whole path,
  \((\oint \sigma\,|du|)^2\);
- what cells of width c miss is alike over four of them, \(\oint \sigma^2\,4 c\,|du|\);
- noise is alike over no step at all, \(\sum \sigma^2 (\Delta u)^2\).

The half width is the conformal quantile of the band times the deviation.  Where the memory is
unknown, the area of what the input forces on the way comes to it, at most its height times the
swing.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from preisach_jax.loss.cycles import ClosedPath, enclosed
from preisach_jax.model import Model, Prediction
from preisach_jax.model.band import COVERAGE_Z, Course, Law
from preisach_jax.record import Record

REACH = 4.0
"""Cells over which what cells miss is alike: the longer one of the two decays of the law."""


def half_widths(
    model: Model, record: Record, predicted: Prediction, loops: Sequence[ClosedPath]
) -> np.ndarray:
    """Half widths of the 95 % band of the loss of some cycles.

    Returns:
        (loop,) in input units times output units.
    """
    half = 0.5 * (predicted.high - predicted.low)
    band = model.band
    if band is None or band.law is None:  # of an older file, which says nothing of the parts
        return np.array([_of_one_sign(loop, record.input, half) for loop in loops])
    course = Course.of(record)
    rows, apart = model.others_along(record)
    of_blocks = band.others.of_blocks if band.others is not None else 0
    parts = apart[:of_blocks], apart[of_blocks:]
    open_memory = np.maximum(half - model.half_width(record), 0.0)
    slices = band.by_slice(course)
    found: list[float] = []
    for loop in loops:
        variance = _of_law(loop, record.input, course, band.law)
        for differences, share in zip(parts, band.law.shares[-2:].tolist(), strict=True):
            variance += share * _of_others(loop, record.input, rows, differences)
        deviations = float(np.mean(loop.along(slices)))
        # A hysteron of unknown state adds a constant, and so no area, until the input forces it.
        forced = float(np.ptp(loop.along(open_memory)))
        more = forced * float(np.ptp(loop.along(record.input)))
        found.append(deviations * float(np.sqrt(variance)) + more)
    return np.array(found)


def _of_one_sign(loop: ClosedPath, input: np.ndarray, size: np.ndarray) -> float:
    """What an error of one sign on each branch makes of an area."""
    steps, along = np.abs(np.diff(loop.along(input))), loop.along(size)
    return float(np.sum(0.5 * (along[1:] + along[:-1]) * steps))


def _of_law(loop: ClosedPath, input: np.ndarray, course: Course, law: Law) -> float:
    """Variance of an area by what goes with the speed, what cells miss, and noise."""
    of_speed, rest = law.by_origin(course)
    noise = np.minimum(rest, (law.least / COVERAGE_Z) ** 2)
    steps = np.abs(np.diff(loop.along(input)))
    of_steps = loop.along(noise)[1:] @ steps**2
    of_cells = loop.along(rest - noise)[1:] @ (steps * np.maximum(REACH * law.cell, steps))
    return float(_of_one_sign(loop, input, np.sqrt(of_speed)) ** 2 + of_steps + of_cells)


def _of_others(
    loop: ClosedPath, input: np.ndarray, rows: np.ndarray, differences: np.ndarray
) -> float:
    """Sum of the squared areas by which some other models differ."""
    x = loop.along(input)
    curves: list[np.ndarray] = [np.interp(loop.path, rows, row) for row in differences]
    return sum(enclosed(x, curve) ** 2 for curve in curves)

"""Whether a line of the residual comes from the drive, or from the steps of its reading."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from preisach_jax.effects.hum import Hum
from preisach_jax.effects.output_quantisation import lattice_step
from preisach_jax.identify import Point, Problem
from preisach_jax.look.stretches import Period

NEIGHBOURS = 10
"""Teeth of the comb on either side of a line that are looked at."""

STANDS_OUT = 10.0
"""Height from which on a line at a multiple of the drive's is one of its own, over the highest of
them: teeth of development records had up to 3.4, lines of hums 50 and more."""

WITHIN = np.linspace(-1.0, 1.0, 9)
"""Places about a line of the input that count as it, over the length of the record."""

BESIDE = np.r_[-20:-3, 4:21]
"""Places beside a line of the input that are looked at, over the length of the record."""

STANDS_OUT_OF_INPUT = 3.0
"""Height from which on the recorded input has a line of its own, over the highest place beside it:
at hums of development records it had up to 1.3, at the line of a converter's steps 4."""

OF_THE_HUM = 0.5
"""Share of a hum that the line of the input must come to in the output."""


def is_of_steps(
    point: Point, hum: Hum, f_hz: float, inputs: Sequence[tuple[np.ndarray, np.ndarray]]
) -> bool:
    """Whether a hum is at a line that the steps of the recorded input make.

    What is recorded of a ramp differs from what acted by a sawtooth of as many periods as the ramp
    passes steps of the converter; samples fold its lines to anywhere.

    Arguments:
        inputs: (time,) seconds and input of each run, before it was thinned.
    """
    heights = _heights(point, hum)
    line_hz = (int(np.argmax(heights)) + 1) * f_hz
    span = max(float(np.ptp(values)) for _, values in inputs)
    least = OF_THE_HUM * float(heights.max()) * span / point.unit
    for time, values in inputs:
        if not lattice_step(values):
            continue
        moved, length = values - values.mean(), float(np.ptp(time))
        own = float(_amplitudes(time, moved, line_hz + WITHIN / length).max())
        beside = float(_amplitudes(time, moved, line_hz + BESIDE / length).max())
        if own > max(STANDS_OUT_OF_INPUT * beside, least):
            return True
    return False


def is_tooth(problem: Problem, point: Point, hum: Hum, f_hz: float, period: Period) -> bool:
    """Whether a hum is at a multiple of the drive's frequency, and no line of it stands out there.

    Whatever is wrong with a model comes back with a drive of period T, at all multiples of 1/T: a
    line of its own is far higher than those beside it, f ± j/T.
    """
    if not period.has_multiple(f_hz, float(np.ptp(problem.record.time))):
        return False
    time = problem.record.time[problem.rows]
    residual = point.residual * point.unit
    highest = 0.5 / problem.survey.step_s
    for multiple, own in enumerate(_heights(point, hum), 1):
        beside = multiple * f_hz + np.r_[-NEIGHBOURS:0, 1 : NEIGHBOURS + 1] / period.seconds
        beside = beside[(beside > 0.5 / period.seconds) & (beside < highest)]
        if not beside.size or own > STANDS_OUT * _amplitudes(time, residual, beside).max():
            return False
    return True


def _heights(point: Point, hum: Hum) -> np.ndarray:
    """(harmonic,) amplitudes of the lines of a hum, in the unit of the output."""
    pairs = zip(point.chain.coefficients, point.coefficients().added, strict=True)
    parts = [float(value) for (name, _), value in pairs if name == hum.name]
    return np.hypot(parts[::2], parts[1::2])


def _amplitudes(time: np.ndarray, values: np.ndarray, f_hz: np.ndarray) -> np.ndarray:
    """(line,) amplitudes of lines, by a Hann window."""
    window = np.sin(np.pi * (time - time.min()) / np.ptp(time)) ** 2
    turned = np.exp(-2j * np.pi * np.outer(f_hz, time))
    return 2 * np.abs(turned @ (window * values)) / window.sum()

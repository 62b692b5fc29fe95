"""One excitation that shows every effect of the library at least once."""

from __future__ import annotations

import math

import numpy as np

from preisach_jax.errors import InputError, require_positive
from preisach_jax.signals.checks import ordered
from preisach_jax.signals.periodic import shrinking
from preisach_jax.signals.stochastic import GOLDEN


class _Pen:
    """Draws a piecewise linear signal: corners at whole samples, levels in parts of the range."""

    def __init__(self, samples_per_second: float):
        self.per_second = samples_per_second
        self.corners, self.levels = [0], [0.0]

    def _after(self, seconds: float) -> int:
        return self.corners[-1] + max(1, round(seconds * self.per_second))

    def go(self, level: float, rate: float) -> None:
        """Moves to a level at a rate in parts of the range per second."""
        self.corners.append(self._after(abs(level - self.levels[-1]) / rate))
        self.levels.append(level)

    def hold(self, seconds: float) -> tuple[int, int]:
        """Rests; returns the first and last sample."""
        begin = self.corners[-1]
        self.corners.append(self._after(seconds))
        self.levels.append(self.levels[-1])
        return begin, self.corners[-1]

    def loop(self) -> None:
        """The reference loop: to the top and back."""
        self.go(1.0, 4.0)
        self.go(0.0, 4.0)


def _decays(pen: _Pen) -> None:
    """Decaying triangles at three rates over 1.5 decades, to centres that differ."""
    for rate, turns, centre in ((0.8, 5, 0.47), (4.0, 9, 0.61), (26.0, 14, 0.38)):
        pen.go(0.0, 3.5)
        for level in shrinking(0.0, 1.0, centre, turns):
            pen.go(level, rate)
        pen.hold(0.1)


def _holds(pen: _Pen) -> None:
    """Steps upward and downward, held for times over two decades."""
    times = (0.018, 0.2, 0.06, 1.9, 0.6)
    pen.go(0.0, 3.5)
    for level, seconds in zip((0.13, 0.34, 0.52, 0.71, 0.92), times, strict=True):
        pen.go(level, 40.0)
        pen.hold(seconds)
    for level, seconds in zip((0.81, 0.63, 0.43, 0.24, 0.08), times, strict=True):
        pen.go(level, 40.0)
        pen.hold(seconds)


def _minor_loops(pen: _Pen) -> None:
    """Loops of equal swing at five biases, on the rising branch and on the falling one."""
    swing, biases = 0.16, (0.1, 0.27, 0.44, 0.61, 0.78)
    pen.go(0.0, 3.5)
    for bias in biases:
        for level in (bias + swing, bias, bias + swing):
            pen.go(level, 3.5)
    pen.go(1.0, 3.5)
    for bias in biases[::-1]:
        for level in (bias, bias + swing, bias):
            pen.go(level, 3.5)
    pen.go(0.0, 3.5)


def _spread(pen: _Pen) -> None:
    """Turning points that fill the plane evenly, at alternating rates."""
    for j in range(19):
        upper, lower = (0.5 + j * GOLDEN) % 1.0, (0.25 + j * math.sqrt(2.0)) % 1.0
        upper, lower = max(upper, lower), min(upper, lower)
        pen.go(upper, (2.0, 6.0, 18.0)[j % 3])
        pen.go(lower, (2.0, 6.0, 18.0)[j % 3])


def _diagnostic_pen(samples_per_second: float) -> tuple[_Pen, tuple[int, int]]:
    pen = _Pen(samples_per_second)
    pen.hold(0.2)
    for _ in range(3):
        pen.loop()
    _decays(pen)
    _holds(pen)
    _minor_loops(pen)
    pen.go(0.64, 3.5)
    pen.hold(1.2)
    _spread(pen)
    pen.go(0.5, 3.5)
    vibration = pen.hold(2.0)
    pen.go(0.0, 3.5)
    pen.loop()
    pen.hold(0.2)
    return pen, vibration


def _vibration(samples: int) -> np.ndarray:
    """Twenty equal sines with Schroeder's phases and soft ends, in parts of the range."""
    lines = np.arange(2, 61, 3)
    phases = -np.pi * np.arange(lines.size) * np.arange(1, lines.size + 1) / lines.size
    place = (np.arange(samples) + 0.5) / samples
    wave = np.sin(2.0 * np.pi * lines * place[:, None] + phases).sum(axis=1)
    # Both ends have to meet the rest around it.
    taper = np.clip(10.0 * np.minimum(place, 1.0 - place), 0.0, 1.0)
    return 0.12 * wave / np.max(np.abs(wave)) * np.sin(0.5 * np.pi * taper) ** 2


def diagnostic_record(
    seconds: float = 24.0, rate_hz: float = 2000.0, low: float = 0.0, high: float = 75.0
) -> np.ndarray:
    """One excitation that shows every effect of the library at least once.

    In this order: three exact repeats of a reference loop (noise floor), decaying triangles at
    three rates over 1.5 decades (rate, lag), steps in both directions held over two decades of time
    (creep), minor loops of equal swing at five biases on both branches (congruency), a pause
    (drift), turning points all over the range, a short multisine (delay against lag), and the
    reference loop again (drift, ageing).

    Arguments:
        seconds: duration, s; all times stretch with it, and rates in proportion fall. In 24 s the
            slowest decaying triangle moves 0.8 ranges a second and the fastest 26.
        rate_hz: sampling rate, Hz.
        low: lower end, in the unit of the input; the signal starts and ends here.
        high: upper end, same unit.

    Returns:
        (round(seconds * rate_hz),) input; a NumPy array in double precision whatever JAX works in,
        because it is to be played and written to files. Its corners are sampled exactly.

    Raises:
        InputError: a time or rate is not positive, the range is empty, or the samples are too few.

    Example:
        >>> diagnostic_record(seconds=24.0, rate_hz=500.0).shape
        (12000,)
    """
    require_positive(seconds=seconds, rate_hz=rate_hz)
    ordered(low, high)
    samples = round(seconds * rate_hz)
    if samples < 6000:
        raise InputError(
            f"{seconds:g} s at {rate_hz:g} Hz are {samples} samples, too few for the fast parts: "
            "give at least 6000"
        )
    ruler = 100_000.0
    plan_s = _diagnostic_pen(ruler)[0].corners[-1] / ruler
    pen, (begin, end) = _diagnostic_pen((samples - 1) / plan_s)
    shape = np.interp(np.arange(samples), pen.corners, pen.levels)
    shape[begin:end] += _vibration(end - begin)
    return low + (high - low) * shape

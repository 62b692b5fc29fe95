"""Frequency response: measured from periodic records, and a linear model of it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike

from preisach_jax.errors import InputError, require_positive
from preisach_jax.signals.checks import checked_lines

DAMPING = (1e-4, 0.9)  # range searched
START_DAMPING = 0.02


class MeasuredResponse(NamedTuple):
    """Frequency response measured on the excited lines.

    Arguments:
        frequency_hz: (lines,) Hz.
        response: (lines,) complex H, output over input.
        deviation: (lines,) standard deviation of H, of both parts together, from period to period.
    """

    frequency_hz: np.ndarray
    response: np.ndarray
    deviation: np.ndarray


class ModalFit(NamedTuple):
    """Linear model of a frequency response: a rational filter with lightly damped modes.

    Arguments:
        gain: gain at rest, output unit per input unit.
        frequency_hz: (modes,) natural frequencies, ascending, Hz.
        damping: (modes,) damping ratios.
        numerator: (2 modes + 1,) coefficients of 1, d^-1, ...
        denominator: (2 modes + 1,) the same, the first being 1.
        delay_samples: whole samples by which the output is later than this filter says.
        rate_hz: sampling rate, Hz.
        error: RMS of |H_model/H - 1| over the lines.
    """

    gain: float
    frequency_hz: np.ndarray
    damping: np.ndarray
    numerator: np.ndarray
    denominator: np.ndarray
    delay_samples: int
    rate_hz: float
    error: float

    def response(self, frequency_hz: ArrayLike) -> np.ndarray:
        """Frequency response of the model.

        Arguments:
            frequency_hz: frequencies, Hz, of any shape.

        Returns:
            Complex response, of the same shape, output unit per input unit.
        """
        bare = frequency_response(self.numerator, self.denominator, frequency_hz, self.rate_hz)
        return bare * _backward(frequency_hz, self.rate_hz) ** self.delay_samples


def frequency_response(
    numerator: ArrayLike, denominator: ArrayLike, frequency_hz: ArrayLike, rate_hz: float
) -> np.ndarray:
    """Frequency response of a rational discrete-time filter.

    F(e^{jωT}) = Σ b_i e^{-ijωT} / Σ a_i e^{-ijωT}.

    Arguments:
        numerator: (order_b + 1,) coefficients b_i of d^-i.
        denominator: (order_a + 1,) coefficients a_i of d^-i.
        frequency_hz: frequencies, Hz, of any shape.
        rate_hz: sampling rate 1/T, Hz.

    Returns:
        Complex response, of the same shape; NumPy, in double precision.

    Raises:
        InputError: the sampling rate is not positive.

    Example:
        >>> mean_of_two = frequency_response([0.5, 0.5], [1.0], [0.0, 500.0], rate_hz=1000.0)
        >>> [round(float(h), 3) for h in abs(mean_of_two)]
        [1.0, 0.0]
    """
    require_positive(rate_hz=rate_hz)
    back = _backward(frequency_hz, rate_hz)
    above = np.polynomial.polynomial.polyval(back, np.asarray(numerator, float))
    return above / np.polynomial.polynomial.polyval(back, np.asarray(denominator, float))


def measure_frequency_response(
    u: ArrayLike, z: ArrayLike, periods: int, rate_hz: float, lines: Sequence[int]
) -> MeasuredResponse:
    """Measure a frequency response with a periodic excitation, without leakage.

    The first period, in which transients fade, is discarded; of the P others
    H(n) = mean_p Z_p(n) / mean_p U_p(n), and its standard deviation is that of Z_p - H U_p over
    √P |mean_p U_p|. What repeats from period to period, as the distortion by a hysteresis does, is
    no part of the deviation: it shows as scatter from line to line.

    Arguments:
        u: (time,) input, `periods` equal periods.
        z: (time,) output.
        periods: number of periods in the record, at least 3.
        rate_hz: sampling rate, Hz.
        lines: whole cycles a period of the excited sines.

    Returns:
        The response on these lines.

    Raises:
        InputError: the record does not hold whole periods, or a line is not whole, is out of range,
            occurs twice or is not excited.

    Example:
        >>> wave = np.tile(np.cos(2 * np.pi * np.arange(8) / 8), 3)
        >>> measured = measure_frequency_response(wave, 2 * wave, 3, rate_hz=8.0, lines=[1])
        >>> measured.frequency_hz.tolist(), abs(measured.response).round(6).tolist()
        ([1.0], [2.0])
    """
    u, z = np.asarray(u, float), np.asarray(z, float)
    if periods < 3:
        raise InputError(f"periods is {periods}: give at least 3, as the first is discarded")
    if u.ndim != 1 or u.shape != z.shape or u.size == 0 or u.size % periods:
        raise InputError(
            f"u has the shape {u.shape} and z {z.shape}: give (time,) twice, with time a multiple "
            f"of {periods} periods"
        )
    require_positive(rate_hz=rate_hz)
    size = u.size // periods
    rows = checked_lines(lines, size)
    spectra_u, spectra_z = (
        np.fft.rfft(x.reshape(periods, size)[1:], axis=1)[:, rows] for x in (u, z)
    )
    mean_u = spectra_u.mean(axis=0)
    idle = np.abs(mean_u) <= 1e-9 * np.max(np.abs(mean_u))
    if np.any(idle):
        raise InputError(f"the input has nothing on the lines {rows[idle].tolist()}: leave them")
    response = spectra_z.mean(axis=0) / mean_u
    rest = spectra_z - response * spectra_u
    spread = np.sqrt(np.sum(np.abs(rest) ** 2, axis=0) / (periods - 2) / (periods - 1))
    return MeasuredResponse(rows * rate_hz / size, response, spread / np.abs(mean_u))


def fit_modes(
    frequency_hz: ArrayLike,
    response: ArrayLike,
    rate_hz: float,
    modes: int = 2,
    delay_samples: int = 0,
) -> ModalFit:
    """Fit a linear model with lightly damped modes to a measured frequency response.

    H = d^-delay B/A, A = Π (1 - 2 e^{-ζωT} cos(ω√(1-ζ²) T) d^-1 + e^{-2ζωT} d^-2), with B of the
    degree of A: the sum of the modes and a direct part. Minimises Σ |H_model/H - 1|², which for
    small errors is that of log magnitude and phase. B enters linearly and is solved for within the
    search over the modes' (ω, ζ) alone (variable projection: Golub and Pereyra, SIAM J. Numer.
    Anal. 10, 413, 1973). The search starts at the highest peaks of |response|.

    Arguments:
        frequency_hz: (lines,) Hz, ascending, above 0 and below half the rate.
        response: (lines,) complex, output unit per input unit.
        rate_hz: sampling rate 1/T, Hz.
        modes: number of modes.
        delay_samples: whole samples of delay to take as given, at least 0.

    Returns:
        The model.

    Raises:
        InputError: the lines are too few or not ascending, or there are fewer peaks than modes.

    Example:
        >>> f = np.linspace(20.0, 480.0, 93)
        >>> h = scipy.signal.freqz([1.0], [1.0, -1.2, 0.98], worN=f, fs=1000.0)[1]
        >>> fit_modes(f, h, rate_hz=1000.0, modes=1).frequency_hz.round(2).tolist()
        [146.38]
    """
    f, h = np.asarray(frequency_hz, float), np.asarray(response, complex)
    _check_lines(f, h, rate_hz, modes, delay_samples)
    back = _backward(f, rate_hz)
    target = h / back**delay_samples

    def numerator(denominator: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Best numerator for a denominator, and the relative errors, real and imaginary."""
        below = np.polynomial.polynomial.polyval(back, denominator) * target
        columns = np.vander(back, 2 * modes + 1, increasing=True) / below[:, None]
        stacked = np.concatenate([columns.real, columns.imag])
        ones = np.concatenate([np.ones(f.size), np.zeros(f.size)])
        best = np.linalg.lstsq(stacked, ones)[0]
        return best, stacked @ best - ones

    def errors(place: np.ndarray) -> np.ndarray:
        frequency, damping = np.exp(place.reshape(2, modes))
        return numerator(_denominator(frequency, damping, rate_hz))[1]

    start = np.concatenate([np.log(_peaks(f, h, modes)), np.full(modes, np.log(START_DAMPING))])
    lowest = np.repeat(np.log([f[0], DAMPING[0]]), modes)
    highest = np.repeat(np.log([f[-1], DAMPING[1]]), modes)
    found = scipy.optimize.least_squares(errors, start, bounds=(lowest, highest), x_scale=0.01)
    frequency, damping = np.exp(found.x.reshape(2, modes))
    order = np.argsort(frequency)
    frequency, damping = frequency[order], damping[order]
    a = _denominator(frequency, damping, rate_hz)
    b, left = numerator(a)
    return ModalFit(
        gain=float(b.sum() / a.sum()),
        frequency_hz=frequency,
        damping=damping,
        numerator=b,
        denominator=a,
        delay_samples=delay_samples,
        rate_hz=rate_hz,
        error=math.sqrt(np.sum(left**2) / f.size),
    )


def _backward(frequency_hz: ArrayLike, rate_hz: float) -> np.ndarray:
    """The backward shift d^-1 = e^{-jωT} at each frequency."""
    return np.exp(-2j * np.pi * np.asarray(frequency_hz, float) / rate_hz)


def _denominator(frequency_hz: np.ndarray, damping: np.ndarray, rate_hz: float) -> np.ndarray:
    pole = np.exp(
        2.0 * np.pi * frequency_hz / rate_hz * (-damping + 1j * np.sqrt(1.0 - damping**2))
    )
    return np.real(np.poly(np.concatenate([pole, pole.conj()])))


def _peaks(f: np.ndarray, h: np.ndarray, modes: int) -> np.ndarray:
    """Frequencies of the peaks that stand out most, ascending."""
    size = np.log(np.abs(h))
    places, about = scipy.signal.find_peaks(size, prominence=0.0)
    if places.size < modes:
        raise InputError(
            f"the response has {places.size} peaks and modes is {modes}: give lines that cover "
            "every resonance, or fewer modes"
        )
    return np.sort(f[places[np.argsort(about["prominences"])[-modes:]]])


def _check_lines(
    f: np.ndarray, h: np.ndarray, rate_hz: float, modes: int, delay_samples: int
) -> None:
    if f.ndim != 1 or f.shape != h.shape:
        raise InputError(f"frequency_hz has the shape {f.shape} and response {h.shape}: give one")
    if modes < 1 or delay_samples < 0:
        raise InputError(
            f"modes is {modes} and delay_samples {delay_samples}: give at least 1 and at least 0"
        )
    # Two real numbers a line, against the numerator's and two a mode.
    if 2 * f.size <= 4 * modes + 1:
        raise InputError(
            f"there are {f.size} lines for {modes} modes: give at least {2 * modes + 1}"
        )
    if not (f[0] > 0.0 and np.all(np.diff(f) > 0.0) and f[-1] < rate_hz / 2):
        raise InputError(
            f"frequency_hz runs from {f[0]:g} to {f[-1]:g}: it must rise from above 0 to below "
            f"{rate_hz / 2:g}, half the rate"
        )
    if not np.all(np.isfinite(h) & (h != 0.0)):
        raise InputError("response has lines that are zero or not finite: leave them out")

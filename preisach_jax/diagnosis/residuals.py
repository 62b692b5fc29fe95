"""What residuals look like against everything they may depend on: numbers, no figures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from preisach_jax.errors import InputError
from preisach_jax.record.core import Record
from preisach_jax.record.course import input_rate, last_reversal, reversals, time_since_reversal

__all__ = [
    "Bins",
    "Correlation",
    "CumulatedPeriodogram",
    "autocorrelation",
    "binned",
    "cross_correlation",
    "cumulated_periodogram",
    "in_sequence",
    "input_rate",
    "last_reversal",
    "longest_lag",
    "reversals",
    "sampling_note",
    "time_since_reversal",
]

LEVEL = 0.99
"""Share of the lags of a white residual that lie inside the bands."""

UNEVEN = 0.05
"""Jitter, as a share of the step, from which on it is said that lags are in samples."""


@dataclass(frozen=True, eq=False)
class Correlation:
    """A correlation of residuals over lags, with the band of a residual that has none.

    Attributes:
        lag: (lag,) in samples.
        lag_s: (lag,) in s, of the median time step.
        value: (lag,) between -1 and 1.
        band: (lag,) half width of the 99 % band about zero.
    """

    lag: np.ndarray
    lag_s: np.ndarray
    value: np.ndarray
    band: np.ndarray

    @property
    def outside(self) -> float:
        """Share of the lags, zero apart, outside the band; 0.01 is what chance gives."""
        other = self.lag != 0
        return float(np.mean(np.abs(self.value[other]) > self.band[other]))


@dataclass(frozen=True, eq=False)
class CumulatedPeriodogram:
    """Share of the residual's power up to each frequency.

    Attributes:
        frequency_hz: (frequency,) positive Fourier frequencies.
        value: (frequency,) share of the power up to there, rising to 1.
        white: (frequency,) what white noise gives.
        band: half width of the 99 % band about `white` (Kolmogorov-Smirnov).
    """

    frequency_hz: np.ndarray
    value: np.ndarray
    white: np.ndarray
    band: float

    @property
    def deviation(self) -> float:
        """Largest distance from white noise."""
        return float(np.max(np.abs(self.value - self.white)))


@dataclass(frozen=True, eq=False)
class Bins:
    """Quantiles of scattered values over bins.

    Attributes:
        centre: (bin,) median position.
        low, median, high: (bin,) 5 %, 50 % and 95 % quantiles.
    """

    centre: np.ndarray
    low: np.ndarray
    median: np.ndarray
    high: np.ndarray


def sampling_note(record: Record) -> str:
    """A sentence on how uneven sampling was treated; empty if the sampling is even.

    Example:
        >>> sampling_note(Record.from_arrays([0.0, 1.0, 2.0, 9.0], [0, 1, 0, 1], [0, 1, 0, 1]))
        'Rows are taken in order; 1 pause left blank.'
    """
    parts: list[str] = []
    if record.jitter > UNEVEN:
        parts.append(f"the time step varies by {100 * record.jitter:.0f} %, so lags count samples")
    if record.runs:
        parts.append(f"{len(record.runs)} records one behind the other, with blanks between")
    pauses = len(record.gaps)
    if pauses:
        parts.append(f"{pauses} pause{'s' if pauses > 1 else ''} left blank")
    missing = int(np.sum(~record.measured))
    if missing:
        rows = "1 row" if missing == 1 else f"{missing} rows"
        parts.append(f"{rows} without a measured output left blank")
    return f"Rows are taken in order; {', '.join(parts)}." if parts else ""


def in_sequence(record: Record, values: np.ndarray, longest: int) -> np.ndarray:
    """Values in the order of the rows, with blanks where the record pauses, or another one starts.

    Arguments:
        record: the record.
        values: (time,) values, NaN where there is none.
        longest: most blanks for a pause; more than the largest lag make no difference.

    Returns:
        (sample,) values, NaN in the pauses.

    Example:
        >>> record = Record.from_arrays([0.0, 1.0, 2.0, 9.0], [0, 1, 0, 1], [0, 1, 0, 1])
        >>> in_sequence(record, np.array([1.0, 2.0, 3.0, 4.0]), longest=2)
        array([ 1.,  2.,  3., nan, nan,  4.])
    """
    rows: list[int] = []
    blanks: list[float] = []
    pauses = [(row, round(seconds / record.step_s) - 1) for row, seconds in record.gaps]
    pauses += [(row, longest) for row in record.starts]
    for row, blank in sorted(pauses):
        count = min(blank, longest)
        rows += [row] * count
        blanks += [np.nan] * count
    return np.insert(np.asarray(values, dtype=float), rows, blanks)


def autocorrelation(values: np.ndarray, longest: int, step_s: float = 1.0) -> Correlation:
    r"""Autocorrelation, over the pairs of samples that are both there.

    \[ r(l) = \frac{1}{N_l}\sum_t e(t)\,e(t+l) \Big/ \frac{1}{N_0}\sum_t e(t)^2 \]

    with the mean taken off first; of white noise, r(l) has the variance \(1/N_l\)
    (G. E. P. Box, G. M. Jenkins, Time Series Analysis, Holden-Day 1976, ch. 2).

    Arguments:
        values: (sample,) residuals in sequence, NaN where there is none.
        longest: largest lag, in samples.
        step_s: time step, in s.

    Returns:
        Lags 0 to `longest`.

    Example:
        >>> autocorrelation(np.array([1.0, -1.0, 1.0, -1.0]), longest=2).value
        array([ 1., -1.,  1.])
    """
    clean, there = _centred(values)
    lag = np.arange(min(longest, len(values) - 1) + 1)
    pairs = np.maximum(_lagged(there, there, lag), 1.0)
    covariance = _lagged(clean, clean, lag) / pairs
    power = covariance[0] if covariance[0] > 0 else 1.0
    return Correlation(lag, lag * step_s, covariance / power, _normal_quantile() / np.sqrt(pairs))


def cross_correlation(
    values: np.ndarray, other: np.ndarray, longest: int, step_s: float = 1.0
) -> Correlation:
    r"""Correlation of residuals with what drove the record, before and after.

    \[ r(l) = \frac{1}{N_l}\sum_t e(t+l)\,u(t) \Big/ \sigma_e \sigma_u \]

    At a positive lag the residual follows the input.  If the two are independent, r has the
    variance \(\frac1N \sum_l r_{ee}(l)\,r_{uu}(l)\), which is above 1/N where both are slow
    (M. S. Bartlett, Stochastic Processes, Cambridge 1955, ch. 9); the sum is taken over the lags
    shown with a triangular window, and not below 1.

    Arguments:
        values: (sample,) residuals in sequence, NaN where there is none.
        other: (sample,) input in the same sequence.
        longest: largest lag, in samples.
        step_s: time step, in s.

    Returns:
        Lags `-longest` to `longest`.

    Example:
        >>> u = np.random.default_rng(1).normal(size=400)
        >>> r = cross_correlation(np.roll(u, 3), u, longest=10)
        >>> int(r.lag[np.argmax(r.value)])
        3
    """
    clean, there = _centred(values)
    drive, given = _centred(other)
    reach = min(longest, len(values) - 1)
    lag = np.arange(-reach, reach + 1)
    pairs = np.maximum(_lagged(given, there, lag), 1.0)
    power = np.sum(clean**2) * np.sum(drive**2) / max(there.sum() * given.sum(), 1.0)
    scale = np.sqrt(power) if power > 0 else 1.0
    value = _lagged(drive, clean, lag) / pairs / scale
    own = autocorrelation(values, reach).value * autocorrelation(other, reach).value
    window = 1 - np.arange(reach + 1) / (reach + 1)
    inflation = max(1.0, float(1 + 2 * np.sum((window * own)[1:])))
    return Correlation(lag, lag * step_s, value, _normal_quantile() * np.sqrt(inflation / pairs))


def cumulated_periodogram(values: np.ndarray, step_s: float = 1.0) -> CumulatedPeriodogram:
    r"""Share of the power up to each Fourier frequency, with its 99 % band for white noise.

    \(C(f_j) = \sum_{i \le j} |E(f_i)|^2 / \sum_i |E(f_i)|^2\) without the frequency zero.  Of white
    noise it leaves the line j/m by more than \(1.63/\sqrt{m}\) in one case of a hundred
    (Box and Jenkins 1976, ch. 8).  Blank samples count as the mean.

    Arguments:
        values: (sample,) residuals in sequence, NaN where there is none.
        step_s: time step, in s.

    Returns:
        The frequencies up to half the sampling rate, that one not included.

    Raises:
        ValueError: if there are fewer than five samples.

    Example:
        >>> wave = np.sin(2 * np.pi * np.arange(100) / 10)
        >>> spectrum = cumulated_periodogram(wave, step_s=0.01)
        >>> float(spectrum.frequency_hz[np.argmax(spectrum.value > 0.5)])
        10.0
    """
    if len(values) < 5:
        raise InputError(f"there are {len(values)} samples; give at least 5 for a periodogram")
    clean, there = _centred(values)
    count = (len(values) - 1) // 2
    power = np.abs(np.asarray(scipy.fft.rfft(clean)))[1 : count + 1] ** 2
    total = power.sum() if power.sum() > 0 else 1.0
    order = np.arange(1, count + 1)
    independent = max(count * there.mean(), 1.0)
    # The limit distribution for many samples; it is a little too wide for few.
    band = float(scipy.special.kolmogi(1 - LEVEL) / np.sqrt(independent))
    return CumulatedPeriodogram(
        order / (len(values) * step_s), np.cumsum(power) / total, order / count, band
    )


def binned(position: np.ndarray, values: np.ndarray, bins: int = 24, fewest: int = 8) -> Bins:
    """Median and 5 to 95 % band of scattered values over bins of position.

    Bins are even in the mean of position and rank, each from 0 to 1: no bin holds more than about
    twice its share of the points, nor spans more than twice its share of the range.

    Arguments:
        position: (point,) what to bin by.
        values: (point,) values; points that are not finite are left out.
        bins: number of bins at most; equal positions are never split.
        fewest: bins with fewer points are left out.

    Returns:
        The bins, in ascending order.

    Example:
        >>> binned(np.arange(100.0), np.repeat([1.0, 5.0], 50), bins=2).median
        array([1., 5.])
    """
    use = np.isfinite(position) & np.isfinite(values)
    position, values = position[use], values[use]
    if not len(position):
        return Bins(*[np.empty(0)] * 4)
    rank = np.searchsorted(np.sort(position), position) / len(position)
    span = max(float(np.ptp(position)), np.finfo(float).tiny)
    blend = (rank + (position - position.min()) / span) / 2
    place = np.minimum((bins * blend / max(blend.max(), 0.5)).astype(int), bins - 1)
    rows: list[list[float]] = []
    for k in range(bins):
        inside = place == k
        if inside.sum() >= fewest:
            rows.append(
                [np.median(position[inside]), *np.quantile(values[inside], [0.05, 0.5, 0.95])]
            )
    return Bins(*np.array(rows).reshape(-1, 4).T)


def longest_lag(record: Record) -> int:
    """Largest lag, in samples, at which correlations of a record's residuals are worth a look.

    Four times the lag at which the input's own autocorrelation falls to zero; a twentieth of the
    record, and 2,000, at most.

    Example:
        >>> t = np.arange(8000.0)
        >>> longest_lag(Record.from_arrays(t, np.sin(2 * np.pi * t / 200), t))
        204
    """
    most = int(np.clip(len(record.time) // 20, 10, 2000))
    own = autocorrelation(in_sequence(record, record.input, most), most).value
    fallen = np.flatnonzero(own <= 0)
    return int(np.clip(4 * fallen[0], 25, most)) if len(fallen) and most > 25 else most


def _centred(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values less their mean with zeros for blanks, and ones where there are values."""
    there = np.isfinite(values)
    mean = values[there].mean() if there.any() else 0.0
    return np.where(there, values - mean, 0.0), there.astype(float)


def _lagged(first: np.ndarray, second: np.ndarray, lag: np.ndarray) -> np.ndarray:
    """Sums over t of first(t) second(t + lag)."""
    size = scipy.fft.next_fast_len(2 * len(first))
    spectra = [np.asarray(scipy.fft.rfft(values, size)) for values in (first, second)]
    return np.asarray(scipy.fft.irfft(np.conj(spectra[0]) * spectra[1], size))[lag]


def _normal_quantile() -> float:
    return float(scipy.special.ndtri(0.5 + LEVEL / 2))

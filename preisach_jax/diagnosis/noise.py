"""The noise of a record: what no model can predict of a residual."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import scipy

from preisach_jax.identify.problem import Point, Problem
from preisach_jax.look.stretches import repeating_period
from preisach_jax.record.course import lattice_step

REST = 1e-6
"""Movement of the input from one sample to the next, in parts of its range, that is none."""

SAMPLES = 100
"""Samples of a stretch, of a rest or a period, over which noise is measured."""

SETTLING = 50
"""Samples after a move that are left out: what rings or lags there is no noise."""

LEAST_STRETCHES = 10
"""Stretches below which nothing is read from them."""

MOST_COLOURED = 5.0
"""Times the noise that second differences show that noise may be: that of an autoregression of 0.9
is four times as much, what sticks and slips some fifty times."""

SAME_INPUT = 0.01
"""Difference of two inputs, in parts of the range, up to which they are the same."""

SAME_COURSE = 0.99
"""Share of the samples of a period that must be the same for the memory to be so, too."""

CLEARLY_PREDICTED = 0.75
"""RMS error of an autoregression of a residual, over the noise that its second differences show,
below which these show what rings."""

AR_ORDER = 20
"""Order of that autoregression."""


def noise_rms(problem: Problem, point: Point) -> float:
    r"""RMS of the noise, from what is unpredictable from one sample to the next.

    Second differences of the residual of the best model, \(e_{k-1} - 2 e_k + e_{k+1}\), have
    variance \(6\sigma^2\) for white noise, and hardly any share of what a model may lack; their
    median absolute value does not mind the samples at which a fast move betrays the model.  Noise
    of a longer memory shows where the input rests, as what each rest leaves around a straight line
    of its own.  The step of the converter sets the least value.  What rings near the sampling rate
    has great second differences as well: where an autoregression predicts clearly more of them, it
    is its error that counts.

    Where the drive repeats itself, all of this is left to what differs from period to period
    (`_rms_of_repeats`): what is the same in each of them is no noise, however fast it is.  Second
    differences only bound it then (`MOST_COLOURED`).

    Returns:
        The RMS in output units.
    """
    residual = point.residual[problem.in_time] * problem.unit
    white = unpredictable_rms(residual, problem.breaks)
    repeated = _rms_of_repeats(problem, residual)
    if repeated is not None:
        return max(min(repeated, MOST_COLOURED * white), output_quantisation_rms(problem))
    predicted_to = float(np.sqrt(innovation_variance(residual, breaks=problem.breaks)))
    if predicted_to < CLEARLY_PREDICTED * white:
        white = predicted_to
    return max(white, output_quantisation_rms(problem), _rms_at_rest(problem, residual))


def unpredictable_rms(residual: np.ndarray, breaks: tuple[int, ...] = ()) -> float:
    """RMS of white noise in a residual in time order, from its second differences.

    Arguments:
        residual: (row,) in output units.
    """
    differences = np.concatenate([np.diff(e, n=2) for e in np.split(residual, breaks)])
    middle = np.median(np.abs(differences - np.median(differences)))
    return float(middle / scipy.special.ndtri(0.75)) / float(np.sqrt(6))


def output_quantisation_rms(problem: Problem) -> float:
    r"""RMS of what the steps q of the output's converter take away, \(q/\sqrt{12}\).

    B. Widrow, I. Kollár, Quantization Noise, Cambridge University Press 2008, ch. 4.

    Returns:
        The RMS in output units; zero where the readings lie on no lattice.
    """
    return lattice_step(problem.target) / float(np.sqrt(12))


def _rms_at_rest(problem: Problem, residual: np.ndarray) -> float:
    """Median RMS of a residual around straight lines over rests of the input; 0 without rests.

    Arguments:
        residual: (row,) residual in time order.
    """
    rows = problem.rows[problem.in_time]
    time, values = problem.record.time[rows], problem.record.input[rows]
    moved = np.abs(np.diff(values, prepend=values[0])) > REST * np.ptp(values)
    moved[list(problem.breaks)] = True
    stretch = np.cumsum(moved)
    starts, counts = np.unique(stretch, return_index=True, return_counts=True)[1:]
    parts = [
        part
        for start, count in zip(starts, counts, strict=True)
        for part in range(start + SETTLING, start + count - SAMPLES + 1, SAMPLES)
    ]
    return _rms_around_lines(time, residual, parts) or 0.0


def _rms_around_lines(time: np.ndarray, values: np.ndarray, begins: Sequence[int]) -> float | None:
    """Median RMS of values around a straight line over each of some stretches.

    Arguments:
        time: (row,) in s.
        values: (row,) values, finite in all stretches.
    """
    if len(begins) < LEAST_STRETCHES:
        return None
    rows = np.asarray(begins)[:, None] + np.arange(SAMPLES)
    x, y = (each[rows] - each[rows].mean(axis=1, keepdims=True) for each in (time, values))
    slope = np.sum(x * y, axis=1) / np.maximum(np.sum(x * x, axis=1), np.finfo(float).tiny)
    left = y - slope[:, None] * x
    return float(np.sqrt(np.median(np.sum(left**2, axis=1)) / (SAMPLES - 2)))


def _rms_of_repeats(problem: Problem, residual: np.ndarray) -> float | None:
    r"""RMS of what differs from period to period of a drive that repeats itself.

    With the period P of the input, \(e_k - 2 e_{k+P} + e_{k+2P}\) has the variance \(6\sigma^2\),
    whatever the noise's colour; what is the same in each period has no share in it.  Of three
    periods only, \(e_{k+P} - e_k\) has \(2\sigma^2\).  Both are taken around straight lines over
    short stretches, so that a drift, and a jump here and there, are no noise.

    Arguments:
        residual: (row,) residual in time order, in output units.
    """
    record = problem.record
    error = np.full(len(record.time), np.nan)
    error[problem.rows[problem.in_time]] = residual
    runs = sorted({0, *record.starts, len(error)})
    powers = [
        (rms**2, stop - start)
        for start, stop in pairwise(runs)
        if (rms := _of_repeats(*(each[start:stop] for each in (record.time, record.input, error))))
        is not None
    ]
    if not powers:
        return None
    power, weight = np.array(powers).T
    return float(np.sqrt(np.average(power, weights=weight)))


def _of_repeats(time: np.ndarray, values: np.ndarray, error: np.ndarray) -> float | None:
    """The same of one run: its (row,) time, input, and residual, NaN where that is not known."""
    lag = repeating_period(values)
    if lag is None:
        return None
    same = np.abs(values[lag:] - values[:-lag]) <= SAME_INPUT * np.ptp(values)
    counts = np.concatenate([[0], np.cumsum(same)])
    # Inputs at k and k + lag that were the same over all the period before have one memory.
    before = counts[lag:-1] - counts[: -lag - 1] >= SAME_COURSE * lag
    alike = np.concatenate([np.zeros(lag, dtype=bool), same[lag:] & before])
    differences = [(error[lag:] - error[:-lag]) / np.sqrt(2)]
    known = [alike & np.isfinite(differences[0])]
    if len(values) > 3 * lag:
        twice = error[: -2 * lag] - 2 * error[lag:-lag] + error[2 * lag :]
        differences.insert(0, twice / np.sqrt(6))
        known.insert(0, alike[:-lag] & alike[lag:] & np.isfinite(twice))
    for each, there in zip(differences, known, strict=True):
        rms = _rms_around_lines(time, each, _full_stretches(there))
        if rms is not None:
            return rms
    return None


def _full_stretches(there: np.ndarray) -> list[int]:
    """Where stretches of `SAMPLES` begin that lie wholly within runs of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], there, [False]]).astype(int)))
    return [
        begin
        for start, stop in edges.reshape(-1, 2).tolist()
        for begin in range(start, stop - SAMPLES + 1, SAMPLES)
    ]


def innovation_variance(residual: np.ndarray, breaks: tuple[int, ...] = ()) -> float:
    """Variance of what an autoregression cannot predict of a residual.

    Arguments:
        residual: (row,) residual in time order.
    """
    parts = [part for part in np.split(residual, breaks) if len(part)]
    powers = [float(np.mean(innovations(part) ** 2)) * len(part) for part in parts]
    return max(sum(powers) / len(residual), np.finfo(float).tiny)


def innovations(values: np.ndarray) -> np.ndarray:
    """What an autoregression cannot predict of values in time order; all of them, if few.

    Least squares on lagged values (P. J. Brockwell, R. A. Davis, Time Series: Theory and Methods,
    2nd ed., Springer 1991, ch. 8).
    """
    order = min(AR_ORDER, len(values) // 10)
    if order < 1:
        return values
    goal = values[order:]
    lagged = np.stack([values[order - k : -k] for k in range(1, order + 1)], axis=1)
    return goal - lagged @ np.linalg.lstsq(lagged, goal, rcond=None)[0]

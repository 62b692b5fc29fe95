"""Fig. 4 to 7: frequency response, loops, and the recursive identification of one plane."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike

from preisach_jax.errors import InputError
from preisach_jax.filter import AdaptiveFilter
from preisach_jax.frequency import fit_modes, frequency_response, measure_frequency_response
from preisach_jax.identify import thinned_rows
from preisach_jax.paper.numbers import FigureData, Progress, report
from preisach_jax.piezo import (
    NOTCH_DENOMINATOR,
    NOTCH_NUMERATOR,
    RATE_HZ,
    encode,
    experiment,
    paper_stage,
)
from preisach_jax.plane import Plane
from preisach_jax.plant import ENCODER_STEP_UM, RANGE_V
from preisach_jax.signals import multisine, triangle
from preisach_jax.sweep import RESIDUAL_FROM
from preisach_jax.theory import largest_slope, quantisation_step

IDENTIFICATION_HZ = 2000.0
PERIOD = 5000  # samples of a multisine at 5 kHz, so that its lines are whole hertz
PERIODS = 3
MIDDLE_V, AMPLITUDE_V = RANGE_V / 2, 2.0
NOISE_UM = 0.006
LOOP_POINTS = 8000


@dataclass(frozen=True, eq=False)
class Bode(FigureData):
    """Fig. 4: frequency response of the stage, its linear model, and the notch filter.

    Magnitudes of the stage are in decibels of 1 µm/V, those of the notch filter of 1.

    Attributes:
        frequency_hz: (lines,) measured lines.
        measured_db: (lines,) magnitude, the mean over realisations of the excitation.
        measured_deg: (lines,) phase, unwrapped.
        deviation_db: (lines,) standard deviation of the magnitude between realisations.
        grid_hz: (grid,) frequencies of the lines that are drawn.
        model_db: (grid,) magnitude of the linear model.
        model_deg: (grid,) phase of the linear model.
        notch_db: (grid,) magnitude of F(d), eq. (26).
        notch_deg: (grid,) phase of F(d).
        mode_hz: (2,) natural frequencies of the model.
        mode_error_hz: (2,) their standard errors over realisations.
        damping: (2,) damping ratios.
        damping_error: (2,) their standard errors.
        gain_um_per_v: gain of the model at rest.
        realisations: how many excitations were measured.
        amplitude_v: largest distance of the excitation from the middle of the range.
        noise_um: standard deviation of the sensor's noise.
    """

    frequency_hz: np.ndarray
    measured_db: np.ndarray
    measured_deg: np.ndarray
    deviation_db: np.ndarray
    grid_hz: np.ndarray
    model_db: np.ndarray
    model_deg: np.ndarray
    notch_db: np.ndarray
    notch_deg: np.ndarray
    mode_hz: np.ndarray
    mode_error_hz: np.ndarray
    damping: np.ndarray
    damping_error: np.ndarray
    gain_um_per_v: float
    realisations: int
    amplitude_v: float
    noise_um: float

    @property
    def caption(self) -> str:
        modes = " and ".join(
            f"{f:.2f} ± {df:.2f} Hz (damping {d:.5f} ± {dd:.5f})"
            for f, df, d, dd in zip(
                self.mode_hz, self.mode_error_hz, self.damping, self.damping_error, strict=True
            )
        )
        return (
            f"Frequency response of the simulated stage, measured with {self.realisations} random "
            f"multisines of {self.amplitude_v:g} V about {MIDDLE_V:g} V and "
            f"{1e3 * self.noise_um:g} nm noise (bars: standard deviation between them), a linear "
            f"model fitted to it, with modes at {modes}, and the notch filter (26). Magnitudes of "
            "the stage refer to 1 µm/V, that of the filter to 1."
        )


def bode(
    realisations: int = 6,
    seed: int = 4,
    noise_um: float = NOISE_UM,
    progress: Progress | None = None,
) -> Bode:
    """Measure the frequency response of the simulated stage and fit a linear model, Fig. 4.

    Args:
        realisations: how many excitations with phases of their own, at least 2.
        seed: draws the phases and the noise.
        noise_um: standard deviation of the sensor's noise, µm.
        progress: called with a text and the part that is done.

    Returns:
        The responses.

    Raises:
        InputError: there are too few realisations.

    Example:
        >>> bode(realisations=2).mode_hz.round().astype(int).tolist()
        [338, 587]
    """
    if realisations < 2:
        raise InputError(f"realisations is {realisations}: give at least 2, to see their spread")
    lines = np.unique(np.round(np.geomspace(5, 2000, 150)).astype(int))
    stage = paper_stage()
    responses: list[np.ndarray] = []
    with jax.enable_x64(True):
        for number in range(realisations):
            report(progress, "frequency response", number / realisations)
            wave_key, noise_key = jax.random.split(jax.random.fold_in(jax.random.key(seed), number))
            wave = multisine(wave_key, PERIOD, lines.tolist(), MIDDLE_V, AMPLITUDE_V)
            u = jnp.tile(wave, PERIODS)
            z = stage.response(u) + noise_um * jax.random.normal(noise_key, u.shape, u.dtype)
            z = encode(z, ENCODER_STEP_UM)
            measured = measure_frequency_response(
                np.asarray(u), np.asarray(z), PERIODS, RATE_HZ, lines.tolist()
            )
            responses.append(measured.response)
    each = np.array(responses)
    mean, frequency = each.mean(axis=0), lines * (RATE_HZ / PERIOD)
    model = fit_modes(frequency, mean, RATE_HZ)
    fits = [fit_modes(frequency, response, RATE_HZ) for response in each]
    grid = np.unique(np.concatenate([np.geomspace(5, 2400, 500), *_near(model.frequency_hz)]))
    notch = frequency_response(NOTCH_NUMERATOR, NOTCH_DENOMINATOR, grid, RATE_HZ)
    frequencies = np.array([fit.frequency_hz for fit in fits])
    dampings = np.array([fit.damping for fit in fits])
    return Bode(
        frequency_hz=frequency,
        measured_db=_decibels(mean),
        measured_deg=_degrees(mean),
        deviation_db=np.std(_decibels(each), axis=0, ddof=1),
        grid_hz=grid,
        model_db=_decibels(model.response(grid)),
        model_deg=_degrees(model.response(grid)),
        notch_db=_decibels(notch),
        notch_deg=_degrees(notch),
        mode_hz=model.frequency_hz,
        mode_error_hz=np.std(frequencies, axis=0, ddof=1) / math.sqrt(realisations),
        damping=model.damping,
        damping_error=np.std(dampings, axis=0, ddof=1) / math.sqrt(realisations),
        gain_um_per_v=model.gain,
        realisations=realisations,
        amplitude_v=AMPLITUDE_V,
        noise_um=noise_um,
    )


def _near(frequencies: np.ndarray) -> list[np.ndarray]:
    """More points of the grid where a lightly damped mode is narrow."""
    return [f * np.linspace(0.92, 1.08, 81) for f in frequencies]


def _decibels(response: np.ndarray) -> np.ndarray:
    return 20.0 * np.log10(np.abs(response))


def _degrees(response: np.ndarray) -> np.ndarray:
    return np.rad2deg(np.unwrap(np.angle(response)))


class Identification(NamedTuple):
    """One record of the experiment, and the adaptive filter run over it.

    Attributes:
        time_s: (time,) s.
        input_v: (time,) x, V.
        stroke_um: (time,) measured z, µm.
        output_um: (time,) filter output ẑ, µm.
        error_um: (time,) e(k), µm.
        is_event: (time,) whether hysterons switched.
    """

    time_s: np.ndarray
    input_v: np.ndarray
    stroke_um: np.ndarray
    output_um: np.ndarray
    error_um: np.ndarray
    is_event: np.ndarray


@functools.lru_cache(maxsize=8)
def identification(seed: int, samples: int, levels: int) -> Identification:
    """Simulate the experiment at 2 kHz and run the adaptive filter over it, once for all figures.

    Args:
        seed: draws the coin of the command.
        samples: time steps.
        levels: N of the plane over 0 to 75 V.

    Returns:
        The record and the rows of the filter.

    Example:
        >>> identification(0, 500, 9).error_um.shape
        (500,)
    """
    with jax.enable_x64(True):
        record = experiment(jax.random.key(seed), samples, rate_hz=IDENTIFICATION_HZ)
        found = AdaptiveFilter(Plane(levels, 0.0, RANGE_V)).run(record.input_v, record.stroke_um)
        return Identification(
            time_s=np.asarray(record.time_s),
            input_v=np.asarray(record.input_v),
            stroke_um=np.asarray(record.stroke_um),
            output_um=np.asarray(found.output),
            error_um=np.asarray(found.error),
            is_event=np.asarray(found.switched) > 0,
        )


@dataclass(frozen=True, eq=False)
class Loops(FigureData):
    """Fig. 5: measured input-output loops.

    Attributes:
        input_v: (points,) drive x of the record, thinned to its turns and bends.
        stroke_um: (points,) measured stroke z there.
        major_input_v: (branch,) drive of the major loop, up and down.
        major_stroke_um: (branch,) stroke of the stage along it.
        seconds: length of the record.
        turns: how often the input turned.
        slope_um_per_v: I, eq. (27), of the record.
    """

    input_v: np.ndarray
    stroke_um: np.ndarray
    major_input_v: np.ndarray
    major_stroke_um: np.ndarray
    seconds: float
    turns: int
    slope_um_per_v: float

    @property
    def caption(self) -> str:
        return (
            f"Input-output loops of the simulated stage over {self.seconds:g} s of the Bernoulli "
            f"input, which turns {self.turns} times, within the major loop (dashed). The greatest "
            f"slope (27) is I = {self.slope_um_per_v:.2f} µm/V."
        )


def loops(
    seconds: float = 20.0, seed: int = 0, samples: int = 50_000, progress: Progress | None = None
) -> Loops:
    """Measured loops of the Bernoulli experiment, Fig. 5.

    Args:
        seconds: how much of the record is shown.
        seed: draws the coin.
        samples: time steps of the record at 2 kHz.
        progress: called with a text and the part that is done.

    Returns:
        The loops.

    Example:
        >>> found = loops(seconds=1.0, samples=2000)
        >>> found.turns, round(found.slope_um_per_v, 1)
        (8, 2.6)
    """
    report(progress, "input-output loops", 0.0)
    shown = min(samples, round(seconds * IDENTIFICATION_HZ))
    run = identification(seed, samples, LEVELS)
    x, z = run.input_v[:shown], run.stroke_um[:shown]
    kept = thinned_rows(x, LOOP_POINTS) if shown > LOOP_POINTS else np.arange(shown)
    with jax.enable_x64(True):
        drive = np.asarray(triangle(601, 600.0, 1.0, 0.0, RANGE_V))
        stroke = np.asarray(paper_stage().hysteresis(drive))
    heading = np.sign(np.diff(x))
    return Loops(
        input_v=x[kept],
        stroke_um=z[kept],
        major_input_v=drive,
        major_stroke_um=stroke,
        seconds=shown / IDENTIFICATION_HZ,
        turns=int(np.count_nonzero(np.diff(heading[heading != 0.0]))),
        slope_um_per_v=largest_slope(run.input_v, run.stroke_um),
    )


LEVELS = 37


class Hinge(NamedTuple):
    """Two straight lines that meet, the later one level.

    Attributes:
        knee: where they meet.
        slope: slope of the earlier line.
        level: height of the later one.
        deviation: RMS distance of the points from the lines.
    """

    knee: float
    slope: float
    level: float
    deviation: float

    def __call__(self, k: ArrayLike) -> np.ndarray:
        """Height of the lines at k."""
        return self.level + self.slope * np.minimum(np.asarray(k) - self.knee, 0.0)


def fit_hinge(k: ArrayLike, y: ArrayLike, candidates: int = 500) -> Hinge:
    """Fit a line and, after it, a level, which meet, by least squares.

    y = level + slope · min(k - knee, 0). Level and slope are solved for at each candidate knee.

    Args:
        k: (points,) abscissae, ascending.
        y: (points,) values.
        candidates: number of knees tried, evenly between the second point and the last but one.

    Returns:
        The lines.

    Raises:
        InputError: there are fewer than ten points.

    Example:
        >>> k = np.arange(100.0)
        >>> found = fit_hinge(k, 1.0 - 0.1 * np.minimum(k - 30.0, 0.0))
        >>> round(found.knee), round(found.slope, 2), round(found.level, 2)
        (30, -0.1, 1.0)
    """
    k, y = np.asarray(k, float), np.asarray(y, float)
    if k.size < 10:
        raise InputError(f"{k.size} points are given: two lines need at least 10")
    knees = np.linspace(float(k[1]), float(k[-2]), candidates)
    bent = np.minimum(k - knees[:, np.newaxis], 0.0)
    bent_mean, y_mean = bent.mean(axis=1), y.mean()
    spread = np.sum(bent * bent, axis=1) - k.size * bent_mean**2
    slopes = (bent @ y - k.size * bent_mean * y_mean) / spread
    best = int(np.argmax(slopes**2 * spread))
    level = y_mean - slopes[best] * bent_mean[best]
    rest: np.ndarray = y - level - slopes[best] * bent[best]
    return Hinge(
        knee=float(knees[best]),
        slope=float(slopes[best]),
        level=float(level),
        deviation=float(np.sqrt(np.mean(rest**2))),
    )


def knee_interval(
    k: ArrayLike, rows: ArrayLike, draws: int = 400, seed: int = 0
) -> tuple[float, float]:
    """95 % interval of the knee of log10 of the mean of rows, by drawing rows with replacement.

    Args:
        k: (points,) abscissae, ascending.
        rows: (rows, points) positive values, each row an independent realisation.
        draws: how often as many rows are drawn and fitted.
        seed: of the draws.

    Returns:
        `(low, high)`.

    Example:
        >>> k = np.arange(100.0)
        >>> rows = [10.0 ** -np.minimum(k - knee, 0.0) for knee in (28.0, 30.0, 32.0)]
        >>> low, high = knee_interval(k, rows)
        >>> bool(27.0 < low < 30.0 < high < 33.0)
        True
    """
    rows = np.asarray(rows, float)
    rng = np.random.default_rng(seed)
    picks = rng.integers(len(rows), size=(draws, len(rows)))
    knees = [fit_hinge(k, np.log10(rows[pick].mean(axis=0))).knee for pick in picks]
    low, high = np.quantile(knees, [0.025, 0.975])
    return float(low), float(high)


@dataclass(frozen=True, eq=False)
class Convergence(FigureData):
    """Fig. 6: squared output error over the record, and its asymptotes.

    Attributes:
        sample: (events,) k of the switching samples of the first record.
        error_squared_um2: (events,) e²(k) there.
        block_sample: (blocks,) k at the middle of each block of `block` samples.
        block_power_um2: (blocks,) mean of e² over the switching samples of a block in all records.
        block: samples of a block.
        hinge: the asymptotes of log10 of the blocks' power over k.
        knee_low: lower end of the 95 % interval of the knee over records.
        knee_high: its upper end.
        increment_squared_um2: (I δx)², the square of a level's increment, (28).
        mean_squared_um2: mean of e² over the switching samples of the residual interval.
        first: m of (30), the first sample of the residual interval.
        samples: samples of a record.
        records: number of records.
        levels: N.
    """

    sample: np.ndarray
    error_squared_um2: np.ndarray
    block_sample: np.ndarray
    block_power_um2: np.ndarray
    block: int
    hinge: Hinge
    knee_low: float
    knee_high: float
    increment_squared_um2: float
    mean_squared_um2: float
    first: int
    samples: int
    records: int
    levels: int

    @property
    def caption(self) -> str:
        hinge = self.hinge
        return (
            f"Squared output error of the recursive identification, N = {self.levels}; k counts "
            f"samples at {IDENTIFICATION_HZ / 1e3:g} kHz, and the {self.sample.size} dots are "
            "those of one record at which hysterons switch. Thin: mean of e² over blocks of "
            f"{self.block} samples and {self.records} records. Asymptotes: least squares fit to "
            "its logarithm of a line and a level that meet; the knee is at k = "
            f"{hinge.knee:.0f} (95 % interval over records {self.knee_low:.0f} to "
            f"{self.knee_high:.0f}), the level {10**hinge.level:.2g} µm². Over k ≥ {self.first} "
            f"the mean of e² is {self.mean_squared_um2:.2g} µm². The errors start near the square "
            f"of a level's increment, (I δx)² = {self.increment_squared_um2:.1f} µm² (dotted)."
        )


def convergence(
    levels: int = LEVELS,
    seed: int = 0,
    samples: int = 50_000,
    records: int = 8,
    progress: Progress | None = None,
) -> Convergence:
    """Squared output error of the recursive identification, Fig. 6.

    Args:
        levels: N.
        seed: draws the coin of the first record; the others have the seeds after it.
        samples: time steps of a record at 2 kHz; the residual interval is the last 80 %.
        records: number of records of which the asymptotes are fitted.
        progress: called with a text and the part that is done.

    Returns:
        The errors and their asymptotes.

    Example:
        >>> found = convergence(levels=9, samples=4000, records=2)
        >>> bool(found.hinge.slope < 0), found.first
        (True, 800)
    """
    runs: list[Identification] = []
    for number in range(records):
        report(progress, "recursive identification", number / records)
        runs.append(identification(seed + number, samples, levels))
    block, first = samples // 100, round(RESIDUAL_FROM * samples)
    middle = (np.arange(100) + 0.5) * block
    power = np.array([_block_power(run, block) for run in runs])
    # A block in which some record has no event is left out.
    whole = np.isfinite(power).all(axis=0)
    middle, power = middle[whole], power[:, whole]
    low, high = knee_interval(middle, power)
    one = runs[0]
    events = np.flatnonzero(one.is_event)
    late = [run.error_um[first:][run.is_event[first:]] ** 2 for run in runs]
    step = quantisation_step(largest_slope(one.input_v, one.stroke_um), RANGE_V / levels)
    return Convergence(
        sample=events,
        error_squared_um2=one.error_um[events] ** 2,
        block_sample=middle,
        block_power_um2=power.mean(axis=0),
        block=block,
        hinge=fit_hinge(middle, np.log10(power.mean(axis=0))),
        knee_low=low,
        knee_high=high,
        increment_squared_um2=float(step) ** 2,
        mean_squared_um2=float(np.mean(np.concatenate(late))),
        first=first,
        samples=samples,
        records=records,
        levels=levels,
    )


def _block_power(run: Identification, block: int) -> np.ndarray:
    """(100,) mean of e² at events in each block of samples; NaN without events."""
    events = np.flatnonzero(run.is_event)
    events = events[events < 100 * block]
    total = np.bincount(events // block, run.error_um[events] ** 2, 100)
    count = np.bincount(events // block, minlength=100)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


@dataclass(frozen=True, eq=False)
class TimeFrame(FigureData):
    """Fig. 7: measurement and model over a short time.

    Attributes:
        time_s: (time,) time.
        measured_um: (time,) measured stroke z.
        model_um: (time,) filter output ẑ, moved by `shift_um`.
        shift_um: mean of z - ẑ over the frame.
        difference_um: RMS of z - ẑ over the frame, without its mean.
        step_um: Z_q, eq. (28), the bound of the model's steps at a level.
        levels: N.
    """

    time_s: np.ndarray
    measured_um: np.ndarray
    model_um: np.ndarray
    shift_um: float
    difference_um: float
    step_um: float
    levels: int

    @property
    def caption(self) -> str:
        return (
            f"Measurement and adaptive filter, N = {self.levels}. The measured stroke is smooth, "
            f"the filter's output moves only where the input passes one of its levels, in steps of "
            f"up to Z_q = {self.step_um:.2f} µm (28). As only differences are identified, the "
            f"output is moved by the mean of z - ẑ over this frame, {self.shift_um:.2f} µm; what "
            f"is left is {self.difference_um:.2f} µm RMS."
        )


def time_frame(
    levels: int = LEVELS,
    seed: int = 0,
    samples: int = 50_000,
    seconds: float = 0.25,
    progress: Progress | None = None,
) -> TimeFrame:
    """A stretch of measurement and filter output, Fig. 7.

    Args:
        levels: N.
        seed: draws the coin.
        samples: time steps of the record at 2 kHz; the frame begins after 90 % of them.
        seconds: length of the frame.
        progress: called with a text and the part that is done.

    Returns:
        The frame.

    Example:
        >>> frame = time_frame(levels=9, samples=4000)
        >>> frame.time_s.shape, bool(abs((frame.measured_um - frame.model_um).mean()) < 1e-9)
        ((400,), True)
    """
    report(progress, "measurement and model", 0.0)
    run = identification(seed, samples, levels)
    begin = round(0.9 * samples)
    rows = slice(begin, begin + round(seconds * IDENTIFICATION_HZ))
    left = run.stroke_um[rows] - run.output_um[rows]
    shift = float(left.mean())
    slope = largest_slope(run.input_v, run.stroke_um)
    return TimeFrame(
        time_s=run.time_s[rows],
        measured_um=run.stroke_um[rows],
        model_um=run.output_um[rows] + shift,
        shift_um=shift,
        difference_um=float(left.std()),
        step_um=float(quantisation_step(slope, RANGE_V / levels)),
        levels=levels,
    )

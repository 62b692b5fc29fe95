"""The numbers of Fig. 1 to 7: hysteron, filter, experiment, and one plane identified over time."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike

from preisach_jax.errors import InputError
from preisach_jax.filter.adaptive import AdaptiveFilter
from preisach_jax.frequency import fit_modes, frequency_response, measure_frequency_response
from preisach_jax.identify.problem import thinned_rows
from preisach_jax.operator.plane import Plane
from preisach_jax.operator.states import hysteron_states
from preisach_jax.paper.sweep import RESIDUAL_FROM
from preisach_jax.piezo import (
    NOTCH_DENOMINATOR,
    NOTCH_NUMERATOR,
    RATE_HZ,
    encode,
    experiment,
    paper_stage,
    resonances,
)
from preisach_jax.plant import ENCODER_STEP_UM, RANGE_V
from preisach_jax.signals import multisine, triangle
from preisach_jax.theory import Progress, largest_slope, quantisation_step

DIGITS = 7
LEVELS = 37
IDENTIFICATION_HZ = 2000.0


@dataclass(frozen=True, eq=False)
class FigureData:
    """The numbers behind a figure: arrays as they are drawn, and what was fitted to them.

    Names end in the unit: `_v`, `_um`, `_um2` for µm², `_s`, `_hz`, `_db`, `_deg`; a part of
    something, a count and a name have none.
    """

    @property
    def caption(self) -> str:
        """What the figure shows, with the numbers that it shows it by."""
        raise NotImplementedError

    def to_json(self) -> dict[str, Any]:
        """The caption and all numbers, to seven digits, ready for JSON."""
        content = {field.name: getattr(self, field.name) for field in fields(self)}
        return {"caption": self.caption, **{name: _plain(v) for name, v in content.items()}}


def _plain(value: Any) -> Any:
    if hasattr(value, "_asdict"):
        value = value._asdict()
    if isinstance(value, Mapping):
        table = cast(Mapping[Any, Any], value)
        return {str(key): _plain(inner) for key, inner in table.items()}
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, list | tuple):
        return [_plain(inner) for inner in cast(Iterable[Any], value)]
    if isinstance(value, float | np.floating):
        return float(f"{value:.{DIGITS}g}")
    return value


def report(progress: Progress | None, text: str, part: float) -> None:
    """Call `progress`, if there is one, with what is being done and the part that is done."""
    if progress is not None:
        progress(text, part)


# --- Fig. 1: the hysteron ---


@dataclass(frozen=True, eq=False)
class HysteronLoops(FigureData):
    """Fig. 1: a relay and its ramp over one loop of the input; states ±1."""

    input: np.ndarray  # (points,) x of the rising branch; the falling one has it reversed
    relay_up: np.ndarray
    relay_down: np.ndarray  # in the order of `input`
    ramp_up: np.ndarray
    ramp_down: np.ndarray  # in the order of `input`
    alpha: float
    beta: float
    delta_x: float

    @property
    def caption(self) -> str:
        return (
            "Hysteron: the relay of (1)-(4) switches on at the threshold α and off at β, and keeps "
            "its state between; the ramp (dashed) replaces the jump by a line of the width δx of a "
            "cell. The sum (6) takes the states as 0 and 1."
        )


def hysteron_loops(points: int = 241, progress: Progress | None = None) -> HysteronLoops:
    """Follow one relay and one ramp through a loop of the input, Fig. 1."""
    report(progress, "hysteron", 0.0)
    plane = Plane(levels=6, low=0.0, high=6.0)
    cell = int(np.flatnonzero((plane.alpha == 4.5) & (plane.beta == 1.5))[0])
    rising = np.linspace(plane.low, plane.high, points)
    path = np.concatenate([rising, rising[::-1]])
    with jax.enable_x64(True):
        branches: list[np.ndarray] = []
        for hysteron in ("relay", "ramp"):
            state = 2.0 * np.asarray(hysteron_states(plane, path, "low", hysteron)[:, cell]) - 1.0
            branches += [state[:points], state[points:][::-1]]
    return HysteronLoops(rising, *branches, alpha=4.5, beta=1.5, delta_x=plane.delta_x)


# --- Fig. 2 and 3: block diagrams ---


class Block(NamedTuple):
    """A block of a diagram: its name, what it does in lines, its equations in the paper."""

    name: str
    text: str
    equation: str


class Arrow(NamedTuple):
    """An arrow from one block to another, and what it carries; an empty name is outside."""

    source: str
    target: str
    symbol: str


@dataclass(frozen=True, eq=False)
class Diagram(FigureData):
    """Fig. 2 and 3: blocks and the signals between them."""

    blocks: tuple[Block, ...]
    signals: tuple[Arrow, ...]
    text: str  # the caption

    @property
    def caption(self) -> str:
        return self.text


def filter_diagram(progress: Progress | None = None) -> Diagram:
    """The data flow of the adaptive hysteresis filter, Fig. 2."""
    report(progress, "adaptive filter", 0.0)
    blocks = (
        Block("plant", "unknown\nhysteresis", "(5)"),
        Block("noise", "+", "(13)"),
        Block("delay_z", "$d^{-1}$", ""),
        Block("difference_z", "−", ""),
        Block("hysterons", "hysterons\nin parallel", "(1)-(4)"),
        Block("sum", "weighted\nsum", "(6)"),
        Block("delay_model", "$d^{-1}$", ""),
        Block("difference_model", "−", ""),
        Block("error", "−", "(7)"),
        Block("switching", "switching\ncells", "(10), (11)"),
        Block("rate", "update\nrate", "(8)"),
        Block("update", "weights\nat k + 0.5", "(12)"),
    )
    signals = (
        Arrow("", "plant", "x(k)"),
        Arrow("", "hysterons", "x(k)"),
        Arrow("", "noise", "n(k)"),
        Arrow("plant", "noise", ""),
        Arrow("noise", "difference_z", "z(k)"),
        Arrow("noise", "delay_z", "z(k)"),
        Arrow("delay_z", "difference_z", "z(k-1)"),
        Arrow("hysterons", "sum", "y(k)"),
        Arrow("sum", "difference_model", "ẑ(k)"),
        Arrow("sum", "delay_model", "ẑ(k)"),
        Arrow("delay_model", "difference_model", "ẑ(k-1)"),
        Arrow("difference_z", "error", "Δz"),
        Arrow("difference_model", "error", "Δẑ"),
        Arrow("error", "rate", "e(k)"),
        Arrow("hysterons", "switching", "y(k)"),
        Arrow("switching", "rate", "A(k)"),
        Arrow("switching", "update", "s(k)"),
        Arrow("rate", "update", "r(k)"),
        Arrow("update", "sum", "R̂"),
    )
    text = (
        "Adaptive hysteresis filter. Plant and filter see the same input x(k); the error e(k) "
        "compares how far their outputs have moved since the last sample at which hysterons "
        "switched (d⁻¹ is the delay to it), both of the filter's outputs with the present weights. "
        "Only then, at k + 0.5, the cells that switched share the error. In brackets: equations."
    )
    return Diagram(blocks, signals, text)


def experiment_diagram(progress: Progress | None = None) -> Diagram:
    """The principal structure of the experiment, Fig. 3."""
    report(progress, "experiment", 0.0)
    low, high = resonances(NOTCH_NUMERATOR).frequency_hz
    step_nm = 1e3 * ENCODER_STEP_UM
    blocks = (
        Block("command", f"Bernoulli\ncommand\n{RATE_HZ / 1e3:g} kHz", ""),
        Block("notch", "notch filter\n$F(d)$", "(26)"),
        Block("amplifier", f"amplifier\n0 to {RANGE_V:g} V", ""),
        Block("hysteresis", "piezo ceramics:\nhysteresis", ""),
        Block("resonances", f"frame: resonances\n{low:.1f} Hz, {high:.1f} Hz", ""),
        Block("encoder", f"linear encoder\n{step_nm:.2f} nm", ""),
    )
    signals = (
        Arrow("command", "notch", "u(k)"),
        Arrow("notch", "amplifier", "x(k)"),
        Arrow("amplifier", "hysteresis", "v"),
        Arrow("hysteresis", "resonances", "h"),
        Arrow("resonances", "encoder", "stroke"),
        Arrow("encoder", "", "z(k)"),
    )
    text = (
        f"Principal structure of the experiment at {RATE_HZ / 1e3:g} kHz. The identification "
        "takes the drive x(k) behind the notch filter as its input, so that the filter's delay is "
        "no part of what it identifies."
    )
    return Diagram(blocks, signals, text)


# --- Fig. 4: frequency response ---

PERIOD = 5000  # samples of a multisine at 5 kHz, so that its lines are whole hertz
PERIODS = 3
MIDDLE_V, AMPLITUDE_V = RANGE_V / 2, 2.0
NOISE_UM = 0.006


@dataclass(frozen=True, eq=False)
class Bode(FigureData):
    """Fig. 4: frequency response of the stage, its linear model, and the notch filter.

    Magnitudes of the stage are in decibels of 1 µm/V, those of the notch filter of 1. Errors are
    standard errors over the realisations of the excitation.
    """

    frequency_hz: np.ndarray  # (lines,) of the measurement
    measured_db: np.ndarray  # mean over realisations
    measured_deg: np.ndarray
    deviation_db: np.ndarray  # standard deviation between realisations
    grid_hz: np.ndarray  # (grid,) of the model and the notch filter
    model_db: np.ndarray
    model_deg: np.ndarray
    notch_db: np.ndarray
    notch_deg: np.ndarray
    mode_hz: np.ndarray  # (2,) natural frequencies of the model
    mode_error_hz: np.ndarray
    damping: np.ndarray
    damping_error: np.ndarray
    gain_um_per_v: float  # of the model at rest
    realisations: int
    amplitude_v: float  # largest distance of the excitation from the middle of the range
    noise_um: float  # standard deviation of the sensor's noise

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
    """Measure the frequency response of the simulated stage and fit a linear model, Fig. 4."""
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
    # More points of the grid where a lightly damped mode is narrow.
    near = [f * np.linspace(0.92, 1.08, 81) for f in model.frequency_hz]
    grid = np.unique(np.concatenate([np.geomspace(5, 2400, 500), *near]))
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


def _decibels(response: np.ndarray) -> np.ndarray:
    return 20.0 * np.log10(np.abs(response))


def _degrees(response: np.ndarray) -> np.ndarray:
    return np.rad2deg(np.unwrap(np.angle(response)))


# --- the experiment of Fig. 5 to 7 ---


class Identification(NamedTuple):
    """One record of the experiment, and the adaptive filter run over it, (time,) each."""

    time_s: np.ndarray
    input_v: np.ndarray  # x
    stroke_um: np.ndarray  # measured z
    output_um: np.ndarray  # ẑ
    error_um: np.ndarray  # e(k)
    is_event: np.ndarray  # whether hysterons switched


@functools.lru_cache(maxsize=8)
def identification(seed: int, samples: int, levels: int) -> Identification:
    """Simulate the experiment at 2 kHz and run the filter over it, once for all figures."""
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


# --- Fig. 5: loops ---

LOOP_POINTS = 8000


@dataclass(frozen=True, eq=False)
class Loops(FigureData):
    """Fig. 5: measured input-output loops."""

    input_v: np.ndarray  # (points,) x of the record, thinned to its turns and bends
    stroke_um: np.ndarray
    major_input_v: np.ndarray  # (branch,) of the major loop, up and down
    major_stroke_um: np.ndarray
    seconds: float
    turns: int  # how often the input turned
    slope_um_per_v: float  # I, eq. (27), of the record

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
    """Measured loops of the Bernoulli experiment, Fig. 5."""
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


# --- Fig. 6: convergence ---


class Hinge(NamedTuple):
    """Two straight lines that meet at the `knee`, the later one level."""

    knee: float
    slope: float  # of the earlier line
    level: float  # of the later one
    deviation: float  # RMS distance of the points

    def __call__(self, k: ArrayLike) -> np.ndarray:
        """Height of the lines at k."""
        return self.level + self.slope * np.minimum(np.asarray(k) - self.knee, 0.0)


def fit_hinge(k: ArrayLike, y: ArrayLike, candidates: int = 500) -> Hinge:
    """Fit y = level + slope · min(k - knee, 0) by least squares, for k ascending.

    Level and slope are solved for at each candidate knee.
    """
    k, y = np.asarray(k, float), np.asarray(y, float)
    if k.size < 10:
        raise InputError(f"there are {k.size} points: give at least 10 for two lines")
    knees = np.linspace(float(k[1]), float(k[-2]), candidates)
    bent = np.minimum(k - knees[:, np.newaxis], 0.0)
    bent_mean, y_mean = bent.mean(axis=1), y.mean()
    spread = np.sum(bent * bent, axis=1) - k.size * bent_mean**2
    slopes = (bent @ y - k.size * bent_mean * y_mean) / spread
    best = int(np.argmax(slopes**2 * spread))
    level = y_mean - slopes[best] * bent_mean[best]
    rest: np.ndarray = y - level - slopes[best] * bent[best]
    deviation = float(np.sqrt(np.mean(rest**2)))
    return Hinge(float(knees[best]), float(slopes[best]), float(level), deviation)


def knee_interval(
    k: ArrayLike, rows: ArrayLike, draws: int = 400, seed: int = 0
) -> tuple[float, float]:
    """95 % interval of the knee of log10 of the mean of rows, by drawing rows with replacement.

    `rows` are (rows, points) positive values, each row an independent realisation.
    """
    rows = np.asarray(rows, float)
    rng = np.random.default_rng(seed)
    picks = rng.integers(len(rows), size=(draws, len(rows)))
    knees = [fit_hinge(k, np.log10(rows[pick].mean(axis=0))).knee for pick in picks]
    low, high = np.quantile(knees, [0.025, 0.975])
    return float(low), float(high)


@dataclass(frozen=True, eq=False)
class Convergence(FigureData):
    """Fig. 6: squared output error over the record, and its asymptotes."""

    sample: np.ndarray  # (events,) k of the switching samples of the first record
    error_squared_um2: np.ndarray  # e²(k) there
    block_sample: np.ndarray  # (blocks,) k at the middle of each block
    block_power_um2: np.ndarray  # mean of e² over the switching samples of a block in all records
    block: int  # samples of a block
    hinge: Hinge  # asymptotes of log10 of the blocks' power over k
    knee_low: float  # 95 % interval of the knee over records
    knee_high: float
    increment_squared_um2: float  # (I δx)², the square of a level's increment, (28)
    mean_squared_um2: float  # of e² over the switching samples of the residual interval
    first: int  # m of (30), the first sample of the residual interval
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
    """Squared output error of the recursive identification, Fig. 6."""
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


# --- Fig. 7: measurement and model ---


@dataclass(frozen=True, eq=False)
class TimeFrame(FigureData):
    """Fig. 7: measurement and model over a short time."""

    time_s: np.ndarray
    measured_um: np.ndarray  # z
    model_um: np.ndarray  # ẑ, moved by `shift_um`
    shift_um: float  # mean of z - ẑ over the frame
    difference_um: float  # RMS of z - ẑ over the frame, without its mean
    step_um: float  # Z_q, eq. (28), the bound of the model's steps at a level
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
    """A stretch of measurement and filter output, Fig. 7."""
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

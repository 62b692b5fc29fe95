"""Fig. 5 and 7: measured loops, and the recursive identification of one plane over time."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import NamedTuple

import jax
import numpy as np

from preisach_jax.filter.adaptive import AdaptiveFilter
from preisach_jax.identify import thinned_rows
from preisach_jax.operator.plane import Plane
from preisach_jax.paper.numbers import FigureData, Progress, report
from preisach_jax.piezo import experiment, paper_stage
from preisach_jax.plant import RANGE_V
from preisach_jax.signals import triangle
from preisach_jax.theory import largest_slope, quantisation_step

IDENTIFICATION_HZ = 2000.0
LOOP_POINTS = 8000


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


LEVELS = 37


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

"""The pictures of the documentation: `python docs/pictures.py [NAME ...]`; all take some minutes.

For each effect a stage with that effect hidden in it is measured, the rate-independent model is
fitted, and what it leaves is drawn over time and against the axis that tells the effect, beside
what remains once the effect is in the model. Everything is seeded.
"""

from __future__ import annotations

import io
import itertools
import re
import sys
from collections.abc import Callable
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from effect_pages import file_name
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image
from telling import COLUMNS, TELLING, Telling

import preisach_jax as pj
from preisach_jax import paper
from preisach_jax.diagnosis import residuals as stats
from preisach_jax.plot import AFTER, BEFORE, png
from preisach_jax.plot import paper as draw_paper
from preisach_jax.plot.plane import forc_diagram
from preisach_jax.plot.style import STYLE
from preisach_jax.quantity import pretty_unit, scaled

ASSETS = Path(__file__).resolve().parent / "assets"
OUT = ASSETS / "effects"
LEAST_MOVE = 0.002  # of the range of the input a second; slower is at rest
POINTS = 4000
MOST_BYTES = 120_000

Fits = tuple[tuple[str, pj.Fit], ...]


def stage_record(name: str, telling: Telling) -> pj.Record:
    """A record of the simulated stage with one effect hidden."""
    hidden = name.removesuffix(":COL")
    drive, noise = None, 0.006
    if name == "input_quantisation":
        drive, noise = slow_ramp_drive(telling), 0.002
    stage = pj.simulate_stage(
        telling.seed, telling.seconds, (hidden,), telling.rate_hz, drive=drive, noise_um=noise
    )
    units = {"input": "V", "output": "um"} | {key: key.rpartition("_")[2] for key in stage.aux}
    return pj.Record.from_arrays(
        stage.time, stage.input, stage.output, aux=dict(stage.aux), units=units
    )


def slow_ramp_drive(telling: Telling) -> np.ndarray:
    """The diagnostic record with a ramp of 0.5 V in 4 s at its end."""
    from preisach_jax.signals import diagnostic_record

    first = diagnostic_record(telling.seconds - 5.0, telling.rate_hz, 0.0, 75.0)
    up = np.linspace(0.0, 37.0, round(0.4 * telling.rate_hz))
    slow = np.linspace(37.0, 37.5, round(4.0 * telling.rate_hz))
    return np.concatenate([first, up, slow])


def operator_creep_record(telling: Telling) -> pj.Record:
    """The plain stage, to which creep operators of many thresholds are added in small steps."""
    stage = pj.simulate_stage(telling.seed, telling.seconds, (), telling.rate_hz)
    rng = np.random.default_rng(77)
    fine = 4
    time = np.arange((len(stage.time) - 1) * fine + 1) / (fine * telling.rate_hz)
    path = np.interp(time, stage.time, stage.input)
    reach = np.sort(rng.uniform(0.1, 0.45, 8))[:, None] * 75.0
    keep = -np.expm1(-1 / (fine * telling.rate_hz) / 10 ** np.linspace(-1.6, 0.9, 6))
    place, crept = np.full((8, 6), path[0]), np.empty_like(path)
    for n, value in enumerate(path):
        away = value - place
        place = place + keep * (away - np.clip(away, -reach, reach))
        crept[n] = place.sum()
    crept *= 0.05 * stage.truth["stroke_um"] / np.ptp(crept)
    return pj.Record.from_arrays(
        stage.time, stage.input, stage.output + crept[::fine], units={"input": "V", "output": "um"}
    )


def loops_drive(rate_hz: float) -> np.ndarray:
    """Spread turning points, and six times a great move with twelve equal minor loops behind it."""
    rng = np.random.default_rng(5)
    corners, levels = [0.0], [0.0]

    def go(level: float, speed: float = 3.0, hold: float = 0.0) -> None:
        for at in (abs(level - levels[-1]) / speed, hold):
            if at > 0:
                corners.append(corners[-1] + at)
                levels.append(level)

    for level in (1.0, 0.0, *np.ravel(np.sort(rng.uniform(0, 1, (10, 2)))[:, ::-1]), 0.0):
        go(float(level))
    for bias, speed in ((0.35, 1.5), (0.45, 3.0), (0.25, 3.0)):
        for great in (1.0, 0.0):
            go(great)
            go(bias, hold=0.3)
            for turn in range(12):
                go(bias + 0.3, speed)
                go(bias, speed, hold=0.3 if turn == 5 else 0.0)
            go(bias, hold=0.2)
    go(0.0)
    return np.interp(np.arange(0.0, corners[-1], 1 / rate_hz), corners, levels)


def reptation_record(telling: Telling, fade: float = 0.8) -> pj.Record:
    """Relays one by one whose states fade to the middle with the path, and a reversible part."""
    rng = np.random.default_rng(79)
    path = loops_drive(500.0)
    middle, half = np.meshgrid(np.linspace(0.0, 1.0, 75), np.linspace(0.002, 0.35, 24))
    inside = (middle + half < 1.0) & (middle - half > 0.0)
    up, down = (middle + half)[inside], (middle - half)[inside]
    weight, width = np.exp(-half / 0.12)[inside], 0.02
    state, travel = np.zeros_like(up), np.abs(np.diff(path, prepend=path[0]))
    z = np.empty_like(path)
    for n, value in enumerate(path):
        state = 0.5 + (state - 0.5) * np.exp(-fade * travel[n])
        on = np.clip((value - up) / width + 0.5, 0.0, 1.0)
        held = np.clip((value - down) / width + 0.5, 0.0, 1.0)
        state = np.minimum(held, np.maximum(on, state))
        z[n] = weight @ state
    z = 18.0 * z / np.ptp(z) + 42.0 * path**1.1 + 0.006 * rng.normal(size=len(path))
    time = np.arange(len(path)) / 500.0
    return pj.Record.from_arrays(time, 75.0 * path, z, units={"input": "V", "output": "um"})


def eddy_current_record(telling: Telling, k: float = 2e-3) -> pj.Record:
    """A core of bent plays, of which the field inside is found on a finer raster by bisection."""
    from preisach_jax.signals import diagnostic_record

    rng = np.random.default_rng(78)
    drive = diagnostic_record(telling.seconds, telling.rate_hz) / 75.0
    count, fine = len(drive), 4
    step = 1 / (telling.rate_hz * fine)
    path = np.interp(np.arange((count - 1) * fine + 1) / fine, np.arange(count), drive)
    radius = np.sort(rng.uniform(0.0, 0.3, 30))
    weight = np.exp(-radius / 0.1) * rng.uniform(0.5, 1.5, 30)
    weight /= weight.sum()
    centre, width = rng.uniform(0.3, 0.7, 30), rng.uniform(0.15, 0.3, 30)

    def flux(place: np.ndarray) -> float:
        return float(weight @ (0.2 * place + width * np.tanh((place - centre) / width)))

    place, field = np.zeros(30), path[0]
    before, course = flux(place), []
    for goal in path:
        low, high = min(field, goal), max(field, goal)
        for _ in range(26):
            field = 0.5 * (low + high)
            h = flux(np.clip(place, field - radius, field + radius))
            low, high = (low, field) if field + k / step * (h - before) > goal else (field, high)
        place = np.clip(place, field - radius, field + radius)
        before = flux(place)
        course.append(before)
    z = 1.2 * np.array(course)[::fine] + 1e-4 * rng.normal(size=count)
    time = np.arange(count) / telling.rate_hz
    return pj.Record.from_arrays(time, 500 * drive, z, units={"input": "A/m", "output": "T"})


def core_record(telling: Telling) -> pj.Record:
    """A core with an excess loss: the field over a chosen induction."""
    from preisach_jax.plant.magnets import simulate_magnet

    core = simulate_magnet(2, effects=("excess_loss",))
    units = {"input": "T", "output": "A/m"}
    return pj.Record.from_arrays(core.time, core.induction, core.field, units=units)


MADE: dict[str, Callable[[Telling], pj.Record]] = {
    "operator_creep": operator_creep_record,
    "reptation": reptation_record,
    "eddy_currents": eddy_current_record,
    "excess_loss": core_record,
}


def record_of(name: str) -> pj.Record:
    """The record with one effect hidden, from the stage or from a world of its own."""
    telling = TELLING[name]
    return MADE[name](telling) if name in MADE else stage_record(name, telling)


def colour(name: str) -> str:
    """That of the rate-independent model, or of the one with the effect."""
    return BEFORE if name == "before" else AFTER


class Panel:
    """What the functions that draw a panel need: the axes, both fits, and scaled quantities."""

    def __init__(self, axes: Axes, fits: Fits, factor: float, unit: str):
        self.axes, self.fits, self.factor, self.unit = axes, fits, factor, unit
        self.record = fits[0][1].record
        self.time, self.input, self.output = (
            self.record.time, self.record.input, self.record.output,
        )  # fmt: skip
        self.input_unit = pretty_unit(self.record.input_unit)
        self.output_unit = pretty_unit(self.record.output_unit)
        self.rate = stats.input_rate(self.time, self.input)
        self.moving = np.abs(self.rate) > LEAST_MOVE * self.record.input_range
        self.axes.axhline(0, color="0.3", lw=0.7)
        self.axes.set_ylabel(f"residual ({unit})")

    def of(self, fit: pj.Fit) -> np.ndarray:
        """(time,) scaled residual."""
        return self.factor * fit.residual

    def cloud(
        self, position: np.ndarray, rows: np.ndarray, sign: np.ndarray | float = 1.0, bins: int = 24
    ) -> None:
        """Points of both models over a position, with the median over bins."""
        for name, fit in self.fits:
            values = (sign * self.of(fit))[rows]
            place = position[rows]
            few = np.random.default_rng(0).permutation(len(place))[:POINTS]
            self.axes.plot(
                place[few], values[few], ".", color=colour(name), ms=2.0, alpha=0.3, mew=0,
                rasterized=True,
            )  # fmt: skip
            found = stats.binned(place, values, bins)
            self.axes.plot(found.centre, found.median, color=colour(name), lw=2)
        self.limit(rows)

    def limit(self, rows: np.ndarray) -> None:
        """Let the axis end where nearly all points of some rows are inside."""
        most = max(np.nanquantile(np.abs(self.of(fit)[rows]), 0.998) for _, fit in self.fits)
        self.axes.set_ylim(-1.15 * most, 1.15 * most)

    def medians(self, position: np.ndarray, groups: dict[str, np.ndarray]) -> None:
        """Medians and bands of both models for groups of rows, told apart by line and mark."""
        styles = (
            ("-", BEFORE, "o"),
            ("--", "#E69F00", "^"),
            ("-", AFTER, "s"),
            ("--", "#56B4E9", "v"),
        )
        pairs = [
            (label, rows, name, fit) for name, fit in self.fits for label, rows in groups.items()
        ]
        for (label, rows, name, fit), (line, shade, mark) in zip(pairs, styles, strict=True):
            found = stats.binned(position[rows], self.of(fit)[rows], 16)
            model = "without" if name == "before" else "with"
            self.axes.fill_between(
                found.centre, found.low, found.high, color=shade, alpha=0.13, lw=0
            )
            self.axes.plot(
                found.centre, found.median, line, color=shade, lw=1.8, marker=mark, ms=4,
                label=f"{label}, {model}",
            )  # fmt: skip
        self.axes.legend(ncols=2, fontsize=7.5)


def rest_time(panel: Panel) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows at rest, time since the input stopped, and the direction and size of the move before."""
    moving = panel.moving
    number = np.arange(len(moving))
    last = np.maximum.accumulate(np.where(moving, number, 0))
    rows = ~moving & (last > 0)
    turn = stats.last_reversal(panel.input)
    move = panel.input - panel.input[turn[last]]
    return rows, panel.time - panel.time[last], move


def _holds(panel: Panel, longest_move: float = 1.1, least_move: float = 0.02) -> list[slice]:
    """Rests of the input of at least 80 ms behind moves of some size."""
    rows, since, move = rest_time(panel)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], rows.astype(int), [0]])))
    swing = panel.record.input_range
    return [
        slice(int(begin), int(end))
        for begin, end in edges.reshape(-1, 2)
        if since[end - 1] > 0.08 and least_move < abs(move[begin]) / swing <= longest_move
    ]


def _tails(panel: Panel, holds: list[slice], line: str, label: str, models: int = 2) -> None:
    """What the residual does in each hold, in the direction of the move before it."""
    _, since, move = rest_time(panel)
    for name, fit in panel.fits[:models]:
        for number, hold in enumerate(holds):
            values = np.sign(move[hold.start]) * panel.of(fit)[hold]
            start = np.median(values[since[hold] < max(0.008, since[hold][0] + 0.003)])
            found = stats.binned(np.log(since[hold]), values - start, 22, 2)
            panel.axes.plot(
                np.exp(found.centre), found.median, line, color=colour(name), lw=1.3, marker=".",
                ms=3, label=label if name == "before" and not number else None,
            )  # fmt: skip
    panel.axes.set_xscale("log")
    panel.axes.set_xlabel("time since the input came to rest (s); one line a hold")
    panel.axes.set_ylabel(
        f"change of the residual in a hold,\nin the direction of the move ({panel.unit})"
    )


def since_rest(panel: Panel) -> None:
    """In the direction of the last move, over the time at rest."""
    _tails(panel, _holds(panel), "-", "")


def since_rest_by_move(panel: Panel) -> None:
    """The same for great and small moves."""
    _tails(panel, _holds(panel, 1.1, 0.35), "-", "after moves above 35 % of the range", 1)
    _tails(panel, _holds(panel, 0.35), ":", "after smaller moves", 1)
    _tails(panel, _holds(panel), "-", "")
    panel.axes.legend(fontsize=7.5)


def input_rate(panel: Panel) -> None:
    """Over the rate of the input."""
    panel.cloud(panel.rate, np.isfinite(panel.output), bins=30)
    panel.axes.set_xlabel(f"rate of the input ({panel.input_unit}/s)")


def along_the_move(panel: Panel) -> None:
    """Along the move, over the speed of the input, the few fastest samples left out."""
    speed = np.abs(panel.rate)
    rows = panel.moving & (speed < 2100)
    panel.cloud(speed, rows, np.sign(panel.rate), 14)
    panel.axes.set_xlabel(f"speed of the input ({panel.input_unit}/s)")
    panel.axes.set_ylabel(f"residual in the direction\nof the move ({panel.unit})")


def output_rate(panel: Panel) -> None:
    """Over the rate of the output of the model with the effect, which has no noise."""
    rate = stats.input_rate(panel.time, panel.fits[1][1].prediction)
    factor, unit = scaled(float(np.quantile(np.abs(rate), 0.99)), panel.record.output_unit)
    panel.cloud(factor * rate, np.isfinite(rate), bins=30)
    panel.axes.set_xlabel(f"rate of the output ({unit}/s)")


def output_by_branch(panel: Panel) -> None:
    """Over the output, rising and falling apart."""
    groups = {
        "rising": panel.moving & (panel.rate > 0), "falling": panel.moving & (panel.rate < 0),
    }  # fmt: skip
    panel.medians(panel.output, groups)
    panel.axes.set_xlabel(f"output ({panel.output_unit})")


def _early_and_late(panel: Panel) -> dict[str, np.ndarray]:
    place = (panel.time - panel.time[0]) / panel.record.duration_s
    return {"first quarter": place < 0.25, "last quarter": place > 0.75}


def output_early_and_late(panel: Panel) -> None:
    """Over the output, early and late apart."""
    panel.medians(panel.output, _early_and_late(panel))
    panel.axes.set_xlabel(f"output ({panel.output_unit})")


def input_early_and_late(panel: Panel) -> None:
    """Over the input, early and late apart."""
    panel.medians(panel.input, _early_and_late(panel))
    panel.axes.set_xlabel(f"input ({panel.input_unit})")


def few_steps_of_input(panel: Panel) -> None:
    """Over the input on the slow ramp at the end."""
    rows = panel.time > panel.time[-1] - 3.0
    _points(panel, panel.input, rows)
    panel.axes.set_xlabel(f"input on a slow ramp ({panel.input_unit})")


def few_steps_of_output(panel: Panel) -> None:
    """Over the output that the model without steps predicts, within a few steps."""
    prediction = panel.fits[0][1].prediction
    centre = float(np.median(panel.output))
    step = float(np.min(np.diff(np.unique(np.round(panel.output, 9)))))
    rows = np.abs(prediction - centre) < 6 * step
    _points(panel, prediction, rows)
    panel.axes.set_xlabel(f"predicted output ({panel.output_unit}), a few steps of it")


def _points(panel: Panel, position: np.ndarray, rows: np.ndarray) -> None:
    for name, fit in panel.fits:
        panel.axes.plot(
            position[rows], panel.of(fit)[rows], ".", color=colour(name), ms=3, mew=0, alpha=0.6,
            rasterized=True,
        )  # fmt: skip
    panel.limit(rows)


def auxiliary(panel: Panel) -> None:
    """Over the auxiliary column."""
    (name,) = panel.record.aux
    panel.cloud(panel.record.aux[name], np.isfinite(panel.output))
    label, _, unit = name.rpartition("_")
    panel.axes.set_xlabel(f"{label} ({unit})")


def output_cold_and_warm(panel: Panel) -> None:
    """Over the output, at low and at high values of the auxiliary column."""
    ((name, column),) = panel.record.aux.items()
    low, high = np.quantile(column, (0.25, 0.75))
    label, _, unit = name.rpartition("_")
    groups = {f"{label} < {low:.3g} {unit}": column < low}
    panel.medians(panel.output, groups | {f"{label} > {high:.3g} {unit}": column > high})
    panel.axes.set_xlabel(f"output ({panel.output_unit})")


def behind_a_step(panel: Panel) -> None:
    """Over time, about the step that leaves most."""
    first = panel.of(panel.fits[0][1])
    rest, since, _ = rest_time(panel)
    begins = np.flatnonzero(np.diff(rest.astype(int)) > 0)
    length = round(0.05 / panel.record.step_s)
    long = [stop for stop in begins if since[min(stop + length, len(since) - 1)] > 0.04]
    power = [np.sum(first[stop - length // 4 : stop + length] ** 2) for stop in long]
    begin = long[int(np.argmax(power))] - length // 4
    energy = np.cumsum(first[begin : begin + length + length // 4] ** 2)
    last = int(np.searchsorted(energy, 0.998 * energy[-1]))
    rows = slice(begin, begin + min(2 * last - length // 4, length) + length // 4)
    time = 1e3 * (panel.time[rows] - panel.time[begin])
    for name, fit in panel.fits:
        panel.axes.plot(time, panel.of(fit)[rows], color=colour(name), lw=1.2, marker=".", ms=4)
    panel.axes.set_xlabel(f"time (ms) from {panel.time[begin]:.2f} s on")
    _input_beside(panel, time, rows)


def _input_beside(panel: Panel, time: np.ndarray, rows: slice) -> None:
    twin = panel.axes.twinx()
    twin.plot(time, panel.input[rows], color="0.45", lw=1.2, ls=":")
    twin.set_ylabel(f"input ({panel.input_unit}), dotted", color="0.35")
    twin.grid(visible=False)


def worst_second(panel: Panel) -> None:
    """Over time, where the rate-independent model errs most."""
    first = np.abs(panel.of(panel.fits[0][1]))
    half = round(0.5 / panel.record.step_s)
    power = np.convolve(first**2, np.ones(half), "same")
    centre = int(np.clip(np.argmax(power), half, len(power) - half))
    rows = slice(centre - half, centre + half)
    for name, fit in panel.fits:
        panel.axes.plot(panel.time[rows], panel.of(fit)[rows], color=colour(name), lw=0.9)
    panel.axes.set_xlabel("time (s), the second in which the error is greatest")
    _input_beside(panel, panel.time[rows], rows)


def lines(panel: Panel) -> None:
    """Amplitude spectrum."""
    for name, fit in panel.fits:
        values = panel.of(fit) - panel.of(fit).mean()
        window = np.hanning(len(values))
        height = 2 * np.abs(np.fft.rfft(values * window)) / window.sum()
        frequency = np.fft.rfftfreq(len(values), panel.record.step_s)
        rows = (frequency > 5) & (frequency < 220)
        panel.axes.plot(frequency[rows], height[rows], color=colour(name), lw=0.9)
    panel.axes.set_yscale("log")
    panel.axes.set_xlabel("frequency (Hz)")
    panel.axes.set_ylabel(f"amplitude of the residual ({panel.unit})")


def loop_number(panel: Panel) -> None:
    """At the lower turn of each minor loop, by its number."""
    turns = stats.reversals(panel.input)
    swing = panel.record.input_range
    groups: list[list[int]] = [[]]
    for turn, after in itertools.pairwise(turns):
        small = abs(abs(panel.input[after] - panel.input[turn]) - 0.3 * swing) < 0.01 * swing
        if small and panel.input[turn] < panel.input[after]:
            groups[-1].append(turn)
        elif not small and groups[-1]:
            groups.append([])
    for group in groups:
        if len(group) < 8:
            continue
        before = panel.input[: group[0]] - panel.input[group[0]]
        high = np.flatnonzero(before > 0.35 * swing)
        low = np.flatnonzero(before < -0.1 * swing)
        above = max(high, default=0) > max(low, default=0)
        for name, fit in panel.fits:
            panel.axes.plot(
                np.arange(1, len(group) + 1), panel.of(fit)[group], color=colour(name), lw=1.2,
                marker="v" if above else "^", ms=4,
            )  # fmt: skip
    panel.axes.set_xlabel(
        "number of the minor loop after a great move (▼ from the top, ▲ from below)"
    )
    panel.axes.set_ylabel(f"residual at its lower turn ({panel.unit})")


AXES: dict[str, Callable[[Panel], None]] = {
    function.__name__: function
    for function in (
        since_rest, since_rest_by_move, input_rate, along_the_move, output_rate,
        output_by_branch, output_early_and_late, input_early_and_late, few_steps_of_input,
        few_steps_of_output, auxiliary, output_cold_and_warm, behind_a_step, worst_second, lines,
        loop_number,
    )
}  # fmt: skip


@mpl.rc_context(STYLE)
def draw(name: str) -> Figure:
    """The picture of one effect's residual."""
    record = record_of(name)
    effect = COLUMNS.get(name, name)
    before, after = pj.fit(record), pj.fit(record, effects=(effect,))
    fits: Fits = (("before", before), ("after", after))
    factor, unit = scaled(float(np.nanquantile(np.abs(before.residual), 0.999)), record.output_unit)
    figure = Figure(figsize=(7.6, 5.4), layout="constrained")
    above, below = figure.subplots(2, 1, height_ratios=[0.8, 1.2])
    course = Panel(above, fits, factor, unit)
    for kind, fit in fits:
        error = factor * fit.rms_validation
        label = (
            f"rate-independent model: {error:.3g} {unit} RMS held out"
            if kind == "before"
            else f"with {effect}: {error:.3g} {unit}"
        )
        above.plot(record.time, course.of(fit), color=colour(kind), lw=0.6, label=label)
    above.set_title(f"{name}: residual (measured minus model)")
    above.set_xlabel("time (s)")
    above.margins(x=0.01)
    handles = above.get_legend_handles_labels()
    figure.legend(*handles, loc="outside lower center", ncols=2)
    AXES[TELLING[name].axis](Panel(below, fits, factor, unit))
    return figure


@mpl.rc_context(STYLE)
def home() -> Figure:
    """The picture of the first page: a loop, and what remains as effects are found."""
    stage = pj.simulate_stage(seed=3, seconds=16.0, effects=("creep", "input_lag"), rate_hz=1000.0)
    units = {"input": "V", "output": "um"}
    record = pj.Record.from_arrays(stage.time, stage.input, stage.output, units=units)
    found = pj.diagnose(record)
    figure = Figure(figsize=(9.2, 3.9), layout="constrained")
    loop, *rungs = (
        panel
        for row in figure.subplot_mosaic(
            [["loop", "0"], ["loop", "1"], ["loop", "2"]], width_ratios=[1, 1.5]
        ).items()
        for panel in row[1:]
    )
    loop.plot(record.input, record.output, color="0.5", lw=0.5)
    loop.set_xlabel("input (V)")
    loop.set_ylabel("output (µm)")
    loop.set_title("measured")
    for axes, fit in zip(rungs, found.steps, strict=True):
        shade = AFTER if fit.effects else BEFORE
        axes.plot(record.time, 1e3 * fit.residual, color=shade, lw=0.6)
        axes.set_ylim(-900, 900)
        axes.set_ylabel("nm")
        names = " + ".join(("Preisach model", *fit.effects))
        axes.set_title(f"residual of {names}: {1e3 * fit.rms_validation:.3g} nm RMS")
    rungs[-1].set_xlabel("time (s)")
    return figure


def forc() -> Figure:
    """The FORC diagram of the bundled reversal curves."""
    path = files("preisach_jax") / "bundled" / "conventional_example.forc"
    figure = forc_diagram(pj.fit(pj.Record.load(str(path)), levels=50).model)
    figure.set_size_inches(5.6, 5.6)
    return figure


@mpl.rc_context(STYLE)
def own_effect() -> Figure:
    """The calibration points of the page on effects of one's own, with the fits of that page."""
    page = (ASSETS.parent / "how-to" / "own-effect.md").read_text(encoding="utf-8")
    names: dict[str, Any] = {"__name__": "page"}
    for block in re.findall(r"```python\n(.*?)```", page, re.DOTALL)[:3]:
        exec(compile(block, "own-effect.md", "exec", dont_inherit=True), names)
    record, again = names["record"], names["again"]
    figure = Figure(figsize=(7.6, 3.4), layout="constrained")
    axes = figure.subplots()
    for name, shade, mark in (("plain", BEFORE, "o"), ("fading", AFTER, "s")):
        left = 100 * names[name].residual[again] / record.output_range
        label = " + ".join(("Preisach model", *names[name].effects))
        axes.plot(
            record.time[again] / 60, left, mark, color=shade, ms=4, mew=0,
            label=f"{label}: {names['error_at'](names[name], again):.3f} % RMS",
        )  # fmt: skip
    axes.set_title("one magnetic state, measured 120 times")
    axes.set_xlabel("time (min)")
    axes.set_ylabel("measured - model\n(% of the range)")
    axes.legend()
    return figure


def drive() -> Figure:
    """Tracking of a simulated stage with more and more of its model's inverse."""
    hidden = ("creep", "output_lag")
    stage = pj.simulate_stage(seed=3, seconds=8.0, rate_hz=1000.0, effects=hidden)
    units = {"input": "V", "output": "um"}
    record = pj.Record.from_arrays(stage.time, stage.input, stage.output, units=units)
    model = pj.fit(record, effects=hidden, levels=13).model
    t = np.arange(1000) / 1000.0
    begin, middle = stage.output[-1], np.ptp(stage.output) / 2
    part = np.clip(t / 0.2, 0, 1)
    ramp = part**2 * (3 - 2 * part)
    z = begin + (middle + 10 * np.sin(2 * np.pi * 3 * t) - begin) * ramp
    wanted = pj.Record.from_arrays(t, 0 * t, z, units={"output": "um"})
    return pj.simulate_loop(model, wanted, limits=(0, 75)).plot()


def of_the_paper(name: str) -> Figure:
    """One of the paper's figures."""
    data = {"hysteron": "hysteron_loops"}.get(name, name)
    return getattr(draw_paper, name)(getattr(paper, data)())


def saved(figure: Figure, path: Path, dpi: int = 120) -> Path:
    """Write a picture with a palette, which holds all its colours in a third of the bytes."""
    picture = Image.open(io.BytesIO(png(figure, dpi))).convert("RGB")
    picture.quantize(128).save(path, optimize=True)
    if path.stat().st_size > MOST_BYTES:
        raise ValueError(f"{path} has {path.stat().st_size} bytes; draw fewer points")
    return path


OTHERS: dict[str, Callable[[], Figure]] = {
    "home": home,
    "forc": forc,
    "drive": drive,
    "own-effect": own_effect,
    "paper/hysteron": partial(of_the_paper, "hysteron"),
    "paper/convergence": partial(of_the_paper, "convergence"),
    "paper/proportionality": partial(of_the_paper, "proportionality"),
}
"""Pictures that are no effects', by their place among the assets."""


if __name__ == "__main__":
    for chosen in sys.argv[1:] or (*OTHERS, *TELLING):
        if chosen in OTHERS:
            written = saved(OTHERS[chosen](), ASSETS / f"{chosen}.png")
        else:
            written = saved(draw(chosen), OUT / f"{file_name(chosen)}.png")
        sys.stdout.write(f"{written}\n")
        sys.stdout.flush()

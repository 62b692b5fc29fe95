"""The paper's figures, and three that go further, drawn from their numbers and written to files."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyArrowPatch, Rectangle
from matplotlib.ticker import FixedLocator, MaxNLocator, NullFormatter, NullLocator, ScalarFormatter

from preisach_jax import paper
from preisach_jax.errors import InputError
from preisach_jax.files import check_folder, json_bytes, write_files
from preisach_jax.paper.noise import power_law_through
from preisach_jax.plot.style import AFTER, BEFORE, FLOOR, MEASURED, STYLE, pdf, png
from preisach_jax.theory import Progress

DPI = 300
SINGLE_IN, DOUBLE_IN = 3.5, 7.2  # width of one column in print, and of two
BLACK = "#000000"
LEVEL_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000")
MARKERS = "osD^vP*"

PRINT: dict[Any, Any] = {
    **STYLE,
    "font.size": 8,
    "axes.titlesize": 8,
    "axes.labelsize": 8,
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5,
    "legend.fontsize": 7.5,
    "lines.linewidth": 1.0,
    "mathtext.fontset": "dejavusans",
}


def _single(height: float) -> tuple[Figure, Axes]:
    """A figure of one column in print, and its axes."""
    figure = Figure(figsize=(SINGLE_IN, height), layout="constrained")
    return figure, figure.add_subplot()


def _minus(text: str) -> str:
    """The text with the sign that numbers on axes have."""
    return text.replace("-", "−")


# --- Fig. 1 ---


@mpl.rc_context(PRINT)
def hysteron(data: paper.HysteronLoops) -> Figure:
    """Fig. 1: input and output of a relay and of its ramp."""
    figure, axes = _single(2.4)
    x = data.input
    for up, down, style, shade, name in (
        (data.relay_up, data.relay_down, "-", BLACK, "relay (2)"),
        (data.ramp_up, data.ramp_down, "--", AFTER, "ramp"),
    ):
        axes.plot(x, up, style, color=shade, label=name, drawstyle=_jumps(style))
        axes.plot(x, down, style, color=shade, drawstyle=_jumps(style))
    arrows = (
        ((data.alpha, -0.15), (data.alpha, 0.15)),
        ((data.beta, 0.15), (data.beta, -0.15)),
        ((2.75, -1.0), (3.25, -1.0)),
        ((3.25, 1.0), (2.75, 1.0)),
    )
    for begin, end in arrows:
        arrow = {"arrowstyle": "-|>", "color": BLACK, "lw": 1.0, "mutation_scale": 11}
        axes.annotate("", end, begin, arrowprops=arrow)
    axes.axhline(0.0, color="0.6", lw=0.6)
    axes.set_xticks([data.beta, data.alpha], ["β", "α"])
    axes.set_yticks([-1, 0, 1], ["−1", "0", "+1"])
    axes.set_ylim(-1.35, 1.75)
    axes.grid(axis="y", visible=False)
    half = data.delta_x / 2
    axes.annotate(
        "", (data.beta - half, -1.2), (data.beta + half, -1.2),
        arrowprops={"arrowstyle": "<->", "color": AFTER, "lw": 0.8, "shrinkA": 0, "shrinkB": 0},
    )  # fmt: skip
    axes.text(data.beta + half + 0.1, -1.2, "δx", color=AFTER, va="center")
    axes.set_xlabel("input x (arbitrary unit)")
    axes.set_ylabel("output y (no unit)")
    axes.legend(loc="upper center", ncols=2)
    return figure


def _jumps(style: str) -> str:
    return "steps-mid" if style == "-" else "default"


# --- Fig. 2 and 3: boxes and wires ---

Place = tuple[float, float]

FILTER_PLACES: Mapping[str, tuple[float, float, float, float]] = {
    # centre and size, in inches
    "plant": (1.05, 3.1, 1.0, 0.62),
    "noise": (2.35, 3.1, 0.26, 0.0),
    "delay_z": (3.6, 2.55, 0.5, 0.36),
    "difference_z": (4.75, 3.1, 0.26, 0.0),
    "hysterons": (1.05, 1.65, 1.0, 0.62),
    "sum": (2.45, 1.65, 0.8, 0.62),
    "delay_model": (3.6, 2.15, 0.5, 0.36),
    "difference_model": (4.75, 1.65, 0.26, 0.0),
    "error": (5.55, 2.38, 0.26, 0.0),
    "switching": (1.05, 0.5, 1.0, 0.62),
    "update": (3.3, 0.5, 1.06, 0.62),
    "rate": (5.55, 0.5, 0.86, 0.62),
}

FILTER_WIRES: Mapping[tuple[str, str], tuple[tuple[Place, ...], Place | None]] = {
    # source and target: corners, and where the symbol is written
    ("", "plant"): (((0.0, 3.1), (0.55, 3.1)), (0.02, 3.2)),
    ("", "hysterons"): (((0.25, 3.1), (0.25, 1.65), (0.55, 1.65)), None),
    ("", "noise"): (((2.35, 3.6), (2.35, 3.23)), (2.42, 3.46)),
    ("plant", "noise"): (((1.55, 3.1), (2.22, 3.1)), None),
    ("noise", "difference_z"): (((2.48, 3.1), (4.62, 3.1)), (2.58, 3.18)),
    ("noise", "delay_z"): (((2.95, 3.1), (2.95, 2.55), (3.35, 2.55)), None),
    ("delay_z", "difference_z"): (((3.85, 2.55), (4.75, 2.55), (4.75, 2.97)), (3.93, 2.62)),
    ("hysterons", "sum"): (((1.55, 1.65), (2.05, 1.65)), (1.62, 1.7)),
    ("sum", "difference_model"): (((2.85, 1.65), (4.62, 1.65)), (3.1, 1.47)),
    ("sum", "delay_model"): (((2.95, 1.65), (2.95, 2.15), (3.35, 2.15)), None),
    ("delay_model", "difference_model"): (((3.85, 2.15), (4.75, 2.15), (4.75, 1.78)), (3.93, 2.22)),
    ("difference_z", "error"): (((4.88, 3.1), (5.55, 3.1), (5.55, 2.51)), (5.1, 3.18)),
    ("difference_model", "error"): (
        ((4.88, 1.65), (5.25, 1.65), (5.25, 2.38), (5.42, 2.38)),
        (4.93, 1.73),
    ),
    ("error", "rate"): (((5.68, 2.38), (6.2, 2.38), (6.2, 0.5), (5.98, 0.5)), (5.86, 2.46)),
    ("hysterons", "switching"): (((1.05, 1.34), (1.05, 0.81)), (1.12, 1.02)),
    ("switching", "update"): (((1.55, 0.58), (2.77, 0.58)), (2.0, 0.65)),
    ("switching", "rate"): (((1.05, 0.19), (1.05, 0.02), (5.55, 0.02), (5.55, 0.19)), (2.0, 0.06)),
    ("rate", "update"): (((5.12, 0.5), (3.83, 0.5)), (4.35, 0.58)),
    ("update", "sum"): (((3.3, 0.81), (3.3, 1.1), (2.45, 1.1), (2.45, 1.34)), (2.8, 1.14)),
}


@mpl.rc_context(PRINT)
def adaptive_filter(data: paper.Diagram) -> Figure:
    """Fig. 2: data flow of the adaptive filter."""
    figure, axes = _blank(6.4, 3.75)
    for block in data.blocks:
        x, y, width, height = FILTER_PLACES[block.name]
        if height:
            _box(axes, (x, y), (width, height), block)
        else:
            _junction(axes, (x, y), width, block)
    for signal in data.signals:
        corners, place = FILTER_WIRES[signal.source, signal.target]
        _wire(axes, corners)
        if place is not None:
            axes.text(*place, _minus(signal.symbol), fontsize=8, va="bottom")
    # Where a wire branches off, and the signs at the differences.
    for x, y in ((0.25, 3.1), (2.95, 3.1), (2.95, 1.65)):
        axes.add_patch(Circle((x, y), 0.03, color=BLACK))
    for x, y, sign in (
        (4.45, 3.16, "+"), (4.82, 2.8, "−"), (4.45, 1.45, "+"), (4.82, 1.86, "−"),
        (5.62, 2.56, "+"), (5.3, 2.2, "−"),
    ):  # fmt: skip
        axes.text(x, y, sign, fontsize=8)
    return figure


@mpl.rc_context(PRINT)
def experiment(data: paper.Diagram) -> Figure:
    """Fig. 3: structure of the experiment, in two rows of boxes."""
    figure, axes = _blank(DOUBLE_IN, 2.0)
    size = (1.5, 0.72)
    places = [(x, y) for y in (1.45, 0.45) for x in (1.0, 3.25, 5.5)]
    for block, place in zip(data.blocks, places, strict=True):
        _box(axes, place, size, block)
    for number, signal in enumerate(data.signals):
        x, y = places[number]
        begin = (x + size[0] / 2, y)
        if number == 2:  # from the first row down to the second one
            turn = ((6.7, y), (6.7, 0.95), (0.02, 0.95), (0.02, 0.45), (0.25, 0.45))
            _wire(axes, (begin, *turn))
            axes.text(6.42, y + 0.05, signal.symbol, fontsize=8)
            continue
        end = (places[number + 1][0] - size[0] / 2, y) if number < 5 else (7.1, y)
        _wire(axes, (begin, end))
        axes.text(
            (begin[0] + end[0]) / 2, y + 0.05, signal.symbol, fontsize=8, ha="center", va="bottom"
        )
    return figure


def _blank(width: float, height: float) -> tuple[Figure, Axes]:
    """A figure whose coordinates are inches."""
    figure = Figure(figsize=(width, height))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(-0.05, width - 0.05), ylim=(-0.05, height - 0.05))
    axes.axis("off")
    return figure, axes


def _box(axes: Axes, centre: Place, size: Place, block: paper.Block) -> None:
    corner = (centre[0] - size[0] / 2, centre[1] - size[1] / 2)
    axes.add_patch(Rectangle(corner, *size, facecolor="#EAF3FA", edgecolor=AFTER, lw=1.0, zorder=3))
    text = f"{block.text}\n{block.equation}".rstrip()
    axes.text(*centre, text, ha="center", va="center", fontsize=7.5, zorder=4, linespacing=1.15)


def _junction(axes: Axes, centre: Place, width: float, block: paper.Block) -> None:
    axes.add_patch(Circle(centre, width / 2, facecolor="white", edgecolor=BLACK, lw=1.0, zorder=3))
    axes.text(*centre, block.text, ha="center", va="center_baseline", fontsize=9, zorder=4)
    if block.equation:
        axes.text(centre[0] + 0.14, centre[1] - 0.3, block.equation, fontsize=7.5)


def _wire(axes: Axes, corners: Sequence[Place]) -> None:
    *way, before = corners[:-1]
    for begin, end in itertools.pairwise([*way, before]):
        axes.plot(*zip(begin, end, strict=True), color=BLACK, lw=0.9, solid_capstyle="projecting")
    axes.add_patch(
        FancyArrowPatch(
            before, corners[-1], arrowstyle="-|>", mutation_scale=8, color=BLACK, lw=0.9,
            shrinkA=0, shrinkB=0,
        )
    )  # fmt: skip


# --- Fig. 4 to 7 ---


@mpl.rc_context(PRINT)
def bode(data: paper.Bode) -> Figure:
    """Fig. 4: Bode diagram."""
    figure = Figure(figsize=(SINGLE_IN, 3.9), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=[1.25, 1])
    for axes, measured, model, notch, bars in (
        (above, data.measured_db, data.model_db, data.notch_db, data.deviation_db),
        (below, data.measured_deg, data.model_deg, data.notch_deg, None),
    ):
        axes.errorbar(
            data.frequency_hz, measured, bars, fmt="o", ms=2.6, mew=0.5, mfc="white", mec=BLACK,
            ecolor=BLACK, elinewidth=0.8, label="stage, measured", zorder=4,
        )  # fmt: skip
        axes.plot(data.grid_hz, model, color=AFTER, label="linear model", zorder=3)
        axes.plot(data.grid_hz, notch, "--", color=BEFORE, label="notch filter (26)", zorder=3)
        axes.set_xscale("log")
        axes.margins(x=0.01)
    for f, shift, side in zip(data.mode_hz, (-4, 4), ("right", "left"), strict=True):
        height = float(np.interp(float(f), data.grid_hz, data.model_db))
        above.annotate(
            f"{f:.1f} Hz", (f, height), xytext=(shift, -2), textcoords="offset points", ha=side,
            fontsize=7.5,
        )  # fmt: skip
    above.set_ylabel("magnitude (dB)\nstage: re 1 µm/V")
    below.set_ylabel("phase (degrees)")
    below.set_xlabel("frequency (Hz)")
    below.yaxis.set_major_locator(MaxNLocator(steps=[1, 1.8, 4.5, 9, 10]))
    handles, names = above.get_legend_handles_labels()
    order = np.argsort([not name.startswith("stage") for name in names], kind="stable")
    figure.legend(
        [handles[n] for n in order], [names[n] for n in order], loc="outside upper center", ncols=2
    )
    return figure


@mpl.rc_context(PRINT)
def loops(data: paper.Loops) -> Figure:
    """Fig. 5: measured input-output loops."""
    figure, axes = _single(2.8)
    axes.plot(data.input_v, data.stroke_um, color=AFTER, lw=0.35, rasterized=True)
    axes.plot(data.major_input_v, data.major_stroke_um, "--", color=BLACK, lw=1.2)
    axes.plot([], [], color=AFTER, label=f"measured, {data.seconds:g} s")
    axes.plot([], [], "--", color=BLACK, label="major loop")
    axes.annotate(
        f"I = {data.slope_um_per_v:.2f} µm/V", (0.97, 0.06), xycoords="axes fraction", ha="right"
    )
    axes.set_xlabel("input x (V)")
    axes.set_ylabel("output z (µm)")
    axes.legend(loc="upper left")
    return figure


@mpl.rc_context(PRINT)
def convergence(data: paper.Convergence) -> Figure:
    """Fig. 6: squared output error with its asymptotes."""
    figure = Figure(figsize=(DOUBLE_IN, 3.0), layout="constrained")
    axes = figure.add_subplot()
    axes.plot(
        data.sample, data.error_squared_um2, ".", ms=2.2, mew=0, color=MEASURED, rasterized=True,
        label="e² at switching samples, one record",
    )  # fmt: skip
    axes.plot(
        data.block_sample, data.block_power_um2, color=AFTER, lw=0.9,
        label=f"mean over {data.block} samples, {data.records} records",
    )  # fmt: skip
    ends = np.array([0.0, min(max(data.hinge.knee, 0.0), data.samples), data.samples])
    axes.plot(ends, 10.0 ** data.hinge(ends), color=BEFORE, lw=1.8, label="fitted asymptotes")
    axes.axvspan(data.knee_low, data.knee_high, color=BEFORE, alpha=0.1, lw=0, zorder=0)
    axes.axhline(data.increment_squared_um2, color=BLACK, ls=":", label="(I δx)²")
    axes.set_yscale("log")
    top = 3.0 * max(data.increment_squared_um2, data.error_squared_um2.max())
    axes.set_ylim(1e-8 * top, top)
    axes.set_xlim(-0.01 * data.samples, 1.01 * data.samples)
    axes.annotate(
        f"knee at k = {data.hinge.knee:.0f} (95 %: {data.knee_low:.0f} to {data.knee_high:.0f})",
        (data.hinge.knee, 0.3 * data.increment_squared_um2), xytext=(0, -3), va="center",
        textcoords="offset points", bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.5},
    )  # fmt: skip
    axes.set_xlabel("k (samples at 2 kHz)")
    axes.set_ylabel("squared output error e² (µm²)")
    figure.legend(loc="outside upper center", ncols=4, markerscale=3)
    return figure


@mpl.rc_context(PRINT)
def time_frame(data: paper.TimeFrame) -> Figure:
    """Fig. 7: measurement and model over a short time."""
    figure, axes = _single(2.6)
    axes.plot(data.time_s, data.measured_um, color=MEASURED, lw=1.6, label="measured z")
    axes.plot(
        data.time_s, data.model_um, color=AFTER, lw=0.9, drawstyle="steps-post", label="filter ẑ"
    )
    axes.margins(x=0.02)
    axes.set_xlabel("time (s)")
    axes.set_ylabel("output (µm)")
    figure.legend(loc="outside upper center", ncols=2)
    return figure


# --- Fig. 8 to 11 ---


@mpl.rc_context(PRINT)
def proportionality(data: paper.Proportionality) -> Figure:
    """Fig. 8: auxiliary norm against the power of the quantisation noise."""
    figure, axes = _single(3.0)
    events, deviation = data.over_events_um, data.events_deviation_um
    for values, bars, line, law, shade, filled, name in (
        (events, deviation, data.line_events_um, data.events, AFTER, AFTER, "switching samples"),
        (
            data.over_samples_um,
            None,
            data.line_samples_um,
            data.samples,
            BEFORE,
            "white",
            "all samples",
        ),
    ):
        label = f"{name}: {law.value:.2f} ({law.low:.2f} to {law.high:.2f})"
        axes.plot(data.line_power_um2, line, color=shade, zorder=2)
        axes.errorbar(
            data.noise_power_um2, values, bars, fmt="o", ms=5, mfc=filled, mec=shade, ecolor=BLACK,
            elinewidth=0.8, label=label, zorder=3,
        )  # fmt: skip
    axes.fill_between(data.noise_power_um2, *data.band_events_um, color=AFTER, alpha=0.25, lw=0)
    for N, W, norm in zip(data.levels, data.noise_power_um2, data.over_events_um, strict=True):
        axes.annotate(
            f"N = {N}", (W, norm), xytext=(-5, 3), textcoords="offset points", ha="right",
            fontsize=7.5,
        )  # fmt: skip
    axes.set_xscale("log")
    axes.set_yscale("log")
    low, high = data.line_power_um2
    axes.set_xlim(low / 2.5, high)
    axes.set_xlabel("power of the quantisation noise W, eq. (29) (µm²)")
    axes.set_ylabel("auxiliary norm, eq. (31) (µm)")
    figure.legend(loc="outside upper center", title="exponent and 95 % interval over")
    return figure


@mpl.rc_context(PRINT)
def coefficients(data: paper.NoiseCoefficients) -> Figure:
    """Fig. 9: what noise does to the weights, and its coefficient."""
    figure = Figure(figsize=(DOUBLE_IN, 4.0), layout="constrained")
    panels = figure.subplot_mosaic([["a", "b"], ["a", "c"]], width_ratios=[1.15, 1])
    _noise_part(panels["a"], data)
    _coefficient(panels["b"], panels["c"], data)
    return figure


def _noise_part(left: Axes, data: paper.NoiseCoefficients) -> None:
    styles = zip(itertools.cycle(LEVEL_COLOURS), itertools.cycle(MARKERS), strict=False)
    for n, (N, (shade, marker)) in enumerate(zip(data.levels, styles, strict=False)):
        left.plot(data.line_power_um2, data.lines_um2[n], color=shade, lw=0.8)
        left.plot(
            data.noise_power_um2, data.noise_part_um2[n], marker, ms=3.6, mew=0, color=shade,
            label=f"N = {N}",
        )  # fmt: skip
        left.plot(
            data.noise_power_um2, data.total_um2[n], marker + "-", ms=3.2, color=shade, mfc="none",
            lw=0.7, alpha=0.35,
        )  # fmt: skip
        left.axhline(data.floor_um2[n], color=shade, ls=":", lw=0.8, alpha=0.7)
    left.set_xscale("log")
    left.set_yscale("log")
    law = data.exponent
    left.set_title(f"(a) exponent {law.value:.3f} ({law.low:.3f} to {law.high:.3f})")
    left.set_xlabel("power of the noise W (µm²)")
    left.set_ylabel("⟨‖E‖²⟩ (µm²)")
    left.legend(loc="lower right", handletextpad=0.2, labelspacing=0.3)


def _coefficient(right: Axes, zoom: Axes, data: paper.NoiseCoefficients) -> None:
    order = np.argsort(data.levels)
    N = data.levels[order]
    right.plot(N, data.bound[order], "s--", ms=4, color=BEFORE, label="bound (25), T = L")
    for axes in (right, zoom):
        axes.plot(N, data.exact[order], "-", color=BLACK, label="exact, first input")
        axes.errorbar(
            N, data.coefficient[order], data.coefficient_error[order], fmt="o", ms=3.6,
            color=AFTER, capsize=2, label="simulated",
        )  # fmt: skip
        axes.set_xscale("log")
        _level_axis(axes, N)
        axes.set_ylabel("⟨‖E‖²⟩ from noise / W")
    right.set_yscale("log")
    for place, bound, orders in zip(N, data.bound[order], data.orders[order], strict=True):
        right.annotate(
            f"$10^{{{orders:.0f}}}$ ×", (place, bound), xytext=(0, 5), textcoords="offset points",
            ha="center", fontsize=7.5,
        )  # fmt: skip
    right.margins(x=0.12, y=0.2)
    zoom.margins(x=0.12)
    zoom.set_ylim(bottom=0.0)
    right.set_title("(b) coefficient, and bound over exact")
    zoom.set_title("(c) coefficient without bound")
    right.legend(loc="center right")


@mpl.rc_context(PRINT)
def relays_and_ramps(data: paper.HysteronComparison) -> Figure:
    """Fig. 10: residual with relays and with ramps."""
    figure, axes = _single(2.9)
    nm = 1e3
    for residual, error, law, fitted, shade, marker, name in (
        (data.relay_um, data.relay_error_um, data.relay, data.levels.size, BEFORE, "o", "relays"),
        (data.ramp_um, data.ramp_error_um, data.ramp, data.ramp_levels, AFTER, "s", "ramps"),
    ):
        label = name
        if law is not None:
            label += f": $N^{{{law.value:.2f}}}$ ({_minus(f'{law.low:.2f} to {law.high:.2f}')})"
            N, ends = data.levels[:fitted], data.levels[[0, fitted - 1]]
            through = power_law_through(N, error[:fitted], law.value, ends)
            axes.plot(ends, nm * through, color=shade)
        axes.plot(data.levels, nm * error, marker, ms=4, color=shade, label=label)
        axes.plot(data.levels, nm * residual, marker, ms=6.5, mfc="none", mec=shade, mew=0.8)
    axes.axhline(nm * data.noise_um, color=FLOOR, ls="--")
    axes.annotate(
        f"sensor noise, {nm * data.noise_um:g} nm", (data.levels[0], nm * data.noise_um),
        xytext=(0, -10), textcoords="offset points", fontsize=7.5, color=BLACK,
    )  # fmt: skip
    axes.set_xscale("log")
    axes.set_yscale("log")
    _level_axis(axes, data.levels)
    axes.set_ylabel("RMS error, filled, and\nresidual, open (nm)")
    figure.legend(loc="outside upper center", title="exponent of the error (95 % interval)")
    return figure


@mpl.rc_context(PRINT)
def recursions(data: paper.RecursionComparison) -> Figure:
    """Fig. 11: errors of the recursions, as dots on a log axis."""
    count = len(data.names)
    figure = Figure(figsize=(DOUBLE_IN, 1.0 + 0.24 * count), layout="constrained")
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    places = np.arange(count)
    for axes, hysterons, error, replay in (
        (panels[0], "relays", data.relay_error, data.relay_replay),
        (panels[1], "ramps", data.ramp_error, data.ramp_replay),
    ):
        axes.hlines(places, 100 * error, 100 * replay, color="0.8", lw=1.2)
        axes.plot(
            100 * error, places, "o", ms=5, mfc="white", mec=BEFORE, label="error e at events"
        )
        axes.plot(100 * replay, places, "o", ms=5, color=AFTER, label="replay of a new record")
        axes.set_xscale("log")
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.set_xlabel("RMS (% of the output's range)")
        axes.set_title(f"{hysterons}, N = {data.levels}")
    panels[0].set_yticks(places, data.names)
    panels[0].set_ylabel("recursion")
    panels[0].set_ylim(count - 0.5, -0.5)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


def _level_axis(axes: Axes, levels: np.ndarray) -> None:
    """Ticks at the levels themselves."""
    axes.xaxis.set_major_locator(FixedLocator(levels.tolist()))
    axes.xaxis.set_major_formatter(ScalarFormatter())
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_xlabel("levels N")


# --- all of them ---


@dataclass(frozen=True)
class PaperFigure:
    """A figure of the paper.

    Attributes:
        title: what it shows.
        data: computes its numbers; takes `progress` and what `quick` names.
        draw: draws them.
        quick: arguments with which it is computed in a few seconds.
    """

    title: str
    data: Callable[..., paper.FigureData]
    draw: Callable[[Any], Figure]
    quick: Mapping[str, Any] = field(default_factory=dict[str, Any])


_SHORT_SWEEP = {"levels": (13, 9, 5), "seeds": 2, "samples": 4000}

FIGURES: Mapping[str, PaperFigure] = {
    "1": PaperFigure("Hysteron", paper.hysteron_loops, hysteron),
    "2": PaperFigure("Adaptive hysteresis filter", paper.filter_diagram, adaptive_filter),
    "3": PaperFigure("Experiment", paper.experiment_diagram, experiment),
    "4": PaperFigure("Frequency response", paper.bode, bode, {"realisations": 2}),
    "5": PaperFigure("Input-output loops", paper.loops, loops, {"seconds": 2.0, "samples": 4000}),
    "6": PaperFigure(
        "Squared output error", paper.convergence, convergence, {"samples": 4000, "records": 2}
    ),
    "7": PaperFigure(
        "Measurement and model", paper.time_frame, time_frame, {"samples": 4000, "seconds": 0.2}
    ),
    "8": PaperFigure(
        "Residual error against quantisation noise",
        paper.proportionality,
        proportionality,
        _SHORT_SWEEP,
    ),
    "9": PaperFigure(
        "Weight error against noise, with the truth known",
        paper.coefficients,
        coefficients,
        _SHORT_SWEEP,
    ),
    "10": PaperFigure(
        "Relays against ramps",
        paper.relays_and_ramps,
        relays_and_ramps,
        {"levels": (5, 9, 13), "samples": 4000, "every": 2},
    ),
    "11": PaperFigure(
        "Recursions compared",
        paper.recursions,
        recursions,
        {"levels": 5, "samples": 2000, "passes": (1, 2)},
    ),
}
"""The figures by number: 1 to 8 are the paper's, the others go further."""


def figure_names(chosen: Sequence[str] | None, quick: bool) -> list[str]:
    """Names of the files of figures, three for each number; None is all."""
    numbers = list(FIGURES) if chosen is None else [str(number) for number in chosen]
    for number in numbers:
        if number not in FIGURES:
            raise InputError(f"there is no figure {number}: choose from {', '.join(FIGURES)}")
    stems = [f"figure_{int(number):02}{'_quick' if quick else ''}" for number in numbers]
    return [f"{stem}.{kind}" for stem in stems for kind in ("pdf", "png", "json")]


def figures(
    folder: str | Path,
    chosen: Sequence[str] | None = None,
    quick: bool = False,
    progress: Progress | None = None,
) -> list[Path]:
    """Compute and draw figures, and write each as PDF, as PNG and as the numbers behind it.

    Arguments:
        chosen: numbers of figures, as in ("4", "8"); None is all.
        quick: whether to compute short records and few realisations, to try it out.
    """
    folder = Path(folder)
    numbers = list(FIGURES) if chosen is None else [str(number) for number in chosen]
    names = figure_names(numbers, quick)
    check_folder(folder)
    written: list[Path] = []
    for place, number in enumerate(numbers):

        def show(text: str, part: float, place: int = place, number: str = number) -> None:
            if progress is not None:
                progress(f"figure {number}: {text}", (place + part) / len(numbers))

        one = FIGURES[number]
        data = one.data(progress=show, **(one.quick if quick else {}))
        drawn = one.draw(data)
        content = {"figure": int(number), "title": one.title, "quick": quick, **data.to_json()}
        paths = [folder / name for name in names[3 * place : 3 * place + 3]]
        made = (pdf(drawn), png(drawn, DPI), json_bytes(content))
        written += write_files(dict(zip(paths, made, strict=True)))
    if progress is not None:
        progress("figures are drawn", 1.0)
    return written

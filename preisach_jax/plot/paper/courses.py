"""Fig. 1 and 4 to 7: hysteron, frequency response, loops, convergence, and a stretch of time."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from preisach_jax import paper
from preisach_jax.plot.paper.style import BLACK, DOUBLE_IN, PRINT, SINGLE_IN, single
from preisach_jax.plot.style import AFTER, BEFORE, MEASURED


@mpl.rc_context(PRINT)
def hysteron(data: paper.HysteronLoops) -> Figure:
    """Fig. 1: input and output of a relay and of its ramp."""
    figure, axes = single(2.4)
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
    figure, axes = single(2.8)
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
    figure, axes = single(2.6)
    axes.plot(data.time_s, data.measured_um, color=MEASURED, lw=1.6, label="measured z")
    axes.plot(
        data.time_s, data.model_um, color=AFTER, lw=0.9, drawstyle="steps-post", label="filter ẑ"
    )
    axes.margins(x=0.02)
    axes.set_xlabel("time (s)")
    axes.set_ylabel("output (µm)")
    figure.legend(loc="outside upper center", ncols=2)
    return figure

"""Fig. 8 to 11: what depends on the levels of the plane, and the recursions compared."""

from __future__ import annotations

import itertools

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullFormatter, NullLocator, ScalarFormatter

from preisach_jax import paper
from preisach_jax.paper.noise import power_law_through
from preisach_jax.plot.paper.style import (
    BLACK,
    DOUBLE_IN,
    LEVEL_COLOURS,
    MARKERS,
    PRINT,
    minus,
    single,
)
from preisach_jax.plot.style import AFTER, BEFORE, FLOOR


@mpl.rc_context(PRINT)
def proportionality(data: paper.Proportionality) -> Figure:
    """Fig. 8: auxiliary norm against the power of the quantisation noise."""
    figure, axes = single(3.0)
    for values, line, law, shade, filled, name in (
        (data.over_events_um, data.line_events_um, data.events, AFTER, AFTER, "switching samples"),
        (data.over_samples_um, data.line_samples_um, data.samples, BEFORE, "white", "all samples"),
    ):
        label = f"{name}: {law.value:.2f} ({law.low:.2f} to {law.high:.2f})"
        axes.plot(data.line_power_um2, line, color=shade, zorder=2)
        axes.plot(
            data.noise_power_um2, values, "o", ms=5, mfc=filled, mec=shade, label=label, zorder=3
        )
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
def coefficients(data: paper.Coefficients) -> Figure:
    """Fig. 9: what noise does to the weights, and its coefficient."""
    figure = Figure(figsize=(DOUBLE_IN, 4.0), layout="constrained")
    panels = figure.subplot_mosaic([["a", "b"], ["a", "c"]], width_ratios=[1.15, 1])
    _noise_part(panels["a"], data)
    _coefficient(panels["b"], panels["c"], data)
    return figure


def _noise_part(left: Axes, data: paper.Coefficients) -> None:
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


def _coefficient(right: Axes, zoom: Axes, data: paper.Coefficients) -> None:
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
    figure, axes = single(2.9)
    nm = 1e3
    for residual, error, law, fitted, shade, marker, name in (
        (data.relay_um, data.relay_error_um, data.relay, data.levels.size, BEFORE, "o", "relays"),
        (data.ramp_um, data.ramp_error_um, data.ramp, data.ramp_levels, AFTER, "s", "ramps"),
    ):
        label = name
        if law is not None:
            label += f": $N^{{{law.value:.2f}}}$ ({minus(f'{law.low:.2f} to {law.high:.2f}')})"
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

"""Figures of residuals: clouds against what may explain them, and tests."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from preisach_jax.diagnosis import residuals as stats
from preisach_jax.escape import literal
from preisach_jax.plot.axes import record_axes, with_unit
from preisach_jax.plot.style import STYLE
from preisach_jax.plot.traces import (
    Traces,
    add_legend,
    colour,
    first_trace,
    record_of,
    residual_scale,
    shade_held_out,
)
from preisach_jax.quantity import scaled

_POINTS = 5000  # most points of a cloud

WIDE = 5.0
"""Ratio of two residuals from which the smaller one would be a flat line on a linear axis."""


@mpl.rc_context(STYLE)
def residuals(traces: Traces) -> Figure:
    """Residual against time, input, its rate, output, and time since the input last turned.

    Points are a random choice of at most 5,000 rows; lines and bands are median and 5-95 % range
    of all rows.  Where one model leaves more than `WIDE` times what the other one does, the axis is
    linear as far as the smaller residual goes, and logarithmic beyond.
    """
    record = record_of(traces)
    figure = Figure(figsize=(8.2, 7.6), layout="constrained")
    panels = figure.subplot_mosaic([["time", "time"], ["input", "rate"], ["output", "since"]])
    factor, unit = residual_scale(traces)
    limits = [factor * np.nanquantile(np.abs(t.residual), 0.999) for t in traces.values()]
    typical = [np.nanquantile(np.abs(t.residual), 0.95) for t in traces.values()]
    linear = _round_up(factor * min(typical))
    is_wide = max(limits) > WIDE * min(limits) > 0
    for key, axis in record_axes(record).items():
        axes = panels[key]
        for trace in traces.values():
            _cloud(axes, axis.values, factor * trace.residual, colour(trace))
        axes.axhline(0, color="0.3", lw=0.7)
        axes.set_ylim(-1.1 * max(limits), 1.1 * max(limits))
        if is_wide:
            _scale_both(axes, linear)
        axes.set_xlabel(literal(axis.label))
        axes.set_ylabel(with_unit("residual", unit))
        if key != "time":
            axes.locator_params(axis="x", nbins=6)
        if axis.is_logarithmic:
            axes.set_xscale("log")
    shade_held_out(panels["time"], first_trace(traces), slice(0, len(record.time)))
    title = "Residual (measured minus model): points, median, 5–95 % band"
    if is_wide:
        shown = f"±{linear:g} {unit}".rstrip()
        title += f"\nThe axis is linear within {shown} (shaded) and logarithmic beyond"
    panels["time"].set_title(title)
    panels["time"].margins(x=0.01)
    add_legend(figure, traces, measured=False)
    return figure


@mpl.rc_context(STYLE)
def residual_tests(traces: Traces) -> Figure:
    """Autocorrelation, cross-correlation with the input, and cumulated periodogram of residuals."""
    record = record_of(traces)
    longest = stats.longest_lag(record)
    drive = stats.in_sequence(record, record.input, longest)
    step = record.step_s
    figure = Figure(figsize=(8.2, 7.2), layout="constrained")
    own, crossed, spectrum = figure.subplots(3, 1)
    factor, unit = scaled(longest * step, "s")
    for trace in traces.values():
        values = stats.in_sequence(record, trace.residual, longest)
        shade = colour(trace)
        found = stats.autocorrelation(values, longest, step)
        _correlation(own, found, factor, shade)
        found = stats.cross_correlation(values, drive, longest, step)
        _correlation(crossed, found, factor, shade)
        power = stats.cumulated_periodogram(values, step)
        few = np.unique(np.geomspace(1, len(power.value), 600).astype(int)) - 1
        spectrum.plot(power.frequency_hz[few], power.value[few], color=shade, lw=1.6)
        spectrum.fill_between(
            power.frequency_hz[few],
            np.clip(power.white[few] - power.band, 0, 1),
            np.clip(power.white[few] + power.band, 0, 1),
            color="0.5", alpha=0.25, lw=0,
        )  # fmt: skip
    own.set_title("Autocorrelation of the residual")
    own.set_xlabel(f"lag ({unit})")
    own.set_ylim(-0.6, 1.05)
    crossed.set_title("Correlation of the residual with the input")
    crossed.set_xlabel(f"lag ({unit}); at positive lags the residual follows the input")
    spectrum.set_title("Cumulated periodogram of the residual")
    spectrum.set_xscale("log")
    spectrum.set_xlabel("frequency (Hz)")
    spectrum.set_ylabel("share of power")
    for axes in (own, crossed):
        axes.axhline(0, color="0.3", lw=0.7)
        axes.set_ylabel("correlation")
    band = Patch(
        color="0.5", alpha=0.35, label="shaded: 99 % band of white, uncorrelated residuals"
    )
    add_legend(figure, traces, measured=False, more=[band], held_out=False)
    return figure


def _round_up(value: float) -> float:
    """The next 1, 2 or 5 times a power of ten."""
    power = 10.0 ** np.floor(np.log10(value)) if value > 0 else 1.0
    return float(next(n * power for n in (1, 2, 5, 10) if n * power >= value * (1 - 1e-12)))


def _scale_both(axes: Axes, linear: float) -> None:
    """An axis on which a small residual is seen beside a great one, with its zero line."""
    top = axes.get_ylim()[1]
    axes.set_yscale("symlog", linthresh=linear, linscale=1.5)
    count = int(np.floor(np.log10(top / linear))) + 1
    decades = [linear * 10.0**k for k in range(count)]
    ticks = [*(-tick for tick in reversed(decades)), 0.0, *decades]
    axes.set_yticks(ticks, [f"{tick:g}".replace("-", "−") for tick in ticks])
    axes.set_yticks([], minor=True)
    axes.axhspan(-linear, linear, color="0.5", alpha=0.08, lw=0, zorder=0)
    axes.set_ylim(-top, top)


def _cloud(axes: Axes, position: np.ndarray, values: np.ndarray, shade: str) -> None:
    rows = np.flatnonzero(np.isfinite(values) & np.isfinite(position))
    if len(rows) > _POINTS:
        rows = np.sort(np.random.default_rng(0).choice(rows, _POINTS, replace=False))
    axes.plot(
        position[rows], values[rows], ".", color=shade, ms=1.6, alpha=0.25, mew=0, rasterized=True,
        zorder=1.9,  # below the lines: pixels that are drawn in a row become one picture
    )  # fmt: skip
    bins = stats.binned(position, values)
    if len(bins.centre) > 1:
        axes.fill_between(bins.centre, bins.low, bins.high, color=shade, alpha=0.22, lw=0)
        axes.plot(bins.centre, bins.median, color=shade, lw=1.8)


def _correlation(axes: Axes, found: stats.Correlation, factor: float, shade: str) -> None:
    lag = factor * found.lag_s
    axes.fill_between(lag, -found.band, found.band, color=shade, alpha=0.2, lw=0)
    axes.plot(lag, found.value, color=shade, lw=1.2)
    axes.margins(x=0.01)

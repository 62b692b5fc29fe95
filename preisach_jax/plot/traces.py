"""Simulations beside their measurement: over time, as loops, and what they leave."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from preisach_jax.diagnosis import residuals as stats
from preisach_jax.escape import literal
from preisach_jax.plot.axes import column_name, greatest, record_axes, with_unit
from preisach_jax.plot.style import AFTER, BEFORE, HELD_OUT, MEASURED, STYLE
from preisach_jax.quantity import quantity, scaled

if TYPE_CHECKING:
    from preisach_jax.diagnosis.result import Diagnosis
    from preisach_jax.record.core import Record


_COLUMNS = 2000  # bins of an envelope: about one a pixel

PAUSE = 10.0
"""Time steps, in usual ones, across which a loop is not drawn."""

JUMP = 0.1
"""Share of the input's range, from one sample to the next, across which a loop is not drawn."""


class Trace(Protocol):
    """A simulation beside its measurement."""

    @property
    def record(self) -> Record: ...
    @property
    def prediction(self) -> np.ndarray: ...
    @property
    def residual(self) -> np.ndarray: ...
    @property
    def validation(self) -> np.ndarray: ...
    @property
    def effects(self) -> tuple[str, ...]: ...


Traces = Mapping[str, Trace]
"""One or two traces of the same record by what the legend calls them."""


def before_and_after(found: Diagnosis) -> dict[str, Trace]:
    """The traces of a diagnosis: the model without effects, and the final one if it has any."""
    named: dict[str, Trace] = {"without effects": found.steps[0]}
    if found.effects:
        named["with " + " + ".join(found.effects)] = found.steps[-1]
    return named


def colour(trace: Trace) -> str:
    """The colour of a trace: one for the model without effects, one for models with some."""
    return AFTER if trace.effects else BEFORE


def worst_stretch(traces: Traces, reversals: int = 10) -> slice:
    """The rows about the greatest error of the first trace, on held-out rows."""
    first = first_trace(traces)
    record = first.record
    count = len(record.time)
    square = np.where(first.validation & record.measured, first.residual, 0.0) ** 2
    width = max(count // 100, 1)
    power = np.convolve(np.nan_to_num(square), np.ones(width), "same")
    centre = int(np.argmax(power))
    half = max(3 * count // 200, 25)
    turns = stats.reversals(record.input, None, record.starts)
    distance = np.sort(np.abs(turns - centre))
    if len(distance) > reversals:
        half = max(min(half, int(distance[reversals])), 25)
    inside = next(rows for rows in record.stretches if rows.start <= centre < rows.stop)
    return slice(max(centre - half, inside.start), min(centre + half, inside.stop))


def first_trace(traces: Traces) -> Trace:
    """The first trace, whose held-out rows and errors choose what is shown."""
    return next(iter(traces.values()))


def record_of(traces: Traces) -> Record:
    """The record that all traces simulate."""
    return first_trace(traces).record


def _name(record: Record, role: str) -> str:
    return literal(column_name(record, role))


def residual_scale(traces: Traces) -> tuple[float, str]:
    """Factor and unit in which the greatest residual of the traces reads best."""
    largest = max(greatest(trace.residual) for trace in traces.values())
    return scaled(largest, record_of(traces).output_unit)


def _envelope(time: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First, least and greatest value of each of many stretches, in order of time."""
    there = np.flatnonzero(np.isfinite(values))
    if len(there) <= 4 * _COLUMNS:
        return time[there], values[there]
    keep: list[int] = []
    for rows in np.array_split(there, _COLUMNS):
        part = values[rows]
        keep += [rows[0], rows[np.argmin(part)], rows[np.argmax(part)]]
    order = np.unique(keep)
    return time[order], values[order]


def _lines(axes: Axes, record: Record, rows: slice, values: np.ndarray, **style: Any) -> None:
    """Draw values along some rows over time, each record by itself."""
    cuts = [start - rows.start for start in _starts_within(record, rows)]
    parts = zip(np.split(record.time[rows], cuts), np.split(values, cuts), strict=True)
    for time, part in parts:
        axes.plot(*_envelope(time, part), **style)


def draw_course(axes: Axes, traces: Traces, rows: slice, what: str) -> None:
    """Draw output or residual over time, held-out rows shaded."""
    record = record_of(traces)
    if what == "output":
        factor, unit = scaled(greatest(record.output), record.output_unit)
        _lines(axes, record, rows, factor * record.output[rows], color=MEASURED, lw=2.6)
        axes.set_ylabel(with_unit(_name(record, "output"), unit))
    else:
        factor, unit = residual_scale(traces)
        axes.axhline(0, color="0.3", lw=0.7)
        axes.set_ylabel(with_unit("residual", unit))
    for trace in traces.values():
        values = trace.prediction if what == "output" else trace.residual
        values = np.where(record.measured, values, np.nan)[rows]
        _lines(axes, record, rows, factor * values, color=colour(trace), lw=1.0)
    for start in _starts_within(record, rows):
        between = record.time[start - 1 : start + 1].mean()
        axes.axvline(between, color="0.45", lw=0.9, ls=":", zorder=1)
    shade_held_out(axes, first_trace(traces), rows)
    axes.set_xlabel(record.time_label)
    axes.margins(x=0.01)


def _starts_within(record: Record, rows: slice) -> list[int]:
    """Rows at which another record starts, among some rows."""
    return [start for start in record.starts if rows.start < start < rows.stop]


def draw_loop(axes: Axes, record: Record, traces: Traces, rows: slice, width: float = 2.6) -> None:
    """Draw output against input: the measurement, and each trace over it."""
    in_factor, in_unit = scaled(greatest(record.input), record.input_unit)
    out_factor, out_unit = scaled(greatest(record.output), record.output_unit)
    # Of a million points, every n-th draws the same line.
    chosen = np.arange(len(record))[rows]
    chosen = chosen[:: max(len(chosen) // 40_000, 1)]
    u = in_factor * record.input[chosen]
    # Across a pause, or a jump between two curves, there is no curve that was measured.
    pauses = np.diff(record.time[chosen])
    usual = float(np.median(pauses)) if len(pauses) else 0.0
    jumps = np.abs(np.diff(u)) > JUMP * in_factor * record.input_range
    far = np.flatnonzero((pauses > PAUSE * usual) | jumps) + 1
    far = np.union1d(far, np.searchsorted(chosen, _starts_within(record, rows)))
    courses = [(MEASURED, width, record.output)]
    courses += [
        (colour(trace), 0.9, np.where(record.measured, trace.prediction, np.nan))
        for trace in traces.values()
    ]
    for shade, line, values in courses:
        z = out_factor * values[chosen]
        axes.plot(
            np.insert(u, far, np.nan), np.insert(z, far, np.nan), color=shade, lw=line,
            marker=".", ms=line, mew=0, rasterized=True,
        )  # fmt: skip
    axes.locator_params(axis="x", nbins=6)
    axes.set_xlabel(with_unit(_name(record, "input"), in_unit))
    axes.set_ylabel(with_unit(_name(record, "output"), out_unit))


def shade_held_out(axes: Axes, trace: Trace, rows: slice) -> None:
    """Shade the blocks of held-out rows, unless all rows are."""
    record = trace.record
    held = trace.validation[rows]
    if not trace.validation.any() or trace.validation[record.measured].all():
        return
    # Rows that were not measured lie in a block as well.
    inside = np.flatnonzero(record.measured[rows])
    flags = np.diff(held[inside].astype(int), prepend=0, append=0)
    time = record.time[rows][inside]
    for begin, end in zip(np.flatnonzero(flags > 0), np.flatnonzero(flags < 0), strict=True):
        axes.axvspan(time[begin], time[end - 1], color=HELD_OUT, alpha=0.25, lw=0, zorder=0)


def add_legend(
    figure: Figure,
    traces: Traces,
    *,
    measured: bool,
    more: Sequence[Patch] = (),
    held_out: bool = True,
) -> None:
    """Add one legend below the figure: measurement, traces, held-out rows."""
    first = first_trace(traces)
    handles = [Patch(color=MEASURED, label="measured")] if measured else []
    for name, trace in traces.items():
        text = literal(name) if measured is False or len(traces) > 1 else "model"
        handles.append(Patch(color=colour(trace), label=text))
    if held_out and not first.validation[first.record.measured].all():
        handles.append(Patch(color=HELD_OUT, alpha=0.4, label="held out from the identification"))
    handles += more
    figure.legend(handles=handles, loc="outside lower center", ncols=min(len(handles), 4))


@mpl.rc_context(STYLE)
def measured_and_model(traces: Traces) -> Figure:
    """Measured output and model over time: the whole record, and where the error is greatest."""
    record = record_of(traces)
    figure = Figure(figsize=(8.2, 6.6), layout="constrained")
    whole, zoom, rest = figure.subplots(3, 1, height_ratios=[1, 1.15, 0.85])
    rows = worst_stretch(traces)
    draw_course(whole, traces, slice(0, len(record.time)), "output")
    whole.set_title("Whole record")
    whole.axvspan(
        record.time[rows.start], record.time[rows.stop - 1], facecolor="none", edgecolor="0.2",
        lw=1.2, zorder=5,
    )  # fmt: skip
    whole.set_xlabel("")
    draw_course(zoom, traces, rows, "output")
    zoom.set_title("The framed part, where the error is largest")
    zoom.set_xlabel("")
    draw_course(rest, traces, rows, "residual")
    rest.set_title("Its residual (measured minus model)")
    add_legend(figure, traces, measured=True)
    return figure


@mpl.rc_context(STYLE)
def where_it_errs_most(traces: Traces) -> Figure:
    """Measured output and models over the stretch of the greatest error, and what they leave."""
    figure = Figure(figsize=(8.2, 4.1), layout="constrained")
    upper, lower = figure.subplots(2, 1, height_ratios=[1.3, 1], sharex=True)
    rows = worst_stretch(traces)
    draw_course(upper, traces, rows, "output")
    draw_course(lower, traces, rows, "residual")
    upper.set_xlabel("")
    lower.set_xlabel(record_of(traces).time_label)
    add_legend(figure, traces, measured=True)
    return figure


@mpl.rc_context(STYLE)
def loop(traces: Traces) -> Figure:
    """Output against input: the whole record as measured, and with models where they err most."""
    record = record_of(traces)
    figure = Figure(figsize=(8.2, 4.0), layout="constrained")
    whole, zoom = figure.subplots(1, 2)
    draw_loop(whole, record, {}, slice(0, len(record.time)), width=0.6)
    whole.set_title("Loops as measured, whole record")
    draw_loop(zoom, record, traces, worst_stretch(traces))
    zoom.set_title("Loops where the error is largest")
    add_legend(figure, traces, measured=True, held_out=False)
    return figure


@mpl.rc_context(STYLE)
def overview(fit: Trace) -> Figure:
    """One simulation at a glance: over time, as a loop, and its residual."""
    traces = {"model": fit}
    everything = slice(0, len(fit.record.time))
    figure = Figure(figsize=(8.2, 6.0), layout="constrained")
    panels = figure.subplot_mosaic([["time", "time"], ["loop", "residual"]], height_ratios=[1, 1.2])
    draw_course(panels["time"], traces, everything, "output")
    draw_loop(panels["loop"], fit.record, traces, everything)
    draw_course(panels["residual"], traces, everything, "residual")
    error = np.sqrt(np.nanmean(fit.residual[fit.validation] ** 2))
    rms = quantity(float(error), fit.record.output_unit, 3)
    panels["residual"].set_title(f"Residual; {rms} RMS held out")
    title = "Preisach model" + "".join(f" + {name}" for name in fit.effects)
    panels["time"].set_title(literal(f"{fit.record.name}: {title}"))
    add_legend(figure, traces, measured=True)
    return figure


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
    factor, unit = scaled(longest * step, record.time_unit)
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
    spectrum.set_xlabel(f"frequency ({record.frequency_unit})")
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

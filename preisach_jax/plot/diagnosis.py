"""Figures of fits and diagnoses; they compute nothing that a result should hold.

Every function returns a new `matplotlib.figure.Figure` and leaves no global state changed, so it
works in scripts, servers and notebooks alike.  A *trace* is a simulation beside its measurement:
a `Fit`, or whatever else has its record, prediction, residual, held-out rows and effects.
"""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize, PowerNorm
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import LogLocator, NullFormatter

from preisach_jax.diagnosis import residuals as stats
from preisach_jax.plot.axes import (
    column_name,
    density_scale,
    greatest,
    plane_edges,
    record_axes,
    shown_weights,
    with_unit,
)
from preisach_jax.plot.style import AFTER, BEFORE, FLOOR, HELD_OUT, MEASURED, REFUSED, STYLE
from preisach_jax.quantity import number, quantity, scaled

if TYPE_CHECKING:
    from preisach_jax.diagnosis.result import Diagnosis
    from preisach_jax.model import Model
    from preisach_jax.record import Record

_POINTS = 5000  # most points of a cloud
_COLUMNS = 2000  # bins of an envelope: about one a pixel


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
    """The traces of a diagnosis: the model without effects, and the final one if it has any.

    Arguments:
        found: the diagnosis.

    Returns:
        One or two fits by their names in legends.
    """
    named: dict[str, Trace] = {"without effects": found.steps[0]}
    if found.effects:
        named["with " + " + ".join(found.effects)] = found.steps[-1]
    return named


def colour(trace: Trace) -> str:
    """The colour of a trace: one for the model without effects, one for models with some."""
    return AFTER if trace.effects else BEFORE


@mpl.rc_context(STYLE)
def waterfall(found: Diagnosis) -> Figure:
    """Held-out error against effects added, with the floor of noise and discretisation.

    Arguments:
        found: a diagnosis.

    Returns:
        The figure; its error axis is logarithmic where the errors differ by more than tenfold.

    Example:
        >>> waterfall(found)  # doctest: +SKIP
    """
    errors = np.array([rung.rms_validation for rung in found.ladder])
    names = ["rate-independent\nPreisach model"]
    for fewer, more in zip(found.ladder, found.ladder[1:], strict=False):
        added = [name for name in more.effects if name not in fewer.effects]
        names.append("\n".join(f"+ {name}" for name in added) or "refitted")
    floor = float(np.hypot(found.budget.noise, found.budget.discretisation))
    factor, unit = scaled(errors.max(), found.budget.unit)
    errors, floor = factor * errors, factor * floor
    least = min(errors.min(), floor) if floor > 0 else errors.min()
    logarithmic = bool(errors.max() > 10 * max(least, 1e-300))
    width = min(4.2 + 1.1 * len(errors), 11)
    figure = Figure(figsize=(width, 3.6), layout="constrained")
    axes = figure.add_subplot()
    bottom = 0.5 * least if logarithmic else 0.0
    for place, error in enumerate(errors):
        shade = BEFORE if place == 0 else AFTER
        axes.bar(place, error - bottom, bottom=bottom, width=0.62, color=shade, zorder=2)
        label = f"{number(error, 3)} {unit}".rstrip()
        if place:
            saved = errors[place - 1] - error
            axes.bar(
                place, saved, bottom=error, width=0.62, color="none",
                edgecolor=AFTER, linestyle=":", hatch="///", alpha=0.35, zorder=2,
            )  # fmt: skip
            axes.plot([place - 0.69, place + 0.31], [errors[place - 1]] * 2, color="0.4", lw=0.8)
            label += f"\n−{100 * saved / errors[place - 1]:.0f} %"
        inside = logarithmic or error > 0.2 * errors.max()
        box = {"facecolor": shade, "lw": 0, "pad": 1} if inside else None
        axes.annotate(
            label, (place, error), xytext=(0, -4 if inside else 4), textcoords="offset points",
            ha="center", va="top" if inside else "bottom", color="white" if inside else "black",
            fontsize=8.5, zorder=6, bbox=box,
        )  # fmt: skip
    if floor > 0:
        axes.axhline(floor, color=FLOOR, lw=1.8, ls="--", zorder=5)
        axes.annotate(
            f"noise and\ndiscretisation\n{number(floor, 3)} {unit}".rstrip(), (1.01, floor),
            xycoords=("axes fraction", "data"), color=FLOOR, va="center", fontsize=8.5,
        )  # fmt: skip
    if logarithmic:
        axes.set_yscale("log")
        axes.set_ylim(bottom, 1.25 * errors.max())
        axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.yaxis.set_major_formatter(_plain_number)
        axes.yaxis.set_minor_formatter(NullFormatter())
    else:
        axes.set_ylim(0, 1.08 * max(errors.max(), floor))
    axes.set_xlim(-0.6, len(errors) - 0.4)
    axes.set_xticks(range(len(names)), names)
    axes.grid(axis="x", visible=False)
    axes.set_ylabel(f"held-out error, RMS ({unit})" if unit else "held-out error, RMS")
    axes.set_title("Error of the model as effects are added")
    return figure


@mpl.rc_context(STYLE)
def measured_and_model(traces: Traces) -> Figure:
    """Measured output and model over time: the whole record, and where the error is greatest.

    Arguments:
        traces: one or two simulations of a record.

    Returns:
        The figure: whole record, a stretch of it, and the residual there.
    """
    record = _record(traces)
    figure = Figure(figsize=(8.2, 6.6), layout="constrained")
    whole, zoom, rest = figure.subplots(3, 1, height_ratios=[1, 1.15, 0.85])
    rows = worst_stretch(traces)
    _course(whole, traces, slice(0, len(record.time)), "output")
    whole.set_title("Whole record")
    whole.axvspan(
        record.time[rows.start], record.time[rows.stop - 1], facecolor="none", edgecolor="0.2",
        lw=1.2, zorder=5,
    )  # fmt: skip
    whole.set_xlabel("")
    _course(zoom, traces, rows, "output")
    zoom.set_title("The stretch in the frame, where the error is greatest")
    zoom.set_xlabel("")
    _course(rest, traces, rows, "residual")
    rest.set_title("Its residual (measured less model)")
    _legend(figure, traces, measured=True)
    return figure


@mpl.rc_context(STYLE)
def where_it_errs_most(traces: Traces, words: Mapping[str, str] | None = None) -> Figure:
    """Measured output and models over the stretch of the greatest error, and what they leave.

    Arguments:
        traces: one or two simulations of a record.
        words: other words for `"measured"`, `"held out"`, `"residual"`, `"time"` and the names of
            the traces, as in another language.

    Returns:
        The figure, wide and low, for the first screen of a report.
    """
    words = words or {}
    figure = Figure(figsize=(8.2, 4.1), layout="constrained")
    upper, lower = figure.subplots(2, 1, height_ratios=[1.3, 1], sharex=True)
    rows = worst_stretch(traces)
    _course(upper, traces, rows, "output")
    _course(lower, traces, rows, "residual")
    upper.set_xlabel("")
    lower.set_xlabel(f"{words.get('time', 'time')} (s)")
    label = lower.get_ylabel()
    lower.set_ylabel(label.replace("residual", words.get("residual", "residual")))
    _legend(figure, traces, measured=True, words=words)
    return figure


@mpl.rc_context(STYLE)
def loop(traces: Traces) -> Figure:
    """Output against input: the whole record as measured, and with models where they err most.

    Arguments:
        traces: one or two simulations of a record.

    Returns:
        The figure.
    """
    record = _record(traces)
    figure = Figure(figsize=(8.2, 4.0), layout="constrained")
    whole, zoom = figure.subplots(1, 2)
    _loop(whole, record, {}, slice(0, len(record.time)), width=0.6)
    whole.set_title("Loops as measured, whole record")
    _loop(zoom, record, traces, worst_stretch(traces))
    zoom.set_title("Loops where the error is greatest")
    _legend(figure, traces, measured=True, held_out=False)
    return figure


@mpl.rc_context(STYLE)
def residuals(traces: Traces) -> Figure:
    """Residual against time, input, its rate, output, and time since the input last turned.

    Points are a random choice of at most 5,000 rows; lines and bands are median and 5-95 % range
    of all rows.

    Arguments:
        traces: one or two simulations of a record.

    Returns:
        The figure.
    """
    record = _record(traces)
    figure = Figure(figsize=(8.2, 7.6), layout="constrained")
    panels = figure.subplot_mosaic([["time", "time"], ["input", "rate"], ["output", "since"]])
    factor, unit = _residual_scale(traces)
    limit = factor * max(np.nanquantile(np.abs(t.residual), 0.999) for t in traces.values())
    for key, axis in record_axes(record).items():
        axes = panels[key]
        for trace in traces.values():
            _cloud(axes, axis.values, factor * trace.residual, colour(trace))
        axes.axhline(0, color="0.3", lw=0.7)
        axes.set_ylim(-1.1 * limit, 1.1 * limit)
        axes.set_xlabel(_plain(axis.label))
        axes.set_ylabel(with_unit("residual", unit))
        if key != "time":
            axes.locator_params(axis="x", nbins=6)
        if axis.is_logarithmic:
            axes.set_xscale("log")
    _shade_held_out(panels["time"], _first(traces), slice(0, len(record.time)))
    panels["time"].set_title("Residual (measured less model): points, median, 5–95 % band")
    panels["time"].margins(x=0.01)
    _legend(figure, traces, measured=False)
    return figure


@mpl.rc_context(STYLE)
def residual_tests(traces: Traces) -> Figure:
    """Autocorrelation, cross-correlation with the input, and cumulated periodogram of residuals.

    Arguments:
        traces: one or two simulations of a record.

    Returns:
        The figure, with 99 % bands.
    """
    record = _record(traces)
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
        color="0.5", alpha=0.35, label="shaded: 99 % band of a residual that holds nothing"
    )
    _legend(figure, traces, measured=False, more=[band], held_out=False)
    return figure


@mpl.rc_context(STYLE)
def density(model: Model) -> Figure:
    """The identified density on the Preisach plane; cells that were never visited are hatched.

    Arguments:
        model: a model.

    Returns:
        The figure.
    """
    edges, shown = plane_edges(model)
    figure = Figure(figsize=(5.6, 4.8), layout="constrained")
    axes = figure.add_subplot()
    area = (edges[1] - edges[0]) ** 2
    draw_cells(axes, model, (edges, edges), shown_weights(model) / area, "density")
    axes.plot(edges[[0, -1]], edges[[0, -1]], color="0.3", lw=0.8)
    axes.set_xlabel(with_unit("switching-off threshold β", shown))
    axes.set_ylabel(with_unit("switching-on threshold α", shown))
    axes.set_title("Density on the Preisach plane")
    visited = np.asarray(model.visited, dtype=bool)
    if not visited.all():
        share = 100 * (1 - visited.mean())
        label = f"never visited by this record ({share:.0f} % of the cells)"
        figure.legend(handles=[unvisited_patch(label)], loc="outside lower center")
    return figure


def draw_cells(
    axes: Axes,
    model: Model,
    borders: tuple[np.ndarray, np.ndarray],
    values: np.ndarray,
    name: str,
) -> None:
    """Draw a density a cell, hatch the cells that were never visited, and add a bar of colours.

    Arguments:
        axes: where to.
        model: the model.
        borders: horizontal and vertical place of the borders of cells, as for `pcolormesh`.
        values: (cells,) density in the output's unit over the square of that of `plane_edges`; NaN
            where a cell is not to be drawn.
        name: what the bar is called.
    """
    plane, visited = model.plane, np.asarray(model.visited, dtype=bool)
    drawn = ~np.isnan(values)
    values = np.where(visited, values, np.nan)
    factor, top, unit = density_scale(model, values)
    signed = model.chain.signed
    picture = axes.pcolormesh(
        *borders, np.ma.masked_invalid(factor * plane.matrix(values)), rasterized=True,
        cmap="PuOr" if signed else "viridis",
        norm=Normalize(-top, top) if signed else PowerNorm(0.5, 0, top),
    )  # fmt: skip
    unvisited = plane.matrix(np.where(drawn & ~visited, 1.0, np.nan))
    if not np.isnan(unvisited).all():
        axes.pcolor(
            *borders, np.ma.masked_invalid(unvisited), cmap="gray", vmin=0, vmax=1.12,
            hatch="xxxx", edgecolor="0.55", lw=0,
        )  # fmt: skip
    axes.set_aspect("equal")
    axes.grid(visible=False)
    bar = axes.figure.colorbar(picture, ax=axes, extend="both" if signed else "max", shrink=0.85)
    bar.set_label(with_unit(name, unit))


def unvisited_patch(label: str) -> Patch:
    """What a legend shows beside the words for cells that were never visited."""
    return Patch(facecolor="0.9", edgecolor="0.55", hatch="xxxx", label=label)


@mpl.rc_context(STYLE)
def candidates(found: Diagnosis) -> Figure:
    """Gain of every effect that was tried, and why it was added or not.

    Arguments:
        found: a diagnosis.

    Returns:
        The figure.
    """
    tried = sorted(found.candidates, key=lambda c: (c.step, not c.accepted, -c.gain))
    reasons = ["\n".join(textwrap.wrap("added" if c.accepted else c.why_not, 70)) for c in tried]
    places: list[float] = []
    headings: list[tuple[float, int]] = []
    place = 0.0
    for position, (candidate, reason) in enumerate(zip(tried, reasons, strict=True)):
        if not position or candidate.step != tried[position - 1].step:
            place += 0.35 if position else 0.0
            headings.append((place, candidate.step))
            place += 0.9
        places.append(place + 0.25 * reason.count("\n"))
        place += 1.0 + 0.5 * reason.count("\n")
    figure = Figure(figsize=(10.8, 1.1 + 0.27 * max(place, 2)), layout="constrained")
    axes = figure.add_subplot()
    gains = np.array([100 * c.gain for c in tried])
    lowest = -20.0 if np.any(gains < 0) else 0.0
    for y, gain, candidate, reason in zip(places, gains, tried, reasons, strict=True):
        shade = AFTER if candidate.accepted else REFUSED
        axes.barh(y, max(gain, lowest), height=0.7, color=shade)
        beyond = "< " if gain < lowest else ""
        shown = lowest if gain < lowest else gain
        axes.annotate(
            f"{beyond}{shown:.1f} %", (max(shown, 0), y), xytext=(4, 0),
            textcoords="offset points", va="center", fontsize=8,
        )  # fmt: skip
        axes.annotate(
            reason, (1.04, y), xycoords=("axes fraction", "data"), va="center", fontsize=8,
            color="black" if candidate.accepted else "0.35",
        )  # fmt: skip
    for y, step in headings:
        onto = " + ".join(found.effects[:step])
        text = f"on the model with {onto}" if onto else "on the model without effects"
        axes.annotate(
            text, (0, y), xycoords=("axes fraction", "data"), va="center", fontsize=8.5,
            fontweight="bold",
        )  # fmt: skip
    axes.set_yticks(places, [c.effect for c in tried])
    axes.set_ylim(place + 0.1, -0.5)
    axes.set_xlim(lowest, 115)
    axes.set_xticks(np.arange(lowest, 101, 20))
    axes.grid(axis="y", visible=False)
    axes.set_xlabel("fall of the held-out mean square (%)")
    axes.set_title("Effects that were tried")
    return figure


@mpl.rc_context(STYLE)
def overview(fit: Trace) -> Figure:
    """One simulation at a glance: over time, as a loop, and its residual.

    Arguments:
        fit: a fit, or another simulation beside its measurement.

    Returns:
        The figure.

    Example:
        >>> overview(fit).savefig("fit.png")  # doctest: +SKIP
    """
    traces = {"model": fit}
    everything = slice(0, len(fit.record.time))
    figure = Figure(figsize=(8.2, 6.0), layout="constrained")
    panels = figure.subplot_mosaic([["time", "time"], ["loop", "residual"]], height_ratios=[1, 1.2])
    _course(panels["time"], traces, everything, "output")
    _loop(panels["loop"], fit.record, traces, everything)
    _course(panels["residual"], traces, everything, "residual")
    error = np.sqrt(np.nanmean(fit.residual[fit.validation] ** 2))
    rms = quantity(float(error), fit.record.output_unit, 3)
    panels["residual"].set_title(f"Residual; {rms} RMS held out")
    title = "Preisach model" + "".join(f" + {name}" for name in fit.effects)
    panels["time"].set_title(_plain(f"{fit.record.name}: {title}"))
    _legend(figure, traces, measured=True)
    return figure


def worst_stretch(traces: Traces, reversals: int = 10) -> slice:
    """The rows about the greatest error of the first trace, on held-out rows.

    Arguments:
        traces: one or two simulations of a record.
        reversals: most turns of the input that a reader can still make out.

    Returns:
        A slice of 3 % of the record, or less.
    """
    first = _first(traces)
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


def _plain_number(value: float, position: float) -> str:
    del position  # which tick it is does not matter
    return number(value)


def _first(traces: Traces) -> Trace:
    return next(iter(traces.values()))


def _record(traces: Traces) -> Record:
    return _first(traces).record


def _plain(text: str) -> str:
    """A text in which a dollar sign starts no formula."""
    return text.replace("$", r"\$")


def _name(record: Record, role: str) -> str:
    return _plain(column_name(record, role))


def _residual_scale(traces: Traces) -> tuple[float, str]:
    largest = max(greatest(trace.residual) for trace in traces.values())
    return scaled(largest, _record(traces).output_unit)


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


def _course(axes: Axes, traces: Traces, rows: slice, what: str) -> None:
    """Draw output or residual over time, held-out rows shaded."""
    record = _record(traces)
    if what == "output":
        factor, unit = scaled(greatest(record.output), record.output_unit)
        _lines(axes, record, rows, factor * record.output[rows], color=MEASURED, lw=2.6)
        axes.set_ylabel(with_unit(_name(record, "output"), unit))
    else:
        factor, unit = _residual_scale(traces)
        axes.axhline(0, color="0.3", lw=0.7)
        axes.set_ylabel(with_unit("residual", unit))
    for trace in traces.values():
        values = trace.prediction if what == "output" else trace.residual
        values = np.where(record.measured, values, np.nan)[rows]
        _lines(axes, record, rows, factor * values, color=colour(trace), lw=1.0)
    for start in _starts_within(record, rows):
        between = record.time[start - 1 : start + 1].mean()
        axes.axvline(between, color="0.45", lw=0.9, ls=":", zorder=1)
    _shade_held_out(axes, _first(traces), rows)
    axes.set_xlabel("time (s)")
    axes.margins(x=0.01)


def _starts_within(record: Record, rows: slice) -> list[int]:
    """Rows at which another record starts, among some rows."""
    return [start for start in record.starts if rows.start < start < rows.stop]


def _loop(axes: Axes, record: Record, traces: Traces, rows: slice, width: float = 2.6) -> None:
    in_factor, in_unit = scaled(greatest(record.input), record.input_unit)
    out_factor, out_unit = scaled(greatest(record.output), record.output_unit)
    # Of a million points, every so-manyth draws the same line.
    chosen = np.arange(len(record))[rows]
    chosen = chosen[:: max(len(chosen) // 40_000, 1)]
    u = in_factor * record.input[chosen]
    # Between far apart points there is no curve that was measured.
    steps = np.abs(np.diff(u))
    usual = float(np.median(steps[steps > 0])) if np.any(steps > 0) else 0.0
    far = np.flatnonzero(steps > max(10 * usual, 0.02 * in_factor * record.input_range)) + 1
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


def _cloud(axes: Axes, position: np.ndarray, values: np.ndarray, shade: str) -> None:
    rows = np.flatnonzero(np.isfinite(values) & np.isfinite(position))
    if len(rows) > _POINTS:
        rows = np.sort(np.random.default_rng(0).choice(rows, _POINTS, replace=False))
    axes.plot(
        position[rows], values[rows], ".", color=shade, ms=1.6, alpha=0.25, mew=0, rasterized=True
    )
    bins = stats.binned(position, values)
    if len(bins.centre) > 1:
        axes.fill_between(bins.centre, bins.low, bins.high, color=shade, alpha=0.22, lw=0)
        axes.plot(bins.centre, bins.median, color=shade, lw=1.8)


def _correlation(axes: Axes, found: stats.Correlation, factor: float, shade: str) -> None:
    lag = factor * found.lag_s
    axes.fill_between(lag, -found.band, found.band, color=shade, alpha=0.2, lw=0)
    axes.plot(lag, found.value, color=shade, lw=1.2)
    axes.margins(x=0.01)


def _shade_held_out(axes: Axes, trace: Trace, rows: slice) -> None:
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


def _legend(
    figure: Figure,
    traces: Traces,
    *,
    measured: bool,
    more: Sequence[Patch] = (),
    held_out: bool = True,
    words: Mapping[str, str] | None = None,
) -> None:
    first, words = _first(traces), words or {}
    said = words.get("measured", "measured")
    handles = [Patch(color=MEASURED, label=said)] if measured else []
    for name, trace in traces.items():
        text = _plain(words.get(name, name)) if measured is False or len(traces) > 1 else "model"
        handles.append(Patch(color=colour(trace), label=text))
    if held_out and not first.validation[first.record.measured].all():
        said = words.get("held out", "held out from identification")
        handles.append(Patch(color=HELD_OUT, alpha=0.4, label=said))
    handles += more
    figure.legend(handles=handles, loc="outside lower center", ncols=min(len(handles), 4))

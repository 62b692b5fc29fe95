"""Traces, and what figures of them share.

A *trace* is a simulation beside its measurement: a `Fit`, or whatever else has its record,
prediction, residual, held-out rows and effects.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from preisach_jax.diagnosis import residuals as stats
from preisach_jax.escape import literal
from preisach_jax.plot.axes import column_name, greatest, with_unit
from preisach_jax.plot.style import AFTER, BEFORE, HELD_OUT, MEASURED
from preisach_jax.quantity import scaled

if TYPE_CHECKING:
    from preisach_jax.diagnosis.result import Diagnosis
    from preisach_jax.record import Record


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
    axes.set_xlabel("time (s)")
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

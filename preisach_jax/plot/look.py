"""A first look at a record: input and output over time with what was found, and the loop."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from preisach_jax.escape import literal
from preisach_jax.look import Look
from preisach_jax.look.drawing import extremes
from preisach_jax.plot.axes import column_name, with_unit
from preisach_jax.plot.style import AFTER, BEFORE, HELD_OUT, MEASURED, STYLE
from preisach_jax.quantity import scaled

COLUMNS = 1200
"""Stretches of time whose extremes are drawn."""

MOST_MARKED = 2000
"""Samples of a loop that are drawn; more are thinned evenly."""


@mpl.rc_context(STYLE)
def first_look(found: Look) -> Figure:
    """Draw a record before any fit."""
    figure = Figure(figsize=(8.2, 5.6), layout="constrained")
    panels = figure.subplot_mosaic([["input", "loop"], ["output", "loop"]], width_ratios=[1.7, 1.0])
    record = found.record
    _course(panels["input"], found, "input", AFTER)
    _course(panels["output"], found, "output", BEFORE)
    panels["input"].sharex(panels["output"])
    panels["input"].tick_params(labelbottom=False)
    panels["output"].set_xlabel(record.time_label)
    _loop(panels["loop"], found)
    handles, labels = panels["output"].get_legend_handles_labels()
    more, others = panels["input"].get_legend_handles_labels()
    legend = dict(zip(others + labels, more + handles, strict=True))
    if legend:
        figure.legend(legend.values(), legend.keys(), loc="outside lower center", ncols=len(legend))
    panels["input"].set_title(literal(record.name))
    return figure


def _course(axes: Axes, found: Look, role: str, shade: str) -> None:
    record = found.record
    values = record.input if role == "input" else record.output
    inside = np.delete(np.arange(len(record)), found.output_spikes if role == "output" else [])
    largest = float(np.nanmax(np.abs(values[inside])))
    factor, unit = scaled(largest, record.channels[role].unit)
    # Stretches without samples are gaps, over which nothing is drawn.
    columns = max(min(COLUMNS, len(record) // 4), 10)
    middle, low, high = extremes(record.time, factor * values, columns)
    axes.fill_between(middle, low, high, color=shade, lw=0, alpha=0.35)
    # One line through the extremes in turn, so that a thin course is seen as well.
    line = np.ravel(np.stack([low, high], axis=1))
    axes.plot(np.repeat(middle, 2), line, color=shade, lw=0.8)
    for k, rest in enumerate(found.excitation.rests):
        axes.axvspan(
            rest.begin_s, rest.begin_s + rest.length_s, color=HELD_OUT, alpha=0.35, lw=0,
            label="rest" if k == 0 else None,
        )  # fmt: skip
    for k, (row, length) in enumerate(record.gaps):
        axes.axvspan(
            record.time[row] - length, record.time[row], color=MEASURED, alpha=0.5, lw=0,
            label="gap" if k == 0 else None,
        )  # fmt: skip
    spikes = found.output_spikes if role == "output" else found.input_spikes
    low_end, high_end = float(np.nanmin(low)), float(np.nanmax(high))
    if role == "output" and spikes.size:
        kept = factor * values[inside]
        low_end, high_end = float(np.nanmin(kept)), float(np.nanmax(kept))
    if spikes.size:
        shown = np.clip(factor * values[spikes], low_end, high_end)
        axes.plot(record.time[spikes], shown, "x", color="black", ms=6, label="spike")
    if role == "output":
        for k, each in enumerate((*found.clipped, *found.stuck, *found.wrapped)):
            rows = slice(each.start, each.stop)
            axes.plot(
                record.time[rows], factor * values[rows], color="black", lw=3, alpha=0.7,
                solid_capstyle="butt", label="fault of the sensor" if k == 0 else None,
            )  # fmt: skip
    margin = 0.06 * (high_end - low_end)
    axes.set_ylim(low_end - margin, high_end + margin)
    axes.margins(x=0.01)
    axes.set_ylabel(literal(with_unit(column_name(record, role), unit)))


def _loop(axes: Axes, found: Look) -> None:
    record = found.excitation.record  # without spikes
    rows = np.flatnonzero(record.measured)
    rows = rows[:: max(1, len(rows) // (20 * MOST_MARKED))]
    factors = [
        scaled(float(np.nanmax(np.abs(values[rows]))), record.channels[role].unit)
        for role, values in (("input", record.input), ("output", record.output))
    ]
    axes.plot(
        factors[0][0] * record.input[rows], factors[1][0] * record.output[rows], color=BEFORE,
        lw=0.5, alpha=0.8,
    )  # fmt: skip
    axes.set_xlabel(literal(with_unit(column_name(record, "input"), factors[0][1])))
    axes.set_ylabel(literal(with_unit(column_name(record, "output"), factors[1][1])))
    axes.set_title("Output over input")

"""The first view: the record as it was measured, and what a look at it finds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from bokeh.layouts import column, row
from bokeh.models import ColumnDataSource, Range1d
from bokeh.plotting import figure

from preisach_jax.app.views import DRAWING, GRID, PLOTS, limits_of, span, unformatted
from preisach_jax.look import Look
from preisach_jax.plot.axes import Axis, record_axes
from preisach_jax.plot.style import BEFORE, HELD_OUT, MEASURED
from preisach_jax.record.core import Record

STRETCHES = 2_000
"""Stretches of time of which the extremes are drawn, where a record has more rows."""

MOST_MARKED = 100
"""Rests that are shaded."""


@dataclass(frozen=True, eq=False)
class Curves:
    """What of a record is drawn.

    Attributes:
        axes: its coordinates, row by row, by `"time"`, `"input"` and `"output"`.
        drawn: (row,) the rows of them that are drawn, by the same names.
    """

    axes: dict[str, Axis]
    drawn: dict[str, np.ndarray]

    @staticmethod
    def of(record: Record) -> Curves:
        """The curves of a record; of a long one the extremes."""
        rows, axes = extreme_rows(record), record_axes(record)
        shown = {name: axes[name] for name in ("time", "input", "output")}
        return Curves(shown, {name: axis.values[rows] for name, axis in shown.items()})


class FirstView:
    """Loop, output and input of a record, in which a look marks what it found.

    The figures stand in the page from the beginning, hidden and empty: to make them takes longer
    than to fill them.

    Attributes:
        layout: the Bokeh object to show.
        curves: what is drawn of the record that is shown.
        source: the rows that are drawn.
        spikes: where the marks of spikes stand, by `"input"` and `"output"`.
        rests: from when to when the input rests.
    """

    def __init__(self):
        self.curves: Curves | None = None
        self.source: ColumnDataSource = ColumnDataSource({"time": [], "input": [], "output": []})
        self.spikes = {name: ColumnDataSource({"x": [], "y": []}) for name in ("input", "output")}
        self.rests = ColumnDataSource({"x0": [], "x1": []})
        self._ranges = {name: Range1d(start=0, end=1) for name in ("time", "input", "output")}
        self._loop = self._figure("Loop", "input", "output")
        self._output = self._figure("Output", "time", "output")
        self._input = self._figure("Input", "time", "input")
        for name, drawn in (("output", self._output), ("input", self._input)):
            drawn.vstrip(
                "x0", "x1", source=self.rests, color=HELD_OUT, alpha=0.25, level="underlay"
            )
            drawn.scatter(
                "x", "y", source=self.spikes[name], marker="x", size=10, color=BEFORE, line_width=2
            )
        courses = column(self._output, self._input, sizing_mode="stretch_both")
        self.layout: Any = row(
            courses, self._loop, sizing_mode="stretch_both", stylesheets=[PLOTS, GRID]
        )

    def show(self, curves: Curves) -> None:
        """Draw a record, and whole: what was marked or zoomed in the last one is let go."""
        self.curves = curves
        self.rests.data = {"x0": [], "x1": []}
        for marks in self.spikes.values():
            marks.data = {"x": [], "y": []}
        self.source.data = dict(curves.drawn)
        for name, values in curves.drawn.items():
            span(self._ranges[name], *limits_of(values))
        for drawn, x, y in (
            (self._loop, "input", "output"), (self._output, "time", "output"),
            (self._input, "time", "input"),
        ):  # fmt: skip
            drawn.xaxis.axis_label = unformatted(curves.axes[x].label)
            drawn.yaxis.axis_label = unformatted(curves.axes[y].label)

    def mark(self, found: Look) -> None:
        """Shade the rests and mark the spikes that a look found."""
        assert self.curves is not None  # a look is at the record that is shown
        axes = self.curves.axes
        rests = found.excitation.rests[:MOST_MARKED]
        self.rests.data = {
            "x0": [rest.begin_s for rest in rests],
            "x1": [rest.begin_s + rest.length_s for rest in rests],
        }
        for name, rows in (("input", found.input_spikes), ("output", found.output_spikes)):
            self.spikes[name].data = {
                "x": axes["time"].values[rows], "y": axes[name].values[rows]
            }  # fmt: skip

    def _figure(self, title: str, x: str, y: str) -> Any:
        drawn: Any = figure(
            title=title, x_range=self._ranges[x], y_range=self._ranges[y],
            sizing_mode="stretch_both", tools="pan,box_zoom,wheel_zoom,reset,save",
            min_height=220, min_width=240, output_backend="canvas", stylesheets=[DRAWING],
        )  # fmt: skip
        drawn.line(x, y, source=self.source, color=MEASURED, width=1.5)
        drawn.toolbar.logo = None
        return drawn


def extreme_rows(record: Record, stretches: int = STRETCHES) -> np.ndarray:
    """Rows of a record to draw: all, or the extremes of input and output in many stretches.

    Returns:
        (row,) increasing rows, the first and the last among them.
    """
    count = len(record)
    if count <= 4 * stretches:
        return np.arange(count)
    chosen = [np.array([0, count - 1])]
    for values in (record.input, record.output):
        width = -(-count // stretches)
        filled = np.full(width * stretches, np.nan)
        filled[:count] = values
        table = filled.reshape(stretches, width)
        some = np.flatnonzero(np.isfinite(table).any(axis=1))
        for pick in (np.nanargmin, np.nanargmax):
            chosen.append(some * width + pick(table[some], axis=1))
    return np.unique(np.concatenate(chosen))

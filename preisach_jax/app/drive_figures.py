"""Three linked figures of a drive: the course with what is expected, its error, and the drive."""

from __future__ import annotations

from typing import Any

import numpy as np
from bokeh.layouts import column
from bokeh.models import Column, ColumnDataSource, Range1d

from preisach_jax.app.drawing import NARROW, drawn_figure, limits_of, place_legend, span
from preisach_jax.app.driving import Driven, unreached
from preisach_jax.app.statistics import MOST_ROWS
from preisach_jax.plot.axes import column_name, greatest, with_unit
from preisach_jax.plot.style import AFTER, FLOOR, MEASURED, REFUSED
from preisach_jax.quantity import pretty_unit, scaled
from preisach_jax.record import Record

SERIES = ("time", "wanted", "expected", "low", "high", "error", "drive")

TIME = "time (s)"
TITLE = "Wanted and expected output"

STACK = f"""
:host {{ min-width: 0 !important; height: max(620px, calc(100vh - 22rem)) !important; }}
{NARROW} {{ :host {{ width: 100% !important; height: 820px !important; }} }}
"""
"""Style of the figures together."""

ALONE = ":host { min-width: 0 !important; height: 360px !important; }"
"""Style of the course while nothing else is known."""


class DriveFigures:
    """The figures of one record; another course or drive changes what they show.

    Arguments:
        record: whose units and names they have.

    Attributes:
        layout: the Bokeh object to show.
        course: corners of the wanted course before its drive is found.
        rows: the rows of a drive.
        lost: the stretches that cannot be reached, from `x0` to `x1`.
    """

    def __init__(self, record: Record):
        self._record = record
        self.course: Any = ColumnDataSource({"x": [], "y": []})
        self.rows: Any = ColumnDataSource({name: [] for name in SERIES})
        self.lost: Any = ColumnDataSource({"x0": [], "x1": []})
        self._time = Range1d(start=0.0, end=1.0)
        self._output = self._output_figure()
        self._error = self._small_figure("Error (wanted minus expected)", "error")
        self._drive = self._small_figure("Drive", "drive")
        self._drive.xaxis.axis_label = TIME
        self.layout: Column = column(
            self._output, self._error, self._drive, sizing_mode="stretch_both", stylesheets=[ALONE]
        )
        self._with_result(False)

    def show_course(self, time: np.ndarray, output: np.ndarray) -> None:
        """Show a course whose drive is not known yet."""
        few = slice(None, None, -(-len(time) // 20_000))
        self.course.data = {"x": time[few], "y": output[few]}
        self.rows.data = {name: [] for name in SERIES}
        self.lost.data = {"x0": [], "x1": []}
        self._with_result(False)
        self._frame(time, output)

    def show(self, result: Driven) -> None:
        """Show a drive."""
        found, time = result.found, result.wanted.time
        error = found.wanted - found.expected
        factor, unit = scaled(greatest(error), self._record.output_unit)
        self._error.yaxis.axis_label = with_unit("error", unit)
        rows = slice(None, None, -(-len(time) // MOST_ROWS))
        values = (time, found.wanted, found.expected, found.low, found.high, factor * error)
        columns = dict(zip(SERIES, (*values, found.drive), strict=True))
        self.rows.data = {name: each[rows] for name, each in columns.items()}
        first, last = unreached(result)
        self.lost.data = {"x0": first, "x1": last}
        self.course.data = {"x": [], "y": []}
        self._with_result(True)
        if len(first):  # strips have no entry in a legend
            self._output.title.text = f"{TITLE} (grey: not reached)"
        self._frame(time, found.wanted, found.expected)

    def _with_result(self, is_there: bool) -> None:
        """Make room for the course alone, or for all figures."""
        self._error.visible = self._drive.visible = is_there
        self._output.legend.visible = is_there
        self._output.title.text = TITLE if is_there else "Wanted output"
        self._output.xaxis.axis_label = "" if is_there else TIME
        self.layout.stylesheets = [STACK if is_there else ALONE]

    def _frame(self, time: np.ndarray, *outputs: np.ndarray) -> None:
        span(self._time, float(time[0]), float(time[-1]))
        lows, highs = zip(*(limits_of(each) for each in outputs), strict=True)
        low, high = min(lows), max(highs)
        if low == high:
            low, high = low - 1.0, high + 1.0
        span(self._output.y_range, low, high)

    def _output_figure(self) -> Any:
        record = self._record
        drawn = drawn_figure(
            TITLE, "",
            with_unit(column_name(record, "output"), pretty_unit(record.output_unit)),
            min_height=220, x_range=self._time, y_range=Range1d(start=0.0, end=1.0),
        )  # fmt: skip
        self._shade(drawn)
        drawn.varea(
            "time", "low", "high", source=self.rows, fill_color=AFTER, alpha=0.25,
            legend_label="95 % band",
        )  # fmt: skip
        drawn.line("x", "y", source=self.course, color=MEASURED, width=3)
        drawn.line(
            "time", "wanted", source=self.rows, color=MEASURED, width=3, legend_label="wanted"
        )
        drawn.line(
            "time", "expected", source=self.rows, color=AFTER, width=1.5, line_dash="dashed",
            legend_label="expected",
        )  # fmt: skip
        place_legend(drawn, "top_left")
        return drawn

    def _small_figure(self, title: str, name: str) -> Any:
        record = self._record
        unit = pretty_unit(record.input_unit)
        label = with_unit(column_name(record, "input"), unit) if name == "drive" else name
        drawn = drawn_figure(title, "", label, min_height=150, x_range=self._time)
        self._shade(drawn)
        shade = FLOOR if name == "drive" else AFTER
        drawn.line("time", name, source=self.rows, color=shade, width=1.5)
        return drawn

    def _shade(self, drawn: Any) -> None:
        drawn.vstrip("x0", "x1", source=self.lost, color=REFUSED, alpha=0.5, level="underlay")

"""Four linked views of a model beside its measurement: loop, time, residual, Preisach plane."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from importlib.resources import files
from typing import Any, cast

import numpy as np
from bokeh.events import Reset, SelectionGeometry
from bokeh.layouts import column, row
from bokeh.models import (
    BoxSelectTool,
    ColorBar,
    Column,
    ColumnDataSource,
    CustomJS,
    Div,
    LinearColorMapper,
    Range1d,
    RangeSlider,
)
from bokeh.palettes import PuOr11, Viridis256
from bokeh.plotting import figure

from preisach_jax.diagnosis import residuals as stats
from preisach_jax.diagnosis.exploration import Exploration
from preisach_jax.fit.stepwise import double_precision
from preisach_jax.model import Model
from preisach_jax.operator.plane import Plane, position_on
from preisach_jax.operator.simulation import branch_starts
from preisach_jax.plot.axes import (
    density_scale,
    greatest,
    plane_edges,
    record_axes,
    shown_density,
    shown_range,
    with_unit,
)
from preisach_jax.plot.style import AFTER, BEFORE, MEASURED
from preisach_jax.quantity import scaled
from preisach_jax.record.core import Record

CHOSEN = "#CC79A7"
"""Colour of what is brushed: one of Okabe and Ito's that no curve has."""

DRAWING = ":host { filter: var(--plots); }"
"""Style of a figure: dark mode turns its light and dark over and keeps its hues."""

NARROW = "@media (max-width: 999px)"
"""The window is a phone's or a tablet's: one column, which scrolls as a whole."""

GRID = NARROW + " { :host { flex-direction: column !important; } }"
"""Style of figures side by side, which stand below each other on a phone."""

BELOW = NARROW + " { :host { order: 1; } }"
"""Style of what stands below the figures on a phone, and above them elsewhere."""

INK = ":host, .bk-slider-title, .bk-clearfix { color: var(--ink); }"
"""Style of texts beside the figures."""

PLOTS = f"""
:host {{ flex: 1 1 20rem !important; min-width: 0 !important;
  height: max(540px, calc(100vh - 21rem)) !important; }}
{NARROW} {{ :host {{ width: 100% !important; height: 1180px !important; }} }}
"""
"""Style of all figures together: they fill what the window leaves."""


def drawn_figure(title: str, x: str, y: str, **options: Any) -> Any:
    """A figure in the page's style."""
    settings: dict[str, Any] = {
        "tools": "pan,wheel_zoom,box_zoom,reset,save", "sizing_mode": "stretch_both",
        "min_width": 240, "min_height": 240,
    }  # fmt: skip
    drawn: Any = figure(
        title=title, x_axis_label=unformatted(x), y_axis_label=unformatted(y),
        stylesheets=[DRAWING], **(settings | options),
    )  # fmt: skip
    drawn.toolbar.update(logo=None, autohide=False)
    drawn.title.text_font_size = "13px"
    return drawn


def brushed(drawn: Any) -> Any:
    """A figure in which a drag of the mouse chooses rows: a stretch of time, or a rectangle."""
    brush = BoxSelectTool(dimensions="width" if drawn.title.text == "Time" else "both")
    brush.description = "Choose rows"
    brush.renderers = []  # what is chosen is shown by glyphs of its own, and alike in all views
    drawn.add_tools(brush)
    drawn.toolbar.active_drag = brush
    return drawn


def keep_ranges(drawn: Any) -> None:
    """Let the ranges of a figure follow what it shows now, and nothing that is added later.

    What is chosen is added then, on a layer of its own: a brush draws that layer anew, not curves.
    It has no place in a legend, which is drawn with the curves.
    """
    for shown in (drawn.x_range, drawn.y_range):
        shown.renderers = list(drawn.renderers)


def place_legend(drawn: Any, place: str) -> None:
    """Put the legend of a figure where it hides little; a click on a name hides its curve."""
    drawn.legend.update(
        location=place, click_policy="hide", label_text_font_size="11px", padding=4,
        background_fill_alpha=0.75, spacing=0, glyph_height=14,
    )  # fmt: skip


def span(shown: Any, start: float, end: float) -> None:
    """Show a range, also when the view is reset."""
    shown.update(start=start, end=end, reset_start=start, reset_end=end)


def limits_of(values: np.ndarray) -> tuple[float, float]:
    """Ends of an axis with a little room beside its values."""
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    return low - 0.03 * (high - low), high + 0.03 * (high - low)


def unformatted(text: str) -> str:
    """A text of which nothing is taken for a formula: Bokeh's begin with two dollar signs."""
    return text.replace("$$", "$ $").replace("\\(", "( ").replace("\\[", "[ ")


MOST_DRAWN = 100_000
"""Rows that are drawn; of a longer record every n-th, the extremes of the input kept."""


def drawn_rows(record: Record) -> np.ndarray:
    """(row,) the rows that are drawn: all, or every n-th and the turning points."""
    count = len(record)
    if count <= MOST_DRAWN:
        return np.arange(count)
    regular = np.arange(0, count, -(-count // MOST_DRAWN))
    return np.union1d(regular, stats.reversals(record.input))


def plane_course(record: Record, plane: Plane) -> tuple[np.ndarray, np.ndarray]:
    """(time,) position of the input on the plane, and that from which its branch departs.

    Returns:
        Both from 0 (lowest) to N (highest).
    """
    position = position_on(plane, record.input)
    path = np.concatenate([[0.0], position])
    with double_precision():
        start = np.asarray(branch_starts(path))
    return position, path[start][1:]


def amplitude_spectrum(record: Record, values: np.ndarray, bins: int = 800) -> dict[str, Any]:
    """Amplitude of a residual's waves over frequency; of close frequencies the greatest.

    Arguments:
        values: (time,) the residual, NaN where nothing was measured.

    Returns:
        `x` in Hz and `y` in the unit of the residual.
    """
    filled = stats.in_sequence(record, values, stats.longest_lag(record))
    there = np.isfinite(filled)
    centred = np.where(there, filled - filled[there].mean(), 0.0)
    amplitude = 2 * np.abs(np.fft.rfft(centred))[1:] / max(there.sum(), 1)
    frequency = np.fft.rfftfreq(len(centred), record.step_s)[1:]
    edges = np.unique(np.geomspace(1, len(frequency), bins).astype(int)) - 1
    highest = np.maximum.reduceat(amplitude, edges)
    stretches = zip(edges, [*edges[1:], len(amplitude)], strict=True)
    at = [begin + int(np.argmax(amplitude[begin:end])) for begin, end in stretches]
    return {"x": frequency[at], "y": np.maximum(highest, 1e-300)}


def bins_of(position: np.ndarray, values: np.ndarray) -> dict[str, Any]:
    """Median and 95 % band of values along a position, as the columns of a source."""
    found = stats.binned(position, values)
    return {name: getattr(found, name) for name in ("centre", "low", "median", "high")}


def no_bins() -> dict[str, Any]:
    """The same columns without rows."""
    return {name: [] for name in ("centre", "low", "median", "high")}


_NO_CELLS: dict[str, Any] = {"x": [], "y": [], "width": [], "height": []}


class PlaneFigure:
    """The plane of the models of one record.

    Attributes:
        figure: the Bokeh figure.
        density: density of each cell.
        cells: the cells that the chosen rows switch.
        staircase: the memory at the last of them.
    """

    def __init__(self, model: Model):
        self.density: ColumnDataSource = ColumnDataSource(
            {"x": [], "y": [], "width": [], "height": [], "value": []}
        )
        self.cells: ColumnDataSource = ColumnDataSource(_NO_CELLS)
        self.staircase: ColumnDataSource = ColumnDataSource({"x": [], "y": []})
        self._mapper = LinearColorMapper(palette=Viridis256, low=0, high=1, nan_color="#E4E4E4")
        self.figure: Any = self._drawn(plane_edges(model)[1])
        self.show(model)

    def show(self, model: Model) -> None:
        """Show the density of a model, and nothing chosen."""
        self.cells.data = _NO_CELLS
        self.staircase.data = {"x": [], "y": []}
        plane = model.plane
        edges, _ = plane_edges(model)
        widths, centres = np.diff(edges), (edges[1:] + edges[:-1]) / 2
        density = np.where(model.visited, shown_density(model), np.nan)
        factor, top, unit = density_scale(model, density)
        self.density.data = {
            "x": centres[plane.beta_index],
            "y": centres[plane.alpha_index],
            "width": widths[plane.beta_index],
            "height": widths[plane.alpha_index],
            "value": factor * density,
        }
        for shown in (self.figure.x_range, self.figure.y_range):
            span(shown, *limits_of(np.array(shown_range(model))))
        signed = model.chain.signed
        self._mapper.update(
            palette=PuOr11 if signed else Viridis256, low=-top if signed else 0.0, high=top
        )
        self.figure.title.text = unformatted(with_unit("Preisach plane: density", unit))

    def _drawn(self, unit: str) -> Any:
        drawn = brushed(
            drawn_figure(
                "Preisach plane",
                with_unit("switching-off threshold β", unit),
                with_unit("switching-on threshold α", unit),
                x_range=Range1d(),
                y_range=Range1d(),
            )
        )
        drawn.rect(
            "x", "y", "width", "height", source=self.density, line_color=None,
            fill_color={"field": "value", "transform": self._mapper},
        )  # fmt: skip
        drawn.rect(
            "x", "y", "width", "height", source=self.cells, fill_color=CHOSEN, fill_alpha=0.45,
            line_color=CHOSEN, line_alpha=0.6, level="overlay",
        )  # fmt: skip
        for shade, width in (("white", 4), ("black", 2)):
            drawn.line("x", "y", source=self.staircase, color=shade, width=width, level="overlay")
        drawn.add_layout(ColorBar(color_mapper=self._mapper, width=10), "right")
        return drawn


CLOUD = 6_000
"""Points of the residual that are drawn; its bands are those of all rows."""

_LABELS = """
function name_handles(tries) {
  const view = Bokeh.index.find_one(slider)
  const handles = view ? view.shadow_el.querySelectorAll(".noUi-handle") : []
  const names = ["First second of the stretch", "Last second of the stretch"]
  handles.forEach((handle, place) => handle.setAttribute("aria-label", names[place]))
  if (handles.length === 0 && tries > 0) setTimeout(() => name_handles(tries - 1), 200)
}
name_handles(25)
"""
"""Names for the handles of the slider, which a screen reader says."""

AXES = {
    "time": "time",
    "input": "input",
    "output": "output",
    "rate": "rate of the input",
    "since": "time since the input last turned",
    "frequency": "frequency",
}
"""What the residual can be seen against, by key, as a person reads it."""


class Views:
    """The figures of one record, which go on to another step without losing what was zoomed.

    Attributes:
        layout: the Bokeh object to show, in a page or a notebook.
        slider: chooses a stretch of time from the keyboard.
    """

    def __init__(self, step: Exploration, key: str = "time"):
        self._record = step.record
        self._step = step
        self._axis = key
        self._rows = drawn_rows(self._record)
        self._axes = record_axes(self._record)
        course = plane_course(self._record, step.fit.model.plane)
        self._course = [values[self._rows] for values in course]
        self.source: Any = ColumnDataSource(self._columns(step))
        self.highlight: ColumnDataSource = ColumnDataSource({name: [] for name in self.source.data})
        self.cloud: ColumnDataSource = ColumnDataSource({"axis": [], "residual": [], "plain": []})
        self.bins: dict[str, ColumnDataSource] = {
            name: ColumnDataSource(no_bins()) for name in ("plain", "residual")
        }
        self.spectra: dict[str, ColumnDataSource] = {
            name: ColumnDataSource({"x": [], "y": []}) for name in ("plain", "residual", "chosen")
        }
        self._begun = 0
        self._started = ColumnDataSource({"time": []})
        self.stretch: ColumnDataSource = ColumnDataSource({"first": [], "last": []})
        self.stretch.on_change("data", lambda attr, old, new: self._show_spectrum_of_chosen())
        self.told: Div = Div(text="", sizing_mode="stretch_width", stylesheets=[INK, BELOW])
        self.loop: Any = self._loop_figure()
        self.time: Any = self._time_figure()
        self.residual: Any = self._residual_figure()
        self.spectrum: Any = self._spectrum_figure()
        self.plane = PlaneFigure(step.fit.model)
        self.slider: RangeSlider = self._time_slider()
        self._figures = {
            "loop": self.loop,
            "time": self.time,
            "residual": self.residual,
            "plane": self.plane.figure,
        }
        self._show(step)
        self._link(step.fit.model)
        left = column(self.loop, self.residual, self.spectrum, sizing_mode="stretch_both")
        right = column(self.time, self.plane.figure, sizing_mode="stretch_both")
        grid = row(left, right, sizing_mode="stretch_both", stylesheets=[GRID])
        self.layout: Column = column(
            self.slider, self.told, grid, sizing_mode="stretch_both", stylesheets=[PLOTS]
        )

    def begin(self) -> None:
        """Let the browser draw what depends on nothing that was brushed."""
        self._begun += 1
        self._started.data = {"time": [self._begun]}

    @property
    def drawn_plane(self) -> Plane:
        """The plane that is drawn."""
        return self._step.steps[0].fit.model.plane

    def show(self, step: Exploration) -> None:
        """Show another step of the same record."""
        self.source.data = self._columns(step)
        self._show(step)

    def _show(self, step: Exploration) -> None:
        self._step = step
        self.highlight.data = {name: [] for name in self.source.data}
        shade = AFTER if step.effects else BEFORE
        for renderers in (self.loop.renderers, self.time.renderers, self.residual.renderers):
            for drawn in renderers:
                if drawn.name == "before":
                    drawn.visible = bool(step.effects)
                elif drawn.name == "model":
                    drawn.glyph.update(**{
                        name: shade for name in ("line_color", "fill_color")
                        if hasattr(drawn.glyph, name)
                    })  # fmt: skip
        self.plane.show(step.fit.model)
        self.show_axis(self._axis)

    def show_axis(self, key: str) -> None:
        """Show the residual against another axis, one of `AXES`."""
        self._axis = key
        self.residual.visible = key != "frequency"
        self.spectrum.visible = key == "frequency"
        self._show_spectra()
        if key == "frequency":
            return
        axis = self._axes[key]
        data = self.source.data
        position = data["axis"] = axis.values[self._rows]  # sends this column alone
        plain, residual = data["plain"], data["residual"]
        there = np.flatnonzero(np.isfinite(data["residual"]))
        few = there[:: max(len(there) // CLOUD, 1)]
        self.cloud.data = {
            "axis": position[few], "residual": residual[few], "plain": plain[few]
        }  # fmt: skip
        for name, values in (("plain", plain), ("residual", residual)):
            self.bins[name].data = bins_of(position, np.asarray(values))
        self.residual.xaxis.axis_label = unformatted(axis.label)
        limit = 1.1 * float(np.nanquantile(np.abs(plain), 0.995))
        span(self.residual.x_range, *limits_of(position))
        span(self.residual.y_range, -limit, limit)

    def _columns(self, step: Exploration) -> dict[str, Any]:
        """The columns of every view, in the units that are shown."""
        record, rows = self._record, self._rows
        out_factor, _ = self._output_scale
        left_factor, _ = self._residual_scale(step)
        plain = step.steps[0].fit
        position, departure = self._course
        return {
            **{key: axis.values[rows] for key, axis in self._axes.items()},
            "output": (out_factor * record.output)[rows],
            "model": (out_factor * _measured(step.fit))[rows],
            "before": (out_factor * _measured(plain))[rows],
            "residual": (left_factor * step.fit.residual)[rows],
            "plain": (left_factor * plain.residual)[rows],
            "axis": self._axes["time"].values[rows],
            "position": position,
            "departure": departure,
        }

    @property
    def _output_scale(self) -> tuple[float, str]:
        return scaled(greatest(self._record.output), self._record.output_unit)

    def _residual_scale(self, step: Exploration) -> tuple[float, str]:
        largest = greatest(step.steps[0].fit.residual)
        return scaled(largest, self._record.output_unit)

    def _loop_figure(self) -> Any:
        inside, outside = self._axes["input"].label, self._axes["output"].label
        drawn = brushed(drawn_figure("Loop", inside, outside))
        self._curves(drawn, "input")
        place_legend(drawn, "top_left")
        return drawn

    def _time_figure(self) -> Any:
        drawn = brushed(drawn_figure("Time", self._axes["time"].label, self._axes["output"].label))
        self._curves(drawn, "time")
        place_legend(drawn, "top_left")
        return drawn

    def _curves(self, drawn: Any, x: str) -> None:
        """Measured output, the model without effects and the present one, and what is chosen."""
        source = self.source
        drawn.line(x, "output", source=source, color=MEASURED, width=3, legend_label="measured")
        drawn.line(x, "before", source=source, color=BEFORE, name="before", legend_label="before")
        drawn.line(x, "model", source=source, color=AFTER, name="model", legend_label="model")
        keep_ranges(drawn)
        drawn.scatter(x, "output", source=self.highlight, color=CHOSEN, size=4, level="overlay")

    def _residual_figure(self) -> Any:
        _, unit = self._residual_scale(self._step)
        # Ranges of their own: those that follow the data would keep to what was drawn first.
        ranges = {"x_range": Range1d(start=0, end=1), "y_range": Range1d(start=-1, end=1)}
        label = with_unit("residual", unit)
        drawn = brushed(drawn_figure("Residual (measured minus model)", "", label, **ranges))
        for name, of, shade in (("before", "plain", BEFORE), ("model", "residual", AFTER)):
            bins = self.bins[of]
            drawn.scatter(
                "axis", of, source=self.cloud, color=shade, size=2, alpha=0.35, name=name,
                legend_label=name,
            )  # fmt: skip
            drawn.varea(
                "centre", "low", "high", source=bins, fill_color=shade, alpha=0.2, name=name
            )
            drawn.line("centre", "median", source=bins, color=shade, width=2, name=name)
        drawn.scatter(
            "axis", "residual", source=self.highlight, color=CHOSEN, size=4, level="overlay"
        )
        place_legend(drawn, "top_left")
        return drawn

    def _spectrum_figure(self) -> Any:
        _, unit = self._residual_scale(self._step)
        drawn = drawn_figure(
            "Spectrum of the residual", f"frequency ({self._record.frequency_unit})",
            with_unit("amplitude", unit),
            x_axis_type="log", y_axis_type="log", visible=False,
        )  # fmt: skip
        for name, shade, label in (
            ("plain", BEFORE, "before"), ("residual", AFTER, "model"),
            ("chosen", CHOSEN, "chosen stretch"),
        ):  # fmt: skip
            drawn.line("x", "y", source=self.spectra[name], color=shade, legend_label=label)
        place_legend(drawn, "bottom_left")
        return drawn

    def _time_slider(self) -> RangeSlider:
        time = self._record.time
        begin, end = float(time[0]), float(time[-1])
        return RangeSlider(
            title=f"Stretch of {self._record.time_label}", start=begin, end=end, value=(begin, end),
            step=(end - begin) / 1000, sizing_mode="stretch_width", format="0[.]000",
            stylesheets=[INK, BELOW],
        )  # fmt: skip

    def _show_spectra(self) -> None:
        if not self.spectrum.visible:
            return
        step = self._step
        factor, _ = self._residual_scale(step)
        traces = {"plain": step.steps[0].fit.residual, "residual": step.fit.residual}
        if not step.effects:
            del traces["plain"]
            self.spectra["plain"].data = {"x": [], "y": []}
        for name, residual in traces.items():
            self.spectra[name].data = amplitude_spectrum(self._record, factor * residual)
        self._show_spectrum_of_chosen()

    def _show_spectrum_of_chosen(self) -> None:
        first, last = (
            list(cast(Sequence[Any], self.stretch.data[name])) for name in ("first", "last")
        )
        if not (self.spectrum.visible and first and last[0] - first[0] >= 16):
            if len(cast(Sequence[Any], self.spectra["chosen"].data["x"])):
                self.spectra["chosen"].data = {"x": [], "y": []}
            return
        rows = slice(int(self._rows[first[0]]), int(self._rows[last[0]]) + 1)
        part = self._record.part(rows.start, rows.stop)
        factor, _ = self._residual_scale(self._step)
        residual = factor * self._step.fit.residual[rows]
        self.spectra["chosen"].data = amplitude_spectrum(part, residual)

    def _link(self, model: Model) -> None:
        """Let a brush in one view light up all of them, in the browser."""
        edges, _ = plane_edges(model)
        arguments = {
            "source": self.source,
            "highlight": self.highlight,
            "cells": self.plane.cells,
            "staircase": self.plane.staircase,
            "stretch": self.stretch,
            "told": self.told,
            "started": self._started,  # what no view shows must be named here to be sent
            "edges": edges,
            "colour": CHOSEN,
        }

        def linked(view: str) -> CustomJS:
            return CustomJS(args={**arguments, "view": view}, code=_linking())

        for view, drawn in self._figures.items():
            drawn.js_on_event(SelectionGeometry, linked(view))
            drawn.js_on_event(Reset, linked("nothing"))
        self.slider.js_on_change("value", linked("slider"))
        # A new step empties what was chosen: the staircase is then that of the last row.
        self._started.js_on_change("data", linked("nothing"))
        self._started.js_on_change("data", CustomJS(args={"slider": self.slider}, code=_LABELS))


@cache
def _linking() -> str:
    return files("preisach_jax.app").joinpath("linking.js").read_text(encoding="utf-8")


def _measured(fit: Any) -> np.ndarray:
    return np.where(fit.record.measured, fit.prediction, np.nan)

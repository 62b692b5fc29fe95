"""The Preisach plane of a model: its density, and the cells and the memory of what is chosen."""

from __future__ import annotations

from typing import Any

import numpy as np
from bokeh.models import ColorBar, ColumnDataSource, LinearColorMapper, Range1d
from bokeh.palettes import PuOr11, Viridis256

from preisach_jax.app.drawing import CHOSEN, brushed, drawn_figure, limits_of, span, unformatted
from preisach_jax.model import Model
from preisach_jax.plot.axes import density_scale, plane_edges, shown_density, shown_range, with_unit

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

"""The identified density on the Preisach plane."""

from __future__ import annotations

from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize, PowerNorm
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from preisach_jax.plot.axes import density_scale, plane_edges, shown_density, shown_range, with_unit
from preisach_jax.plot.style import STYLE

if TYPE_CHECKING:
    from preisach_jax.model import Model


@mpl.rc_context(STYLE)
def density(model: Model) -> Figure:
    """The identified density on the Preisach plane; cells that were never visited are hatched."""
    edges, shown = plane_edges(model)
    figure = Figure(figsize=(5.6, 4.8), layout="constrained")
    axes = figure.add_subplot()
    draw_cells(axes, model, (edges, edges), shown_density(model), "density")
    axes.plot(edges[[0, -1]], edges[[0, -1]], color="0.3", lw=0.8)
    axes.set_xlabel(with_unit("switching-off threshold β", shown))
    axes.set_ylabel(with_unit("switching-on threshold α", shown))
    low, high = shown_range(model)
    axes.set(xlim=(low, high), ylim=(low, high))
    part = (
        "" if low == edges[0] else f": part of {edges[0]:.3g} to {edges[-1]:.3g} {shown}".rstrip()
    )
    axes.set_title(f"Density on the Preisach plane{part}")
    visited = np.asarray(model.visited, dtype=bool)
    if not visited.all():
        share = 100 * (1 - visited.mean())
        label = f"never visited by this record ({share:.0f} % of the cells)"
        figure.legend(handles=[unvisited_patch(label)], loc="outside lower center")
    return figure


def draw_cells(
    axes: Axes, model: Model, borders: tuple[np.ndarray, np.ndarray], values: np.ndarray, name: str
) -> None:
    """Draw a density a cell, hatch the cells that were never visited, and add a bar of colours.

    Arguments:
        values: (cells,) density in the output's unit over the square of that of `plane_edges`; NaN
            where a cell is not to be drawn.
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

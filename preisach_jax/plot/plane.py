"""The identified density: on the Preisach plane, and as the diagram of reversal curves."""

from __future__ import annotations

from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize, PowerNorm
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from preisach_jax.plot.axes import (
    density_scale,
    plane_edges,
    shown_density,
    shown_range,
    shown_weights,
    with_unit,
)
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


@mpl.rc_context(STYLE)
def forc_diagram(model: Model) -> Figure:
    r"""The density of a model against Hc = (α - β)/2 and Hu = (α + β)/2, as FORC diagrams show it.

    A curve that turns upward at Ha = β and has come to Hb = α has switched on what lies between,
    so that
    \[ \rho(H_a, H_b) = -\frac12 \frac{\partial^2 M}{\partial H_a\, \partial H_b}
       = \frac{R}{2\, \delta x^2} : \]
    half the density R/δx² of hysterons that switch between 0 and 1. The diagram is that of the
    model's hysterons alone, without the effects around them, smooth as far as the cells and the
    fit make it so. Reversible cells, on the diagonal α = β or Hc = 0, have no reversal curve; they
    are left out, and the legend says how much of the sum of all weights they hold. Over the plane
    of Ha and Hb, 2ρ adds up to the rest of that sum; over that of Hc and Hu, 4ρ does.

    Arguments:
        model: a model; fields are in the unit of its input, ρ is in that of its output over the
            square of the former.
    """
    plane = model.plane
    edges, shown = plane_edges(model)
    alpha, beta = np.meshgrid(edges, edges, indexing="ij")
    turns = plane.alpha_index != plane.beta_index
    weights = shown_weights(model)
    values = np.where(turns, shown_density(model) / 2, np.nan)
    figure = Figure(figsize=(4.4, 5.6), layout="constrained")
    axes = figure.add_subplot()
    draw_cells(axes, model, ((alpha - beta) / 2, (alpha + beta) / 2), values, "FORC density ρ")
    axes.axhline(0, color="0.3", lw=0.8)
    low, high = shown_range(model)
    axes.set_xlim(0, (high - low) / 2)
    axes.set_ylim(low, high)
    axes.set_xlabel(with_unit("Hc = (α - β)/2", shown))
    axes.set_ylabel(with_unit("Hu = (α + β)/2", shown))
    total = weights.sum()
    share = 100 * weights[~turns].sum() / total if total > 0 else 0.0
    axes.set_title("FORC diagram")
    said = [
        Patch(facecolor="none", label=f"reversible (Hc = 0), not drawn: {share:.0f} % of the sum")
    ]
    if not np.asarray(model.visited, dtype=bool)[turns].all():
        said.append(unvisited_patch("never visited by this record"))
    figure.legend(handles=said, loc="outside lower center")
    return figure

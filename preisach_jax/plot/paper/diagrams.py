"""Fig. 2 and 3: the filter and the experiment as boxes and wires."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyArrowPatch, Rectangle

from preisach_jax import paper
from preisach_jax.plot.paper.style import BLACK, DOUBLE_IN, PRINT, minus
from preisach_jax.plot.style import AFTER

Place = tuple[float, float]

FILTER_PLACES: Mapping[str, tuple[float, float, float, float]] = {
    # centre and size, in inches
    "plant": (1.05, 3.1, 1.0, 0.62),
    "noise": (2.35, 3.1, 0.26, 0.0),
    "delay_z": (3.6, 2.55, 0.5, 0.36),
    "difference_z": (4.75, 3.1, 0.26, 0.0),
    "hysterons": (1.05, 1.65, 1.0, 0.62),
    "sum": (2.45, 1.65, 0.8, 0.62),
    "delay_model": (3.6, 2.15, 0.5, 0.36),
    "difference_model": (4.75, 1.65, 0.26, 0.0),
    "error": (5.55, 2.38, 0.26, 0.0),
    "switching": (1.05, 0.5, 1.0, 0.62),
    "update": (3.3, 0.5, 1.06, 0.62),
    "rate": (5.55, 0.5, 0.86, 0.62),
}

FILTER_WIRES: Mapping[tuple[str, str], tuple[tuple[Place, ...], Place | None]] = {
    # source and target: corners, and where the symbol is written
    ("", "plant"): (((0.0, 3.1), (0.55, 3.1)), (0.02, 3.2)),
    ("", "hysterons"): (((0.25, 3.1), (0.25, 1.65), (0.55, 1.65)), None),
    ("", "noise"): (((2.35, 3.6), (2.35, 3.23)), (2.42, 3.46)),
    ("plant", "noise"): (((1.55, 3.1), (2.22, 3.1)), None),
    ("noise", "difference_z"): (((2.48, 3.1), (4.62, 3.1)), (2.58, 3.18)),
    ("noise", "delay_z"): (((2.95, 3.1), (2.95, 2.55), (3.35, 2.55)), None),
    ("delay_z", "difference_z"): (((3.85, 2.55), (4.75, 2.55), (4.75, 2.97)), (3.93, 2.62)),
    ("hysterons", "sum"): (((1.55, 1.65), (2.05, 1.65)), (1.62, 1.7)),
    ("sum", "difference_model"): (((2.85, 1.65), (4.62, 1.65)), (3.1, 1.47)),
    ("sum", "delay_model"): (((2.95, 1.65), (2.95, 2.15), (3.35, 2.15)), None),
    ("delay_model", "difference_model"): (((3.85, 2.15), (4.75, 2.15), (4.75, 1.78)), (3.93, 2.22)),
    ("difference_z", "error"): (((4.88, 3.1), (5.55, 3.1), (5.55, 2.51)), (5.1, 3.18)),
    ("difference_model", "error"): (
        ((4.88, 1.65), (5.25, 1.65), (5.25, 2.38), (5.42, 2.38)),
        (4.93, 1.73),
    ),
    ("error", "rate"): (((5.68, 2.38), (6.2, 2.38), (6.2, 0.5), (5.98, 0.5)), (5.86, 2.46)),
    ("hysterons", "switching"): (((1.05, 1.34), (1.05, 0.81)), (1.12, 1.02)),
    ("switching", "update"): (((1.55, 0.58), (2.77, 0.58)), (2.0, 0.65)),
    ("switching", "rate"): (((1.05, 0.19), (1.05, 0.02), (5.55, 0.02), (5.55, 0.19)), (2.0, 0.06)),
    ("rate", "update"): (((5.12, 0.5), (3.83, 0.5)), (4.35, 0.58)),
    ("update", "sum"): (((3.3, 0.81), (3.3, 1.1), (2.45, 1.1), (2.45, 1.34)), (2.8, 1.14)),
}


@mpl.rc_context(PRINT)
def adaptive_filter(data: paper.Diagram) -> Figure:
    """Fig. 2: data flow of the adaptive filter."""
    figure, axes = _blank(6.4, 3.75)
    for block in data.blocks:
        x, y, width, height = FILTER_PLACES[block.name]
        if height:
            _box(axes, (x, y), (width, height), block)
        else:
            _junction(axes, (x, y), width, block)
    for signal in data.signals:
        corners, place = FILTER_WIRES[signal.source, signal.target]
        _wire(axes, corners)
        if place is not None:
            axes.text(*place, minus(signal.symbol), fontsize=8, va="bottom")
    # Where a wire branches off, and the signs at the differences.
    for x, y in ((0.25, 3.1), (2.95, 3.1), (2.95, 1.65)):
        axes.add_patch(Circle((x, y), 0.03, color=BLACK))
    for x, y, sign in (
        (4.45, 3.16, "+"), (4.82, 2.8, "−"), (4.45, 1.45, "+"), (4.82, 1.86, "−"),
        (5.62, 2.56, "+"), (5.3, 2.2, "−"),
    ):  # fmt: skip
        axes.text(x, y, sign, fontsize=8)
    return figure


@mpl.rc_context(PRINT)
def experiment(data: paper.Diagram) -> Figure:
    """Fig. 3: structure of the experiment, in two rows of boxes."""
    figure, axes = _blank(DOUBLE_IN, 2.0)
    size = (1.5, 0.72)
    places = [(x, y) for y in (1.45, 0.45) for x in (1.0, 3.25, 5.5)]
    for block, place in zip(data.blocks, places, strict=True):
        _box(axes, place, size, block)
    for number, signal in enumerate(data.signals):
        x, y = places[number]
        begin = (x + size[0] / 2, y)
        if number == 2:  # from the first row down to the second one
            turn = ((6.7, y), (6.7, 0.95), (0.02, 0.95), (0.02, 0.45), (0.25, 0.45))
            _wire(axes, (begin, *turn))
            axes.text(6.42, y + 0.05, signal.symbol, fontsize=8)
            continue
        end = (places[number + 1][0] - size[0] / 2, y) if number < 5 else (7.1, y)
        _wire(axes, (begin, end))
        axes.text(
            (begin[0] + end[0]) / 2, y + 0.05, signal.symbol, fontsize=8, ha="center", va="bottom"
        )
    return figure


def _blank(width: float, height: float) -> tuple[Figure, Axes]:
    """A figure whose coordinates are inches."""
    figure = Figure(figsize=(width, height))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(-0.05, width - 0.05), ylim=(-0.05, height - 0.05))
    axes.axis("off")
    return figure, axes


def _box(axes: Axes, centre: Place, size: Place, block: paper.Block) -> None:
    corner = (centre[0] - size[0] / 2, centre[1] - size[1] / 2)
    axes.add_patch(Rectangle(corner, *size, facecolor="#EAF3FA", edgecolor=AFTER, lw=1.0, zorder=3))
    text = f"{block.text}\n{block.equation}".rstrip()
    axes.text(*centre, text, ha="center", va="center", fontsize=7.5, zorder=4, linespacing=1.15)


def _junction(axes: Axes, centre: Place, width: float, block: paper.Block) -> None:
    axes.add_patch(Circle(centre, width / 2, facecolor="white", edgecolor=BLACK, lw=1.0, zorder=3))
    axes.text(*centre, block.text, ha="center", va="center_baseline", fontsize=9, zorder=4)
    if block.equation:
        axes.text(centre[0] + 0.14, centre[1] - 0.3, block.equation, fontsize=7.5)


def _wire(axes: Axes, corners: Sequence[Place]) -> None:
    *way, before = corners[:-1]
    for begin, end in itertools.pairwise([*way, before]):
        axes.plot(*zip(begin, end, strict=True), color=BLACK, lw=0.9, solid_capstyle="projecting")
    axes.add_patch(
        FancyArrowPatch(
            before, corners[-1], arrowstyle="-|>", mutation_scale=8, color=BLACK, lw=0.9,
            shrinkA=0, shrinkB=0,
        )
    )  # fmt: skip

"""What the paper's figures share: sizes in print, colours and marks."""

from __future__ import annotations

from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from preisach_jax.plot.style import STYLE

SINGLE_IN, DOUBLE_IN = 3.5, 7.2  # width of one column in print, and of two
BLACK = "#000000"
LEVEL_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000")
MARKERS = "osD^vP*"

PRINT: dict[Any, Any] = {
    **STYLE,
    "font.size": 8,
    "axes.titlesize": 8,
    "axes.labelsize": 8,
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5,
    "legend.fontsize": 7.5,
    "lines.linewidth": 1.0,
    "mathtext.fontset": "dejavusans",
}


def single(height: float) -> tuple[Figure, Axes]:
    """A figure of one column in print, and its axes."""
    figure = Figure(figsize=(SINGLE_IN, height), layout="constrained")
    return figure, figure.add_subplot()


def minus(text: str) -> str:
    """The text with the sign that numbers on axes have."""
    return text.replace("-", "−")

"""The paper's figures, and three that go further, drawn from their numbers and written to files."""

from preisach_jax.plot.paper.courses import bode, convergence, hysteron, loops, time_frame
from preisach_jax.plot.paper.diagrams import adaptive_filter, experiment
from preisach_jax.plot.paper.figures import FIGURES, PaperFigure, figure_names, figures
from preisach_jax.plot.paper.levels import (
    coefficients,
    proportionality,
    recursions,
    relays_and_ramps,
)
from preisach_jax.plot.paper.style import DOUBLE_IN, LEVEL_COLOURS, MARKERS, PRINT, SINGLE_IN

__all__ = [
    "DOUBLE_IN",
    "FIGURES",
    "LEVEL_COLOURS",
    "MARKERS",
    "PRINT",
    "SINGLE_IN",
    "PaperFigure",
    "adaptive_filter",
    "bode",
    "coefficients",
    "convergence",
    "experiment",
    "figure_names",
    "figures",
    "hysteron",
    "loops",
    "proportionality",
    "recursions",
    "relays_and_ramps",
    "time_frame",
]

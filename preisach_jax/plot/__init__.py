"""Figures from result objects, each a new `matplotlib.figure.Figure`."""

from preisach_jax.plot.diagnosis import (
    Trace,
    Traces,
    before_and_after,
    candidates,
    colour,
    density,
    loop,
    measured_and_model,
    overview,
    residual_tests,
    residuals,
    waterfall,
    worst_stretch,
)
from preisach_jax.plot.forc import forc_diagram
from preisach_jax.plot.style import AFTER, BEFORE, FLOOR, HELD_OUT, MEASURED, REFUSED, pdf, png, svg

__all__ = [
    "AFTER",
    "BEFORE",
    "FLOOR",
    "HELD_OUT",
    "MEASURED",
    "REFUSED",
    "Trace",
    "Traces",
    "before_and_after",
    "candidates",
    "colour",
    "density",
    "forc_diagram",
    "loop",
    "measured_and_model",
    "overview",
    "pdf",
    "png",
    "residual_tests",
    "residuals",
    "svg",
    "waterfall",
    "worst_stretch",
]

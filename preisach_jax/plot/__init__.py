"""Figures from result objects; they compute nothing that a result should hold.

Every function returns a new `matplotlib.figure.Figure` and leaves no global state changed, so it
works in scripts, servers and notebooks alike.
"""

from preisach_jax.plot.diagnosis import candidates, waterfall
from preisach_jax.plot.plane import density, forc_diagram
from preisach_jax.plot.style import AFTER, BEFORE, FLOOR, HELD_OUT, MEASURED, REFUSED, pdf, png, svg
from preisach_jax.plot.traces import (
    Trace,
    Traces,
    before_and_after,
    colour,
    loop,
    measured_and_model,
    overview,
    residual_tests,
    residuals,
    where_it_errs_most,
    worst_stretch,
)

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
    "where_it_errs_most",
    "worst_stretch",
]

"""The figures of the paper, and three that go further, as numbers.

One function a figure, whose result holds what is drawn and what was fitted to it. All compute in
double precision whatever JAX is set to; what they draw at random follows from a seed.
"""

from preisach_jax.paper.comparison import (
    HysteronComparison,
    RecursionComparison,
    recursions,
    relays_and_ramps,
)
from preisach_jax.paper.noise import (
    NoiseCoefficients,
    Proportionality,
    coefficients,
    exact_coefficients,
    noise_sweep,
    proportionality,
)
from preisach_jax.paper.numbers import (
    Arrow,
    Block,
    Bode,
    Convergence,
    Diagram,
    FigureData,
    Hinge,
    HysteronLoops,
    Loops,
    TimeFrame,
    bode,
    convergence,
    experiment_diagram,
    filter_diagram,
    fit_hinge,
    hysteron_loops,
    knee_interval,
    loops,
    time_frame,
)

__all__ = [
    "Arrow",
    "Block",
    "Bode",
    "Convergence",
    "Diagram",
    "FigureData",
    "Hinge",
    "HysteronComparison",
    "HysteronLoops",
    "Loops",
    "NoiseCoefficients",
    "Proportionality",
    "RecursionComparison",
    "TimeFrame",
    "bode",
    "coefficients",
    "convergence",
    "exact_coefficients",
    "experiment_diagram",
    "filter_diagram",
    "fit_hinge",
    "hysteron_loops",
    "knee_interval",
    "loops",
    "noise_sweep",
    "proportionality",
    "recursions",
    "relays_and_ramps",
    "time_frame",
]

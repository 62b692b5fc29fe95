"""Identification of a model from a record by separable least squares.

Weights, offset, initial memory and coefficients of added effects are linear and solved for;
the one to few nonlinear parameters of the effects are found outside, from a coarse grid by
Gauss-Newton steps with derivatives through the model.
"""

from preisach_jax.identify.gauss_newton import Linearised, linearise, refine, starts_of, stepped
from preisach_jax.identify.problem import (
    ALL,
    BLOCKS,
    FOLDS,
    IDENTIFICATION,
    VALIDATION,
    Point,
    Problem,
    evaluate,
    thinned_rows,
    with_all_rows,
    with_strength,
)

__all__ = [
    "ALL",
    "BLOCKS",
    "FOLDS",
    "IDENTIFICATION",
    "VALIDATION",
    "Linearised",
    "Point",
    "Problem",
    "evaluate",
    "linearise",
    "refine",
    "starts_of",
    "stepped",
    "thinned_rows",
    "with_all_rows",
    "with_strength",
]

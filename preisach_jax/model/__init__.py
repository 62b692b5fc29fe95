"""A model with its numbers: what it predicts, and its file."""

from preisach_jax.model.model import (
    RANGE_TOLERANCE,
    Model,
    Prediction,
    check_clock,
    check_not_inside,
    exactly_summable,
    past_sentence,
    without_effects,
)
from preisach_jax.model.origin import FORMAT_VERSION, Origin, ParameterEstimate

__all__ = [
    "FORMAT_VERSION",
    "RANGE_TOLERANCE",
    "Model",
    "Origin",
    "ParameterEstimate",
    "Prediction",
    "check_clock",
    "check_not_inside",
    "exactly_summable",
    "past_sentence",
    "without_effects",
]

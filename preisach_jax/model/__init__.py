"""A model with its numbers: what it predicts, and its file."""

from preisach_jax.model.content import FORMAT_VERSION
from preisach_jax.model.core import Model
from preisach_jax.model.estimates import ParameterEstimate, Prediction
from preisach_jax.model.mechanical import check_not_inside
from preisach_jax.model.origin import Origin
from preisach_jax.model.requirements import RANGE_TOLERANCE
from preisach_jax.model.weights import exactly_summable
from preisach_jax.model.without import without_effects

__all__ = [
    "FORMAT_VERSION",
    "RANGE_TOLERANCE",
    "Model",
    "Origin",
    "ParameterEstimate",
    "Prediction",
    "check_not_inside",
    "exactly_summable",
    "without_effects",
]

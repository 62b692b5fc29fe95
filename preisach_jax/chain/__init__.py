"""The signal chain: input effects, Preisach operator, weight, output, added and sensor effects."""

from preisach_jax.chain.coefficients import Coefficients, Columns, coarsened
from preisach_jax.chain.description import MIDDLE, PLACES, Chain, EffectValues
from preisach_jax.chain.driven import drive, driven_path
from preisach_jax.chain.hysteresis import (
    HysteresisColumns,
    first_run_output,
    hysteresis_columns,
    hysteresis_output,
    stated_start,
)
from preisach_jax.chain.matrix import columns_behind, regressors
from preisach_jax.chain.output import behind_hysteresis, response, responses, sensed, tangents
from preisach_jax.chain.signals import Drive, ThinnedSignals, signals_of

__all__ = [
    "MIDDLE",
    "PLACES",
    "Chain",
    "Coefficients",
    "Columns",
    "Drive",
    "EffectValues",
    "HysteresisColumns",
    "ThinnedSignals",
    "behind_hysteresis",
    "coarsened",
    "columns_behind",
    "drive",
    "driven_path",
    "first_run_output",
    "hysteresis_columns",
    "hysteresis_output",
    "regressors",
    "response",
    "responses",
    "sensed",
    "signals_of",
    "stated_start",
    "tangents",
]

"""The paper's experiment in JAX: command, notch filter (26), piezo stage, encoder, at 5 kHz.

A simulated world that shares no code with the models. For many records, map `experiment` over keys.
"""

from preisach_jax.piezo.notch import (
    NOTCH_DENOMINATOR,
    NOTCH_NUMERATOR,
    RATE_HZ,
    Modes,
    linear_filter,
    notch_filter,
    resonances,
)
from preisach_jax.piezo.records import PiezoRecord, encode, experiment
from preisach_jax.piezo.stage import PLAYS, PiezoStage, paper_stage

__all__ = [
    "NOTCH_DENOMINATOR",
    "NOTCH_NUMERATOR",
    "PLAYS",
    "RATE_HZ",
    "Modes",
    "PiezoRecord",
    "PiezoStage",
    "encode",
    "experiment",
    "linear_filter",
    "notch_filter",
    "paper_stage",
    "resonances",
]

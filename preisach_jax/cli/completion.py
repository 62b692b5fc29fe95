"""What the shell offers when a word is completed; files it completes by itself."""

from __future__ import annotations

EFFECT_NAMES = (
    "ageing",
    "creep",
    "delay",
    "drift",
    "eddy_currents",
    "excess_loss",
    "hum",
    "input_lag",
    "input_quantisation",
    "leakage",
    "log_rate",
    "moving",
    "operator_creep",
    "output_lag",
    "output_nonlinearity",
    "output_quantisation",
    "rate_dependence",
    "reptation",
    "resonance",
    "restoring_force",
    "slew_limit",
    "viscosity",
)
"""The built-in effects; to ask the library itself would take seconds at every press of a key."""


def complete_effect(incomplete: str) -> list[str]:
    """Names of effects that begin so."""
    return [name for name in EFFECT_NAMES if name.startswith(incomplete)]


def complete_effects(incomplete: str) -> list[str]:
    """Lists of effects that go on so; each effect stands in a list once."""
    before, comma, last = incomplete.rpartition(",")
    taken = before.split(",")
    return [before + comma + name for name in complete_effect(last) if name not in taken]

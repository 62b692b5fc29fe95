"""Excitations: what to play to an actuator in order to see its hysteresis and its other effects."""

from preisach_jax.signals.diagnostic import diagnostic_record
from preisach_jax.signals.periodic import chirp, decaying_triangles, multisine, staircase, triangle
from preisach_jax.signals.stochastic import bernoulli_ramp, random_steps

__all__ = [
    "bernoulli_ramp",
    "chirp",
    "decaying_triangles",
    "diagnostic_record",
    "multisine",
    "random_steps",
    "staircase",
    "triangle",
]

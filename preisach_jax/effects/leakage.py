"""Leakage: the reading forgets what is constant, as that of a charge amplifier does."""

from __future__ import annotations

from dataclasses import replace

import jax.numpy as jnp
from jaxtyping import Array

from preisach_jax.effects.base import RATES, OutputEffect, Survey
from preisach_jax.effects.linear import StateSpace, relaxations
from preisach_jax.effects.parameter import time_constant


class Leakage(OutputEffect):
    r"""First-order high-pass of the output: \(\dot z = \dot h - z/\tau\).

    The reading begins at zero, where the machine has been at rest for long or the amplifier has
    just been reset; the model's offset is what it settles to.

    Arguments:
        tau_low_s, tau_high_s: bounds of the search for the time constant, in s.

    Example:
        >>> import jax, numpy as np
        >>> t = np.linspace(0.0, 1.0, 101)
        >>> z = jax.jit(Leakage(tau_s=0.5).apply)(np.where(t > 0.0, 1.0, 0.0), t)
        >>> round(float(z[-1]), 3)  # exp(-2), less half a sample
        0.137
    """

    name = "leakage"
    rank = 22
    in_words = "a leakage of the reading (a constant output decays to zero)"
    physics = (
        "A charge amplifier loses its charge through the resistor of its feedback and the "
        "insulation of its cable, an integrator behind a pick-up coil is given a corner against "
        "drift, and an amplifier with AC coupling passes no constant: the reading follows what is "
        "fast, and whatever stays decays to zero with one time constant."
    )
    source = (
        "G. Gautschi, Piezoelectric Sensorics, Springer 2002, ch. 11 (time constant and drift of "
        "charge amplifiers); F. Fiorillo, Measurement and Characterization of Magnetic Materials, "
        "Elsevier 2004, ch. 7 (integrators)"
    )
    signature = (
        "residual that decays towards the middle of the loop wherever the input rests, most where "
        "it rests far from there"
    )
    confused_with = ("creep", "drift")
    needs = (RATES,)
    experiment = (
        "holds of increasing length after moves in both directions: a leakage goes back against "
        "the move and by one exponential, a creep goes on with the move and over decades"
    )
    tau_low_s: float = 0.1
    tau_high_s: float = 100.0
    tau_s: float = time_constant("time constant of the decay", margins=(2, 2))

    def bound_to(self, survey: Survey) -> Leakage:
        return replace(self, tau_low_s=20 * survey.step_s, tau_high_s=10 * survey.duration_s)

    def state_space(self, dt: Array) -> StateSpace:
        a, b = relaxations(jnp.atleast_1d(self.tau_s), dt)
        return StateSpace(a, b, -jnp.ones((1, 1)), jnp.zeros(()))

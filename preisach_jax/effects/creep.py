"""Creep: the output goes on moving after the input has stopped."""

from __future__ import annotations

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from preisach_jax.effects.base import RATES, OutputEffect, Signals, Survey
from preisach_jax.effects.linear import StateSpace, relaxations
from preisach_jax.effects.parameter import Parameter, coefficient, log_grid, parameter


def creep_times(survey: Survey) -> tuple[float, ...]:
    """Time constants of the elements of a creep that a record can show, in s."""
    # Shorter elements than these are a lag, longer ones a ramp in disguise.
    low = max(min(survey.duration_s / 1000, 50 * survey.step_s), 10 * survey.step_s)
    return log_grid(min(low, survey.duration_s / 10), survey.duration_s, per_decade=2)


class Creep(OutputEffect):
    r"""Linear creep: \(z = h + \sum_i c_i\, y_i,\ \tau_i \dot y_i = h - y_i,\ c_i \ge 0\).

    Arguments:
        tau_s: time constants of the Kelvin-Voigt elements, in s, about evenly spaced on a
            logarithmic scale; set from the record by `bound_to`.

    Example:
        >>> [p.name for p in Creep(tau_s=(0.1, 1.0)).parameters()]
        ['c_1', 'c_2']
    """

    name = "creep"
    rank = 1
    in_words = "creep (the output goes on moving after the input has stopped)"
    physics = (
        "Domains go on switching by thermal activation after the field has settled, so the stroke "
        "of a piezo actuator grows with the logarithm of time, by one or two per cent a decade. "
        "A chain of springs and dampers (Kelvin-Voigt elements) with time constants spread evenly "
        "over the decades reproduces it."
    )
    source = (
        "D. Croft, G. Shed, S. Devasia, J. Dyn. Syst. Meas. Control 123 (2001) 35-43; "
        "H. Jung, D.-G. Gweon, Rev. Sci. Instrum. 71 (2000) 1896-1900"
    )
    signature = (
        "slow exponential tails after every step and in every hold, in the direction of the move"
    )
    confused_with = ("drift", "ageing", "operator_creep", "reptation", "leakage", "log_rate")
    needs = (RATES,)
    experiment = (
        "holds over two decades of time after moves in both directions: creep follows the move, "
        "drift does not care"
    )
    tau_s: tuple[float, ...] = (0.1, 1.0, 10.0)
    c: tuple[float, ...] = parameter(
        "1",
        0.0,
        0.5,
        count=lambda own: len(own.tau_s),
        meaning=lambda own: [f"gain of the element of {tau:.3g} s" for tau in own.tau_s],
        total=lambda own: ("gain_per_decade", 1 / own._per_decade),
    )

    def coefficients(self) -> tuple[Parameter, ...]:
        return tuple(
            coefficient(
                f"start_{i}",
                "{z}",
                f"what the past before the record leaves in the element of {tau:.3g} s",
                amount=False,
            )
            for i, tau in enumerate(self.tau_s, start=1)
        )

    def free_response(self, signals: Signals) -> Float[Array, "time column"]:
        return jnp.exp(-signals.time[:, None] / jnp.asarray(self.tau_s)[None, :])

    def past_bound(self, signals: Signals, furthest: float) -> Float[Array, " time"]:
        gains = self._gains
        # Creep goes on beyond the elements that the record could show: by a decade, half of which
        # an average past has used up.
        beyond = 0.5 * gains.sum() / self._per_decade
        return furthest * (self.free_response(signals) @ gains + beyond)

    def bound_to(self, survey: Survey) -> Creep:
        return replace(self, tau_s=creep_times(survey))

    @property
    def _gains(self) -> Array:
        return jnp.stack([jnp.asarray(gain) for gain in self.c])

    @property
    def _per_decade(self) -> float:
        """Elements in a decade of time; a single one stands for a decade."""
        if len(self.tau_s) < 2:
            return 1.0
        return (len(self.tau_s) - 1) / float(np.log10(self.tau_s[-1] / self.tau_s[0]))

    def state_space(self, dt: Array) -> StateSpace:
        gains = self._gains
        return StateSpace(
            *relaxations(jnp.asarray(self.tau_s), dt), gains[:, None], 1 + gains.sum()
        )

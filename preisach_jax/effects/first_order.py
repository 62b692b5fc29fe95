"""What the lags of the input and of the output share: one time constant, and its low-pass."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar, Self

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from preisach_jax.effects.base import RATES, Effect, Survey, low_pass_step
from preisach_jax.effects.parameter import time_constant


class FirstOrderLag(Effect):
    r"""First-order lag of a signal: \(\tau \dot y = x - y\).

    Arguments:
        tau_low_s, tau_high_s: bounds of the search for the time constant, in s.
        of_samples: whether it is a filter of the samples, as a controller has it,
            \(y_k = x_k + e^{-\Delta t/\tau} (y_{k-1} - x_k)\): half a sample earlier than the
            lag of a signal that goes straight from sample to sample.
    """

    needs: ClassVar[tuple[str, ...]] = (RATES,)
    form_pays: ClassVar[float] = 0.9
    """Both forms have one parameter, and what the wrong one leaves goes with the speed."""

    tau_low_s: float = 1e-5
    tau_high_s: float = 10.0
    of_samples: bool = eqx.field(static=True, default=False)
    tau_s: float = time_constant(
        lambda own: "time constant" + " of a filter of the samples" * own.of_samples, margins=(2, 4)
    )

    def bound_to(self, survey: Survey) -> Self:
        return replace(
            self, tau_low_s=survey.step_s / 4, tau_high_s=survey.duration_s / 20, of_samples=False
        )

    def variants(self, survey: Survey) -> tuple[Self, ...]:
        bound = self.bound_to(survey)
        return bound, replace(bound, of_samples=True)

    def init(self, first: Array) -> Array:
        return jnp.stack([first, first])

    def step(self, state: Array, value: Array, dt: Array) -> tuple[Array, Array]:
        if self.of_samples:
            output = value + jnp.exp(-dt / self.tau_s) * (state[0] - value)
            return jnp.stack([output, value]), output
        state = low_pass_step(state, value, dt, self.tau_s)
        return state, state[0]

"""What the lags of the input and of the output share: one time constant, and its low-pass."""

from __future__ import annotations

from typing import ClassVar, Self

import jax.numpy as jnp
from jaxtyping import Array

from preisach_jax.effects.base import RATES, Effect, Survey, low_pass_step
from preisach_jax.effects.parameter import time_constant


class FirstOrderLag(Effect):
    r"""First-order lag of a signal: \(\tau \dot y = x - y\).

    Arguments:
        tau_low_s, tau_high_s: bounds of the search for the time constant, in s.
    """

    needs: ClassVar[tuple[str, ...]] = (RATES,)

    tau_low_s: float = 1e-5
    tau_high_s: float = 10.0
    tau_s: float = time_constant("time constant", margins=(2, 4))

    def bound_to(self, survey: Survey) -> Self:
        return type(self)(tau_low_s=survey.step_s / 4, tau_high_s=survey.duration_s / 20)

    def init(self, first: Array) -> Array:
        return jnp.stack([first, first])

    def step(self, state: Array, value: Array, dt: Array) -> tuple[Array, Array]:
        state = low_pass_step(state, value, dt, self.tau_s)
        return state, state[0]

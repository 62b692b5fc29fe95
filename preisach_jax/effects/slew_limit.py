"""Slew limit: what drives the material cannot change faster than a greatest rate."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from preisach_jax.effects.base import RATES, InputEffect, Survey
from preisach_jax.effects.parameter import parameter


def starts_between(low: float, high: float) -> tuple[float, ...]:
    """Eight values between two bounds, evenly spaced on a logarithmic scale."""
    ratio = (high / low) ** (1 / 9)
    return tuple(low * ratio**k for k in range(1, 9))


class SlewLimit(InputEffect):
    r"""Limited rate of the input: u' goes towards u, with \(|\dot u'| \le s\).

    Arguments:
        slew_low, slew_high: bounds of the search for s, in input units per s.

    Example:
        >>> import jax.numpy as jnp
        >>> step = jnp.array([0.0, 4.0, 4.0, 4.0])
        >>> SlewLimit(slew=1.5).apply(step, jnp.arange(4.0)).tolist()
        [0.0, 1.5, 3.0, 4.0]
    """

    name = "slew_limit"
    rank = 5
    in_words = "a slew limit of the drive (its fastest moves come late)"
    physics = (
        "An amplifier delivers a greatest current, and a piezo stack is a capacitor: the voltage "
        "cannot change faster than current over capacitance.  Slower motion passes unchanged; "
        "faster motion becomes a ramp of that slope, and short fast strokes do not reach their end."
    )
    source = (
        "A. J. Fleming, K. K. Leang, Design, Modeling and Control of Nanopositioning Systems, "
        "Springer 2014, ch. 14 (current and slew limits of amplifiers)"
    )
    signature = "residual after fast moves only, which ends abruptly; none below a certain rate"
    confused_with = ("input_lag", "rate_dependence")
    needs = (RATES,)
    experiment = (
        "steps of several heights from rest: behind a slew limit the time to arrive grows with the "
        "height, behind a lag it does not; and slow loops, on which a limit does nothing"
    )
    limits_rate = True
    slew_low: float = 1e-3
    slew_high: float = 1e6
    slew: float = parameter(
        "{u}/s",
        lambda own: own.slew_low,
        lambda own: own.slew_high,
        log=True,
        start=lambda own: starts_between(own.slew_low, own.slew_high),
        meaning="greatest rate of the drive",
    )

    def bound_to(self, survey: Survey) -> SlewLimit:
        if len(survey.input) < 2 or not np.ptp(survey.input) > 0:
            return self
        fastest = float(np.max(survey.speeds))
        return SlewLimit(slew_low=0.02 * fastest, slew_high=fastest)

    @property
    def greatest_rate(self) -> float:
        return self.slew

    def sampled(self, step_s: float, amounts: tuple[float, ...]) -> dict[str, Any]:
        return {"most": self.slew * step_s}

    def init(self, first: Array) -> Array:
        return jnp.stack([first, first])

    def step(self, state: Array, value: Array, dt: Array) -> tuple[Array, Array]:
        # The input goes straight from `last` to `value`: u' runs to meet it, then stays with it
        # as far as the limit lets it.
        driven, last = state
        slew = self.slew
        rate = (value - last) / jnp.where(dt > 0, dt, 1.0)
        side = jnp.sign(last - driven)
        closing = slew - side * rate
        closes = closing > 0
        meeting = jnp.where(closes, jnp.abs(last - driven) / jnp.where(closes, closing, 1.0), dt)
        meets = meeting < dt
        together = value - (rate - jnp.clip(rate, -slew, slew)) * (dt - meeting)
        driven = jnp.where(meets, together, driven + side * slew * dt)
        return jnp.stack([driven, value]), driven

"""What effects that move thresholds with the speed of the input share."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar, Self

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from preisach_jax.effects.base import RATES, HysteresisEffect, Survey
from preisach_jax.errors import unfinished


class SpeedWidening(HysteresisEffect):
    """Thresholds that move outward, α + δ and β - δ, by a law of the speed of the input.

    Arguments:
        reference_per_s: greatest speed of the record, in input units per s.
        with_reversible: whether the reversible part lags as well, as if it had thresholds.
        with_corners: whether the input has corners, so that it turns at full speed, and the speed
            at a sample is that of the interval before it. Else the input is smooth, rests where it
            turns, and the speed is the mean of the intervals on both sides.
    """

    goes_with_speed: ClassVar[bool] = True
    needs: ClassVar[tuple[str, ...]] = (RATES,)

    reference_per_s: float = 1.0
    range_u: float = 1.0
    with_reversible: bool = eqx.field(static=True, default=False)
    with_corners: bool = eqx.field(static=True, default=False)

    def law(self, speed: Float[Array, " time"]) -> Float[Array, " time"]:
        """By how much thresholds move outward at a speed over the reference, in input units."""
        raise unfinished(self, "law(self, speed)")

    def bound_to(self, survey: Survey) -> Self:
        if len(survey.time) < 2:
            return self
        fastest = float(np.quantile(survey.speeds, 0.99))
        swing = float(np.ptp(survey.input))
        return replace(
            self,
            reference_per_s=fastest or swing / survey.step_s,
            range_u=swing,
            with_reversible=False,
            with_corners=False,
        )

    def variants(self, survey: Survey) -> tuple[Self, ...]:
        bound = self.bound_to(survey)
        forms = ((False, False), (True, True), (True, False), (False, True))
        return tuple(
            replace(bound, with_reversible=reversible, with_corners=corners)
            for reversible, corners in forms
        )

    @property
    def widens_reversible(self) -> bool:
        return self.with_reversible

    def widening(
        self, path: Float[Array, " time"], time: Float[Array, " time"]
    ) -> Float[Array, " time"]:
        width = 1 if self.with_corners else 2
        dt = time[width:] - time[:-width]
        speed = jnp.abs(path[width:] - path[:-width]) / jnp.where(dt > 0, dt, 1.0)
        last = speed[-1:] if width == 2 else speed[:0]
        speed = jnp.concatenate([speed[:1], speed, last]) / self.reference_per_s
        return self.law(speed)

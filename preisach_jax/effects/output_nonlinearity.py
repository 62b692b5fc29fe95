"""Nonlinear output: the sensor, or what saturates, bends the whole loop alike."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from preisach_jax.effects.base import HEIGHTS, SensorEffect, Survey
from preisach_jax.effects.parameter import Parameter, coefficient

HALF_WAVES = 24
"""Half waves over the range up to which ripples are tried where a cubic does not follow."""


class OutputNonlinearity(SensorEffect):
    r"""Memoryless map of the output, written backwards: \(z - \sum_k c_k \varphi_k(x) = h\).

    \(\varphi_2, \varphi_3\) are the Legendre polynomials of the reading over its range,
    \(x = 2 (z - z_0)/Z - 1\); a map with ripples has \(\cos(k \pi (x + 1) / 2)\) besides.

    Arguments:
        low_z, range_z: lower end and range of the reading.
        half_waves: the greatest k of the cosines, which begin with 2; zero for a cubic.

    Example:
        >>> [c.name for c in OutputNonlinearity().coefficients()]
        ['c_2', 'c_3']
    """

    name = "output_nonlinearity"
    rank = 16
    needs = (HEIGHTS,)
    needs_clock = False
    in_words = "a nonlinear sensor (it bends the whole loop in the same way)"
    physics = (
        "The reading is not in proportion to the displacement: a capacitive or inductive sensor "
        "away from its calibration, a lever, a material near saturation. Whatever the history, "
        "equal outputs are bent alike."
    )
    source = (
        "A. J. Fleming, Sens. Actuators A 190 (2013) 106-126 (sensors of nanopositioning systems); "
        "L. Ljung, System Identification, 2nd ed., Prentice Hall 1999, sec. 5.2 (Wiener models)"
    )
    signature = (
        "a smooth curve against the output, the same on both branches; most of it is absorbed by "
        "the density, what is left shows in minor loops"
    )
    confused_with = ("moving",)
    experiment = (
        "calibrate the sensor against another; or equal minor loops at five or more biases on both "
        "branches"
    )
    # Ripples also make up for the cells of a plane where the loop is steep, but never for so much.
    form_pays = 0.1
    low_z: float = 0.0
    range_z: float = 1.0
    half_waves: int = eqx.field(static=True, default=0)

    def coefficients(self) -> tuple[Parameter, ...]:
        parts = {"c_2": "the quadratic part", "c_3": "the cubic part"}
        parts |= {f"ripple_{k}": f"the ripple of {k / 2:g} waves" for k in self._ripples}
        return tuple(
            coefficient(name, "{z}", f"amplitude of {part}") for name, part in parts.items()
        )

    @property
    def _ripples(self) -> range:
        return range(2, self.half_waves + 1)

    def bound_to(self, survey: Survey) -> OutputNonlinearity:
        if len(survey.time) < 2:
            return self
        return OutputNonlinearity(float(survey.output.min()), float(np.ptp(survey.output)))

    def variants(self, survey: Survey) -> tuple[OutputNonlinearity, ...]:
        cubic = self.bound_to(survey)
        return (cubic, replace(cubic, half_waves=HALF_WAVES))

    def sampled(self, step_s: float, amounts: tuple[float, ...]) -> dict[str, Any]:
        cubic, ripples = amounts[:2], amounts[2:]
        return {"low": self.low_z, "range": self.range_z, "cubic": cubic, "ripples": ripples}

    def columns(self, reading: Float[Array, " time"]) -> Float[Array, "time column"]:
        x = 2 * (reading - self.low_z) / self.range_z - 1
        # Beyond what was read the map goes straight on.
        end = jnp.clip(x, -1.0, 1.0)
        beyond = x - end
        quadratic = (3 * end**2 - 1) / 2 + 3 * end * beyond
        cubic = (5 * end**3 - 3 * end) / 2 + (15 * end**2 - 3) / 2 * beyond
        bends = jnp.stack([quadratic, cubic], axis=-1)
        if not self._ripples:
            return bends
        # A cosine costs ten times this recurrence, cos (k + 1) a = 2 cos a cos k a - cos (k - 1) a.
        turn = jnp.cos(jnp.pi * (end + 1) / 2)

        def following(last: tuple[Array, Array], _: None) -> tuple[tuple[Array, Array], Array]:
            ripple = 2 * turn * last[1] - last[0]
            return (last[1], ripple), ripple

        start = (jnp.ones_like(turn), turn)
        ripples = jax.lax.scan(following, start, length=len(self._ripples))[1]
        return jnp.concatenate([bends, ripples.T], axis=-1)

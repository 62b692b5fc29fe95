"""Eddy currents: the field inside lags behind the applied one by the speed of the output."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from preisach_jax.effects.base import RATES, HysteresisEffect, Survey
from preisach_jax.effects.parameter import parameter


class EddyCurrents(HysteresisEffect):
    r"""Field separation: \(v = u - k\,\dot h\) drives the hysterons.

    The derivative is the backward difference: exact where the output is straight, and stable
    however great k is.  Where a step of time is not short against k times the slope of the loop, k
    comes out too great, by up to a tenth.

    Arguments:
        range_u: range of the input.
        speed_z: usual speed of the output, per s, which bounds k.

    Example:
        >>> import jax.numpy as jnp
        >>> path, output, time = jnp.array([0.0, 4.0]), jnp.array([0.0, 1.0]), jnp.array([0.0, 0.5])
        >>> EddyCurrents(k=0.25).fed_back(path, output, time).tolist()
        [0.0, 3.5]
    """

    name = "eddy_currents"
    rank = 8
    in_words = (
        "eddy currents (the faster the output changes, the later the material sees its input)"
    )
    goes_with_speed = True
    feeds_back = True
    # Each trial of k means all states anew, and an output that agrees with itself.
    on_request = True
    of_field = "input"
    physics = (
        "A change of the flux induces currents in a conducting core, whose field opposes it: the "
        "material sees the applied field less a part in proportion to the speed of its own "
        "magnetisation. The loop widens most where it is steepest, and after the input has "
        "stopped, the output still settles."
    )
    source = (
        "G. Bertotti, Hysteresis in Magnetism, Academic Press 1998, ch. 12; S. E. Zirka, "
        "Y. I. Moroz, P. Marketos, A. J. Moses, IEEE Trans. Magn. 42 (2006) 2121-2132 (viscosity-"
        "based magnetodynamic model)"
    )
    signature = (
        "loops wider at speed, in proportion to the slope of the loop: most on its flanks, none "
        "where the output saturates"
    )
    confused_with = ("input_lag", "rate_dependence", "excess_loss")
    needs = (RATES,)
    experiment = (
        "loops into saturation at several rates over a decade: eddy currents act where the loop "
        "is steep, a lag of the drive and moving thresholds everywhere"
    )
    range_u: float = 1.0
    speed_z: float = 1.0
    k: float = parameter(
        "{u} s/{z}",
        0.0,
        lambda own: own.range_u / own.speed_z,
        meaning="input for unit speed of output",
    )

    def bound_to(self, survey: Survey) -> EddyCurrents:
        if len(survey.time) < 2:
            return self
        speed = float(np.quantile(survey.speeds, 0.9))
        swing = float(np.ptp(survey.input)) or 1.0
        ratio = float(np.ptp(survey.output)) / swing or 1.0
        return replace(self, range_u=swing, speed_z=ratio * (speed or swing / survey.step_s))

    def sampled(self, step_s: float, amounts: tuple[float, ...]) -> dict[str, Any]:
        return {"gain": self.k / step_s}

    def fed_back(
        self,
        path: Float[Array, " time"],
        output: Float[Array, " time"],
        time: Float[Array, " time"],
    ) -> Float[Array, " time"]:
        dt = jnp.diff(time, prepend=time[:1])
        moved = jnp.diff(output, prepend=output[:1])
        # The first sample has none before it.
        speed = jnp.where(dt > 0, moved / jnp.where(dt > 0, dt, 1.0), 0.0)
        return path - self.k * speed

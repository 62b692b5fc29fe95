"""First-order lag between the recorded input and what drives the material."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float

from preisach_jax.effects.base import InputEffect
from preisach_jax.effects.output_lag import FirstOrderLag
from preisach_jax.effects.speed import limited

ARC = 1 / 12
"""Area between an arc and its chord, over (curvature x step²) and the step."""


class InputLag(FirstOrderLag, InputEffect):
    r"""First-order lag of the input: \(\tau \dot u' = u - u'\).

    Arguments:
        tau_low_s, tau_high_s: bounds of the search for the time constant, in s.
        of_samples: whether it is a filter of the samples, which is half a sample earlier.

    Example:
        >>> InputLag().parameters()[0].name
        'tau_s'
    """

    name = "input_lag"
    rank = 4
    in_words = "a lag of the drive (the input reaches the material late and smoothed)"
    physics = (
        "The command is recorded before the amplifier, but the material sees what is behind it. "
        "A voltage amplifier with its output resistance and the capacitance of the piezo stack, "
        "or a current source with the inductance of a coil, follows with a time constant R·C or "
        "L/R: at speed the loop widens, and turning points are rounded.  A filter of the samples "
        "in a controller does the same, half a sample earlier."
    )
    source = (
        "A. J. Fleming, K. K. Leang, Design, Modeling and Control of Nanopositioning Systems, "
        "Springer 2014, ch. 14 (driving capacitive loads)"
    )
    signature = "residual in proportion to the rate of the input; none at rest"
    confused_with = (
        "delay",
        "output_lag",
        "slew_limit",
        "rate_dependence",
        "eddy_currents",
        "viscosity",
    )
    experiment = (
        "the same loop at several rates over a decade and a half, and a multisine: a lag "
        "attenuates fast parts, a delay only shifts them"
    )

    def sampled(self, step_s: float, amounts: tuple[float, ...]) -> dict[str, Any]:
        return {"arc": 0.0 if self.of_samples else ARC}

    def apply(
        self, signal: Float[Array, " time"], time: Float[Array, " time"]
    ) -> Float[Array, " time"]:
        if self.of_samples:
            return super().apply(signal, time)
        # A step takes its signal as straight between samples.  Where it bends, the arc encloses
        # with its chord a twelfth of (curvature x step²), by which the ends are moved.
        dt = jnp.diff(time)
        dt = jnp.concatenate([dt[:1], dt]) if len(time) > 1 else jnp.ones_like(time)
        speed = jnp.diff(signal, prepend=signal[:1]) / dt
        bend = jnp.diff(speed, prepend=0.0) * dt
        return super().apply(signal - ARC * limited(bend), time)

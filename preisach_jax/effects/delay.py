"""Pure delay between the hysteresis and the recorded output."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

from preisach_jax.effects.base import RATES, OutputEffect, Survey
from preisach_jax.effects.parameter import parameter


class Delay(OutputEffect):
    r"""Pure delay, by a fraction of a sample as well: \(z(t) = h(t - \theta)\).

    Arguments:
        delay_low_s, delay_high_s: bounds of the search, in s.

    Example:
        >>> import jax.numpy as jnp
        >>> t = jnp.arange(5.0)
        >>> Delay(delay_s=0.5).apply(t, t).tolist()
        [0.0, 0.5, 1.5, 2.5, 3.5]
    """

    name = "delay"
    rank = 11
    in_words = "a pure delay between input and measured output"
    physics = (
        "Converters, the filter of the sensor and its digital link, and a data logger that takes "
        "its channels one after the other deliver the output later than the input by a fixed time, "
        "whatever the signal."
    )
    source = (
        "L. Ljung, System Identification: Theory for the User, 2nd ed., Prentice Hall 1999, ch. 4"
    )
    signature = (
        "residual in proportion to the rate of the output; loops too wide at speed, and in the "
        "wrong sense where the material itself has little hysteresis"
    )
    confused_with = ("input_lag", "output_lag", "resonance", "viscosity")
    needs = (RATES,)
    experiment = (
        "a multisine or chirp up to a tenth of the sampling rate: the phase of a delay grows with "
        "frequency without bound, and its gain stays at one"
    )
    is_delay = True
    delay_low_s: float = 1e-5
    delay_high_s: float = 1.0
    delay_s: float = parameter(
        "s",
        lambda own: own.delay_low_s,
        lambda own: own.delay_high_s,
        log=True,
        margins=(2, 2),
        meaning="delay",
    )

    def bound_to(self, survey: Survey) -> Delay:
        return Delay(delay_low_s=survey.step_s / 4, delay_high_s=survey.duration_s / 20)

    @property
    def late_s(self) -> float:
        return self.delay_s

    def apply(
        self, signal: Float[Array, " time"], time: Float[Array, " time"]
    ) -> Float[Array, " time"]:
        # A delay needs the past of its signal, not a state of fixed size.  The output is shifted,
        # and not the input: a shifted input would be sampled beside its turning points, and the
        # hysteresis would remember the wrong ones.
        return jnp.interp(time - self.delay_s, time, signal)

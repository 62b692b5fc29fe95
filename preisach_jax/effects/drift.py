"""Drift: a slow change of the output that does not depend on the input."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from preisach_jax.effects.base import AddedEffect, Parameter, Survey, log_grid


def settling(time_s, tau_s, horizon_s: float):
    r"""Exponential approach that is 0 at the start and 1 at the horizon \(T\).

    \[ g(t) = \frac{1 - e^{-t/\tau}}{1 - e^{-T/\tau}} \]

    It is a straight line for \(\tau \gg T\), so one formula serves for both.
    """
    return jnp.expm1(-time_s / tau_s) / jnp.expm1(-horizon_s / tau_s)


class Drift(AddedEffect):
    r"""Exponential or straight drift, added to the output: \(a\,g(t)\), with `settling` as g.

    Arguments:
        horizon_s: time in s after which the drift has reached its amplitude: the length of the
            record that is fitted.

    Example:
        >>> Drift().coefficients()[0].name
        'amplitude'
    """

    name: ClassVar[str] = "drift"
    physics: ClassVar[str] = (
        "Warming frames, electronics and sensors move the zero of the measurement slowly and "
        "without regard to the input, mostly as an exponential approach to a new equilibrium, "
        "which on a short record is a straight line."
    )
    source: ClassVar[str] = (
        "A. J. Fleming, Sens. Actuators A 190 (2013) 106-126 (review of nanometre position sensors)"
    )
    signature: ClassVar[str] = (
        "residual that depends on time alone, the same at rest and in motion, at any input"
    )
    confused_with: ClassVar[tuple[str, ...]] = ("creep", "ageing")
    experiment: ClassVar[str] = (
        "the same reference loop at the start and at the end, and long holds after moves in both "
        "directions: drift shifts all alike, ageing shrinks the loop, creep follows the move"
    )
    horizon_s: float = eqx.field(static=True, default=1.0)

    def parameters(self):
        low, high = self.horizon_s / 30, self.horizon_s * 30
        return (
            Parameter(
                "tau_s",
                "s",
                low,
                high,
                start=log_grid(low * 3, high / 3, per_decade=1),
                log=True,
                meaning="time constant; far above the record's length it is a straight line",
            ),
        )

    def coefficients(self):
        return (Parameter("amplitude", "{z}", -jnp.inf, jnp.inf, meaning="change over the record"),)

    def bound_to(self, survey: Survey):
        return Drift(horizon_s=survey.duration_s)

    def columns(self, values, signals):
        return settling(signals.time, values["tau_s"], self.horizon_s)[:, None]

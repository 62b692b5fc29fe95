"""First-order lags: between the hysteresis and the recorded output, and what all lags share."""

from __future__ import annotations

from dataclasses import replace
from typing import Self

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from preisach_jax.effects.base import RATES, Effect, OutputEffect, Survey
from preisach_jax.effects.linear import StateSpace, relaxations
from preisach_jax.effects.parameter import time_constant


class FirstOrderLag(Effect):
    r"""First-order lag of a signal: \(\tau \dot y = x - y\).

    Arguments:
        tau_low_s, tau_high_s: bounds of the search for the time constant, in s.
        of_samples: whether it is a filter of the samples, as a controller has it,
            \(y_k = x_k + e^{-\Delta t/\tau} (y_{k-1} - x_k)\): half a sample earlier than the
            lag of a signal that goes straight from sample to sample.
    """

    needs = (RATES,)
    form_pays = 0.9
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

    def state_space(self, dt: Array) -> StateSpace:
        a, b = relaxations(jnp.atleast_1d(self.tau_s), dt)
        one = jnp.ones((1, 1))
        # A filter of samples takes the signal as if it had jumped after the last one.
        return StateSpace(a, -a[:, :, 0] if self.of_samples else b, one, jnp.ones(()))


class OutputLag(FirstOrderLag, OutputEffect):
    r"""First-order lag of the output: \(\tau \dot z = h - z\).

    Arguments:
        tau_low_s, tau_high_s: bounds of the search for the time constant, in s.
        of_samples: whether it is a filter of the samples, which is half a sample earlier.

    Example:
        >>> import jax, numpy as np
        >>> t = np.arange(5.0)
        >>> late = t - np.asarray(jax.jit(OutputLag(tau_s=0.125).apply)(t, t))
        >>> late.round(3).tolist()
        [0.0, 0.125, 0.125, 0.125, 0.125]
    """

    name = "output_lag"
    rank = 10
    in_words = "a lag of the sensor (the reading follows the output late and smoothed)"
    physics = (
        "The material moves at once, but the reading follows late: the demodulator of a capacitive "
        "or inductive sensor, a strain gauge amplifier and an anti-aliasing filter average over a "
        "time constant, and so does a filter of the samples in a controller, half a sample "
        "earlier.  The turning points that the material remembers are those of the input."
    )
    source = "A. J. Fleming, Sens. Actuators A 190 (2013) 106-126 (bandwidth of position sensors)"
    signature = (
        "residual in proportion to the rate of the output, with a tail of the time constant after "
        "every stop"
    )
    confused_with = ("delay", "input_lag", "resonance", "viscosity")
    experiment = (
        "a multisine up to a tenth of the sampling rate: a lag attenuates what is fast and a delay "
        "does not, a resonance amplifies it first; and fast small loops on a slow large one: "
        "behind a lag of the input the material remembers other turning points"
    )

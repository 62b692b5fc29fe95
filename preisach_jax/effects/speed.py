"""The speed of a signal from its samples, and effects that move thresholds with it."""

from __future__ import annotations

from dataclasses import replace
from typing import Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from preisach_jax.effects.base import RATES, HysteresisEffect, Survey
from preisach_jax.effects.linear import relaxation
from preisach_jax.errors import unfinished


def limited(change: Float[Array, " time"]) -> Float[Array, " time"]:
    """The lesser of each change and the last one, and zero where their signs differ.

    With what a signal bends by limited so, its corners stay corners (the minmod limiter: A. Harten,
    J. Comput. Phys. 49 (1983) 357-393).

    Arguments:
        change: (time,) changes from sample to sample; before the first one there was none.

    Returns:
        (time,) in units of the changes.
    """
    last = jnp.pad(change, (1, 0))[:-1]
    lesser = jnp.where(jnp.abs(change) < jnp.abs(last), change, last)
    return jnp.where(change * last > 0, lesser, 0.0)


def smoothed_rate(
    signal: Float[Array, " time"], time: Float[Array, " time"], tau_s: Array
) -> Float[Array, " time"]:
    r"""Rate of a signal behind a first-order low-pass, from samples that are past.

    \[ \tau \dot w = \dot x - w, \qquad
       \dot x = d_k + \frac{2t - t_{k-1} - t_k}{\Delta t_k} c_k, \quad
       d_k = \frac{x_k - x_{k-1}}{\Delta t_k}, \quad
       c_k = \tfrac12 \Delta t_k\,\bar a_k, \quad
       a_k = 2\frac{d_k - d_{k-1}}{\Delta t_k + \Delta t_{k-1}} \]

    for \(t_{k-1} < t \le t_k\), with the `limited` \(\bar a\) of a.  It is exact for a signal that
    goes straight over two intervals or more from corner to corner; that of a smooth signal is not
    half a sample late, as the difference to the sample before alone would be.

    Arguments:
        signal: (time,) signal x.
        time: (time,) in s, ascending; samples at one instant have no rate between them.
        tau_s: time constant in s, positive.

    Returns:
        (time,) w, in units of the signal per s; zero at the first sample.
    """
    dt = jnp.diff(time, prepend=time[:1])
    safe_dt = jnp.where(dt > 0, dt, 1.0)
    rate = jnp.diff(signal, prepend=signal[:1]) / safe_dt
    apart = (safe_dt + jnp.roll(safe_dt, 1)) / 2
    # Before the first interval no rate is known from which that would have changed.
    change = (jnp.diff(rate, prepend=rate[:1]) / apart).at[:2].set(0.0)
    bend = limited(change) * safe_dt / 2
    early, late = rate - bend, rate + bend

    decay, share = relaxation(tau_s, dt)

    def advance(speed: Array, sample: tuple[Array, ...]) -> tuple[Array, Array]:
        begin, end, kept, moved = sample
        speed = end + kept * (speed - begin) - moved * (end - begin)
        return speed, speed

    return jax.lax.scan(advance, jnp.zeros_like(rate[0]), (early, late, decay, share))[1]


class SpeedWidening(HysteresisEffect):
    """Thresholds that move outward, α + δ and β - δ, by a law of the speed of the input.

    Arguments:
        reference_per_s: greatest speed of the record, in input units per s.
        with_reversible: whether the reversible part lags as well, as if it had thresholds.
        with_corners: whether the input has corners, so that it turns at full speed, and the speed
            at a sample is that of the interval before it. Else the input is smooth, rests where it
            turns, and the speed is the mean of the intervals on both sides.
    """

    goes_with_speed = True
    needs = (RATES,)

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

"""Resonance: a mode of the mechanics between the hysteresis and the recorded output."""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array

from preisach_jax.effects.base import RATES, OutputEffect, Survey
from preisach_jax.effects.parameter import log_grid, parameter


class Resonance(OutputEffect):
    r"""One mode of unit gain at rest: \(\ddot z + 2\zeta\omega\dot z + \omega^2 (z - h) = 0\).

    Arguments:
        f_low_hz, f_high_hz: bounds of the search for \(\omega / 2\pi\), in Hz.

    Example:
        >>> import jax.numpy as jnp
        >>> t = jnp.linspace(0.0, 1.0, 101)
        >>> z = Resonance(f_hz=10.0, zeta=0.05).apply(jnp.where(t > 0.0, 1.0, 0.0), t)
        >>> round(float(z.max()), 1)
        1.8
    """

    name: ClassVar[str] = "resonance"
    physics: ClassVar[str] = (
        "Behind the active material a mass moves on a spring: the stage on its flexures, or the "
        "stack itself.  The mode follows slow motion, overshoots and rings after fast motion at "
        "its natural frequency until its damping has taken the energy away, and is late in "
        "between."
    )
    source: ClassVar[str] = (
        "D. Croft, S. Devasia, Rev. Sci. Instrum. 70 (1999) 4600-4605 (vibration of a piezo "
        "scanner); exact step: G. F. Franklin, J. D. Powell, M. L. Workman, Digital Control of "
        "Dynamic Systems, 3rd ed., Addison-Wesley 1998, ch. 6 (triangle hold)"
    )
    signature: ClassVar[str] = (
        "residual that rings at one frequency after steps and corners, and dies away at rest"
    )
    confused_with: ClassVar[tuple[str, ...]] = (
        "output_lag",
        "delay",
        "hum",
        "cross:COL",
        "restoring_force",
    )
    needs: ClassVar[tuple[str, ...]] = (RATES,)
    experiment: ClassVar[str] = (
        "steps or corners followed by rest, sampled at ten times the mode: a mode rings and dies "
        "away, a lag and a delay do not ring, and a hum never stops"
    )
    f_low_hz: float = 1.0
    f_high_hz: float = 1000.0
    # Lower starts are as slow as the excitation itself, and are reached by the search.
    f_hz: float = parameter(
        "Hz",
        lambda own: own.f_low_hz,
        lambda own: own.f_high_hz,
        log=True,
        start=lambda own: log_grid(
            max(own.f_high_hz / 10**2.5, own.f_low_hz) * 1.05, own.f_high_hz / 1.05, per_decade=10
        ),
        meaning="natural frequency without damping",
    )
    zeta: float = parameter("1", 0.001, 0.7, log=True, start=(0.02, 0.2), meaning="damping ratio")

    def bound_to(self, survey: Survey) -> Resonance:
        return Resonance(f_low_hz=2 / survey.duration_s, f_high_hz=0.45 / survey.step_s)

    def init(self, first: Array) -> Array:
        return jnp.stack([jnp.zeros_like(first), jnp.zeros_like(first), first])

    def step(self, state: Array, value: Array, dt: Array) -> tuple[Array, Array]:
        # The state is (z - h, dz/dt / omega, h): small numbers, and zero at rest.
        away, speed, last = state
        omega, zeta = 2 * jnp.pi * self.f_hz, self.zeta
        # dt is zero at the first sample: the safe step keeps 0/0 out of values and gradients.
        angle = omega * jnp.where(dt > 0, dt, 1.0)
        root = jnp.sqrt(1 - zeta**2)
        decay = jnp.exp(-zeta * angle)
        cosine, sine = decay * jnp.cos(root * angle), decay * jnp.sin(root * angle) / root
        gone = 1 - cosine - zeta * sine
        slope = (value - last) / angle
        moved = (1 - gone) * away + sine * speed - slope * (sine + 2 * zeta * gone)
        faster = (cosine - zeta * sine) * speed - sine * away + slope * gone
        away, speed = jnp.where(dt > 0, moved, away), jnp.where(dt > 0, faster, speed)
        return jnp.stack([away, speed, value]), value + away

"""Resonance: a mode of the mechanics between the hysteresis and the recorded output."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Self

import jax.numpy as jnp
from jaxtyping import Array

from preisach_jax.effects.base import RATES, OutputEffect, Survey, Values
from preisach_jax.effects.linear import StateSpace
from preisach_jax.effects.modal import Modal, stacked
from preisach_jax.effects.parameter import log_grid, parameter

LARGEST_GAIN = 100.0
"""Gain of a further mode over that of the first one, of any sign, at most."""

RINGING = (0.03, 0.12)
"""Damping ratios at which a further mode is looked for."""

SLIGHT = 0.1
"""Gain of a further mode at which it is looked for."""


def _gain(number: int) -> Any:
    """Declare the gain of a mode after the first one."""
    return parameter(
        "1",
        -LARGEST_GAIN,
        LARGEST_GAIN,
        start=lambda own: (own.start_of(number).gain,),
        meaning=f"gain of mode {number} at rest, over that of the first one",
        when=lambda own: own.modes >= number,
    )


class Resonance(Modal, OutputEffect):
    r"""Modes that the hysteresis drives, side by side, the first one of unit gain at rest.

    \[ z = \sum_k g_k y_k, \qquad
    \ddot y_k + 2\zeta_k\omega_k\dot y_k + \omega_k^2 (y_k - h) = 0, \qquad g_1 = 1 \]

    A diagnosis begins with one mode and finds the number (see `Effect.enlarged`); to fit more,
    say `Resonance(modes=2)`.

    Arguments:
        f_low_hz, f_high_hz: bounds of the search for \(\omega / 2\pi\), in Hz.
        modes: how many modes, up to four.
        starts: see `Modal`.

    Example:
        >>> import jax, numpy as np
        >>> t = np.linspace(0.0, 1.0, 101)
        >>> z = jax.jit(Resonance(f_hz=10.0, zeta=0.05).apply)(np.where(t > 0.0, 1.0, 0.0), t)
        >>> round(float(z.max()), 1)
        1.8
    """

    name = "resonance"
    rank = 12
    in_words = "a resonance of the mechanics"
    physics = (
        "Behind the active material a mass moves on a spring: the stage on its flexures, or the "
        "stack itself.  The mode follows slow motion, overshoots and rings after fast motion at "
        "its natural frequency until its damping has taken the energy away, and is late in "
        "between.  Further modes (bending, tilting) move beside the first one, each with a gain of "
        "its own, of either sign; a diagnosis adds them one by one, four at most."
    )
    source = (
        "D. Croft, S. Devasia, Rev. Sci. Instrum. 70 (1999) 4600-4605 (vibration of a piezo "
        "scanner); exact step: G. F. Franklin, J. D. Powell, M. L. Workman, Digital Control of "
        "Dynamic Systems, 3rd ed., Addison-Wesley 1998, ch. 6 (triangle hold)"
    )
    signature = (
        "residual that rings at one frequency after steps and corners, and dies away at rest"
    )
    confused_with = ("output_lag", "delay", "hum", "cross:COL", "restoring_force")
    needs = (RATES,)
    experiment = (
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
        start=lambda own: (
            *log_grid(
                max(own.f_high_hz / 10**2.5, own.f_low_hz) * 1.05,
                own.f_high_hz / 1.05,
                per_decade=10,
            ),
            *own.seen,
        ),
        meaning="natural frequency without damping",
    )
    zeta: float = parameter("1", 0.001, 0.7, log=True, start=(0.02, 0.2), meaning="damping ratio")

    gain_2: float = _gain(2)
    gain_3: float = _gain(3)
    gain_4: float = _gain(4)

    @property
    def lowest_hz(self) -> float:
        return self.f_low_hz

    @property
    def highest_hz(self) -> float:
        return self.f_high_hz

    @property
    def gains(self) -> list[Any]:
        """Gain of each mode at rest, over that of the first one, where the effect acts."""
        return [1.0, self.gain_2, self.gain_3, self.gain_4][: self.modes]

    def bound_to(self, survey: Survey) -> Resonance:
        bound = replace(self, f_low_hz=2 / survey.duration_s, f_high_hz=0.45 / survey.step_s)
        return bound.searched_from(survey, survey.input, static_known=True)

    def enlarged(
        self, survey: Survey, values: Values
    ) -> tuple[Self, tuple[dict[str, float], ...]] | None:
        found = self.with_mode_from(survey, survey.input, values, static_known=True)
        if found is None:
            return None
        more, seen = found
        # What one mode makes of two rings where neither of them does, and is as strong as they are.
        number = more.modes
        grid = [
            {**values, f"f_{number}_hz": f_hz, f"zeta_{number}": zeta}
            for f_hz in replace(self, starts=()).parameters()[0].start
            for zeta in RINGING
        ]
        return more, tuple({**start, f"gain_{number}": SLIGHT} for start in (seen, *grid))

    def reduced(self, values: Values) -> Sequence[tuple[Self, dict[str, float]]]:
        gains = [1.0, *(values[f"gain_{number}"] for number in range(2, self.modes + 1))]
        found: list[tuple[Self, dict[str, float]]] = []
        for gone, (less, start) in enumerate(super().reduced(values)):
            first, *others = gains[:gone] + gains[gone + 1 :]
            own = {f"gain_{k}": g / first if first else g for k, g in enumerate(others, start=2)}
            found.append((less, {**start, **own}))
        return found

    def state_space(self, dt: Array) -> StateSpace:
        gains = stacked(self.gains, dt)
        c = jnp.stack([gains, jnp.zeros_like(gains)], axis=-1)
        return StateSpace(*self.modes_over(dt), c, gains.sum())

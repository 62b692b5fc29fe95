"""Viscosity: a part of the output goes with the speed of the input."""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from preisach_jax.effects.base import RATES, AddedEffect, Signals, Survey, Values
from preisach_jax.effects.low_pass import smoothed_rate
from preisach_jax.effects.parameter import Parameter, log_grid


class Viscosity(AddedEffect):
    r"""A force against motion: viscous, dry and saturating, of the smoothed speed w.

    \[ c\,w + d \tanh(w/v) + s \tanh(w/v)\,e^{-|w|/v_s}, \qquad \tau \dot w = \dot u - w \]

    A speed v far below those of the record makes Coulomb friction of the second part, and the third
    is the rise of a dry friction towards rest (Stribeck).

    Arguments:
        fastest: greatest speed of the record, in input units per s.
        tau_low_s, tau_high_s: bounds of the smoothing; at the lower one the speed is that of the
            last interval.
        saturates: whether there is a second part.
        stribeck: whether there is a third part.

    Example:
        >>> import jax.numpy as jnp
        >>> t = jnp.arange(3.0)
        >>> signals = Signals(t, 2 * t, {})
        >>> Viscosity().columns({"tau_s": jnp.array(0.1)}, signals).round(2).tolist()
        [[0.0], [2.0], [2.0]]
    """

    name: ClassVar[str] = "viscosity"
    goes_with_speed: ClassVar[bool] = True
    scaled: ClassVar[bool] = True
    physics: ClassVar[str] = (
        "A fluid or a sliding contact resists motion: where the input is a displacement and the "
        "output a force, a part of the force goes with the speed. It is viscous (in proportion), "
        "dry (of constant size and the sign of the speed, greater near rest where it is "
        "lubricated) or saturating (a magnetorheological fluid yields). A compressible fluid and "
        "the filter of a sensor make it follow late."
    )
    source: ClassVar[str] = (
        "B. F. Spencer, S. J. Dyke, M. K. Sain, J. D. Carlson, J. Eng. Mech. 123 (1997) 230-238 "
        "and N. M. Kwok, Q. P. Ha, T. H. Nguyen, J. Li, B. Samali, Sens. Actuators A 132 (2006) "
        "441-451 (dampers); B. Armstrong-Hélouvry, P. Dupont, C. Canudas de Wit, Automatica 30 "
        "(1994) 1083-1138 (Coulomb and Stribeck friction)"
    )
    signature: ClassVar[str] = (
        "residual that goes with the speed of the input and drops before each turning point, "
        "where a lag is greatest behind it"
    )
    confused_with: ClassVar[tuple[str, ...]] = ("input_lag", "output_lag", "delay")
    needs: ClassVar[tuple[str, ...]] = (RATES,)
    experiment: ClassVar[str] = (
        "sines of one size at three or more frequencies: a viscosity leads the displacement, and "
        "its height goes with the frequency or stays, a lag comes behind it"
    )
    fastest: float = 1.0
    tau_low_s: float = 1e-4
    tau_high_s: float = 0.1
    saturates: bool = eqx.field(static=True, default=False)
    stribeck: bool = eqx.field(static=True, default=False)

    def parameters(self) -> tuple[Parameter, ...]:
        smoothing = Parameter(
            "tau_s",
            "s",
            self.tau_low_s,
            self.tau_high_s,
            start=log_grid(2 * self.tau_low_s, self.tau_high_s / 2, per_decade=1.5),
            log=True,
            meaning="lag behind the speed; at its lower bound it is immediate",
            open_ended=True,
        )
        if not self.saturates:
            return (smoothing,)
        scale = Parameter(
            "speed",
            "{u}/s",
            1e-3 * self.fastest,
            3 * self.fastest,
            start=(0.03 * self.fastest, 0.12 * self.fastest, 0.5 * self.fastest),
            log=True,
            meaning="speed at which three quarters of the saturating part are reached",
            open_ended=True,
        )
        if not self.stribeck:
            return (smoothing, scale)
        decay = Parameter(
            "stribeck_speed",
            "{u}/s",
            1e-2 * self.fastest,
            self.fastest,
            start=(0.1 * self.fastest, 0.4 * self.fastest),
            log=True,
            meaning="speed over which the dry part falls to its size at speed",
            open_ended=True,
        )
        return (smoothing, scale, decay)

    def coefficients(self) -> tuple[Parameter, ...]:
        free = (-jnp.inf, jnp.inf)
        viscous = Parameter("viscous", "{z} s/{u}", *free, meaning="output for unit speed")
        dry = Parameter("saturating", "{z}", *free, meaning="size of the part that saturates")
        rise = Parameter("stribeck", "{z}", *free, meaning="what it is greater near rest")
        return (viscous, dry, rise)[: 1 + self.saturates + self.stribeck]

    def bound_to(self, survey: Survey) -> Viscosity:
        longest = max(min(200 * survey.step_s, survey.duration_s / 50), 8 * survey.step_s)
        fastest = self.fastest
        if len(survey.time) > 1 and np.ptp(survey.input) > 0:
            speed = survey.speeds
            fastest = float(np.quantile(speed, 0.98)) or float(np.ptp(survey.input)) / survey.step_s
        return Viscosity(fastest, survey.step_s / 4, longest)

    def variants(self, survey: Survey) -> tuple[Viscosity, ...]:
        bound = self.bound_to(survey)
        scales = (bound.fastest, bound.tau_low_s, bound.tau_high_s)
        forms = ((False, False), (True, False), (True, True))
        return tuple(Viscosity(*scales, *form) for form in forms)

    def columns(self, values: Values, signals: Signals) -> Float[Array, "time column"]:
        speed = smoothed_rate(signals.input, signals.time, jnp.asarray(values["tau_s"]))
        parts = [speed]
        if self.saturates:
            parts.append(jnp.tanh(speed / values["speed"]))
        if self.stribeck:
            parts.append(parts[1] * jnp.exp(-jnp.abs(speed) / values["stribeck_speed"]))
        return jnp.stack(parts, axis=1)

"""Viscosity: a part of the output goes with the speed of the input."""

from __future__ import annotations

from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from preisach_jax.effects.base import RATES, AddedEffect, Signals, Survey
from preisach_jax.effects.parameter import Parameter, coefficient, parameter, time_constant
from preisach_jax.effects.speed import smoothed_rate


class Viscosity(AddedEffect):
    r"""A force against motion: viscous, dry and saturating, of the smoothed speed w.

    \[ c\,w + d \tanh(w/v) + s \tanh(w/v)\,e^{-|w|/v_s}, \qquad \tau \dot w = \dot u - w \]

    Its input u is behind the effects of the input: what lags or limits the drive limits its speed.
    A speed v far below those of the record makes Coulomb friction of the second part, and the third
    is the rise of a dry friction towards rest (Stribeck).

    Arguments:
        fastest: greatest speed of the record, in input units per s.
        tau_low_s, tau_high_s: bounds of the smoothing; at the lower one the speed is that at the
            sample.
        saturates: whether there is a second part.
        stribeck: whether there is a third part.

    Example:
        >>> import jax, numpy as np
        >>> t = np.arange(3.0)
        >>> signals = Signals(t, 2 * t, {})
        >>> np.round(jax.jit(Viscosity(tau_s=0.1).columns)(signals), 2).tolist()
        [[0.0], [2.0], [2.0]]
    """

    name = "viscosity"
    rank = 19
    in_words = "a viscosity (a part of the output depends on the speed of the input)"
    goes_with_speed = True
    beside_the_loop = True
    smoothed_by = "tau_s"
    physics = (
        "A fluid or a sliding contact resists motion: where the input is a displacement and the "
        "output a force, a part of the force goes with the speed. It is viscous (in proportion), "
        "dry (of constant size and the sign of the speed, greater near rest where it is "
        "lubricated) or saturating (a magnetorheological fluid yields). A compressible fluid and "
        "the filter of a sensor make it follow late."
    )
    source = (
        "B. F. Spencer, S. J. Dyke, M. K. Sain, J. D. Carlson, J. Eng. Mech. 123 (1997) 230-238 "
        "and N. M. Kwok, Q. P. Ha, T. H. Nguyen, J. Li, B. Samali, Sens. Actuators A 132 (2006) "
        "441-451 (dampers); B. Armstrong-Hélouvry, P. Dupont, C. Canudas de Wit, Automatica 30 "
        "(1994) 1083-1138 (Coulomb and Stribeck friction)"
    )
    signature = (
        "residual that goes with the speed of the input and drops before each turning point, "
        "where a lag is greatest behind it"
    )
    confused_with = ("input_lag", "output_lag", "delay", "excess_loss")
    needs = (RATES,)
    experiment = (
        "sines of one size at three or more frequencies: a viscosity leads the displacement, and "
        "its height goes with the frequency or stays, a lag comes behind it"
    )
    fastest: float = 1.0
    tau_low_s: float = 1e-4
    tau_high_s: float = 0.1
    saturates: bool = eqx.field(static=True, default=False)
    stribeck: bool = eqx.field(static=True, default=False)
    tau_s: float = time_constant(
        "lag behind the speed; at its lower bound it is immediate",
        margins=(2, 2),
        per_decade=1.5,
        open_ended="both",
    )
    speed: float = parameter(
        "{u}/s",
        lambda own: 1e-3 * own.fastest,
        lambda own: 3 * own.fastest,
        log=True,
        start=lambda own: (0.03 * own.fastest, 0.12 * own.fastest, 0.5 * own.fastest),
        meaning="speed at which three quarters of the saturating part are reached",
        open_ended="both",
        when=lambda own: own.saturates,
    )
    stribeck_speed: float = parameter(
        "{u}/s",
        lambda own: 1e-2 * own.fastest,
        lambda own: own.fastest,
        log=True,
        start=lambda own: (0.1 * own.fastest, 0.4 * own.fastest),
        meaning="speed over which the dry part falls to its size at speed",
        open_ended="both",
        when=lambda own: own.saturates and own.stribeck,
    )

    def coefficients(self) -> tuple[Parameter, ...]:
        viscous = coefficient("viscous", "{z} s/{u}", "output for unit speed")
        dry = coefficient("saturating", "{z}", "size of the part that saturates")
        rise = coefficient("stribeck", "{z}", "what it is greater near rest")
        return (viscous, dry, rise)[: 1 + self.saturates + self.stribeck]

    def bound_to(self, survey: Survey) -> Viscosity:
        longest = max(min(200 * survey.step_s, survey.duration_s / 50), 8 * survey.step_s)
        fastest = self.fastest
        if len(survey.time) > 1 and np.ptp(survey.input) > 0:
            speed = survey.speeds
            fastest = float(np.quantile(speed, 0.98)) or float(np.ptp(survey.input)) / survey.step_s
        return replace(
            self,
            fastest=fastest,
            tau_low_s=survey.step_s / 10,
            tau_high_s=longest,
            saturates=False,
            stribeck=False,
        )

    def variants(self, survey: Survey) -> tuple[Viscosity, ...]:
        bound = self.bound_to(survey)
        forms = ((False, False), (True, False), (True, True))
        return tuple(
            replace(bound, saturates=saturates, stribeck=stribeck) for saturates, stribeck in forms
        )

    def columns(self, signals: Signals) -> Float[Array, "time column"]:
        speed = smoothed_rate(signals.input, signals.time, jnp.asarray(self.tau_s))
        parts = [speed]
        if self.saturates:
            parts.append(jnp.tanh(speed / self.speed))
        if self.stribeck:
            parts.append(parts[1] * jnp.exp(-jnp.abs(speed) / self.stribeck_speed))
        return jnp.stack(parts, axis=1)

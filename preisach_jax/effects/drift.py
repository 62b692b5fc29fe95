"""Drift: a slow change of the output with time, or with the path that the input has gone."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from preisach_jax.effects.base import CYCLES, AddedEffect, Signals, Survey, Values
from preisach_jax.effects.parameter import Parameter, coefficient, parameter


def settling(time_s: Array, tau_s: Array | float, horizon_s: float) -> Array:
    r"""Exponential approach that is 0 at the start and 1 at the horizon \(T\).

    \[ g(t) = \frac{1 - e^{-t/\tau}}{1 - e^{-T/\tau}} \]

    It is a straight line for \(\tau \gg T\), so one formula serves for both.
    """
    return jnp.expm1(-time_s / tau_s) / jnp.expm1(-horizon_s / tau_s)


def bounds_of(survey: Survey) -> dict[str, Any]:
    """The horizon of a slow effect on a record, and whether the path stands for the time there."""
    counted = len(survey.path) > 0
    return {
        "horizon_s": float(survey.path[-1]) if counted else survey.duration_s,
        "by_path": counted,
    }


def slow_time(effect: Any, signals: Signals) -> Array:
    """What a slow effect goes with, `(time,)`: the time, or the path of the input."""
    return signals.path if effect.by_path else signals.time


def settling_time(meaning: str, when: Callable[[Any], bool] | None = None) -> Any:
    """The time constant of `settling` as a parameter, around the horizon of an effect."""
    return parameter(
        lambda own: "{u}" if own.by_path else "s",
        lambda own: own.horizon_s / 30,
        lambda own: own.horizon_s * 30,
        log=True,
        margins=(3, 3),
        per_decade=1.0,
        meaning=meaning,
        open_ended="both",
        when=when,
    )


WAVES = (6, 12, 24, 34, 48)
"""Numbers of waves of a wander."""

LEAST_ROWS = 10 * WAVES[-1]
"""Fewest rows that hold a wander."""

WANDERS = 0.5
"""Share of what fewer waves leave that more of them must not leave."""


class Drift(AddedEffect):
    r"""Slow change added to the output: \(a\,g(t)\), with `settling` as g, or a wander.

    A wander without a law is a sum of slow waves, \(\sum_k a_k \cos(\pi k t / T)\); beyond the
    record it stays where it was last.

    Arguments:
        horizon_s: time T in s after which the drift has reached its amplitude: the length of the
            record that is fitted.
        by_path: whether it goes with the path of the input, in its unit, in place of the time.
        waves: number of waves; zero for an exponential or straight drift.

    Example:
        >>> Drift().coefficients()[0].name
        'amplitude'
    """

    name: ClassVar[str] = "drift"
    rank: ClassVar[int] = 13
    needs_clock: ClassVar[bool] = False
    in_words: ClassVar[str] = "a drift of the measurement that does not depend on the input"
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
    confused_with: ClassVar[tuple[str, ...]] = ("creep", "ageing", "reptation", "leakage")
    needs: ClassVar[tuple[str, ...]] = (CYCLES,)
    of_time_alone: ClassVar[bool] = True
    experiment: ClassVar[str] = (
        "the same reference loop at the start and at the end, and long holds after moves in both "
        "directions: drift shifts all alike, ageing shrinks the loop, creep follows the move"
    )
    horizon_s: float = 1.0
    by_path: bool = eqx.field(static=True, default=False)
    waves: int = eqx.field(static=True, default=0)
    tau_s: float = settling_time(
        "time constant; far above the record's length it is a straight line",
        when=lambda own: not own.waves,
    )

    @property
    def nonparametric(self) -> bool:
        return self.waves > 0

    def coefficients(self) -> tuple[Parameter, ...]:
        if self.waves:
            period, unit = 2 * self.horizon_s, "of the path" if self.by_path else "s"
            return tuple(
                coefficient(
                    f"wave_{k}", "{z}", f"amplitude of the wave of period {period / k:.3g} {unit}"
                )
                for k in range(1, self.waves + 1)
            )
        return (coefficient("amplitude", "{z}", "change over the record"),)

    def bound_to(self, survey: Survey) -> Drift:
        return replace(self, **bounds_of(survey), waves=0)

    def variants(self, survey: Survey) -> tuple[Drift, ...]:
        settled = self.bound_to(survey)
        if len(survey.residual) < LEAST_ROWS:
            return (settled,)
        when = survey.path if settled.by_path else survey.time - survey.time[0]
        most = replace(settled, waves=WAVES[-1]).waves_at(np, np.asarray(when))
        wander, least = None, float(np.sum((survey.residual - survey.residual.mean()) ** 2))
        for waves in self._slower_than_the_drive(survey):
            left = _left(survey.residual, most[:, :waves])
            if left < WANDERS * least:
                wander, least = replace(settled, waves=waves), left
        return (settled,) if wander is None else (settled, wander)

    @staticmethod
    def _slower_than_the_drive(survey: Survey) -> list[int]:
        """Numbers of waves of which the fastest, of period 2 T / k, is no faster than the drive."""
        return [waves for waves in WAVES if 2 * survey.duration_s >= waves * survey.cycle_s]

    def enlarged(
        self, survey: Survey, values: Values
    ) -> tuple[Drift, tuple[dict[str, float], ...]] | None:
        del values  # of a wander, the model's other errors may have hidden the faster waves
        more = [waves for waves in self._slower_than_the_drive(survey) if waves > self.waves]
        if not (self.waves and more) or len(survey.residual) < LEAST_ROWS:
            return None
        return replace(self, waves=more[0]), ({},)

    def sampled(self, step_s: float, amounts: tuple[float, ...]) -> dict[str, Any]:
        step = 1.0 if self.by_path else step_s
        if self.waves:
            return {"waves": amounts, "rate": step / self.horizon_s}
        amplitude = amounts[0] / math.expm1(-self.horizon_s / self.tau_s)
        return {"amplitude": amplitude, "rate": -step / self.tau_s}

    def columns(self, signals: Signals) -> Float[Array, "time column"]:
        when = slow_time(self, signals)
        if self.waves:
            return self.waves_at(jnp, when)
        return settling(when, self.tau_s, self.horizon_s)[:, None]

    def waves_at(self, xp: Any, when: Any) -> Any:
        """(time, column) waves of a wander at some times, or paths, by NumPy or JAX."""
        phase = xp.pi * xp.clip(when / self.horizon_s, 0.0, 1.0)
        return xp.cos(phase[:, None] * xp.arange(1, self.waves + 1)[None, :])


def _left(residual: np.ndarray, columns: np.ndarray) -> float:
    """Sum of squares that a constant and some columns leave of a residual."""
    matrix = np.concatenate([np.ones((len(residual), 1)), columns], axis=1)
    solution = np.linalg.lstsq(matrix, residual, rcond=None)[0]
    return float(np.sum((residual - matrix @ solution) ** 2))

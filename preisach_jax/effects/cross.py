"""Another axis that leaks into the output, through a mode of the mechanics."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar, Self

import jax.numpy as jnp
from jaxtyping import Array, Float

from preisach_jax.effects.base import AddedEffect, Signals, Survey
from preisach_jax.effects.of_column import OfColumn
from preisach_jax.effects.parameter import Parameter, coefficient, log_grid, parameter
from preisach_jax.effects.resonance import Resonance


class Cross(OfColumn, AddedEffect):  # pyright: ignore[reportIncompatibleVariableOverride]
    r"""The input of another axis, a(t), added to the output through a mode of unit gain at rest.

    \[ g\,y, \qquad \ddot y + 2\zeta\omega\dot y + \omega^2 (y - a) = 0 \]

    Arguments:
        column: name of the auxiliary column; the effect is called `cross:COLUMN` after it.
        unit: its unit.
        tau_low_s, tau_high_s: times within which \(1/\omega\) is searched, in s.

    Example:
        >>> Cross(column="y_V", unit="V").name
        'cross:y_V'
    """

    prefix: ClassVar[str] = "cross"
    physics: ClassVar[str] = (
        "The axes of a stage, a mirror or a scanner share a frame and flexures that are not quite "
        "square: a drive of one axis moves the reading of another, in proportion where it is slow, "
        "and with the mode of what is in between where it is fast."
    )
    source: ClassVar[str] = (
        "A. J. Fleming, K. K. Leang, Design, Modeling and Control of Nanopositioning Systems, "
        "Springer 2014, ch. 4 (cross-coupling of flexure stages)"
    )
    signature: ClassVar[str] = (
        "residual that follows another axis, greater and late near the frequency of a mode"
    )
    confused_with: ClassVar[tuple[str, ...]] = ("aux:COL", "resonance")
    experiment: ClassVar[str] = (
        "a multisine up to beyond the mode on the other axis while this one rests"
    )
    f_hz: float = parameter(
        "Hz",
        lambda own: own.lowest_hz,
        lambda own: own.highest_hz,
        log=True,
        start=lambda own: log_grid(
            max(own.highest_hz / 10**2.5, own.lowest_hz) * 1.1, own.highest_hz / 1.1, per_decade=6
        ),
        meaning="natural frequency of the mode between the axes",
    )
    zeta: float = parameter("1", 0.001, 0.95, log=True, start=(0.05, 0.4), meaning="damping ratio")

    @property
    def lowest_hz(self) -> float:
        """The lowest natural frequency that is searched."""
        return float(1 / (2 * jnp.pi * self.tau_high_s))

    @property
    def highest_hz(self) -> float:
        """The highest natural frequency that is searched."""
        return float(1 / (2 * jnp.pi * self.tau_low_s))

    def coefficients(self) -> tuple[Parameter, ...]:
        unit = f"{{z}}/{self.unit or '1'}"
        return (coefficient("gain", unit, "output per unit of the axis"),)

    def bound_to(self, survey: Survey) -> Self:
        slowest = survey.duration_s / 20
        return replace(self, tau_low_s=survey.step_s / 2.8, tau_high_s=slowest)

    def columns(self, signals: Signals) -> Float[Array, "time column"]:
        column = signals.aux[self.column]
        mode = Resonance(f_hz=self.f_hz, zeta=self.zeta)
        return mode.apply(column, signals.time)[:, None]

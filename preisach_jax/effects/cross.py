"""Another axis that leaks into the output, through a mode of the mechanics."""

from __future__ import annotations

from dataclasses import replace
from typing import Self

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from preisach_jax.effects.base import AddedEffect, OfColumn, Survey, Values
from preisach_jax.effects.linear import StateSpace
from preisach_jax.effects.modal import Modal
from preisach_jax.effects.parameter import Parameter, coefficient, log_grid, parameter

LATE = 0.3
"""Gain of a mode's rate over that of the mode from which on a form with a phase is tried."""


class Cross(Modal, OfColumn, AddedEffect):  # pyright: ignore[reportIncompatibleVariableOverride]
    r"""The input of another axis, a(t), added to the output through modes of the mechanics.

    \[ \sum_k g_k\,y_k + q_k\,\dot y_k / \omega_k, \qquad
    \ddot y_k + 2\zeta_k\omega_k\dot y_k + \omega_k^2 (y_k - a) = 0 \]

    The \(q\) are there where it is turned: axes act late on one another, and modes that lie close
    together are complex (D. J. Ewins, Modal Testing, 2nd ed., Research Studies Press 2000, section
    2.7).  A diagnosis begins with one mode and finds the number (see `Effect.enlarged`); to fit
    more, say `Cross(column="y_V", modes=2, turned=True)`.

    Arguments:
        turned: whether each mode has a phase of its own.
        modes: how many modes, up to four.
        starts: see `Modal`.
        column: name of the auxiliary column; the effect is called `cross:COLUMN` after it.
        unit: its unit.
        tau_low_s, tau_high_s: times within which \(1/\omega\) is searched, in s.

    Example:
        >>> Cross(column="y_V", unit="V").name
        'cross:y_V'
    """

    prefix = "cross"
    rank = 21
    in_words = "coupling from {} through the mechanics"
    form_pays = 0.9
    physics = (
        "The axes of a stage, a mirror or a scanner share a frame and flexures that are not quite "
        "square: a drive of one axis moves the reading of another, in proportion where it is slow, "
        "and with the modes of what is in between where it is fast.  Where that comes late, each "
        "mode has a part in quadrature as well."
    )
    source = (
        "A. J. Fleming, K. K. Leang, Design, Modeling and Control of Nanopositioning Systems, "
        "Springer 2014, ch. 4 (cross-coupling of flexure stages)"
    )
    signature = "residual that follows another axis, greater and late near the frequency of a mode"
    confused_with = ("aux:COL", "resonance")
    experiment = "a multisine up to beyond the mode on the other axis while this one rests"
    turned: bool = eqx.field(static=True, default=False, kw_only=True)
    f_hz: float = parameter(
        "Hz",
        lambda own: own.lowest_hz,
        lambda own: own.highest_hz,
        log=True,
        start=lambda own: (
            *log_grid(
                max(own.highest_hz / 10**2.5, own.lowest_hz) * 1.1,
                own.highest_hz / 1.1,
                per_decade=6,
            ),
            *own.seen,
        ),
        meaning="natural frequency of the mode between the axes",
    )
    zeta: float = parameter(
        "1",
        0.001,
        0.95,
        log=True,
        start=lambda own: (0.015, 0.05, 0.4) if own.seen else (0.05, 0.4),
        meaning="damping ratio",
    )

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
        ends = ["", *(f"_{number}" for number in range(2, self.modes + 1))]
        kinds = [("gain", "output per unit of the axis")]
        if self.turned:
            kinds.append(("quadrature", "the same for the rate over the natural frequency"))
        return tuple(
            coefficient(f"{name}{end}", unit, meaning + (f", mode {1 + k}" if k else ""))
            for k, end in enumerate(ends)
            for name, meaning in kinds
        )

    def bound_to(self, survey: Survey) -> Self:
        slowest = survey.duration_s / 20
        bound = replace(self, tau_low_s=survey.step_s / 2.8, tau_high_s=slowest)
        if self.column not in survey.aux:
            return bound
        return bound.searched_from(survey, survey.aux[self.column], static_known=False)

    def variants(self, survey: Survey) -> tuple[Self, ...]:
        plain = self.bound_to(survey)
        late = plain.starts and abs(plain.starts[3]) > LATE
        return (plain, replace(plain, turned=True)) if late and not self.turned else (plain,)

    def enlarged(
        self, survey: Survey, values: Values
    ) -> tuple[Self, tuple[dict[str, float], ...]] | None:
        found = self.with_mode_from(survey, survey.aux[self.column], values, static_known=False)
        return None if found is None else (replace(found[0], turned=True), (found[1],))

    def state_space(self, dt: Array) -> StateSpace:
        # A column for each mode, and where it is turned one for its rate.
        parts = 1 + self.turned
        c = np.zeros((parts * self.modes, self.modes, 2))
        for column in range(len(c)):
            c[column, column // parts, column % parts] = 1.0
        d = np.tile([1.0, 0.0][:parts], self.modes)
        return StateSpace(*self.modes_over(dt), jnp.asarray(c), jnp.asarray(d))

"""An auxiliary column of the record (load, temperature) that acts on the output."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array

from preisach_jax.effects.base import AddedEffect, OfColumn, column_lag
from preisach_jax.effects.linear import StateSpace, relaxations
from preisach_jax.effects.parameter import Parameter, coefficient


class Auxiliary(OfColumn, AddedEffect):  # pyright: ignore[reportIncompatibleVariableOverride]
    r"""An auxiliary signal a(t) added to the output through a lag: \(g\,y,\ \tau\dot y = a - y\).

    Arguments:
        column: name of the auxiliary column; the effect is called `aux:COLUMN` after it.
        unit: its unit.
        tau_low_s, tau_high_s: bounds of the lag; at the lower one the action is immediate.

    Example:
        >>> Auxiliary(column="load_N", unit="N").name
        'aux:load_N'
    """

    prefix = "aux"
    rank = 18
    needs_clock = False
    in_words = "the influence of {}"
    physics = (
        "A load bends the stage by its compliance, at once; a temperature stretches it by its "
        "expansion, with the lag of the heat. Whatever is recorded beside the input can act on the "
        "output, in proportion and with a first-order lag."
    )
    source = (
        "A. J. Fleming, K. K. Leang, Design, Modeling and Control of Nanopositioning Systems, "
        "Springer 2014, ch. 2 and 3"
    )
    signature = "residual that follows the auxiliary column"
    confused_with = ("drift", "gain:COL", "cross:COL")
    experiment = "change the auxiliary quantity while the input rests"
    tau_s: float = column_lag()

    def coefficients(self) -> tuple[Parameter, ...]:
        unit = f"{{z}}/{self.unit or '1'}"
        return (coefficient("gain", unit, "output per auxiliary unit"),)

    def state_space(self, dt: Array) -> StateSpace:
        one = jnp.ones((1, 1, 1))
        return StateSpace(*relaxations(jnp.atleast_1d(self.tau_s), dt), one, one[0, 0])

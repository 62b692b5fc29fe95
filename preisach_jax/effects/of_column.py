"""What the effects of an auxiliary column share: its name, its unit, and the lag of its action."""

from __future__ import annotations

from collections.abc import Iterable
from typing import ClassVar, Self

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from preisach_jax.effects.base import Effect, Signals, Survey, Values
from preisach_jax.effects.low_pass import low_passed
from preisach_jax.effects.parameter import Parameter, log_grid


class OfColumn(Effect):
    """An effect of an auxiliary column, with a first-order lag.

    Class attributes:
        prefix: what stands before the column's name in that of the effect.

    Arguments:
        column: name of the auxiliary column; the effect is called `PREFIX:COLUMN` after it.
        unit: its unit.
        tau_low_s, tau_high_s: bounds of the lag; at the lower one the action is immediate.
    """

    prefix: ClassVar[str] = ""

    column: str = eqx.field(static=True, default="COL")
    unit: str = eqx.field(static=True, default="1")
    tau_low_s: float = 1e-3
    tau_high_s: float = 1.0

    @property
    def name(self) -> str:  # pyright: ignore[reportIncompatibleVariableOverride]
        return f"{self.prefix}:{self.column}"

    def lag(self, per_decade: float = 1.0) -> Parameter:
        """The time constant of the lag, with so many starts a decade."""
        return Parameter(
            "tau_s",
            "s",
            self.tau_low_s,
            self.tau_high_s,
            start=log_grid(self.tau_low_s, self.tau_high_s / 2, per_decade),
            log=True,
            meaning="lag; at its lower bound the action is immediate",
            open_ended=True,
        )

    def bound_to(self, survey: Survey) -> Self:
        return type(self)(
            column=self.column,
            unit=self.unit,
            tau_low_s=survey.step_s / 10,
            tau_high_s=survey.duration_s / 5,
        )

    def lagged(self, values: Values, signals: Signals) -> Float[Array, " time"]:
        """The column behind its lag, `(time,)`, at rest before the first sample."""
        return low_passed(signals.aux[self.column], signals.time, jnp.asarray(values["tau_s"]))


def auxiliary_columns(effects: Iterable[Effect]) -> list[str]:
    """Names of the auxiliary columns that some effects act through, each once, in their order."""
    return list(dict.fromkeys(e.column for e in effects if isinstance(e, OfColumn)))

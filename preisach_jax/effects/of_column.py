"""What the effects of an auxiliary column share: its name, its unit, and the lag of its action."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any, ClassVar, Self

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from preisach_jax.effects.base import Effect, Signals, Survey
from preisach_jax.effects.low_pass import low_passed
from preisach_jax.effects.parameter import time_constant


def column_lag() -> Any:
    """The lag behind an auxiliary column, as a parameter of an effect."""
    return time_constant(
        "lag; at its lower bound the action is immediate",
        margins=(1, 2),
        per_decade=1.0,
        open_ended="both",
    )


class OfColumn(Effect):
    """An effect of an auxiliary column, with a first-order lag.

    Class attributes:
        prefix: what stands before the column's name in that of the effect.

    Arguments:
        unit: unit of the column.
    """

    prefix: ClassVar[str] = ""

    column: str = eqx.field(static=True, default="COL")
    unit: str = eqx.field(static=True, default="1")
    tau_low_s: float = 1e-3
    tau_high_s: float = 1.0

    @property
    def name(self) -> str:  # pyright: ignore[reportIncompatibleVariableOverride]
        return f"{self.prefix}:{self.column}"

    def bound_to(self, survey: Survey) -> Self:
        return replace(self, tau_low_s=survey.step_s / 10, tau_high_s=survey.duration_s / 5)


def behind_lag(effect: OfColumn, signals: Signals, tau_s: float) -> Float[Array, " time"]:
    """The column of an effect behind a lag, `(time,)`, at rest before the first sample."""
    return low_passed(signals.aux[effect.column], signals.time, jnp.asarray(tau_s))


def auxiliary_columns(effects: Iterable[Effect]) -> list[str]:
    """Names of the auxiliary columns that some effects act through, each once, in their order."""
    return list(dict.fromkeys(e.column for e in effects if isinstance(e, OfColumn)))

"""An auxiliary column of the record (load, temperature) that acts on the output."""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from preisach_jax.effects.base import (
    AddedEffect,
    Parameter,
    Signals,
    Survey,
    Values,
    log_grid,
    low_pass_step,
)


class Auxiliary(AddedEffect):
    r"""An auxiliary signal a(t) added to the output through a lag: \(g\,y,\ \tau\dot y = a - y\).

    Arguments:
        column: name of the auxiliary column; the effect is called `aux:COLUMN` after it.
        unit: its unit.
        tau_low_s, tau_high_s: bounds of the lag; at the lower one the action is immediate.

    Example:
        >>> Auxiliary(column="load_N", unit="N").name
        'aux:load_N'
    """

    place: ClassVar[str] = "added"
    physics: ClassVar[str] = (
        "A load bends the stage by its compliance, at once; a temperature stretches it by its "
        "expansion, with the lag of the heat. Whatever is recorded beside the input can act on the "
        "output, in proportion and with a first-order lag."
    )
    source: ClassVar[str] = (
        "A. J. Fleming, K. K. Leang, Design, Modeling and Control of Nanopositioning Systems, "
        "Springer 2014, ch. 2 and 3"
    )
    signature: ClassVar[str] = "residual that follows the auxiliary column"
    confused_with: ClassVar[tuple[str, ...]] = ("drift",)
    experiment: ClassVar[str] = "change the auxiliary quantity while the input rests"
    column: str = eqx.field(static=True, default="COL")
    unit: str = eqx.field(static=True, default="1")
    tau_low_s: float = 1e-3
    tau_high_s: float = 1.0

    @property
    def name(self) -> str:  # pyright: ignore[reportIncompatibleVariableOverride]
        return f"aux:{self.column}"

    def parameters(self) -> tuple[Parameter, ...]:
        return (
            Parameter(
                "tau_s",
                "s",
                self.tau_low_s,
                self.tau_high_s,
                start=log_grid(self.tau_low_s, self.tau_high_s / 2, per_decade=1),
                log=True,
                meaning="lag; at its lower bound the action is immediate",
                open_ended=True,
            ),
        )

    def coefficients(self) -> tuple[Parameter, ...]:
        unit = f"{{z}}/{self.unit or '1'}"
        return (Parameter("gain", unit, -jnp.inf, jnp.inf, meaning="output per auxiliary unit"),)

    def bound_to(self, survey: Survey) -> Auxiliary:
        return Auxiliary(
            column=self.column,
            unit=self.unit,
            tau_low_s=survey.step_s / 10,
            tau_high_s=survey.duration_s / 5,
        )

    def columns(self, values: Values, signals: Signals) -> Float[Array, "time column"]:
        signal = signals.aux[self.column]
        dt = jnp.diff(signals.time, prepend=signals.time[:1])

        def advance(state: Array, sample: tuple[Array, Array]) -> tuple[Array, Array]:
            value, step_s = sample
            state = low_pass_step(state, value, step_s, values["tau_s"])
            return state, state[0]

        state = jnp.stack([signal[0], signal[0]])
        return jax.lax.scan(advance, state, (signal, dt))[1][:, None]

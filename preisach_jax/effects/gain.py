"""An auxiliary column of the record (coil current, temperature, load) that scales the loop."""

from __future__ import annotations

from typing import ClassVar, Self

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from preisach_jax.effects.base import Signals, Survey, Values, WeightEffect
from preisach_jax.effects.of_column import OfColumn
from preisach_jax.effects.parameter import Parameter


class Gain(OfColumn, WeightEffect):  # pyright: ignore[reportIncompatibleVariableOverride]
    r"""A factor on the loop, and on a viscosity beside it, that goes with an auxiliary signal a(t).

    \[ 1 + g A\,\varphi(x), \qquad \varphi(x) = x + q\,(x^2 - 1/4), \qquad
       x = (y - a_0)/A, \quad \tau\dot y = a - y \]

    with the range A of the column and its middle \(a_0\), where the factor of a straight line is 1;
    \(|q| \le 1\) keeps the curve monotone over the column's range.  What the loop shrinks towards
    is free: the output moves by a coefficient times \(A\,\varphi\) as well.

    Arguments:
        column: name of the auxiliary column; the effect is called `gain:COLUMN` after it.
        unit: its unit.
        tau_low_s, tau_high_s: bounds of the lag; at the lower one the action is immediate.
        middle, span: middle and range of the column.

    Example:
        >>> import jax.numpy as jnp
        >>> coil = Gain(column="current_A", unit="A", middle=0.5, span=1.0)
        >>> current = jnp.array([0.0, 0.5, 1.0])
        >>> signals = Signals(jnp.arange(3.0), current, {"current_A": current})
        >>> values = {"gain": 1.0, "curvature": 0.0, "tau_s": 1e-3}
        >>> coil.name, coil.gain(values, signals).round(1).tolist()
        ('gain:current_A', [0.5, 1.0, 1.5])
    """

    prefix: ClassVar[str] = "gain"
    physics: ClassVar[str] = (
        "The current in a coil sets how stiff a magnetorheological fluid is, a temperature how "
        "much a piezo strains for a volt, a load how far a magnet gets: the height of the whole "
        "loop goes with a quantity that is recorded beside the input, at once or with a lag (the "
        "inductance of the coil, the heat capacity)."
    )
    source: ClassVar[str] = (
        "B. F. Spencer, S. J. Dyke, M. K. Sain, J. D. Carlson, J. Eng. Mech. 123 (1997) 230-238 "
        "(coefficients linear in a voltage behind a first-order lag)"
    )
    signature: ClassVar[str] = (
        "residual in proportion to the output, with a sign that goes with the auxiliary column"
    )
    confused_with: ClassVar[tuple[str, ...]] = ("aux:COL", "ageing")
    experiment: ClassVar[str] = (
        "the same loop at three or more values of the auxiliary quantity: a gain changes its "
        "height, an added signal its place"
    )
    middle: float = 0.5
    span: float = 1.0

    def parameters(self) -> tuple[Parameter, ...]:
        most = 2 / self.span
        return (
            Parameter(
                "gain",
                f"1/({self.unit})" if "/" in self.unit else f"1/{self.unit or '1'}",
                -most,
                most,
                meaning="change of the factor for unit column, over the column's range",
            ),
            Parameter(
                "curvature",
                "1",
                -1.0,
                1.0,
                start=(-0.5, 0.5),
                meaning="bend of the factor over the column's range; 0 is straight",
                amount=False,
            ),
            self.lag(),
        )

    def coefficients(self) -> tuple[Parameter, ...]:
        unit = f"{{z}}/{self.unit or '1'}"
        return (Parameter("shift", unit, -jnp.inf, jnp.inf, meaning="what is added as well"),)

    def bound_to(self, survey: Survey) -> Self:
        column = survey.aux.get(self.column, np.zeros(0))
        low, high = (float(column.min()), float(column.max())) if len(column) else (0.0, 1.0)
        return type(self)(
            self.column,
            self.unit,
            survey.step_s / 10,
            survey.duration_s / 5,
            (low + high) / 2,
            (high - low) or 1.0,
        )

    def gain(self, values: Values, signals: Signals) -> Float[Array, " time"]:
        return 1 + values["gain"] * self.columns(values, signals)[:, 0]

    def columns(self, values: Values, signals: Signals) -> Float[Array, "time column"]:
        place = (self.lagged(values, signals) - self.middle) / self.span
        return self.span * (place + values["curvature"] * (place**2 - 0.25))[:, None]

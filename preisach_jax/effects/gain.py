"""An auxiliary column of the record (coil current, temperature, load) that scales the loop."""

from __future__ import annotations

from dataclasses import replace
from typing import Self

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from preisach_jax.effects.base import OfColumn, Signals, Survey, WeightEffect, column_lag
from preisach_jax.effects.low_pass import low_passed
from preisach_jax.effects.parameter import Parameter, coefficient, parameter


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
        >>> import jax, numpy as np
        >>> coil = Gain(column="current_A", unit="A", middle=0.5, span=1.0)
        >>> current = np.array([0.0, 0.5, 1.0])
        >>> signals = Signals(np.arange(3.0), current, {"current_A": current})
        >>> coil = coil.at({"gain": 1.0, "curvature": 0.0, "tau_s": 1e-3})
        >>> coil.name, np.round(jax.jit(coil.factor)(signals), 1).tolist()
        ('gain:current_A', [0.5, 1.0, 1.5])
    """

    prefix = "gain"
    rank = 20
    needs_clock = False
    in_words = "a loop that {} scales"
    physics = (
        "The current in a coil sets how stiff a magnetorheological fluid is, a temperature how "
        "much a piezo strains for a volt, a load how far a magnet gets: the height of the whole "
        "loop goes with a quantity that is recorded beside the input, at once or with a lag (the "
        "inductance of the coil, the heat capacity)."
    )
    source = (
        "B. F. Spencer, S. J. Dyke, M. K. Sain, J. D. Carlson, J. Eng. Mech. 123 (1997) 230-238 "
        "(coefficients linear in a voltage behind a first-order lag)"
    )
    signature = (
        "residual in proportion to the output, with a sign that goes with the auxiliary column"
    )
    confused_with = ("aux:COL", "ageing")
    experiment = (
        "the same loop at three or more values of the auxiliary quantity: a gain changes its "
        "height, an added signal its place"
    )
    middle: float = 0.5
    span: float = 1.0
    gain: float = parameter(
        lambda own: f"1/({own.unit})" if "/" in own.unit else f"1/{own.unit or '1'}",
        lambda own: -2 / own.span,
        lambda own: 2 / own.span,
        meaning="change of the factor for unit column, over the column's range",
    )
    curvature: float = parameter(
        "1",
        -1.0,
        1.0,
        start=(-0.5, 0.5),
        meaning="bend of the factor over the column's range; 0 is straight",
        amount=False,
    )
    tau_s: float = column_lag()

    def coefficients(self) -> tuple[Parameter, ...]:
        unit = f"{{z}}/{self.unit or '1'}"
        return (coefficient("shift", unit, "what is added as well"),)

    def bound_to(self, survey: Survey) -> Self:
        column = survey.aux.get(self.column, np.zeros(0))
        low, high = (float(column.min()), float(column.max())) if len(column) else (0.0, 1.0)
        return replace(super().bound_to(survey), middle=(low + high) / 2, span=(high - low) or 1.0)

    def factor(self, signals: Signals) -> Float[Array, " time"]:
        return 1 + self.gain * self.columns(signals)[:, 0]

    def columns(self, signals: Signals) -> Float[Array, "time column"]:
        late = low_passed(self.driver(signals), signals.time, jnp.asarray(self.tau_s))
        place = (late - self.middle) / self.span
        return self.span * (place + self.curvature * (place**2 - 0.25))[:, None]

"""Ageing: the hysteresis shrinks as time goes by, or with the path of the input."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, ClassVar

import equinox as eqx
from jaxtyping import Array, Float

from preisach_jax.effects.base import CYCLES, Signals, Survey, WeightEffect
from preisach_jax.effects.drift import bounds_of, settling, settling_time, slow_time
from preisach_jax.effects.parameter import parameter


class Ageing(WeightEffect):
    r"""Gain of all weights that falls with time: \(1 - \ell\, g(t)\), with `settling` as g.

    Arguments:
        horizon_s: time in s after which the loss is reached: the length of the record.
        by_path: whether it goes with the path of the input, in its unit, in place of the time.

    Example:
        >>> [p.name for p in Ageing().parameters()]
        ['loss', 'tau_s']
    """

    name: ClassVar[str] = "ageing"
    rank: ClassVar[int] = 15
    needs_clock: ClassVar[bool] = False
    in_words: ClassVar[str] = "ageing (the loop shrinks as time goes by)"
    physics: ClassVar[str] = (
        "Depolarisation, fatigue and warming take a share of the active material away (or give it "
        "back): the whole loop shrinks towards its lower end, without a change of its shape."
    )
    source: ClassVar[str] = (
        "D. C. Lupascu, Fatigue in Ferroelectric Ceramics and Related Issues, Springer 2004; with "
        "the path: J. L. Chaboche, Int. J. Plast. 5 (1989) 247-302 (accumulated strain)"
    )
    signature: ClassVar[str] = (
        "residual in proportion to the output, of a sign that changes from early to late"
    )
    confused_with: ClassVar[tuple[str, ...]] = ("drift", "creep", "gain:COL")
    needs: ClassVar[tuple[str, ...]] = (CYCLES,)
    of_time_alone: ClassVar[bool] = True
    experiment: ClassVar[str] = (
        "the same reference loop over the full range at the start and at the end: ageing changes "
        "its height, drift its place"
    )
    horizon_s: float = 1.0
    by_path: bool = eqx.field(static=True, default=False)
    loss: float = parameter("1", -0.5, 0.9, meaning="share of the stroke lost over the record")
    tau_s: float = settling_time(
        "time constant; far above the record's length the loss is a straight line"
    )

    def bound_to(self, survey: Survey) -> Ageing:
        return replace(self, **bounds_of(survey))

    def sampled(self, step_s: float, amounts: tuple[float, ...]) -> dict[str, Any]:
        loss = self.loss / math.expm1(-self.horizon_s / self.tau_s)
        return {"loss": loss, "rate": -(1.0 if self.by_path else step_s) / self.tau_s}

    def factor(self, signals: Signals) -> Float[Array, " time"]:
        return 1 - self.loss * settling(slow_time(self, signals), self.tau_s, self.horizon_s)

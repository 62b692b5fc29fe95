"""Upper limits for effects that were not found: how great they could be without being seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from preisach_jax.cores import on_all_cores
from preisach_jax.effects.base import AddedEffect, Effect, SensorEffect
from preisach_jax.identify.confidence import LEVEL
from preisach_jax.identify.problem import Point, Problem, with_all_rows
from preisach_jax.identify.signature import (
    Projection,
    amount_signatures,
    amounts_of,
    size_signatures,
)
from preisach_jax.quantity import quantity

KNOWN = 1.01
"""Ratio of a parameter's bounds below which the record shows what it is."""


PROBES = 3
"""Values at which an effect is asked what share of the residual it would make."""

NOTHING = 1e-12
"""RMS of a change, in output ranges, that is the computer's rounding."""


@dataclass(frozen=True)
class Limit:
    """How great an effect that was not found could be, with 95 % confidence.

    Attributes:
        effect: its name.
        quantity: what is limited: a parameter, or an amount made of several.
        value: the limit; None if the record says nothing about it.
        unit: its unit.
        above: whether the quantity must lie above the limit (a frequency), and not below.
        rms: RMS change of the output by the effect at its limit, in output units; None if the
            record says nothing.
        absorbed: share of the effect's power that the other parts of the model can take up.
        shown: whether the record itself shows the value, as readings show a converter's step; then
            it is no limit, but what the quantity is.
        poorly_bounded: whether the effect at its limit would make more than the whole error.
    """

    effect: str
    quantity: str
    value: float | None
    unit: str
    above: bool
    rms: float | None
    absorbed: float
    shown: bool = False
    poorly_bounded: bool = False

    def text(self, output_unit: str) -> str:
        """The limit in words."""
        name = self.quantity.removesuffix("_s").removesuffix("_hz").replace("_", " ")
        hidden = f"{100 * self.absorbed:.0f} % of its effect could hide in the density"
        if self.value is None or self.rms is None:
            return f"undetectable in this record: {hidden}"
        value = (
            f"{100 * self.value:.2g} %" if self.unit == "1" else quantity(self.value, self.unit, 2)
        )
        rms = f"{quantity(self.rms, output_unit, 2)} RMS of the output"
        if self.shown:
            return f"{name} of {value}, as the record itself shows ({rms})"
        bound = f"{name} {'above' if self.above else 'below'} {value} ({rms})"
        return (
            f"poorly bounded: {bound}, more than the whole error" if self.poorly_bounded else bound
        )


def limits(problem: Problem, point: Point, effects: Sequence[Effect]) -> tuple[Limit, ...]:
    """How great each of some effects could be without being seen beside a model.

    Each effect's signature, its change of the output at the present weights, is freed from what
    weights and other parameters can take up; its size in the residual and the scatter of that over
    blocks give the limit.

    Returns:
        One limit an effect, in their order; without those whose signature is not finite, and those
        of a user's own that fail.
    """
    whole = with_all_rows(point, problem.identified)
    projection = Projection(problem, whole)

    def limit_of(effect: Effect) -> Limit | None:
        try:
            return _limit(
                problem, whole, projection, effect.bound_to(problem.survey_of(whole, effect))
            )
        except (FloatingPointError, np.linalg.LinAlgError):
            return None  # its signature is not finite: nothing can be said
        except Exception:
            if type(effect).__module__.startswith("preisach_jax."):
                raise
            # The same failure of a user's own effect stands in the table of candidates.
            return None

    return tuple(limit for limit in on_all_cores(limit_of, effects) if limit is not None)


def _limit(problem: Problem, point: Point, projection: Projection, effect: Effect) -> Limit | None:
    if effect.limited_by_residual:
        return _limit_by_the_residual(problem, point, projection, effect)
    limit = _limit_of_amount if amounts_of(effect) else _limit_of_size
    return limit(problem, point, projection, effect)


def _limit_by_the_residual(
    problem: Problem, point: Point, projection: Projection, effect: Effect
) -> Limit | None:
    """The value at which an effect would make the whole residual, but for its scatter."""
    most = projection.most_rms(scipy.special.ndtri(LEVEL))
    first = effect.parameters()[0]
    unit, times, absorbed = problem.shown_unit(first.unit), 1.0, 0.0
    value = rms = np.nan
    for _ in range(PROBES):
        ((values, signature),) = size_signatures(problem, point, effect.probe(times))
        seen = projection.see(signature, values)
        if seen.rms < NOTHING:
            return None
        if not np.isfinite(seen.deviation):
            return Limit(effect.name, first.name, None, unit, False, None, seen.absorbed)
        # How much of them the density takes up depends on where the steps lie.
        absorbed = max(absorbed, seen.absorbed)
        more = most / (seen.rms * np.sqrt(1 - absorbed))
        value, rms, times = more * values[first.name], more * seen.rms, more * times
    rms *= problem.unit
    return Limit(effect.name, first.name, float(value), unit, False, float(rms), absorbed)


def _limit_of_amount(
    problem: Problem, point: Point, projection: Projection, effect: Effect
) -> Limit:
    """The greatest amount, over all values that the other parameters start from."""
    two_sided = scipy.special.ndtri(0.5 + LEVEL / 2)
    amounts = amounts_of(effect)
    first = amounts[0]
    name, _ = first.total
    share = np.array([own.total[1] if own.total[0] == name else 0.0 for own in amounts])
    # The columns of an added effect are limited one by one.
    alone = isinstance(effect, AddedEffect | SensorEffect)
    seen = [
        projection.see(signature, values)
        for values, columns in amount_signatures(problem, point, effect)
        for signature in (columns.T if alone else [columns @ share])
    ]
    visible = [one for one in seen if np.isfinite(one.deviation)]
    absorbed = min((one.absorbed for one in seen), default=1.0)
    unit = problem.shown_unit(first.unit)
    if not visible:
        return Limit(effect.name, name, None, unit, False, None, absorbed)
    # A coefficient of the solver is in output ranges, a parameter in its own unit.
    bounds = [abs(one.size) + two_sided * one.deviation for one in visible]
    worst = int(np.argmax([b * one.rms for b, one in zip(bounds, visible, strict=True)]))
    rms = bounds[worst] * visible[worst].rms * problem.unit
    return Limit(effect.name, name, float(bounds[worst]), unit, False, float(rms), absorbed)


def _limit_of_size(
    problem: Problem, point: Point, projection: Projection, effect: Effect
) -> Limit | None:
    """The weakest value of the first parameter from which on all are excluded."""
    one_sided = scipy.special.ndtri(LEVEL)
    first = effect.parameters()[0]
    signatures = size_signatures(problem, point, effect)
    # A constant says nothing of how great an effect is: a leakage that has just begun shifts all.
    seen = [
        replace(projection.see(signature, values), rms=float(np.std(signature)))
        for values, signature in signatures
    ]
    seen = [one for one in seen if one.rms > 0]
    if not seen:
        return None
    unit, absorbed = problem.shown_unit(first.unit), min(one.absorbed for one in seen)
    if first.high < KNOWN * first.low:
        value, rms = float(seen[0].values[first.name]), float(seen[0].rms) * problem.unit
        return Limit(effect.name, first.name, value, unit, False, rms, absorbed, shown=True)
    seen.sort(key=lambda one: one.rms)
    upper = np.array([max(one.size, 0.0) + one_sided * one.deviation for one in seen])
    open_ = np.flatnonzero(~(upper < 1))
    weakest = int(open_[-1]) + 1 if len(open_) else 0
    ends = np.array([one.values[first.name] for one in seen])
    above = len(ends) > 1 and bool(np.polyfit(np.arange(len(ends)), np.log(ends), 1)[0] < 0)
    if weakest == len(seen):
        return Limit(effect.name, first.name, None, unit, above, None, absorbed)
    value, rms = ends[weakest], seen[weakest].rms
    if weakest == 0 and not above:  # below the first start, the change is in proportion
        value, rms = value * upper[0], rms * upper[0]
    return Limit(
        effect.name, first.name, float(value), unit, above, float(rms) * problem.unit, absorbed
    )

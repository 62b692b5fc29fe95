"""Upper limits for effects that were not found: how great they could be without being seen."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg
import scipy.special

from preisach_jax.chain import Chain, Coefficients, columns_behind, response, tangents
from preisach_jax.confidence import LEVEL
from preisach_jax.effects.base import AddedEffect, Effect, Parameter, SensorEffect
from preisach_jax.identify import ALL, Point, Problem, linearise, starts_of, with_all_rows
from preisach_jax.quantity import quantity

HIDDEN = 1e-4
"""Share of a signature that the rest of the model must leave for it to be seen at all."""


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
    """

    effect: str
    quantity: str
    value: float | None
    unit: str
    above: bool
    rms: float | None
    absorbed: float

    def text(self, output_unit: str) -> str:
        """The limit in words."""
        name = self.quantity.removesuffix("_s").removesuffix("_hz").replace("_", " ")
        hidden = f"{100 * self.absorbed:.0f} % of its effect could hide in the density"
        if self.value is None or self.rms is None:
            return f"undetectable in this record: {hidden}"
        shown = (
            f"{100 * self.value:.2g} %" if self.unit == "1" else quantity(self.value, self.unit, 2)
        )
        side = "above" if self.above else "below"
        return f"{name} {side} {shown} ({quantity(self.rms, output_unit, 2)} RMS of the output)"


@dataclass(frozen=True)
class _Seen:
    """A signature as the record sees it: its estimated size and that one's deviation."""

    values: dict[str, float]
    size: float
    deviation: float
    rms: float
    absorbed: float


class _Projection:
    """Takes out of a signature what the rest of a model can take up, and sizes what is left."""

    def __init__(self, problem: Problem, point: Point):
        self.problem = problem
        linear = linearise(problem, point, point.parameters)
        gram, _ = linear.equations.system(ALL, point.strength)
        free = ~point.equations.nonnegative | (point.solution > 0)
        inside = np.concatenate([free, np.ones(len(point.parameters), dtype=bool)])
        self.matrix = np.concatenate([point.matrix, linear.tangents], axis=1)[:, inside]
        self.factor = scipy.linalg.cho_factor(gram[np.ix_(inside, inside)])
        self.residual = point.residual

    def see(self, signature: np.ndarray, values: dict[str, float]) -> _Seen:
        """Size of a signature, `(row,)` in output ranges, in the residual, with its deviation."""
        whole = float(signature @ signature)
        rms = float(np.sqrt(whole / len(signature)))
        unseen = _Seen(values, np.nan, np.inf, rms, 1.0)
        if not np.isfinite(whole):
            return unseen
        taken_up = scipy.linalg.cho_solve(self.factor, self.matrix.T @ signature)
        left = signature - self.matrix @ taken_up
        power = float(left @ left)
        if power <= HIDDEN**2 * whole:
            return unseen
        scores = np.bincount(self.problem.block, left * self.residual)
        spread = np.sqrt((scores**2).sum() * len(scores) / (len(scores) - 1))
        size = float(left @ self.residual) / power
        return _Seen(values, size, float(spread) / power, rms, 1 - power / whole)


def limits(problem: Problem, point: Point, effects: Sequence[Effect]) -> tuple[Limit, ...]:
    """How great each of some effects could be without being seen beside a model.

    Each effect's signature, its change of the output at the present weights, is freed from what
    weights and other parameters can take up; its size in the residual and the scatter of that over
    blocks give the limit.

    Arguments:
        problem: the record.
        point: the model, refined.
        effects: effects that it does not have.

    Returns:
        One limit an effect, in their order; those whose signature fails are left out.
    """
    whole = with_all_rows(point)
    projection = _Projection(problem, whole)
    survey = problem.survey_of(whole)
    found = []
    for effect in effects:
        try:
            found.append(_limit(problem, whole, projection, effect.bound_to(survey)))
        except Exception:
            # The same failure stands in the table of candidates, where the effect was tried.
            continue
    return tuple(limit for limit in found if limit is not None)


def _limit(problem: Problem, point: Point, projection: _Projection, effect: Effect) -> Limit | None:
    amounts = [p for p in effect.parameters() if p.is_amount or p.start == (0.0,)]
    if isinstance(effect, AddedEffect | SensorEffect):
        amounts = [*amounts, *effect.coefficients()]
    if amounts:
        return _limit_of_amount(problem, point, projection, effect, amounts)
    return _limit_of_size(problem, point, projection, effect)


def _limit_of_amount(
    problem: Problem, point: Point, projection: _Projection, effect: Effect, amounts
) -> Limit:
    """The greatest amount, over all values that the other parameters start from."""
    two_sided = scipy.special.ndtri(0.5 + LEVEL / 2)
    share, name, unit = effect.total_amount(amounts)
    seen = [
        projection.see(columns @ share if whole else columns, values)
        for values, columns, whole in _amount_signatures(problem, point, effect, amounts)
    ]
    visible = [one for one in seen if np.isfinite(one.deviation)]
    absorbed = min((one.absorbed for one in seen), default=1.0)
    unit = problem.shown_unit(unit)
    if not visible:
        return Limit(effect.name, name, None, unit, False, None, absorbed)
    # A coefficient of the solver is in output ranges, a parameter in its own unit.
    bounds = [abs(one.size) + two_sided * one.deviation for one in visible]
    worst = int(np.argmax([b * one.rms for b, one in zip(bounds, visible, strict=True)]))
    rms = bounds[worst] * visible[worst].rms * problem.unit
    return Limit(effect.name, name, float(bounds[worst]), unit, False, float(rms), absorbed)


def _amount_signatures(
    problem: Problem, point: Point, effect: Effect, amounts: list[Parameter]
) -> Iterator[tuple[dict[str, float], np.ndarray, bool]]:
    chain = point.chain.with_effects((*point.chain.effects, effect))
    names = [(effect.name, parameter.name) for parameter in amounts]
    for values in starts_of(effect):
        if isinstance(effect, AddedEffect | SensorEffect):
            alone = point.chain.with_effects((effect,))
            own = {effect.name: values}
            parts = columns_behind(alone, own, problem.signals, problem.rows, problem.target)
            for column in np.concatenate(parts, axis=1)[problem.rows].T:
                yield values, column / problem.unit, False
            continue
        everything = {**point.values, effect.name: values}
        raw = tangents(chain, everything, problem.signals, _with_room(point, chain), names)
        yield values, raw[problem.rows] / problem.unit, True


def _limit_of_size(
    problem: Problem, point: Point, projection: _Projection, effect: Effect
) -> Limit | None:
    """The weakest value of the first parameter from which on all are excluded."""
    one_sided = scipy.special.ndtri(LEVEL)
    first = effect.parameters()[0]
    chain = point.chain.with_effects((*point.chain.effects, effect))
    coefficients = _with_room(point, chain)
    present = np.asarray(response(point.chain, point.values, problem.signals, point.coefficients()))
    seen = []
    for values in starts_of(effect):
        everything = {**point.values, effect.name: values}
        changed = np.asarray(response(chain, everything, problem.signals, coefficients))
        seen.append(projection.see((changed - present)[problem.rows] / problem.unit, values))
    seen = [one for one in seen if one.rms > 0]
    if not seen:
        return None
    seen.sort(key=lambda one: one.rms)
    upper = np.array([max(one.size, 0.0) + one_sided * one.deviation for one in seen])
    open_ = np.flatnonzero(~(upper < 1))
    weakest = int(open_[-1]) + 1 if len(open_) else 0
    ends = np.array([one.values[first.name] for one in seen])
    above = len(ends) > 1 and bool(np.polyfit(np.arange(len(ends)), np.log(ends), 1)[0] < 0)
    unit, absorbed = problem.shown_unit(first.unit), min(one.absorbed for one in seen)
    if weakest == len(seen):
        return Limit(effect.name, first.name, None, unit, above, None, absorbed)
    value, rms = ends[weakest], seen[weakest].rms
    if weakest == 0 and not above:  # below the first start, the change is in proportion
        value, rms = value * upper[0], rms * upper[0]
    return Limit(
        effect.name, first.name, float(value), unit, above, float(rms) * problem.unit, absorbed
    )


def _with_room(point: Point, chain: Chain) -> Coefficients:
    """The coefficients of a point, with none for what a longer chain adds."""
    present = point.coefficients()
    by_name = dict(
        zip([(e, c.name) for e, c in point.chain.coefficients], present.added, strict=True)
    )
    added = [by_name.get((e, c.name), 0.0) for e, c in chain.coefficients]
    return replace(present, added=np.asarray(added))

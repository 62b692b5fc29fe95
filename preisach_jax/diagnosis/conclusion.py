"""From a search to its diagnosis: final fits, budget, limits, verdict."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from preisach_jax.cores import on_all_cores
from preisach_jax.diagnosis.budget import Floor, error_budget, grid_rms, refined_levels
from preisach_jax.diagnosis.evidence import LEAST_SCORE, Evidence, predicted_errors, simple_ratio
from preisach_jax.diagnosis.limits import Limit, limits
from preisach_jax.diagnosis.memoryless import memoryless
from preisach_jax.diagnosis.past import of_the_first_rise, of_the_past
from preisach_jax.diagnosis.plausible import implausible
from preisach_jax.diagnosis.remainder import relations
from preisach_jax.diagnosis.result import Budget, Candidate, Diagnosis, Finding, Rung
from preisach_jax.diagnosis.search import Selection
from preisach_jax.diagnosis.tellable import REASONS, shows_little
from preisach_jax.diagnosis.tellable import notes as untellable_notes
from preisach_jax.diagnosis.wording import (
    located,
    next_experiment,
    notes_on,
    of_hysteresis,
    sentence,
)
from preisach_jax.effects.base import Effect
from preisach_jax.fit import Fit, Progress
from preisach_jax.fit.fitted import FINAL_ROWS, finished
from preisach_jax.fit.stepwise import (
    at_levels,
    in_silence,
    moved_to,
    on_a_coarser_plane,
    with_signs,
)
from preisach_jax.identify.confidence import with_model_error
from preisach_jax.identify.problem import Point, Problem
from preisach_jax.look import look
from preisach_jax.model import Model
from preisach_jax.record.core import Record

MOST_MISSED = 0.3
"""RMS error of a final model, over the spread of the output, beyond which no effect is named."""

NO_LIMITS = "This record does not show {}, if there (see preisach look): no limits are given."

TOO_LITTLE = (
    "with all effects found, the model still misses most of the output: no effect can be named "
    "reliably"
)

NOT_ON_ALL_ROWS = "it improves the rows used in the search, but too little on the whole record"

WITHOUT_A_LAW = (
    "it follows no law, and much of what it should explain remains: no effect can be named reliably"
)

MOST_LEFT_BY_NONPARAMETRIC = 0.1
"""Unexplained RMS error, over that which a form without a law takes up, beyond which it is no name
for what was there."""

A_LITTLE = 1.25
"""Factor on a score, or on the error allowed, within which a verdict is close."""


def verdict_of(budget: Budget, named: bool, tolerance: float = 0.0) -> tuple[str, bool]:
    """The verdict on a model, and whether what remains is taken to be within the budget.

    Arguments:
        named: whether the model has effects.
        tolerance: RMS error, in output units, that does not matter.
    """
    met = budget.is_met or budget.unexplained <= tolerance
    if named:
        return ("explained" if met else "partly_explained"), met
    return ("adequate" if met else "unexplained"), met


def assembled(
    fits: Sequence[Fit],
    findings: tuple[Finding, ...],
    budget: Budget,
    candidates: tuple[Candidate, ...],
    bounds: tuple[Limit, ...],
    tried: Sequence[Effect],
    notes: Sequence[str],
    *,
    tolerance: float = 0.0,
    alternatives: dict[str, Model] | None = None,
    little: bool = False,
) -> Diagnosis:
    """A diagnosis of its parts, whether the program or somebody by hand has chosen the effects.

    Arguments:
        tolerance: RMS error, in output units, that does not matter.
        little: whether the record cannot tell most of the effects that were tried.
    """
    record, last = fits[-1].record, fits[-1]
    verdict, met = verdict_of(budget, bool(findings), tolerance)
    # Beside an error that nothing explains, how great an effect could be is not known.
    bounds = () if verdict == "unexplained" else bounds
    silent = look(record).cannot_tell
    not_shown = [bound.effect for bound in bounds if bound.effect in silent]
    if not_shown:
        notes = [*notes, NO_LIMITS.format(", ".join(not_shown))]
    bounds = tuple(
        replace(bound, poorly_bounded=(bound.rms or 0.0) > last.rms_validation and not bound.shown)
        for bound in bounds
        if bound.effect not in silent
    )
    close = close_calls(findings, candidates, budget, met)
    shows_none = bool(candidates) and all(c.why_not in REASONS.values() for c in candidates)
    found = Diagnosis(
        verdict=verdict,
        sentence=sentence(verdict, findings, budget, fits, tolerance, close, shows_none),
        close=close,
        findings=findings,
        ladder=tuple(Rung.of(fit) for fit in fits),
        budget=budget,
        candidates=candidates,
        limits=bounds,
        alternatives=alternatives or {},
        next_experiment=next_experiment(verdict, findings, tried, little),
        located="" if met else located(record, last.residual),
        remainder=() if met else relations(record, last.residual, _lines(last.model)),
        notes=tuple(notes),
        steps=tuple(fits),
        memoryless=memoryless(fits[0], tolerance),
    )
    return replace(found, sentence=" ".join([*of_hysteresis(found), found.sentence]))


def _lines(model: Model) -> dict[str, tuple[float, ...]]:
    """Frequencies in Hz that the effects of a model have, by their names."""
    return {
        name: tuple(each.value for each in estimates.values() if each.unit == "Hz")
        for name, estimates in model.parameters.items()
    }


@dataclass(frozen=True, eq=False)
class Final:
    """A model fitted to all rows.

    Attributes:
        fit: the fit, without its regressors, which are great.
        floor: what no other effect can take away from its error.
        errors: (stretch,) mean squares that it predicts, in squared output ranges.
        objections: what of its effects all rows show to be none of them, by their names.
    """

    fit: Fit
    floor: Floor
    errors: np.ndarray
    objections: Mapping[str, str]


class Finals:
    """Models that were found on some rows of a record, fitted to all of them, each once.

    Arguments:
        record: the record.
        search: the record as it was cut for the search.
    """

    def __init__(self, record: Record, search: Problem):
        self.record, self.search = record, search
        self.whole = Problem.of(record, FINAL_ROWS)
        self._known: dict[Point, Final] = {}

    def of(self, points: Sequence[Point]) -> list[Final]:
        """The models, in their order."""
        bases = self.whole.reduced(self.search)

        def final(point: Point) -> Final:
            own, reduced = replace(self.whole, cache={}), replace(bases, cache=dict(bases.cache))
            fit = finished(own, moved_to(reduced, point), self.record)
            told = {name: implausible(own, fit.point, name) for name in fit.effects}
            floor, errors = Floor.of(own, fit), predicted_errors(own, fit.point)
            objections = {name: text for name, text in told.items() if text}
            return Final(replace(fit, point=fit.point.slim), floor, errors, objections)

        new = [point for point in points if point not in self._known]
        self._known |= zip(new, on_all_cores(final, new), strict=True)
        return [self._known[point] for point in points]


@dataclass(frozen=True, eq=False)
class Fitted:
    """The models of a path fitted to all rows, and what the last one leaves.

    Attributes:
        finals: the models.
        other: the last one on another plane.
        planes: both, with all hysterons and weights of one sign.
        budget: of the last one.
    """

    finals: list[Final]
    other: Point
    planes: tuple[Point, Point]
    budget: Budget

    @staticmethod
    def of(known: Finals, all_hysterons: Problem, selection: Selection) -> Fitted:
        """The models of a selection."""
        problem, now = selection.problem, selection.now
        finals = known.of(selection.path)
        rows = min(len(problem.record), FINAL_ROWS)
        finer = refined_levels(rows, now.chain.plane.levels)
        coarser = finer is None
        other = on_a_coarser_plane(problem, now) if coarser else at_levels(problem, now, finer)
        planes = with_signs(all_hysterons, now), with_signs(all_hysterons, other)
        last = finals[-1]
        grid = grid_rms(all_hysterons, last.fit, *planes)
        budget = error_budget(known.whole, last.fit, last.floor, grid)
        return Fitted(finals, other, planes, budget)


def concluded(
    finals: Finals,
    all_hysterons: Problem,
    selection: Selection,
    tolerance: float,
    progress: Progress = in_silence,
) -> Diagnosis:
    """The diagnosis that a search comes to.

    Its models are fitted to all rows; effects that all rows speak against are given up.

    Arguments:
        finals: the models that were fitted to all rows on the way.
        all_hysterons: the record as it was cut for the search, for models with all hysterons.
        tolerance: RMS error, in output units, that does not matter.
    """
    record, problem = finals.record, selection.problem
    measured = problem.target / problem.unit
    # Where hysteresis is not what makes the output, the first effect that bends the model towards
    # it is seldom what is there: a damper's force looks like a displacement delayed.
    if selection.now.validation_mean_square > MOST_MISSED**2 * measured.var():
        while selection.names:
            selection = selection.without(len(selection.names) - 1, TOO_LITTLE)
    progress("fitting all rows", 0.95)
    fitted = Fitted.of(finals, all_hysterons, selection)
    while (against := _refuted(selection, fitted)) is not None:
        selection = selection.without(*against)
        fitted = Fitted.of(finals, all_hysterons, selection)
    fits = [final.fit for final in fitted.finals]
    budget, planes = fitted.budget, fitted.planes
    progress("limiting the effects that were not found", 0.98)
    spoken_of = {*selection.names, *(name for own in selection.rivals for name in own)}
    absent = [effect for effect in selection.tried if effect.name not in spoken_of]
    # What the grid of the plane adds must not pass for an effect: the finest plane is best.
    finest = max(planes, key=lambda point: point.chain.plane.levels)
    parameters = with_model_error(fits[-1].model.parameters, selection.now, fitted.other)
    model = replace(fits[-1].model, parameters=parameters)
    model = model.with_budget(budget.noise, budget.discretisation)
    fits[-1] = replace(fits[-1], model=model)
    rivals = [(name, point) for own in selection.rivals for name, point in own.items()]
    in_place = finals.of([point for _, point in rivals])
    return assembled(
        fits,
        tuple(_finding(selection, fits, position) for position in range(len(selection.names))),
        budget,
        selection.candidates,
        limits(all_hysterons, finest, absent),
        selection.tried,
        (
            *notes_on(record, model),
            *of_the_first_rise(record, model, fits[-1].rms_validation),
            *of_the_past(record, model, fits[-1].rms_validation),
            *untellable_notes(finals.whole, selection.tried),
            *selection.failures,
        ),
        tolerance=tolerance,
        little=shows_little(finals.whole, selection.tried),
        alternatives={
            name: final.fit.model for (name, _), final in zip(rivals, in_place, strict=True)
        },
    )


def _refuted(selection: Selection, fitted: Fitted) -> tuple[int, str] | None:
    """The place of an effect that all rows speak against, and what they say; None if of none."""
    finals, budget, unit = fitted.finals, fitted.budget, selection.problem.unit
    last = finals[-1]
    for position, name in enumerate(selection.names):
        if objection := last.objections.get(name):
            return position, objection
    if len(finals) > 1:
        before = finals[-2]
        gain = 1 - simple_ratio(last.fit.rms_validation**2, before.fit.rms_validation**2)
        if Evidence.of(before.errors, last.errors, gain, selection.floor).against:
            return len(finals) - 2, NOT_ON_ALL_ROWS
    for position, name in enumerate(selection.names):
        taken = float(np.std(fitted.planes[0].share_of(name)) * unit)
        # Slow waves follow a part of whatever is slow: of a sensor that jumps, or a wandering gain.
        nonparametric = selection.now.chain.effect(name).nonparametric
        if nonparametric and budget.unexplained > MOST_LEFT_BY_NONPARAMETRIC * taken:
            return position, WITHOUT_A_LAW
    return None


def _finding(selection: Selection, fits: Sequence[Fit], position: int) -> Finding:
    name, before, after = selection.names[position], fits[position], fits[position + 1]
    tried = next(t for t in selection.steps[position] if t.effect == name and t.evidence)
    assert tried.evidence is not None
    return Finding(
        name,
        (name, *selection.rivals[position]),
        fits[-1].model.parameters[name],
        before.rms_validation,
        after.rms_validation,
        tried.evidence.numbers(),
    )


def close_calls(
    findings: Sequence[Finding], candidates: Sequence[Candidate], budget: Budget, met: bool
) -> tuple[str, ...]:
    """What a little more or less data could turn: scores, or an error, near their limits.

    Arguments:
        met: whether the error that is not explained was taken to be within the budget.

    Returns:
        A clause each; empty if the verdict is clear.
    """

    def is_near(evidence: Mapping[str, float]) -> bool:
        return 1 / A_LITTLE < evidence.get("score", 0.0) / LEAST_SCORE < A_LITTLE

    calls = [
        f"{each.effect} passes by a small margin" for each in findings if is_near(each.evidence)
    ]
    last = [c for c in candidates if c.step == len(findings) and not c.accepted]
    refused = [c.effect for c in last if is_near(c.evidence) and c.evidence["score"] < LEAST_SCORE]
    calls += [f"{name} fails by a small margin" for name in dict.fromkeys(refused)]
    least, most = budget.allowed / A_LITTLE**0.5, budget.allowed * A_LITTLE**0.5
    if met == budget.is_met and least < budget.unexplained < most:
        side = "just within" if met else "just beyond"
        calls.append(f"what is not explained is {side} noise and discretisation")
    return tuple(calls)

"""From the last step of a diagnosis to its result: final fits, budget, limits, verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from preisach_jax.diagnosis.budget import discretisation_rms, error_budget
from preisach_jax.diagnosis.evidence import LEAST_GAIN, compare
from preisach_jax.diagnosis.finals import Final, FinalFits
from preisach_jax.diagnosis.limits import Limit, limits
from preisach_jax.diagnosis.margin import close_calls
from preisach_jax.diagnosis.memoryless import memoryless
from preisach_jax.diagnosis.past import of_the_first_rise, of_the_past
from preisach_jax.diagnosis.remainder import relations
from preisach_jax.diagnosis.result import Budget, Candidate, Diagnosis, Finding, Rung
from preisach_jax.diagnosis.step import Step, signed_planes
from preisach_jax.diagnosis.tellable import REASONS, shows_little
from preisach_jax.diagnosis.tellable import notes as untellable_notes
from preisach_jax.diagnosis.trial import (
    NOT_ON_ALL_ROWS,
    TOO_LITTLE,
    TOO_SLIGHT,
    WITHOUT_A_LAW,
    failures,
    given_up_rows,
)
from preisach_jax.diagnosis.walk import with_rival_leading
from preisach_jax.diagnosis.within_cells import within_cells_rms
from preisach_jax.diagnosis.wording import (
    located,
    next_experiment,
    notes_on,
    of_hysteresis,
    sentence,
)
from preisach_jax.effects.base import Effect
from preisach_jax.fit import Fit, Progress, in_silence
from preisach_jax.identify import Point
from preisach_jax.identify.confidence import with_model_error
from preisach_jax.look import look
from preisach_jax.model import Model

MOST_MISSED = 0.3
"""RMS error of a final model, over the spread of the output, beyond which no effect is named."""

MOST_LEFT_BY_THE_LAWLESS = 0.1
"""Unexplained RMS error, over that which a form without a law takes up, beyond which it is no name
for what was there."""

NO_LIMITS = "This record does not show {}, if there (see preisach look): no limits are given."

LEAST_BESIDE_THE_UNEXPLAINED = 0.2
"""Mean square that the last effect must take away, over that which stays unexplained beside it."""


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


def concluded(
    step: Step, finals: FinalFits, tolerance: float, progress: Progress = in_silence
) -> Diagnosis:
    """The diagnosis that a last step comes to.

    Its models are fitted to all rows; effects that help too little there are given up.

    Arguments:
        tolerance: RMS error, in output units, that does not matter.
    """
    step = step.compared
    rivals = {name: point for named in step.named for name, point in named.rivals.items()}
    for point in (*step.path, *rivals.values()):
        finals.begin(step.problem, point)
    # Meanwhile, for the step that this will most likely be:
    progress("limiting the effects that were not found", 0.0)
    planes = signed_planes(step)
    limited, bounds = step, _limits(step, planes)
    known = step
    step = _with_plausible_rivals(step, finals)
    while True:
        step, fitted = _fitted(step, finals, progress)
        fits = [final.fit for final in fitted]
        step = step.compared
        if step is not known:
            known, planes = step, signed_planes(step)
        now, other = planes
        within = within_cells_rms(step.record, fits[-1].residual, now.chain.plane)
        discretisation = discretisation_rms(step.all_hysterons, now, other, within)
        progress("measuring the error budget", 0.9)
        budget = error_budget(finals.problem, fits[-1], fitted[-1].floor, discretisation)
        fewer = (
            _without_what_the_drive_makes(step, fitted[-1])
            or _without_the_lawless(step, budget)
            or _without_the_slight(step, budget, fits, tolerance)
        )
        if fewer is None:
            break
        step = fewer
    if step is not limited:
        bounds = _limits(step, planes)
    parameters = with_model_error(fits[-1].model.parameters, step.now, step.other or step.now)
    model = replace(fits[-1].model, parameters=parameters)
    model = model.with_budget(budget.noise, budget.discretisation)
    fits[-1] = replace(fits[-1], model=model)
    return assembled(
        fits,
        _findings(step, fits),
        budget,
        step.candidates,
        bounds,
        step.tried,
        (
            *notes_on(step.record, model),
            *of_the_first_rise(step.record, model, fits[-1].rms_validation),
            *of_the_past(step.record, model, fits[-1].rms_validation),
            *untellable_notes(finals.problem, step.tried),
            *failures(list(step.trials)),
        ),
        tolerance=tolerance,
        little=shows_little(finals.problem, step.tried),
        alternatives={
            name: finals.of(step.problem, point).fit.model
            for named in step.named
            for name, point in named.rivals.items()
        },
    )


def _limits(step: Step, planes: tuple[Point, Point]) -> tuple[Limit, ...]:
    """How great each effect could be that is not in the model of a step, nor like one in it."""
    spoken_of = {name for named in step.named for name in (named.name, *named.rivals)}
    absent = [effect for effect in step.tried if effect.name not in spoken_of]
    # What the grid of the plane adds must not pass for an effect: the finest plane is best.
    finest = max(planes, key=lambda point: point.chain.plane.levels)
    return limits(step.all_hysterons, finest, absent)


def without_what_explains_too_little(step: Step) -> Step:
    """Name nothing where the final model still misses much of the output.

    Where hysteresis is not what makes the output, the first effect that bends the model
    towards it is seldom what is there: a damper's force looks like a displacement delayed.
    """
    measured = step.problem.target / step.problem.unit
    if step.now.validation_mean_square <= MOST_MISSED**2 * measured.var():
        return step
    rows = given_up_rows(list(step.trials), [named.trial for named in step.named], TOO_LITTLE)
    return replace(step, named=(), path=step.path[:1], trials=tuple(rows), other=None)


def _without_the_last(step: Step, objection: str) -> Step:
    rows = given_up_rows(list(step.trials), [step.named[-1].trial], objection)
    return replace(step, named=step.named[:-1], path=step.path[:-1], trials=tuple(rows), other=None)


def _without_the_lawless(step: Step, budget: Budget) -> Step | None:
    """Take back a form without a law that leaves much unexplained beside what it takes up.

    Slow waves follow a part of whatever is slow: of a sensor that jumps, or a wandering gain.
    """
    for position, named in enumerate(step.named):
        effect = step.now.chain.effect(named.name)
        taken = float(np.std(step.now.share_of(named.name)) * step.problem.unit)
        if effect.lawless and budget.unexplained > MOST_LEFT_BY_THE_LAWLESS * taken:
            return _without(step, position, WITHOUT_A_LAW)
    return None


def _with_plausible_rivals(step: Step, finals: FinalFits) -> Step:
    """Let a rival stand for an effect that all rows show at a bound, if they do not so of it."""
    for position, named in enumerate(step.named):
        if named.name not in finals.of(step.problem, step.now).contradicted:
            continue
        ranked = sorted(named.rivals.items(), key=lambda item: item[1].validation_mean_square)
        for rival, point in ranked:
            if rival not in finals.of(step.problem, point).contradicted:
                step = with_rival_leading(step, position, rival)
                break
    return step


def _without_what_the_drive_makes(step: Step, final: Final) -> Step | None:
    """Take back an effect that shows itself on all rows to come from the drive."""
    for position, named in enumerate(step.named):
        if objection := final.from_the_drive.get(named.name):
            return _without(step, position, objection)
    return None


def _without(step: Step, position: int, objection: str) -> Step:
    kept = (*step.named[:position], *step.named[position + 1 :])
    rows = given_up_rows(list(step.trials), [step.named[position].trial], objection)
    path = step.ladder([each.name for each in kept])
    return replace(step, named=kept, path=path, trials=tuple(rows), other=None)


def _without_the_slight(
    step: Step, budget: Budget, fits: Sequence[Fit], tolerance: float
) -> Step | None:
    """Take back a last effect that does little beside what stays unexplained.

    Beside physics that the library does not have, whatever bends the model a little towards it
    passes the tests.
    """
    if not step.named or budget.is_met or budget.unexplained <= tolerance:
        return None
    taken = fits[-2].rms_validation ** 2 - fits[-1].rms_validation ** 2
    if taken >= LEAST_BESIDE_THE_UNEXPLAINED * budget.unexplained**2:
        return None
    return _without_the_last(step, TOO_SLIGHT)


def _fitted(step: Step, finals: FinalFits, progress: Progress) -> tuple[Step, list[Final]]:
    """The fit of each model; last effects that help too little on all rows are given up."""
    fitted: list[Final] = []
    for position, point in enumerate(step.path):
        progress("fitting all rows", 0.4 + 0.5 * position / len(step.path))
        fitted.append(finals.of(step.problem, point))
    # The first test, on all rows.
    most = (1 - LEAST_GAIN) ** 0.5
    errors = [final.fit.rms_validation for final in fitted]
    while len(fitted) > 1 and not errors[len(fitted) - 1] <= most * errors[len(fitted) - 2]:
        step = _without_the_last(step, NOT_ON_ALL_ROWS)
        fitted.pop()
    return step, fitted


def _findings(step: Step, fits: Sequence[Fit]) -> tuple[Finding, ...]:
    findings: list[Finding] = []
    for position, named in enumerate(step.named):
        before, after = fits[position], fits[position + 1]
        evidence = compare(step.problem, step.path[position], step.path[position + 1])
        findings.append(
            Finding(
                named.name,
                (named.name, *named.rivals),
                fits[-1].model.parameters[named.name],
                before.rms_validation,
                after.rms_validation,
                evidence.numbers(),
            )
        )
    return tuple(findings)

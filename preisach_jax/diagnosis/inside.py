"""The hysteresis inside the mechanics, tried where a resonance behind it leaves something."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from preisach_jax.diagnosis.budget import budget_of_residual
from preisach_jax.diagnosis.conclusion import MOST_MISSED, assembled
from preisach_jax.diagnosis.evidence import Evidence, compare_fits
from preisach_jax.diagnosis.result import Candidate, Diagnosis, Finding
from preisach_jax.diagnosis.search import Selection
from preisach_jax.diagnosis.wording import notes_on
from preisach_jax.errors import InputError
from preisach_jax.fit import Fit, Progress
from preisach_jax.fit.fitted import on_all_rows
from preisach_jax.fit.mechanical import fit_inside
from preisach_jax.quantity import quantity
from preisach_jax.record.core import Record

LEAST_GAIN = 0.5
"""Relative fall of the held-out mean square against a resonance below which the hysteresis is not
said to be inside the mechanics: near a weak loop both say nearly the same."""

NO_FRICTION = "the intervals of its share or of its yielding include zero: a spring does as well"

MISSES_MUCH = "the model with it still misses much of the output"


def with_mechanics(
    found: Diagnosis,
    selection: Selection,
    record: Record,
    effect: Any,
    tolerance: float,
    progress: Progress,
    *,
    asked: bool = False,
) -> Diagnosis:
    """The diagnosis, with the hysteresis inside the mechanics if that passes.

    It is simulated, alone, which takes a minute: only where a resonance was named, or does
    most and was not, and more remains than the budget.  It takes the place of all other effects,
    and must pass against the model with the resonance.

    Arguments:
        tolerance: RMS error, in output units, that does not matter.
        asked: whether the effect was asked for: then it is tried wherever something is left.
    """
    if effect is None or found.base.record.runs or not found.leaves_a_part:
        return found
    rival = _rival(found, selection, record, effect.confused_with)
    if rival is None:
        if not asked:
            return found
        rival = found.final
    before = min(rival, found.final, key=lambda fit: fit.rms_validation)
    levels = found.base.model.plane.levels
    try:
        fit = fit_inside(
            record,
            effect,
            found.base.point,
            levels,
            lambda text, done: progress(text, 0.9 + 0.1 * done),
            to_beat=before.rms_validation,
        )
    except InputError as error:
        why_not = str(error).removeprefix(f"{record.name}: ")
        row = Candidate(effect.name, 0, 0.0, np.nan, {}, False, f"not fitted: {why_not}")
        return replace(found, candidates=(*found.candidates, row))
    objection = _objection(compare_fits(before, fit), fit)
    evidence = compare_fits(found.base, fit)
    row = Candidate(
        effect.name,
        0,
        evidence.gain,
        fit.rms_validation,
        evidence.numbers(),
        not objection,
        objection,
    )
    if objection:
        return replace(found, candidates=(*found.candidates, row))
    return _inside(found, selection, before, fit, row, tolerance)


def _rival(
    found: Diagnosis, selection: Selection, record: Record, rivals: tuple[str, ...]
) -> Fit | None:
    """The model with a resonance that is to be beaten; None where no resonance leads."""
    if any(name in found.effects for name in rivals):
        return found.final
    first = [tried for tried in selection.steps[0] if tried.model and tried.evidence]
    best = max(first, key=lambda each: each.evidence.gain if each.evidence else 0.0, default=None)
    if found.effects or best is None or best.effect not in rivals or best.model is None:
        return None
    if best.evidence is None or not best.evidence.gain > 0:
        return None
    return on_all_rows(record, selection.problem, best.model.point)


def _objection(evidence: Evidence, fit: Fit) -> str:
    """What speaks against it, beside a model with a resonance; empty if nothing does."""
    if evidence.against:
        return f"against a resonance, {evidence.against}"
    if not evidence.gain >= LEAST_GAIN:
        return (
            f"against a resonance, the held-out mean square falls by {100 * evidence.gain:.1f} %, "
            f"less than {100 * LEAST_GAIN:.0f} %"
        )
    (estimates,) = fit.model.parameters.values()
    shown = [estimates[name] for name in ("share", "beta") if name in estimates]
    if any(each.low <= 0 <= each.high for each in shown):
        return NO_FRICTION
    spread = float(np.nanstd(fit.record.output))
    return MISSES_MUCH if fit.rms_validation > MOST_MISSED * spread else ""


def _inside(
    found: Diagnosis, selection: Selection, before: Fit, fit: Fit, row: Candidate, tolerance: float
) -> Diagnosis:
    """The diagnosis that names it in place of all other effects."""
    budget = budget_of_residual(fit)
    fit = replace(fit, model=fit.model.with_budget(budget.noise, 0.0))
    finding = Finding(
        row.effect,
        (row.effect,),
        fit.model.parameters[row.effect],
        found.base.rms_validation,
        fit.rms_validation,
        row.evidence,
    )
    others = tuple(
        replace(each, accepted=False, why_not=f"{row.effect} does more") if each.accepted else each
        for each in found.candidates
    )
    sizes = [quantity(each.rms_validation, budget.unit, 3) for each in (before, fit)]
    note = (
        "The hysteresis is inside the mechanics, driven by the output: that leaves "
        f"{sizes[1]} RMS held out, where a hysteresis of the input with a resonance behind it "
        f"leaves {sizes[0]}. What other effects could be hidden beside it was not asked."
    )
    return assembled(
        (found.base, fit),
        (finding,),
        budget,
        (*others, row),
        (),
        selection.tried,
        (*notes_on(fit.record, found.base.model), note),
        tolerance=tolerance,
    )

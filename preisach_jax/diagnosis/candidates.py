"""Every effect tried beside a model, at the same time on all cores."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from preisach_jax.confidence import Certainty, differs_from_nothing
from preisach_jax.cores import on_all_cores
from preisach_jax.diagnosis.evidence import compare
from preisach_jax.diagnosis.signature import Projection, promises
from preisach_jax.diagnosis.trial import NotFitted, Trial
from preisach_jax.effects.auxiliary import Auxiliary
from preisach_jax.effects.base import Effect, HysteresisEffect, InputEffect
from preisach_jax.fit import LEAST_PROMISE, Progress, with_effect
from preisach_jax.identify import Point, Problem


def try_beside(
    problem: Problem, point: Point, effects: Sequence[Effect], step: int, progress: Progress
) -> list[Trial | NotFitted]:
    """Try each of some effects beside a model: screened, refitted jointly, and judged.

    Those that move the input or the thresholds, and so mean all states anew, come last: most of
    their forms need not be tried then.

    Arguments:
        problem: the record.
        point: the model.
        effects: effects that it does not have.
        step: how many effects it has.
        progress: called with a text and the share of the effects that are done.

    Returns:
        What came of each, in the order in which they were tried.
    """
    moving = (InputEffect, HysteresisEffect)
    projection = Projection(problem, point)
    trials: list[Trial | NotFitted] = []
    for late in (False, True):
        group = [effect for effect in effects if isinstance(effect, moving) == late]
        fitted = [t.point.validation_mean_square for t in trials if isinstance(t, Trial)]
        to_beat = min(fitted, default=np.inf)

        def try_one(effect: Effect, to_beat: float = to_beat) -> Trial | NotFitted:
            return _try(problem, point, effect, step, projection, to_beat)

        for effect, trial in zip(group, on_all_cores(try_one, group), strict=True):
            trials.append(trial)
            progress(f"tried {effect.name}", len(trials) / len(effects))
    return trials


def _try(
    problem: Problem,
    point: Point,
    effect: Effect,
    step: int,
    projection: Projection,
    to_beat: float,
) -> Trial | NotFitted:
    if isinstance(effect, Auxiliary) and np.ptp(problem.record.aux[effect.column]) == 0:
        value = problem.record.aux[effect.column][0]
        return NotFitted(effect, step, f"the column is constant ({value:g}): nothing can be seen")
    try:
        promised = _promise(problem, point, effect, projection)
        if promised < LEAST_PROMISE:
            return NotFitted.screened(effect, step, promised)
        rich = with_effect(problem, point, effect, to_beat=to_beat)
        evidence = compare(problem, point, rich)
        # What the locks refuse need not be asked how sure it is.
        certain = (
            Certainty(alone=True, together=True)
            if evidence.against
            else differs_from_nothing(problem, rich, effect.name)
        )
        return Trial(effect, step, rich, evidence, certain)
    except (FloatingPointError, np.linalg.LinAlgError) as error:
        return NotFitted(effect, step, f"could not be fitted: {error}")
    except Exception as error:
        if type(effect).__module__.startswith("preisach_jax."):
            raise
        # A user's own effect must not take the diagnosis of the others with it.
        reason = f"failed: {type(error).__name__}: {error}"
        return NotFitted(effect, step, reason, failed=True)


def _promise(problem: Problem, point: Point, effect: Effect, projection: Projection) -> float:
    """Share of the residual that an effect explains; at least `LEAST_PROMISE` is enough."""
    greatest = 0.0
    for form in problem.forms_of(effect, point):
        for share in promises(problem, point, projection, form):
            greatest = max(greatest, share)
            if greatest >= LEAST_PROMISE:
                return greatest
    return greatest

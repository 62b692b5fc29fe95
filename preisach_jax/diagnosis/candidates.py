"""Every effect tried beside a model: screened to first order, and the leading ones refitted."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np

from preisach_jax.confidence import Certainty, differs_from_nothing
from preisach_jax.cores import on_all_cores
from preisach_jax.diagnosis.evidence import compare
from preisach_jax.diagnosis.trial import NotFitted, Trial
from preisach_jax.effects.auxiliary import Auxiliary
from preisach_jax.effects.base import Effect, HysteresisEffect, InputEffect
from preisach_jax.fit import LEAST_PROMISE, Progress, with_effect
from preisach_jax.identify import Point, Problem
from preisach_jax.signature import Projection, Prospect, prospects

Found = TypeVar("Found")

LEADERS = 4
"""Effects that are refitted jointly, those that promise most first."""

LEADS = 0.5
"""Share of the greatest promise with which an effect is refitted as well, however many are."""


def try_beside(
    problem: Problem, point: Point, effects: Sequence[Effect], step: int, progress: Progress
) -> list[Trial | NotFitted]:
    """Try each of some effects beside a model: screened, and refitted jointly if it leads.

    What an effect promises to first order costs a thousandth of a joint refit.  Those that promise
    most are refitted and judged; those that move the input or the thresholds, and so mean all
    states anew, come last: most of their forms need not be tried then.

    Arguments:
        problem: the record.
        point: the model.
        effects: effects that it does not have.
        step: how many effects it has.
        progress: called with a text and the share of the work that is done.

    Returns:
        What came of each, in the order in which they were tried.
    """
    projection = Projection(problem, point)
    trials: list[Trial | NotFitted] = []
    promised: dict[Effect, list[Prospect]] = {}

    def promise(effect: Effect) -> list[Prospect] | NotFitted:
        return _guarded(effect, step, lambda: _promise(problem, point, effect, step, projection))

    for effect, found in zip(effects, on_all_cores(promise, effects), strict=True):
        progress(f"looking for {effect.name}", 0.5 * (len(trials) + len(promised)) / len(effects))
        if isinstance(found, NotFitted):
            trials.append(found)
        else:
            promised[effect] = found
    leading = _leading(promised)
    for effect, found in promised.items():
        if effect not in leading:
            trials.append(NotFitted.outshone(effect, step, _best(found).held_out))
    moving = (InputEffect, HysteresisEffect)
    begun = len(trials)
    for late in (False, True):
        group = [effect for effect in leading if isinstance(effect, moving) == late]
        fitted = [t.point.validation_mean_square for t in trials if isinstance(t, Trial)]
        to_beat = min(fitted, default=np.inf)

        def refit(effect: Effect, to_beat: float = to_beat) -> Trial | NotFitted:
            known = promised[effect]
            return _guarded(
                effect, step, lambda: _refitted(problem, point, effect, step, to_beat, known)
            )

        for effect, trial in zip(group, on_all_cores(refit, group), strict=True):
            trials.append(trial)
            share = (len(trials) - begun) / len(leading)
            progress(f"tried {effect.name}", 0.5 + 0.5 * share)
    return trials


def _guarded(effect: Effect, step: int, work: Callable[[], Found]) -> Found | NotFitted:
    """What some work on an effect gives; an effect that fails does not take the others with it."""
    try:
        return work()
    except (FloatingPointError, np.linalg.LinAlgError) as error:
        return NotFitted(effect, step, f"could not be fitted: {error}")
    except Exception as error:
        if type(effect).__module__.startswith("preisach_jax."):
            raise
        # A user's own effect must not take the diagnosis of the others with it.
        reason = f"failed: {type(error).__name__}: {error}"
        return NotFitted(effect, step, reason, failed=True)


def _promise(
    problem: Problem, point: Point, effect: Effect, step: int, projection: Projection
) -> list[Prospect] | NotFitted:
    """What all forms and starts of an effect promise, or why it is left."""
    if isinstance(effect, Auxiliary) and np.ptp(problem.record.aux[effect.column]) == 0:
        value = problem.record.aux[effect.column][0]
        return NotFitted(effect, step, f"the column is constant ({value:g}): nothing can be seen")
    found = prospects(problem, point, projection, problem.forms_of(effect, point))
    explained = max(prospect.explained for prospect in found)
    if explained < LEAST_PROMISE:
        return NotFitted.screened(effect, step, explained)
    return found


def _best(found: Sequence[Prospect]) -> Prospect:
    return max(found, key=lambda prospect: prospect.held_out)


def _leading(promised: dict[Effect, list[Prospect]]) -> list[Effect]:
    """The effects to refit: those that promise most on the rows held out."""
    held_out = {effect: _best(found).held_out for effect, found in promised.items()}
    ranked = sorted(promised, key=lambda effect: -held_out[effect])
    return [
        effect
        for position, effect in enumerate(ranked)
        if position < LEADERS or held_out[effect] > LEADS * held_out[ranked[0]]
    ]


def _refitted(
    problem: Problem,
    point: Point,
    effect: Effect,
    step: int,
    to_beat: float,
    known: Sequence[Prospect],
) -> Trial:
    """An effect refitted jointly with the rest of the model, and what speaks for it."""
    rich = with_effect(problem, point, effect, to_beat=to_beat, known=known)
    evidence = compare(problem, point, rich)
    # What the locks refuse need not be asked how sure it is.
    certain = (
        Certainty(alone=True, together=True)
        if evidence.against
        else differs_from_nothing(problem, rich, effect.name)
    )
    return Trial(effect, step, rich, evidence, certain)

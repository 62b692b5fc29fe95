"""Every effect tried beside a model: screened to first order, and the leading ones refitted."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np

from preisach_jax.confidence import Certainty, differs_from_nothing
from preisach_jax.cores import on_all_cores
from preisach_jax.diagnosis.evidence import LEAST_GAIN, compare, promised_evidence
from preisach_jax.diagnosis.tellable import untellable
from preisach_jax.diagnosis.trial import NotFitted, Trial
from preisach_jax.effects.base import Effect
from preisach_jax.effects.of_column import OfColumn
from preisach_jax.fit import LEAST_PROMISE, Progress, feeds_back, with_effect
from preisach_jax.identify import Point, Problem
from preisach_jax.signature import Projection, Prospect, prospects

Found = TypeVar("Found")

NO_UNIQUE_OUTPUT = "not tried: beside weights of both signs its output is not unique"

LEADERS = 3
"""Effects that are refitted jointly in any case, those that promise most."""

MOST_LEADERS = 5
"""Effects that are refitted jointly at most."""

LEADS = 3.0
"""Times the held-out mean square that the best promise leaves which another may leave to be
refitted as well: joint refits seldom change more."""


def try_beside(
    problem: Problem, point: Point, effects: Sequence[Effect], step: int, progress: Progress
) -> list[Trial | NotFitted]:
    """Try each of some effects beside a model: screened, and refitted jointly if it leads.

    What an effect promises to first order costs a thousandth of a joint refit.  Those that promise
    most are refitted and judged.

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
    leading = _leading(problem, point, promised)
    for effect, found in promised.items():
        if effect not in leading:
            promise_held_out = _best(found).held_out
            trials.append(NotFitted.passed_over(effect, step, promise_held_out, LEAST_HOPE))

    def refit(effect: Effect) -> Trial | NotFitted:
        known = promised[effect]
        return _guarded(effect, step, lambda: _refitted(problem, point, effect, step, known))

    for done, (effect, trial) in enumerate(
        zip(leading, on_all_cores(refit, leading), strict=True), start=1
    ):
        trials.append(trial)
        progress(f"tried {effect.name}", 0.5 + 0.5 * done / len(leading))
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
    if reason := untellable(problem, effect):
        return NotFitted(effect, step, reason)
    if point.chain.signed and feeds_back(effect):
        return NotFitted(effect, step, NO_UNIQUE_OUTPUT)
    if isinstance(effect, OfColumn) and np.ptp(problem.record.aux[effect.column]) == 0:
        value = problem.record.aux[effect.column][0]
        return NotFitted(effect, step, f"the column is constant ({value:g}): nothing can be seen")
    found = prospects(problem, point, projection, problem.forms_of(effect, point))
    explained = max(prospect.explained for prospect in found)
    if explained < LEAST_PROMISE:
        return NotFitted.screened(effect, step, explained)
    return found


LEAST_HOPE = 0.5 * LEAST_GAIN
"""Relative fall of the held-out mean square that an effect must promise to be refitted at all."""

LEAST_HOPEFUL_Z = 1.0
"""Standardised mean gain over the held-out blocks that it must promise."""

GREAT_PROMISE = 0.2
"""Relative fall of the held-out mean square from which on an effect is refitted whatever its
whitened residual says at the start."""

MOST_OTHERS = 2
"""Such effects at most."""

FARTHEST_START = 2.0
"""Times the residual's power that its best start may add: from farther away, its size lies beyond
the bounds of its parameters."""


def _best(found: Sequence[Prospect]) -> Prospect:
    return max(found, key=lambda prospect: prospect.held_out)


def _leading(
    problem: Problem, point: Point, promised: dict[Effect, list[Prospect]]
) -> list[Effect]:
    """The effects to refit: those that promise most on the rows held out, and may keep it.

    Beside a model that misses much, the whitened residual of an effect at a rough start says little
    of what it comes to when refitted: those that promise much are refitted whatever it says.
    """
    held_out = {effect: _best(found).held_out for effect, found in promised.items()}
    ranked = sorted(promised, key=lambda effect: -held_out[effect])
    leading: list[Effect] = []
    for effect in ranked:
        if len(leading) >= MOST_LEADERS or held_out[effect] < LEAST_HOPE:
            break
        if len(leading) >= LEADERS and not (
            1 - held_out[effect] < LEADS * (1 - held_out[leading[0]])
        ):
            break
        if _is_hopeful(problem, point, promised[effect]):
            leading.append(effect)
    others = (effect for effect in ranked if effect not in leading)
    great = (
        effect
        for effect in itertools.takewhile(lambda each: held_out[each] >= GREAT_PROMISE, others)
        if _is_hopeful(problem, point, promised[effect], least_delta_bic=-np.inf)
    )
    return leading + list(itertools.islice(great, MOST_OTHERS))


def _is_hopeful(
    problem: Problem, point: Point, found: Sequence[Prospect], least_delta_bic: float = 0.0
) -> bool:
    """Whether what an effect promises to first order could pass both tests."""
    if max(prospect.reached for prospect in found) < -FARTHEST_START:
        return False
    evidence = promised_evidence(problem, point, _best(found))
    return evidence.z >= LEAST_HOPEFUL_Z and evidence.delta_bic > least_delta_bic


def _refitted(
    problem: Problem,
    point: Point,
    effect: Effect,
    step: int,
    known: Sequence[Prospect],
) -> Trial:
    """An effect refitted jointly with the rest of the model, and what speaks for it."""
    rich = with_effect(problem, point, effect, known=known)
    evidence = compare(problem, point, rich)
    # What the locks refuse need not be asked how sure it is.
    certain = (
        Certainty(alone=True, together=True)
        if evidence.against
        else differs_from_nothing(problem, rich, effect.name)
    )
    return Trial(effect, step, rich, evidence, certain)

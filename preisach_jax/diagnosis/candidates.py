"""Every effect tried beside a model: screened to first order, and the leading ones refitted."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from preisach_jax.cores import on_all_cores
from preisach_jax.diagnosis.evidence import LEAST_GAIN, compare, promised_evidence
from preisach_jax.diagnosis.tellable import surveyed, untellable
from preisach_jax.diagnosis.trial import NotFitted, Trial
from preisach_jax.effects.base import Effect
from preisach_jax.effects.of_column import OfColumn
from preisach_jax.fit import Progress, feeds_back, with_effect
from preisach_jax.identify import Point, Problem
from preisach_jax.identify.confidence import Certainty, differs_from_nothing
from preisach_jax.identify.signature import Projection, Prospect, prospects

Found = TypeVar("Found")

NO_UNIQUE_OUTPUT = "not tried: beside weights of both signs its output is not unique"

LEADERS = 3
"""Effects that promise most, which are refitted jointly where none that leads passes."""

MOST_LEADERS = 5
"""Effects that are refitted jointly at most."""

LEADS = 3.0
"""Times the held-out mean square that the best promise leaves which another may leave to be
refitted with it: joint refits seldom change more."""

FAR = 10.0
"""The same for the `LEADERS`: of an effect that feeds back, the first order says little."""


@dataclass(frozen=True, eq=False)
class Screening:
    """What effects promise beside a model to first order, and which of them to refit.

    Attributes:
        problem, point: the record and the model.
        step: how many effects the model has.
        promised: the prospects of each effect that promises anything.
        groups: the effects to refit: those that lead, and those to turn to if none of them passes.
        rest: the others, by what they promise.
        left: why each of those that cannot be tried is left.
        least_hope: fall of the held-out mean square that an effect had to promise.
    """

    problem: Problem
    point: Point
    step: int
    promised: Mapping[Effect, list[Prospect]]
    groups: tuple[tuple[Effect, ...], ...]
    rest: tuple[Effect, ...]
    left: tuple[NotFitted, ...]
    least_hope: float

    def passed_over(self, groups: Sequence[Sequence[Effect]]) -> list[Trial | NotFitted]:
        """The rows of effects that were not refitted."""
        return [
            NotFitted.passed_over(
                effect, self.step, _best(self.promised[effect]).held_out, self.least_hope
            )
            for group in groups
            for effect in group
        ]


def promises(
    problem: Problem, point: Point, effects: Sequence[Effect], step: int, progress: Progress
) -> tuple[dict[Effect, list[Prospect]], list[NotFitted]]:
    """The prospects of each of some effects that promises anything, and why others are left."""
    projection = Projection(problem, point)
    surveyed(problem)  # before the workers ask: they share the problem, and only read it
    left: list[NotFitted] = []
    promised: dict[Effect, list[Prospect]] = {}

    def promise(effect: Effect) -> list[Prospect] | NotFitted:
        return _guarded(effect, step, lambda: _promise(problem, point, effect, step, projection))

    for effect, found in zip(effects, on_all_cores(promise, effects), strict=True):
        progress(f"looking for {effect.name}", (len(left) + len(promised)) / len(effects))
        if isinstance(found, NotFitted):
            left.append(found)
        else:
            promised[effect] = found
    return promised, left


def screened(
    problem: Problem,
    point: Point,
    effects: Sequence[Effect],
    step: int,
    progress: Progress,
    least_gain: float = LEAST_GAIN,
) -> Screening:
    """Ask what each of some effects promises beside a model.

    What an effect promises to first order costs a hundredth of a joint refit.
    """
    promised, left = promises(problem, point, effects, step, progress)
    groups = _leading(problem, point, promised, HOPE * least_gain)
    chosen = [effect for group in groups for effect in group]
    rest = [effect for effect in promised if effect not in chosen]
    rest.sort(key=lambda effect: -_best(promised[effect]).held_out)
    least_hope = HOPE * least_gain
    return Screening(problem, point, step, promised, groups, tuple(rest), tuple(left), least_hope)


def refitted(
    screening: Screening, effects: Sequence[Effect], progress: Progress, in_full: bool = False
) -> list[Trial | NotFitted]:
    """Refit some of the effects that were screened jointly with the rest of the model.

    Arguments:
        in_full: whether each effect is refined to its end, whatever it promises.
    """
    trials: list[Trial | NotFitted] = []
    problem, point, step = screening.problem, screening.point, screening.step

    def refit(effect: Effect, best: float) -> Trial | NotFitted:
        known = screening.promised[effect]
        return _guarded(
            effect, step, lambda: _refitted(problem, point, effect, step, known, best, in_full)
        )

    def add(effect: Effect, trial: Trial | NotFitted) -> None:
        trials.append(trial)
        progress(f"tried {effect.name}", len(trials) / len(effects))

    # What the first one reaches says which of the others need not be refined to their end.
    add(effects[0], refit(effects[0], np.inf))
    reached = [t.point.validation_mean_square for t in trials if isinstance(t, Trial) and t.passes]
    best = min(reached, default=np.inf)
    others = effects[1:]
    for effect, trial in zip(
        others, on_all_cores(lambda effect: refit(effect, best), others), strict=True
    ):
        add(effect, trial)
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
    return prospects(problem, point, projection, problem.forms_of(effect, point))


HOPE = 0.5
"""Share of the least gain for a name that an effect must promise to be refitted at all."""

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
    problem: Problem, point: Point, promised: dict[Effect, list[Prospect]], least_hope: float
) -> tuple[tuple[Effect, ...], ...]:
    """The effects to refit: those that promise most on the rows held out, and may keep it.

    Beside a model that misses much, the whitened residual of an effect at a rough start says little
    of what it comes to when refitted: those that promise much are refitted whatever it says.

    Returns:
        Groups of them; a later one is for where none of those before it passes.
    """
    held_out = {effect: _best(found).held_out for effect, found in promised.items()}
    ranked = [e for e in sorted(promised, key=lambda e: -held_out[e]) if held_out[e] >= least_hope]
    hopeful = [e for e in ranked if _is_hopeful(problem, point, promised[e])]
    near = [e for e in hopeful if 1 - held_out[e] < LEADS * (1 - held_out[hopeful[0]])]
    first = near[:MOST_LEADERS]
    others = [e for e in hopeful[:LEADERS] if e not in first]
    best = held_out[first[0]] if first else 0.0
    first += [e for e in others if 1 - held_out[e] < FAR * (1 - best)]
    second = [e for e in others if e not in first]
    great = [
        effect
        for effect in ranked
        if held_out[effect] >= GREAT_PROMISE
        and effect not in (*first, *second)
        and _is_hopeful(problem, point, promised[effect], least_delta_bic=-np.inf)
    ][:MOST_OTHERS]
    for effect in great:
        (first if 1 - held_out[effect] < LEADS * (1 - best) else second).append(effect)
    return tuple(tuple(group) for group in (first, second) if group)


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
    best: float,
    in_full: bool,
) -> Trial:
    """An effect refitted jointly with the rest of the model, and what speaks for it."""
    rich = with_effect(problem, point, effect, in_full, known, best)
    evidence = compare(problem, point, rich)
    # What the tests refuse need not be asked how sure it is.
    certain = (
        Certainty(alone=True, together=True)
        if evidence.against
        else differs_from_nothing(problem, rich, effect.name)
    )
    return Trial(effect, step, rich, evidence, certain)

"""Two effects at once: where neither passes alone, and where a third one made up for both.

A resonance beside a lag is found with the damping of neither, and a delay alone may do better than
either.  From there no refinement leads to what both are beside each other, and the gain of the one
that is missing seems small.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from preisach_jax.diagnosis.candidates import promises
from preisach_jax.diagnosis.evidence import LEAST_GAIN
from preisach_jax.diagnosis.judgement import LEAST_GAIN_BESIDE, alike, judged_beside
from preisach_jax.diagnosis.step import Named, Step
from preisach_jax.diagnosis.trial import Row, Trial, accepted_rows, with_rival
from preisach_jax.diagnosis.walk import MOST_EFFECTS, tried_beside
from preisach_jax.effects.base import Effect
from preisach_jax.fit import at_levels, feeds_back, in_silence, with_effect, without_effect
from preisach_jax.identify import Point
from preisach_jax.identify.signature import Prospect

GAIN_TO_LOOK_AHEAD = 0.2
"""Relative fall of the held-out mean square from which on an effect that does not pass alone is
tried beside a second one."""

MOST_LOOKED_BEHIND = 2
"""Such effects at most."""

MOST_RUNNERS_UP = 4
"""Effects that are put in the place of the last one, to look for a second one beside them."""

PAYS = 0.5
"""Held-out mean square that a pair must not leave, over that of the model as it is, if it has not
the last effect of that, and over that with the best effect added to it."""

GAIN_OF_A_RUNNER_UP = 0.2
"""Relative fall of the held-out mean square that one must have brought by itself."""

MOST_OF_OTHERS = 3
"""Pairs without the last effect that are fitted."""


@dataclass(frozen=True, eq=False)
class Promised:
    """A second effect beside a runner-up, as it is promised to first order.

    Attributes:
        runner_up, alone: the runner-up, and the model with it alone.
        second, has_last: the second effect, and whether it is the last one of the model.
        prospects: what it promises from all its starts.
        left: held-out mean square that it promises to leave, in squared output ranges.
    """

    runner_up: Trial
    alone: Point
    second: Effect
    has_last: bool
    prospects: Sequence[Prospect]
    left: float


@dataclass(frozen=True, eq=False)
class Pair:
    """What was promised, and the model with both effects."""

    promised: Promised
    both: Point

    @property
    def left(self) -> float:
        """Held-out mean square, in squared output ranges."""
        return self.both.validation_mean_square


def with_pair(step: Step, tolerance: float) -> tuple[Step, bool]:
    """The step with two effects of which none passes alone, and whether there are any.

    Of two effects of like size each leaves what the other does, so that neither gain is alike
    over the blocks.  Where one promises much, the others are tried beside it; both are added if
    each passes beside the other.

    Arguments:
        tolerance: RMS error, in output units, that does not matter.
    """
    count, problem = step.position, step.problem
    if count + 2 > MOST_EFFECTS:
        return step, False
    for first in step.fitted(count, GAIN_TO_LOOK_AHEAD)[:MOST_LOOKED_BEHIND]:
        _, second, _ = tried_beside(step.with_named(first), tolerance)
        # Forms without a law take up a part of whatever another one leaves.
        if second is None or any(effect.lawless for effect in second.point.chain.effects):
            continue
        without = without_effect(problem, second.point, first.effect.name)
        beside = judged_beside(problem, without, first.effect, count, second.point, tolerance)
        if beside is None:
            continue
        rows = accepted_rows(list(step.trials), [first.effect.name], count)
        found = replace(step, trials=(*rows, (second, True, second.effect.name)))
        return found.with_named(replace(beside, point=first.point)).with_named(second), True
    return step, False


def with_better_pair(step: Step, tried: Step, tolerance: float) -> Step | None:
    """The step with two effects in the place of its last one; None if that does not pay.

    The first is one that did nearly as well as the last effect before it; the second is either the
    last effect, searched for anew beside it, or any other.

    Arguments:
        tolerance: RMS error, in output units, that does not matter.
    """
    if not step.named or step.is_within_budget:
        return None
    added = len(tried.named) > len(step.named)
    if added and tried.is_within_budget:
        return None
    best = tried if added else step
    most = PAYS * tried.now.validation_mean_square if added else np.inf
    promising = _promising(step, best.now.validation_mean_square)
    pairs = [pair for each in promising if (pair := _fitted(step, each, most))]
    pairs.sort(key=lambda pair: pair.left)
    for pair in pairs:
        if found := _passing(step, pair, tolerance):
            return _exchanged(step, tried, pair, found, pairs)
    return None


def _runners_up(step: Step) -> list[Trial]:
    """The effects that did best where the last one was named, but for that one."""
    present = {effect.name for effect in step.now.chain.effects}
    before = step.fitted(step.named[-1].trial.step, GAIN_OF_A_RUNNER_UP)
    others = [trial for trial in before if trial.effect.name not in present]
    if step.now.chain.signed:
        others = [trial for trial in others if not feeds_back(trial.effect)]
    return others[:MOST_RUNNERS_UP]


def _promising(step: Step, most: float) -> list[Promised]:
    """The pairs that promise to leave less: those with the last effect, and the best of the others.

    What a pair comes to when both are fitted together is often half of what it promises.
    """
    last, found = step.named[-1].name, list[Promised]()
    for runner_up in _runners_up(step):
        if any(effect.lawless for effect in runner_up.point.chain.effects):
            continue
        alone = at_levels(step.problem, runner_up.point, step.now.chain.plane.levels)
        present = {effect.name for effect in alone.chain.effects}
        seconds = [effect for effect in step.tried if effect.name not in present]
        promised, _ = promises(step.problem, alone, seconds, step.position, in_silence)
        for second, prospects in promised.items():
            promise = max(prospect.held_out for prospect in prospects)
            left = (1 - promise) * alone.validation_mean_square
            if left < most:
                has_last = second.name == last
                found.append(Promised(runner_up, alone, second, has_last, prospects, left))
    found.sort(key=lambda each: each.left)
    others = [each for each in found if not each.has_last]
    return [each for each in found if each.has_last] + others[:MOST_OF_OTHERS]


def _fitted(step: Step, promised: Promised, most: float) -> Pair | None:
    """A pair fitted together, if it leaves less than that, and than it must to be worth having."""
    share = 1 - LEAST_GAIN if promised.has_last else PAYS
    worth = min(share * step.now.validation_mean_square, most)
    both = with_effect(step.problem, promised.alone, promised.second, known=promised.prospects)
    # Forms without a law take up a part of whatever another one leaves.
    if any(each.lawless for each in both.chain.effects):
        return None
    pair = Pair(promised, both)
    return pair if pair.left < worth else None


def _passing(step: Step, pair: Pair, tolerance: float) -> tuple[Trial, Trial] | None:
    """Both effects of a pair as they are tried beside each other, if each of them passes so."""
    problem, promised = step.problem, pair.promised
    first, second = promised.runner_up, promised.second
    without_first = step.now
    if not promised.has_last:
        without_first = with_effect(problem, step.path[-2], second)
    beside: list[Trial] = []
    for effect, position, without in (
        (first.effect, first.step, without_first),
        (second, first.step + 1, promised.alone),
    ):
        passed = judged_beside(
            problem, without, effect, position, pair.both, tolerance, LEAST_GAIN_BESIDE
        )
        if passed is None:
            return None
        beside.append(passed)
    return beside[0], beside[1]


def _rivals(
    step: Step, tried: Step, pair: Pair, pairs: list[Pair]
) -> tuple[dict[str, Point], dict[str, Point]]:
    """Models with another effect in the place of the first of a pair, and of the second."""
    last, own = step.named[-1], pair.promised
    names = {own.runner_up.effect.name, own.second.name}
    first: dict[str, Point] = {}
    second: dict[str, Point] = {}
    if own.has_last:
        beside = tried.fitted(step.position, -np.inf)
        first |= {t.effect.name: t.point for t in beside if t.passes_both_tests}
        second |= last.rivals
    else:
        # What made up for both may stand for one of them.
        first |= last.rivals | {last.name: step.now}
    for other in pairs:
        if other is not pair and alike(step.problem, pair.both, other.both):
            runner_up = other.promised.runner_up
            if other.promised.second is own.second:
                first[runner_up.effect.name] = other.both
            elif runner_up is own.runner_up:
                second[other.promised.second.name] = other.both
    without = [{n: p for n, p in each.items() if n not in names} for each in (first, second)]
    return without[0], without[1]


def _exchanged(
    step: Step, tried: Step, pair: Pair, found: tuple[Trial, Trial], pairs: list[Pair]
) -> Step:
    """The step with a pair in the place of its last effect."""
    last = step.named[-1]
    first, second = replace(found[0], point=pair.promised.alone), found[1]
    of_first, of_second = _rivals(step, tried, pair, pairs)
    rows: list[Row] = with_rival(list(tried.trials), last.trial, first)
    here = (second.effect.name, second.step)
    rows = [row for row in rows if (row[0].effect.name, row[0].step) != here]
    return replace(
        step,
        trials=(*rows, (second, True, second.effect.name)),
        named=(*step.named[:-1], Named(first, of_first), Named(second, of_second)),
        path=(*step.path[:-1], first.point, pair.both),
        other=None,
    )

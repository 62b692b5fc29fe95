"""The last effect of a model searched for anew, beside one that did nearly as well before it.

Where two effects act, the first one that is named alone makes up for both: a resonance beside a lag
is found with the damping of neither.  From there no refinement leads to what it is beside the
other, whose own gain then seems small.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from preisach_jax.diagnosis.evidence import LEAST_GAIN
from preisach_jax.diagnosis.judgement import LEAST_GAIN_BESIDE, alike, judged_beside
from preisach_jax.diagnosis.step import Named, Step
from preisach_jax.diagnosis.trial import Row, Trial, with_rival
from preisach_jax.fit import at_levels, feeds_back, with_effect
from preisach_jax.identify import Point
from preisach_jax.identify.signature import Projection, prospects

MOST_RUNNERS_UP = 4
"""Effects beside which the last one is searched for anew."""

PAYS = 0.5
"""Held-out mean square that the pair must not leave, over that with the best effect added beside
the model as it is."""

GAIN_OF_A_RUNNER_UP = 0.2
"""Relative fall of the held-out mean square that one must have brought by itself."""


@dataclass(frozen=True, eq=False)
class Pair:
    """A runner-up, the model with it alone, and that with the last effect beside it."""

    runner_up: Trial
    alone: Point
    both: Point


def with_last_anew(step: Step, tried: Step, tolerance: float) -> Step | None:
    """The step with a runner-up of its last effect, and that effect anew; None if it does not pay.

    Arguments:
        step: the step.
        tried: the same after all effects were tried beside its model, and the best one was added
            if any passed.
        tolerance: RMS error, in output units, that does not matter.
    """
    if not step.named or step.is_within_budget:
        return None
    added = len(tried.named) > len(step.named)
    if added and tried.is_within_budget:
        return None
    most = PAYS * tried.now.validation_mean_square if added else np.inf
    pairs = [pair for trial in _runners_up(step) if (pair := _beside(step, trial, most))]
    pairs.sort(key=lambda pair: pair.both.validation_mean_square)
    for pair in pairs:
        if found := _passing(step, pair, tolerance):
            rivals = _rivals(step, tried, pair, pairs)
            return _exchanged(replace(step, trials=tried.trials), pair, found, rivals)
    return None


def _rivals(step: Step, tried: Step, pair: Pair, pairs: list[Pair]) -> dict[str, Point]:
    """Models with another effect in the place of the runner-up of a pair, by its name."""
    beside = tried.fitted(step.position, -np.inf)
    rivals = {t.effect.name: t.point for t in beside if t.passes_both_tests}
    rivals |= {
        other.runner_up.effect.name: other.both
        for other in pairs
        if other is not pair and alike(step.problem, pair.both, other.both)
    }
    rivals.pop(pair.runner_up.effect.name, None)
    return rivals


def _runners_up(step: Step) -> list[Trial]:
    """The effects that did best where the last one was named, but for that one."""
    present = {effect.name for effect in step.now.chain.effects}
    before = step.fitted(step.named[-1].trial.step, GAIN_OF_A_RUNNER_UP)
    others = [trial for trial in before if trial.effect.name not in present]
    if step.now.chain.signed:
        others = [trial for trial in others if not feeds_back(trial.effect)]
    return others[:MOST_RUNNERS_UP]


def _beside(step: Step, runner_up: Trial, most: float) -> Pair | None:
    """The last effect beside a runner-up, if that leaves less than it does now, and than `most`."""
    problem, now = step.problem, step.now
    if any(effect.lawless for effect in runner_up.point.chain.effects):
        return None
    alone = at_levels(problem, runner_up.point, now.chain.plane.levels)
    effect = step.effect(step.named[-1].name)
    found = prospects(problem, alone, Projection(problem, alone), problem.forms_of(effect, alone))
    promised = max(prospect.held_out for prospect in found)
    worth = min((1 - LEAST_GAIN) * now.validation_mean_square, most)
    if (1 - promised) * alone.validation_mean_square > worth:
        return None
    both = with_effect(problem, alone, effect, known=found)
    # Forms without a law take up a part of whatever another one leaves.
    if any(each.lawless for each in both.chain.effects):
        return None
    return Pair(runner_up, alone, both) if both.validation_mean_square < worth else None


def _passing(step: Step, pair: Pair, tolerance: float) -> tuple[Trial, Trial] | None:
    """Both effects of a pair as they are tried beside each other, if each of them passes so."""
    problem, last = step.problem, step.named[-1].trial
    beside: list[Trial] = []
    for trial, without in ((pair.runner_up, step.now), (last, pair.alone)):
        asked = replace(trial, objection="")
        passed = judged_beside(problem, without, asked, pair.both, tolerance, LEAST_GAIN_BESIDE)
        if passed is None:
            return None
        beside.append(passed)
    return beside[0], beside[1]


def _exchanged(
    step: Step, pair: Pair, found: tuple[Trial, Trial], rivals: dict[str, Point]
) -> Step:
    """The step with the pair in the place of its last effect."""
    named = step.named[-1]
    first = replace(found[0], point=pair.alone)
    second = replace(found[1], step=named.trial.step + 1)
    rows: list[Row] = with_rival(list(step.trials), named.trial, first)
    rows = [row for row in rows if (row[0].effect.name, row[0].step) != (named.name, second.step)]
    kept = {name: point for name, point in named.rivals.items() if name != first.effect.name}
    return replace(
        step,
        trials=(*rows, (second, True, second.effect.name)),
        named=(*step.named[:-1], Named(first, rivals), Named(second, kept)),
        path=(*step.path[:-1], pair.alone, pair.both),
        other=None,
    )

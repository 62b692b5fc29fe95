"""From one step of a diagnosis to the next: effects added, taken out, and exchanged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from preisach_jax.diagnosis.candidates import refitted, screened
from preisach_jax.diagnosis.evidence import LEAST_GAIN, compare, free_parameters
from preisach_jax.diagnosis.judgement import (
    LEAST_GAIN_BESIDE,
    LEAST_GAIN_WITHIN_BUDGET,
    alike,
    judged,
)
from preisach_jax.diagnosis.step import Named, Step
from preisach_jax.diagnosis.trial import NotFitted, Row, Trial, with_rival
from preisach_jax.effects.gain import Gain
from preisach_jax.fit import Progress, in_silence, settled, with_effect, without_effect
from preisach_jax.identify import Point, evaluate
from preisach_jax.identify.confidence import differs_from_nothing

MOST_EFFECTS = 4

MUCH_LEFT = 4.0
"""Times the budget's mean square from which on each effect is fitted in full beside others."""

SCREENING = 0.4
"""Share of a round that goes by until all effects are screened."""


def tried_beside(
    step: Step, tolerance: float, progress: Progress = in_silence, each_in_full: bool = False
) -> tuple[list[Trial | NotFitted], Trial | None, Point]:
    """Try all effects beside the model of a step: screened, refitted if they lead, and judged.

    Arguments:
        tolerance: RMS error, in output units, that does not matter.
        each_in_full: whether, where none of those that lead passes and the error is above the
            budget, each of the others is fitted in full: a promise to first order says little of
            an effect that is far from none.

    Returns:
        What came of each, the best one that passes, and the model to go on from (see `judged`).
    """
    problem, now = step.problem, step.now
    # The law of an effect is never quite that of the machine, and a second one makes up for it.
    least = LEAST_GAIN
    if step.position:
        least = LEAST_GAIN_WITHIN_BUDGET if step.is_within_budget else LEAST_GAIN_BESIDE
    screening = screened(
        problem,
        now,
        step.left,
        step.position,
        lambda text, done: progress(text, SCREENING * done),
        least,
    )
    rows: list[Trial | NotFitted] = list(screening.left)
    best: Trial | None = None
    groups = [*screening.groups, screening.rest]
    while groups and best is None:
        in_full = len(groups) == 1
        if not groups[0] or (in_full and not (each_in_full and _leaves_much(step))):
            break
        rows += refitted(
            screening,
            groups.pop(0),
            lambda text, done: progress(text, SCREENING + (1 - SCREENING) * done),
            in_full,
        )
        rows, best, now = judged(
            problem, now, rows, lambda text: progress(text, 1.0), tolerance, least
        )
    return rows + screening.passed_over(groups), best, now


def _leaves_much(step: Step) -> bool:
    """Whether the error is so far above the budget that an effect not promised may be missing."""
    return step.above_budget > (MUCH_LEFT if step.position else 2)


def with_best(step: Step, tolerance: float, progress: Progress = in_silence) -> tuple[Step, bool]:
    """The step with the best effect that passes, and whether there is one.

    Arguments:
        tolerance: RMS error, in output units, that does not matter.
    """
    trials, best, now = tried_beside(step, tolerance, progress, each_in_full=True)
    name = best.effect.name if best is not None else ""
    # Of an effect that is tried again on a finer plane, the last trial counts.
    again = {(trial.effect.name, trial.step) for trial in trials}
    rows: list[Row] = [r for r in step.trials if (r[0].effect.name, r[0].step) not in again]
    rows += [(trial, trial is best, name) for trial in trials]
    step = replace(step, path=(*step.path[:-1], now), trials=tuple(rows))
    if best is None:
        return step, False
    filed = tuple((t if t is best else _filed(t), added, other) for t, added, other in step.trials)
    step = replace(step, trials=filed)
    # What passes both tests may stand in the family, even if its amounts alone are uncertain.
    others = [
        trial
        for trial in trials
        if isinstance(trial, Trial) and trial.passes_both_tests and trial is not best
    ]
    # What scales the loop moves it as well: that alone does not make it a rival.
    others = [t for t in others if any(t.certain) or not isinstance(t.effect, Gain)]
    like_the_best = [o for o in others if alike(step.problem, best.point, o.point)]
    rivals = {o.effect.name: o.point for o in like_the_best}
    return step.with_named(best, rivals), True


def _filed(trial: Trial | NotFitted) -> Trial | NotFitted:
    """A trial that nothing goes on from, without its regressors."""
    return replace(trial, point=trial.point.slim) if isinstance(trial, Trial) else trial


def without_superfluous(step: Step) -> Step:
    """The step without an effect that those added after it have made superfluous."""
    for named in step.named[:-1]:
        without = without_effect(step.problem, step.now, named.name)
        if compare(step.problem, without, step.now).against:
            kept = tuple(each for each in step.named if each is not named)
            path = (*step.ladder([each.name for each in kept[:-1]]), without)
            return replace(step, named=kept, path=path, other=None)
    return step


def with_better_rivals(step: Step, positions: Sequence[int]) -> Step:
    """The step with rivals of some of its effects in their places, where they do better by now."""
    for position in positions:
        step = _with_best_rival(step, position)
    return step


def with_families(step: Step, positions: Sequence[int]) -> Step:
    """Ask of rivals again whether they could stand in the final model, all refitted.

    What one effect alone could not tell may show beside the others.  A rival that does better
    now takes the place.
    """
    for position in positions:
        step = _with_best_rival(step, position)
        named = step.named[position]
        kept = {name: p for name, p in named.rivals.items() if alike(step.problem, step.now, p)}
        step = _with_named(step, position, replace(named, rivals=kept))
    return step


def _with_best_rival(step: Step, position: int) -> Step:
    """The step with the rivals of an effect as they do now; one that does better in its place."""
    named = step.named[position]
    present = {effect.name for effect in step.now.chain.effects}
    rivals = {
        name: _in_place_of(step, named.name, name, point)
        for name, point in named.rivals.items()
        if name not in present
    }
    better = [
        _tried_again(step, named, name, point)
        for name, point in rivals.items()
        if not compare(step.problem, step.now, point).against or _dominates(point, step.now)
    ]
    certain = [trial for trial in better if any(trial.certain)]
    step = _with_named(step, position, replace(named, rivals=rivals))
    if not certain:
        return step
    again = min(certain, key=lambda trial: trial.point.validation_mean_square)
    return _exchanged(step, position, again)


def with_rival_leading(step: Step, position: int, rival: str) -> Step:
    """The step with a rival in the place of one of its effects.

    The rivals of the other effects are asked again beside it.
    """
    named = step.named[position]
    step = _exchanged(step, position, _tried_again(step, named, rival, named.rivals[rival]))
    return with_families(step, [k for k in range(len(step.named)) if k != position])


def _exchanged(step: Step, position: int, again: Trial) -> Step:
    """The step with a rival, as it was tried again, in the place of an effect, now its rival."""
    named = step.named[position]
    rivals = {**named.rivals, named.name: step.now}
    del rivals[again.effect.name]
    rows = with_rival(list(step.trials), named.trial, again)
    step = _with_named(step, position, Named(again, rivals))
    path = (*step.ladder([each.name for each in step.named[:-1]]), again.point)
    return replace(step, trials=tuple(rows), path=path, other=None)


def _dominates(point: Point, other: Point) -> bool:
    """Whether a model leaves less than another one, with fewer parameters."""
    less = point.validation_mean_square < other.validation_mean_square
    return less and free_parameters(point) < free_parameters(other)


def _with_named(step: Step, position: int, named: Named) -> Step:
    return replace(step, named=(*step.named[:position], named, *step.named[position + 1 :]))


def _in_place_of(step: Step, name: str, rival: str, point: Point) -> Point:
    """The present model with a rival, as it is at another point, in place of an effect.

    Beside an effect that has been exchanged since, a rival may have taken up what that one lacked:
    it is searched for anew.
    """
    now = step.now
    present = {effect.name for effect in now.chain.effects}
    if {effect.name for effect in point.chain.effects} - {rival} - present:
        without = without_effect(step.problem, now, name)
        return with_effect(step.problem, without, step.effect(rival))
    effect = point.chain.effect(rival)
    effects = tuple(effect if e.name == name else e for e in now.chain.effects)
    values = {**now.values, rival: point.values[rival]}
    del values[name]
    chain = now.chain.with_effects(effects)
    return settled(step.problem, evaluate(step.problem, chain, values, now.strength, now))


def _tried_again(step: Step, named: Named, rival: str, point: Point) -> Trial:
    """A rival as a trial of its own, judged against the model that has neither."""
    without = without_effect(step.problem, step.now, named.name)
    effect = step.effect(rival)
    evidence = compare(step.problem, without, point)
    certain = differs_from_nothing(step.problem, point, rival)
    return Trial(effect, named.trial.step, point, evidence, certain)

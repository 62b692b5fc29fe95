"""Which of the effects that were tried is the best, and what speaks against it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from preisach_jax.diagnosis.budget import by_another_plane
from preisach_jax.diagnosis.chance import by_chance
from preisach_jax.diagnosis.evidence import LEAST_GAIN, compare, free_parameters
from preisach_jax.diagnosis.plausible import implausible
from preisach_jax.diagnosis.trial import BY_THE_GRID, BY_THE_PRIOR, WITHIN_BUDGET, NotFitted, Trial
from preisach_jax.effects.base import Effect, SensorEffect
from preisach_jax.fit import REFINEMENT, at_levels, feeds_back
from preisach_jax.identify import Point, Problem, evaluate, refine
from preisach_jax.identify.confidence import differs_from_nothing
from preisach_jax.quantity import quantity
from preisach_jax.record.jumps import wander_rms

WEAK = 0.9
"""Relative fall of the held-out mean square below which an effect must stand on a finer plane too.
"""

SECOND_OF_A_KIND = 0.5
"""Relative fall of the held-out mean square below which no second effect that goes with the speed
of the input is named."""

LEAST_GAIN_WITHIN_BUDGET = 0.5
"""Relative fall of the held-out mean square below which nothing is named beside other effects that
leave no more than noise and discretisation."""

LEAST_GAIN_BESIDE = 1 / 6
"""The same beside other effects that leave more than that: half of the mean square or more is still
to be explained, and what takes less of it only bends the model towards something else."""

SIMPLER_MAY_LEAVE = 1.5
"""Times the least held-out mean square that an effect of fewer parameters may leave to lead: where
it leaves more, only the whitened residual, in which slow effects hardly count, calls them alike."""

OF_JUMPS = 2.0
"""Times the RMS that the heights of a sensor's jumps leave open that an effect must contribute."""

CONFIRMATION_LEVELS = 50
"""Finest plane on which an effect is confirmed."""


def judged(
    problem: Problem,
    now: Point,
    trials: Sequence[Trial | NotFitted],
    announce: Callable[[str], None],
    tolerance: float = 0.0,
    least_gain: float = LEAST_GAIN,
) -> tuple[list[Trial | NotFitted], Trial | None, Point]:
    """Find the best of the effects that were tried beside a model, asked what speaks against it.

    Arguments:
        tolerance: RMS error, in output units, that does not matter.

    Returns:
        The trials with the objections that were found, the best one that passes, and the model to
        go on from: with the prior of a trial that owed its gain to that alone.
    """
    trials = list(trials)
    passing = _ranked(problem, [t for t in trials if isinstance(t, Trial) and t.passes])
    while passing:
        objection = _too_small(problem, now, passing[0], tolerance)
        if not objection and passing[0].evidence.gain < least_gain:
            objection = WITHIN_BUDGET
        if not objection:
            objection, now = _objection(problem, now, passing[0], announce)
        if not objection:
            return trials, passing[0], now
        refused = passing.pop(0)
        trials[trials.index(refused)] = replace(refused, objection=objection)
    return trials, None, now


def judged_beside(
    problem: Problem,
    without: Point,
    effect: Effect,
    step: int,
    both: Point,
    tolerance: float,
    least_gain: float = LEAST_GAIN,
) -> Trial | None:
    """An effect as it does in a model that has another one too; None if anything speaks against it.

    Arguments:
        tolerance: RMS error, in output units, that does not matter.
    """
    evidence = compare(problem, without, both)
    certain = differs_from_nothing(problem, both, effect.name)
    beside = Trial(effect, step, both, evidence, certain)
    return judged(problem, without, [beside], lambda text: None, tolerance, least_gain)[1]


def alike(problem: Problem, best: Point, other: Point) -> bool:
    """Whether a record cannot tell another model from the best one."""
    return bool(compare(problem, other, best).against)


def _ranked(problem: Problem, passing: list[Trial]) -> list[Trial]:
    """The best first; those that are sure of no single amount must beat the others clearly.

    Of effects that the record cannot tell from the best one and that leave hardly more, the one of
    fewest parameters leads, a common one before a special one.
    """
    by_error = sorted(passing, key=lambda trial: trial.point.validation_mean_square)
    if by_error:
        least = by_error[0]
        spent = {id(t): (free_parameters(t.point), t.effect.special) for t in by_error}
        simpler = [
            trial
            for trial in by_error
            if spent[id(trial)] < spent[id(least)]
            and trial.point.validation_mean_square
            <= SIMPLER_MAY_LEAVE * least.point.validation_mean_square
            and alike(problem, least.point, trial.point)
        ]
        simpler.sort(key=lambda trial: spent[id(trial)])
        by_error = [*simpler[:1], *(trial for trial in by_error if trial not in simpler[:1])]
    sure = [trial for trial in by_error if trial.certain.alone]
    others = [trial for trial in by_error if not trial.certain.alone]
    clear = [t for t in others if not (sure and alike(problem, t.point, sure[0].point))]
    return [*clear, *sure, *(t for t in others if t not in clear)]


def _too_small(problem: Problem, now: Point, trial: Trial, tolerance: float) -> str:
    """What says that an effect does not matter in practice; empty if it does."""
    removed = now.validation_mean_square - trial.point.validation_mean_square
    rms = float(max(removed, 0.0) ** 0.5) * problem.unit
    wander = OF_JUMPS * wander_rms(problem.record)
    if rms < wander:
        made, allowed = (quantity(size, problem.record.output_unit, 3) for size in (rms, wander))
        return f"it contributes {made} RMS; jumps of the sensor leave {allowed} open"
    if rms > tolerance or tolerance == 0:
        return ""
    made, allowed = (quantity(size, problem.record.output_unit, 3) for size in (rms, tolerance))
    return f"it contributes {made} RMS, within the tolerance of {allowed}"


def _objection(
    problem: Problem, now: Point, trial: Trial, announce: Callable[[str], None]
) -> tuple[str, Point]:
    """What speaks against an effect that passes both tests, and the model to go on from.

    If it is the strength of the prior alone that helps, the present model takes it over.
    """
    if contradiction := implausible(problem, trial.point, trial.effect.name):
        return contradiction, now
    if against := _same_kind(now, trial) or by_chance(problem, now, trial.effect, trial.point):
        return against, now
    if trial.evidence.gain >= WEAK:
        return "", now
    plain = _with_the_prior_of(problem, now, trial.point)
    if compare(problem, plain, trial.point).against:
        return BY_THE_PRIOR, plain
    if not _stands_on_a_finer_plane(problem, now, trial, announce):
        return BY_THE_GRID, now
    return "", now


def _same_kind(now: Point, trial: Trial) -> str:
    """The effect of the present model that goes with speed as well, where that says all but little.

    The law of the first one is never quite that of the machine, and a second one makes up for it.
    """
    first = [effect.name for effect in now.chain.effects if effect.goes_with_speed]
    if not (first and trial.effect.goes_with_speed) or trial.evidence.gain >= SECOND_OF_A_KIND:
        return ""
    return (
        f"it depends on the speed, as {first[0]} does, and takes less than "
        f"{100 * SECOND_OF_A_KIND:.0f} % of the mean square away beside it"
    )


def _with_the_prior_of(problem: Problem, now: Point, rich: Point) -> Point:
    """The present model with the strength of the prior that was chosen for a richer one.

    The strength is chosen for each model from few folds, by chance not always well; what
    another one brings is no merit of the effect.
    """
    if rich.strength == now.strength:
        return now
    there = evaluate(problem, now.chain, now.values, rich.strength, now)
    plain = refine(problem, there, iterations=4)
    return plain if plain.validation_mean_square < now.validation_mean_square else now


def _stands_on_a_finer_plane(
    problem: Problem, now: Point, trial: Trial, announce: Callable[[str], None]
) -> bool:
    """Whether a weak effect helps on a finer plane as well.

    What the cells of a plane cannot represent looks like a feedback or a bent sensor, which
    so must remove more error than an infinitely fine grid would.
    """
    levels = now.chain.plane.levels
    finer = min(round(levels * REFINEMENT), CONFIRMATION_LEVELS)
    if finer <= levels:
        return True
    announce(f"trying {trial.effect.name} on a plane of {finer} levels")
    plain = at_levels(problem, now, finer)
    effect = trial.effect
    if feeds_back(effect) or isinstance(effect, SensorEffect):
        # These bend the loop as its cells do: they must do more than all of the grid.
        removed = now.validation_mean_square - trial.point.validation_mean_square
        grid = by_another_plane(problem, now, plain) / problem.unit
        if not removed > grid**2:
            return False
    return not compare(problem, plain, at_levels(problem, trial.point, finer)).against

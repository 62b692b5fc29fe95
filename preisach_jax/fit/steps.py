"""From one model to the next: an effect more or less, another plane, other signs."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from preisach_jax.chain.runs import response
from preisach_jax.cores import on_all_cores
from preisach_jax.effects.base import Effect, HysteresisEffect
from preisach_jax.identify import VALIDATION, Point, Problem, evaluate, refine, with_strength
from preisach_jax.identify.signature import Projection, Prospect, prospects

MOST_STARTS = 2
"""Starts of a form of an effect that are refined."""

STARTS_REACH = 2.0
"""Times what the best start leaves of the residual's power that another one may leave to be refined
as well."""

BEHIND = 2.0
"""Times the held-out mean square of the best model so far at which, after the first steps, another
one is given up: it can be no rival."""

FAR_BEHIND = 6.0
"""The same for an effect inside the hysteresis, whose first steps say less of where it comes to."""

NO_GAIN = 1.1
"""Times the held-out mean square of the model without an effect at which, after the first steps,
the one with it is given up."""

FORMS_HOPE = 0.9
"""Share of the held-out mean square that the most likely form of an effect inside the hysteresis
must not leave for its other forms to be refined: the wrong form of what is there takes much more
away."""

FORMS_BEHIND = 3.0
"""Times the held-out mean square of the best model so far that the most likely form must not leave
for its other forms to be refined."""

FORMS_REACH = 2.0
"""Times what the most likely form promises to leave which another may leave to be refined."""

REFINEMENT = 1.5
"""Ratio of the levels of two planes that are compared."""

FINAL_TOLERANCE = 1e-3
"""Relative fall of the objective below which parameters are not refined further on all rows: one
step without new regressors follows (`finished`)."""

SIGNS_TOLERANCE = 0.03
"""Relative fall of the objective that a step of the parameters must promise for all hysterons with
signs to be followed anew: what is less, one step without new regressors brings (`finished`)."""

LEAST_PROMISE = 0.01
"""Relative fall of the objective that a linearisation must promise for an effect to be refined."""


def feeds_back(effect: Effect) -> bool:
    """Whether an effect makes what drives the hysterons depend on their output."""
    return isinstance(effect, HysteresisEffect) and effect.feeds_back


def held_out_rms(problem: Problem, point: Point) -> float:
    """RMS of what the output of a model misses on the rows held out, in output units.

    What is fed back, and the reading of a sensor, are those of the model, and not of its equations.
    """
    held_out = problem.fold == VALIDATION[0]
    output = response(point.chain, point.values, problem.signals, point.coefficients())
    missed = problem.target - np.asarray(output)[problem.rows]
    return float(np.sqrt(np.mean(missed[held_out] ** 2)))


def settled(problem: Problem, point: Point) -> Point:
    """Refined, with the strength of the prior that the data choose for it."""
    point = refine(problem, point)
    before = point.strength
    point = with_strength(problem, point)
    return point if point.strength == before else refine(problem, point, iterations=4)


def with_effect(
    problem: Problem,
    point: Point,
    effect: Effect,
    always: bool = False,
    known: Sequence[Prospect] = (),
    best: float = np.inf,
) -> Point:
    """The best model that has an effect beside those of a point, all refitted jointly.

    Its forms and starts are compared by what they promise to first order; the best ones are
    refined.

    Arguments:
        always: whether to refine all forms of the effect whatever they promise.
    """
    promised = known
    if not promised:
        forms = problem.forms_of(effect, point)
        promised = prospects(problem, point, Projection(problem, point), forms)
    starts = [list(own) for _, own in itertools.groupby(promised, lambda each: id(each.effect))]
    left = [1 - max(start.held_out for start in own) for own in starts]
    likely = int(np.argmin(left))
    inside = isinstance(effect, HysteresisEffect)
    most = (FAR_BEHIND if inside else BEHIND) * best
    if not always:
        most = min(most, NO_GAIN * point.validation_mean_square)
    tried = {likely: _with_form(problem, point, starts[likely], most)}
    # To first order, waves without a law promise more than a law whose time constant is yet to be
    # found: a form that stays behind says little of the others.
    if inside and tried[likely].validation_mean_square > most:
        return tried[likely]
    # Forms of an effect inside the hysteresis look alike, and each means all states anew.
    picks = inside and not always
    hope = min(FORMS_HOPE * point.validation_mean_square, FORMS_BEHIND * best)
    if picks and tried[likely].validation_mean_square > hope:
        return tried[likely]
    for position, own in enumerate(starts):
        if position != likely and not (picks and left[position] > FORMS_REACH * left[likely]):
            tried[position] = _with_form(problem, point, own, most)
    found, *others = [tried[position] for position in sorted(tried)]
    for trial in others:
        if trial.validation_mean_square < effect.form_pays * found.validation_mean_square:
            found = trial
    return found


def _with_form(problem: Problem, point: Point, starts: Sequence[Prospect], most: float) -> Point:
    """The best model with one form of an effect, from the starts that promise most.

    One whose held-out mean square is above `most` after the first steps is not refined to its end.
    """
    ranked = sorted(starts, key=lambda start: -start.reached)[:MOST_STARTS]
    effect = ranked[0].effect
    chain = point.chain.with_effects((*point.chain.effects, effect))
    near = [
        start for start in ranked if 1 - start.reached <= STARTS_REACH * (1 - ranked[0].reached)
    ]

    def refined(start: Prospect) -> Point:
        values = {**point.values, effect.name: start.values}
        there = evaluate(problem, chain, values, point.strength, point)
        return refine(problem, there, iterations=3)

    trial = min(on_all_cores(refined, near or ranked[:1]), key=lambda trial: trial.objective)
    if trial.validation_mean_square > most:
        return trial
    return settled(problem, trial)


def without_effect(problem: Problem, point: Point, name: str) -> Point:
    """The model that lacks one of a point's effects, the others refitted jointly."""
    effects = tuple(effect for effect in point.chain.effects if effect.name != name)
    values = {key: value for key, value in point.values.items() if key != name}
    chain = point.chain.with_effects(effects)
    return settled(problem, evaluate(problem, chain, values, point.strength, point))


def at_levels(problem: Problem, point: Point, levels: int) -> Point:
    """The same model on a plane of other levels, refitted."""
    chain = replace(point.chain, plane=point.chain.plane.with_levels(levels))
    return settled(problem, evaluate(problem, chain, point.values, point.strength, point))


def on_a_coarser_plane(problem: Problem, point: Point) -> Point:
    """The same model on the next coarser plane, refitted."""
    return at_levels(problem, point, max(2, round(point.chain.plane.levels / REFINEMENT)))


def moved_to(problem: Problem, point: Point) -> Point:
    """The chain of a point, from its values, refitted to a cut of its record."""
    if not point.chain.effects:
        return point
    there = evaluate(problem, point.chain, point.values, point.strength, point)
    moved = refine(problem, with_strength(problem, there), iterations=3, tolerance=FINAL_TOLERANCE)
    thinned = len(point.target) < len(problem.target)
    for effect in point.chain.effects:
        if not (thinned and effect.found_in_residual):
            continue
        # Thinned rows may have led to a wrong line, from which no refinement leads away.
        without = without_effect(problem, moved, effect.name)
        again = with_effect(problem, without, effect, always=True)
        if again.validation_mean_square < (1 - LEAST_PROMISE) * moved.validation_mean_square:
            moved = again
    return moved


def with_signs(problem: Problem, point: Point) -> Point:
    """A point of a reduced basis with all hysterons, whose weights have one sign."""
    if point.columns.vectors is None and len(point.matrix) == len(problem.target):
        return point
    there = evaluate(problem, point.chain, point.values, point.strength, point)
    if point.chain.feeds_back:  # what is fed back now is that of weights of one sign
        there = evaluate(problem, point.chain, point.values, point.strength, there)
    return refine(problem, with_strength(problem, there), 2, SIGNS_TOLERANCE)

"""From one model to the next: an effect more or less, another plane, other signs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from preisach_jax.chain import Chain
from preisach_jax.chain.runs import response
from preisach_jax.effects.base import Effect, HysteresisEffect, InputEffect
from preisach_jax.errors import NotFiniteError
from preisach_jax.identify import (
    VALIDATION,
    Point,
    Problem,
    evaluate,
    refine,
    starts_of,
    with_strength,
)

MOST_STARTS = 2
"""Starts of a form of an effect that are refined."""

FORMS_HOPE = 0.95
"""Held-out mean square, over that of the model without it, that the first form of an effect of the
input or of the hysteresis must not leave for its other forms to be tried: each means all states of
the hysterons anew, and the wrong form of what is there takes much more away."""

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


def with_effect(problem: Problem, point: Point, effect: Effect) -> Point:
    """The best model that has an effect beside those of a point, all refitted jointly."""
    return settled(problem, roughly_with(problem, point, effect))


def roughly_with(problem: Problem, point: Point, effect: Effect) -> Point:
    """The same after the first steps from the best starts of the best form.

    Every start is refitted in full but for the effect's own parameters.
    """
    costly = isinstance(effect, InputEffect | HysteresisEffect)
    found: Point | None = None
    for form in problem.forms_of(effect, point):
        starts = starts_of(form)
        if costly and found is not None:
            if found.validation_mean_square > FORMS_HOPE * point.validation_mean_square:
                break
            known = found.values[effect.name]
            starts = [{p.name: known.get(p.name, p.start[0]) for p in form.parameters()}]
        chain = point.chain.with_effects((*point.chain.effects, form))
        trial = best_start(problem, point, chain, effect.name, starts, 1 if costly else MOST_STARTS)
        pays = 1.0 if found is None else effect.form_pays * found.validation_mean_square
        if found is None or trial.validation_mean_square < pays:
            found = trial
    assert found is not None  # each effect has a form
    return found


def best_start(
    problem: Problem,
    point: Point,
    chain: Chain,
    effect: str,
    starts: Sequence[dict[str, float]],
    most: int,
) -> Point:
    """The best model of a chain, after the first steps from the best starts of an effect."""
    kept: list[Point] = []
    failure: NotFiniteError | None = None
    for start in starts:
        values = {**point.values, effect: start}
        try:
            trial = evaluate(problem, chain, values, point.strength, point)
        except NotFiniteError as error:
            failure = error
            continue
        # The regressors of all starts would be gigabytes.
        kept = sorted([*kept, trial], key=lambda each: each.objective)[:most]
    if failure is not None and not kept:
        raise failure
    refined = (refine(problem, trial, iterations=3) for trial in kept)
    return min(refined, key=lambda each: each.objective)


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
        again = with_effect(problem, without, effect)
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

"""From a record to a model without effects, and on by an effect more or less, or another plane."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import contextmanager
from dataclasses import replace
from types import SimpleNamespace
from typing import TypeVar

import numpy as np
from threadpoolctl import threadpool_limits

from preisach_jax.chain.description import Chain
from preisach_jax.chain.runs import response, signals_of
from preisach_jax.cores import on_processor
from preisach_jax.effects import resolve
from preisach_jax.effects.base import Effect, HysteresisEffect, InputEffect
from preisach_jax.errors import InputError, NotFiniteError, shown
from preisach_jax.identify.gauss_newton import refine, starts_of
from preisach_jax.identify.problem import ALL, VALIDATION, Point, Problem, evaluate, with_strength
from preisach_jax.identify.regression import FIRST_STRENGTH
from preisach_jax.model import check_clock
from preisach_jax.operator.plane import Plane
from preisach_jax.record.core import Record
from preisach_jax.record.faults import Fault, faults
from preisach_jax.record.joined import by_run, parts_of
from preisach_jax.record.jumps import jumps, wander_rms
from preisach_jax.record.spikes import gross_spikes, input_spikes, isolated_spikes

Progress = Callable[[str, float], None]

Found = TypeVar("Found")

DEFAULT_LEVELS = 25

COARSE_LEVELS = 13
"""Levels of the plane on which both polarities are compared."""

MOST_ROUNDS = 6
"""How often spikes and jumps are looked for: great ones hide smaller ones."""

WORTH_CORRECTING = 0.5
"""Share to which the open level of a record must fall for its jumps to be corrected anew."""

CLEAR_CORRELATION = 0.5
"""Correlation of input and output beyond which its sign is the polarity: a drift, or a loop as wide
as it is high, leaves less."""

MAX_SHARE_WITH_SIGNS = 0.1
"""Held-out mean square, over that with weights of one sign, that weights of both signs must not
leave.  A butterfly leaves 0.01 or less; where one sign is right but a delay is hidden, weights of
both signs imitate some of it, and leave 0.3 to 1."""

POOR = 0.05
"""Held-out error over the spread of the output above which weights of both signs are tried."""

MAX_SHARE_WITH_SPACING = 0.5
"""Held-out mean square, over that with thresholds equally spaced, that thresholds where the output
moves must not leave.  Narrow steep loops leave 0.001 to 0.3."""

SEARCH_ROWS = 8_000
"""Samples to which a longer record is thinned while effects are searched for."""

MOST_STARTS = 2
"""Starts of a form of an effect that are refined."""

MAX_SHARE_OF_FIRST_FORM = 0.95
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


def in_silence(text: str, done: float) -> None:
    """Discarded progress."""
    del text, done


@contextmanager
def double_precision() -> Generator[None]:
    """Work in double precision on the processor, with one thread for small factorisations.

    Several threads of the linear algebra library gain nothing at these sizes, and lose a factor
    of five where other processes want the cores.
    """
    with on_processor(), threadpool_limits(limits=1, user_api="blas"):
        yield


def effects_for(record: Record, asked: Iterable[str | Effect]) -> tuple[Effect, ...]:
    """Effects from their names, for a record; effects pass as they are."""
    found = resolve(asked, {name: record.channels[name].unit for name in record.aux})
    check_clock(found, record)
    return found


def checked_levels(levels: int | None) -> int:
    """The number of levels, or an error that says what it may be."""
    if levels is None:
        return DEFAULT_LEVELS
    try:
        whole = int(levels)
    except (TypeError, ValueError, OverflowError):  # a text, NaN, infinity
        whole = 0
    if isinstance(levels, bool) or whole != levels or not 2 <= whole <= 200:
        raise InputError(f"levels is {shown(levels)}; give an integer from 2 to 200 (25 is usual)")
    return whole


def plane_of(problem: Problem, levels: int) -> Plane:
    """The plane that the input of a record spans; of runs that are held out it is not asked."""
    record = problem.record
    values = record.input
    if len(problem.identified) < len(ALL):
        values = np.concatenate([values[run.rows] for run in record.runs if not run.held_out])
    return Plane(levels, float(values.min()), float(values.max()))


def base_point(problem: Problem, levels: int) -> Point:
    """The rate-independent model, with weights of the signs that the record shows.

    Its thresholds are equally spaced, unless they predict what is held out much better where the
    output moves.
    """
    signs, slot, record = _signs(problem), ("spacing",), problem.record
    if slot in problem.cache:
        return _base_point(problem, problem.cache[slot].with_levels(levels), *signs)
    even = _base_point(problem, plane_of(problem, levels), *signs)
    plane, rows = even.chain.plane, problem.rows[np.isin(problem.fold, problem.identified)]
    seen = SimpleNamespace(input=record.input, output=np.full(len(record), np.nan))
    seen.output[rows] = record.output[rows]
    uneven = _base_point(problem, Plane.of(seen, levels, (plane.low, plane.high)), *signs)
    least = MAX_SHARE_WITH_SPACING * even.validation_mean_square
    point = uneven if uneven.validation_mean_square < least else even
    problem.cache[slot] = point.chain.plane
    return point


def plain_model(record: Record, levels: int) -> tuple[Record, Problem, Point]:
    """The rate-independent model of a record, freed of spikes, faults and jumps of its sensors.

    With the mended record, and that as it was cut for a search.
    """
    record = record.bridged(by_run(record, input_spikes)).masked(_faults(record))
    record = record.without(by_run(record, gross_spikes))
    for _ in range(MOST_ROUNDS):
        problem = Problem.of(record, SEARCH_ROWS)
        point = base_point(problem, levels)
        left = _mended(record, _response(record, point))
        if left is record:
            return record, problem, point
        record = left
    problem = Problem.of(record, SEARCH_ROWS)
    return record, problem, base_point(problem, levels)


def mended(record: Record, modelled: np.ndarray) -> Record:
    """The record without the samples that stand out from a (time,) modelled output, or jumps."""
    left = _mended(record, modelled)
    known = left.spikes.keys() == record.spikes.keys() and left.jumps.keys() == record.jumps.keys()
    if known and wander_rms(left) > WORTH_CORRECTING * wander_rms(record):
        return record
    return left


def mended_by(record: Record, point: Point) -> Record:
    """`mended`, by a model that was found on some of the rows."""
    return mended(record, _response(record, point))


def _mended(record: Record, modelled: np.ndarray) -> Record:
    left = record.without(by_run(record, isolated_spikes, modelled))
    return record.levelled(by_run(record, jumps, modelled)) if left is record else left


def _response(record: Record, point: Point) -> np.ndarray:
    return np.asarray(response(point.chain, point.values, signals_of(record), point.coefficients()))


def _faults(record: Record) -> tuple[Fault, ...]:
    """Stretches in which the sensor of a record is at fault, of each run alone."""
    return tuple(
        fault._replace(start=fault.start + rows.start, stop=fault.stop + rows.start)
        for part, rows in zip(parts_of(record), record.stretches, strict=True)
        for fault in faults(part)
    )


def in_reduced_basis(problem: Problem, point: Point) -> tuple[Problem, Point]:
    """A record and a model of it, to search on from in the directions that the record decides."""
    small = problem.reduced()
    there = evaluate(small, point.chain, point.values, point.strength)
    return small, with_strength(small, there)


def _base_point(problem: Problem, plane: Plane, polarity: int, signed: bool) -> Point:
    chain = Chain(plane, polarity=polarity, signed=signed)
    return with_strength(problem, evaluate(problem, chain, {}, FIRST_STRENGTH))


def _signs(problem: Problem) -> tuple[int, bool]:
    """Polarity of a record's model, and whether its weights have both signs.

    The output rises with the input (1) or falls (-1), and all weights have that sign, unless those
    of both signs predict what is held out much better.
    """
    slot = ("signs",)
    if slot not in problem.cache:
        along = float(np.corrcoef(problem.record.input[problem.rows], problem.target)[0, 1])
        tried = (1, -1) if abs(along) < CLEAR_CORRELATION else (1 if along >= 0 else -1,)
        plane = plane_of(problem, COARSE_LEVELS)
        plain = [_base_point(problem, plane, sign, signed=False) for sign in tried]
        best = min(plain, key=lambda point: point.objective)
        signed = False
        least = MAX_SHARE_WITH_SIGNS * best.validation_mean_square
        if best.validation_mean_square > POOR**2 * float(np.var(problem.goal)):
            both = _base_point(problem, plane, best.chain.polarity, signed=True)
            signed = both.validation_mean_square < least
        problem.cache[slot] = best.chain.polarity, signed
    return problem.cache[slot]


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


def refit(problem: Problem, point: Point) -> Point:
    """Refined, with the strength of the prior that the data choose for it."""
    point = refine(problem, point)
    before = point.strength
    point = with_strength(problem, point)
    return point if point.strength == before else refine(problem, point, iterations=4)


def with_effect(problem: Problem, point: Point, effect: Effect) -> Point:
    """The best model that has an effect more than a point, all refitted jointly."""
    return refit(problem, roughly_with(problem, point, effect))


def roughly_with(problem: Problem, point: Point, effect: Effect) -> Point:
    """The same after the first steps from the best starts of the best form.

    Every start is refitted in full but for the effect's own parameters.
    """
    costly = isinstance(effect, InputEffect | HysteresisEffect)
    found: Point | None = None
    for form in problem.forms_of(effect, point):
        starts = starts_of(form)
        if costly and found is not None:
            if (
                found.validation_mean_square
                > MAX_SHARE_OF_FIRST_FORM * point.validation_mean_square
            ):
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
    rough = problem.rough
    for start in starts:
        values = {**point.values, effect: start}
        try:
            trial = evaluate(rough, chain, values, point.strength, point)
        except NotFiniteError as error:
            failure = error
            continue
        # The regressors of all starts would be gigabytes.
        kept = sorted([*kept, trial], key=lambda each: each.objective)[:most]
    if failure is not None and not kept:
        raise failure
    refined = (refine(rough, trial, iterations=3) for trial in kept)
    there = (evaluate(problem, chain, each.values, point.strength, point) for each in refined)
    return min(there, key=lambda each: each.objective)


def without_effect(problem: Problem, point: Point, name: str) -> Point:
    """The model that lacks one of a point's effects, the others refitted jointly."""
    effects = tuple(effect for effect in point.chain.effects if effect.name != name)
    values = {key: value for key, value in point.values.items() if key != name}
    chain = point.chain.with_effects(effects)
    return refit(problem, evaluate(problem, chain, values, point.strength, point))


def at_levels(problem: Problem, point: Point, levels: int) -> Point:
    """The same model on a plane of other levels, refitted."""
    chain = replace(point.chain, plane=point.chain.plane.with_levels(levels))
    return refit(problem, evaluate(problem, chain, point.values, point.strength, point))


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

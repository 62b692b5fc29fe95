"""From a record to a first model without effects."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace

import numpy as np

from preisach_jax.chain import Chain
from preisach_jax.chain.runs import response, signals_of
from preisach_jax.errors import InputError, shown
from preisach_jax.fit.result import Fit
from preisach_jax.fit.running import Found
from preisach_jax.identify import ALL, Point, Problem, evaluate, with_strength
from preisach_jax.identify.reduction import FIRST_STRENGTH
from preisach_jax.operator.plane import Plane
from preisach_jax.record import Record
from preisach_jax.record.faults import Fault, faults
from preisach_jax.record.joined import by_run, parts_of
from preisach_jax.record.jumps import jumps, wander_rms
from preisach_jax.record.spikes import gross_spikes, input_spikes, isolated_spikes

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

SIGNS_PAY = 0.1
"""Held-out mean square, over that with weights of one sign, that weights of both signs must not
leave.  A butterfly leaves 0.01 or less; where one sign is right but a delay is hidden, weights of
both signs imitate some of it, and leave 0.3 to 1."""

POOR = 0.05
"""Held-out error over the spread of the output above which weights of both signs are tried."""

SPACING_PAYS = 0.5
"""Held-out mean square, over that with thresholds equally spaced, that thresholds where the output
moves must not leave.  Narrow steep loops leave 0.001 to 0.3."""

SEARCH_ROWS = 8_000
"""Samples to which a longer record is thinned while effects are searched for."""


def aux_units(record: Record) -> dict[str, str]:
    """Units of a record's auxiliary columns by name."""
    return {name: record.channels[name].unit for name in record.aux}


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
    least = SPACING_PAYS * even.validation_mean_square
    point = uneven if uneven.validation_mean_square < least else even
    problem.cache[slot] = point.chain.plane
    return point


def begun(record: Record, levels: int) -> tuple[Record, Problem, Point]:
    """The rate-independent model of a record, freed of spikes, faults and jumps of its sensors.

    Returns:
        The mended record, as it was cut for a search, and the model.
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
    """The record without the samples that stand out alone, or if none do, without jumps.

    Arguments:
        modelled: (time,) what a model makes of the record, in output units.
    """
    left = _mended(record, modelled)
    known = left.spikes.keys() == record.spikes.keys() and left.jumps.keys() == record.jumps.keys()
    if known and wander_rms(left) > WORTH_CORRECTING * wander_rms(record):
        return record
    return left


def mended_by(record: Record, point: Point) -> Record:
    """The same beside a model that was found on some of its rows."""
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


def freed_of_blemishes(
    record: Record, work: Callable[[Record], Found], fit_of: Callable[[Found], Fit]
) -> Found:
    """What is found in a record, again as long as what its fit leaves shows spikes or jumps.

    What the plain model misses hides those that one with effects shows.
    """
    found = work(record)
    for _ in range(MOST_ROUNDS):
        fit = fit_of(found)
        if not fit.effects:
            break  # `begun` has left out what a model without effects shows
        left = mended(fit.record, fit.prediction)
        if left is fit.record:
            break
        found = work(left)
    return found


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
        least = SIGNS_PAY * best.validation_mean_square
        if best.validation_mean_square > POOR**2 * float(np.var(problem.goal)):
            both = _base_point(problem, plane, best.chain.polarity, signed=True)
            signed = both.validation_mean_square < least
        problem.cache[slot] = best.chain.polarity, signed
    return problem.cache[slot]

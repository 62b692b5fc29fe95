"""The diagnosis: a model without effects, a search for what it lacks, a conclusion."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

from preisach_jax.diagnosis.budget import refined_levels
from preisach_jax.diagnosis.conclusion import Finals, concluded
from preisach_jax.diagnosis.inside import with_mechanics
from preisach_jax.diagnosis.result import Candidate, Diagnosis
from preisach_jax.diagnosis.search import Search, Selection, Whole
from preisach_jax.diagnosis.tolerance import tolerance_of
from preisach_jax.effects import OF_COLUMNS, library, listed
from preisach_jax.effects.base import Effect
from preisach_jax.fit import Fit, Progress
from preisach_jax.fit.fitted import FINAL_ROWS, freed_of_blemishes
from preisach_jax.fit.stepwise import (
    at_levels,
    checked_levels,
    double_precision,
    effects_for,
    in_reduced_basis,
    in_silence,
    mended_by,
    plain_model,
)
from preisach_jax.identify.problem import Point, Problem
from preisach_jax.loss import magnet_of
from preisach_jax.record.core import Record
from preisach_jax.record.joined import as_one

Watch = Callable[[Fit, tuple[Candidate, ...]], object]
"""Called with a fit on the way of a diagnosis, and with what was tried before it."""

SEARCH_LEVELS = 38
"""Levels of the finest plane on which all effects are tried: a finer one takes long."""

REFINEMENT_PAYS = 0.1
"""Relative fall of the held-out mean square for which a finer plane is kept."""


def diagnose(
    record: Record | Sequence[Record],
    effects: Iterable[str | Effect] | None = None,
    levels: int | None = None,
    *,
    hold_out: Sequence[Record] = (),
    tolerance: str | None = None,
    progress: Progress | None = None,
    watch: Watch | None = None,
) -> Diagnosis:
    """Find out which physical effects a rate-independent model of a record lacks.

    Every effect that the record can show is refitted jointly with the density, from all its starts,
    beside a few models at a time.  Whole models are compared by how well they predict stretches of
    the record from the others (`evidence`): the smallest that predicts as well as the best one is
    taken, and those of its size that predict as well are the families.

    Arguments:
        record: the measurement, or several of one machine: one model, with a memory for each.
        effects: effects to try, by name or as objects; by default the library, without those that
            are tried on request (but with those that are of the field, where the units are those
            of a magnet), and all auxiliary columns.  To try one's own beside the library:
            `[*pj.effects().values(), Mine()]`.
        levels: levels N of the plane; by default 25, and finer where that pays.
        hold_out: further records that are held out whole, in place of blocks of the others.
        tolerance: an error that does not matter, in per cent of the stroke (`"0.1%"`) or with the
            output's unit (`"20 nm"`): what is below it is told, and does not change the verdict.
        progress: called with a text and a share done.
        watch: called with each fit on the way, and with what was tried beside the one before.

    Returns:
        The diagnosis.

    Raises:
        InputError: if what is given is no record, several of them do not belong together, an
            effect is unknown, levels is not an integer from 2 to 200, or the
            tolerance has no unit, another one than the output, or is not below the stroke.

    Example:
        >>> import numpy as np, preisach_jax as pj
        >>> t = np.arange(3000) / 100
        >>> u = 5 - 5 * np.cos(t * (1 + t / 40))
        >>> z = u**1.1 + 0.01 * np.random.default_rng(0).normal(size=3000)
        >>> pj.diagnose(pj.Record.from_arrays(t, u, z), ["drift"], levels=9).verdict
        'adequate'
    """
    record = as_one(record, hold_out, "diagnose")
    asked = effects_to_try(record, effects)
    # It is fitted alone, and only once all others have been asked.
    inside = [effect for effect in asked if effect.inside_mechanics]
    tried = tuple(effect for effect in asked if effect not in inside)
    if not inside and effects is None and record.has_clock:
        mechanics = next((e for e in library().values() if e.inside_mechanics), None)
    else:
        mechanics = inside[0] if inside else None
    least = tolerance_of(tolerance, record)
    with double_precision():
        return freed_of_blemishes(
            record,
            lambda given: _diagnosed(
                given,
                tried,
                (mechanics, bool(inside)),
                levels,
                least,
                progress or in_silence,
                watch,
            ),
            lambda found: found.steps[-1],
        )


def effects_to_try(record: Record, effects: Iterable[str | Effect] | None) -> tuple[Effect, ...]:
    """The effects that are asked for, or the library; with one for each auxiliary column."""
    magnet = magnet_of(record)
    field = magnet.field if magnet else "none"
    everything = [
        name
        for name, effect in library().items()
        if (not effect.on_request or effect.of_field == field)
        and (record.has_clock or not effect.needs_clock)
    ]
    asked = listed(everything if effects is None else effects)
    names = [item if isinstance(item, str) else item.name for item in asked]
    of_columns = [kind.prefix for kind in OF_COLUMNS if f"{kind.prefix}:COL" in names]
    # The library's placeholders: one effect a column.
    asked = [item for item, name in zip(asked, names, strict=True) if not name.endswith(":COL")]
    for prefix in of_columns:
        each = [f"{prefix}:{column}" for column in record.aux]
        asked += [name for name in each if name not in names]
    return effects_for(record, asked)


def _diagnosed(
    record: Record,
    tried: tuple[Effect, ...],
    mechanics: tuple[Effect | None, bool],
    levels: int | None,
    tolerance: float,
    progress: Progress,
    watch: Watch | None,
) -> Diagnosis:
    progress("fitting the rate-independent model", 0.0)
    record, all_hysterons, point = plain_model(record, checked_levels(levels))
    problem, point = in_reduced_basis(all_hysterons, point)

    finals = Finals(record, problem)

    def show(point: Point, tried: tuple[Candidate, ...] = ()) -> None:
        if watch is not None:
            watch(finals.of([point])[0].fit, tried)

    finer = None if levels is not None else finer_plane(problem, point, SEARCH_LEVELS)
    point = finer or point
    search = Search.of(problem, tried, tolerance, progress)
    root = Whole.of(problem, point)
    show(root.point)
    # What the plain model misses hides blemishes that the best effect shows.
    best = search.best_beside(root)
    if best is not None and (left := mended_by(record, best)) is not record:
        return _diagnosed(left, tried, mechanics, levels, tolerance, progress, watch)
    selection = search.run(root, show)
    if levels is None:
        selection = _on_a_finer_plane(selection, search)
    found = concluded(finals, all_hysterons, selection, tolerance, progress)
    effect, asked = mechanics
    return with_mechanics(found, selection, record, effect, tolerance, progress, asked=asked)


def finer_plane(problem: Problem, point: Point, most: int | None = None) -> Point | None:
    """A model on the finest plane that pays; None if none does.

    Arguments:
        most: levels of the finest plane that is tried.
    """
    finest: Point | None = None
    while True:
        now = finest or point
        levels = refined_levels(min(len(problem.record), FINAL_ROWS), now.chain.plane.levels)
        if levels is None or (most is not None and levels > most):
            return finest
        other = at_levels(problem, now, levels)
        least = (1 - REFINEMENT_PAYS) * now.validation_mean_square
        if not other.validation_mean_square < least:
            return finest
        finest = other


def _on_a_finer_plane(selection: Selection, search: Search) -> Selection:
    """The same on the plane that its last model asks for; searched anew if that shows more."""
    finer = finer_plane(selection.problem, selection.now)
    if finer is None:
        return selection
    levels = finer.chain.plane.levels
    refined = selection.on_levels(levels)
    if levels > SEARCH_LEVELS:
        return refined
    again = replace(search, met={}, tried_beside={}, standing={})
    now = Whole.of(again.problem, refined.now)
    if again.is_noise(now) or all(tried.objection for tried in again.beside(now)):
        return refined
    return again.run(Whole.of(again.problem, refined.path[0]))

"""The diagnosis: screen all effects, add the best that passes both tests, repeat, stop."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

from preisach_jax.diagnosis.conclusion import concluded, without_what_explains_too_little
from preisach_jax.diagnosis.finals import FinalFits
from preisach_jax.diagnosis.growth import grown, in_best_forms, with_larger, with_larger_beside
from preisach_jax.diagnosis.inside import with_mechanics
from preisach_jax.diagnosis.pace import Pace
from preisach_jax.diagnosis.pairs import with_better_pair, with_pair
from preisach_jax.diagnosis.result import Candidate, Diagnosis
from preisach_jax.diagnosis.step import Step, on_a_refined_plane, refined_with_signs
from preisach_jax.diagnosis.tolerance import tolerance_of
from preisach_jax.diagnosis.walk import (
    MOST_EFFECTS,
    with_best,
    with_better_rivals,
    with_families,
    without_superfluous,
)
from preisach_jax.effects import OF_COLUMNS, library, listed, resolve
from preisach_jax.effects.base import Effect
from preisach_jax.effects.restoring_force import RestoringForce
from preisach_jax.fit import (
    Fit,
    Progress,
    aux_units,
    begun,
    checked_levels,
    double_precision,
    freed_of_blemishes,
    in_reduced_basis,
    in_silence,
    mended_by,
)
from preisach_jax.loss import magnet_of
from preisach_jax.record import Record
from preisach_jax.record.joined import as_one

Watch = Callable[[Fit, tuple[Candidate, ...]], object]
"""Called with a fit on the way of a diagnosis, and with all that was tried before it."""


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

    Every effect whose signature, freed from what the density can take up, is in the residual is
    refitted jointly with the density and judged on held-out blocks.  The best is added if it
    passes both tests (`evidence`), and the search goes on from there; effects that later ones have
    made superfluous are taken out again.

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
    inside = [effect for effect in asked if isinstance(effect, RestoringForce)]
    tried = tuple(effect for effect in asked if effect not in inside)
    mechanics = inside[0] if inside else RestoringForce() if effects is None else None
    least = tolerance_of(tolerance, record)
    with double_precision():
        return freed_of_blemishes(
            record,
            lambda given: _walk(
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
        if not effect.on_request or effect.of_field == field
    ]
    asked = listed(everything if effects is None else effects)
    names = [item if isinstance(item, str) else item.name for item in asked]
    of_columns = [kind.prefix for kind in OF_COLUMNS if f"{kind.prefix}:COL" in names]
    # The library's placeholders: one effect a column.
    asked = [item for item, name in zip(asked, names, strict=True) if not name.endswith(":COL")]
    for prefix in of_columns:
        each = [f"{prefix}:{column}" for column in record.aux]
        asked += [name for name in each if name not in names]
    return resolve(asked, aux_units(record))


def _walk(
    record: Record,
    tried: tuple[Effect, ...],
    mechanics: tuple[RestoringForce | None, bool],
    levels: int | None,
    tolerance: float,
    progress: Progress,
    watch: Watch | None,
) -> Diagnosis:
    """The diagnosis of one record, begun again without the blemishes that an effect shows."""
    while True:
        pace = Pace(progress)
        pace.tell("fitting the rate-independent model", 0.0)
        record, problem, point = begun(record, checked_levels(levels))
        small, point = in_reduced_basis(problem, point)
        step = Step(record, small, problem, tried, (point,))
        with FinalFits(record) as finals:
            found = _selected(step, finals, levels is not None, tolerance, pace, watch)
            if isinstance(found, Step):
                if levels is None:
                    found = refined_with_signs(found)
                plain = concluded(found, finals, tolerance, pace.tell)
                effect, asked = mechanics
                return with_mechanics(
                    plain, found, finals, effect, tolerance, pace.tell, asked=asked
                )
        record = found


def _selected(
    step: Step,
    finals: FinalFits,
    levels_are_given: bool,
    tolerance: float,
    pace: Pace,
    watch: Watch | None,
) -> Step | Record:
    """Forward selection with a backward check; the record without its spikes where it has some."""

    def refined_and_shown(step: Step) -> Step:
        step = in_best_forms(step)
        step = on_a_refined_plane(step, levels_are_given, lambda text: pace.tell(text, 0.0))
        finals.begin(step.problem, step.now)
        if watch is not None:
            watch(finals.of(step.problem, step.now).fit, step.candidates)
        return step

    step = refined_and_shown(step)
    while len(step.named) < MOST_EFFECTS:
        pace.begin_round(len(step.named))
        larger = grown(step)
        tried, more = with_best(step, tolerance, pace.tell)
        pair = with_better_pair(step, tried, tolerance)
        if pair is not None:
            pair = with_better_rivals(pair, range(len(pair.named)))
        others = [other for other in (larger, pair) if other is not None]
        other = min(others, key=lambda other: other.now.validation_mean_square, default=None)
        step = tried
        if other is not None and not (more and _is_better(step, other)):
            beside, found = (step, False) if more else with_larger_beside(step, tolerance, other)
            step = refined_and_shown(beside if found else other)
            continue
        if not more:
            step, more = with_larger(step, tolerance)
        if not more:
            step, more = with_pair(step, tolerance)
        if not more:
            step, more = with_larger_beside(step, tolerance)
        if not more:
            break
        if len(step.named) == 1:
            left = mended_by(step.record, step.now)
            if left is not step.record:
                return left
        # The rivals of the last one were tried beside the very same model.
        step = with_better_rivals(step, range(len(step.named) - 1))
        # A finer plane may bring out what the coarse one has hidden.
        step = refined_and_shown(without_superfluous(step))
    else:  # no effect more may be named, but those that are may still lack a term
        while (larger := grown(step)) is not None:
            step = refined_and_shown(larger)
    pace.begin_conclusion(len(step.named))
    return without_what_explains_too_little(with_families(step, range(len(step.named))))


def _is_better(step: Step, other: Step) -> bool:
    """Whether the model of a step leaves less on the rows held out than that of another."""
    return step.now.validation_mean_square < other.now.validation_mean_square

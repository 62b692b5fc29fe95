"""Fit a model of chosen effects to a record."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from preisach_jax.effects.base import Effect, OfColumn
from preisach_jax.errors import InputError
from preisach_jax.fit.fitted import Added, Fit, freed_of_blemishes, on_all_rows
from preisach_jax.fit.mechanical import fit_inside
from preisach_jax.fit.stepwise import (
    Progress,
    checked_levels,
    double_precision,
    effects_for,
    feeds_back,
    held_out_rms,
    in_reduced_basis,
    in_silence,
    on_a_coarser_plane,
    plain_model,
    with_effect,
)
from preisach_jax.fit.training import Schedule, Training, in_double, trained
from preisach_jax.identify.confidence import with_model_error
from preisach_jax.record.core import Record
from preisach_jax.record.joined import as_one

if TYPE_CHECKING:
    from optax import GradientTransformation

__all__ = ["Added", "Fit", "Progress", "Schedule", "Training", "fit"]

UNTRAINED = 0.2
"""Share of the work that is done until arrays are trained, if any are."""


def fit(
    record: Record | Sequence[Record],
    effects: Iterable[str | Effect] = (),
    levels: int | None = None,
    *,
    hold_out: Sequence[Record] = (),
    progress: Progress | None = None,
    optimiser: GradientTransformation | None = None,
    training_steps: int | None = None,
) -> Fit:
    r"""Fit the Preisach model with chosen effects to a record.

    Minimises \(\|z - \hat z(R, \theta)\|^2 + \lambda\, R^\top P R\) over weights \(R \ge 0\)
    and the parameters \(\theta\) of the effects; the record chooses \(\lambda\).

    Arguments:
        record: the measurement, or several of one machine: one model, with a memory for each.
        effects: names of the library, or effects of one's own.
        levels: levels N of the plane; by default 25.
        hold_out: further records that are held out whole, in place of blocks of the others.
        progress: called with a text and a share done.
        optimiser: of optax, such as `optax.adam(1e-2)`, which trains the floating arrays that
            effects of one's own hold, through the model; without one they stay as they are.
        training_steps: its steps at most, by default 2000; a third of the identification rows
            tells when to stop.

    Returns:
        The fit.

    Raises:
        InputError: if what is given is no record, several of them do not belong together, an
            effect is unknown or that of a constant column, levels is not an integer from 2 to
            200, an optimiser has nothing to train, or a training fails before it finds anything
            better than its start.

    Example:
        >>> import numpy as np, preisach_jax as pj
        >>> t = np.arange(3000) / 100
        >>> u = 5 - 5 * np.cos(t * (1 + t / 40))
        >>> fit = pj.fit(pj.Record.from_arrays(t, u, u**1.1), levels=9)
        >>> fit.fit_percent > 99
        True
    """
    record = as_one(record, hold_out, "fit")
    chosen = effects_for(record, effects)
    for name, values in record.aux.items():
        own = [e.name for e in chosen if isinstance(e, OfColumn) and e.column == name]
        if np.ptp(values) == 0 and own:
            raise InputError(
                f"{record.name}, column {name}: the auxiliary column is constant "
                f"({values[0]:g}), so its effect cannot be seen; leave out {own[0]}"
            )
    schedule = None if optimiser is None else Schedule.of(optimiser, training_steps)
    if schedule is None and training_steps is not None:
        raise InputError(
            f"training_steps is {training_steps}, but nothing is trained without an optimiser; "
            "give one, such as optimiser=optax.adam(1e-2)"
        )
    with double_precision():
        if schedule is not None:
            chosen = in_double(chosen)
        return freed_of_blemishes(
            record,
            lambda given: _fitted(
                given, chosen, checked_levels(levels), schedule, progress or in_silence
            ),
            lambda found: found,
        )


def _fitted(
    record: Record,
    chosen: tuple[Effect, ...],
    levels: int,
    schedule: Schedule | None,
    progress: Progress,
) -> Fit:
    inside: list[Any] = [effect for effect in chosen if effect.inside_mechanics]
    if inside and len(chosen) > 1:
        others = ", ".join(effect.name for effect in chosen if effect is not inside[0])
        raise InputError(
            f"{record.name}: {inside[0].name} is fitted alone, since no other effect acts inside "
            f"its mechanics; leave out {others}"
        )
    record, problem, point = plain_model(record, levels)
    if inside:
        found = fit_inside(record, inside[0], point, levels, progress)
        before = held_out_rms(problem, point)
        return replace(found, added=(Added(found.effects, before, found.rms_validation),))
    backwards = [effect.name for effect in chosen if feeds_back(effect)]
    if point.chain.signed and backwards:
        raise InputError(
            f"{record.name}: the record asks for weights of both signs, beside which "
            f"{backwards[0]} has no unique output; leave it out"
        )
    problem, point = in_reduced_basis(problem, point)
    share = 1.0 if schedule is None else UNTRAINED
    errors = [held_out_rms(problem, point)]
    for position, effect in enumerate(chosen):
        progress(f"fitting {effect.name}", share * position / len(chosen))
        point = with_effect(problem, point, effect)
        errors.append(held_out_rms(problem, point))
    pairs = zip(chosen, itertools.pairwise(errors), strict=True)
    added = tuple(Added((effect.name,), *pair) for effect, pair in pairs)
    training = None
    if schedule is not None:

        def show(text: str, done: float) -> None:
            progress(text, share + (1 - share) * done)

        names = [effect.name for effect in chosen]
        point, training = trained(problem, point, names, schedule, show)
        added = (Added(tuple(names), errors[0], held_out_rms(problem, point)),)
    found = replace(on_all_rows(record, problem, point), training=training, added=added)
    if not point.parameters and not point.chain.coefficients:
        return found
    # What the cells add moves parameters as well: intervals from the residual alone are too short.
    coarser = on_a_coarser_plane(problem, point)
    parameters = with_model_error(found.model.parameters, point, coarser)
    return replace(found, model=replace(found.model, parameters=parameters))

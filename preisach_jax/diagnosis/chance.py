"""Whether a column goes with what a model leaves more closely than chance lets it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import jax.numpy as jnp
import numpy as np

from preisach_jax.chain.signals import each_run
from preisach_jax.diagnosis.plausible import bound_near
from preisach_jax.effects.base import Effect, Signals
from preisach_jax.effects.modal import Modal
from preisach_jax.effects.of_column import OfColumn
from preisach_jax.identify import Point, Problem
from preisach_jax.identify.signature import Projection, prospects

SHIFTS = 10
"""Parts of a record by which a column is shifted, forward in time and backward: with the column
backward and not shifted there are 19 other courses, and one in twenty columns that have nothing to
do with the output leads them all."""


def by_chance(problem: Problem, now: Point, effect: Effect, rich: Point) -> str:
    """What says that a column goes with a wander by chance; empty if nothing does.

    Signals that wander at random go together for as long as a record is short, and a test that
    takes its blocks for independent does not see it.  So the column is shifted in time, which
    leaves its spectrum as it is: where it does no more than a shifted one, to first order in its
    amount, it says nothing.  Behind a lag as long as is looked for, any column is so smooth that it
    is a course more of what wanders.
    """
    if not (isinstance(effect, OfColumn) and any(each.lawless for each in now.chain.effects)):
        return ""
    for parameter in effect.parameters():
        value = rich.values[effect.name][parameter.name]
        if parameter.name == "tau_s" and bound_near(parameter, value) == "upper":
            return (
                f"behind a lag of {value:.3g} s, the longest that is looked for, "
                f"{effect.column} is a course more of what wanders"
            )
    # Where the column's own response has its modes, a shifted one has none.
    form = replace(effect, starts=()) if isinstance(effect, Modal) else effect
    projection = Projection(problem, now)

    def left_by(signals: Signals) -> float:
        found = prospects(replace(problem, signals=signals), now, projection, [form])
        return min(float(np.mean(each.promise.residual**2)) for each in found)

    here = left_by(problem.signals)
    if any(left_by(other) <= here for other in _shifted(problem.signals, effect.column)):
        return (
            f"{effect.column} shifted in time explains as much of what wanders: that they go "
            "together is chance"
        )
    return ""


def _shifted(signals: Signals, column: str) -> Iterator[Signals]:
    """Signals with a column shifted in time within each run, and backward."""
    for part in range(SHIFTS):
        for direction in (1, -1):
            if part or direction < 0:
                yield each_run(partial(_turned, column, part / SHIFTS, direction), signals)


def _turned(column: str, share: float, direction: int, signals: Signals) -> Signals:
    """The signals of a run with a column that goes in a direction from a share of the run on."""
    course = np.asarray(signals.aux[column])
    turned = np.roll(course[::direction], round(share * len(course)))
    return replace(signals, aux={**signals.aux, column: jnp.asarray(turned)})

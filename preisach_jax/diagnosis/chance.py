"""Whether a column goes with what a model leaves more closely than chance lets it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import jax.numpy as jnp
import numpy as np

from preisach_jax.chain.signals import each_run
from preisach_jax.effects.base import OfColumn, Signals
from preisach_jax.identify import Point, Problem, evaluate

SHIFTS = 10
"""Parts of a record by which a column is shifted, forward in time and backward: with the column
backward and not shifted there are 19 other courses, and one in twenty columns that have nothing to
do with the output leads them all."""


def by_chance(problem: Problem, point: Point, name: str) -> str:
    """What says that a column goes with a wander by chance; empty if nothing does.

    Signals that wander at random go together for as long as a record is short, and rows between
    those that identify tell nothing of it.  So the column is shifted in time, which leaves its
    spectrum as it is: where it does no more than a shifted one, it says nothing.
    """
    effect = point.chain.effect(name)
    if not (isinstance(effect, OfColumn) and any(each.lawless for each in point.chain.effects)):
        return ""
    for signals in _shifted(problem.signals, effect.column):
        other = replace(problem, signals=signals)
        there = evaluate(other, point.chain, point.values, point.strength, point)
        if there.objective <= point.objective:
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

"""Signatures: what an effect would change, freed from what a model can take up."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy

from preisach_jax.chain.coefficients import Coefficients, coarsened
from preisach_jax.chain.description import Chain
from preisach_jax.chain.runs import columns_behind, driven_path, response, responses, tangents
from preisach_jax.effects.base import (
    AddedEffect,
    Effect,
    HysteresisEffect,
    InputEffect,
    SensorEffect,
    WeightEffect,
)
from preisach_jax.effects.parameter import Parameter
from preisach_jax.errors import NotFiniteError
from preisach_jax.identify.gauss_newton import linearise, starts_of
from preisach_jax.identify.problem import Point, Problem

COARSE_LEVELS = 19
"""Levels of the plane on which the signature of moved thresholds is computed."""

HIDDEN = 1e-4
"""Share of a signature that the rest of the model must leave for it to be seen at all."""


@dataclass(frozen=True)
class Seen:
    """A signature as the record sees it: its estimated size and that one's deviation.

    Attributes:
        values: parameters of the effect.
        size: least-squares factor of the signature in the residual.
        deviation: of the size, from its scatter over blocks; infinite where nothing is to be seen.
        rms: of the whole signature, in output ranges.
        absorbed: share of its power that the model can take up.
    """

    values: dict[str, float]
    size: float
    deviation: float
    rms: float
    absorbed: float


class Projection:
    """Takes out of a signature what a model can take up, on the rows that identify it.

    Arguments:
        any_sign: whether weights and amounts that are zero, as those of the other sign would be,
            count as well.
    """

    def __init__(self, problem: Problem, point: Point, *, any_sign: bool = False):
        linear = linearise(problem, point, point.parameters)
        gram, _ = linear.equations.system(point.folds, point.strength)
        free = ~point.equations.nonnegative | (point.solution > 0) | any_sign
        # An amount at zero could make up for a signature by a sign that it cannot have.
        loose = np.array(
            [
                any_sign or not p.is_amount or point.values[e][p.name] > 0
                for e, p in point.parameters
            ],
            dtype=bool,
        )
        inside = np.concatenate([free, loose])
        self.rows: np.ndarray = np.isin(problem.fold, point.folds)
        self.block: np.ndarray = problem.block[self.rows]
        matrix = point.matrix if free.all() else point.matrix[:, free]
        if loose.any():
            matrix = np.concatenate([matrix, linear.tangents[:, loose]], axis=1)
        self.matrix: np.ndarray = matrix
        self.factor: Any = scipy.linalg.cho_factor(gram[np.ix_(inside, inside)])
        self.residual: np.ndarray = point.residual[self.rows]

    def left(self, signatures: np.ndarray) -> np.ndarray:
        """What the model leaves of `(row,)` or `(row, signature)`."""
        identified = self.rows if not self.rows.all() else slice(None)
        moment = self.matrix[identified].T @ signatures[identified]
        return signatures - self.matrix @ scipy.linalg.cho_solve(self.factor, moment)

    def see(self, signature: np.ndarray, values: dict[str, float]) -> Seen:
        """Size of a signature, `(row,)` in output ranges, in the residual, with its deviation."""
        own = signature[self.rows]
        whole = float(own @ own)
        rms = float(np.sqrt(whole / len(own)))
        unseen = Seen(values, np.nan, np.inf, rms, 1.0)
        if not np.isfinite(whole):
            return unseen
        left = self.left(signature)[self.rows]
        power = float(left @ left)
        if power <= HIDDEN**2 * whole:
            return unseen
        scores = np.bincount(self.block, left * self.residual)
        scores = scores[np.unique(self.block)]
        spread = np.sqrt((scores**2).sum() * len(scores) / (len(scores) - 1))
        size = float(left @ self.residual) / power
        return Seen(values, size, float(spread) / power, rms, 1 - power / whole)

    def most_rms(self, deviations: float) -> float:
        """RMS of the residual, and so many deviations of it more, from its scatter over blocks."""
        _, blocks = np.unique(self.block, return_inverse=True)
        squares = np.bincount(blocks, self.residual**2) / np.bincount(blocks)
        deviation = squares.std(ddof=1) / np.sqrt(len(squares))
        return float(np.sqrt(np.mean(self.residual**2) + deviations * deviation))


def amounts_of(effect: Effect) -> list[Parameter]:
    """What an effect changes the output in proportion to, where it is weak; may be empty."""
    amounts = [p for p in effect.parameters() if p.is_amount or p.start == (0.0,)]
    if isinstance(effect, AddedEffect | SensorEffect):
        return [*amounts, *effect.coefficients()]
    return amounts


def amount_signatures(
    problem: Problem, point: Point, effect: Effect
) -> Iterator[tuple[dict[str, float], np.ndarray]]:
    """Changes for a unit of each amount, `(row, amount)`, at all starts of the other parameters."""
    chain, coefficients = _with_room(point, effect)
    names = [(effect.name, parameter.name) for parameter in amounts_of(effect)]
    for values in starts_of(effect):
        if isinstance(effect, AddedEffect | SensorEffect):
            columns = _columns_alone(problem, point, effect, values)
        else:
            everything = _values_with(problem, point, chain, effect, values)
            columns = tangents(chain, everything, problem.signals, coefficients, names)
        yield values, columns[problem.rows] / problem.unit


def size_signatures(
    problem: Problem, point: Point, effect: Effect
) -> Iterator[tuple[dict[str, float], np.ndarray]]:
    """Changes by the effect, `(row,)` in output ranges, at all its starts."""
    chain, coefficients = _with_room(point, effect)
    without = chain.with_effects(point.chain.effects)
    starts = starts_of(effect)
    for values in starts:
        _values_with(problem, point, chain, effect, values)
    changes = changes_of_output(problem, point, without, chain, coefficients, effect.name, starts)
    yield from zip(starts, changes, strict=True)


def changes_of_output(
    problem: Problem,
    point: Point,
    without: Chain,
    chain: Chain,
    coefficients: Coefficients,
    effect: str,
    starts: list[dict[str, float]],
) -> np.ndarray:
    """Changes of the output from one chain to another, `(start, row)` in output ranges."""
    present = np.asarray(response(without, point.values, problem.signals, coefficients))
    changed = responses(chain, point.values, problem.signals, coefficients, effect, starts)
    return (changed - present)[:, problem.rows] / problem.unit


def _values_with(
    problem: Problem, point: Point, chain: Chain, effect: Effect, values: dict[str, float]
) -> dict[str, dict[str, float]]:
    """The values of a chain that has an effect more, with which its hysterons can be driven."""
    everything = {**point.values, effect.name: values}
    if not isinstance(effect, InputEffect | HysteresisEffect):
        return everything
    # Hysterons saturate, so that an infinite input would not show in the output.
    if not np.isfinite(driven_path(chain, everything, problem.signals)).all():
        raise NotFiniteError(f"it gives values that are not finite at {values}; check its law")
    return everything


def _columns_alone(
    problem: Problem, point: Point, effect: Effect, values: dict[str, float]
) -> np.ndarray:
    """What the effect's own coefficients multiply, `(time, column)`."""
    # What is before the loop may be before its columns too, and what scales it may scale them.
    others: list[Effect] = []
    if isinstance(effect, AddedEffect):
        others = [*point.chain.at(InputEffect), *point.chain.at(WeightEffect)]
    alone = point.chain.with_effects((effect, *others))
    own = {**point.values, effect.name: values}
    parts = columns_behind(alone, own, problem.signals, problem.rows, problem.target)
    return parts[0]


def _with_room(point: Point, effect: Effect) -> tuple[Chain, Coefficients]:
    """The chain of a point with an effect more, and its coefficients with none for that."""
    chain = point.chain.with_effects((*point.chain.effects, effect))
    present = point.coefficients()
    names = [(e, c.name) for e, c in point.chain.coefficients]

    def with_room(added: np.ndarray) -> np.ndarray:
        by_name = dict(zip(names, added, strict=True))
        return np.array([by_name.get((e, c.name), 0.0) for e, c in chain.coefficients])

    own = [np.concatenate([run[:1], with_room(run[1:])]) for run in present.own]
    own = np.array(own).reshape(len(own), -1) if own else present.own
    present = replace(present, added=with_room(present.added), own=own)
    plane = chain.plane
    if isinstance(effect, HysteresisEffect) and plane.levels > COARSE_LEVELS:
        # Moved thresholds are followed one by one, and change the output alike on a coarser plane.
        present = coarsened(plane, present, COARSE_LEVELS)
        chain = replace(chain, plane=plane.with_levels(COARSE_LEVELS))
    return chain, present

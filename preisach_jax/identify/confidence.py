"""Confidence intervals of a model's parameters from residuals that are correlated in time."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy

from preisach_jax.chain import Coefficients
from preisach_jax.chain.runs import of_last_run
from preisach_jax.effects.base import Parameter
from preisach_jax.identify import FOLDS, Linearised, Point, Problem, linearise
from preisach_jax.identify.point import share_off
from preisach_jax.model import ParameterEstimate
from preisach_jax.model.band import Others, rounded

LEVEL = 0.95
"""Coverage of the intervals, and certainty of the tests."""

OF_THE_LAW = 1.3
"""How many times as long intervals are for machines, whose laws are never quite those of effects.
With it 93 % of 136 parameters of blind records with seeds from 8e9 and 9e9 are held, 88 % without;
95 % and 90 % if those of viscosity are left out, whose speed was late."""

OTHERS_OF_BLOCKS = 12
"""Models that a band gets from stretches of the record."""

OTHERS_OF_PRIOR = 16
"""Models that a band gets from what the smoothness prior decides."""


class Influences(NamedTuple):
    """What parts of a record move of every column of a model.

    Attributes:
        linear: the columns, and behind them the tangents of the nonlinear parameters.
        blocks: (block, column) what each block moves.
        stretches: (stretch, column) the same of stretches of four blocks.
        inside: columns that are free of their bound.
        gram: (column, column) regularised matrix of the regression on all columns.
    """

    linear: Linearised
    blocks: np.ndarray
    stretches: np.ndarray
    inside: np.ndarray
    gram: np.ndarray


def estimates(
    problem: Problem, point: Point, known: Influences | None = None
) -> dict[str, dict[str, ParameterEstimate]]:
    r"""All parameters of a point's effects with 95 % intervals.

    Joint linearisation in weights and parameters, with the sandwich covariance
    \(M^{-1} \bigl(\sum_b s_b s_b^\top\bigr) M^{-1}\) over contiguous blocks b, whose scores
    \(s_b = \sum_{k \in b} a_k e_k\) carry whatever correlation the residuals have inside a block
    (H. White, Asymptotic Theory for Econometricians, 2nd ed., Academic Press 2001, ch. 6).  It is
    computed over blocks and over stretches of four of them, and the greater variance is taken.
    """
    parameters = point.parameters
    if not parameters and not point.chain.coefficients:
        return {effect.name: {} for effect in point.chain.effects}
    found_by = known or influences(problem, point, parameters)
    linear, parts = found_by.linear, (found_by.blocks, found_by.stretches)
    size = len(point.solution)
    # Stretches of several blocks hold longer correlations; blocks, being more, are surer.
    deviation = np.sqrt(np.maximum(*(_variances(part) for part in parts)))
    factor = _factor(len(parts[0]))
    found: dict[str, dict[str, ParameterEstimate]] = {
        effect.name: {} for effect in point.chain.effects
    }
    for position, (effect, parameter) in enumerate(parameters):
        half = factor * deviation[size + position] / linear.scale[position]
        found[effect][parameter.name] = _interval(
            parameter, point.values[effect][parameter.name], half, problem
        )
    column = point.columns.first_added
    values = point.coefficients().added
    for position, (effect, coefficient) in enumerate(point.chain.coefficients, start=column):
        half = factor * deviation[position] * problem.unit / point.equations.scale[position]
        found[effect][coefficient.name] = _interval(
            coefficient, float(values[position - column]), float(half), problem
        )
    return found


def with_model_error(
    found: Mapping[str, Mapping[str, ParameterEstimate]], point: Point, other: Point
) -> dict[str, dict[str, ParameterEstimate]]:
    r"""Intervals made longer, on both sides, by what a model is not: of a finer grid, of a machine.

    A plane of another number of levels changes a number by \(d\), which is a share of its error
    (`share_off`): the whole is \(b = d / |1 - (N / N')^p|\).  A side of length s becomes
    \(l \sqrt{s^2 + b^2}\), with l (`OF_THE_LAW`) for what the law of an effect leaves.

    Numbers that the estimates lack, as of a hum of fewer harmonics, count for nothing.
    """
    wider = {effect: dict(own) for effect, own in found.items()}
    share = share_off(point, other)
    pairs = [
        (effect, each, point.values[effect][each.name], other.values[effect][each.name])
        for effect, each in point.parameters
    ]
    amounts = [each.coefficients().added for each in (point, other)]
    names = point.chain.coefficients
    pairs += [(*name, *both) for name, *both in zip(names, *amounts, strict=True)]
    for effect, parameter, here, there in pairs:
        own = wider[effect].get(parameter.name)
        if own is None:
            continue
        change = parameter.to_search(there) - parameter.to_search(here)
        moved = abs(change / share) if share else 0.0
        low = _further(parameter, own.value, own.low, moved, -1)
        high = _further(parameter, own.value, own.high, moved, 1)
        wider[effect][parameter.name] = replace(own, low=low, high=high)
    return wider


def _further(parameter: Parameter, value: float, end: float, moved: float, side: int) -> float:
    """An end of an interval, as far from the value on its side as all its causes make it."""
    if not math.isfinite(end):
        return end
    middle = parameter.to_search(value)
    length = OF_THE_LAW * math.hypot(parameter.to_search(end) - middle, moved)
    return parameter.from_search(middle + math.copysign(length, side))


def influences(
    problem: Problem, point: Point, parameters: list[tuple[str, Parameter]]
) -> Influences:
    """What each block, and each stretch of four, moves of every column."""
    linear = linearise(problem, point, parameters)
    gram, _ = linear.equations.system(point.folds, point.strength)
    free = ~point.equations.nonnegative | (point.solution > 0)
    inside = np.flatnonzero(np.concatenate([free, np.ones(len(parameters), dtype=bool)]))
    residual = point.residual
    # A block is one slice of the rows, of which nothing is copied.
    edges = np.flatnonzero(np.diff(problem.block, prepend=-1, append=-1))
    slices = {
        int(problem.block[start]): slice(start, stop)
        for start, stop in itertools.pairwise(edges.tolist())
    }
    used = np.unique(problem.block[np.isin(problem.fold, point.folds)])
    scores = np.stack(
        [
            np.concatenate(
                [
                    part[slices[b]].T @ residual[slices[b]]
                    for part in (point.matrix, linear.tangents)
                ]
            )
            for b in used.tolist()
        ]
    )[:, inside]
    influence = np.zeros((len(used), gram.shape[0]))
    solved = scipy.linalg.solve(gram[np.ix_(inside, inside)], scores.T, assume_a="pos")
    influence[:, inside] = solved.T
    stretch = used // FOLDS
    longer = np.stack([influence[stretch == s].sum(axis=0) for s in np.unique(stretch)])
    return Influences(linear, influence, longer, inside, gram)


def moves_of(point: Point, found: Influences) -> tuple[np.ndarray, int]:
    r"""What could have come of the record in place of a model: square roots of covariances of it.

    Of the sandwich covariance of `estimates`, each of some stretches of the record is one; of the
    posterior covariance \(\sigma^2 M^{-1}\) of the hysterons alone, with the regularised matrix M,
    those of the greatest variances, of which hardly any row tells and which the smoothness prior
    decides.

    Returns:
        (move, column) changes of all columns, tangents last, and how many are of stretches.
    """
    groups = np.array_split(found.stretches, min(OTHERS_OF_BLOCKS, len(found.stretches)))
    of_blocks = np.stack([group.sum(axis=0) for group in groups])
    of_blocks *= np.sqrt(len(groups) / max(len(groups) - 1, 1))
    density = found.inside[found.inside < point.columns.offset]
    count = min(OTHERS_OF_PRIOR, len(density))
    told, direction = scipy.linalg.eigh(
        found.gram[np.ix_(density, density)], subset_by_index=(0, count - 1), check_finite=False
    )
    told = np.maximum(told, np.finfo(float).tiny)
    of_prior = np.zeros((count, found.blocks.shape[1]))
    of_prior[:, density] = direction.T * np.sqrt(point.validation_mean_square / told)[:, None]
    return np.concatenate([of_blocks, of_prior]), len(groups)


def other_models(
    problem: Problem, point: Point, found: Influences, moves: np.ndarray, of_blocks: int
) -> Others:
    """The models that `moves_of` a point lead to, along the last run of the record.

    Arguments:
        moves: (move, column) changes of all columns.
    """
    size = len(point.solution)

    def numbers(move: np.ndarray) -> Coefficients:
        there = point.coefficients(point.solution + move[:size])
        return of_last_run(point.chain, there, problem.signals)

    here = numbers(np.zeros(size))
    there = [numbers(move) for move in moves]
    parameters = np.zeros((len(moves), len(point.parameters)))
    for position, (effect, parameter) in enumerate(point.parameters):
        value = point.values[effect][parameter.name]
        steps = moves[:, size + position] / found.linear.scale[position]
        if parameter.log:
            coordinate = parameter.to_search(value)
            ends = [parameter.from_search(coordinate + step) for step in steps.tolist()]
            steps = np.array(ends) - value
        # Amounts may leave their bounds: held there, those that make up for others no longer do.
        parameters[:, position] = steps
    return Others(
        of_blocks,
        rounded(np.array([each.weights - here.weights for each in there])),
        np.array([each.offset - here.offset for each in there]),
        np.array([each.added - here.added for each in there]),
        parameters,
    )


def _variances(parts: np.ndarray) -> np.ndarray:
    """Variance of the sum of independent parts, `(part, column)`."""
    count = len(parts)
    return (parts**2).sum(axis=0) * count / (count - 1)


def _factor(count: int) -> float:
    """Half an interval over the standard deviation that `count` parts gave."""
    return float(scipy.special.stdtrit(count - 1, 0.5 + LEVEL / 2))


def _interval(
    parameter: Parameter, value: float, half: float, problem: Problem
) -> ParameterEstimate:
    centre = parameter.to_search(value)
    with np.errstate(over="ignore"):
        low, high = centre - half, centre + half
        if parameter.log:
            low, high = np.exp(low), np.exp(high)
    return ParameterEstimate(
        value,
        float(max(low, parameter.low)),
        float(min(high, parameter.high)),
        problem.shown_unit(parameter.unit),
    )

"""Confidence intervals of a model's parameters from residuals that are correlated in time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import scipy.linalg
import scipy.special

from preisach_jax.effects.base import Parameter
from preisach_jax.identify import FOLDS, Point, Problem, linearise
from preisach_jax.model import ParameterEstimate

LEVEL = 0.95


def estimates(problem: Problem, point: Point) -> dict[str, dict[str, ParameterEstimate]]:
    r"""All parameters of a point's effects with 95 % intervals.

    Joint linearisation in weights and parameters, with the sandwich covariance
    \(M^{-1} \bigl(\sum_b s_b s_b^\top\bigr) M^{-1}\) over contiguous blocks b, whose scores
    \(s_b = \sum_{k \in b} a_k e_k\) carry whatever correlation the residuals have inside a block
    (H. White, Asymptotic Theory for Econometricians, 2nd ed., Academic Press 2001, ch. 6).  It is
    computed over blocks and over stretches of four of them, and the greater variance is taken.

    Arguments:
        problem: the record.
        point: a refined point.

    Returns:
        Estimates by effect and parameter name; intervals never leave the parameters' bounds.
    """
    parameters = point.parameters
    linear = linearise(problem, point, parameters)
    size = len(point.solution)
    gram, _ = linear.equations.system(point.folds, point.strength)
    free = ~point.equations.nonnegative | (point.solution > 0)
    inside = np.flatnonzero(np.concatenate([free, np.ones(len(parameters), dtype=bool)]))
    matrix = np.concatenate([point.matrix, linear.tangents], axis=1)[:, inside]
    residual = point.residual
    used = np.unique(problem.block[np.isin(problem.fold, point.folds)])
    scores = np.stack([matrix[problem.block == b].T @ residual[problem.block == b] for b in used])
    influence = scipy.linalg.solve(gram[np.ix_(inside, inside)], scores.T, assume_a="pos").T
    deviation = np.zeros(gram.shape[0])
    # Stretches of several blocks hold longer correlations; blocks, being more, are surer.
    stretch = used // FOLDS
    longer = np.stack([influence[stretch == s].sum(axis=0) for s in np.unique(stretch)])
    deviation[inside] = np.maximum(_scatter(influence), _scatter(longer))
    factor = scipy.special.stdtrit(len(used) - 1, 0.5 + LEVEL / 2)
    found = {effect.name: {} for effect in point.chain.effects}
    for position, (effect, parameter) in enumerate(parameters):
        half = factor * deviation[size + position] / linear.scale[position]
        found[effect][parameter.name] = _interval(
            parameter, point.values[effect][parameter.name], half, problem
        )
    column = point.columns.offset + 1
    values = point.coefficients().added
    for position, (effect, coefficient) in enumerate(point.chain.coefficients, start=column):
        half = factor * deviation[position] * problem.unit / point.equations.scale[position]
        found[effect][coefficient.name] = _interval(
            coefficient, float(values[position - column]), float(half), problem
        )
    return found


def with_grid_error(
    found: Mapping[str, Mapping[str, ParameterEstimate]], point: Point, other: Point
) -> dict[str, dict[str, ParameterEstimate]]:
    """Intervals made longer, on both sides, by what a plane of other levels changes.

    Arguments:
        found: the `estimates` of a model.
        point: the model.
        other: the same model on a finer or a coarser plane.

    Returns:
        The estimates; intervals never leave the parameters' bounds.
    """
    wider = {effect: dict(own) for effect, own in found.items()}
    pairs = [
        (effect, each, point.values[effect][each.name], other.values[effect][each.name])
        for effect, each in point.parameters
    ]
    amounts = [each.coefficients().added for each in (point, other)]
    names = point.chain.coefficients
    pairs += [(*name, *both) for name, *both in zip(names, *amounts, strict=True)]
    for effect, parameter, here, there in pairs:
        own = wider[effect][parameter.name]
        change = abs(parameter.to_search(there) - parameter.to_search(here))
        low, high = (
            parameter.from_search(parameter.to_search(end) + move) if np.isfinite(end) else end
            for end, move in ((own.low, -change), (own.high, change))
        )
        wider[effect][parameter.name] = replace(own, low=float(low), high=float(high))
    return wider


def _scatter(parts: np.ndarray) -> np.ndarray:
    """Standard deviation of the sum of independent parts, `(part, column)`."""
    count = len(parts)
    return np.sqrt((parts**2).sum(axis=0) * count / (count - 1))


def differs_from_nothing(
    point: Point, effect: str, found: dict[str, dict[str, ParameterEstimate]]
) -> bool:
    """Whether an amount of an effect (a gain, a loss, a coefficient) is surely not zero.

    Effects without an amount, such as a lag, are there as soon as they are in the model.

    Arguments:
        point: the model.
        effect: the effect's name.
        found: its `estimates`.
    """
    amounts = [
        parameter.name
        for name, parameter in point.parameters
        if name == effect and (parameter.is_amount or parameter.start == (0.0,))
    ]
    amounts += [
        each.name for name, each in point.chain.coefficients if name == effect and each.amount
    ]
    intervals = [found[effect][name] for name in amounts]
    return not amounts or any(interval.low * interval.high > 0 for interval in intervals)


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

"""Confidence intervals of a model's parameters from residuals that are correlated in time.

They hold as well what the parameters would be if the input went in arcs from sample to sample.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy

from preisach_jax.chain.coefficients import Coefficients
from preisach_jax.chain.runs import of_last_run, response
from preisach_jax.chain.signals import ThinnedSignals, each_run, parts_of
from preisach_jax.effects.base import Signals
from preisach_jax.effects.parameter import Parameter
from preisach_jax.identify.gauss_newton import Linearised, linearise
from preisach_jax.identify.problem import FOLDS, Point, Problem, grid_error_share
from preisach_jax.model import ParameterEstimate
from preisach_jax.model.band import Others, rounded

LEVEL = 0.95
"""Coverage of the intervals."""

OF_THE_LAW = 1.3
"""How many times as long intervals are for machines, whose laws are never quite those of effects.
With it 93 % of 136 parameters of blind records with seeds from 8e9 and 9e9 are held, 88 % without;
95 % and 90 % if those of viscosity are left out, whose speed was late."""

OTHERS_OF_BLOCKS = 12
"""Models that a band gets from stretches of the record."""

OTHERS_OF_PRIOR = 16
"""Models that a band gets from what the smoothness prior decides."""

OF_HALF_A_STEP = 4 / 3
"""Error of straight lines over what halves of them take off: it goes with the step squared."""

FURTHEST = 50.0
"""Logarithm of a factor beyond which an end of an interval is not moved."""


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
    (`grid_error_share`): the whole is \(b = d / |1 - (N / N')^p|\).  A side of length s becomes
    \(l \sqrt{s^2 + b^2}\), with l (`OF_THE_LAW`) for what the law of an effect leaves.

    Numbers that the estimates lack, as of a hum of fewer harmonics, count for nothing.
    """
    wider = {effect: dict(own) for effect, own in found.items()}
    share = grid_error_share(point, other)
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
    those of the greatest variances, which hardly any row decides and which the smoothness prior
    decides. The result are (move, column) changes of all columns, tangents last, and how many of
    them are of stretches.
    """
    groups = np.array_split(found.stretches, min(OTHERS_OF_BLOCKS, len(found.stretches)))
    of_blocks = np.stack([group.sum(axis=0) for group in groups])
    of_blocks *= np.sqrt(len(groups) / max(len(groups) - 1, 1))
    density = found.inside[found.inside < point.columns.offset]
    count = min(OTHERS_OF_PRIOR, len(density))
    decided, direction = scipy.linalg.eigh(
        found.gram[np.ix_(density, density)], subset_by_index=(0, count - 1), check_finite=False
    )
    decided = np.maximum(decided, np.finfo(float).tiny)
    of_prior = np.zeros((count, found.blocks.shape[1]))
    of_prior[:, density] = direction.T * np.sqrt(point.validation_mean_square / decided)[:, None]
    return np.concatenate([of_blocks, of_prior]), len(groups)


def other_models(
    problem: Problem, point: Point, found: Influences, moves: np.ndarray, of_blocks: int
) -> Others:
    """The models that (move, column) `moves_of` a point lead to, along the record's last run."""
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


def with_arcs(
    found: Mapping[str, Mapping[str, ParameterEstimate]],
    problem: Problem,
    point: Point,
    by: Influences,
) -> dict[str, dict[str, ParameterEstimate]]:
    """Intervals that hold the values of a model whose input goes in arcs between its samples, too.

    It is not known how an input went between two samples.  What a model's output changes by
    arcs in place of straight lines (`change_by_arcs`) moves its columns as noise does.
    """
    wider = {effect: dict(own) for effect, own in found.items()}
    if not any(wider.values()):
        return wider
    moved = _moved_by(change_by_arcs(problem, point), problem, point, by)
    if not np.isfinite(moved).all():
        return wider
    nonlinear = zip(point.parameters, moved[len(point.solution) :] / by.linear.scale, strict=True)
    amounts = moved[: len(point.solution)] * problem.unit / point.equations.scale
    linear = zip(point.chain.coefficients, amounts[point.columns.first_added :], strict=True)
    for (effect, parameter), shift in (*nonlinear, *linear):
        wider[effect][parameter.name] = _reaching(parameter, wider[effect][parameter.name], shift)
    return wider


def _reaching(parameter: Parameter, own: ParameterEstimate, shift: float) -> ParameterEstimate:
    """An interval about a value, and about what it would be without a shift."""
    shift = float(np.clip(shift, -FURTHEST, FURTHEST)) if parameter.log else float(shift)
    if shift > 0:
        return replace(own, low=parameter.from_search(parameter.to_search(own.low) - shift))
    if shift < 0:
        return replace(own, high=parameter.from_search(parameter.to_search(own.high) - shift))
    return own


def _moved_by(change: np.ndarray, problem: Problem, point: Point, by: Influences) -> np.ndarray:
    """(column,) what a change of the output, `(row,)` in output ranges, moves of every column."""
    rows = np.isin(problem.fold, point.folds)
    parts = (point.matrix, by.linear.tangents)
    pull = np.concatenate([part[rows].T @ change[rows] for part in parts])[by.inside]
    moved = np.zeros(len(by.gram))
    gram = by.gram[np.ix_(by.inside, by.inside)]
    moved[by.inside] = scipy.linalg.solve(gram, pull, assume_a="pos")
    return moved


def change_by_arcs(problem: Problem, point: Point) -> np.ndarray:
    """By how much the output of a model changes where its input bends between the samples.

    The model runs along twice as many samples, of which every second one lies on an arc through its
    neighbours.  What goes straight from sample to sample inside a model, as that does which a lag
    passes on to a mode, goes straight for half the time there. Along a record that was thinned the
    (row,) change, in output ranges, is zero.
    """
    parts = parts_of(problem.signals)
    if any(isinstance(part, ThinnedSignals) for part in parts):
        return np.zeros(len(problem.rows))
    numbers = point.coefficients()
    straight, bent = (
        np.asarray(response(point.chain, point.values, signals, numbers))
        for signals in (problem.signals, each_run(on_arcs, problem.signals))
    )
    # Nothing lies between the last sample of a run and the first one of the next.
    run = np.repeat(np.arange(len(parts)), [len(part.time) for part in parts])
    at_samples = bent[2 * np.arange(len(run)) - run]
    return OF_HALF_A_STEP * (at_samples - straight)[problem.rows] / problem.unit


def on_arcs(signals: Signals) -> Signals:
    r"""Signals with a sample between each two; that of the input lies on an arc.

    \[ x_{k+1/2} = \frac{x_k + x_{k+1}}{2} - \frac{\Delta t^2}{8}\,
       \frac{a_k a_{k+1} (a_k + a_{k+1})}{a_k^2 + a_{k+1}^2} \]

    with the second differences a, and no arc where their signs differ: corners stay corners (G. D.
    van Albada, B. van Leer, W. W. Roberts, Astron. Astrophys. 108 (1982) 76-84).
    """
    time, x = np.asarray(signals.time), np.asarray(signals.input)
    step = np.diff(time)
    slope = np.diff(x) / np.where(step > 0, step, 1.0)
    apart = step[1:] + step[:-1]
    bend = np.pad(2 * np.diff(slope) / np.where(apart > 0, apart, 1.0), 1)
    begin, end = bend[:-1], bend[1:]
    same_sign = begin * end > 0
    squares = np.where(same_sign, begin**2 + end**2, 1.0)
    mean = np.where(same_sign, begin * end * (begin + end) / squares, 0.0)
    return Signals(
        _between(signals.time),
        _between(signals.input, mean * step**2 / 8),
        {name: _between(values) for name, values in signals.aux.items()},
    )


def _between(values: jax.Array, arc: np.ndarray | float = 0.0) -> jax.Array:
    """Values with the mean of each two between them, less the height of an arc."""
    here = np.asarray(values)
    middle = (here[1:] + here[:-1]) / 2 - arc
    return jnp.asarray(np.insert(here, np.arange(1, len(here)), middle), values.dtype)

r"""Linear part of the identification: normal equations, smoothness prior, non-negative weights.

A record never tells most combinations of hysterons apart: they follow the smoothness prior. The
generalised eigenvectors of the Gram matrix G of the regressors and of G + P, with the penalty P of
the prior, sort them by the share of a direction that the data decide (the directions of a smoothing
spline: G. Wahba, Spline Models for Observational Data, SIAM 1990). Some hundred of them, a reduced
`Basis`, predict rows that were held out as well as a thousand hysterons do, so that effects can be
searched for in their span.
"""

from __future__ import annotations

import importlib
import itertools
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy

from preisach_jax.chain.hysteresis import HysteresisColumns

# At once, not with its first use: only the threads of a library that is loaded can be limited.
importlib.import_module("scipy.linalg")

STRENGTHS = tuple(10.0**exponent for exponent in range(-8, 1))
"""Strengths of the smoothness prior among which the data choose, per sample."""

LEAST_IMPROVEMENT = 1e-3
"""Relative fall of the cross-validated error for which another strength is preferred."""

RIDGE = 1e-10
"""Ridge relative to the largest diagonal entry: keeps columns that never move determinate."""

MEMORY_STRENGTH = 1e-6
"""Strength, per sample, with which an unknown start is drawn to half of what is possible, and one
without bounds to zero."""

SIZES = (64, 128, 192, 256)
"""Numbers of vectors that are tried: few, so that few shapes are compiled."""

ENOUGH = 1.02
"""Held-out mean square, over that with the most vectors, with which fewer will do."""

MANY_AT_BOUND = 0.25
"""Share of coefficients at their bound from which on the others alone are factorised."""

FIRST_STRENGTH = 1e-4
"""Strength of the smoothness prior from which the search for the best one starts."""

TRIED_STRENGTHS = (1e-2, 1e-3, 1e-4, 1e-5)
"""Strengths of the prior among which the best one judges how many vectors are enough."""


@lru_cache(maxsize=16)
def smoothness(levels: int) -> np.ndarray:
    r"""Smoothness prior on the density, as a quadratic form on the weights.

    Thin-plate energy \(\sum R_{\alpha\alpha}^2 + 2 R_{\alpha\beta}^2 + R_{\beta\beta}^2\) by second
    differences (G. Wahba, Spline Models for Observational Data, SIAM 1990).  The diagonal carries
    the reversible part, which need not resemble its neighbours: it is smoothed along itself only.
    """
    index = np.full((levels + 2, levels + 2), -1)
    alpha, beta = np.tril_indices(levels)
    index[alpha + 1, beta + 1] = np.arange(len(alpha))  # a border of -1 stands for "no cell"
    off_diagonal = index.copy()
    off_diagonal[np.arange(levels + 2), np.arange(levels + 2)] = -1
    diagonal = np.full_like(index, -1)
    np.fill_diagonal(diagonal, np.diag(index))
    second, mixed = (1.0, -2.0, 1.0), (2**0.5, -(2**0.5), -(2**0.5), 2**0.5)
    stencils = (
        (off_diagonal, ((-1, 0), (0, 0), (1, 0)), second),
        (off_diagonal, ((0, -1), (0, 0), (0, 1)), second),
        (off_diagonal, ((0, 0), (1, 0), (0, 1), (1, 1)), mixed),
        (diagonal, ((-1, -1), (0, 0), (1, 1)), second),
    )
    energy = np.zeros((len(alpha), len(alpha)))
    for cells, offsets, factors in stencils:
        members = np.stack([np.roll(cells, (-a, -b), (0, 1)).ravel() for a, b in offsets])
        members = members[:, (members >= 0).all(axis=0)]
        for row, factor in zip(members, factors, strict=True):
            for column, other in zip(members, factors, strict=True):
                np.add.at(energy, (row, column), factor * other)
    return energy


def _along(first_run: np.ndarray, levels: int) -> np.ndarray:
    """Smoothness of the hysterons of the first run, by second differences of neighbours."""
    differences = np.diff(np.eye(levels), n=2, axis=0)
    stencil = np.kron(np.eye(len(first_run) // levels), differences)
    whole = ~(stencil[:, ~first_run] != 0).any(axis=1)
    stencil = stencil[np.ix_(whole, first_run)]
    return stencil.T @ stencil


@dataclass(frozen=True)
class NormalEquations:
    """Gram matrix, moments and power of a regression, kept apart for each fold of rows.

    Attributes:
        gram: (fold, column, column).
        moment: (fold, column).
        power: (fold,) sum of squares of the target.
        count: (fold,) rows.
        scale: (column,) by which a solution is divided to belong to the unscaled columns.
        nonnegative: (column,) whether the coefficient must not be negative.
        prior: (column, column) smoothness of the density, for strength 1 and one row.
        memory: (column, column) pull of the unknown initial memory, for one row.
    """

    gram: np.ndarray
    moment: np.ndarray
    power: np.ndarray
    count: np.ndarray
    scale: np.ndarray
    nonnegative: np.ndarray
    prior: np.ndarray
    memory: np.ndarray

    def system(self, folds: np.ndarray, strength: float) -> tuple[np.ndarray, np.ndarray]:
        """Regularised matrix and right-hand side over some folds."""
        gram = self.gram[folds].sum(axis=0)
        rows = self.count[folds].sum()
        gram = gram + rows * (strength * self.prior + MEMORY_STRENGTH * self.memory)
        gram[np.diag_indices_from(gram)] += RIDGE * np.diag(gram).max()
        return gram, self.moment[folds].sum(axis=0)

    def mean_square(self, solution: np.ndarray, folds: np.ndarray) -> float:
        """Mean squared residual of a (scaled) solution over some folds."""
        gram, moment = self.gram[folds].sum(axis=0), self.moment[folds].sum(axis=0)
        squares = self.power[folds].sum() - 2 * moment @ solution + solution @ gram @ solution
        return max(float(squares / self.count[folds].sum()), 0.0)

    def penalty(self, solution: np.ndarray, strength: float) -> float:
        """Prior's share of the objective, for one row."""
        prior = strength * self.prior + MEMORY_STRENGTH * self.memory
        return float(solution @ prior @ solution)

    def extended(self, other: np.ndarray, own: np.ndarray, moment: np.ndarray) -> NormalEquations:
        """With more free columns, by their products with these, themselves and the target."""
        gram = np.concatenate(
            [
                np.concatenate([self.gram, other], axis=2),
                np.concatenate([other.transpose(0, 2, 1), own], axis=2),
            ],
            axis=1,
        )
        more = own.shape[1]

        def padded(square: np.ndarray) -> np.ndarray:
            return np.pad(square, (0, more))

        return NormalEquations(
            gram,
            np.concatenate([self.moment, moment], axis=1),
            self.power,
            self.count,
            np.concatenate([self.scale, np.ones(more)]),
            np.concatenate([self.nonnegative, np.zeros(more, dtype=bool)]),
            padded(self.prior),
            padded(self.memory),
        )


def slices_of(fold: np.ndarray) -> list[slice]:
    """The rows of each fold, of rows that are in the order of their folds."""
    edges = np.searchsorted(fold, np.arange(int(fold.max()) + 2)).tolist()
    return [slice(*pair) for pair in itertools.pairwise(edges)]


def penalties(
    levels: int, groups: tuple[np.ndarray, ...], first_run: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """What is asked of the columns of a hysteresis apart from the data, for one row.

    Smoothness of the density, for strength 1, and pull of the unknown initial memory, (column,
    column) each. `first_run` are the hysterons of the first run, (2 levels,), for which the last
    groups, which are empty, stand; of several runs one behind the other.
    """
    cells = levels * (levels + 1) // 2
    size = cells + len(groups)
    prior, memory = np.zeros((size, size)), np.zeros((size, size))
    prior[:cells, :cells] = smoothness(levels)
    if first_run is not None:
        begin = size - int(first_run.sum())
        prior[begin:, begin:] = _along(first_run, levels)
    for position, group in enumerate(groups):
        pulled = np.array([cells + position, *(group % cells)])
        pull = np.array([1.0, *[-0.5] * len(group)])
        memory[np.ix_(pulled, pulled)] += np.outer(pull, pull)
    return prior, memory


def normal_equations(
    matrix: np.ndarray,
    target: np.ndarray,
    fold: np.ndarray,
    nonnegative: np.ndarray,
    asked: tuple[np.ndarray, np.ndarray],
    loose: np.ndarray | None = None,
) -> NormalEquations:
    """Normal equations of a regression on the columns of a chain, fold by fold.

    The columns of the (row, column) matrix are hysteresis, offset and, scaled to unit size, added
    ones, of which those that are `loose` are drawn to zero. Folds ascend from 0.
    """
    columns, of_hysteresis = matrix.shape[1], len(asked[0])
    scale = np.ones(columns)
    behind = slice(of_hysteresis + 1, columns)
    size = np.sqrt(np.mean(matrix[:, behind] ** 2, axis=0))
    scale[behind] = np.where(size > 0, size, 1.0)
    folds = slices_of(fold)
    gram = np.zeros((len(folds), columns, columns))
    moment = np.zeros((len(folds), columns))
    power, count = np.zeros(len(folds)), np.zeros(len(folds))
    for k, rows in enumerate(folds):
        part, goal = matrix[rows], target[rows]
        gram[k] = squares(part)
        gram[k] /= scale[:, None]
        gram[k] /= scale
        moment[k] = part.T @ goal / scale
        power[k], count[k] = goal @ goal, len(goal)
    prior, memory = (np.pad(each, (0, columns - of_hysteresis)) for each in asked)
    if loose is not None:
        memory[loose, loose] = 1.0
    return NormalEquations(gram, moment, power, count, scale, nonnegative, prior, memory)


def squares(matrix: np.ndarray) -> np.ndarray:
    """Gram matrix of the columns of `(row, column)`, at half the work of a product."""
    if len(matrix) == 0:
        return np.zeros((matrix.shape[1],) * 2)
    # A matrix in the order of C is its own transpose in that of Fortran: nothing is copied.
    half = scipy.linalg.blas.dsyrk(1.0, np.ascontiguousarray(matrix).T, lower=True)
    return np.tril(half) + np.tril(half, -1).T


def solve_nonnegative(
    gram: np.ndarray,
    moment: np.ndarray,
    nonnegative: np.ndarray,
    passive: np.ndarray | None = None,
    iterations: int = 300,
) -> np.ndarray:
    r"""Minimise \(\tfrac12 w^\top G w - b^\top w\) with some coefficients non-negative.

    Block principal pivoting: Kim and Park, SIAM J. Sci. Comput. 33 (2011) 3261-3281.  A search
    solves hundreds of such problems near one another: `scipy.optimize.nnls` and `lsq_linear` take
    no guess of which coefficients are free of their bound, `passive`.
    """
    size = len(moment)
    passive = np.ones(size, dtype=bool) if passive is None else passive | ~nonnegative
    # Coefficients and their gradients of rounding size are on neither side of their bound.
    reach = np.abs(moment).max() or 1.0
    diagonal = np.diag(gram)
    patience, fewest = 3, size + 1
    few: _FewAtBound | None = None
    solution = np.zeros(size)
    for _ in range(iterations):
        bound = np.flatnonzero(~passive)
        if len(bound) < MANY_AT_BOUND * size:
            few = _FewAtBound(gram, moment) if few is None else few
            solution, gradient = few.solved(bound)
        else:
            inside = np.flatnonzero(passive)
            solution = np.zeros(size)
            factor = scipy.linalg.cho_factor(gram[np.ix_(inside, inside)], check_finite=False)
            solution[inside] = scipy.linalg.cho_solve(factor, moment[inside], check_finite=False)
            gradient = gram @ solution - moment
        wrong = nonnegative & np.where(
            passive, solution * diagonal < -1e-12 * reach, gradient < -1e-12 * reach
        )
        count = int(wrong.sum())
        if count == 0:
            break
        if count < fewest:
            fewest, patience = count, 3
        elif patience > 0:
            patience -= 1
        else:  # exchange one at a time: slow, and sure to end
            wrong[: np.flatnonzero(wrong)[-1]] = False
        passive = passive ^ wrong
    return np.where(nonnegative, np.maximum(solution, 0.0), solution)


class _FewAtBound:
    r"""The free minimum, and what a bound on each coefficient changes: \(G^{-1} e_k\)."""

    def __init__(self, gram: np.ndarray, moment: np.ndarray):
        self.factor = scipy.linalg.cho_factor(gram, check_finite=False)
        self.free: np.ndarray = scipy.linalg.cho_solve(self.factor, moment, check_finite=False)
        self.place = np.full(len(moment), -1)
        self.answers = np.zeros((len(moment), 0))

    def solved(self, bound: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The minimum with some coefficients at zero, and the gradient there."""
        new = bound[self.place[bound] < 0]
        self.place[new] = self.answers.shape[1] + np.arange(len(new))
        unit = np.zeros((len(self.free), len(new)), order="F")
        unit[new, np.arange(len(new))] = 1.0
        more = scipy.linalg.cho_solve(self.factor, unit, overwrite_b=True, check_finite=False)
        self.answers = np.concatenate([self.answers, more], axis=1)
        answers = self.answers[:, self.place[bound]]
        push: np.ndarray = np.linalg.solve(answers[bound], self.free[bound])
        solution: np.ndarray = self.free - answers @ push
        gradient = np.zeros(len(self.free))
        solution[bound], gradient[bound] = 0.0, -push
        return solution, gradient


def choose_strength(
    equations: NormalEquations,
    folds: np.ndarray,
    start: float,
    log_error: Callable[[np.ndarray, int], float] | None = None,
    guess: np.ndarray | None = None,
) -> float:
    """Strength of the smoothness prior with the least cross-validated error over some folds.

    Each fold is predicted from the others, and the geometric mean of their errors counts: a fold
    that holds what no other does, as the start of the record from an unknown memory, is predicted
    badly at any strength, and must not drown the rest.  The search goes downhill from a start, by
    a decade at a time, the stronger side first: weak priors are slow to solve for, and rarely the
    best. A `guess` is a solution near by, whose zeros are likely those of the result.
    """

    def log_mean_square(solution: np.ndarray, k: int) -> float:
        mean_square = equations.mean_square(solution, np.array([k]))
        return float(np.log(max(mean_square, np.finfo(float).tiny)))

    log_error = log_error or log_mean_square
    known = None if guess is None else guess > 0
    passive: dict[int, np.ndarray | None] = {int(k): known for k in folds}
    errors: dict[int, float] = {}

    def error(position: int) -> float:
        if position not in errors:
            total = 0.0
            for k in folds:
                gram, moment = equations.system(folds[folds != k], STRENGTHS[position])
                solution = solve_nonnegative(gram, moment, equations.nonnegative, passive[int(k)])
                passive[int(k)] = solution > 0
                total += log_error(solution, int(k)) / len(folds)
            errors[position] = np.exp(total)
        return errors[position]

    best = int(np.argmin(np.abs(np.log(np.asarray(STRENGTHS) / start))))
    for direction in (1, -1):
        moved = False
        while 0 <= best + direction < len(STRENGTHS):
            if not error(best + direction) < (1 - LEAST_IMPROVEMENT) * error(best):
                break
            best, moved = best + direction, True
        if moved:
            break
    return STRENGTHS[best]


@dataclass(frozen=True, eq=False)
class Basis:
    """Combinations of hysterons, and of what an unknown start and a first run leave open.

    Attributes:
        cells: (cells, vector) shares of the hysterons.
        memory: (cells, vector) shares of what their unknown starts leave open; of several runs
            one behind the other.
        first_run: (2 levels, vector) shares of the hysterons of the first run; likewise.
        asked: the `penalties` on the vectors.
    """

    cells: np.ndarray
    memory: np.ndarray
    first_run: np.ndarray
    asked: tuple[np.ndarray, np.ndarray]

    @property
    def size(self) -> int:
        """Number of vectors."""
        return self.cells.shape[1]

    def first(self, count: int) -> Basis:
        """The vectors that the record decides best."""
        prior, memory = (each[:count, :count] for each in self.asked)
        return Basis(
            self.cells[:, :count],
            self.memory[:, :count],
            self.first_run[:, :count],
            (prior, memory),
        )

    def applied_to(self, hysteresis: HysteresisColumns) -> HysteresisColumns:
        """The combinations along any path, whose groups may differ from those of the basis."""
        groups = [group for group in hysteresis.groups if len(group)]
        own = [self.memory[group].sum(axis=0, keepdims=True) for group in groups]
        vectors = np.concatenate([self.cells, *own, self.first_run[hysteresis.first_run]])
        return hysteresis.combined(vectors)


def reduced_basis(
    hysteresis: HysteresisColumns, equations: NormalEquations, folds: np.ndarray, held_out: int
) -> Basis:
    """The directions that a record decides, as many as the held-out error asks for."""
    cells, groups = hysteresis.cells, [group for group in hysteresis.groups if len(group)]
    columns = cells + len(hysteresis.groups)
    vectors = _sorted_directions(equations, columns, folds, min(SIZES[-1], columns))
    sizes = [size for size in SIZES if size < vectors.shape[1]] + [vectors.shape[1]]
    most = _combined(equations, vectors)
    best, chosen = np.inf, sizes[-1]
    for size in reversed(sizes):
        small = _first_of(most, size, vectors.shape[1])
        error = min(_error(small, folds, held_out, strength) for strength in TRIED_STRENGTHS)
        best = min(best, error)
        if error > ENOUGH * best:
            break
        chosen = size
    vectors = vectors[:, :chosen]
    memory = np.zeros((len(hysteresis.start), chosen))
    for position, group in enumerate(groups):
        memory[group] = vectors[cells + position] / len(group)
    first_run = np.zeros((len(hysteresis.first_run), chosen))
    first_run[hysteresis.first_run] = vectors[cells + len(groups) :]
    asked = most.prior[:chosen, :chosen], most.memory[:chosen, :chosen]
    return Basis(vectors[:cells], memory, first_run, asked)


def _error(equations: NormalEquations, folds: np.ndarray, held_out: int, strength: float) -> float:
    """Mean square on the fold held out of what the others identify."""
    gram, moment = equations.system(folds, strength)
    solution = scipy.linalg.solve(gram, moment, assume_a="pos")
    return equations.mean_square(solution, np.array([held_out]))


def _sorted_directions(
    equations: NormalEquations, columns: int, folds: np.ndarray, count: int
) -> np.ndarray:
    """(column, count) directions of the greatest shares decided by the data, greatest first."""
    gram, rows = equations.gram[folds].sum(axis=0), equations.count[folds].sum()
    greatest, inner = np.diag(gram).max(), gram
    while len(inner) > columns:  # an offset takes up what it can of each column
        mean = inner[-1, :-1] / np.sqrt(inner[-1, -1])
        inner = inner[:-1, :-1] - np.outer(mean, mean)
    penalty = FIRST_STRENGTH * equations.prior + MEMORY_STRENGTH * equations.memory
    whole = inner + rows * penalty[:columns, :columns]
    whole[np.diag_indices_from(whole)] += RIDGE * greatest
    last = len(whole) - 1
    most = (last + 1 - count, last)
    found = scipy.linalg.eigh(inner, whole, subset_by_index=most, check_finite=False)[1]
    return found[:, ::-1]


def _first_of(equations: NormalEquations, size: int, most: int) -> NormalEquations:
    """The equations of the first of some vectors, and of the offsets behind them."""
    kept = np.append(np.arange(size), np.arange(most, len(equations.scale)))
    square = np.ix_(kept, kept)
    return NormalEquations(
        np.stack([gram[square] for gram in equations.gram]),
        equations.moment[:, kept],
        equations.power,
        equations.count,
        equations.scale[kept],
        equations.nonnegative[kept],
        equations.prior[square],
        equations.memory[square],
    )


def _combined(equations: NormalEquations, vectors: np.ndarray) -> NormalEquations:
    """The equations of combinations of all columns but the last, which are the offsets."""
    columns, size = len(vectors), int(vectors.shape[1])
    behind = len(equations.scale) - columns
    wide = np.zeros((columns + behind, size + behind))
    wide[:columns, :size], wide[columns:, size:] = vectors, np.eye(behind)
    return NormalEquations(
        np.stack([wide.T @ gram @ wide for gram in equations.gram]),
        equations.moment @ wide,
        equations.power,
        equations.count,
        np.ones(size + behind),
        np.zeros(size + behind, dtype=bool),
        wide.T @ equations.prior @ wide,
        wide.T @ equations.memory @ wide,
    )

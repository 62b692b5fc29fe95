r"""A reduced basis: the combinations of hysterons that a record decides.

Most combinations of hysterons are never told apart by a record, and follow the smoothness prior
instead. The generalised eigenvectors of the Gram matrix G of the regressors and of G + P, with the
penalty P of the prior, sort them by the share of a direction that the data decide (the directions
of a smoothing spline: G. Wahba, Spline Models for Observational Data, SIAM 1990). Some hundred of
them predict rows that were held out as well as a thousand hysterons do, so that effects can be
searched for in their span.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from preisach_jax.chain import HysteresisColumns
from preisach_jax.identify.regression import MEMORY_STRENGTH, RIDGE, NormalEquations

SIZES = (64, 128, 192, 256)
"""Numbers of vectors that are tried: few, so that few shapes are compiled."""

ENOUGH = 1.02
"""Held-out mean square, over that with the most vectors, with which fewer will do."""

FIRST_STRENGTH = 1e-4
"""Strength of the smoothness prior from which the search for the best one starts."""

TRIED_STRENGTHS = (1e-2, 1e-3, 1e-4, 1e-5)
"""Strengths of the prior among which the best one judges how many vectors are enough."""


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

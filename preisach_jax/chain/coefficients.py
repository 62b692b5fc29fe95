"""The linear numbers of a model, and the columns that they multiply."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from preisach_jax.operator.plane import Plane


@dataclass(frozen=True)
class Columns:
    """The regressors of a chain at given parameters: what its linear coefficients multiply.

    Attributes:
        matrix: (time, column), in the order cells, initial memory, offset, added effects.
        cells: how many columns belong to the cells of the plane.
        groups: for each column of the initial memory, the cells whose unknown start it carries;
            none for those of the first run.  Of several runs, cells count on from run to run.
        start: (cells,) stated initial memory, see `stated_start`; zero where it is unknown; of
            several runs one behind the other.
        first_run: (2 levels,) bool: which of the hysterons that switch in the first run only the
            last groups are, see `first_run_output`; of several runs one behind the other.
        added: names of the effects of the last columns, one each: added effects, free responses of
            output effects, and effects of the sensor.
        loose: (column,) whether it is there only for a past that is not known.
        polarity: sign of the weights, which the columns of the hysteresis carry.
        signed: whether the weights may have both signs.
        vectors: (hysteresis column, vector) combinations of the columns of the hysteresis, which
            stand in the matrix in their place; None where they stand there themselves.
        own: run and place of the columns just behind the offset, which are those of one run: place
            zero for what its offset differs by from the last run's, else from one on that of the
            coefficient.
    """

    matrix: np.ndarray
    cells: int
    groups: tuple[np.ndarray, ...]
    start: np.ndarray
    first_run: np.ndarray
    added: tuple[str, ...]
    loose: np.ndarray
    polarity: int = 1
    signed: bool = False
    vectors: np.ndarray | None = None
    own: tuple[tuple[int, int], ...] = ()

    @property
    def nonnegative(self) -> np.ndarray:
        """(column,) whether the coefficient must not be negative: weights and initial memory."""
        kinds = np.zeros(self.matrix.shape[1], dtype=bool)
        kinds[: self.offset] = self.vectors is None and not self.signed
        return kinds

    @property
    def offset(self) -> int:
        """Index of the constant column."""
        whole = self.cells + len(self.groups)
        return whole if self.vectors is None else self.vectors.shape[1]

    @property
    def first_added(self) -> int:
        """Index of the column of the first of the chain's coefficients."""
        return self.offset + 1 + len(self.own)

    def of_effect(self, effect: str) -> list[int]:
        """Indices of the columns of an effect, in all runs."""
        names, edge = self.added, self.offset + 1
        alone = [k for k, (_, place) in enumerate(self.own) if place and names[place - 1] == effect]
        common = [k for k, name in enumerate(names) if name == effect]
        return [*(edge + k for k in alone), *(self.first_added + k for k in common)]


def coarsened(plane: Plane, coefficients: Coefficients, levels: int) -> Coefficients:
    """The same density on a coarser plane over the same range.

    Each coarse cell gets the shares of the fine cells that lie in it.
    """
    fine, coarse = np.arange(plane.levels + 1) / plane.levels, np.arange(levels + 1) / levels
    low = np.maximum(coarse[:-1, None], fine[None, :-1])
    high = np.minimum(coarse[1:, None], fine[None, 1:])
    shares = np.maximum(high - low, 0.0) * plane.levels
    rows, columns = np.tril_indices(plane.levels)

    def of_cells(values: np.ndarray) -> np.ndarray:
        laid_out = np.zeros((plane.levels, plane.levels))
        laid_out[rows, columns] = values
        square = shares @ laid_out @ shares.T
        # Of a fine cell on the diagonal some falls on the wrong side of that of the coarse plane.
        square = np.tril(square) + np.triu(square, 1).T
        return square[np.tril_indices(levels)]

    both = coefficients.first_run
    parts = np.split(both, len(both) // plane.levels) if len(both) else ()
    memories = np.split(coefficients.memory, len(coefficients.memory) // plane.cells)
    return replace(
        coefficients,
        weights=of_cells(coefficients.weights),
        memory=np.concatenate([of_cells(memory) for memory in memories]),
        first_run=np.concatenate([shares @ part for part in parts]) if parts else np.zeros(0),
    )


@dataclass(frozen=True)
class Coefficients:
    """The linear numbers of a model.

    Attributes:
        weights: (cells,) weights R, in output units; of one sign, that of the chain's polarity,
            unless the chain is signed.
        memory: (cells,) output that each hysteron's unknown start adds until the input forces it.
        offset: output with all hysterons off, but those of the first run as it leaves them.
        added: (column,) coefficients of the added effects, of free responses, and of the sensor.
        first_run: (2 levels,) weights of the hysterons that switch in the first run only, see
            `first_run_output`; empty if there are none.
        own: (run, 1 + column) offset and coefficients of the runs before the last one, whose
            `offset` and `added` are those above; empty for a single run.

    Of several runs, memory and first run stand one behind the other (see `runs`).
    """

    weights: np.ndarray
    memory: np.ndarray
    offset: float
    added: np.ndarray
    first_run: np.ndarray = field(default_factory=lambda: np.zeros(0))
    own: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))

    @staticmethod
    def from_columns(columns: Columns, solution: np.ndarray) -> Coefficients:
        """Sort a solution vector over the columns into its parts."""
        if columns.vectors is not None:
            behind = columns.vectors.shape[1]
            solution = np.concatenate([columns.vectors @ solution[:behind], solution[behind:]])
            columns = replace(columns, vectors=None)
        sign, weights = columns.polarity, solution[: columns.cells]
        memory = np.tile(weights, len(columns.start) // columns.cells) * columns.start
        for group, total in zip(columns.groups, solution[columns.cells :], strict=False):
            # The column fixes only the sum over the group: each cell gets its share by weight.
            each = weights[group % columns.cells]
            share = np.maximum(each, 0) + 1e-12 * (1 + np.abs(weights).max())
            if len(group):
                memory[group] = total * share / share.sum()
        first_run = np.zeros(len(columns.first_run))
        count = columns.first_run.sum()
        first_run[columns.first_run] = solution[columns.offset - count : columns.offset]
        offset, added = float(solution[columns.offset]), solution[columns.first_added :]
        runs = 1 + max((run for run, _ in columns.own), default=-1)
        own = np.tile(np.concatenate([[offset], added]), (runs, 1))
        for value, place in zip(solution[columns.offset + 1 :], columns.own, strict=False):
            own[place] = value + (offset if place[1] == 0 else 0.0)
        return Coefficients(sign * weights, sign * memory, offset, added, sign * first_run, own)

    def raised(self, level: float) -> Coefficients:
        """The same with all offsets greater by a level."""
        own = self.own.copy()
        own[:, :1] += level
        return replace(self, offset=self.offset + level, own=own)

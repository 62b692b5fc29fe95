"""A chain at given nonlinear parameters, with its best linear coefficients."""

from __future__ import annotations

from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np

from preisach_jax.chain import Chain, Coefficients, Columns, sensed
from preisach_jax.effects.base import Effect, Parameter, SensorEffect
from preisach_jax.identify.blocks import VALIDATION
from preisach_jax.identify.regression import NormalEquations

GRID_ORDER = 1.0
"""Power of the cell with which the error of a fitted plane falls: of smooth densities it is 1 to
2."""


@dataclass(frozen=True, eq=False)
class Point:
    """A chain at given nonlinear parameters, with its best linear coefficients.

    Attributes:
        chain: what is in the model.
        values: nonlinear parameters by effect and name.
        strength: strength of the smoothness prior.
        folds: folds of rows that identify.
        unit: output range, in output units.
        level: mean output, in output units.
        target: (row,) measured output from its mean, in output ranges.
        matrix: (row, column) scaled regressors of the measured rows.
        columns: what the columns are.
        equations: normal equations, in output ranges.
        solution: (column,) scaled coefficients from those folds.
        objective: mean square plus penalty on those folds.
        known_mean_square: that on the held-out blocks of a point without regressors; else None.
    """

    chain: Chain
    values: dict[str, dict[str, float]]
    strength: float
    folds: np.ndarray
    unit: float
    level: float
    target: np.ndarray
    matrix: np.ndarray
    columns: Columns
    equations: NormalEquations
    solution: np.ndarray
    objective: float
    known_mean_square: float | None = None

    @property
    def residual(self) -> np.ndarray:
        """(row,) residual over all measured rows, in output ranges.

        What the sensor makes of the output is predicted as it would be without the measurement.
        """
        if not self.chain.at(SensorEffect):
            return self.target - self.matrix @ self.solution
        rest = self.matrix.shape[1] - self.chain.sensor_coefficients
        signal = self.matrix[:, :rest] @ self.solution[:rest] * self.unit + self.level
        reading = sensed(self.chain, self.values, jnp.asarray(signal), self.coefficients())
        return self.target - (np.asarray(reading) - self.level) / self.unit

    @property
    def validation_mean_square(self) -> float:
        """Mean square on the held-out blocks, in squared output ranges."""
        if self.known_mean_square is not None:
            return self.known_mean_square
        if self.chain.at(SensorEffect):  # what the sensor does is in no normal equations
            held_out = int(self.equations.count[VALIDATION].sum())
            return float(np.mean(self.residual[-held_out:] ** 2))
        return self.equations.mean_square(self.solution, VALIDATION)

    @property
    def parameters(self) -> list[tuple[str, Parameter]]:
        """All nonlinear parameters with the effects they belong to."""
        return parameters_of(self.chain.effects)

    def share_of(self, effect: str) -> np.ndarray:
        """(row,) what an effect's own columns give, in output ranges: those that it adds, or those
        of what the past before the record left in it."""
        own = self.columns.of_effect(effect)
        return self.matrix[:, own] @ self.solution[own]

    @property
    def slim(self) -> Point:
        """The same point without its regressors and products: what a larger model starts from."""
        matrix = np.zeros((0, self.matrix.shape[1]))
        columns = replace(self.columns, matrix=matrix)
        none = np.zeros((0, 0, 0))
        equations = replace(
            self.equations, gram=none, prior=np.zeros((0, 0)), memory=np.zeros((0, 0))
        )
        return replace(
            self,
            matrix=matrix,
            columns=columns,
            equations=equations,
            known_mean_square=self.validation_mean_square,
        )

    def coefficients(self, solution: np.ndarray | None = None) -> Coefficients:
        """The linear numbers of the model in output units."""
        solution = self.solution if solution is None else solution
        found = Coefficients.from_columns(self.columns, self.unit * solution / self.equations.scale)
        return found.raised(self.level)


def parameters_of(effects: tuple[Effect, ...]) -> list[tuple[str, Parameter]]:
    """All nonlinear parameters of some effects, with the effects' names."""
    return [(effect.name, parameter) for effect in effects for parameter in effect.parameters()]


def share_off(point: Point, other: Point, order: float = GRID_ORDER) -> float:
    r"""Share of the grid's error that another plane takes off, \(1 - (N / N')^p\)."""
    return 1 - (point.chain.plane.levels / other.chain.plane.levels) ** order

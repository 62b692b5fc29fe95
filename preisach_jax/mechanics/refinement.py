"""Least squares of a simulated output, by Levenberg-Marquardt steps."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Array

MOST_STEPS = 40
ENOUGH = 1e-5
"""Relative fall of the mean square of two steps below which the search ends."""

MOST_DAMPING = 1e6


class Refined(NamedTuple):
    """Where a search has come to.

    Attributes:
        values: (parameter,) the best values.
        residual: (time,) what they leave.
        tangents: (time, parameter) derivatives of the output there.
        mean_square: mean square of the rows that count, with the penalty.
    """

    values: np.ndarray
    residual: np.ndarray
    tangents: np.ndarray
    mean_square: float


def refined(
    run: Callable[[np.ndarray], Array],
    derivative: Callable[[np.ndarray], Array],
    values: np.ndarray,
    goal: np.ndarray,
    counts: np.ndarray,
    bounds: tuple[np.ndarray, np.ndarray],
    penalty: np.ndarray | None = None,
    most_steps: int = MOST_STEPS,
) -> Refined:
    """The parameters whose output comes closest to a goal.

    K. Levenberg, Q. Appl. Math. 2 (1944) 164-168; D. W. Marquardt, J. SIAM 11 (1963) 431-441: the
    damping is that of the scaled parameters.  A step that lets the output diverge is shortened.

    Arguments:
        run: the simulation, from (parameter,) values to (time,) output.
        derivative: its derivatives, (time, parameter).
        values: (parameter,) where to start.
        goal: (time,) the measured output.
        counts: (time,) bool, rows that are compared.
        bounds: lowest and highest values, (parameter,) each.
        penalty: (row, parameter) rows that should be zero times the values; by default none.
    """
    rows = np.zeros((0, len(values))) if penalty is None else penalty
    weight = 1 / np.sqrt(counts.sum())

    def left(values: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        residual = goal - np.asarray(run(values))
        stacked = np.concatenate([residual[counts] * weight, -rows @ values])
        square = float(stacked @ stacked)
        return residual, stacked, square if np.isfinite(square) else np.inf

    residual, stacked, square = left(values)
    tangents = np.asarray(derivative(values))
    damping, small = 1e-2, 0
    for _ in range(most_steps):
        matrix = np.concatenate([tangents[counts] * weight, rows])
        scale = np.maximum(np.linalg.norm(matrix, axis=0), np.finfo(float).tiny)
        scaled = matrix / scale
        gram, slope = scaled.T @ scaled, scaled.T @ stacked
        while damping < MOST_DAMPING:
            damped: Any = gram + damping * np.eye(len(values))
            step = np.asarray(np.linalg.solve(damped, slope), dtype=float)
            trial = np.clip(values + step / scale, *bounds)
            found = left(trial)
            if found[2] < square:
                break
            damping *= 4
        else:
            break
        small = small + 1 if found[2] > (1 - ENOUGH) * square else 0
        values, (residual, stacked, square) = trial, found
        damping = max(damping / 10, 1e-9)
        tangents = np.asarray(derivative(values))
        if small == 2:
            break
    return Refined(values, residual, tangents, square)

"""The linear coefficients of a chain at given nonlinear parameters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from preisach_jax.chain import Chain
from preisach_jax.chain.runs import regressors
from preisach_jax.errors import NotFiniteError
from preisach_jax.identify.blocks import ALL, IDENTIFICATION
from preisach_jax.identify.point import Point
from preisach_jax.identify.problem import Problem, equations_of
from preisach_jax.identify.regression import choose_strength, slices_of, solve_nonnegative


def evaluate(
    problem: Problem,
    chain: Chain,
    values: dict[str, dict[str, float]],
    strength: float,
    like: Point | None = None,
    folds: np.ndarray = IDENTIFICATION,
) -> Point:
    """Solve for the linear coefficients at given nonlinear parameters."""
    hysteresis = problem.hysteresis(chain, values, like)
    columns = regressors(chain, values, problem.signals, hysteresis, problem.rows, problem.target)
    del hysteresis
    matrix = columns.matrix
    if not np.isfinite(matrix).all():
        raise NotFiniteError(
            f"the model gives values that are not finite at {values}; narrow the effect's bounds"
        )
    basis = problem.basis(chain) if problem.reduces_on(chain.plane) else None
    equations = equations_of(problem, columns, basis)
    matrix[:, columns.offset + 1 :] /= equations.scale[columns.offset + 1 :]
    guess = np.empty(0) if like is None else like.solution
    if like is not None and like.columns.vectors is not None and columns.vectors is None:
        guess = like.columns.vectors @ guess[: like.columns.offset]
        guess = np.concatenate([guess, like.solution[like.columns.offset :]])
    bare = Point(
        chain, values, strength, folds, problem.unit, problem.level, problem.goal, matrix, columns,
        equations, guess, 0.0,
    )  # fmt: skip
    return solved(bare)


def solved(point: Point) -> Point:
    """The point with its linear coefficients and its objective computed."""
    equations, folds, strength = point.equations, point.folds, point.strength
    gram, moment = equations.system(folds, strength)
    guess = point.solution
    passive = guess > 0 if len(guess) == len(moment) else None
    solution = solve_nonnegative(gram, moment, equations.nonnegative, passive)
    objective = equations.mean_square(solution, folds) + equations.penalty(solution, strength)
    return replace(point, solution=solution, objective=objective)


def with_strength(problem: Problem, point: Point) -> Point:
    """The same point with the strength of the prior that its own data choose.

    Without signs, what a fold holds that no other tells of is predicted so badly that it would
    choose alone; so its blocks count one by one there.
    """
    signs = bool(point.columns.nonnegative.any())
    by_block = None if signs else _log_error_by_block(problem, point)
    equations, now = point.equations, point.strength
    strength = choose_strength(equations, IDENTIFICATION, now, by_block, point.solution)
    return solved(replace(point, strength=strength))


def _log_error_by_block(problem: Problem, point: Point) -> Callable[[np.ndarray, int], float]:
    slices = slices_of(problem.fold)

    def log_error(solution: np.ndarray, k: int) -> float:
        rows = slices[k]
        left = point.target[rows] - point.matrix[rows] @ solution
        block = problem.block[rows]
        powers = np.bincount(block, left**2)[np.unique(block)]
        return float(np.mean(np.log(np.maximum(powers, np.finfo(float).tiny))))

    return log_error


def with_all_rows(point: Point, folds: np.ndarray = ALL) -> Point:
    """The same point with its linear coefficients identified on all measured rows."""
    return solved(replace(point, folds=folds))

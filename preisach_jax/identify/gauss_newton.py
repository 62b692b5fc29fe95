"""The nonlinear parameters, by Gauss-Newton steps jointly with the linear ones."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np

from preisach_jax.chain.runs import response, tangents
from preisach_jax.effects.base import Effect, Parameter
from preisach_jax.errors import NotFiniteError
from preisach_jax.identify.problem import Point, Problem, evaluate
from preisach_jax.identify.regression import NormalEquations, slices_of, solve_nonnegative


@dataclass(frozen=True, eq=False)
class Linearised:
    """A point with further columns: the tangents of its nonlinear parameters.

    Attributes:
        tangents: (row, parameter) derivatives with respect to the search coordinates, scaled.
        scale: (parameter,) by which they were divided.
        equations: normal equations with the tangents behind all other columns.
    """

    tangents: np.ndarray
    scale: np.ndarray
    equations: NormalEquations

    def objective(self, solution: np.ndarray, point: Point) -> float:
        """Mean square plus penalty that coefficients of all columns promise."""
        promised = self.equations.mean_square(solution, point.folds)
        return promised + self.equations.penalty(solution, point.strength)


def linearise(
    problem: Problem, point: Point, parameters: list[tuple[str, Parameter]]
) -> Linearised:
    """Append the tangents of some parameters to the regression of a point."""
    names = [(effect, parameter.name) for effect, parameter in parameters]
    coefficients = point.coefficients()
    raw = tangents(point.chain, point.values, problem.signals, coefficients, names)
    raw = raw[problem.rows] / problem.unit
    for column, (effect, parameter) in enumerate(parameters):
        if parameter.log:
            raw[:, column] *= point.values[effect][parameter.name]
    if not np.isfinite(raw).all():
        raise NotFiniteError(
            f"the derivatives are not finite at {point.values}; narrow the bounds of the effect"
        )
    scale = np.maximum(np.sqrt(np.mean(raw**2, axis=0)), 1e-12)
    raw = raw / scale
    target = problem.goal
    other: list[np.ndarray] = []
    own: list[np.ndarray] = []
    moment: list[np.ndarray] = []
    for rows in slices_of(problem.fold):
        other.append(point.matrix[rows].T @ raw[rows])
        own.append(raw[rows].T @ raw[rows])
        moment.append(raw[rows].T @ target[rows])
    equations = point.equations.extended(np.stack(other), np.stack(own), np.stack(moment))
    # Parameters with a natural zero, such as a gain, are solved for as non-negative amounts: the
    # target is moved so that the column multiplies the amount itself and not its change.
    amounts = np.array([parameter.is_amount for _, parameter in parameters])
    if amounts.any():
        now = np.array([point.values[e][p.name] for e, p in parameters]) * scale * amounts
        size = len(point.solution)
        equations = replace(
            equations,
            moment=equations.moment + equations.gram[:, :, size:] @ now,
            power=equations.power
            + 2 * equations.moment[:, size:] @ now
            + np.einsum("i,kij,j->k", now, equations.gram[:, size:, size:], now),
            nonnegative=np.concatenate([point.equations.nonnegative, amounts]),
        )
    return Linearised(raw, scale, equations)


def _joint_step(
    point: Point, parameters: list[tuple[str, Parameter]], linear: Linearised
) -> tuple[np.ndarray, np.ndarray]:
    """Gauss-Newton step in search coordinates, and the coefficients of all columns after it."""
    gram, moment = linear.equations.system(point.folds, point.strength)
    guess = np.concatenate([point.solution > 0, np.ones(len(parameters), dtype=bool)])
    solution = solve_nonnegative(gram, moment, linear.equations.nonnegative, guess)
    step = solution[len(point.solution) :] / linear.scale
    for position, (effect, parameter) in enumerate(parameters):
        if parameter.is_amount:
            step[position] -= point.values[effect][parameter.name]
    return step, solution


def _moved(
    values: dict[str, dict[str, float]], parameters: list[tuple[str, Parameter]], step: np.ndarray
) -> dict[str, dict[str, float]]:
    """Values after a step in search coordinates, inside their bounds."""
    moved = {effect: dict(of_effect) for effect, of_effect in values.items()}
    for (effect, parameter), wish in zip(parameters, step, strict=True):
        # A factor of three at once is as far as a linearisation of a time can be trusted.
        change = float(np.clip(wish, -1.1, 1.1)) if parameter.log else float(wish)
        coordinate = parameter.to_search(values[effect][parameter.name]) + change
        moved[effect][parameter.name] = parameter.from_search(coordinate)
    return moved


def refine(problem: Problem, point: Point, iterations: int = 8, tolerance: float = 1e-4) -> Point:
    """Gauss-Newton on all nonlinear parameters, linear coefficients solved at every trial."""
    parameters = point.parameters
    if not parameters:
        return point
    for _ in range(iterations):
        linear = linearise(problem, point, parameters)
        step, solution = _joint_step(point, parameters, linear)
        before = point.objective
        if linear.objective(solution, point) > before * (1 - tolerance):
            break
        for shrink in (1.0, 0.4, 0.1):
            values = _moved(point.values, parameters, shrink * step)
            trial = evaluate(problem, point.chain, values, point.strength, point, point.folds)
            if trial.objective < before:
                point = trial
                break
        if point.objective > before * (1 - tolerance):
            break
    return point


def stepped(problem: Problem, point: Point, most: float = np.inf) -> Point:
    """A point after one small Gauss-Newton step, whose regressors are not computed again."""
    parameters = point.parameters
    if not parameters:
        return point
    linear = linearise(problem, point, parameters)
    step, solution = _joint_step(point, parameters, linear)
    if linear.objective(solution, point) < (1 - most) * point.objective:
        return point
    values = _moved(point.values, parameters, step)
    moved = replace(point, values=values, solution=solution[: len(point.solution)])
    return moved if _simulated(problem, moved) <= _simulated(problem, point) else point


def _simulated(problem: Problem, point: Point) -> float:
    """Objective of a point by the output that its model simulates."""
    output = response(point.chain, point.values, problem.signals, point.coefficients())
    error = (problem.target - np.asarray(output)[problem.rows]) / problem.unit
    inside = np.isin(problem.fold, point.folds)
    penalty = point.equations.penalty(point.solution, point.strength)
    return float(np.mean(error[inside] ** 2)) + penalty


def starts_of(effect: Effect) -> list[dict[str, float]]:
    """All combinations of the values from which the search for an effect starts."""
    parameters = effect.parameters()
    grids = itertools.product(*(parameter.start for parameter in parameters))
    names = [parameter.name for parameter in parameters]
    return [dict(zip(names, values, strict=True)) for values in grids]

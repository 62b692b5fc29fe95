"""The error budget: noise, converters, the grid of the plane, memory that is seldom visited."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from preisach_jax.chain.runs import response, signals_of
from preisach_jax.diagnosis.noise import (
    MOST_COLOURED,
    noise_rms,
    output_quantisation_rms,
    unpredictable_rms,
)
from preisach_jax.diagnosis.remainder import related_share
from preisach_jax.diagnosis.result import NOTABLE, Budget
from preisach_jax.effects.output_quantisation import lattice_step
from preisach_jax.fit import REFINEMENT, Fit, with_regressors
from preisach_jax.identify import VALIDATION, Point, Problem, with_all_rows
from preisach_jax.identify.problem import GRID_ORDER, grid_error_share
from preisach_jax.record.jumps import wander_rms

MOST_LEVELS = 50
"""Finest plane that is tried automatically."""

MOST_WORK = 3e10
"""Rows times squared cells beyond which a plane is not tried automatically."""

MOST_OVER_WITHIN = 6.0
"""Times the RMS that comes back within cells that the error of the grid may be: of smooth densities
it is some 3 to 6, of relays 1."""

OF_RELAYS = 1.5
"""Times the RMS that comes back within cells up to which the error of the grid, as another plane
tells it, is that of a density of single relays."""

ORDER_OF_RELAYS = 0.5
"""`GRID_ORDER` of some dozens of relays."""

PATH_OVER_LINE = 2.5**0.5
"""RMS of a Brownian path, as jumps in a cell make it, between its ends or around its mean (1/6 of
its variance), over that around a straight line of its own (1/15)."""


@dataclass(frozen=True)
class Floor:
    """What no other effect can take away from the error of a fit, as RMS in output units.

    Attributes:
        noise: see `noise_rms`.
        memory: see `memory_rms`.
    """

    noise: float
    memory: float

    @staticmethod
    def of(problem: Problem, fit: Fit) -> Floor:
        """The floor of a fit."""
        point = with_regressors(problem, fit)
        return Floor(noise_rms(problem, point), memory_rms(problem, point))


def error_budget(problem: Problem, fit: Fit, floor: Floor, grid: tuple[float, float]) -> Budget:
    """What the held-out error of a fit is made of.

    Arguments:
        grid: RMS of what the grid of the plane adds (`discretisation_rms`, `by_another_plane`).
    """
    parts = (floor.noise, grid[0], floor.memory, wander_rms(problem.record))
    noise, discretisation, memory, jumps, unexplained = _shares(fit.rms_validation, *parts)
    budget = Budget(
        noise=noise,
        input_quantisation=input_quantisation_rms(problem, fit.point),
        output_quantisation=output_quantisation_rms(problem),
        discretisation=discretisation,
        memory=memory,
        unexplained=unexplained,
        unit=problem.record.channels["output"].unit,
        jumps=jumps,
    )
    return _with_noise_of_any_colour(budget, fit, grid[1])


def budget_of_residual(fit: Fit) -> Budget:
    """What the held-out error of a fit without a grid is made of: noise, and the rest."""
    measured = fit.record.measured
    steps = lattice_step(fit.record.output[measured]) / float(np.sqrt(12))
    white = max(unpredictable_rms(fit.residual[measured]), steps)
    noise, rest = _shares(fit.rms_validation, white)
    unit = fit.record.channels["output"].unit
    return _with_noise_of_any_colour(Budget(noise, 0.0, steps, 0.0, 0.0, rest, unit), fit, 0.0)


def _with_noise_of_any_colour(budget: Budget, fit: Fit, grid: float) -> Budget:
    """The same if it is met; else with what goes with nothing (`related_share`) as noise.

    Second differences show the white part of noise alone.  Where nothing goes with the remainder,
    no physics can pass for the grid either, and all that another plane tells is its own; and by
    what the error on the rows held out is greater than on all rows, these would have told.

    Arguments:
        grid: RMS of what the grid of the plane adds, `by_another_plane`.
    """
    left = float(np.sqrt(np.nanmean(fit.residual[fit.record.measured] ** 2)))
    if budget.is_met or left > MOST_COLOURED * budget.noise:
        return budget
    if related_share(fit.record, fit.residual) > NOTABLE:
        return budget
    whole, grid = fit.rms_validation, max(grid, budget.discretisation)
    noise = max(budget.noise, float(np.sqrt(max(left**2 - grid**2, 0.0))))
    noise, grid, memory, jumps, rest = _shares(whole, noise, grid, whole, budget.jumps)
    return replace(
        budget, noise=noise, discretisation=grid, memory=memory, jumps=jumps, unexplained=rest
    )


def _shares(whole: float, *parts: float) -> list[float]:
    """RMS of each part, at most of what those before it leave of the whole, and of the rest."""
    left, shares = whole**2, list[float]()
    for rms in parts:
        share = min(rms**2, left)
        shares.append(float(np.sqrt(share)))
        left -= share
    return [*shares, float(np.sqrt(left))]


def input_quantisation_rms(problem: Problem, point: Point) -> float:
    """RMS of what the steps in which the input was recorded may do to the output.

    Of an input that was recorded in steps any value within half of one may have acted: this is
    the change of the model's output where one is drawn at each sample.  Steps that would change it
    by more than the whole error are those of the drive itself.

    Returns:
        The RMS in output units; zero where the input lies on no lattice.
    """
    step = lattice_step(problem.record.input)
    if step == 0:
        return 0.0
    record = problem.record
    rounding = step * np.random.default_rng(0).uniform(-0.5, 0.5, len(record.input))
    as_recorded, moved = (
        response(point.chain, point.values, signals_of(each), point.coefficients())
        for each in (record, replace(record, input=record.input + rounding))
    )
    rms = float(np.sqrt(np.mean(np.asarray(moved - as_recorded) ** 2)))
    whole = float(np.sqrt(point.validation_mean_square)) * problem.unit
    return rms if rms < whole else 0.0


def refined_levels(rows: int, levels: int) -> int | None:
    """The next finer plane that is worth its work on a record of so many rows, or None.

    Fewer rows than cells cannot tell what a finer plane is good for.
    """
    finer = min(round(levels * REFINEMENT), MOST_LEVELS)
    cells = finer * (finer + 1) / 2
    if finer <= levels or cells > rows or rows * cells**2 > MOST_WORK:
        return None
    return finer


def discretisation_rms(
    problem: Problem, point: Point, other: Point, within_cells: tuple[float, float] | None
) -> float:
    """RMS of what the grid of the plane adds, by another plane and by what comes back in its cells.

    What another plane leaves more or less (`by_another_plane`) may be physics that the model lacks
    and that a finer plane fits, row by row.  An error of the grid comes back wherever the input
    passes a cell: it is no more than some times that (`MOST_OVER_WITHIN`).

    Where what comes back is most of what another plane tells, the density is one of single relays:
    the error falls with the root of the cell, and passes differ from the straight lines that are
    taken from each by more than what is left around these (`PATH_OVER_LINE`).

    Arguments:
        within_cells: RMS of what comes back within cells, and the most that it may be, in output
            units; None if too few passes tell.

    Returns:
        The RMS in output units.
    """
    by_plane = by_another_plane(problem, point, other)
    if within_cells is None:
        return by_plane
    within, most = within_cells
    if by_plane > OF_RELAYS * within:
        return min(by_plane, MOST_OVER_WITHIN * most)
    of_relays = by_another_plane(problem, point, other, ORDER_OF_RELAYS)
    return max(of_relays, PATH_OVER_LINE * within)


def by_another_plane(
    problem: Problem, point: Point, other: Point, order: float = GRID_ORDER
) -> float:
    """RMS of what the grid of the plane adds, from the change of the held-out error on another.

    A finer plane takes its share away, a coarser one adds its own.

    Returns:
        The RMS in output units.
    """
    here = point.validation_mean_square
    share = (here - other.validation_mean_square) / grid_error_share(point, other, 2 * order)
    return float(np.sqrt(np.clip(share, 0.0, here))) * problem.unit


def memory_rms(problem: Problem, point: Point) -> float:
    """RMS of what the rows held out would have told of the coefficients.

    Where they visit cells of the plane that the other rows seldom do, the prediction rests on the
    smoothness prior.  Identified with them, the same model leaves less there by this share.

    Returns:
        The RMS in output units.
    """
    held_out = problem.fold == VALIDATION[0]
    told = float(np.mean(with_all_rows(point).residual[held_out] ** 2))
    return float(np.sqrt(max(point.validation_mean_square - told, 0.0))) * problem.unit

"""The error budget: noise, converters, the cells of the plane, memory that is seldom visited."""

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
from preisach_jax.diagnosis.remainder import is_related
from preisach_jax.diagnosis.result import NOTABLE, Budget
from preisach_jax.fit import Fit
from preisach_jax.fit.fitted import with_regressors
from preisach_jax.fit.stepwise import REFINEMENT
from preisach_jax.identify.problem import (
    GRID_ORDER,
    VALIDATION,
    Point,
    Problem,
    grid_error_share,
    with_all_rows,
)
from preisach_jax.operator.plane import Plane, position_on
from preisach_jax.record.core import Record
from preisach_jax.record.course import last_move, lattice_step
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
        grid: RMS of what the grid of the plane adds, and of all that another plane tells.
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
    """The same if it is met; else with what goes with nothing (`is_related`) as noise.

    Second differences show the white part of noise alone.  Where nothing goes with the remainder,
    no physics can pass for the grid either, and all that another plane tells is its own; and by
    what the error on the rows held out is greater than on all rows, these would have told.

    Arguments:
        grid: RMS of what the grid of the plane adds, `by_another_plane`.
    """
    left = float(np.sqrt(np.nanmean(fit.residual[fit.record.measured] ** 2)))
    if budget.is_met or left > MOST_COLOURED * budget.noise:
        return budget
    if is_related(fit.record, fit.residual, NOTABLE):
        return budget
    grid = max(grid, budget.discretisation)
    noise = max(budget.noise, float(np.sqrt(max(left**2 - grid**2, 0.0))))
    noise, grid, memory = _shares(fit.rms_validation, noise, grid)
    return replace(
        budget, noise=noise, discretisation=grid, memory=memory, jumps=0.0, unexplained=0.0
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


def grid_rms(problem: Problem, fit: Fit, point: Point, other: Point) -> tuple[float, float]:
    """RMS of what the grid of the plane adds, and of all that another plane tells.

    Arguments:
        fit: the model fitted to all rows.
        point, other: the same model, with all hysterons, on its plane and on another one.
    """
    within = within_cells_rms(fit.record, fit.residual, point.chain.plane)
    estimate = discretisation_rms(problem, point, other, within)
    return estimate, by_another_plane(problem, point, other)


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


BINS = 8
"""Parts of a cell over which errors are averaged along a pass."""

LEAST_ROWS = 4
"""Rows of a pass below which it tells nothing."""

LEAST_TOLD = 0.2
"""Share of the passes that must have a pair for the estimate to count."""


def within_cells_rms(
    record: Record, residual: np.ndarray, plane: Plane
) -> tuple[float, float] | None:
    r"""RMS of the part of a residual that is finer than a cell and comes back pass after pass.

    Along one pass of the input through a cell of the plane, a model of even ramps can follow the
    output no further than by a straight line.  What is left around such a line, averaged over
    parts of the cell, is a profile \(p_b\).  Of two passes \(m, n\) of the same cell in the same
    direction, with the most similar inputs at the last reversal, the products have the mean
    \(\langle p_b^{(m)} p_b^{(n)} \rangle\): the mean square of what both share.  Noise, and
    physics that act at other times in each pass, share nothing.

    Arguments:
        residual: (time,) measured minus predicted output.

    Returns:
        The RMS in output units and the most that it may be, by two deviations of the mean over
        pairs; None where too few passes have enough rows, or none of a pair pass the same parts of
        a cell.
    """
    rows = np.flatnonzero(record.measured)
    values = record.input[rows]
    moved = np.diff(values, prepend=values[:1]) != 0
    rising = last_move(values) > 0
    place = position_on(plane, values)
    cell = np.clip(place.astype(int), 0, plane.levels - 1)
    turned = np.diff(rising, prepend=not rising[0])
    starts = np.searchsorted(rows, record.starts)
    turned[starts[starts < len(rows)]] = True  # behind some start nothing may be measured
    begins = turned | (np.diff(cell, prepend=-1) != 0)
    number = np.cumsum(begins) - 1
    counts, profiles = _profiles(number, moved, place, cell, residual[rows])
    first = np.flatnonzero(begins)
    last_turn = np.maximum.accumulate(np.where(turned, np.arange(len(rows)), 0))[first]
    one, two = _pairs(2 * cell[first] + rising[first], values[last_turn], counts)
    if len(one) < LEAST_TOLD * len(first):
        return None
    weights = np.minimum(counts[one], counts[two])
    if not weights.any():
        return None
    total = float(weights.sum())
    products = np.sum(weights * profiles[one] * profiles[two], axis=1)
    shared = float(products.sum()) / total
    deviation = float(np.linalg.norm(products - shared * weights.sum(axis=1))) / total
    return float(np.sqrt(max(shared, 0.0))), float(np.sqrt(max(shared + 2 * deviation, 0.0)))


def _profiles(
    number: np.ndarray, moved: np.ndarray, place: np.ndarray, cell: np.ndarray, error: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(pass, part) rows in each part of a cell, and the mean there around a straight line."""
    passes, weight = int(number[-1]) + 1, moved.astype(float)
    rows = np.maximum(np.bincount(number, weight, passes), 1.0)

    def centred(values: np.ndarray) -> np.ndarray:
        return values - (np.bincount(number, weight * values, passes) / rows)[number]

    x, y = centred(place), centred(error)
    power = np.bincount(number, weight * x * x, passes)
    slope = np.bincount(number, weight * x * y, passes) / np.where(power > 0, power, 1.0)
    part = BINS * number + np.clip((BINS * (place - cell)).astype(int), 0, BINS - 1)
    shape = (passes, BINS)
    counts = np.bincount(part, weight, passes * BINS).reshape(shape)
    sums = np.bincount(part, weight * (y - slope[number] * x), passes * BINS).reshape(shape)
    return counts, sums / np.maximum(counts, 1.0)


def _pairs(kind: np.ndarray, turn: np.ndarray, counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Passes of one cell and direction, each with that of the next input at its last reversal."""
    told = np.flatnonzero(counts.sum(axis=1) >= LEAST_ROWS)
    order = told[np.lexsort((turn[told], kind[told]))]
    same = kind[order[:-1]] == kind[order[1:]]
    return order[:-1][same], order[1:][same]

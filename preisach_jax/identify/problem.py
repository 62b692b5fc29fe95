"""A record that is identified, cut into blocks, and models of it at given nonlinear parameters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import jax.numpy as jnp
import numpy as np
import scipy

from preisach_jax.chain.coefficients import Coefficients, Columns
from preisach_jax.chain.description import Chain, EffectValues
from preisach_jax.chain.hysteresis import HysteresisColumns
from preisach_jax.chain.output import sensed
from preisach_jax.chain.runs import (
    combinations_along,
    hysteresis_columns,
    hysteresis_output,
    is_one_path,
    regressors,
    signals_of,
    thinned,
)
from preisach_jax.chain.signals import parts_of
from preisach_jax.effects import BUILT_IN
from preisach_jax.effects.base import (
    Effect,
    HysteresisEffect,
    InputEffect,
    Parameter,
    SensorEffect,
    Signals,
    Survey,
)
from preisach_jax.effects.lawful import require_law_of_place
from preisach_jax.errors import NotFiniteError
from preisach_jax.identify.regression import (
    Basis,
    NormalEquations,
    choose_strength,
    normal_equations,
    penalties,
    reduced_basis,
    slices_of,
    solve_nonnegative,
)
from preisach_jax.operator.plane import Plane
from preisach_jax.record.channels import SAMPLES
from preisach_jax.record.core import Record
from preisach_jax.record.joined import without_rows

BLOCKS = 96
"""Contiguous blocks of measured rows into which a record is cut."""

FOLDS = 4
"""One block of four is held out; the other three folds identify, and choose the prior.
Where whole runs are held out, their rows are the fourth fold."""

STEPS = (3, 3, 3, 5, 5, 5)
"""Blocks from one that is held out to the next.  Were they always four, a drive whose period is so
long, or a half or a quarter of that, would show the rows held out the same part of its course."""

LEAST_STRETCHES = 64
"""Stretches into which the input of a run is cut at least where a record is thinned."""

IDENTIFICATION = np.arange(FOLDS - 1)

VALIDATION = np.array([FOLDS - 1])

ALL = np.arange(FOLDS)

WHOLE_CELLS = 100
"""Cells up to which all hysterons are kept, with weights of one sign: they cost little more than a
reduced basis."""


ROUGH_ROWS = 3
"""One row of so many tells where to begin a search for parameters."""

ROUGH_VECTORS = 64
"""Vectors of a reduced basis that tell it."""

WORTH_THINNING = 0.75
"""Share of a record's samples from which on thinning it is not worth what it loses."""

MOST_KEPT = 10_000_000
"""States beyond which columns are computed anew instead of kept: that takes less than a second,
and keeping them takes hundreds of megabytes."""

GRID_ORDER = 1.0
"""Power of the cell with which the error of a fitted plane falls: of smooth densities it is 1 to
2."""


def rows_kept(record: Record, limit: int) -> np.ndarray:
    """Samples of a record to keep, about `limit`; each run gets its share of them."""
    kept: list[np.ndarray] = []
    for rows in record.stretches:
        count = rows.stop - rows.start
        own = max(round(limit * count / len(record)), LEAST_STRETCHES)
        kept.append(rows.start + thinned_rows(record.input[rows], min(own, count)))
    return np.concatenate(kept)


def blocks_of(record: Record, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(row,) block and fold of each of the measured rows of a record."""
    block, fold = np.zeros(len(rows), dtype=int), np.zeros(len(rows), dtype=int)
    by_blocks = not any(run.held_out for run in record.runs)
    first = 0
    for position, stretch in enumerate(record.stretches):
        inside = (rows >= stretch.start) & (rows < stretch.stop)
        own, count = rows[inside] - stretch.start, stretch.stop - stretch.start
        # A short record has fewer blocks, but all folds of them.
        most = FOLDS * max(1, round(BLOCKS / FOLDS * inside.sum() / len(rows)))
        blocks = min(most, FOLDS * (len(own) // (2 * FOLDS)))
        # Lost samples must not move what is held out, nor leave a block without rows.
        cut = own * blocks // count
        if blocks and np.bincount(cut, minlength=blocks).min() < 0.75 * len(own) / blocks:
            cut = np.arange(len(own)) * blocks // len(own)
        block[inside] = first + cut
        if by_blocks:
            fold[inside] = _folds(max(blocks, 1), held_out=True)[cut]
        elif record.runs[position].held_out:
            fold[inside] = FOLDS - 1
        else:
            fold[inside] = _folds(max(blocks, 1), held_out=False)[cut]
        first += max(blocks, 1)
    return block, fold


def _folds(blocks: int, held_out: bool) -> np.ndarray:
    """(block,) a fold of each block; the last one, if some are held out, every `STEPS` blocks."""
    fold = np.full(blocks, -1)
    if held_out:
        at = np.cumsum(np.resize(STEPS, blocks)) - 1
        fold[at[at < blocks]] = FOLDS - 1
        if blocks > 1 and fold[-1] == FOLDS - 1:
            # The ends of a run identify: what is not measured beyond them is unknown.
            fold[-2:] = fold[-2:][::-1]
    others = np.flatnonzero(fold < 0)
    count = np.arange(len(others))
    fold[others] = (count + count // 7) % (FOLDS - 1)  # 7: nor are these in step with a period
    return fold


def thinned_rows(values: np.ndarray, limit: int) -> np.ndarray:
    """Samples of an input to keep: its extremes, more where it bends, fewer where it does not.

    The input is cut into stretches, of which half are shared out evenly and half by the square
    root of the second difference around a sample: that spreads the error of straight lines between
    the samples evenly.  Of each stretch the first sample is kept, and where the input turns inside
    it, those of its least and its greatest value, so that no reversal is lost but inside a stretch.
    """
    count = len(values)
    bend = np.zeros(count)
    bend[1:-1] = np.sqrt(np.abs(np.diff(values, n=2)))
    share = scipy.ndimage.uniform_filter1d(bend, 15)
    for _ in range(5):  # a sample needs no more than a stretch of its own
        share = np.minimum(share / max(share.sum(), np.finfo(float).tiny), 2.0 / limit)
    share = 0.5 / count + 0.5 * share / max(share.sum(), np.finfo(float).tiny)
    stretch = np.floor(np.cumsum(share) / share.sum() * limit * (1 - 1e-12)).astype(int)
    starts = np.flatnonzero(np.diff(stretch, prepend=-1))
    keep = np.zeros(count, dtype=bool)
    keep[[0, -1]] = True
    keep[starts] = True
    turns = np.zeros(count, dtype=bool)
    moved = np.flatnonzero(np.diff(values))  # a converter repeats the value at a turning point
    turns[moved[:-1][np.diff(np.sign(np.diff(values)[moved])) != 0] + 1] = True
    sizes = np.diff(starts, append=count)
    for extreme in (np.minimum, np.maximum):
        keep |= turns & (values == np.repeat(extreme.reduceat(values, starts), sizes))
    others = np.flatnonzero(~keep)
    filling = min(-int(keep.sum()) % max(limit // 16, 1), len(others))
    keep[others[np.arange(filling) * len(others) // max(filling, 1)]] = True
    return np.flatnonzero(keep)


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


def grid_error_share(point: Point, other: Point, order: float = GRID_ORDER) -> float:
    r"""Share of the grid's error that another plane takes off, \(1 - (N / N')^p\)."""
    return 1 - (point.chain.plane.levels / other.chain.plane.levels) ** order


@dataclass(frozen=True, eq=False)
class Problem:
    """A record, cut into blocks and put on the device in double precision; no block spans two runs.

    Rows are in the order of their folds, and within a fold in the order of time, so that a fold is
    one slice of the regressors.

    Attributes:
        record: the record, possibly thinned.
        signals: what drives a model, on the device.
        survey: time scales of the record before it was thinned.
        rows: (row,) indices of the measured samples.
        block: (row,) block of each of them.
        fold: (row,) fold of each of them; the last one is held out.
        reduces: whether models on planes of many cells are solved for in a reduced basis, without
            signs.
        whole: the problem of which this one has a part of the rows, and of the basis; else None.
    """

    record: Record
    signals: Signals
    survey: Survey
    rows: np.ndarray
    block: np.ndarray
    fold: np.ndarray
    reduces: bool = False
    whole: Problem | None = None
    cache: dict[tuple[Any, ...], Any] = field(default_factory=dict[tuple[Any, ...], Any])

    def reduced(self, like: Problem | None = None) -> Problem:
        """The same record, whose models of many cells are solved for in a reduced basis."""
        known = {} if like is None else like.cache
        kept = {slot: own for slot, own in known.items() if slot[0] in ("basis", "lawful")}
        return replace(self, reduces=True, cache=kept)

    @property
    def rough(self) -> Problem:
        """The same record with few of its rows and directions: where to begin, at a quarter of the
        work."""
        slot = ("rough",)
        if slot not in self.cache:
            few = slice(None, None, ROUGH_ROWS)
            rows, block, fold = self.rows[few], self.block[few], self.fold[few]
            self.cache[slot] = replace(
                self, rows=rows, block=block, fold=fold, whole=self, cache={}
            )
        return self.cache[slot]

    @staticmethod
    def of(record: Record, limit: int | None = None) -> Problem:
        """Cut a record into blocks of equal numbers of samples, of measured ones if many lack."""
        record.check_identifiable()
        survey = Survey(record.duration_s, record.step_s)
        signals = signals_of(record)
        if limit is not None and len(record.time) > 1.25 * limit:
            kept = rows_kept(record, limit)
            # Little is saved where an input turns at nearly every sample, and its dynamics are
            # lost with what lies between the samples kept.
            if len(kept) <= WORTH_THINNING * len(record.time):
                record = without_rows(record, kept)
                signals = thinned(signals_of(record), signals, kept)
        rows = np.flatnonzero(record.measured)
        block, fold = blocks_of(record, rows)
        order = np.argsort(fold, kind="stable")
        return Problem(record, signals, survey, rows[order], block[order], fold[order])

    @property
    def identified(self) -> np.ndarray:
        """Folds by which a final model is identified: all of them, but whole runs held out."""
        return IDENTIFICATION if any(run.held_out for run in self.record.runs) else ALL

    @property
    def breaks(self) -> tuple[int, ...]:
        """Positions among the rows in the order of time where another run starts."""
        return tuple(np.searchsorted(np.sort(self.rows), self.record.starts).tolist())

    def survey_of(self, point: Point, effect: Effect | None = None) -> Survey:
        """What an effect may know of the record, and of what a model without it leaves."""
        order, starts = self.in_time, self.breaks
        if effect is not None and effect.of_time_alone and self.record.runs:
            run = max(self.record.runs, key=lambda run: (not run.held_out, run.stop - run.start))
            inside = (self.rows[order] >= run.start) & (self.rows[order] < run.stop)
            order, starts = order[inside], ()
        rows = self.rows[order]
        return replace(
            self.survey,
            starts=starts,
            time=self.record.time[rows],
            input=self.record.input[rows],
            output=self.record.output[rows],
            residual=point.residual[order] * point.unit,
            aux={name: values[rows] for name, values in self.record.aux.items()},
            path=np.zeros(0) if self.record.has_clock else self._path[rows],
        )

    @property
    def _path(self) -> np.ndarray:
        """(time,) path of the input in each run, see `Signals.path`."""
        return np.concatenate([np.asarray(part.path) for part in parts_of(self.signals)])

    def forms_of(self, effect: Effect, point: Point) -> tuple[Effect, ...]:
        """Forms of an effect to add to a point; they may cost a spectrum."""
        survey = self.survey_of(point, effect)
        forms = effect.variants(survey)
        slot = ("lawful", effect.name)
        if type(effect) not in BUILT_IN and slot not in self.cache:
            for form in forms:
                require_law_of_place(form, survey)
            self.cache[slot] = True
        return forms

    @property
    def in_time(self) -> np.ndarray:
        """(row,) positions of the rows in the order of time."""
        return np.argsort(self.rows)

    @property
    def target(self) -> np.ndarray:
        """(row,) measured output."""
        return self.record.output[self.rows]

    @property
    def unit(self) -> float:
        """Range of the measured output: the solver works on outputs of unit range."""
        return float(np.ptp(self.target))

    @property
    def level(self) -> float:
        """Mean of the measured output, from which the solver counts: squares keep their digits."""
        return float(self.target.mean())

    @property
    def goal(self) -> np.ndarray:
        """(row,) measured output from its mean, in output ranges."""
        return (self.target - self.level) / self.unit

    def shown_unit(self, unit: str) -> str:
        """A parameter's unit with those of the record in place of `{z}` and `{u}`."""
        channels = self.record.channels
        if not self.record.has_clock:
            unit = {"s": SAMPLES}.get(unit, unit)
        unit = unit.replace("{z}", channels["output"].unit or "1")
        return unit.replace("{u}", channels["input"].unit or "1")

    def hysteresis(
        self, chain: Chain, values: EffectValues, like: Point | None = None
    ) -> HysteresisColumns:
        """Columns of the operator; those along the recorded input are kept."""
        moving = bool(chain.at(InputEffect) or chain.at(HysteresisEffect))
        slot = ("hysteresis", chain.plane, chain.hysteron)
        if not moving and slot in self.cache:
            return self.cache[slot]
        if moving and self.reduces_on(chain.plane) and is_one_path(chain, self.signals):
            return self._combinations(chain, values)
        output = None
        if chain.feeds_back and like is not None:
            output = self.hysteresis_output(like)
        memory = self.record.initial_memory
        columns = hysteresis_columns(chain, values, self.signals, memory, output)
        if self.reduces_on(chain.plane):
            columns = self.basis(chain, None if moving else columns).applied_to(columns)
        if not moving and columns.states.size <= MOST_KEPT:
            self.cache[slot] = columns
        return columns

    def _combinations(self, chain: Chain, values: EffectValues) -> HysteresisColumns:
        """Those of the reduced basis along a path that effects of the input have moved."""
        basis, slot = self.basis(chain), ("like", chain.plane, chain.hysteron)
        if slot not in self.cache:  # without its states, which may be too many to keep
            still = self.hysteresis(chain.with_effects(()), {})
            self.cache[slot] = replace(still, states=np.zeros((0, basis.size)))
        shares, memory = (basis.cells, basis.memory, basis.first_run), self.record.initial_memory
        return combinations_along(chain, values, self.signals, memory, shares, self.cache[slot])

    def reduces_on(self, plane: Plane) -> bool:
        """Whether models on a plane are solved for in a reduced basis: not if it has few cells."""
        return self.reduces and plane.cells > WHOLE_CELLS

    def basis(self, chain: Chain, columns: HysteresisColumns | None = None) -> Basis:
        """Directions in which a record decides the density on a plane; found once."""
        slot = ("basis", chain.plane, chain.hysteron)
        if self.whole is not None:
            return self.whole.basis(chain).first(ROUGH_VECTORS)
        if slot not in self.cache:
            bare = chain.with_effects(())
            if columns is None:
                columns = hysteresis_columns(bare, {}, self.signals, self.record.initial_memory)
            whole = regressors(bare, {}, self.signals, columns, self.rows, self.target)
            equations = equations_of(self, whole, None)
            self.cache[slot] = reduced_basis(columns, equations, IDENTIFICATION, int(VALIDATION[0]))
        return self.cache[slot]

    def hysteresis_output(self, point: Point) -> np.ndarray:
        """(time,) output of the Preisach operator of a point, in output units."""
        found = point.coefficients()
        # What is fed back is found for weights of one sign.
        if self.reduces_on(point.chain.plane) and not point.chain.signed:
            sign = point.chain.polarity
            weights, memory = (
                sign * np.maximum(sign * w, 0) for w in (found.weights, found.memory)
            )
            found = replace(found, weights=weights, memory=memory)
        return np.asarray(hysteresis_output(point.chain, point.values, self.signals, found))


def equations_of(problem: Problem, columns: Columns, basis: Basis | None) -> NormalEquations:
    """Normal equations of a chain's columns on all measured rows."""
    levels = round((np.sqrt(8 * columns.cells + 1) - 1) / 2)
    asked = penalties(levels, columns.groups, columns.first_run) if basis is None else basis.asked
    return normal_equations(
        columns.matrix, problem.goal, problem.fold, columns.nonnegative, asked, columns.loose
    )


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

    Without signs, what a fold alone holds is predicted so badly that it would
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

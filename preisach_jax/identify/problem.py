"""A record that is identified: its blocks, and what is kept from one model to the next."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from preisach_jax.chain import Chain, Columns, EffectValues, HysteresisColumns
from preisach_jax.chain.runs import (
    hysteresis_columns,
    hysteresis_output,
    regressors,
    signals_of,
    thinned,
)
from preisach_jax.effects import BUILT_IN
from preisach_jax.effects.base import Effect, HysteresisEffect, InputEffect, Signals, Survey
from preisach_jax.effects.lawful import require_law_of_place
from preisach_jax.identify.blocks import ALL, IDENTIFICATION, VALIDATION, blocks_of, rows_kept
from preisach_jax.identify.point import Point
from preisach_jax.identify.reduction import Basis, reduced_basis
from preisach_jax.identify.regression import NormalEquations, normal_equations, penalties
from preisach_jax.operator.plane import Plane
from preisach_jax.record import Record
from preisach_jax.record.joined import without_rows

WHOLE_CELLS = 100
"""Cells up to which all hysterons are kept, with weights of one sign: they cost little more than a
reduced basis."""


WORTH_THINNING = 0.75
"""Share of a record's samples from which on thinning it is not worth what it loses."""

MOST_KEPT = 10_000_000
"""States beyond which columns are computed anew instead of kept: that takes less than a second,
and keeping them takes hundreds of megabytes."""


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
    """

    record: Record
    signals: Signals
    survey: Survey
    rows: np.ndarray
    block: np.ndarray
    fold: np.ndarray
    reduces: bool = False
    cache: dict[tuple[Any, ...], Any] = field(default_factory=dict[tuple[Any, ...], Any])

    def reduced(self, like: Problem | None = None) -> Problem:
        """The same record, whose models of many cells are solved for in a reduced basis."""
        known = {} if like is None else like.cache
        kept = {slot: own for slot, own in known.items() if slot[0] in ("basis", "lawful")}
        return replace(self, reduces=True, cache=kept)

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
        )

    def forms_of(self, effect: Effect, point: Point) -> tuple[Effect, ...]:
        """Forms of an effect to try beside a point; they may cost a spectrum."""
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

    def reduces_on(self, plane: Plane) -> bool:
        """Whether models on a plane are solved for in a reduced basis: not if it has few cells."""
        return self.reduces and plane.cells > WHOLE_CELLS

    def basis(self, chain: Chain, columns: HysteresisColumns | None = None) -> Basis:
        """Directions in which a record decides the density on a plane; found once."""
        slot = ("basis", chain.plane, chain.hysteron)
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

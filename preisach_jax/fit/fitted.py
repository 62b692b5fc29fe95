"""A fit: a model and the record on which it was identified, and how it comes of a point."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import scipy

from preisach_jax.chain.runs import of_last_run, response, signals_of
from preisach_jax.fit.stepwise import (
    MOST_ROUNDS,
    SIGNS_TOLERANCE,
    Found,
    mended,
    moved_to,
    with_signs,
)
from preisach_jax.fit.training import Training
from preisach_jax.hooks import HOOKS
from preisach_jax.identify.confidence import (
    Influences,
    estimates,
    influences,
    moves_of,
    other_models,
    with_arcs,
)
from preisach_jax.identify.gauss_newton import stepped
from preisach_jax.identify.problem import ALL, VALIDATION, Point, Problem, evaluate, with_all_rows
from preisach_jax.loss import Loss, loss_per_cycle, magnet_of
from preisach_jax.model import Model, Origin, Prediction
from preisach_jax.model.band import Band, InputMotion
from preisach_jax.quantity import quantity
from preisach_jax.record.core import Record
from preisach_jax.record.joined import RunErrors, errors_by_run, last_fitted

if TYPE_CHECKING:
    from matplotlib.figure import Figure

RISE = 1e-3
"""Relative rise of a held-out error from which on it is said: less is not seen in its digits."""

BAND_ROWS = 12_000
"""Rows, at least, that calibrate the band of a longer record: neighbours say the same."""

FINAL_ROWS = 60_000
"""Samples to which a still longer record is thinned for the final fit, to bound its memory."""


@dataclass(frozen=True)
class Added:
    """What adding effects to a model did to its error on the rows held out.

    Attributes:
        effects: their names.
        before, after: the RMS error, in output units, as the search saw it: of a long record on
            the rows to which it was thinned.
    """

    effects: tuple[str, ...]
    before: float
    after: float


@dataclass(frozen=True, eq=False)
class Fit:
    """A model fitted to a record, with what it leaves.

    Attributes:
        record: the record.
        model: the model, identified on all rows.
        prediction: (time,) output of the same model identified on the identification rows alone.
        identification: (time,) rows that identified `prediction`.
        validation: (time,) rows held out: contiguous blocks spread over the record.
        point: the numerical state, from which a larger model starts; possibly without regressors.
        training: how the arrays of its effects were trained; None if they were not.
        added: what each effect did to the held-out error as it was added, in their order; of
            effects that were trained, what all of them did.
    """

    record: Record
    model: Model
    prediction: np.ndarray
    identification: np.ndarray
    validation: np.ndarray
    point: Point
    training: Training | None = None
    added: tuple[Added, ...] = ()

    def __repr__(self) -> str:
        return f"<Fit of {self.record.name}: {self.model.line}>"

    def _repr_html_(self) -> str:
        return HOOKS["Fit._repr_html_"](self)

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the effects in the model."""
        return tuple(effect.name for effect in self.model.effects)

    @property
    def name(self) -> str:
        """The model by its effects."""
        return self.model.name

    @property
    def residual(self) -> np.ndarray:
        """(time,) measured minus predicted output; NaN where nothing was measured."""
        return self.record.output - self.prediction

    @property
    def rms_identification(self) -> float:
        """RMS residual on the identification rows, in output units."""
        return float(np.sqrt(np.mean(self.residual[self.identification] ** 2)))

    @property
    def rms_validation(self) -> float:
        """RMS residual on the held-out rows, in output units."""
        return float(np.sqrt(np.mean(self.residual[self.validation] ** 2)))

    @property
    def max_abs_validation(self) -> float:
        """Largest residual on the held-out rows, in output units."""
        return float(np.max(np.abs(self.residual[self.validation])))

    @property
    def fit_percent(self) -> float:
        r"""\(100\,(1 - \|e\| / \|z - \bar z\|)\) on the held-out rows."""
        output = self.record.output[self.validation]
        spread = np.linalg.norm(output - output.mean())
        return float(100 * (1 - np.linalg.norm(self.residual[self.validation]) / spread))

    @property
    def rises(self) -> tuple[str, ...]:
        """A sentence on each effect whose adding raised the held-out error."""
        unit = self.record.output_unit
        return tuple(
            f"adding {', '.join(each.effects)} raised the held-out error from "
            f"{quantity(each.before, unit, 4)} to {quantity(each.after, unit, 4)} RMS: leave it "
            "out, unless it is known to act and the record to be poor"
            for each in self.added
            if not each.after <= (1 + RISE) * each.before
        )

    @property
    def by_record(self) -> tuple[RunErrors, ...]:
        """What the model leaves of each of several records; empty for a single one."""
        return errors_by_run(self.record, self.residual, self.identification, self.validation)

    @cached_property
    def loss(self) -> Loss | None:
        """Of a magnet, what its closed cycles lose; None if the units are not those of H and B."""
        return loss_per_cycle(self.record, self.model) if magnet_of(self.record) else None

    def summary(self) -> str:
        """Errors and parameters as text."""
        return HOOKS["Fit.summary"](self)

    def plot(self) -> Figure:
        """Measured against model, and the residual, as a matplotlib figure."""
        return HOOKS["Fit.plot"](self)

    def predict(self, record: Record) -> Prediction:
        """Predict the output of a record; see `Model.predict`."""
        return self.model.predict(record)

    def save(self, path: str | Path) -> None:
        """Write the model as JSON; see `Model.save`."""
        self.model.save(path)


def on_all_rows(record: Record, problem: Problem, point: Point) -> Fit:
    """The fit of a point that was found on a thinned record."""
    whole = Problem.of(record, FINAL_ROWS)
    return finished(whole, moved_to(whole.reduced(problem), point), record)


def finished(problem: Problem, point: Point, record: Record) -> Fit:
    """The fit of a point: the model of all rows, the prediction without those held out."""
    point = with_signs(problem, point)
    held_back = whole = stepped(problem, point, SIGNS_TOLERANCE)
    if len(problem.identified) == len(ALL):
        whole = stepped(problem, with_all_rows(point))
    coefficients = held_back.coefficients()
    signals = signals_of(record)
    prediction = np.asarray(response(point.chain, held_back.values, signals, coefficients))
    held_out = held_out_rows(problem, record)
    residual = (record.output - prediction)[held_out]
    cells = whole.chain.plane.cells
    found = influences(problem, whole, whole.parameters)
    units = {role: channel.unit for role, channel in record.channels.items()}
    model = Model(
        chain=whole.chain,
        values=whole.values,
        coefficients=of_last_run(whole.chain, whole.coefficients(), signals),
        parameters=with_arcs(estimates(problem, whole, found), problem, whole, found),
        visited=np.ptp(whole.matrix[:, :cells], axis=0) > 1e-9,
        columns={
            **{role: record.channels[role].name for role in ("time", "input", "output")},
            "aux": list(record.aux),
        },
        units=units,
        origin=Origin.of(last_fitted(record)),
        rms_validation=float(np.sqrt(np.mean(residual**2))),
        band=_band_of(problem, whole, found, record),
    )
    return Fit(record, model, prediction, record.measured & ~held_out, held_out, point)


def _band_of(problem: Problem, point: Point, found: Influences, record: Record) -> Band:
    """The band of a model, from what each fold misses by the coefficients of the others."""
    missed = np.zeros(len(problem.rows))
    for fold in ALL:
        own = problem.fold == fold
        missed[own] = with_all_rows(point, ALL[fold != ALL]).residual[own]
    moves, of_blocks = moves_of(point, found)
    missed *= problem.unit
    noise = _noise_rms(missed[problem.in_time], problem.breaks)
    few = problem.in_time[:: 1 + len(problem.rows) // BAND_ROWS]
    by_weights, by_parameters = np.split(moves, [point.matrix.shape[1]], axis=1)
    squares = point.matrix[few] @ by_weights.T
    squares += found.linear.tangents[few] @ by_parameters.T
    squares *= squares
    spread = np.stack([squares[:, :of_blocks].sum(axis=1), squares[:, of_blocks:].sum(axis=1)], 1)
    rows = np.searchsorted(record.time, problem.record.time[problem.rows[few]])
    plane = point.chain.plane
    return Band.calibrated(
        InputMotion.of(record, rows),
        missed[few],
        np.sqrt(spread) * problem.unit,
        (plane.high - plane.low) / plane.levels,
        noise,
        other_models(problem, point, found, moves, of_blocks),
    )


def _noise_rms(missed: np.ndarray, breaks: tuple[int, ...]) -> float:
    """RMS of what is unpredictable from row to row, by second differences that no jump disturbs."""
    jumps = np.concatenate([np.diff(part, n=2) for part in np.split(missed, breaks)])
    middles = (float(np.median(np.abs(each))) for each in (missed, jumps / np.sqrt(6)))
    return min(middles) / float(scipy.special.ndtri(0.75))


def with_regressors(problem: Problem, fit: Fit) -> Point:
    """The point of a fit with its regressors, which are computed again where they were let go."""
    point = fit.point
    if len(point.matrix):
        return point
    return evaluate(problem, point.chain, point.values, point.strength, point)


def held_out_rows(problem: Problem, record: Record) -> np.ndarray:
    """(time,) measured rows of the whole record that lie in the stretches held out."""
    if len(problem.identified) < len(ALL):
        mask = np.zeros(len(record.time), dtype=bool)
        for run in record.runs:
            mask[run.rows] = run.held_out
        return mask & record.measured
    order = problem.in_time
    times = problem.record.time[problem.rows[order]]
    held_out = problem.fold[order] == VALIDATION[0]
    measured = np.flatnonzero(record.measured)
    # Each row goes with the last row of the cut that is not after it.
    before = np.searchsorted(times, record.time[measured], side="right") - 1
    mask = np.zeros(len(record.time), dtype=bool)
    mask[measured] = held_out[np.maximum(before, 0)]
    return mask


def freed_of_blemishes(
    record: Record, work: Callable[[Record], Found], fit_of: Callable[[Found], Fit]
) -> Found:
    """What is found in a record, again as long as what its fit leaves shows spikes or jumps.

    What the plain model misses hides those that one with effects shows.
    """
    found = work(record)
    for _ in range(MOST_ROUNDS):
        fit = fit_of(found)
        if not fit.effects:
            break  # `plain_model` has left out what a model without effects shows
        left = mended(fit.record, fit.prediction)
        if left is fit.record:
            break
        found = work(left)
    return found

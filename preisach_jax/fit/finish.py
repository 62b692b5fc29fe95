"""From the search on some rows to the final model on all of them."""

from __future__ import annotations

import numpy as np
import scipy

from preisach_jax.chain.runs import of_last_run, response, signals_of
from preisach_jax.fit.result import Fit
from preisach_jax.fit.steps import SIGNS_TOLERANCE, moved_to, with_signs
from preisach_jax.identify import ALL, VALIDATION, Point, Problem, evaluate, stepped, with_all_rows
from preisach_jax.identify.between import with_arcs
from preisach_jax.identify.confidence import (
    Influences,
    estimates,
    influences,
    moves_of,
    other_models,
)
from preisach_jax.model import Model, Origin
from preisach_jax.model.band import Band, InputMotion
from preisach_jax.record import Record
from preisach_jax.record.joined import last_fitted

BAND_ROWS = 12_000
"""Rows, at least, that calibrate the band of a longer record: neighbours tell the same."""

FINAL_ROWS = 60_000
"""Samples to which a still longer record is thinned for the final fit, to bound its memory."""


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

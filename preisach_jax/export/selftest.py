"""The course and the outputs by which generated code tests itself."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from preisach_jax.effects.base import Place
from preisach_jax.export.account import jumps, looks_ahead
from preisach_jax.export.description import Description
from preisach_jax.export.stepper import sample_by_sample
from preisach_jax.model import Model
from preisach_jax.record.core import Record

Columns = dict[str, np.ndarray]

TURNS = (0.3, 1.0, 0.12, 0.81, 0.35, 0.62, 0.44, 0.0, 0.93, 0.55, 0.55)
"""Corners of the course, in parts of the input's range; the last part is a hold."""

SAMPLES_A_LINE = 37

WITHIN, WITHIN_FLOAT, WITHIN_FLOAT_RATE = 1e-12, 1e-5, 1e-4
"""Differences that are no mistake, in parts of the output's range; a rate is less exact."""

WITHIN_JUMPS = 0.2
"""The same where rounding may move a jump."""


def course(model: Description) -> np.ndarray:
    """Input of the self test, `(sample,)`: straight lines, or smooth where the speed counts."""
    if looks_ahead(model):
        t = np.linspace(0.0, 1.0, SAMPLES_A_LINE * (len(TURNS) - 1) + 1)
        part = 0.5 - 0.5 * np.cos(2 * np.pi * 3 * t) * (0.4 + 0.6 * np.cos(2 * np.pi * t) ** 2)
    else:
        samples = np.arange(SAMPLES_A_LINE * (len(TURNS) - 1) + 1)
        part = np.interp(samples, SAMPLES_A_LINE * np.arange(len(TURNS)), TURNS)
    if model.hysteron == "relay" and not model.at(Place.INPUT) and not model.at(Place.HYSTERESIS):
        # Away from the thresholds, so that the rounding of a float does not move one.
        part = (np.round(4 * model.levels * part - 0.5) + 0.5) / (4 * model.levels)
        part = np.clip(part, 0.0, 1.0)
    return model.low + (model.high - model.low) * part


def self_test(model: Model, described: Description) -> dict[str, Any]:
    """Input, auxiliary columns and expected output of the self test, with the tolerances."""
    drive = course(described)
    count = len(drive)
    swing = np.sin(np.arange(count) / 29)
    aux = {column.name: np.round(swing + k, 6) for k, column in enumerate(described.aux)}
    if looks_ahead(described):
        expected = _sample_by_sample(described, drive, aux)
    else:
        expected = _predicted(model, described, drive, aux)
    reach = float(np.ptp(expected)) or 1.0
    rate = described.widening is not None
    coarse = WITHIN_FLOAT_RATE if rate else WITHIN_FLOAT
    coarse = WITHIN_JUMPS if jumps(described) else coarse
    return {
        "input": drive.tolist(),
        "aux": [
            {"identifier": column.identifier + "_course", "course": aux[column.name].tolist()}
            for column in described.aux
        ],
        "aux_arguments": "".join(
            f", (preisach_real){column.identifier}_course[k]" for column in described.aux
        ),
        "expected": expected.tolist(),
        "first": int(rate),
        "tolerance": repr(WITHIN * reach),
        "tolerance_float": repr(coarse * reach),
        "adapt": repr((WITHIN_JUMPS if jumps(described) else 100 * WITHIN) * reach),
        "adapt_float": repr((WITHIN_JUMPS if jumps(described) else 100 * WITHIN_FLOAT) * reach),
        "bound": repr(1e3 * (reach + float(np.abs(expected).max()) + abs(described.offset))),
    }


def _predicted(model: Model, described: Description, drive: np.ndarray, aux: Columns) -> np.ndarray:
    """What `Model.predict` says to a record that continues none."""
    start, stop = model.origin.start_s, model.origin.stop_s
    first = start if start <= 0 <= stop + (stop - start) else 0.0
    time = first + np.arange(len(drive)) * described.step_s
    blank = np.full(len(drive), np.nan)
    record = Record.from_arrays(time, drive, blank, aux=aux)
    return replace(model, band=None).predict(record).output


def _sample_by_sample(described: Description, drive: np.ndarray, aux: Columns) -> np.ndarray:
    """The law that looks at no sample to come."""
    inputs = np.stack([drive, *(aux[column.name] for column in described.aux)], axis=1)
    return sample_by_sample(described, inputs)

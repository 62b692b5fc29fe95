"""The course and the outputs by which generated code tests itself."""

from __future__ import annotations

from typing import Any

import numpy as np

from preisach_jax.effects.places import Place
from preisach_jax.export.account import jumps, looks_ahead
from preisach_jax.export.description import Description
from preisach_jax.model import Model
from preisach_jax.record import Record

TURNS = (0.3, 1.0, 0.12, 0.81, 0.35, 0.62, 0.44, 0.0, 0.93, 0.55, 0.55)
"""Corners of the course, in parts of the input's range; the last part is a hold."""

SAMPLES_A_LINE = 37

WITHIN, WITHIN_FLOAT = 1e-12, 1e-5
"""Differences that are no mistake, in parts of the output's range."""

WITHIN_AHEAD, WITHIN_JUMPS = 2e-2, 0.2
"""The same where a law of `Model.predict` looks ahead, and where rounding may move a jump."""


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
    """Input, auxiliary columns and expected output of the self test, with the tolerances.

    Arguments:
        model: the model.
        described: the same in discrete time.

    Returns:
        What the template of the self test is filled with.
    """
    drive = course(described)
    count = len(drive)
    swing = np.sin(np.arange(count) / 29)
    aux = {column.name: np.round(swing + k, 6) for k, column in enumerate(described.aux)}
    start, stop = model.origin.start_s, model.origin.stop_s
    # A clock that `predict` takes for the beginning of a record that continues none.
    first = start if start <= 0 <= stop + (stop - start) else 0.0
    time = first + np.arange(count) * described.step_s
    expected = model.predict(
        Record.from_arrays(time, drive, np.full(count, np.nan), aux=aux)
    ).output
    reach = float(np.ptp(expected)) or 1.0
    rate, inexact = described.part("rate_dependence"), looks_ahead(described)
    share = (WITHIN_JUMPS if jumps(described) else WITHIN_AHEAD) if inexact else WITHIN
    coarse = WITHIN_JUMPS if jumps(described) else WITHIN_FLOAT
    quantised = described.part("output_quantisation") is not None
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
        "first": int(rate is not None or inexact),
        "tolerance": repr(share * reach),
        "tolerance_float": repr(max(share, coarse) * reach),
        "adapts": not (quantised or rate is not None),
        "adapt_times": 100,
        "bound": repr(1e3 * (reach + float(np.abs(expected).max()) + abs(described.offset))),
    }

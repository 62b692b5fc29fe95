"""The columns that the linear coefficients of a chain multiply."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import jax.numpy as jnp
import numpy as np

from preisach_jax.chain.coefficients import Columns
from preisach_jax.chain.compiled import apply_to_columns, as_arrays, sensor_columns_of
from preisach_jax.chain.description import Chain, EffectValues
from preisach_jax.chain.hysteresis import MOST_COLUMNS, HysteresisColumns
from preisach_jax.chain.output import columns_beside, gains_of
from preisach_jax.cores import on_all_cores
from preisach_jax.effects.base import OutputEffect, SensorEffect, Signals

GATHERED_ROWS = 256
"""Rows that are gathered at once: they stay in the processor's cache on their way."""


def regressors(
    chain: Chain,
    values: EffectValues,
    signals: Signals,
    hysteresis: HysteresisColumns,
    rows: np.ndarray | None = None,
    measured: np.ndarray | None = None,
) -> Columns:
    """The columns that the linear coefficients multiply, at given nonlinear parameters.

    Arguments:
        rows: (row,) samples to keep, in their order; all by default.
        measured: (row,) measured output at these samples, for the effects of the sensor.

    Returns:
        The columns, `(row, column)`.
    """
    rows = np.arange(len(signals.time)) if rows is None else rows
    behind_it = [np.ones((len(signals.time), 1))]
    behind_it += columns_behind(chain, values, signals, rows, measured)
    of_hysteresis = hysteresis.states.shape[1] + hysteresis.switched.shape[1]
    whole = of_hysteresis + sum(part.shape[1] for part in behind_it)
    matrix = np.empty((len(rows), whole), dtype=hysteresis.states.dtype)

    def place(start: int, part: np.ndarray) -> None:
        stop = start + part.shape[1]
        for first in range(0, len(rows), GATHERED_ROWS):
            some = slice(first, first + GATHERED_ROWS)
            matrix[some, start:stop] = part[rows[some]]

    through = _behind(chain, values, signals)
    if through is None:
        place(0, hysteresis.states)
        place(hysteresis.states.shape[1], hysteresis.switched)
    else:
        starts = range(0, of_hysteresis, MOST_COLUMNS)
        deque(on_all_cores(lambda at: place(at, through(hysteresis.some(at))), starts), maxlen=0)
    start = of_hysteresis
    for part in behind_it:
        place(start, part)
        start += part.shape[1]
    if chain.polarity < 0:
        matrix[:, :of_hysteresis] *= -1
    behind = chain.coefficients
    loose = np.zeros(matrix.shape[1], dtype=bool)
    loose[len(loose) - len(behind) :] = [not each.amount for _, each in behind]
    names = tuple(effect for effect, _ in behind)
    groups, start, first_run = hysteresis.groups, hysteresis.start, hysteresis.first_run
    cells, sign = chain.plane.cells, chain.polarity
    return Columns(
        matrix,
        cells,
        groups,
        start,
        first_run,
        names,
        loose,
        sign,
        chain.signed,
        hysteresis.vectors,
    )


def _behind(
    chain: Chain, values: EffectValues, signals: Signals
) -> Callable[[np.ndarray], np.ndarray] | None:
    """What the effects of weights and output make of some columns; None if there are none."""
    gains = [np.asarray(factor) for factor in gains_of(chain, values, signals)]
    filters = chain.at(OutputEffect)
    if not gains and not filters:
        return None

    def behind(columns: np.ndarray) -> np.ndarray:
        for gain in gains:
            columns = columns * gain[:, None]
        for effect in filters:
            own = as_arrays(values[effect.name])
            columns = apply_to_columns(effect, own, columns, signals.time)
        return columns

    return behind


def columns_behind(
    chain: Chain,
    values: EffectValues,
    signals: Signals,
    rows: np.ndarray,
    measured: np.ndarray | None,
) -> list[np.ndarray]:
    """What the coefficients of added, output and sensor effects multiply, `(time, column)` each.

    Arguments:
        rows: (row,) samples at which the output was measured.
        measured: (row,) measured output at these samples, for the effects of the sensor.
    """
    beside = columns_beside(chain, values, signals, {})
    parts = [np.asarray(columns) for columns in beside.values()]
    for effect in chain.at(SensorEffect):
        reading = np.full(len(signals.time), np.nan)
        reading[rows] = measured
        columns = sensor_columns_of(
            effect, len(effect.coefficients()), as_arrays(values[effect.name]), jnp.asarray(reading)
        )
        parts.append(np.asarray(columns))
    return parts

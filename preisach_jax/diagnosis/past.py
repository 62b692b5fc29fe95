"""What is put down to hysterons that the past of a record left on, and that switch once for all."""

from __future__ import annotations

import numpy as np

from preisach_jax.chain.driven import drive
from preisach_jax.chain.hysteresis import first_run_output
from preisach_jax.chain.runs import signals_of
from preisach_jax.model import Model
from preisach_jax.operator.plane import position_on
from preisach_jax.quantity import quantity
from preisach_jax.record.core import Record
from preisach_jax.record.course import reversals

LEAST_ADVANCES = 10
"""Turns of the input beyond all before, from which on what they switch may be a course of time."""

CLEARLY = 1e-3
"""Share of the input's range by which a turn is beyond those before."""

OF_THE_ERROR = 3.0
"""RMS of what they switch, over the error of the model, from which on it is told."""


MOST_AT_FIRST = 4.0
"""Mean square error before the input has covered its range, over that of the rest, from which on
it is told."""


def of_the_beginning(record: Record, residual: np.ndarray) -> str:
    """That the error of a model sits before the input has covered its range; empty if not.

    Arguments:
        residual: (time,) measured minus modelled output, in output units.
    """
    values = record.input
    clearly = CLEARLY * float(np.ptp(values))
    covered = max(
        int(np.argmax(values >= values.max() - clearly)),
        int(np.argmax(values <= values.min() + clearly)),
    )
    squared = np.where(record.measured, residual, np.nan) ** 2
    first, rest = squared[: covered + 1], squared[covered + 1 :]
    if not (np.isfinite(first).any() and np.isfinite(rest).any()):
        return ""
    if not np.nanmean(first) > MOST_AT_FIRST * np.nanmean(rest):
        return ""
    share, rows = np.nansum(first) / np.nansum(squared), (covered + 1) / len(values)
    until = quantity(float(record.time[covered] - record.time[0]), "s", 3)
    return (
        f"{100 * share:.0f} % of the squared error lie in the first {100 * rows:.2g} % of the "
        f"rows, {until}, before the input has covered its range: that is the initial memory, which "
        "--initial-memory says (as-fitted where this record begins as that of the model did)"
    )


def of_the_first_rise(record: Record, model: Model, error: float) -> tuple[str, ...]:
    """What a reader must know if the first passage of the input is another one than later ones.

    Arguments:
        error: held-out error of the model, in output units.
    """
    if record.runs or model.chain.mechanics is not None:
        return ()
    # From inside its range, what the first passage switches may be the plane's own memory.
    position = position_on(model.plane, record.input)
    first = position[0]
    if min(first - position.min(), position.max() - first) > 1.0:
        return ()
    farthest = int(np.argmax(np.abs(position - first)))
    if np.abs(position[farthest:] - first).min() > 1.0:
        return ()  # it never comes back: there is no later passage
    course = drive(model.chain, model.values, signals_of(record))
    output = np.asarray(first_run_output(model.chain, course, model.coefficients.first_run))
    away = float(output[int(np.argmax(np.abs(output)))])
    if abs(away) < OF_THE_ERROR * error:
        return ()
    side = "below" if away < 0 else "above"
    note = (
        f"The first passage differs from later ones: the output begins "
        f"{quantity(abs(away), record.output_unit, 2)} {side} where the same input has it later "
        "(hysterons that switch once for all, as on a virgin curve). A prediction of another "
        "record that begins so needs --initial-memory as-fitted; else its band allows for both."
    )
    return (note,)


def of_the_past(record: Record, model: Model, error: float) -> tuple[str, ...]:
    """What a reader must know if the past of a record takes up what time may do; none if not.

    Where each loop of many is a little greater than the last one, each switches hysterons that no
    later one switches back, if they lie beyond the range of the input.  Their sum is a course of
    time, as a drift and an ageing are.

    Arguments:
        error: held-out error of the model, in output units.
    """
    if record.initial_memory != "free" or record.runs or model.chain.mechanics is not None:
        return ()
    if (count := _advances(record.input)) < LEAST_ADVANCES:
        return ()
    course = drive(model.chain, model.values, signals_of(record))
    output = np.asarray(first_run_output(model.chain, course, model.coefficients.first_run))
    rms = float(np.std(output[record.measured]))
    if rms < OF_THE_ERROR * error:
        return ()
    note = (
        f"The input turns beyond all its values before {count} times, and "
        f"{quantity(rms, record.output_unit, 2)} RMS of the output are put down to hysterons that "
        "an unknown past left on and that switch then once for all: a drift or an ageing cannot be "
        "told from that. If the material was saturated at the start, say so (--initial-memory high "
        "or low)."
    )
    return (note,)


def _advances(values: np.ndarray) -> int:
    """How often an input turns clearly beyond where it has turned before."""
    clearly = CLEARLY * float(np.ptp(values))
    turns = values[reversals(values, clearly)]
    if not len(turns):
        return 0
    highest = np.maximum.accumulate(np.append(values[0], turns))
    lowest = np.minimum.accumulate(np.append(values[0], turns))
    return int(np.sum((np.diff(highest) > clearly) | (np.diff(lowest) < -clearly)))

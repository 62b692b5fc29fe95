"""What is put down to hysterons that the past of a record left on, and that switch once for all."""

from __future__ import annotations

import numpy as np

from preisach_jax.chain import first_run_output
from preisach_jax.chain.driven import drive
from preisach_jax.chain.runs import signals_of
from preisach_jax.model import Model
from preisach_jax.quantity import quantity
from preisach_jax.record import Record
from preisach_jax.record.course import reversals

LEAST_ADVANCES = 10
"""Turns of the input beyond all before, from which on what they switch may be a course of time."""

CLEARLY = 1e-3
"""Share of the input's range by which a turn is beyond those before."""

OF_THE_ERROR = 3.0
"""RMS of what they switch, over the error of the model, from which on it is told."""


def of_the_past(record: Record, model: Model, error: float) -> tuple[str, ...]:
    """What a reader must know if the past of a record takes up what time may do; none if not.

    Where each loop of many is a little greater than the last one, each switches hysterons that no
    later one switches back, if they lie beyond the range of the input.  Their sum is a course of
    time, as a drift and an ageing are.

    Arguments:
        record: the record.
        model: the model of it.
        error: its held-out error, in output units.
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

"""The practical size of an error: what lies below it is told, and does not change the verdict."""

from __future__ import annotations

import re

import numpy as np

from preisach_jax.errors import InputError
from preisach_jax.quantity import in_unit, quantity
from preisach_jax.record.core import Record

PATTERN = re.compile(r"\s*([0-9.]+(?:[eE][-+]?[0-9]+)?)\s*(\S*)\s*")


def stroke_of(record: Record) -> float:
    """Range of the measured output, in its unit."""
    return float(np.ptp(record.output[record.measured]))


def tolerance_of(text: str | None, record: Record) -> float:
    """A tolerance in output units.

    Arguments:
        record: the record, whose output has the unit.
    """
    if text is None:
        return 0.0
    unit, stroke = record.output_unit, stroke_of(record)
    remedy = f"give per cent of the stroke, such as 0.1%, or a value with its unit ({unit or '-'})"
    found = PATTERN.fullmatch(text)
    if found is None or not _is_positive(found[1]):
        raise InputError(f"tolerance {text!r} is no positive number with a unit; {remedy}")
    value, given = float(found[1]), found[2]
    if not given:
        raise InputError(f"tolerance {text!r} has no unit; {remedy}")
    if given == "%":
        tolerance = value / 100 * stroke
    else:
        factor = in_unit(given, unit)
        if factor is None:
            raise InputError(f"tolerance {text!r} is in {given}; {remedy}")
        tolerance = value * factor
    if not tolerance < stroke:
        raise InputError(
            f"tolerance {text!r} is not below the stroke of {quantity(stroke, unit)}; {remedy}"
        )
    return tolerance


def _is_positive(digits: str) -> bool:
    try:
        return 0 < float(digits) < np.inf
    except ValueError:
        return False

"""The wanted course of the output: shapes that are typed, and its file."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from preisach_jax.diagnosis import residuals as stats
from preisach_jax.diagnosis.exploration import Exploration
from preisach_jax.effects.base import auxiliary_columns
from preisach_jax.errors import InputError
from preisach_jax.quantity import quantity
from preisach_jax.record import Record
from preisach_jax.record.units import seconds_per, split_unit

MOST_ROWS = 200_000
"""Rows of a course that is made here; the command line drives longer ones."""

LEAST_PER_PERIOD = 8
"""Rows in which a period still has its shape."""

SHARE = 0.6
"""Share of the stroke that a shape spans unless another swing is typed."""

STEPS = 5
"""Steps of a staircase from its foot to its top."""

FLANK = 0.2
"""Share of a step in which a staircase goes to the next one: no stage jumps."""

LEAD = 0.5
"""Periods in which the stage is led to the beginning of a shape."""

REST = 0.1
"""Share of that in which the stage is left where it is: a delay passes nothing sooner."""

HOLD = 0.15
"""Share of a period for which a scan holds at either end."""

RESTING_ROWS = 256
"""Rows for which it is reckoned how the output goes on by itself; delays and lags are shorter."""

MADE = "wanted.csv"
"""What a course that is made here is called as a file."""

SHAPES = ("Triangle", "Sine", "Staircase", "Scan with holds")
"""Shapes by the name that the menu has."""


@dataclass(frozen=True)
class Shape:
    """A course that repeats.

    Attributes:
        kind: one of `SHAPES`.
        middle, swing: middle of the course, and from its lowest to its highest, in the unit of the
            output.
        frequency: periods per s.
        periods: how many.
    """

    kind: str
    middle: float
    swing: float
    frequency: float
    periods: float


def usual_shape(step: Exploration) -> Shape:
    """Three triangles over 60 % of the stroke, as fast as the record usually goes."""
    record = step.record
    output = step.fit.prediction
    low, high = float(output.min()), float(output.max())
    swing = _short(SHARE * (high - low))
    speed = np.abs(stats.input_rate(record.time, record.input))
    moving = speed[speed > 0.01 * speed.max()]
    per_s = float(np.median(moving)) * (high - low) / float(np.ptp(record.input))
    # Neither so fast that a period has few rows, nor so slow that there are very many of them.
    slowest, fastest = (1 / (rows * record.step_s) for rows in (MOST_ROWS / 40, 40))
    frequency = min(max(per_s / (2 * swing), slowest), fastest)
    return Shape(SHAPES[0], _short((low + high) / 2, 3), swing, _short(frequency), 3.0)


def _short(value: float, digits: int = 2) -> float:
    return float(f"{value:.{digits}g}")


def resting(step: Exploration) -> np.ndarray:
    """(row,) how the output goes on behind the record while the input rests: delays, creep."""
    model, record = step.fit.model, step.record
    time = model.origin.stop_s + model.origin.step_s * np.arange(1, RESTING_ROWS + 1)
    names = auxiliary_columns(model.effects)
    aux = {name: np.full(len(time), record.aux[name][-1]) for name in names}
    held = np.full(len(time), record.input[-1])
    rest = Record.from_arrays(time, held, np.full(len(time), np.nan), aux=aux, name="the rest")
    return model.predict(rest).output


def shaped(shape: Shape, begin: np.ndarray | float, step_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Time and output of a shape, to which the stage is led from where it is.

    Arguments:
        begin: output from which half a period leads to that, or (row,) how it would go on by
            itself: what is on its way already cannot be had otherwise.
        step_s: time between two rows, in s.

    Returns:
        (time,) time in s from 0, and output in the unit of the shape.
    """
    _check(shape, step_s)
    low = shape.middle - shape.swing / 2
    count = 1 + round((LEAD + shape.periods) / (shape.frequency * step_s))
    time = step_s * np.arange(count)
    phase = shape.frequency * time - LEAD
    own = np.atleast_1d(begin)
    own = own[np.minimum(np.arange(count), len(own) - 1)]
    led = own + (low - own) * _smooth((1 + phase / LEAD - REST) / (1 - REST))
    return time, np.where(phase < 0, led, low + shape.swing * _level(shape.kind, phase))


def _check(shape: Shape, step_s: float) -> None:
    for name, value in (
        ("swing", shape.swing), ("frequency", shape.frequency), ("number of periods", shape.periods)
    ):  # fmt: skip
        if not 0 < value < np.inf:
            raise InputError(f"the {name} is {value:g}; give a number above 0")
    if not np.isfinite(shape.middle):
        raise InputError(f"the middle is {shape.middle:g}; give a number")
    rows = 1 / (shape.frequency * step_s)
    if rows < LEAST_PER_PERIOD:
        raise InputError(
            f"at {quantity(shape.frequency, 'Hz')} a period has {rows:.2g} rows of "
            f"{quantity(step_s, 's')}; give at most "
            f"{quantity(1 / (LEAST_PER_PERIOD * step_s), 'Hz')}"
        )
    if rows * (shape.periods + LEAD) > MOST_ROWS:
        raise InputError(
            f"{shape.periods:g} periods at {quantity(shape.frequency, 'Hz')} are "
            f"{rows * shape.periods:,.0f} rows, and the page makes {MOST_ROWS:,} at most: give "
            "fewer periods or a higher frequency, or use preisach compensate"
        )


def _level(kind: str, phase: np.ndarray) -> np.ndarray:
    """A shape between 0 and 1 over its phase in periods."""
    part = phase % 1.0
    rising = 1 - np.abs(2 * part - 1)
    if kind == "Triangle":
        return rising
    if kind == "Sine":
        return (1 - np.cos(2 * np.pi * part)) / 2
    if kind == "Staircase":
        place = 2 * STEPS * part
        slot = np.floor(place)
        held, then = (np.minimum(k, 2 * STEPS - k) for k in (slot, slot + 1))
        return (held + (then - held) * _smooth((place - slot - (1 - FLANK)) / FLANK)) / STEPS
    run = 0.5 - HOLD
    return np.clip(np.minimum(part / run, (1 - HOLD - part) / run), 0.0, 1.0)


def _smooth(share: np.ndarray) -> np.ndarray:
    """From 0 to 1 without a jump of speed or acceleration."""
    held = np.clip(share, 0.0, 1.0)
    return held**3 * (10 + held * (6 * held - 15))


@dataclass(frozen=True)
class CourseFile:
    """A wanted course as a file.

    Attributes:
        name: what it is called.
        content: its bytes.
        columns: names of its columns by role, where they are not those of the model.
        units: units by role, where the names of the columns do not tell them.
        notes: what was assumed, in sentences.
    """

    name: str
    content: bytes
    columns: Mapping[str, str]
    units: Mapping[str, str]
    notes: tuple[str, ...] = ()


def course_file(step: Exploration, time: np.ndarray, output: np.ndarray) -> CourseFile:
    """A course as a file with the model's columns, as `preisach compensate` reads it.

    Auxiliary columns that the model needs stay at their last values in the record.

    Arguments:
        time: (time,) in s.
        output: (time,) in the unit of the model's output.
    """
    model, record = step.fit.model, step.record
    own = {"time": "t_s", "output": "z"}
    # A number for a name is that of a column, in a file without names.
    columns = {role: own[role] for role in own if re.fullmatch(r"\d*", model.columns[role])}
    names = [columns.get(role) or model.columns[role] for role in own]
    multiplier, divisor = seconds_per(model.units["time"]) or (1.0, 1.0)
    values = [time if "time" in columns else time * divisor / multiplier, output]
    units = {} if "output" in columns else told_units(step)
    notes: list[str] = []
    for name in auxiliary_columns(model.effects):
        last = float(record.aux[name][-1])
        names.append(name)
        values.append(np.full(len(time), last))
        unit = record.channels[name].unit
        notes.append(f"{name} is assumed to stay at {quantity(last, unit)}, its last value")
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(names)
    writer.writerows(zip(*(each.tolist() for each in values), strict=True))
    return CourseFile(MADE, text.getvalue().encode(), columns, units, tuple(notes))


def told_units(step: Exploration) -> dict[str, str]:
    """The unit of the output, where it was told otherwise than the name of its column says it."""
    model = step.fit.model
    own = model.units["output"]
    by_name = split_unit(model.columns["output"])[1]
    return {"output": own} if own and by_name and own != by_name else {}

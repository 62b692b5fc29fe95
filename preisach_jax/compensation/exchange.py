"""The files of a drive: the wanted course as it is read, and the drive as it is written."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import replace

from preisach_jax.compensation.drive import Compensation
from preisach_jax.effects.base import auxiliary_columns
from preisach_jax.errors import InputError
from preisach_jax.model import Model
from preisach_jax.record import Record
from preisach_jax.record.channels import SAMPLES
from preisach_jax.record.columns import NO_CLOCK
from preisach_jax.record.table import Table

COLUMNS = ("t", "u", "z_expected", "z_low", "z_high", "reachable")
"""Columns of a drive's file."""


def drive_csv(found: Compensation) -> bytes:
    """A drive as the text of its file, one row for each row of the course."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    series = (found.time, found.drive, found.expected, found.low, found.high)
    reachable = found.reachable.astype(int)
    writer.writerows(zip(*(values.tolist() for values in (*series, reachable)), strict=True))
    return text.getvalue().encode()


def wanted_course(
    model: Model,
    table: Table,
    name: str,
    *,
    time: str | None = None,
    output: str | None = None,
    aux: Sequence[str] = (),
    rate: float | None = None,
    units: Mapping[str, str] | None = None,
) -> Record:
    """The wanted course in a file, as a record whose output it is.

    Arguments:
        rate: sampling rate in Hz, in place of a column of time.
        units: units by role or column.
    """
    output = output or model.columns["output"]
    own_time = NO_CLOCK if model.units.get("time") == SAMPLES else model.columns["time"]
    time = time or (None if rate is not None else own_time)
    units = dict(units or {})
    if "output" in units:
        units["input"] = units.pop("output")
    else:
        units.pop("input", None)
    if time not in (None, NO_CLOCK) and (own := model.units.get("time")):
        units.setdefault("time", own)
    names = [*aux, *(column for column in auxiliary_columns(model.effects) if column not in aux)]
    # A record has an input without holes: of a course that is its output, which goes by that name
    # in what the reader says of it.
    try:
        course = Record.of_table(
            table,
            name,
            time=time,
            input=output,
            aux=names,
            rate=rate,
            units=units,
            need_output=False,
        )
    except InputError as error:
        said = str(error).replace("--input", "--output")
        raise InputError(said.replace("the input must be", "the wanted output must be")) from error
    if course.torn_row is not None:
        raise InputError(
            f"{table.source}: the last row, {course.torn_row}, breaks off; complete or remove it"
        )
    channels = {**course.channels, "output": course.channels["input"]}
    return replace(course, output=course.input, channels=channels)

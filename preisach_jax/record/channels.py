"""From the columns of a table to the channels of a record: units, values, what was assumed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from preisach_jax.errors import InputError
from preisach_jax.record.checks import check_increasing, check_not_infinite, check_unit_keys
from preisach_jax.record.clock import evenly_spread, is_rounded
from preisach_jax.record.columns import Roles, unit_of
from preisach_jax.record.table import Table
from preisach_jax.record.units import TIME_UNITS, is_known_unit, seconds_per, split_unit

SAMPLES = "samples"
"""Unit of the time of a record without a clock."""

EPOCH_S = 1e8
"""First time, in s, from which on a clock is taken to count from 1970 or the like (three years)."""


_COUNTS = ((1e17, "ns"), (1e14, "us"), (1e11, "ms"))  # since 1970; 1e11 s is the year 5138
_DAYS = (20_000.0, 80_000.0)  # of spreadsheets, since 1900: 1954 to 2119
_SHORT_DAYS = 1e-4  # steps below it would be 10 kHz, if they were seconds


@dataclass(frozen=True)
class Channel:
    """A channel's name in the file, and its unit, `""` where unknown."""

    name: str
    unit: str


def name_channels(
    table: Table, roles: Roles, units: Mapping[str, str] | None
) -> dict[str, Channel]:
    """Name and unit of every channel: told, else stated by the file, else by the name."""
    check_unit_keys(units, ["time", "input", "output", *table.columns], table.source)
    units = units or {}
    chosen = {"time": roles.time, "input": roles.input, "output": roles.output}
    channels: dict[str, Channel] = {}
    for key, column in (*chosen.items(), *((name, name) for name in roles.aux)):
        if column is None:
            channels[key] = Channel("t" if key == "time" else key, units.get(key, ""))
            continue
        unit = unit_of(table, column)
        channels[key] = Channel(column, units.get(key, units.get(column, unit)))
    time = channels["time"]
    if roles.counted:
        channels["time"] = Channel("sample", SAMPLES)
    elif roles.time is None or time.unit == "":
        channels["time"] = Channel(time.name, _epoch_unit(table, roles.time))
    elif seconds_per(time.unit) is None:
        raise InputError(
            f"{table.source}, column {time.name}: {time.unit!r} is no unit of time; it must be one "
            f"of {TIME_UNITS}, give it with --units time=s or the sampling rate with --rate HZ"
        )
    return channels


def _epoch_unit(table: Table, column: str | None) -> str:
    """The unit of a time that states none: seconds, or of counts from 1970 as great as they are."""
    values = None if column is None or table.is_record else table.lenient_numbers(column)
    if values is None or not np.isfinite(values[0]):
        return "s"
    return next((unit for least, unit in _COUNTS if abs(values[0]) >= least), "s")


def _unit_taken(table: Table, column: str, unit: str) -> str:
    """What is told of a time whose unit nothing states."""
    place = f"{table.source}: column {column} states no unit, "
    if unit != "s":
        return f"{place}and its numbers are as great as {unit} since 1970: taken as {unit}"
    values = table.lenient_numbers(column)
    if values is not None and _DAYS[0] < values[0] < _DAYS[1]:
        step = float(np.median(np.diff(values)))
        if 0 < step < _SHORT_DAYS:
            return (
                f"{place}taken as seconds; it begins at {values[0]:.6g} and grows by {step:.2g}: "
                "if these are days, as spreadsheets count them, say --unit time=d"
            )
    return f"{place}taken as seconds"


def read_time(
    table: Table, column: str | None, unit: str, rate: float | None
) -> tuple[np.ndarray, np.ndarray]:
    """(K,) time as in the file, in `unit`, and (K,) in seconds; of the rate without a column.

    Without a rate samples are counted, one a second.

    Seconds count from the first row where the file's count from an epoch such as 1970.
    """
    if column is None and unit == SAMPLES:
        values = np.arange(float(table.rows.size))
        return values, values
    if column is None:
        if rate is None or not np.isfinite(rate) or rate <= 0:
            raise InputError(f"rate is {rate}: give the sampling rate in Hz, above 0")
        values = np.arange(table.rows.size) / rate
        return values, values
    values = table.numbers(
        column, "correct or remove the row, or give the sampling rate with --rate HZ"
    )
    empty = np.flatnonzero(np.isnan(values))
    if empty.size:
        raise InputError(
            f"{table.place(column, empty[0])}: the cell is empty or NaN; fill it in or remove the "
            "row, or give the sampling rate with --rate HZ"
        )
    factors = seconds_per(unit)
    assert factors is not None  # name_channels has refused any other unit
    with np.errstate(over="ignore"):  # an infinite time is refused with its row
        seconds = values * factors[0] / factors[1]
        if _counts_from_an_epoch(table, seconds):
            seconds = table.from_first(column) * factors[0] / factors[1]
    seconds = evenly_spread(seconds)
    check_increasing(seconds, values, lambda k: table.place(column, k))
    return values, seconds


def _counts_from_an_epoch(table: Table, seconds: np.ndarray) -> bool:
    """Whether times of a file are so great that they count from 1970 or another epoch."""
    is_great = bool(np.isfinite(seconds).all() and abs(seconds[0]) >= EPOCH_S)
    return is_great and not table.is_record


def read_input(table: Table, column: str) -> np.ndarray:
    """(K,) float64, finite."""
    return _read_complete(
        table, column, "the input must be known in every row, fill it in or cut the record there"
    )


_LEAST_HELD = 0.05
"""Share of the rows in which an input that never turns must rest, to show more than a curve."""


def check_turns(table: Table, roles: Roles, path: np.ndarray, output: np.ndarray) -> None:
    """Refuse an input that goes one way only: no loop can be known from it."""
    steps: np.ndarray = np.diff(path)
    if (np.any(steps > 0) and np.any(steps < 0)) or not np.ptp(path):
        return
    held = np.count_nonzero(steps == 0) / max(len(steps), 1)
    ways = np.sign(np.diff(output[np.isfinite(output)]))
    if roles.counted and held > 0 and np.any(ways > 0) and np.any(ways < 0):
        raise InputError(
            f"{table.source}: the rows are sorted by the input, column {roles.input}, so that "
            "their order in time is lost, and with it the hysteresis; give the rows as they were "
            "measured"
        )
    if roles.counted or held < _LEAST_HELD:
        raise InputError(
            f"{table.source}: the input, column {roles.input}, never turns in its "
            f"{len(path):,} rows, so that no hysteresis can be seen (a first curve, or a branch of "
            "a loop); record the way back as well, or say which column with --input COL"
        )


def read_aux(table: Table, column: str) -> np.ndarray:
    """(K,) float64, finite."""
    return _read_complete(
        table, column, "an auxiliary column must be known in every row, fill it in or leave it out"
    )


def read_output(table: Table, column: str | None) -> np.ndarray:
    """(K,) float64, NaN where nothing was measured; all NaN without a column."""
    if column is None:
        return np.full(table.rows.shape, np.nan)
    values = table.numbers(
        column, "correct it, or leave the cell empty if the output was not measured there"
    )
    check_not_infinite(values, lambda k: table.place(column, k))
    return values


def assumptions(
    table: Table, roles: Roles, channels: Mapping[str, Channel], units: Mapping[str, str] | None
) -> list[str]:
    """What the user is told: assumptions of the reader, guesses, and the unit of time."""
    notes = list(table.notes)
    if roles.guessed:
        parts = [f"{role} {channels[role].name}" for role in roles.guessed]
        by = "names and units" if table.named else "the places and courses of the columns"
        notes.append(f"{table.source}: guessed from {by}: {', '.join(parts)}")
    notes += roles.said
    if roles.counted and not roles.said:
        notes.append(f"{table.source}: samples are counted; only what needs no clock is tried")
    if roles.time is not None and not (
        {"time", roles.time} & set(units or {})
        or table.units.get(roles.time)
        or split_unit(roles.time)[1]
    ):
        notes.append(_unit_taken(table, roles.time, channels["time"].unit))
    seconds = None if roles.time is None else table.lenient_numbers(roles.time)
    if seconds is not None and is_rounded(seconds):
        equal = int(np.sum(np.diff(seconds) == 0))
        notes.append(
            f"{table.source}: {equal:,} times of column {roles.time} are those of the row before, "
            "as they are rounded; such rows were spread evenly"
        )
    for role in ("input", "output", *roles.aux):
        unit = channels[role].unit
        if not is_known_unit(unit):
            notes.append(
                f"{table.source}: {unit!r}, the unit of column {channels[role].name}, is none that "
                "is known here; values are taken as they stand and shown with it. If it is "
                f"misspelt, say it right with --unit {role}=UNIT"
            )
    if roles.time is not None and (start := _epoch_start(table, roles.time, channels)) is not None:
        notes.append(
            f"{table.source}: column {roles.time} begins at {start:.12g} s, so time counts from "
            "the first row"
        )
    return notes


def _epoch_start(table: Table, column: str, channels: Mapping[str, Channel]) -> float | None:
    """The first time in s where times count from an epoch, else None."""
    values = table.lenient_numbers(column)
    factors = seconds_per(channels["time"].unit)
    if values is None or factors is None:
        return None
    with np.errstate(over="ignore"):
        seconds = values * factors[0] / factors[1]
    return float(seconds[0]) if _counts_from_an_epoch(table, seconds) else None


def _read_complete(table: Table, column: str, remedy: str) -> np.ndarray:
    values = table.numbers(column, "correct or remove the row")
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size:
        what = "the cell is empty or NaN" if np.isnan(values[bad[0]]) else "the value is infinite"
        more = f" ({bad.size} such rows)" if bad.size > 1 else ""
        raise InputError(f"{table.place(column, bad[0])}: {what}{more}; {remedy}")
    return values

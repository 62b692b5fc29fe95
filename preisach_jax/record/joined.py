"""Several records of one machine as one: joined end to end, each a run with a memory of its own."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from preisach_jax.errors import InputError
from preisach_jax.quantity import number, pretty_unit, quantity
from preisach_jax.record.core import Record
from preisach_jax.record.marks import Run

PAUSE = 100
"""Usual time steps between two runs on the joined clock: above what counts as a gap."""

MOST_APART = 20.0
"""Ratio of the time steps of two records beyond which they are not fitted together."""


def as_one(given: Any, hold_out: Any = (), asked_by: str = "fit") -> Record:
    """One record of what a function was given: a record, or several."""
    several, apart = (_listed(each, asked_by) for each in (given, hold_out))
    if not several:
        raise InputError(f"{asked_by} was given no record; pass a Record, or a list of them")
    return several[0] if len(several) == 1 and not apart else joined(several, apart)


def _listed(given: Any, asked_by: str) -> list[Record]:
    records = list(cast(Sequence[Any], given)) if isinstance(given, list | tuple) else [given]
    for one in records:
        if isinstance(one, Record):
            if one.runs and len(records) > 1:
                raise InputError(
                    f"{one.name}: this record is made of several; pass the records themselves"
                )
            continue
        what = type(one).__name__
        remedy = "pass a preisach_jax.Record (Record.load, Record.from_arrays), or a list of them"
        if all(hasattr(one, name) for name in ("time", "input", "output")):
            remedy = "pass Record.from_arrays(s.time, s.input, s.output, aux=s.aux) of it"
            remedy = remedy if hasattr(one, "aux") else remedy.replace(", aux=s.aux", "")
        raise InputError(f"{asked_by} was given a {what}, which is no record; {remedy}")
    return records


def joined(records: Sequence[Record], hold_out: Sequence[Record] = ()) -> Record:
    """Join records end to end on one clock.

    A pause of `PAUSE` usual steps stands between two of them.  Wherever a run starts, every state
    of a model starts anew; nothing that is computed from neighbouring rows reaches across.

    Returns:
        A record whose `runs` say where each of them lies; its `time_values` are their own clocks
        in s.
    """
    everything = [*records, *hold_out]
    _check_alike(everything)
    _check_reach(records, hold_out)
    pause = PAUSE * max(record.step_s for record in everything)
    shifted: list[np.ndarray] = []
    runs: list[Run] = []
    start, shift = 0, float(everything[0].time[0])
    for position, record in enumerate(everything):
        shifted.append(record.time - record.time[0] + shift)
        shift = float(shifted[-1][-1]) + pause
        stop = start + len(record)
        runs.append(
            Run(
                record.name,
                record.sha256,
                start,
                stop,
                float(record.time[0]),
                record.initial_memory,
                position >= len(records),
            )
        )
        start = stop

    def whole(values: Iterable[np.ndarray]) -> np.ndarray:
        return np.concatenate(list(values))

    first, time = everything[0], whole(shifted)
    both = Record.from_arrays(
        time,
        whole(record.input for record in everything),
        whole(record.output for record in everything),
        aux={name: whole(record.aux[name] for record in everything) for name in first.aux},
        name=", ".join(record.name for record in everything),
        initial_memory=first.initial_memory,
    )
    clocks = whole(record.time for record in everything)
    return replace(both, channels=first.channels, runs=tuple(runs), time_values=clocks)


def _check_alike(records: Sequence[Record]) -> None:
    """Refuse records of other columns, units or rates than the first, or given twice."""
    first = records[0]
    for position, record in enumerate(records):
        for other in records[:position]:
            if other.sha256 == record.sha256 and _same_columns(other, record):
                same = "given twice" if other.name == record.name else f"the same as {other.name}"
                raise InputError(f"{record.name}: this record is {same}; give each record once")
        if set(record.aux) != set(first.aux):
            mine, its = (", ".join(each.aux) or "none" for each in (record, first))
            raise InputError(
                f"{record.name}: its auxiliary columns are {mine}, and those of {first.name} are "
                f"{its}; give records of the same columns (--aux)"
            )
        for role in ("input", "output", *first.aux):
            own, other = (each.channels[role] for each in (record, first))
            if own.name != other.name:
                raise InputError(
                    f"{record.name}: the {role} is column {own.name}, and {other.name} in "
                    f"{first.name}; name the columns of all records alike"
                )
            if pretty_unit(own.unit) != pretty_unit(other.unit):
                mine, its = (pretty_unit(each.unit) or "no unit" for each in (own, other))
                raise InputError(
                    f"{record.name}, column {own.name}: its unit is {mine}, and {its} in "
                    f"{first.name}; convert one of them, or state the unit (--unit)"
                )
        if record.has_clock != first.has_clock:
            counted = record if first.has_clock else first
            raise InputError(
                f"{counted.name}: it has no clock, and others have one; give its sampling rate "
                "(--rate), or read all of them without a clock (--time none)"
            )
        ratio = record.step_s / first.step_s
        if not 1 / MOST_APART <= ratio <= MOST_APART:
            mine, its = (f"{number(1 / each.step_s, 4)} Hz" for each in (record, first))
            raise InputError(
                f"{record.name}: it was sampled at {mine}, and {first.name} at {its}; give records "
                f"whose rates are within a factor of {MOST_APART:g}: resample one of them"
            )


def _same_columns(one: Record, other: Record) -> bool:
    if set(one.aux) != set(other.aux):
        return False
    return all(np.array_equal(one.aux[name], other.aux[name]) for name in one.aux)


def _check_reach(records: Sequence[Record], hold_out: Sequence[Record]) -> None:
    """Refuse a record to hold out whose input goes where none of the others does."""
    low = min(float(record.input.min()) for record in records)
    high = max(float(record.input.max()) for record in records)
    reach = 0.01 * (high - low)
    for record in hold_out:
        unit = record.input_unit
        for value in (float(record.input.min()), float(record.input.max())):
            if not low - reach <= value <= high + reach:
                ends = f"{number(low)} to {quantity(high, unit)}"
                raise InputError(
                    f"{record.name}: its input reaches {quantity(value, unit)}, and the records "
                    f"that are fitted span {ends}; hold out a record within it"
                )


@dataclass(frozen=True)
class RunErrors:
    """What a model leaves of one of several records, in output units.

    Attributes:
        record: the record's name.
        sha256: digest of its values.
        rows: its number of rows.
        held_out: whether all of them are held out.
        rms_identification: RMS error on its rows that identify; NaN if there are none.
        rms_validation: RMS error on its rows that are held out; NaN if there are none.
        mean_validation: mean error there.
        max_abs_validation: greatest error there.
    """

    record: str
    sha256: str
    rows: int
    held_out: bool
    rms_identification: float
    rms_validation: float
    mean_validation: float
    max_abs_validation: float


def errors_by_run(
    record: Record, residual: np.ndarray, identification: np.ndarray, validation: np.ndarray
) -> tuple[RunErrors, ...]:
    """What a model leaves of each of several records that were joined."""
    found: list[RunErrors] = []
    for run in record.runs:
        left = residual[run.rows]
        fitted, others = left[identification[run.rows]], left[validation[run.rows]]
        found.append(
            RunErrors(
                run.name,
                run.sha256,
                run.stop - run.start,
                run.held_out,
                _rms(fitted),
                _rms(others),
                float(np.mean(others)) if len(others) else np.nan,
                float(np.max(np.abs(others))) if len(others) else np.nan,
            )
        )
    return tuple(found)


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else np.nan


def parts_of(record: Record) -> list[Record]:
    """The runs of a record, each a record of its own on the joined clock; itself without runs."""
    return [_part(record, run) for run in record.runs] or [record]


def without_rows(record: Record, kept: np.ndarray) -> Record:
    """Some samples of a record, with what was left out of it forgotten; its jumps are kept."""
    edges = [(run.start, run.stop) for run in record.runs]
    moved = np.searchsorted(kept, np.array(edges, dtype=int).reshape(-1, 2)).tolist()
    return replace(
        record,
        time=record.time[kept],
        input=record.input[kept],
        output=record.output[kept],
        aux={name: values[kept] for name, values in record.aux.items()},
        time_values=record.time_values[kept],
        spikes={},
        input_spikes={},
        faults=(),
        jumps={int(np.searchsorted(kept, row)): jump for row, jump in record.jumps.items()},
        runs=tuple(
            replace(run, start=start, stop=stop)
            for run, (start, stop) in zip(record.runs, moved, strict=True)
        ),
    )


def last_fitted(record: Record) -> Record:
    """The last run that is not held out, as it was given; the record itself if it has no runs."""
    fitted = [run for run in record.runs if not run.held_out]
    if not fitted:
        return record
    run = fitted[-1]
    part = _part(record, run)
    time = part.time_values
    name = f"{run.name}, the last of {len(fitted)} records" if len(fitted) > 1 else run.name
    return replace(part, name=name, time=time, sha256=run.sha256)


def _part(record: Record, run: Run) -> Record:
    part = record.part(run.start, run.stop)
    jumps = {row - run.start: jump for row, jump in record.jumps.items() if row in run}
    return replace(part, name=run.name, initial_memory=run.initial_memory, jumps=jumps)


def by_run(record: Record, find: Callable[..., np.ndarray], *along: np.ndarray) -> np.ndarray:
    """What is found row by row in each run alone."""
    if not record.runs:
        return find(record, *along)
    parts = zip(parts_of(record), record.runs, strict=True)
    return np.concatenate(
        [find(part, *(values[run.rows] for values in along)) for part, run in parts]
    )

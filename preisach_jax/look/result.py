"""What a look at a record finds: columns, sampling, excitation, blemishes, prospects."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from preisach_jax.look import stretches
from preisach_jax.look.prospects import Excitation, Prospect, prospects, rate_text
from preisach_jax.quantity import quantity
from preisach_jax.record import Record
from preisach_jax.record.columns import unit_of, why
from preisach_jax.record.faults import faults
from preisach_jax.record.reading import read_table
from preisach_jax.record.spans import spans
from preisach_jax.record.spikes import WINDOW, gross_spikes, input_spikes, isolated_spikes
from preisach_jax.record.table import Table
from preisach_jax.rows import holes

MOST_COLUMNS = 40
"""Columns of a file that are shown one by one."""

SPIKE_SHARE = 0.3
"""Share of a spike's height that the samples beside it must have to be part of it."""

SHARPER = 2.0
"""Times the steps of the course just before and after a spike that it rises and falls by."""

UNEVEN = 0.05
"""Jitter, as a share of the step, from which on it is told."""


@dataclass(frozen=True)
class ColumnView:
    """A column of a file: its role, `""` if none, why, its unit, and what it holds."""

    name: str
    role: str
    why: str
    unit: str
    kind: str
    low: float | None
    high: float | None


@dataclass(frozen=True, eq=False)
class Look:
    """What a record holds and can tell, before any fit.

    Attributes:
        record: the measurement.
        excitation: what its input does: turns, rests, strokes; noise and steps of the readings.
        output_spikes, input_spikes: rows that stand out alone.
        stuck: where the output keeps a value while the input moves on.
        clipped: where it is at the end of its sensor's range.
        wrapped: where its counter has wrapped.
        prospects: what the record can tell of each effect.
        columns: the columns of the file, where it was made of one.
        notes: what was guessed and assumed.
    """

    record: Record
    excitation: Excitation
    output_spikes: np.ndarray
    input_spikes: np.ndarray
    stuck: tuple[stretches.Stretch, ...]
    clipped: tuple[stretches.Stretch, ...]
    wrapped: tuple[stretches.Stretch, ...]
    prospects: tuple[Prospect, ...]
    columns: tuple[ColumnView, ...] = ()
    notes: tuple[str, ...] = ()

    @cached_property
    def can_tell(self) -> tuple[str, ...]:
        """Names of the effects that the record shows well, if they are there."""
        return tuple(each.effect for each in self.prospects if each.grade == "well")

    @cached_property
    def cannot_tell(self) -> tuple[str, ...]:
        """Names of the effects of which it says nothing."""
        return tuple(each.effect for each in self.prospects if each.grade == "not at all")

    def record_next(self) -> list[str]:
        """What to record besides, the most useful first, each once."""
        wanted = [each.remedy for each in self.prospects if each.remedy]
        return sorted(dict.fromkeys(wanted), key=lambda text: -wanted.count(text))

    def rows(self) -> list[tuple[str, str]]:
        """What it found, as a name and a text each."""
        return [*_sampling(self.record), *_drive(self.excitation), *_readings(self)]

    def plot(self) -> Any:
        """The record as a figure: input and output over time with what was found, and the loop.

        Returns:
            A `matplotlib.figure.Figure`.
        """
        from preisach_jax.plot.look import first_look

        return first_look(self)

    def to_json(self) -> dict[str, Any]:
        """The content of `--json`."""
        record, found = self.record, self.excitation
        low, high = found.rates
        return {
            "record": {"name": record.name, "sha256": record.sha256, "rows": len(record)},
            "columns": [asdict(column) for column in self.columns],
            "channels": {
                role: {"column": channel.name, "unit": channel.unit}
                for role, channel in record.channels.items()
            },
            "notes": list(self.notes),
            "sampling": {
                "duration_s": record.duration_s,
                "step_s": record.step_s,
                "rate_hz": 1 / record.step_s,
                "jitter": record.jitter,
                "gaps": [{"row": row, "length_s": length} for row, length in record.gaps],
                "unmeasured": int((~record.measured).sum()),
            },
            "input": {
                "low": float(record.input.min()),
                "high": float(record.input.max()),
                "step": found.input_step,
                "reversals": len(found.turns),
                "rates": {
                    "slowest": low if found.strokes else None,
                    "fastest": high if found.strokes else None,
                    "decades": found.decades,
                },
                "holds": [asdict(rest) for rest in found.rests],
                "repeats": found.repeats(),
                "minor_loop_biases": found.biases(),
                "spikes": self.input_spikes.tolist(),
            },
            "output": {
                "low": float(np.nanmin(record.output)),
                "high": float(np.nanmax(record.output)),
                "step": found.output_step,
                "noise_rms": found.noise,
                "spikes": self.output_spikes.tolist(),
                "stuck": [asdict(each) for each in self.stuck],
                "clipped": [asdict(each) for each in self.clipped],
                "wrapped": [asdict(each) for each in self.wrapped],
            },
            "prospects": [asdict(each) for each in self.prospects],
            "can_tell": list(self.can_tell),
            "cannot_tell": list(self.cannot_tell),
            "record_next": self.record_next(),
        }


def look(
    record: Record | str | os.PathLike[str],
    *,
    effects: Sequence[str] | None = None,
    columns: Sequence[ColumnView] = (),
    notes: Sequence[str] = (),
) -> Look:
    """Look at a record before any fit: sampling, excitation, blemishes, and what it can tell.

    Arguments:
        record: the measurement, or a file, whose columns are guessed.
        effects: names of the effects to judge; all of the library by default.
        columns: the columns of the file it was made of, as `columns_of` gives them.
        notes: what was guessed and assumed when it was read.

    Returns:
        What was found; `plot()` draws it, `to_json()` has the numbers.

    Raises:
        InputError: the input or the output is constant, or too little was measured.

    Example:
        >>> t = np.arange(3000) / 100
        >>> u = np.abs((t % 4) - 2)
        >>> found = look(Record.from_arrays(t, u, u**1.1, units={"input": "V"}))
        >>> len(found.excitation.turns), found.excitation.repeats(), "creep" in found.cannot_tell
        (14, 7, True)
    """
    if not isinstance(record, Record):
        return look_at_file(record)
    record.check_identifiable()
    gross = gross_spikes(record)
    of_input = input_spikes(record)
    clean = record.without(gross)
    course = _interpolated(clean)
    smooth = scipy.ndimage.median_filter(course, WINDOW, mode="nearest")
    turning = stretches.turns(clean.bridged(of_input))
    alone = isolated_spikes(clean, smooth) & ~_at_turns(clean, turning)
    alone &= _as_high_as_beside(np.abs(course - smooth), alone)
    alone = _sharper_than_around(course, alone)
    clean = clean.without(alone).bridged(of_input)
    still = stretches.rests(clean)
    sick = faults(clean)
    excitation = Excitation(
        clean,
        turning,
        tuple(still),
        tuple(stretches.strokes(clean, turning, still)),
        stretches.noise_rms(clean.output),
        stretches.resolution(clean.output),
        stretches.resolution(clean.input),
    )
    return Look(
        record,
        excitation,
        np.flatnonzero(gross | alone),
        np.flatnonzero(of_input),
        stretches.at_fault(clean, "stuck", sick),
        stretches.at_fault(clean, "clipped", sick),
        stretches.at_fault(clean, "wrapped", sick),
        prospects(excitation, None if effects is None else tuple(effects)),
        tuple(columns),
        tuple(notes),
    )


def look_at_table(table: Table, name: str, **options: Any) -> Look:
    """Look at the record in the columns of a file.

    Arguments:
        table: the columns.
        name: what reports call the record.
        options: `time`, `input`, `output`, `aux`, `rate`, `units`, `initial_memory` as for
            `Record.load`.

    Returns:
        What was found.

    Raises:
        InputError: a column cannot be used; `QuestionError` where it is not clear which is which.
    """
    notes: list[str] = []
    record = Record.of_table(table, name, announce=notes.append, **options)
    chosen = {role: channel.name for role, channel in record.channels.items()}
    told = [role for role in ("time", "input", "output") if options.get(role)]
    roles = {role if role in ("time", "input", "output") else "aux": column
             for role, column in chosen.items()}  # fmt: skip
    return look(record, columns=columns_of(table, roles, told), notes=notes)


def look_at_file(path: str | os.PathLike[str], **options: Any) -> Look:
    """Look at the record in a file; see `look_at_table`."""
    return look_at_table(read_table(path), Path(path).name, **options)


def _as_high_as_beside(height: np.ndarray, found: np.ndarray) -> np.ndarray:
    """(K,) bool: rows that stand out nearly as much as any beside them.

    A running median that passes a spike by on a slope is off by a little around it.
    """
    beside = scipy.ndimage.maximum_filter1d(np.where(found, height, 0.0), 2 * WINDOW + 1)
    return height > SPIKE_SHARE * np.asarray(beside)


def _sharper_than_around(course: np.ndarray, found: np.ndarray) -> np.ndarray:
    """(K,) bool: of the stretches found, those that begin and end with a jump.

    The peak of a fast course rises over some samples, of which its step is one among equals.
    """
    kept = np.zeros_like(found)
    for start, stop in spans(found):
        if start < 2 or stop > len(course) - 2:
            continue
        before, into = np.abs(np.diff(course[start - 2 : start + 1]))
        out, after = np.abs(np.diff(course[stop - 1 : stop + 2]))
        kept[start:stop] = into > SHARPER * before and out > SHARPER * after
    return kept


def _at_turns(record: Record, turning: np.ndarray) -> np.ndarray:
    """(K,) bool: rows beside turns and jumps of the input, where the output may well jump."""
    steps = np.abs(np.diff(record.input, prepend=record.input[:1]))
    jumps = steps > 10 * np.median(steps)
    jumps[turning] = True
    return np.asarray(scipy.ndimage.binary_dilation(jumps, iterations=WINDOW))


def _interpolated(record: Record) -> np.ndarray:
    """(K,) output with straight lines where nothing was measured."""
    there = record.measured
    return np.interp(record.time, record.time[there], record.output[there])


def columns_of(
    table: Table, chosen: Mapping[str, str], told: Sequence[str] = ()
) -> list[ColumnView]:
    """The columns of a file with their roles and why.

    Arguments:
        table: the columns.
        chosen: the column of each role, as far as known.
        told: roles that the user named.
    """
    roles = {column: role for role, column in chosen.items()}
    views: list[ColumnView] = []
    for name in list(table.columns)[:MOST_COLUMNS]:
        role = roles.get(name, "")
        values = table.lenient_numbers(name)
        finite = values[np.isfinite(values)] if values is not None else np.empty(0)
        kind = "numbers"
        if values is None:
            kind = "text"
        elif not finite.size:
            kind = "empty"
        elif np.all(finite == finite[0]):
            kind = "constant"
        reason = "you named it" if role in told else why(table, role, name) if role else ""
        low, high = (float(finite.min()), float(finite.max())) if finite.size else (None, None)
        views.append(ColumnView(name, role, reason, unit_of(table, name), kind, low, high))
    if table.left_aside:
        views += [ColumnView(name, "", why_not, "", "left aside", None, None)
                  for name, why_not in list(table.left_aside.items())[:MOST_COLUMNS]]  # fmt: skip
    return views


def _sampling(record: Record) -> list[tuple[str, str]]:
    step = record.step_s
    rate = quantity(1 / step, "Hz", 4) if step <= 1 else f"one every {quantity(step, 's', 4)}"
    even = "evenly" if record.jitter < UNEVEN else f"with {100 * record.jitter:.0f} % of jitter"
    length = f"{len(record):,} rows over {quantity(record.duration_s, 's', 4)}"
    rows = [("sampling", f"{length}, {rate} {even}")]
    return rows + [("missing", text) for text in holes(replace(record, spikes={}))]


def _drive(found: Excitation) -> list[tuple[str, str]]:
    record = found.record
    unit = record.input_unit
    low, high = record.input.min(), record.input.max()
    rows = [("input", f"{quantity(low, unit, 3)} to {quantity(high, unit, 3)}")]
    kinds = f"{len(found.turns):,} reversals"
    if found.period and len(record) // found.period > 1:
        seconds = quantity(found.period * record.step_s, "s", 3)
        kinds += f"; the input repeats itself every {seconds}, {len(record) // found.period} times"
    elif found.repeats() > 1:
        kinds += f"; the most frequent loop comes {found.repeats():,} times"
    if places := found.biases():
        kinds += f"; minor loops at {places} place{'s' * (places > 1)}"
    rows.append(("loops", kinds))
    slowest, fastest = found.rates
    if found.strokes:
        span = rate_text(fastest, unit)
        if found.decades >= 0.1:
            span = f"{rate_text(slowest, unit)} to {span}, {found.decades:.1f} decades"
        samples = f"the fastest stroke takes {found.fastest_samples:.0f} samples"
        rows.append(("rates", f"{span}; {samples}"))
    lengths = [rest.length_s for rest in found.rests]
    if lengths:
        total = quantity(sum(lengths), "s", 3)
        each = f"{quantity(min(lengths), 's', 3)} to {quantity(max(lengths), 's', 3)}"
        text = f"{len(lengths):,} of {each}, {total} in all"
        rows.append(("rests", text if len(lengths) > 1 else f"one of {total}"))
    else:
        rows.append(("rests", "none: the input never keeps still"))
    return rows


def _readings(found: Look) -> list[tuple[str, str]]:
    excitation, record = found.excitation, found.excitation.record
    unit = record.output_unit
    low, high = np.nanmin(record.output), np.nanmax(record.output)
    share = 100 * excitation.noise / record.output_range
    rows = [("output", f"{quantity(low, unit, 3)} to {quantity(high, unit, 3)}")]
    if excitation.noise > 0:
        # The third differences of a course that bends within a few samples look like noise.
        is_fast = len(excitation.turns) > len(record) / 40
        size = f"{'at most ' if is_fast else ''}{quantity(excitation.noise, unit, 2)} RMS"
        rows.append(("noise", f"{size} ({share:.2g} % of stroke)"))
    else:
        rows.append(("noise", "none above the last digit"))
    steps = [
        f"{side} in steps of {quantity(step, its_unit, 3)}"
        for side, step, its_unit in (
            ("input", excitation.input_step, record.input_unit),
            ("output", excitation.output_step, unit),
        )
        if step > 0
    ]
    if steps:
        rows.append(("converters", ", ".join(steps)))
    for name, spikes in (("output", found.output_spikes), ("input", found.input_spikes)):
        if spikes.size:
            some = ", ".join(f"{row + 1:,}" for row in spikes[:3])
            more = f" and {spikes.size - 3:,} more" if spikes.size > 3 else ""
            rows.append((f"spikes of the {name}", f"{spikes.size:,}: sample {some}{more}"))
    for name, where in (
        ("sticks", found.stuck),
        ("clipped", found.clipped),
        ("wrapped", found.wrapped),
    ):
        if where:
            longest = max(where, key=lambda each: each.stop - each.start)
            begin, length = (quantity(s, "s", 3) for s in (longest.begin_s, longest.length_s))
            text = f"for {length} from {begin} on at {quantity(longest.level, unit, 3)}"
            more = f", the longest of {len(where):,} stretches" if len(where) > 1 else ""
            rows.append((f"output {name}", text + more))
    return rows

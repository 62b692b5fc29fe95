"""What a look at a record finds: columns, sampling, excitation, blemishes, prospects."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from preisach_jax.hooks import HOOKS
from preisach_jax.look import stretches
from preisach_jax.look.columns import ColumnView
from preisach_jax.look.prospects import Excitation, Prospect, rate_text
from preisach_jax.quantity import quantity
from preisach_jax.record.blemishes import holes
from preisach_jax.record.core import Record
from preisach_jax.record.samples import without_hysteresis

UNEVEN = 0.05
"""Jitter, as a share of the step, from which on it is told."""


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
        records: name and rows of every record of the file; one of it alone.
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
    records: tuple[dict[str, Any], ...] = ()

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

    @cached_property
    def _without_hysteresis(self) -> str:
        return without_hysteresis(self.record)

    def rows(self) -> list[tuple[str, str]]:
        """What it found, as a name and a text each."""
        rows = [*_sampling(self.record), *_drive(self.excitation), *_readings(self)]
        none = self._without_hysteresis
        return rows + [("hysteresis", none.removeprefix("no hysteresis: "))] * bool(none)

    def clock(self) -> dict[str, Any]:
        """Of what kind the clock is: a column, a rate or none; which column, and its unit."""
        channel = self.record.channels["time"]
        by_column = any(view.role == "time" for view in self.columns)
        kind = "none" if not self.record.has_clock else "column" if by_column else "rate"
        return {
            "kind": kind,
            "column": channel.name if by_column else None,
            "unit": channel.unit if self.record.has_clock else None,
        }

    def plot(self) -> Any:
        """The record as a figure: input and output over time with what was found, and the loop.

        Returns:
            A `matplotlib.figure.Figure`.
        """
        return HOOKS["Look.plot"](self)

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
            "clock": self.clock(),
            "records": list(self.records),
            "hysteresis": self._without_hysteresis or None,
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
                "repeats": found.repeats,
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


def _time(record: Record, seconds: float, digits: int = 3) -> str:
    """A time in words; without a clock samples."""
    return quantity(seconds, "s", digits) if record.has_clock else f"{seconds:,.0f} samples"


def _sampling(record: Record) -> list[tuple[str, str]]:
    missing = [("missing", text) for text in holes(replace(record, spikes={}))]
    if not record.has_clock:
        cycles = float(np.sum(np.abs(np.diff(record.input)))) / (2 * record.input_range)
        counted = f"{len(record):,} rows, counted: there is no clock; {cycles:.3g} cycles by the "
        return [("sampling", f"{counted}path of the input"), *missing]
    step = record.step_s
    rate = quantity(1 / step, "Hz", 4) if step <= 1 else f"one every {quantity(step, 's', 4)}"
    even = "evenly" if record.jitter < UNEVEN else f"with {100 * record.jitter:.0f} % of jitter"
    length = f"{len(record):,} rows over {quantity(record.duration_s, 's', 4)}"
    rows = [("sampling", f"{length}, {rate} {even}")]
    return rows + missing


def _drive(found: Excitation) -> list[tuple[str, str]]:
    record = found.record
    unit = record.input_unit
    low, high = record.input.min(), record.input.max()
    rows = [("input", f"{quantity(low, unit, 3)} to {quantity(high, unit, 3)}")]
    kinds = f"{len(found.turns):,} reversals"
    if found.period and len(record) // found.period > 1:
        seconds = _time(record, found.period * record.step_s)
        kinds += f"; the input repeats itself every {seconds}, {len(record) // found.period} times"
    elif found.repeats > 1:
        kinds += f"; the most frequent loop occurs {found.repeats:,} times"
    if places := found.biases():
        kinds += f"; minor loops at {places} place{'s' * (places > 1)}"
    rows.append(("loops", kinds))
    slowest, fastest = found.rates
    if found.strokes and record.has_clock:
        span = rate_text(fastest, unit)
        if found.decades >= 0.1:
            span = f"{rate_text(slowest, unit)} to {span}, {found.decades:.1f} decades"
            span += " (nine of ten strokes)"
        samples = f"the fastest stroke takes {found.fastest_samples:.0f} samples"
        rows.append(("rates", f"{span}; {samples}"))
    lengths = [rest.length_s for rest in found.rests]
    if lengths:
        total = _time(record, sum(lengths))
        each = f"{_time(record, min(lengths))} to {_time(record, max(lengths))}"
        text = f"{len(lengths):,} of {each}, {total} in all"
        rows.append(("rests", text if len(lengths) > 1 else f"one of {total}"))
    else:
        rows.append(("rests", "none: the input never rests"))
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
            begin, length = (_time(record, s) for s in (longest.begin_s, longest.length_s))
            text = f"for {length} from {begin} on at {quantity(longest.level, unit, 3)}"
            more = f", the longest of {len(where):,} stretches" if len(where) > 1 else ""
            rows.append((f"output {name}", text + more))
    return rows

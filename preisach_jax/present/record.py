"""A record as rows of texts with units, and as HTML."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING

from preisach_jax.present import html
from preisach_jax.quantity import number, pretty_unit, quantity, scaled

if TYPE_CHECKING:
    from preisach_jax.record import Record


def record_lines(record: Record, notes: Iterable[str]) -> list[str]:
    """What was read in a line, then what was guessed about it and what is missing."""
    from preisach_jax.record.blemishes import holes

    parts: list[str] = []
    for role, channel in record.channels.items():
        name = channel.name if role == channel.name else f"{role} {channel.name}"
        parts.append(f"{name} ({pretty_unit(channel.unit) or 'no unit'})")
    return [f"{record.line}; {', '.join(parts)}", *notes, *holes(record)]


def column_rows(record: Record) -> list[tuple[str, str, str, str, str]]:
    """The columns of a record: role, name in the file, unit, least and greatest value."""
    measured = record.output[record.measured]
    values = {"time": record.time, "input": record.input, "output": measured, **record.aux}
    rows: list[tuple[str, str, str, str, str]] = []
    for role, channel in record.channels.items():
        there = values[role]
        unit = channel.unit if role != "time" or not record.has_clock else "s"
        low, high = (there.min(), there.max()) if there.size else (math.nan, math.nan)
        factor, shown = scaled(max(abs(low), abs(high)), unit)
        least, most = (number(float(factor * end)) for end in (low, high))
        rows.append((role, channel.name, shown or "unknown", least, most))
    return rows


def span_rows(record: Record) -> list[tuple[str, str]]:
    """How many rows, how long, how great, and from which state."""
    measured = int(record.measured.sum())
    rows = f"{len(record.time):,}"
    if measured < len(record.time):
        rows += f", {measured:,} of them with a measured output"
    if not record.has_clock:
        return [
            ("rows", f"{rows}, counted: there is no clock"),
            ("stroke", quantity(record.output_range, record.output_unit)),
            ("state at the first sample", record.initial_memory),
        ]
    length = f"{number(record.duration_s)} s"
    length = f"up to {length} each" if record.runs else length
    return [
        ("rows", rows),
        ("duration", f"{length}, step {quantity(record.step_s, 's')}"),
        ("stroke", quantity(record.output_range, record.output_unit)),
        ("state at the first sample", record.initial_memory),
    ]


def _run_rows(record: Record) -> list[tuple[str, str]]:
    """Name and digest of a record, or of each of several."""
    if not record.runs:
        return [("data", record.name), ("SHA-256 of its values", record.sha256)]
    rows: list[tuple[str, str]] = []
    for run in record.runs:
        held_out = ", held out" if run.held_out else ""
        rows.append(("data", f"{run.name}, {run.stop - run.start:,} rows{held_out}"))
        rows.append(("SHA-256 of its values", run.sha256))
    return rows


def record_rows(record: Record) -> list[tuple[str, str]]:
    """What a record holds: columns, rows, duration and stroke."""
    columns: list[str] = []
    for role, channel in record.channels.items():
        unit = pretty_unit(channel.unit)
        name = role if role == channel.name else f"{role} {channel.name}"
        columns.append(f"{name} in {unit}" if unit else f"{name} (unit unknown)")
    return [*_run_rows(record), ("columns", "; ".join(columns)), *span_rows(record)]


def as_html(record: Record) -> str:
    """Columns with units and ranges, duration, gaps and missing outputs, for notebooks."""
    from preisach_jax.record.blemishes import holes

    return html.block(
        html.heading(record.line),
        html.table(("", "column", "unit", "from", "to"), column_rows(record), numbers_from=3),
        html.table((), span_rows(record)),
        *map(html.sentence, holes(record)),
    )

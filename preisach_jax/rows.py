"""What results say, as rows of texts with units: for pages, terminals and notebooks alike.

Only the types of the results are known here, so that the results themselves can show their rows.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Protocol

from preisach_jax.quantity import interval, number, pretty_unit, quantity, scaled

if TYPE_CHECKING:
    from preisach_jax.diagnosis.result import Diagnosis, Finding
    from preisach_jax.model import Model, ParameterEstimate
    from preisach_jax.record import Record
    from preisach_jax.record.joined import RunErrors

_HEADLINES = {
    "adequate": "Nothing is missing",
    "explained": "The missing effect is found",
    "partly_explained": "An effect is found, and something remains",
    "unexplained": "Something is missing, and nothing that was tried explains it",
}


def headline(found: Diagnosis) -> str:
    """The verdict of a diagnosis in a few words."""
    if found.verdict == "adequate" and found.next_experiment is not None:
        return "Nothing is seen to be missing, and this record could hardly show it"
    several = len(found.effects) > 1 and found.verdict == "explained"
    return "The missing effects are found" if several else _HEADLINES[found.verdict]


class Errors(Protocol):
    """What a model leaves of a record: a fit, or a rung of a ladder."""

    @property
    def effects(self) -> tuple[str, ...]: ...
    @property
    def rms_identification(self) -> float: ...
    @property
    def rms_validation(self) -> float: ...
    @property
    def max_abs_validation(self) -> float: ...
    @property
    def fit_percent(self) -> float: ...


def model_name(effects: Iterable[str]) -> str:
    """A model by its effects."""
    return " + ".join(("Preisach model", *effects))


def error_rows(models: Sequence[Errors], record: Record) -> list[dict[str, str]]:
    """Errors of models of one record as texts: one row a model, in one common unit."""
    greatest = max(model.rms_validation for model in models)
    factor, unit = scaled(greatest, record.output_unit)
    rows: list[dict[str, str]] = []
    for model in models:
        rows.append(
            {
                "model": model_name(model.effects),
                "rms_identification": number(factor * model.rms_identification),
                "rms_validation": number(factor * model.rms_validation),
                "max_abs_validation": number(factor * model.max_abs_validation),
                "percent_of_stroke": number(100 * model.rms_validation / record.output_range, 3),
                "fit_percent": f"{model.fit_percent:.2f}",
                "unit": unit,
            }
        )
    return rows


def ladder_rows(found: Diagnosis) -> list[dict[str, str]]:
    """The ladder as texts: one row a model, errors in one common unit."""
    return error_rows(found.ladder, found.base.record)


def error_table(
    models: Sequence[Errors], record: Record
) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Headers with units, and the rows of `error_rows` below them."""
    rows = error_rows(models, record)
    unit = f" ({rows[0]['unit']})" if rows[0]["unit"] else ""
    columns = {
        "model": "model",
        "rms_validation": f"held-out RMS{unit}",
        "percent_of_stroke": "% of stroke",
        "max_abs_validation": f"largest{unit}",
        "fit_percent": "fit %",
    }
    return tuple(columns.values()), [tuple(row[key] for key in columns) for row in rows]


RUN_HEADERS = ("record", "rows", "identified RMS", "held-out RMS", "% of stroke", "largest", "mean")


def run_table(
    errors: Sequence[RunErrors], record: Record
) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Headers, and one row a record of several, with what a model leaves of it; else no rows."""
    if not errors:
        return (), []
    finite = [each.rms_validation for each in errors if math.isfinite(each.rms_validation)]
    factor, unit = scaled(max(finite), record.output_unit)
    shown = f" ({unit})" if unit else ""

    def text(value: float, digits: int = 4) -> str:
        return number(value, digits) if math.isfinite(value) else "-"

    rows = [
        (
            f"{each.record} (held out)" if each.held_out else each.record,
            f"{each.rows:,}",
            text(factor * each.rms_identification),
            text(factor * each.rms_validation),
            text(100 * each.rms_validation / record.output_range, 3),
            text(factor * each.max_abs_validation),
            text(factor * each.mean_validation, 2),
        )
        for each in errors
    ]
    lacking = ("record", "rows", "% of stroke")
    return tuple(h if h in lacking else h + shown for h in RUN_HEADERS), rows


def run_lines(errors: Sequence[RunErrors], unit: str) -> list[str]:
    """What a model leaves of each of several records, a line each."""
    lines: list[str] = []
    for each in errors:
        name = f"{each.record} ({each.rows:,} rows)"
        if not math.isfinite(each.rms_validation):
            lines.append(f"{name}: identification error {each.rms_identification:.4g} {unit} RMS")
            continue
        kind = ", all of it" if each.held_out else ""
        lines.append(
            f"{name}: held-out error{kind} {each.rms_validation:.4g} {unit} RMS, "
            f"{each.max_abs_validation:.4g} {unit} at most, mean {each.mean_validation:.2g} {unit}"
        )
    return lines


def limit_rows(found: Diagnosis) -> list[tuple[str, str]]:
    """Effects that were not found, and how great they could be (95 %)."""
    return [(limit.effect, limit.text(found.budget.unit)) for limit in found.limits]


def budget_rows(found: Diagnosis) -> list[tuple[str, str, str]]:
    """The error budget: what, how much, and where the number is from."""
    budget = found.budget
    rest = "what none of these explains"
    steps = [
        (f"of it, steps of the {side}", quantity(rms, budget.unit, 3), source)
        for side, rms, source in (
            ("input", budget.input_quantisation, "at most: it may have been recorded in them"),
            ("output", budget.output_quantisation, "a step over √12"),
        )
        if rms > 0
    ]
    return [
        ("noise", quantity(budget.noise, budget.unit, 3), "unpredictable between samples"),
        *steps,
        (
            "discretisation",
            quantity(budget.discretisation, budget.unit, 3),
            "the cells of the plane, from a finer or coarser one",
        ),
        (
            "memory",
            quantity(budget.memory, budget.unit, 3),
            "cells seldom visited: what the rows held out would have told",
        ),
        ("unexplained", quantity(budget.unexplained, budget.unit, 3), rest),
        (
            "together",
            quantity(found.ladder[-1].rms_validation, budget.unit, 3),
            "held-out error of the final model (the squares add up)",
        ),
    ]


MOST_SHOWN = 8
"""Parameters of one finding that are shown; the model file has all."""


def parameter_rows(
    parameters: Mapping[str, ParameterEstimate], all_in: str = "model.json"
) -> list[tuple[str, str]]:
    """Parameters with their 95 % intervals, as texts; of many the first few, and where all are."""
    rows = [(name, interval(e.value, e.low, e.high, e.unit)) for name, e in parameters.items()]
    if len(rows) <= MOST_SHOWN:
        return rows
    few = MOST_SHOWN // 2
    return [*rows[:few], (f"and {len(rows) - few} more", f"in {all_in}")]


def finding_parameters(finding: Finding) -> list[tuple[str, str]]:
    """The parameters of a finding with their intervals, as texts."""
    return parameter_rows(finding.parameters)


def finding_rows(findings: Iterable[Finding]) -> list[tuple[str, str, str, str]]:
    """What was found: effect, what cannot be told from it, parameter, value with interval."""
    rows: list[tuple[str, str, str, str]] = []
    for finding in findings:
        effect, others = finding.effect, ", ".join(finding.family[1:]) or "nothing"
        for parameter, value in finding_parameters(finding) or [("", "")]:
            rows.append((effect, others, parameter, value))
            effect = others = ""
    return rows


def record_line(record: Record) -> str:
    """A record in one line: name, rows, duration."""
    if record.runs:
        longest = quantity(record.duration_s, "s")
        return f"{record.name}: {len(record):,} rows of {len(record.runs)} records, up to {longest}"
    return f"{record.name}: {len(record):,} rows, {quantity(record.duration_s, 's')}"


def record_lines(record: Record, notes: Iterable[str]) -> list[str]:
    """What was read in a line, then what was guessed about it and what is missing."""
    parts: list[str] = []
    for role, channel in record.channels.items():
        name = channel.name if role == channel.name else f"{role} {channel.name}"
        parts.append(f"{name} ({pretty_unit(channel.unit) or 'no unit'})")
    return [f"{record_line(record)}; {', '.join(parts)}", *notes, *holes(record)]


def column_rows(record: Record) -> list[tuple[str, str, str, str, str]]:
    """The columns of a record: role, name in the file, unit, least and greatest value."""
    measured = record.output[record.measured]
    values = {"time": record.time, "input": record.input, "output": measured, **record.aux}
    rows: list[tuple[str, str, str, str, str]] = []
    for role, channel in record.channels.items():
        there = values[role]
        unit = channel.unit if role != "time" else "s"
        low, high = (there.min(), there.max()) if there.size else (math.nan, math.nan)
        factor, shown = scaled(max(abs(low), abs(high)), unit)
        least, most = (number(float(factor * end)) for end in (low, high))
        rows.append((role, channel.name, shown or "unknown", least, most))
    return rows


def holes(record: Record) -> list[str]:
    """What is missing in a record, in words: stretches of time, and outputs."""
    found: list[str] = []
    if record.gaps:
        row, seconds = max(record.gaps, key=lambda gap: gap[1])
        others = f", and {len(record.gaps) - 1} shorter ones" if len(record.gaps) > 1 else ""
        found.append(f"a gap of {quantity(seconds, 's', 3)} before sample {row + 1:,}{others}")
    if unmeasured := int((~record.measured).sum()) - left_out(record):
        found.append(f"{unmeasured:,} samples without a measured output: history of the input only")
    if record.torn_row is not None:
        found.append(torn_line(record))
    return [*found, *fault_lines(record)]


def torn_line(record: Record) -> str:
    """Which row was left out because the file ends within it, in words."""
    return f"row {record.torn_row:,} was left out: the file ends within it"


def left_out(record: Record) -> int:
    """How many outputs were measured and are not used."""
    return len(record.spikes) + sum(stop - start for _, start, stop in record.faults)


OF_FAULTS = {
    "stuck": "the output keeps one value while the input moves on",
    "clipped": "the output is at the end of its sensor's range",
    "wrapped": "the output's counter has wrapped",
}


def fault_lines(record: Record) -> list[str]:
    """Which samples were not used: faults of the sensor, and what stands out alone, in words."""
    found: list[str] = []
    for kind, words in OF_FAULTS.items():
        rows = [(start, stop) for each, start, stop in record.faults if each == kind]
        if not rows:
            continue
        count = sum(stop - start for start, stop in rows)
        some = ", ".join(f"{start + 1:,}-{stop:,}" for start, stop in rows[:3])
        others = f" and {len(rows) - 3:,} other stretches" if len(rows) > 3 else ""
        found.append(
            f"{words} in {count:,} samples ({100 * count / len(record.time):.2g} %), which were "
            f"left out: samples {some}{others}"
        )
    for what, spikes, done in (
        ("output", record.spikes, "left out"),
        ("input", record.input_spikes, "bridged by lines, as the output does not answer"),
    ):
        if not spikes:
            continue
        rows = sorted(spikes)
        many = len(rows) > 1
        some = ", ".join(f"{row + 1:,}" for row in rows[:3])
        others = f" and {len(rows) - 3:,} others" if len(rows) > 3 else ""
        share = 100 * len(rows) / len(record.time)
        found.append(
            f"{len(rows):,} {what}{'s' * many} ({share:.2g} %) "
            f"{'stand out from their' if many else 'stands out from its'} neighbours alone and "
            f"{'were' if many else 'was'} {done}: sample{'s' * many} {some}{others}"
        )
    return found


def span_rows(record: Record) -> list[tuple[str, str]]:
    """How many rows, how long, how great, and from which state."""
    measured = int(record.measured.sum())
    rows = f"{len(record.time):,}"
    if measured < len(record.time):
        rows += f", {measured:,} of them with a measured output"
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
    return [
        *_run_rows(record),
        ("columns", "; ".join(columns)),
        *span_rows(record),
    ]


def plane_text(model: Model) -> str:
    """Levels, cells and limits of a model's plane, and the signs of its weights if not positive."""
    axis = "output" if model.chain.mechanics else "input"
    plane, unit = model.plane, model.units.get(axis, "")
    factor, shown = scaled(max(abs(plane.low), abs(plane.high)), unit)
    span = f"{number(factor * plane.low)} to {number(factor * plane.high)} {shown}".rstrip()
    falls = ", output falls as the input rises" if model.chain.polarity < 0 else ""
    if model.chain.signed:
        falls = ", weights of both signs"
    return f"{model.chain.size_text}, {plane.cells:,} cells, {axis} from {span}{falls}"


def model_rows(model: Model) -> list[tuple[str, str]]:
    """What a model is made of: plane, cells, effects and the record that it was fitted to."""
    return [
        ("plane", plane_text(model)),
        ("cells visited", f"{100 * model.visited.mean():.0f} %"),
        ("effects", ", ".join(effect.name for effect in model.effects) or "none"),
        ("identified on", f"{model.origin.record}, {model.origin.rows:,} rows"),
    ]


def model_line(model: Model) -> str:
    """A model in one line: its effects, its levels, its error."""
    error = quantity(model.rms_validation, model.units.get("output", ""), 3)
    name = model_name(effect.name for effect in model.effects)
    return f"{name}, {model.chain.size_text}, held-out error {error} RMS"


def chain_rows(model: Model) -> list[tuple[str, str, str, str]]:
    """A model in the order in which a signal passes it: place, part, parameter, value."""
    rows: list[tuple[str, str, str, str]] = []
    operator = [("hysteresis", "Preisach operator", "plane", plane_text(model))]
    for effect in model.chain.in_order:
        if effect.place != "input":
            rows += operator
            operator = []
        where, part = str(effect.place), effect.name
        for parameter, value in parameter_rows(
            model.parameters[effect.name], "Model.parameters"
        ) or [("", "")]:
            rows.append((where, part, parameter, value))
            where = part = ""
    return rows + operator

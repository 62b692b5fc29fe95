"""What results say, as rows of texts with units: for pages, terminals and notebooks alike.

Only the types of the results are known here, so that the results themselves can show their rows.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from preisach_jax.quantity import interval, number, pretty_unit, quantity, scaled

if TYPE_CHECKING:
    from preisach_jax.diagnosis.result import Diagnosis, Finding
    from preisach_jax.model import Model
    from preisach_jax.record import Record

_HEADLINES = {
    "adequate": "Nothing is missing",
    "explained": "The missing effect is found",
    "partly_explained": "An effect is found, and something remains",
    "unexplained": "Something is missing, and nothing that was tried explains it",
}


def headline(found: Diagnosis) -> str:
    """The verdict of a diagnosis in a few words."""
    several = len(found.effects) > 1 and found.verdict == "explained"
    return "The missing effects are found" if several else _HEADLINES[found.verdict]


def ladder_rows(found: Diagnosis) -> list[dict[str, str]]:
    """The ladder as texts: one row a model, errors in one common unit."""
    record = found.base.record
    greatest = max(rung.rms_validation for rung in found.ladder)
    factor, unit = scaled(greatest, found.budget.unit)
    rows = []
    for rung in found.ladder:
        rows.append(
            {
                "model": " + ".join(("Preisach model", *rung.effects)),
                "rms_identification": number(factor * rung.rms_identification),
                "rms_validation": number(factor * rung.rms_validation),
                "max_abs_validation": number(factor * rung.max_abs_validation),
                "percent_of_stroke": number(100 * rung.rms_validation / record.output_range, 3),
                "fit_percent": f"{rung.fit_percent:.2f}",
                "unit": unit,
            }
        )
    return rows


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


def finding_parameters(finding: Finding) -> list[tuple[str, str]]:
    """The parameters of a finding with their intervals, as texts."""
    rows = [
        (name, interval(e.value, e.low, e.high, e.unit)) for name, e in finding.parameters.items()
    ]
    if len(rows) <= MOST_SHOWN:
        return rows
    few = MOST_SHOWN // 2
    return [*rows[:few], (f"and {len(rows) - few} more", "in model.json")]


def record_rows(record: Record) -> list[tuple[str, str]]:
    """What a record holds: columns, rows, duration and stroke."""
    columns = []
    for role, channel in record.channels.items():
        unit = pretty_unit(channel.unit)
        name = role if role == channel.name else f"{role} {channel.name}"
        columns.append(f"{name} in {unit}" if unit else f"{name} (unit unknown)")
    measured = int(record.measured.sum())
    rows = f"{len(record.time):,}"
    if measured < len(record.time):
        rows += f", {measured:,} of them with a measured output"
    return [
        ("data", record.name),
        ("SHA-256 of its values", record.sha256),
        ("columns", "; ".join(columns)),
        ("rows", rows),
        ("duration", f"{number(record.duration_s)} s, step {quantity(record.step_s, 's')}"),
        ("stroke", quantity(record.output_range, record.output_unit)),
        ("state at the first sample", record.initial_memory),
    ]


def model_rows(model: Model) -> list[tuple[str, str]]:
    """What a model is made of: plane, cells, effects and the record that it was fitted to."""
    plane, unit = model.plane, model.units.get("input", "")
    factor, shown = scaled(max(abs(plane.low), abs(plane.high)), unit)
    span = f"{number(factor * plane.low)} to {number(factor * plane.high)} {shown}".rstrip()
    return [
        ("plane", f"{plane.levels} levels, {plane.cells:,} cells, input from {span}"),
        ("cells visited", f"{100 * model.visited.mean():.0f} %"),
        ("effects", ", ".join(effect.name for effect in model.effects) or "none"),
        ("identified on", f"{model.origin.record}, {model.origin.rows:,} rows"),
    ]

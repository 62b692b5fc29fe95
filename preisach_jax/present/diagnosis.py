"""A diagnosis as rows of texts with units, as text and as HTML."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from preisach_jax.present import html
from preisach_jax.present.fit import error_rows, error_table, run_lines, run_table
from preisach_jax.present.loss import loss_lines, loss_table
from preisach_jax.present.model import chain_table, parameter_rows
from preisach_jax.quantity import quantity

if TYPE_CHECKING:
    from preisach_jax.diagnosis.exploration import Exploration
    from preisach_jax.diagnosis.result import Diagnosis, Finding

_HEADLINES = {
    "adequate": "Nothing is missing",
    "explained": "The missing effect was found",
    "partly_explained": "An effect was found, but part of the error remains",
    "unexplained": "Something is missing, but no effect that was tried explains it",
}


def headline(found: Diagnosis) -> str:
    """The verdict of a diagnosis in a few words."""
    if found.verdict == "adequate" and found.next_experiment is not None:
        return "No missing effect is visible, but this record could hardly show one"
    if not found.effects and found.without_hysteresis is not None:
        return "There is no hysteresis to be seen"
    if found.verdict == "adequate" and found.budget.is_of_the_plane(found.base.record.output_range):
        return "No effect can be seen: the cells of the plane are the limit"
    several = len(found.effects) > 1 and found.verdict == "explained"
    return "The missing effects were found" if several else _HEADLINES[found.verdict]


def ladder_rows(found: Diagnosis) -> list[dict[str, str]]:
    """The ladder as texts: one row a model, errors in one common unit."""
    return error_rows(found.ladder, found.base.record, found.memoryless)


def limit_rows(found: Diagnosis) -> list[tuple[str, str]]:
    """Effects that were not found, and how great they could be (95 %)."""
    return [(limit.effect, limit.text(found.budget.unit)) for limit in found.limits]


def budget_rows(found: Diagnosis) -> list[tuple[str, str, str]]:
    """The error budget: what, how much, and where the number is from."""
    budget = found.budget
    rest = "not explained by any of these"
    steps = [
        (f"of it, steps of the {side}", quantity(rms, budget.unit, 3), source)
        for side, rms, source in (
            (
                "input",
                budget.input_quantisation,
                "at most; none if the drive itself moves in these steps",
            ),
            ("output", budget.output_quantisation, "a step over √12"),
        )
        if rms > 0
    ]
    levels = "levels beside jumps of the sensor"
    jumps = [("jumps", quantity(budget.jumps, budget.unit, 3), levels)] if budget.jumps > 0 else []
    return [
        ("noise", quantity(budget.noise, budget.unit, 3), "unpredictable between samples"),
        *steps,
        (
            "discretisation",
            quantity(budget.discretisation, budget.unit, 3),
            "finite cells of the plane: another plane, and what comes back in its cells",
        ),
        (
            "memory",
            quantity(budget.memory, budget.unit, 3),
            "rarely visited cells, which only the held-out rows cover",
        ),
        *jumps,
        ("unexplained", quantity(budget.unexplained, budget.unit, 3), rest),
        (
            "together",
            quantity(found.ladder[-1].rms_validation, budget.unit, 3),
            "held-out error of the final model (the squares add up)",
        ),
    ]


def form_lines(found: Diagnosis) -> list[str]:
    """The form that was asked for, sparse or learned: what it would take away, where to look."""
    form = found.form
    if form is None:
        return []
    lines = [form.sentence]
    if form.offered:
        lines.append(f"remainder ≈ {form.formula}")
        lines += form.state_texts
        lines.append(f"where to look: {'; '.join(form.physics)}")
    if form.learned is not None:
        lines.append(form.learned.sentence)
    if form.learned is not None and form.learned.offered:
        lines += form.learned.state_texts
        lines.append(f"where to look: {'; '.join(form.learned.where_to_look)}")
    return [*lines, *form.notes]


def form_rows(found: Diagnosis) -> list[tuple[str, str, str, str]]:
    """The terms of the sparse form: formula, coefficient, RMS, and where to look."""
    if found.form is None:
        return []
    return [
        (
            term.formula,
            quantity(term.coefficient, found.form.unit, 3),
            quantity(term.rms, found.form.unit, 3),
            term.physics,
        )
        for term in found.form.terms
    ]


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


def as_html(found: Diagnosis) -> str:
    """Verdict, ladder, findings with intervals and what to record next, for notebooks."""
    record = found.base.record
    headers = ("found", "cannot be told from", "parameter", "value")
    record_next = found.next_experiment.text if found.next_experiment else ""
    said = {"What remains": found.located, "Record next": record_next}
    return html.block(
        html.heading(f"{headline(found)} ({found.verdict})"),
        html.sentence(found.sentence),
        html.table(*error_table(found.ladder, record, found.memoryless), numbers_from=1),
        html.table(*run_table(found.final.by_record, record), numbers_from=1),
        html.table(headers, finding_rows(found.findings)),
        html.table(*loss_table(found.final.loss, record), numbers_from=0),
        *(html.sentence(f"{name}: {text}") for name, text in said.items() if text),
        *map(html.sentence, form_lines(found)),
        *map(html.sentence, found.notes),
    )


def step_as_html(step: Exploration) -> str:
    """The errors of all steps by hand, and the parts of the last one, for notebooks."""
    return html.block(
        html.heading(f"{step.record.name}: {step.fit.model.line}"),
        html.table(*error_table(step.ladder, step.record), numbers_from=1),
        chain_table(step.fit.model),
    )


def as_text(found: Diagnosis) -> str:
    """The verdict and the ladder, a line each."""
    budget = found.budget

    def shown(value: float) -> str:
        return quantity(value, budget.unit)

    lines = [f"{found.verdict}: {found.sentence}", *found.notes, ""]
    for rung in found.rungs:
        lines.append(
            f"  {rung.name}: held-out error {shown(rung.rms_validation)} RMS, "
            f"{shown(rung.max_abs_validation)} at most, fit {rung.fit_percent:.2f} %"
        )
    lines += [f"  {line}" for line in run_lines(found.final.by_record, budget.unit)]
    lines.append(
        f"  budget: noise {shown(budget.noise)}, discretisation "
        f"{shown(budget.discretisation)}, memory {shown(budget.memory)}, "
        + (f"jumps of the sensor {shown(budget.jumps)}, " if budget.jumps > 0 else "")
        + f"unexplained {shown(budget.unexplained)}"
    )
    if found.located:
        lines.append(f"  what remains: {found.located}")
    lines += [f"    {text}" for text in found.remainder_in_words]
    lines += [f"  {line}" for line in loss_lines(found.final.loss, found.base.record)]
    lines += [f"  {text}" for text in form_lines(found)]
    if found.next_experiment:
        lines.append(f"  record next: {found.next_experiment.text}")
    return "\n".join(lines)

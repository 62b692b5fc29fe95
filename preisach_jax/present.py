"""Results as sentences, rows of texts with units, text and HTML; pages and figures print these."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, Protocol

from preisach_jax.quantity import interval, number, pretty_unit, quantity, scaled

if TYPE_CHECKING:
    from preisach_jax.diagnosis.exploration import Exploration
    from preisach_jax.diagnosis.result import Diagnosis, Finding
    from preisach_jax.fit import Fit, Training
    from preisach_jax.loss import Loss
    from preisach_jax.model import Model, ParameterEstimate
    from preisach_jax.record.core import Record
    from preisach_jax.record.joined import RunErrors


_LINE = "rgba(128,128,128,.45)"
_CELL = "padding:.15em 1.2em .15em 0;border:0;background:none;vertical-align:top"


def _block(*parts: str) -> str:
    """Parts made by this module, one below the other."""
    style = f"margin:.3em 0;padding-left:.8em;border-left:3px solid {_LINE}"
    return f'<div style="{style}">{"".join(parts)}</div>'


def _heading(text: str) -> str:
    """What the whole is, as a bold line."""
    return f'<p style="margin:.3em 0;font-weight:600">{escape(text)}</p>'


def _sentence(text: str) -> str:
    """A paragraph, or nothing if there is no text."""
    return f'<p style="margin:.3em 0">{escape(text)}</p>' if text else ""


def _table(headers: Sequence[str], rows: Iterable[Sequence[str]], numbers_from: int = 99) -> str:
    """A compact table."""
    rows = list(rows)
    if not rows:
        return ""

    def line(cells: Sequence[str], tag: str, more: str) -> str:
        sides = ["right" if place >= numbers_from else "left" for place in range(len(cells))]
        return "".join(
            f'<{tag} style="{_CELL};{more};text-align:{side}">{escape(cell)}</{tag}>'
            for cell, side in zip(cells, sides, strict=True)
        )

    ruled = f"font-weight:600;border-bottom:1px solid {_LINE}"
    head = f"<thead><tr>{line(headers, 'th', ruled)}</tr></thead>" if headers else ""
    body = "".join(f"<tr>{line(row, 'td', 'white-space:pre-wrap')}</tr>" for row in rows)
    # Tables do not take colour and size from the page where it states no standard.
    style = "border-collapse:collapse;margin:.4em 0;color:inherit;font-size:inherit"
    return f'<table style="{style}">{head}<tbody>{body}</tbody></table>'


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
        unit = record.time_unit if role == "time" else channel.unit
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


def record_html(record: Record) -> str:
    """Columns with units and ranges, duration, gaps and missing outputs, for notebooks."""
    from preisach_jax.record.blemishes import holes

    return _block(
        _heading(record.line),
        _table(("", "column", "unit", "from", "to"), column_rows(record), numbers_from=3),
        _table((), span_rows(record)),
        *map(_sentence, holes(record)),
    )


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


def chain_table(model: Model) -> str:
    """The chain in its order, with parameters and their intervals, as HTML."""
    return _table(("acts on", "part", "parameter", "value"), chain_rows(model))


def model_html(model: Model) -> str:
    """Line, chain and record of a model, for notebooks."""
    return _block(
        _heading(model.line),
        chain_table(model),
        _sentence(f"Identified on {model.origin.record}, {model.origin.rows:,} rows."),
    )


MOST_ROWS = 12
"""Kinds of cycles that are shown; diagnosis.json has all."""


def loss_table(loss: Loss | None, record: Record) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Headers with units, and one row a kind of cycle: those that lose most, the slowest first."""
    if loss is None or not loss.cycles:
        return (), []
    kinds = loss.kinds
    sizes = [abs(kind.model if math.isnan(kind.measured) else kind.measured) for kind in kinds]
    most = sorted(range(len(kinds)), key=lambda k: -sizes[k])[:MOST_ROWS]
    kinds = [kinds[k] for k in sorted(most)]
    units = [record.input_unit, record.output_unit]
    swings = [
        [0.5 * (kind.input_high - kind.input_low) for kind in kinds],
        [0.5 * (kind.output_high - kind.output_low) for kind in kinds],
    ]
    scales = [scaled(max(map(_known, swing)), unit)
              for swing, unit in zip(swings, units, strict=True)]  # fmt: skip
    joules = pretty_unit(loss.unit).replace("m3", "m³")
    sides = [
        f"{side} ±{' (' + unit + ')' if unit else ''}"
        for side, (_, unit) in zip(("input", "output"), scales, strict=True)
    ]
    headers = ("frequency (Hz)", "cycles", *sides, f"measured loss ({joules})",
               f"model ({joules})", "95 % band", "difference %")  # fmt: skip
    rows: list[tuple[str, ...]] = []
    for place, kind in enumerate(kinds):
        shown = [
            _text(factor * swing[place], 4)
            for swing, (factor, _) in zip(swings, scales, strict=True)
        ]
        rows.append(
            (
                number(1 / kind.duration_s, 3),
                str(kind.count),
                *shown,
                _text(kind.measured, 4),
                _text(kind.model, 4),
                f"{_text(kind.low, 4)} to {_text(kind.high, 4)}",
                _text(kind.difference_percent, 2),
            )
        )
    return headers, rows


def loss_lines(loss: Loss | None, record: Record) -> list[str]:
    """The same, a line each."""
    headers, rows = loss_table(loss, record)
    if not rows:
        return []
    widths = [max(map(len, column)) for column in zip(headers, *rows, strict=True)]
    return ["loss per cycle"] + [
        "  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True))
        for row in (headers, *rows)
    ]


def _known(value: float) -> float:
    return 0.0 if math.isnan(value) else value


def _text(value: float, digits: int) -> str:
    return "-" if math.isnan(value) else number(value, digits)


class Errors(Protocol):
    """What a model leaves of a record: a fit, or a rung of a ladder."""

    @property
    def name(self) -> str: ...
    @property
    def rms_identification(self) -> float: ...
    @property
    def rms_validation(self) -> float: ...
    @property
    def max_abs_validation(self) -> float: ...
    @property
    def fit_percent(self) -> float: ...


def error_rows(
    models: Sequence[Errors], record: Record, below: Sequence[Errors] = ()
) -> list[dict[str, str]]:
    """Errors of models of one record as texts: one row a model, in one common unit.

    Arguments:
        models: the models, whose errors choose the unit.
    """
    greatest = max(model.rms_validation for model in models)
    factor, unit = scaled(greatest, record.output_unit)
    rows: list[dict[str, str]] = []
    for model in (*below, *models):
        rows.append(
            {
                "model": model.name,
                "rms_identification": number(factor * model.rms_identification),
                "rms_validation": number(factor * model.rms_validation),
                "max_abs_validation": number(factor * model.max_abs_validation),
                "percent_of_stroke": number(100 * model.rms_validation / record.output_range, 3),
                "fit_percent": f"{model.fit_percent:.2f}",
                "unit": unit,
            }
        )
    return rows


def error_table(
    models: Sequence[Errors], record: Record, below: Sequence[Errors] = ()
) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Headers with units, and the rows of `error_rows` below them."""
    rows = error_rows(models, record, below)
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


def training_lines(training: Training | None, unit: str) -> list[str]:
    """How the arrays of effects were trained, a line; none if they were not."""
    if training is None:
        return []
    return [
        f"  {', '.join(training.effects)}: {training.numbers:,} numbers trained, best at step "
        f"{training.best_step} of {training.steps} (error on the rows that chose it "
        f"{training.rms_before:.4g} -> {training.rms_after:.4g} {unit} RMS); {training.ended}"
    ]


def fit_html(fit: Fit) -> str:
    """Errors with units, parameters with their intervals and the plane, for notebooks."""
    return _block(
        _heading(f"{fit.record.name}: {fit.model.line}"),
        _table(*error_table((fit,), fit.record), numbers_from=1),
        *(_sentence(f"Warning: {sentence}.") for sentence in fit.rises),
        _table(*run_table(fit.by_record, fit.record), numbers_from=1),
        _table(*loss_table(fit.loss, fit.record), numbers_from=0),
        chain_table(fit.model),
    )


def fit_text(fit: Fit) -> str:
    """Errors and parameters of a fit, a line each."""
    from preisach_jax.record.blemishes import fault_lines

    unit = fit.record.channels["output"].unit or "(no unit)"
    stroke = fit.record.output_range
    rms, largest = fit.rms_validation, fit.max_abs_validation
    lines = [
        f"Preisach model, {fit.model.chain.size_text}"
        + "".join(f" + {name}" for name in fit.effects),
        f"  held-out error {rms:.4g} {unit} RMS ({100 * rms / stroke:.3g} % of stroke), "
        f"{largest:.4g} {unit} at most; fit {fit.fit_percent:.2f} %",
        f"  identification error {fit.rms_identification:.4g} {unit} RMS",
    ]
    lines += [f"  warning: {sentence}" for sentence in fit.rises]
    lines += [f"  {line}" for line in run_lines(fit.by_record, unit)]
    for effect, parameters in fit.model.parameters.items():
        for name, estimate in parameters.items():
            lines.append(
                f"  {effect}.{name} = {estimate.value:.5g} {estimate.unit} "
                f"(95 %: {estimate.low:.5g} to {estimate.high:.5g})"
            )
    lines += training_lines(fit.training, unit)
    more = (*fault_lines(fit.record), *loss_lines(fit.loss, fit.record))
    return "\n".join([*lines, *(f"  {line}" for line in more)])


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
        ("noise", quantity(budget.noise, budget.unit, 3), "unpredictable, and related to nothing"),
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
    """The form that was asked for: what it would take away, where to look."""
    form = found.form
    if form is None:
        return []
    lines = [form.sentence]
    if form.offered:
        lines.append(f"remainder ≈ {form.formula}")
        lines += form.state_texts
        lines.append(f"where to look: {'; '.join(form.physics)}")
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


def diagnosis_html(found: Diagnosis) -> str:
    """Verdict, ladder, findings with intervals and what to record next, for notebooks."""
    record = found.base.record
    headers = ("found", "cannot be told from", "parameter", "value")
    record_next = found.next_experiment.text if found.next_experiment else ""
    said = {"What remains": found.located, "Record next": record_next}
    return _block(
        _heading(f"{headline(found)} ({found.verdict})"),
        _sentence(found.sentence),
        _table(*error_table(found.ladder, record, found.memoryless), numbers_from=1),
        _table(*run_table(found.final.by_record, record), numbers_from=1),
        _table(headers, finding_rows(found.findings)),
        _table(*loss_table(found.final.loss, record), numbers_from=0),
        *(_sentence(f"{name}: {text}") for name, text in said.items() if text),
        *map(_sentence, form_lines(found)),
        *map(_sentence, found.notes),
    )


def exploration_html(step: Exploration) -> str:
    """The errors of all steps by hand, and the parts of the last one, for notebooks."""
    return _block(
        _heading(f"{step.record.name}: {step.fit.model.line}"),
        _table(*error_table(step.ladder, step.record), numbers_from=1),
        chain_table(step.fit.model),
    )


def diagnosis_text(found: Diagnosis) -> str:
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

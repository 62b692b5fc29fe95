"""What models leave of a record: tables of errors, and a fit as text and as HTML."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol

from preisach_jax.present import html
from preisach_jax.present.loss import loss_lines, loss_table
from preisach_jax.present.model import chain_table
from preisach_jax.quantity import number, scaled

if TYPE_CHECKING:
    from preisach_jax.fit import Fit, Training
    from preisach_jax.record import Record
    from preisach_jax.record.joined import RunErrors


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


def as_html(fit: Fit) -> str:
    """Errors with units, parameters with their intervals and the plane, for notebooks."""
    return html.block(
        html.heading(f"{fit.record.name}: {fit.model.line}"),
        html.table(*error_table((fit,), fit.record), numbers_from=1),
        *(html.sentence(f"Warning: {sentence}.") for sentence in fit.rises),
        html.table(*run_table(fit.by_record, fit.record), numbers_from=1),
        html.table(*loss_table(fit.loss, fit.record), numbers_from=0),
        chain_table(fit.model),
    )


def as_text(fit: Fit) -> str:
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

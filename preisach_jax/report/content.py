"""What the pages say, as texts and tables; the templates only lay it out."""

from __future__ import annotations

import platform
import shlex
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import PurePosixPath, PureWindowsPath
from typing import TYPE_CHECKING, Any

import jax
import numpy as np

from preisach_jax.diagnosis import evidence
from preisach_jax.diagnosis.residuals import LEVEL, sampling_note
from preisach_jax.diagnosis.wording import plain
from preisach_jax.errors import InputError
from preisach_jax.escape import printable
from preisach_jax.identify.problem import BLOCKS, FOLDS
from preisach_jax.present import (
    budget_rows,
    finding_parameters,
    form_rows,
    headline,
    ladder_rows,
    limit_rows,
    loss_table,
    model_rows,
    record_rows,
    run_table,
)
from preisach_jax.quantity import number, quantity, scaled

if TYPE_CHECKING:
    from preisach_jax.diagnosis.comparison import Comparison
    from preisach_jax.diagnosis.result import Diagnosis, Finding
    from preisach_jax.effects.base import Effect
    from preisach_jax.model import Model
    from preisach_jax.record.core import Record


REFERENCES = (
    "F. Preisach, Über die magnetische Nachwirkung, Zeitschrift für Physik 94 (1935) 277–302.",
    "I. D. Mayergoyz, Mathematical Models of Hysteresis and Their Applications, Elsevier 2003.",
    "M. Ruderman, D. Rachinskii, Discrete-time adaptive hysteresis filter for parallel computing "
    "and recursive identification of Preisach model.",
    "G. H. Golub, V. Pereyra, The differentiation of pseudo-inverses and nonlinear least squares "
    "problems whose variables separate, SIAM Journal on Numerical Analysis 10 (1973) 413–432.",
    "G. E. P. Box, G. M. Jenkins, Time Series Analysis: Forecasting and Control, Holden-Day 1976.",
)


def diagnosis_page(found: Diagnosis, command: str | None) -> dict[str, Any]:
    """All that the page of a diagnosis says."""
    record = found.base.record
    return {
        "title": record.name,
        "verdict": found.verdict,
        "headline": headline(found),
        "sentence": found.sentence,
        "size": _size(found),
        "effects": found.effects,
        "ladder": ladder_rows(found),
        "records": run_table(found.final.by_record, record),
        "findings": [_finding(each, found.model) for each in found.findings],
        "families": [f.family for f in found.findings if len(f.family) > 1],
        "next_experiment": found.next_experiment,
        "next_command": _next_command(found),
        "located": found.located,
        "remainder": found.remainder_in_words,
        "form": found.form,
        "form_terms": form_rows(found),
        "notes": found.notes,
        "loss": loss_table(found.final.loss, found.final.record),
        "driven": _driven(found),
        "limits": limit_rows(found),
        "budget": budget_rows(found),
        "sampling": sampling_note(record),
        "record": record_rows(record),
        "model": model_rows(found.model),
        "software": software_rows(),
        "command": shareable(command),
        "method": _method(found),
        "references": REFERENCES,
    }


def _driven(found: Diagnosis) -> str:
    """How well a stage would follow a course that the model drives; empty if it says little."""
    model, record = found.model, found.base.record
    if found.leaves_a_part:
        return ""
    try:
        model.check_invertible()
    except InputError:
        return ""
    rows = record.measured
    line = np.polyfit(record.input[rows], record.output[rows], 1)
    missed = record.output[rows] - np.polyval(line, record.input[rows])
    stroke = record.output_range
    own, straight = (
        f"{quantity(rms, record.output_unit, 3)} ({100 * rms / stroke:.2g} % of the stroke)"
        for rms in (model.rms_validation, float(np.sqrt(np.mean(missed**2))))
    )
    return (
        "Driven by the inverse of this model (preisach compensate), the stage would follow a "
        f"course like this one with an error of about {own} RMS, the held-out error of the model; "
        f"with the best straight line instead of the model, the error would be {straight}."
    )


def shareable(command: str | None) -> str | None:
    """A command line for a page that is given to others: of files elsewhere the names alone.

    Folders outside of the one where the command was given tell who gave it, and where; the command
    repeats the work where the files are at hand.

    Arguments:
        command: the command line, None if there is none.

    Returns:
        It, with the last part of each absolute path, and of each that leads upward.

    Example:
        >>> shareable("preisach diagnose /home/ada/stage.csv --report=/home/ada/r --unit v=um/s")
        'preisach diagnose stage.csv --report=r --unit v=um/s'
    """
    if command is None:
        return None
    words: list[str] = []
    for word in shlex.split(command):
        option, equals, value = word.partition("=") if word.startswith("--") else ("", "", word)
        words.append(f"{option}{equals}{_name_of_path_elsewhere(value)}")
    return printable(shlex.join(words))


def _name_of_path_elsewhere(word: str) -> str:
    for kind in (PurePosixPath, PureWindowsPath):
        path = kind(word)
        if path.is_absolute() or path.parts[:1] in {("..",), ("~",)} or word.startswith("~"):
            return path.name or "."
    return word


def comparison_page(comparison: Comparison, command: str | None) -> dict[str, Any]:
    """All that the page of a comparison says."""
    record, model = comparison.record, comparison.model
    return {
        "title": record.name,
        "sentence": comparison_sentence(comparison),
        "notes": comparison.notes,
        "errors": error_rows(comparison),
        "tests": test_rows(comparison),
        "sampling": sampling_note(record),
        "record": record_rows(record),
        "model": model_rows(model),
        "software": software_rows(),
        "command": shareable(command),
    }


def comparison_sentence(comparison: Comparison) -> str:
    """What a comparison shows, in one sentence."""
    unit = comparison.record.output_unit
    share = 100 * comparison.rms / comparison.record.output_range
    expected = comparison.model.rms_validation
    text = (
        f"The model predicts this record to {quantity(comparison.rms, unit, 3)} RMS "
        f"({number(share, 3)} % of stroke)"
    )
    if not expected > 0:
        return text + "."
    if comparison.record.sha256 == comparison.model.origin.sha256:
        return f"{text}; it was identified on this record, so this is no independent test."
    ratio = comparison.rms / expected
    own = quantity(expected, unit, 3)
    if ratio <= 1.5:
        return f"{text}, as well as the record on which it was identified ({own}, held out)."
    return f"{text}, {number(ratio, 2)} times the {own} on the record where it was identified."


def error_rows(comparison: Comparison) -> list[tuple[str, str]]:
    """The errors of a comparison, as texts."""
    unit = comparison.record.output_unit
    share = 100 * comparison.rms / comparison.record.output_range
    return [
        ("RMS error", quantity(comparison.rms, unit)),
        ("of the stroke", f"{number(share, 3)} %"),
        ("largest error", quantity(comparison.max_abs, unit)),
        ("fit", f"{comparison.fit_percent:.2f} %"),
    ]


def test_rows(comparison: Comparison) -> list[tuple[str, str, str]]:
    """The residual tests of a comparison: what, how much, what a good model gives."""
    tests, unit = comparison.tests, comparison.record.output_unit
    chance = f"about {100 * (1 - LEVEL):.0f} % by chance"
    return [
        ("mean error", quantity(tests.bias, unit, 3), "about 0"),
        ("inside the model's 95 % band", f"{100 * tests.inside_band:.1f} %", "about 95 %"),
        (
            "autocorrelation outside its 99 % band",
            f"{100 * tests.autocorrelation_outside:.0f} % of the lags",
            chance,
        ),
        (
            "correlation with the input outside its 99 % band",
            f"{100 * tests.cross_correlation_outside:.0f} % of the lags",
            chance,
        ),
        (
            "cumulated periodogram, distance from white noise",
            number(tests.periodogram_deviation, 3),
            f"up to {number(tests.periodogram_band, 2)} by chance",
        ),
    ]


def _size(found: Diagnosis) -> dict[str, str]:
    """What is left of the error, and what it was, in per cent of the stroke and in its unit."""
    record, ladder = found.base.record, found.ladder
    stroke, unit = record.output_range, record.output_unit
    share, before_share = (
        number(100 * rung.rms_validation / stroke, 2) for rung in (ladder[-1], ladder[0])
    )
    rms, before = (quantity(rung.rms_validation, unit, 3) for rung in (ladder[-1], ladder[0]))
    has_more = len(ladder) > 1
    return {
        "share": share, "rms": rms, "before": before if has_more else "",
        "before_share": before_share,
    }  # fmt: skip


def _next_command(found: Diagnosis) -> str:
    if found.next_experiment is not None:
        return "preisach design . --out next.csv"
    return "preisach predict model.json next.csv --out predicted.csv"


def _finding(finding: Finding, model: Model) -> dict[str, Any]:
    known: dict[str, Effect] = {effect.name: effect for effect in model.effects}
    effect = known[finding.effect]
    unit = model.units.get("output", "")
    factor, shown = scaled(finding.rms_before, unit)
    numbers = finding.evidence
    return {
        "effect": finding.effect,
        "plain": plain(finding.effect),
        "family": finding.family,
        "parameters": finding_parameters(finding),
        "meanings": _meanings(effect),
        "before": f"{number(factor * finding.rms_before, 3)} {shown}".rstrip(),
        "after": f"{number(factor * finding.rms_after, 3)} {shown}".rstrip(),
        "evidence": [(_EVIDENCE.get(name, name), number(x, 3)) for name, x in numbers.items()],
        "physics": effect.physics,
        "signature": effect.signature,
        "source": effect.source,
    }


_EVIDENCE = {
    "gain": "decrease of the held-out mean square (share)",
    "score": "score of the prediction of each stretch from others",
    "blocks": "stretches",
}


def _meanings(effect: Effect) -> Mapping[str, str]:
    parameters = [*effect.parameters(), *getattr(effect, "coefficients", tuple)()]
    return {parameter.name: parameter.meaning for parameter in parameters}


def software_rows() -> list[tuple[str, str]]:
    packages = ("preisach_jax", "jax", "numpy", "scipy")
    versions = ", ".join(f"{name} {version(name)}" for name in packages)
    return [
        ("software", f"{versions}, Python {platform.python_version()}"),
        ("machine", f"{platform.system()}, {platform.machine()}, {jax.default_backend()}"),
        ("seeds", "all 0: the same data and versions give the same results"),
    ]


def _method(found: Diagnosis) -> list[str]:
    plane = found.model.plane
    even = plane.own_thresholds is None
    placed = "equal cells" if even else "thresholds where the output moves"
    return [
        "The output is modelled as a weighted sum of hysterons on the Preisach plane [1, 2] in "
        f"the discrete-time form of [3], with {plane.levels} levels an axis "
        f"({plane.cells:,} cells), {placed} and switching ramps one cell wide in place of jumps. "
        "Weights are non-negative and smooth; cross-validation chooses how smooth. They are found "
        "by linear least squares at each value of the effects' parameters, which are found by "
        "Gauss-Newton steps (variable projection [4]).",
        _held_out(found.base.record),
        "Whole models are compared, each refitted in full. Each predicts "
        f"{evidence.STRETCHES} stretches of the record from the others; the score of one against "
        "a simpler one is the mean logarithm of the ratio of their RMS errors over its standard "
        f"error, to which {100 * evidence.OF_THE_LAW:.0f} % are added that no number of rows "
        f"removes. An effect is named if its score is at least {evidence.LEAST_SCORE:g}. Models "
        "of as many effects that predict as well as the best one form a family: this record "
        "cannot tell them apart.",
        "Intervals are 95 %, from the joint linearisation in weights and parameters, with "
        "residuals that may be correlated within a block. Bands of the residual tests are "
        "99 % [5].",
    ]


def _held_out(record: Record) -> str:
    """What is held out, and what a model of several records has in common, in sentences."""
    text = (
        f"The measured rows are cut into {BLOCKS} contiguous blocks, of which one in {FOLDS} is "
        "held out, in uneven steps; memory is simulated through them. "
        "All errors named held-out are from these blocks, of a model that was identified without "
        "them. The model that is saved was identified on all rows."
    )
    if not record.runs:
        return text
    apart = [run.name for run in record.runs if run.held_out]
    if apart:
        text = (
            f"All rows of {', '.join(apart)} are held out: errors named held-out are those of a "
            "prediction from the input alone, by the model that is saved."
        )
    return (
        f"{text} The records share the density and the parameters of the effects; each has its own "
        "memory, offset, drift and hum, and no block, difference or filter reaches from one to the "
        "next. The model that is saved goes on from the end of the last one that was fitted."
    )


HEADERS = ("", "effects", "RMS error", "% of stroke", "largest", "fit %", "in the model's band")


def several_rows(comparisons: Mapping[str, Comparison]) -> list[tuple[str, ...]]:
    """One row a comparison, below `HEADERS`; errors in one common unit."""
    several = list(comparisons.values())
    units = {each.record.output_unit for each in several}
    factor, unit = scaled(max(each.rms for each in several), several[0].record.output_unit)
    rows: list[tuple[str, ...]] = []
    for name, each in comparisons.items():
        if len(units) > 1:
            factor, unit = scaled(each.rms, each.record.output_unit)
        rows.append(
            (
                name,
                ", ".join(each.effects) or "none",
                f"{number(factor * each.rms, 3)} {unit}".rstrip(),
                number(100 * each.rms / each.record.output_range, 3),
                f"{number(factor * each.max_abs, 3)} {unit}".rstrip(),
                f"{each.fit_percent:.2f}",
                f"{100 * each.tests.inside_band:.0f} %",
            )
        )
    return rows


def several_sentence(comparisons: Mapping[str, Comparison]) -> str:
    """Which comparison leaves least and which most, in shares of the stroke."""
    shares = {name: 100 * each.rms / each.record.output_range for name, each in comparisons.items()}
    least, most = min(shares, key=shares.__getitem__), max(shares, key=shares.__getitem__)
    best, worst = comparisons[least], comparisons[most]
    small = quantity(best.rms, best.record.output_unit, 3)
    great = quantity(worst.rms, worst.record.output_unit, 3)
    text = (
        f"{least} has the smallest error, {small} RMS ({number(shares[least], 3)} % of stroke), "
        f"and {most} the largest, {great} ({number(shares[most], 3)} %)."
    )
    own = [
        name for name, each in comparisons.items() if each.record.sha256 == each.model.origin.sha256
    ]
    if own:
        text += f" Identified on this very record, so no independent test: {', '.join(own)}."
    return text


def several_page(comparisons: Mapping[str, Comparison], command: str | None) -> dict[str, Any]:
    """All that the page of several comparisons says."""
    first = next(iter(comparisons.values()))
    is_one_record = all(e.record.sha256 == first.record.sha256 for e in comparisons.values())
    count = len(comparisons)
    notes = [f"{name}: {note}" for name, each in comparisons.items() for note in each.notes]
    return {
        "title": f"{count} models, {first.record.name}" if is_one_record else f"{count} records",
        "heading": "Models against one record" if is_one_record else "One model against records",
        "sentence": several_sentence(comparisons),
        "notes": notes,
        "headers": HEADERS,
        "rows": several_rows(comparisons),
        "software": software_rows(),
        "command": shareable(command),
    }

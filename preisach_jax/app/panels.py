"""The texts and lists of the page; whatever comes from a file is escaped."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from importlib.resources import files
from typing import Any

import panel as pn
from markupsafe import Markup

from preisach_jax.diagnosis.exploration import Exploration
from preisach_jax.diagnosis.result import Budget, Candidate, Diagnosis
from preisach_jax.diagnosis.wording import evidence_in_words, plain
from preisach_jax.errors import InputError
from preisach_jax.quantity import quantity
from preisach_jax.record import Record
from preisach_jax.rows import headline, model_name, parameter_rows, record_lines

DROP = (
    "Drop a file above, or click to choose one: CSV, MicroMag .forc, NPZ, MAT or Parquet. It stays "
    "on this machine."
)
CHOOSE = "Look at the columns, then press Use these columns."
FIT = "Press Fit: the plain hysteresis model comes first, then what it lacks is compared."
NOT_COMPARED = "Nothing was compared yet: any effect can be added."


@cache
def style() -> str:
    """The style sheet of the page."""
    return files("preisach_jax.app").joinpath("style.css").read_text(encoding="utf-8")


def pane(text: str = "") -> Any:
    """A pane of HTML made by this module, in the page's style."""
    return pn.pane.HTML(text, sizing_mode="stretch_width", stylesheets=[style()], margin=(2, 8))


def heading(number: str, text: str) -> str:
    """The heading of a part of the side bar."""
    return str(Markup("<h2><span>{}</span> {}</h2>").format(number, text))


def doing(text: str) -> str:
    """What goes on, where a screen reader hears it."""
    return str(Markup('<div class="doing" role="status" aria-live="polite">{}</div>').format(text))


def failure(error: Exception) -> Markup:
    """A user's mistake as its message; a failure of ours as such."""
    text = str(error)
    if not isinstance(error, InputError):
        text = f"This is a failure of the program, not of yours: {type(error).__name__}: {text}"
    return mistake(text)


def mistake(text: str) -> Markup:
    """What is wrong, where a screen reader says it at once."""
    return Markup('<div class="error" role="alert">{}</div>').format(text)


def told(record: Record, notes: Sequence[str]) -> Markup:
    """What was read, and what was assumed about it."""
    lines = record_lines(record, notes)
    return Markup('<div class="told">{}</div>').format(
        Markup("").join(Markup("<p>{}</p>").format(line) for line in lines)
    )


def paragraph(text: str) -> str:
    """A text as a paragraph."""
    return str(Markup("<p>{}</p>").format(text))


def ladder(step: Exploration, found: Diagnosis | None) -> str:
    """The errors of all steps as bars, with the floor of noise and grid where it is known."""
    rungs, unit = step.ladder, step.record.output_unit
    most = max(rung.rms_validation for rung in rungs)
    lines: list[Markup] = []
    for place, rung in enumerate(rungs):
        name = f"+ {rung.effects[-1]}" if rung.effects else "Preisach model"
        share = 100 * rung.rms_validation / most
        fall = ""
        if place:
            fall = f" (−{100 * (1 - rung.rms_validation / rungs[place - 1].rms_validation):.1f} %)"
        lines.append(
            Markup(
                '<li><span class="name">{}</span>'
                '<span class="bar"><span class="{}" style="width:{:.1f}%"></span></span>'
                '<span class="value">{}{}</span></li>'
            ).format(
                name, "after" if place else "before", share,
                quantity(rung.rms_validation, unit, 4), fall,
            )
        )  # fmt: skip
    budget = found.budget if found else step.known_budget
    return str(
        Markup('<ol class="ladder" aria-label="Held-out error, RMS">{}</ol>{}{}').format(
            Markup("").join(lines), _floor(budget) if budget else "", _amounts(step)
        )
    )


def _amounts(step: Exploration) -> Markup:
    """How much of each effect there is, with 95 % intervals."""
    rows = [
        Markup("<tr><td>{}</td><td>{}</td></tr>").format(f"{effect}.{name}", text)
        for effect, parameters in step.fit.model.parameters.items()
        for name, text in parameter_rows(parameters)
    ]
    return Markup('<table class="amounts">{}</table>').format(Markup("").join(rows))


def _floor(budget: Budget) -> Markup:
    shares = [
        f"{name} {quantity(rms, budget.unit, 3)}"
        for name, rms in (
            ("noise", budget.noise),
            ("grid", budget.discretisation),
            ("memory", budget.memory),
            ("unexplained", budget.unexplained),
        )
    ]
    return Markup(
        '<p class="budget">Held-out error (RMS). Of that of the model shown: {}.</p>'
    ).format(", ".join(shares))


def verdict(step: Exploration, found: Diagnosis | None) -> str:
    """What can be said of the present step."""
    if found is not None:
        text = Markup("<b>{}</b> ({}). {}").format(headline(found), found.verdict, found.sentence)
        more: list[str] = []
        if found.located:
            more.append(f"What remains: {found.located}.")
        if found.next_experiment:
            more.append(f"Record next: {found.next_experiment.text}")
        paragraphs = Markup("").join(Markup("<p>{}</p>").format(line) for line in more)
        return str(Markup('<div class="verdict"><p>{}</p>{}</div>').format(text, paragraphs))
    budget = step.known_budget
    if budget is None:
        return ""
    words = (
        "what remains is noise and the grid of the model"
        if budget.is_met
        else f"{quantity(budget.unexplained, budget.unit, 3)} are neither noise nor grid: "
        "something is missing"
    )
    name = model_name(step.effects)
    return str(Markup('<div class="verdict"><p>{}: {}.</p></div>').format(name, words))


class CandidateRow:
    """An effect in the list: its name, what speaks for and against it, a button that adds it.

    Rows stay, and only what they say changes: to send new ones at every step would be slow.

    Arguments:
        name: the effect.
        add: called when the button is pressed.
    """

    def __init__(self, name: str, add: Callable[[], None]):
        self._name = name
        self._text = pane()
        self._button = pn.widgets.Button(
            label="Add", width=60, description=f"Add {name} to the model and refit"
        )
        self._button.on_click(lambda event: add())
        self.view: Any = pn.Row(self._text, self._button, sizing_mode="stretch_width")

    def show(self, candidate: Candidate | None) -> None:
        """Say what came of comparing it, or nothing if it was not compared."""
        convincing = candidate is not None and not candidate.why_not
        self._text.object = str(_candidate(self._name, candidate, convincing))
        self._button.color = "primary" if convincing else "default"


def order_of(step: Exploration, compared: Sequence[Candidate]) -> list[str]:
    """Names of the effects that may be added, the most convincing first."""
    ranked = sorted(compared, key=lambda c: (bool(c.why_not), -c.gain))
    names = [c.effect for c in ranked if c.effect not in step.effects]
    return names + [effect.name for effect in step.left if effect.name not in names]


def _candidate(name: str, candidate: Candidate | None, convincing: bool) -> Markup:
    parts = [Markup("<b>{}</b>").format(name)]
    if convincing:
        parts.append(Markup(' <span class="mark">convincing</span>'))
    if candidate is not None:
        share = 100 * min(max(candidate.gain, 0.0), 1.0)
        bar = '<span class="gain"><span style="width:{:.0f}%"></span></span>'
        parts.append(Markup(bar).format(share))
    if plain(name) != name:
        parts.append(Markup("<p>{}</p>").format(plain(name)))
    if candidate is not None:
        parts.append(Markup('<p class="evidence">{}</p>').format(evidence_in_words(candidate)))
    kind = "candidate convincing" if convincing else "candidate"
    return Markup('<div class="{}">{}</div>').format(kind, Markup("").join(parts))


def downloads(files: Mapping[str, bytes]) -> list[Any]:
    """One button a file."""
    return [
        pn.widgets.FileDownload(
            callback=_reading(content), filename=name, label=f"Download {name}",
            color="default", embed=False, sizing_mode="stretch_width",
        )
        for name, content in files.items()
    ]  # fmt: skip


def _reading(content: bytes) -> Callable[[], io.BytesIO]:
    return lambda: io.BytesIO(content)


def table(names: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """The first rows of a file."""
    head = Markup("").join(Markup("<th>{}</th>").format(name) for name in names)
    body = Markup("").join(
        Markup("<tr>{}</tr>").format(
            Markup("").join(Markup("<td>{}</td>").format(cell) for cell in row)
        )
        for row in rows
    )
    whole = "<table><thead><tr>{}</tr></thead><tbody>{}</tbody></table>"
    return str(Markup(f'<div class="preview">{whole}</div>').format(head, body))

"""The texts and lists of the page; whatever comes from a file is escaped."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from importlib.resources import files
from typing import Any
from weakref import WeakKeyDictionary

import panel as pn
from bokeh.models import GlobalInlineStyleSheet, InlineStyleSheet
from markupsafe import Markup

from preisach_jax.diagnosis.exploration import Exploration
from preisach_jax.diagnosis.result import Budget, Candidate, Diagnosis
from preisach_jax.diagnosis.wording import evidence_in_words, plain
from preisach_jax.errors import InputError
from preisach_jax.look import Look
from preisach_jax.present import form_lines, headline, parameter_rows, record_lines
from preisach_jax.quantity import change, number, quantity
from preisach_jax.record.core import Record

_WIDGETS, _HEAD = "preisach-widgets.css", "preisach-head.css"
_SHEETS: WeakKeyDictionary[Any, dict[str, InlineStyleSheet]] = WeakKeyDictionary()

LOOKING = "Looking at the record ..."
DROP_HERE = "Drop a file here, or click to choose one"
KINDS = (
    "CSV and other texts, Excel, LabVIEW, HDF5, MAT, NPZ, Parquet, Feather, MicroMag .forc, or a "
    "saved .preisach project. It stays on this machine."
)
DROP = "Effects that the model may lack are compared here."
CHOOSE = "Choose the columns above: the record is drawn and fitted as soon as they are known."
FIT = "The plain hysteresis model comes first, then the effects it may lack are compared."
NOT_COMPARED = "Nothing has been compared yet; any effect can be added."


FACTS = """
:host { flex: 0 1 24rem !important; }
@media (max-width: 999px) { :host { flex: none !important; width: 100% !important; } }
"""
"""Style of the table of facts beside the plot of a record, or below it."""


@cache
def style_text() -> str:
    """The style sheet of the page as text."""
    return files("preisach_jax.app").joinpath("style.css").read_text(encoding="utf-8")


def style() -> str:
    """The style sheet of the page for one more widget: in a tab the name of one that all share."""
    return _shared(_WIDGETS)


def page_style() -> str:
    """The style sheet of the page for its head, from where all widgets inherit their colours."""
    return _shared(_HEAD)


def _shared(name: str) -> str:
    share_styles()
    return name if pn.state.curdoc in _SHEETS else style_text()


def share_styles() -> None:
    """Let all widgets of the present tab share style sheets, if there is a tab.

    Panel looks the names of sheets up before it asks the server for them, in a store that it
    empties when the page has come to the browser: so this is done again before widgets are made or
    changed.  As texts, the sheets of a hundred widgets would be a megabyte in each tab.
    """
    known: Any = getattr(pn.state, "_stylesheets", None)
    document = pn.state.curdoc
    if document is None or known is None:
        return
    if document not in _SHEETS:
        kinds = {_WIDGETS: InlineStyleSheet, _HEAD: GlobalInlineStyleSheet}
        _SHEETS[document] = {name: kind(css=style_text()) for name, kind in kinds.items()}
    known.setdefault(document, {}).update(_SHEETS[document])


def pane(text: str = "") -> Any:
    """A pane of HTML made by this module, in the page's style."""
    return pn.pane.HTML(text, sizing_mode="stretch_width", stylesheets=[style()], margin=(2, 8))


def brand(name: str) -> str:
    """The heading of the page, with the file that is open."""
    text = '<div class="brand"><h1>preisach</h1><span class="file">{}</span></div>'
    return str(Markup(text).format(name))


def heading(text: str) -> str:
    """The heading of a part of the page."""
    return str(Markup("<h2>{}</h2>").format(text))


def doing(text: str) -> str:
    """A state of affairs, where a screen reader hears it."""
    return str(Markup('<div class="doing" role="status">{}</div>').format(text))


def progress(text: str, done: float) -> str:
    """What goes on and how far it is; a share of 0 is one that is not known."""
    if not text:
        return doing("")
    share = f'style="width:{100 * min(done, 1.0):.0f}%"' if done > 0 else 'class="waiting"'
    track = Markup(f'<div class="track" aria-hidden="true"><span {share}></span></div>')
    return doing(text) + str(track)


def failure(error: Exception) -> Markup:
    """A user's mistake as its message; a failure of ours as such."""
    text = str(error)
    if not isinstance(error, InputError):
        text = f"Internal error: {type(error).__name__}: {text}"
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
    """The errors of all steps as bars, with the floor of noise and discretisation if known."""
    rungs, unit = step.ladder, step.record.output_unit
    most = max(rung.rms_validation for rung in rungs)
    lines: list[Markup] = []
    for place, rung in enumerate(rungs):
        name = f"+ {rung.effects[-1]}" if rung.effects else "Preisach model"
        share = 100 * rung.rms_validation / most
        fall = ""
        if place:
            percent = 100 * (rung.rms_validation / rungs[place - 1].rms_validation - 1)
            fall = f" ({change(percent, 1)})"
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
        Markup('{}<ol class="ladder" aria-label="Held-out error, RMS">{}</ol>{}{}').format(
            _without_hysteresis(step),
            Markup("").join(lines),
            _floor(budget) if budget else "",
            _amounts(step),
        )
    )


def _without_hysteresis(step: Exploration) -> Markup:
    unit = step.record.output_unit
    errors = [f"{m.name} {quantity(m.rms_validation, unit, 3)}" for m in step.memoryless]
    return Markup('<p class="budget">Without hysteresis: {}.</p>').format(", ".join(errors))


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
            *([("jumps", budget.jumps)] if budget.jumps > 0 else []),
            ("unexplained", budget.unexplained),
        )
    ]
    return Markup('<p class="budget">Held-out error (RMS). For the model shown: {}.</p>').format(
        ", ".join(shares)
    )


def verdict(step: Exploration, found: Diagnosis | None) -> str:
    """The error of the present step in large type, and what can be said of it."""
    rms, unit = step.fit.rms_validation, step.record.output_unit
    share = 100 * rms / step.record.output_range
    head, words, is_met = _judgement(step, found)
    kind = "waiting" if is_met is None else "met" if is_met else "unmet"
    return str(
        Markup(
            '<div class="verdict {}"><div><div class="error-size">{}</div>'
            '<div class="share">{} % of the stroke, RMS on held-out rows</div></div>'
            '<div class="words"><b>{}</b>{}</div></div>'
        ).format(kind, quantity(rms, unit, 3), number(share, 2), head, words)
    )


def _judgement(step: Exploration, found: Diagnosis | None) -> tuple[str, Markup, bool | None]:
    """A verdict in a few words, in more, and whether only noise and discretisation are left."""
    paragraph = Markup("<p>{}</p>")
    if found is not None:
        lines = [found.sentence]
        if found.located:
            lines.append(f"What remains: {found.located}.")
            lines += [f"{text}." for text in found.remainder_in_words]
        lines += form_lines(found)
        if found.next_experiment:
            lines.append(f"Record next: {found.next_experiment.text}")
        words = Markup("").join(paragraph.format(line) for line in lines)
        return headline(found), words, found.budget.is_met
    name = step.fit.name
    budget = step.known_budget
    if budget is None:
        return name, paragraph.format("Estimating how much of this is noise."), None
    if budget.is_met:
        head = "Nothing more is missing" if step.effects else "Nothing is missing"
        return head, paragraph.format(f"{name}: what remains is noise and discretisation."), True
    rest = quantity(budget.unexplained, budget.unit, 3)
    words = paragraph.format(f"{name}: {rest} of the error are neither noise nor discretisation.")
    return "Something is missing", words, False


class CandidateRow:
    """An effect as a card: its name, the error it would leave, what speaks for and against it.

    Cards stay, and only what they say changes: to send new ones at every step would be slow.
    """

    def __init__(self, name: str, add: Callable[[], None], framed: Callable[[Any, Any], Any]):
        self._name = name
        self._text = pane()
        self.button: Any = pn.widgets.Button(
            label=f"Add {name}", stylesheets=[style()], margin=(2, 8)
        )
        self.button.on_click(_ignoring(add))
        self.view: Any = framed(self._text, self.button)

    @property
    def text(self) -> str:
        """What the card says, as HTML."""
        return self._text.object

    def show(self, candidate: Candidate | None, step: Exploration) -> None:
        """Say what came of comparing it beside a step, or nothing if it was not compared."""
        convincing = candidate is not None and not candidate.why_not
        self._text.object = str(_candidate(self._name, candidate, step))
        self.button.color = "primary" if convincing else "default"


def _ignoring(called: Callable[[], None]) -> Callable[[Any], None]:
    def on_event(event: Any) -> None:
        del event
        called()

    return on_event


def order_of(step: Exploration, compared: Sequence[Candidate]) -> list[str]:
    """Names of the effects that may be added, the most convincing first."""
    ranked = sorted(compared, key=lambda c: (bool(c.why_not), -c.gain))
    names = [c.effect for c in ranked if c.effect not in step.effects]
    return names + [effect.name for effect in step.left if effect.name not in names]


def _candidate(name: str, candidate: Candidate | None, step: Exploration) -> Markup:
    parts = [Markup("<b>{}</b>").format(name)]
    if candidate is not None and not candidate.why_not:
        parts.append(Markup(' <span class="mark">convincing</span>'))
    if plain(name) != name:
        # Some explain a name in brackets behind it, and it stands above already.
        words = plain(name).removeprefix(f"{name} (")
        words = words.removesuffix(")") if words != plain(name) else words
        parts.append(Markup("<p>{}</p>").format(words))
    if candidate is not None:
        before, after = step.fit.rms_validation, candidate.rms_validation
        if math.isfinite(after):
            unit = step.record.output_unit
            left = 100 * min(after / before, 1.0)
            parts.append(
                Markup(
                    '<p class="leaves">would leave {} of {}</p><span class="gain" '
                    'aria-hidden="true"><span style="width:{:.0f}%"></span></span>'
                ).format(quantity(after, unit, 3), quantity(before, unit, 3), left)
            )
        parts.append(
            Markup("<details><summary>Evidence on {}</summary><p>{}</p></details>").format(
                name, evidence_in_words(candidate)
            )
        )
    return Markup('<div class="candidate">{}</div>').format(Markup("").join(parts))


def facts(found: Look) -> str:
    """What a look at a record finds, in a table, and what the record can tell."""
    rows = [*found.rows(), ("shows well", ", ".join(found.can_tell) or "no effect")]
    poorly = [each.effect for each in found.prospects if each.grade == "poorly"]
    if poorly:
        rows.append(("shows poorly", ", ".join(poorly)))
    if found.cannot_tell:
        rows.append(("does not show", ", ".join(found.cannot_tell)))
    rows += [("to record next", text) for text in found.record_next()[:3]]
    body = Markup("").join(
        Markup('<tr><th scope="row">{}</th><td>{}</td></tr>').format(*line) for line in rows
    )
    return str(Markup('<table class="facts">{}</table>').format(body))


def facts_pane() -> Any:
    """A place for the facts of a look, as wide as a third of the window."""
    shown = pane()
    shown.stylesheets = [*shown.stylesheets, FACTS]
    return shown


def agree(errors: Sequence[float], saved: Sequence[float]) -> bool:
    """Whether the errors of repeated steps are those that were saved, but for rounding."""
    pairs = zip(errors, saved, strict=False)
    return len(errors) == len(saved) and all(math.isclose(a, b, rel_tol=1e-3) for a, b in pairs)


def downloads(files: Mapping[str, bytes]) -> list[Any]:
    """One button a file."""
    return [
        pn.widgets.FileDownload(
            callback=_reading(content), filename=name, label=f"Download {name}",
            color="default", embed=False, sizing_mode="stretch_width", min_width=200,
        )
        for name, content in files.items()
    ]  # fmt: skip


def _reading(content: bytes) -> Callable[[], io.BytesIO]:
    return lambda: io.BytesIO(content)


def table(names: Sequence[str], rows: Sequence[Sequence[str]], label: str) -> str:
    """A table that scrolls by itself where it is too wide; the keyboard and `label` lead there."""
    head = Markup("").join(Markup("<th>{}</th>").format(name) for name in names)
    body = Markup("").join(
        Markup("<tr>{}</tr>").format(
            Markup("").join(Markup("<td>{}</td>").format(cell) for cell in row)
        )
        for row in rows
    )
    whole = "<table><thead><tr>{}</tr></thead><tbody>{}</tbody></table>"
    box = '<div class="preview" tabindex="0" role="region" aria-label="{}">'
    return str(Markup(f"{box}{whole}</div>").format(label, head, body))

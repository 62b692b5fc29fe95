"""The view "Compare": the model of the page under other records, or other models beside it."""

from __future__ import annotations

import base64
import shlex
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import panel as pn
from markupsafe import Markup

from preisach_jax.app import panels
from preisach_jax.app.drive import command_shown
from preisach_jax.app.layout import BLOCK, WRAP, Dropper, button
from preisach_jax.app.upload import MOST_BYTES, Upload
from preisach_jax.diagnosis.comparison import Comparison, compare
from preisach_jax.diagnosis.exploration import Exploration
from preisach_jax.errors import InputError
from preisach_jax.files import json_bytes
from preisach_jax.fit import Progress
from preisach_jax.model import Model
from preisach_jax.record.channels import SAMPLES
from preisach_jax.record.columns import NO_CLOCK, ReadOptions
from preisach_jax.record.core import Record
from preisach_jax.report import write_comparisons
from preisach_jax.report.content import HEADERS, several_rows, several_sentence

OWN_MODEL = "page-model.json"
"""What the model of the page is called, among others and as a file."""


@dataclass(frozen=True)
class Dropped:
    """A file to compare with: a record, or a model where its name ends in .json.

    Attributes:
        name: as the user called it.
        content: its bytes.
    """

    name: str
    content: bytes

    @property
    def is_model(self) -> bool:
        """Whether it is a model."""
        return self.name.lower().endswith(".json") and b'"preisach' in self.content[:2000]


@dataclass(frozen=True)
class Compared:
    """What a comparison shows.

    Attributes:
        found: the comparisons by what each is called, of one model or of one record.
        picture: the overlay as SVG.
        command: the command line that does the same.
        files: contents by name: the report, the model of the page.
    """

    found: dict[str, Comparison]
    picture: bytes
    command: str
    files: dict[str, bytes]


def compared(step: Exploration, dropped: Sequence[Dropped], progress: Progress) -> Compared:
    """Test the model of a step against records, or several models against one record.

    Records alone are compared under the model of the step, beside its own record; models alone
    under its record; several models and one record under that record.
    """
    models = [each for each in dropped if each.is_model]
    records = [each for each in dropped if not each.is_model]
    if models and len(records) > 1:
        raise InputError(
            f"{len(models) + 1} models and {len(records)} records; take away all records but one, "
            "or all models"
        )
    own, name = step.fit.model, step.record.name
    if twice := {OWN_MODEL, name} & {each.name for each in dropped}:
        raise InputError(
            f"{min(twice)}: what is open here is called the same; give the file another name"
        )
    known = {OWN_MODEL: own} | {each.name: _model(each) for each in models}
    found: dict[str, Comparison] = {}
    if models:
        record = _record(records[0], own) if records else step.record
        for k, (title, model) in enumerate(known.items()):
            progress(f"comparing {title}", k / len(known))
            found[title] = compare(model, record)
        names = [*known, records[0].name if records else name]
    else:
        progress(f"comparing {name}", 0.0)
        found[name] = compare(own, step.record)
        for k, each in enumerate(records, start=1):
            progress(f"comparing {each.name}", k / (len(records) + 1))
            found[each.name] = compare(own, _record(each, own))
        names = [OWN_MODEL, *found]
    progress("drawing", 0.95)
    command = shlex.join(["preisach", "compare", *names])
    with tempfile.TemporaryDirectory() as place:
        paths = write_comparisons(found, Path(place), command=command)
        files = {path.name: path.read_bytes() for path in paths}
    picture = files.pop("overlay.svg")
    files[OWN_MODEL] = json_bytes(own.to_json())
    return Compared(found, picture, command, files)


def _model(dropped: Dropped) -> Model:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.json"
        path.write_bytes(dropped.content)
        try:
            return Model.load(path)
        except InputError as error:
            raise InputError(str(error).replace(str(path), dropped.name)) from None


def _record(dropped: Dropped, model: Model) -> Record:
    """The record in a file, by the columns of the model where it has them, else as guessed."""
    upload = Upload.of(dropped.name, dropped.content)
    table = upload.table
    told = {
        role: model.columns[role]
        for role in ("time", "input", "output")
        if model.columns[role] in table.columns
    }
    if model.units.get("time") == SAMPLES:
        told["time"] = NO_CLOCK
    units = {role: model.units[role] for role in told if model.units.get(role)}
    options = {**told, "units": units, "aux": tuple(model.columns["aux"])}
    return Record.of_table(table, dropped.name, **cast(ReadOptions, options))


MOST = 20
"""Files that are compared at once."""

NEEDED = (
    "Records are compared under the model of a record. Drop one above; as soon as its model "
    "stands, drop here what to compare."
)
"""What stands in the view before there is a model."""

_HINT = (
    "Further records: the model is tried on each. Models (.json): each is tried on the record that "
    "is open, or on one record that is dropped beside them."
)
_TEXT = "Drop or choose records or models to compare"


class CompareView:
    """Files to compare, and what came of it.

    Attributes:
        view: what to show in the page.
        files: what is compared, in the order in which it came.
    """

    def __init__(self, compare: Callable[[], None], refuse: Callable[[Exception], None]):
        self._compare, self._refuse = compare, refuse
        self.files: tuple[Dropped, ...] = ()
        self._dropper = Dropper(
            self._on_drop, refuse, MOST_BYTES, _TEXT, hint=_HINT, compact=True, several=True
        )
        self._hint = panels.pane(panels.paragraph(_HINT))
        self._chosen = pn.Row(sizing_mode="stretch_width", stylesheets=[WRAP])
        self._told = panels.pane()
        self._shown = panels.pane()
        self._downloads = pn.Row(sizing_mode="stretch_width", stylesheets=[WRAP])
        self._command = panels.pane()
        self.view: Any = pn.Column(
            self._dropper, self._hint, self._chosen, self._told, self._shown, self._downloads,
            self._command, sizing_mode="stretch_width", stylesheets=[BLOCK],
        )  # fmt: skip

    def show(self, result: Compared) -> None:
        """Show a comparison."""
        self._told.object = ""
        self._shown.object = _shown(result)
        self._downloads.objects = panels.downloads(result.files)
        self._command.object = command_shown(result.command)

    def refuse(self, error: Exception) -> None:
        """Say why there is no comparison; the last one stays."""
        self._told.object = str(panels.failure(error))

    def outdated(self, name: str) -> None:
        """Say that the model of the page is another now, where there is a comparison."""
        if self._shown.object:
            self._told.object = panels.doing(f"The model is now {name}: compare again.")

    def _on_drop(self, name: str, content: bytes) -> None:
        others = tuple(each for each in self.files if each.name != name)
        if len(others) >= MOST:
            self._refuse(InputError(f"{name}: {MOST} files are compared already; take one away"))
            return
        self._use((*others, Dropped(name, content)))

    def _take_away(self, name: str) -> None:
        self._use(tuple(each for each in self.files if each.name != name))

    def _use(self, files: tuple[Dropped, ...]) -> None:
        self.files = files
        self._chosen.objects = [
            button(f"Take away {each.name}", lambda event, name=each.name: self._take_away(name))
            for each in files
        ]
        if files:
            again = button("Compare again", lambda event: self._compare())
            self._chosen.objects = [again, *self._chosen.objects]
            self._compare()
            return
        self._told.object = self._shown.object = self._command.object = ""
        self._downloads.objects = []


def _shown(result: Compared) -> str:
    """Sentence, notes, table and overlay as HTML; names from files are escaped."""
    notes = [f"{name}: {note}" for name, each in result.found.items() for note in each.notes]
    lines = Markup("").join(Markup('<p class="soft">{}</p>').format(note) for note in notes)
    uri = "data:image/svg+xml;base64," + base64.b64encode(result.picture).decode()
    alternative = f"Residuals, loops and errors of {', '.join(result.found)}, drawn over each other"
    return str(
        Markup("<p><b>{}</b></p>").format(several_sentence(result.found))
        + Markup(panels.table(HEADERS, several_rows(result.found), "Comparison"))
        + lines
        + Markup('<img class="overlay" src="{}" alt="{}">').format(uri, alternative)
    )

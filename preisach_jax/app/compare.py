"""The view "Compare": the model of the page under other records, or other models beside it."""

from __future__ import annotations

import base64
from collections.abc import Callable
from typing import Any

import panel as pn
from markupsafe import Markup

from preisach_jax.app import panels
from preisach_jax.app.comparing import Compared, Dropped
from preisach_jax.app.driving import command_shown
from preisach_jax.app.dropper import Dropper
from preisach_jax.app.layout import BLOCK, WRAP, button
from preisach_jax.app.upload import MOST_BYTES
from preisach_jax.errors import InputError
from preisach_jax.report.several import HEADERS, several_rows, several_sentence

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

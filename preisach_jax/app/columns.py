"""Choosing columns and units of a file, from a preview with the guess filled in."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import panel as pn
from markupsafe import Markup

from preisach_jax.app import panels
from preisach_jax.app.upload import Choice, Upload

NO_COLUMN = "(none: sampling rate)"


class ColumnChoice:
    """The preview of a file, and menus for its columns.

    Arguments:
        upload: the file.
        chosen: called with the choice.
        before: what was chosen for this file before, to begin with.
    """

    def __init__(
        self, upload: Upload, chosen: Callable[[Choice], None], before: Choice | None = None
    ):
        self._upload = upload
        self._before = before
        self._chosen = chosen
        names = upload.offered()
        self._roles = {
            role: pn.widgets.Select(
                label=title, options=[*extra, *names], value=self._first(role, [*extra, *names]),
                sizing_mode="stretch_width",
            )
            for role, title, extra in (
                ("time", "Time", [NO_COLUMN]), ("input", "Input", [""]), ("output", "Output", [""])
            )
        }  # fmt: skip
        self._units = {
            role: pn.widgets.TextInput(
                label="Unit",
                width=110,
                value=self._first_unit(role),
                placeholder="such as V, um, ms",
            )
            for role in self._roles
        }
        self._rate = pn.widgets.FloatInput(
            label="Sampling rate (Hz), in place of time",
            value=before.rate if before else None,
            start=0.0,
            width=230,
        )
        self._aux = pn.widgets.MultiSelect(
            label="Auxiliary columns (tried as causes; Ctrl-click for several)", size=4,
            options=names, value=list(before.aux) if before else [],
            sizing_mode="stretch_width",
        )  # fmt: skip
        for role, menu in self._roles.items():
            menu.param.watch(self._on_menu(role), "value")
        use = pn.widgets.Button(label="Use these columns", color="primary")
        use.on_click(self._on_use)
        self._wrong = panels.pane()
        head = Markup("<h1>{}</h1><p>{}</p>").format(
            upload.name,
            upload.question or "The columns were guessed from names and units: look, and correct.",
        )
        self.view: pn.Column = pn.Column(
            panels.pane(str(head)),
            panels.pane(panels.table(*upload.first_rows())),
            *(pn.Row(self._roles[role], self._units[role]) for role in self._roles),
            self._rate, self._aux, use, self._wrong,
            sizing_mode="stretch_both", css_classes=["choice"], scroll=True,
        )  # fmt: skip

    def _first(self, role: str, options: list[str]) -> str:
        before = self._before
        guess = self._upload.guess.get(role) if before is None else getattr(before, role)
        return guess if guess in options else options[0]

    def _first_unit(self, role: str) -> str:
        before = self._before
        return self._unit(role) if before is None else (before.units or {}).get(role, "")

    def _unit(self, role: str) -> str:
        column = self._roles[role].value
        if column in ("", NO_COLUMN):
            return ""
        return self._upload.unit(column) or ("s" if role == "time" else "")

    def _on_menu(self, role: str) -> Callable[[Any], None]:
        def changed(event: Any) -> None:
            del event
            self._units[role].value = self._unit(role)

        return changed

    def _on_use(self, event: Any) -> None:
        del event
        named = {role: menu.value for role, menu in self._roles.items()}
        time = named["time"]
        rate = self._rate.value if time == NO_COLUMN else None
        missing = [role for role in ("input", "output") if not named[role]]
        if time == NO_COLUMN and not rate:
            missing.insert(0, "time (or the sampling rate)")
        if missing:
            text = f"Choose the column of {' and of '.join(missing)}."
            self._wrong.object = str(panels.mistake(text))
            return
        self._wrong.object = ""
        units = {
            role: field.value.strip()
            for role, field in self._units.items()
            if field.value.strip() and not (role == "time" and rate)
        }
        self._chosen(
            Choice(
                None if rate else time,
                named["input"],
                named["output"],
                tuple(self._aux.value),
                rate,
                units,
            )
        )

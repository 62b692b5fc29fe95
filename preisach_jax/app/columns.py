"""The columns of a file as a row of menus over the plot; each change is taken at once.

Where names and units do not tell input and output, each pair of columns is drawn as a small loop to
choose from.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import panel as pn

from preisach_jax.app import panels
from preisach_jax.app.layout import BLOCK, styled
from preisach_jax.app.upload import Upload
from preisach_jax.record.columns import NO_CLOCK, ReadOptions, signals_of

NO_COLUMN = "(none)"

ALL = 0
"""What the menu of tables holds where none is chosen."""

MOST_DRAWN = 6
"""Columns of which each pair is drawn."""

PICTURE, POINTS = 72, 400
"""Size of such a picture in pixels, and its points."""

_CHIPS = """
:host { min-width: 0 !important; flex-wrap: wrap !important; gap: 0.3rem 0.9rem;
  align-items: flex-end; }
"""
_CHIP = ":host { gap: 0; align-items: flex-end; flex: 0 0 auto; }"


def loop_picture(path: np.ndarray, answer: np.ndarray) -> str:
    """A small picture of one column over another, as SVG."""
    some = np.unique(np.linspace(0, len(path) - 1, POINTS).astype(int))
    some = some[np.isfinite(path[some]) & np.isfinite(answer[some])]

    def placed(values: np.ndarray) -> np.ndarray:
        low, high = values.min(), values.max()
        return 4 + (PICTURE - 8) * (values - low) / (high - low if high > low else 1.0)

    points = ""
    if some.size:
        pairs = zip(placed(path[some]), PICTURE - placed(answer[some]), strict=True)
        points = " ".join(f"{x:.1f},{y:.1f}" for x, y in pairs)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{PICTURE}" height="{PICTURE}" '
        f'viewBox="0 0 {PICTURE} {PICTURE}" fill="none" stroke="currentColor">'
        f'<polyline points="{points}" /></svg>'
    )


class ColumnChoice:
    """Menus for the columns of a file and their units, with the guess filled in."""

    def __init__(
        self,
        upload: Upload,
        chosen: Callable[[ReadOptions], None],
        before: ReadOptions | None = None,
    ):
        self._upload = upload
        self._before = before
        self._chosen = chosen
        self._last: ReadOptions | None = None
        names = upload.offered()
        self._roles: dict[str, Any] = {}
        for role, title, extra in (
            ("time", "Time", [NO_COLUMN]), ("input", "Input", [""]), ("output", "Output", [""])
        ):  # fmt: skip
            options = [*extra, *names]
            menu = pn.widgets.Select(
                label=title, options=options, value=self._first(role, options), width=130
            )
            self._roles[role] = styled(menu)
        self._units = {
            role: styled(
                pn.widgets.TextInput(
                    label=f"Unit of {role}", width=90, value=self._first_unit(role),
                    placeholder="such as V",
                )
            )
            for role in self._roles
        }  # fmt: skip
        self._rate = styled(
            pn.widgets.FloatInput(
                label="Sampling rate (Hz)", value=before.get("rate") if before else None, start=0.0,
                width=150, visible=self._roles["time"].value == NO_COLUMN,
            )
        )  # fmt: skip
        self._aux = styled(
            pn.widgets.MultiSelect(
                label="Auxiliary columns (Ctrl-click)", size=3, options=names,
                value=list(before.get("aux", ())) if before else [],
                width=190, visible=len(names) > 3,
            )
        )  # fmt: skip
        for role, menu in self._roles.items():
            menu.param.watch(self._on_menu(role), "value")
        for field in (*self._units.values(), self._rate, self._aux):
            field.param.watch(self._on_change, "value")
        self._table = styled(
            pn.widgets.Select(
                label="Table", options=self._tables(), value=(before or {}).get("table") or ALL,
                width=190, visible=len(upload.tables) > 1,
            )
        )  # fmt: skip
        self._table.param.watch(self._on_change, "value")
        self._pictures = pn.FlexBox(*self._pairs(), visible=bool(self._missing()))
        self._told = panels.pane(self._advice())
        chips = [
            pn.Row(self._roles[role], self._units[role], width=245, stylesheets=[_CHIP])
            for role in self._roles
        ]
        row = pn.Row(
            *chips, self._rate, self._aux, self._table,
            sizing_mode="stretch_width", stylesheets=[_CHIPS],
        )  # fmt: skip
        self.view: Any = pn.Column(
            row, self._told, self._pictures, sizing_mode="stretch_width", stylesheets=[BLOCK]
        )

    def choice(self) -> ReadOptions | None:
        """What is chosen; None while a column is missing."""
        if self._missing():
            return None
        time = self._roles["time"].value
        rate = self._rate.value if time == NO_COLUMN else None
        units = {
            role: field.value.strip()
            for role, field in self._units.items()
            if field.value.strip() and not (role == "time" and time == NO_COLUMN)
        }
        return {
            "time": None if rate else NO_CLOCK if time == NO_COLUMN else time,
            "input": self._roles["input"].value,
            "output": self._roles["output"].value,
            "aux": tuple(self._aux.value),
            "rate": rate,
            "units": units,
            "table": self._table.value or None,
        }

    def _tables(self) -> dict[str, int]:
        """The tables of the file by what its menu calls them: all as several records, or one."""
        tables = self._upload.tables
        each = {
            f"{k}: rows {table.rows[0]:,} to {table.rows[-1]:,}": k
            for k, table in enumerate(tables, start=1)
        }
        return {f"all {len(tables)}, as records of one specimen": ALL, **each}

    def _pairs(self) -> list[Any]:
        """A button for each pair of columns that may be input and output, with its loop."""
        if not (self._missing() and self._upload.is_open):
            return []
        table = self._upload.table
        found: list[Any] = []
        for driving, answering in itertools.combinations(signals_of(table)[:MOST_DRAWN], 2):
            path, answer = table.lenient_numbers(driving), table.lenient_numbers(answering)
            assert path is not None  # or it were no signal
            assert answer is not None
            made = pn.widgets.Button(
                label=f"{driving} → {answering}", icon=loop_picture(path, answer),
                icon_size=f"{PICTURE}px",
            )  # fmt: skip
            made.on_click(partial(self._on_pair, driving, answering))
            found.append(styled(made))
        return found

    def _on_pair(self, driving: str, answering: str, event: Any) -> None:
        del event
        self._roles["input"].value, self._roles["output"].value = driving, answering

    def first(self) -> ReadOptions | None:
        """What is chosen before anything is changed; None while a column is missing."""
        self._last = self.choice()
        return self._last

    def take(self) -> None:
        """Hand the choice on, if it is complete and another than before."""
        choice = self.choice()
        self._told.object = self._advice()
        self._pictures.visible = choice is None
        if choice is not None and choice != self._last:
            self._last = choice
            self._chosen(choice)

    def _missing(self) -> list[str]:
        return [role for role in ("input", "output") if not self._roles[role].value]

    def _advice(self) -> str:
        if missing := self._missing():
            text = f"Choose the column of {' and of '.join(missing)}."
            question = self._upload.question
            if self._upload.is_open:
                text += " Or press the loop that is right: across is the input, upwards the output."
            return panels.doing(f"{question} {text}" if question else text)
        if self._roles["time"].value == NO_COLUMN and not self._rate.value:
            return panels.doing("Without a time samples are counted; give the rate if you know it.")
        if self._last is None and self._before is None and not self._upload.question:
            return panels.doing("Columns guessed from names and units; change any of them here.")
        return panels.doing("")

    def _first(self, role: str, options: list[str]) -> str:
        before = self._before
        guess = self._upload.guess.get(role) if before is None else before.get(role)
        return guess if guess in options else options[0]

    def _first_unit(self, role: str) -> str:
        before = self._before
        return self._unit(role) if before is None else (before.get("units") or {}).get(role, "")

    def _unit(self, role: str) -> str:
        column = self._roles[role].value
        if column in ("", NO_COLUMN):
            return ""
        return self._upload.unit(column) or ("s" if role == "time" else "")

    def _on_menu(self, role: str) -> Callable[[Any], None]:
        def changed(event: Any) -> None:
            del event
            self._rate.visible = self._roles["time"].value == NO_COLUMN
            unit = self._unit(role)
            if self._units[role].value != unit:
                self._units[role].value = unit  # which hands the choice on
            else:
                self.take()

        return changed

    def _on_change(self, event: Any) -> None:
        del event
        self.take()

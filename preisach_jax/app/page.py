"""The page: a file, its columns, a fit, four linked views, and what may be missing."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import panel as pn
from markupsafe import Markup

from preisach_jax.app import panels
from preisach_jax.app.columns import ColumnChoice
from preisach_jax.app.export import exports
from preisach_jax.app.jobs import Job
from preisach_jax.app.script import Click
from preisach_jax.app.upload import MOST_BYTES, Choice, Upload
from preisach_jax.app.views import AXES, Views, record_view
from preisach_jax.diagnosis import diagnose
from preisach_jax.diagnosis.exploration import Exploration, explore
from preisach_jax.diagnosis.result import Candidate, Diagnosis
from preisach_jax.diagnosis.selection import effects_to_try
from preisach_jax.fit import Fit, Progress
from preisach_jax.record import Record

LEVELS = {"25 levels, finer where it pays": 0, "13 levels": 13, "38 levels": 38, "50 levels": 50}
"""Levels of the plane by what the menu calls them; 0 leaves them to the fit."""


class State(NamedTuple):
    """Where the page is: what a search that is cancelled goes back to."""

    step: Exploration | None
    clicks: list[Click]
    found: Diagnosis | None
    candidates: tuple[Candidate, ...]


class Page:
    """One tab of a browser: its file, its model, and the work that goes on for it.

    Arguments:
        first: a file to begin with, None for an empty page.
    """

    def __init__(self, first: Path | None = None):
        self._document = pn.state.curdoc
        self._folder = tempfile.TemporaryDirectory(prefix="preisach-app-")
        self._upload: Upload | None = None
        self._choice: Choice | None = None
        self._record: Record | None = None
        self._step: Exploration | None = None
        self._candidates: tuple[Candidate, ...] = ()
        self._found: Diagnosis | None = None
        self._clicks: list[Click] = []
        self._views: Views | None = None
        self._job: Job | None = None
        self._before_search: State | None = None
        self._build()
        self._refresh()
        if first is not None:
            self._open(lambda: Upload.at(first))

    def _build(self) -> None:
        self._dropper = pn.widgets.FileDropper(
            multiple=False, height=90, max_file_size=f"{MOST_BYTES // 1_000_000}MB", previews=[],
            sizing_mode="stretch_width", width=None,
        )  # fmt: skip
        self._dropper.param.watch(self._on_drop, "value")
        self._message = panels.pane()
        self._progress = pn.indicators.Progress(
            value=0, max=100, sizing_mode="stretch_width", visible=False, bar_color="primary"
        )
        self._doing = panels.pane()
        self._levels = pn.widgets.Select(label="Preisach plane", options=LEVELS, width=250)
        self._fit = _button("Fit", self._on_fit, "primary")
        self._find = _button("Find it for me", self._on_find, "success")
        self._undo = _button("Undo", self._on_undo)
        self._cancel = _button("Cancel", self._on_cancel)
        self._other = _button("Other columns", self._on_other_columns)
        self._axis = pn.widgets.Select(
            label="Residual against", options={text: key for key, text in AXES.items()}, width=230
        )
        self._axis.param.watch(self._on_axis, "value")
        self._ladder = panels.pane()
        self._verdict = panels.pane()
        self._advice = panels.pane()
        self._rows: dict[str, panels.CandidateRow] = {}
        self._list = pn.Column(sizing_mode="stretch_width", css_classes=["candidates"])
        self._prepare = _button("Prepare export", self._on_export)
        self._downloads = pn.Column(sizing_mode="stretch_width")
        self._main = pn.Column(sizing_mode="stretch_both", css_classes=["main"])
        side = pn.Column(
            panels.pane(panels.heading("1", "Record")),
            self._dropper, self._other, self._message,
            panels.pane(panels.heading("2", "Model")),
            self._levels, pn.Row(self._fit, self._find, self._undo, self._cancel),
            self._doing, self._progress, self._verdict, self._ladder,
            panels.pane(panels.heading("3", "What may be missing")),
            self._advice,
            self._list,
            panels.pane(panels.heading("4", "Export")),
            self._prepare, self._downloads,
            width=370, sizing_mode="stretch_height", scroll=True, css_classes=["side"],
        )  # fmt: skip
        self.view: pn.Row = pn.Row(side, self._main, sizing_mode="stretch_both")

    def close(self) -> None:
        """Let go of everything when the tab is closed."""
        self._stop_job()
        self._folder.cleanup()

    # A file and its columns

    def _on_drop(self, event: Any) -> None:
        if not event.new:
            return
        name, content = list(event.new.items())[-1]
        content = content.encode() if isinstance(content, str) else content
        self._open(lambda: Upload.of(name, content, Path(self._folder.name)))

    def _open(self, read: Callable[[], Upload]) -> None:
        # What was there before is let go only once the file has been read.
        self._start("reading the file", lambda progress: read(), self._show_columns)

    def _show_columns(self, upload: Upload) -> None:
        self._stop_job()
        self._record = self._step = self._views = self._found = None
        if upload is not self._upload:
            self._choice = None
        self._upload, self._clicks, self._candidates = upload, [], ()
        self._downloads.objects = []
        self._say("")
        choosing = ColumnChoice(upload, self._on_columns, self._choice)
        self._main.objects = [choosing.view]
        self._refresh()

    def _on_other_columns(self, event: Any) -> None:
        del event
        if self._upload is not None:
            self._show_columns(self._upload)

    def _on_columns(self, choice: Choice) -> None:
        upload = self._upload
        assert upload is not None  # the columns shown are those of an upload
        notes: list[str] = []

        def show(record: Record) -> None:
            self._record, self._choice, self._clicks = record, choice, []
            self._say(panels.told(record, notes))
            self._show_record(record)
            self._refresh()

        work = partial(upload.record, choice, announce=notes.append)
        self._start("reading the columns", lambda progress: work(), show)

    def _show_record(self, record: Record) -> None:
        self._views = None
        self._main.objects = [pn.pane.Bokeh(record_view(record), sizing_mode="stretch_both")]

    # Fit, add, undo, find

    def _on_fit(self, event: Any) -> None:
        del event
        record, levels = self._record, self._levels.value or None
        if record is None:
            return
        self._start(
            "fitting",
            lambda progress: explore(record, levels=levels, progress=progress),
            lambda step: self._go_to(step, [Click("fit", levels)]),
        )

    def _on_add(self, name: str) -> None:
        step = self._step
        if step is None or name in step.effects or self._before_search:
            return  # pressed before the page has shown that it was added
        self._start(
            f"adding {name}",
            lambda progress: step.add(name, progress),
            lambda new: self._go_to(new, [*self._clicks, Click("add", effect=name)]),
        )

    def _on_undo(self, event: Any) -> None:
        del event
        if self._step is not None and self._step.before is not None:
            self._stop_job()
            self._go_to(self._step.before, [*self._clicks, Click("undo")])

    def _on_find(self, event: Any) -> None:
        del event
        record, levels = self._record, self._levels.value or None
        if record is None:
            return

        tried = effects_to_try(record, None)

        def find(progress: Progress) -> tuple[Diagnosis, Exploration]:
            step: list[Exploration] = []

            def watch(fit: Fit, candidates: tuple[Candidate, ...]) -> None:
                before = next((s for s in reversed(step) if s.effects == fit.effects[:-1]), None)
                now = Exploration(fit, tried, before)
                step.append(now)
                self._hand_over(lambda: self._watch(now, candidates))

            found = diagnose(record, levels=levels, progress=progress, watch=watch)
            return found, Exploration.of(found)

        before = State(self._step, self._clicks, self._found, self._candidates)
        self._start("searching", find, lambda both: self._found_it(both[0], both[1], levels))
        self._before_search = before
        self._refresh()

    def _watch(self, step: Exploration, candidates: tuple[Candidate, ...]) -> None:
        """Show a step of the search while it goes on."""
        self._step, self._found = step, None
        last = max((c.step for c in candidates), default=0)
        self._candidates = tuple(c for c in candidates if c.step == last)
        self._show_step()

    def _found_it(self, found: Diagnosis, step: Exploration, levels: int | None) -> None:
        self._before_search = None
        self._candidates = tuple(c for c in found.candidates if c.step == len(found.effects))
        self._go_to(step, [Click("find", levels)], found)

    def _go_to(
        self, step: Exploration, clicks: list[Click], found: Diagnosis | None = None
    ) -> None:
        self._step, self._clicks, self._found = step, clicks, found
        if found is None:
            self._candidates = step.known_candidates
        self._show_step()
        if not self._candidates:
            self._rank(step)

    def _rank(self, step: Exploration) -> None:
        """Compare what may be missing, while the step can be looked at."""

        def rank(progress: Progress) -> tuple[Candidate, ...]:
            step.budget()
            return step.candidates(progress)

        def show(candidates: tuple[Candidate, ...]) -> None:
            self._candidates = candidates
            self._refresh()

        self._start("comparing what may be missing", rank, show)

    def _show_step(self) -> None:
        step = self._step
        assert step is not None  # called for a step only
        if self._views is None or self._views.levels != step.fit.model.plane.levels:
            self._views = Views(step, self._axis.value)
            drawn = pn.pane.Bokeh(self._views.layout, sizing_mode="stretch_both")
            self._main.objects = [self._axis, drawn]
        else:
            self._views.show(step)
        self._hand_over(self._views.begin)
        self._downloads.objects = []
        self._refresh()

    def _on_axis(self, event: Any) -> None:
        if self._views is not None:
            self._views.show_axis(event.new)
            self._views.begin()

    # Export

    def _on_export(self, event: Any) -> None:
        del event
        step, upload, choice = self._step, self._upload, self._choice
        if step is None or upload is None or choice is None:
            return
        found, clicks = self._found, list(self._clicks)

        def work(progress: Progress) -> dict[str, bytes]:
            return exports(step, found, upload.name, choice, clicks, progress)

        self._start("writing the report", work, self._offer)

    def _offer(self, files: dict[str, bytes]) -> None:
        self._downloads.objects = panels.downloads(files)
        if self._step is not None and not self._candidates:
            self._rank(self._step)  # which the export has cut short
        self._refresh()

    # Work and what is said

    def _start(
        self, what: str, work: Callable[[Progress], Any], done: Callable[[Any], None]
    ) -> None:
        self._stop_job()

        def finished(result: Any) -> None:
            self._job = None
            self._say_progress("", 0.0)
            done(result)

        def failed(error: Exception) -> None:
            self._stop_job()
            self._say(panels.failure(error))
            self._refresh()

        self._say_progress(what, 0.0)
        self._job = Job(
            work, hand_over=self._hand_over, on_progress=self._say_progress, on_done=finished,
            on_error=failed,
        )  # fmt: skip
        self._refresh()

    def _hand_over(self, function: Callable[[], None]) -> None:
        document = self._document
        if document is None or document.session_context is None:
            function()  # without a server there is no other thread to hand it to
        else:
            document.add_next_tick_callback(partial(_at_once, function))

    def _stop_job(self) -> None:
        if self._job is not None:
            self._job.cancel()
            self._job = None
            self._say_progress("", 0.0)
        if self._before_search is not None:
            # A search that is cut short leaves nothing: a half of it can not be repeated.
            before, self._before_search = self._before_search, None
            self._step, self._clicks, self._found, self._candidates = before

    def _on_cancel(self, event: Any) -> None:
        del event
        was_searching = self._before_search is not None
        self._stop_job()
        if was_searching and self._step is not None:
            self._show_step()
        elif was_searching and self._record is not None:
            self._show_record(self._record)
        self._refresh()

    def _say_progress(self, text: str, done: float) -> None:
        self._progress.visible = bool(text)
        self._progress.value = int(100 * np.clip(done, 0, 1)) if done > 0 else -1
        self._doing.object = panels.doing(text)

    def _say(self, text: Markup | str) -> None:
        self._message.object = str(Markup.escape(text))

    def _refresh(self) -> None:
        """What can be pressed now, and what is said of the present step."""
        step, busy = self._step, self._job is not None
        self._advice.object = panels.paragraph(self._advise())
        searching = self._before_search is not None
        self._fit.disabled = self._find.disabled = self._record is None or searching
        self._other.visible = self._record is not None
        self._undo.disabled = step is None or step.before is None or searching
        self._cancel.disabled = not busy
        self._prepare.disabled = step is None or searching
        if step is None:
            self._ladder.object = self._verdict.object = ""
            self._list.objects = []
            return
        self._ladder.object = panels.ladder(step, self._found)
        self._verdict.object = panels.verdict(step, self._found)
        self._show_candidates(step)

    def _advise(self) -> str:
        """What to do next."""
        if self._step is not None:
            return "" if self._candidates else panels.NOT_COMPARED
        if self._record is not None:
            return panels.FIT
        return panels.DROP if self._upload is None else panels.CHOOSE

    def _show_candidates(self, step: Exploration) -> None:
        compared = {candidate.effect: candidate for candidate in self._candidates}
        shown = []
        for name in panels.order_of(step, self._candidates):
            if name not in self._rows:
                self._rows[name] = panels.CandidateRow(name, partial(self._on_add, name))
            self._rows[name].show(compared.get(name))
            shown.append(self._rows[name].view)
        if shown != self._list.objects:
            self._list.objects = shown


def _button(name: str, clicked: Callable[[Any], None], kind: str = "default") -> Any:
    button = pn.widgets.Button(label=name, color=kind)
    button.on_click(lambda event: _at_once(partial(clicked, event)))
    return button


def _at_once(change: Callable[[], None]) -> None:
    """Send all that changes in one message, so that a tab never shows half of a step."""
    with pn.io.hold():
        change()

"""What is open in the page: a file, its columns, its record, and what a look at it finds."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from preisach_jax.app import panels
from preisach_jax.app.columns import ColumnChoice
from preisach_jax.app.first import FirstView
from preisach_jax.app.jobs import Working
from preisach_jax.app.layout import Layout, beside, plots
from preisach_jax.app.project import SUFFIX, Project, unpacked
from preisach_jax.app.upload import Upload
from preisach_jax.fit import Progress
from preisach_jax.look import Look, columns_of, look
from preisach_jax.record import ReadOptions, Record


class Opening(Working):
    """From a file that came to its record; what is then done with it is the page's.

    Arguments:
        layout: the widgets of the page.
    """

    def __init__(self, layout: Layout):
        self._layout = layout
        self._folder = tempfile.TemporaryDirectory(prefix="preisach-app-")
        self._upload: Upload | None = None
        self._choosing: ColumnChoice | None = None
        self._choice: ReadOptions | None = None
        self._record: Record | None = None
        self._first_view: FirstView | None = None
        self._look: Look | None = None
        self._notes: list[str] = []
        self._project: Project | None = None
        super().__init__(layout.doing, layout.message)

    def close(self) -> None:
        """Let go of everything when the tab is closed."""
        self._stop_job()
        self._folder.cleanup()

    def _show_pane(self, name: str) -> None:
        """Show one of the panes in the great part of the page."""

    def _fit(self) -> None:
        """Fit the record that has been opened."""

    def _forget_record(self) -> None:
        """Let go of the record; called when another one takes its place."""
        self._record = self._first_view = self._look = None
        self._notes = []

    def _on_drop(self, name: str, content: bytes) -> None:
        folder = Path(self._folder.name)
        if name.lower().endswith(SUFFIX):
            self._open_project(name, content)
        else:
            self._open(name, lambda: Upload.of(name, content, folder))

    def _open(self, name: str, read: Callable[[], Upload]) -> None:
        # What was there before is let go only once the file has been read.
        self._start(f"reading {name}", lambda progress: read(), self._show_upload)

    def _open_project(self, name: str, content: bytes) -> None:
        def read(progress: Progress) -> tuple[Project, Upload]:
            project = unpacked(name, content)
            return project, Upload.of(project.name, project.content, Path(self._folder.name))

        def show(both: tuple[Project, Upload]) -> None:
            self._project, self._choice = both[0], both[0].choice
            self._show_upload(both[1], both[0].choice)

        self._start(f"opening {name}", read, show)

    def _show_upload(self, upload: Upload, choice: ReadOptions | None = None) -> None:
        self._upload, self._choice = upload, choice
        self._layout.dropper.compact = True
        if choice is None:
            self._project = None
        self._forget_record()
        self._say("")
        self._layout.file.object = panels.brand(upload.name)
        self._choosing = ColumnChoice(upload, self._on_columns, choice)
        self._layout.chips.objects = [self._choosing.view]
        self._show_pane("Record")
        self._refresh()
        self._choosing.take()

    def _on_columns(self, choice: ReadOptions) -> None:
        upload = self._upload
        assert upload is not None  # the columns are those of an upload
        if self._project is not None and choice != self._project.choice:
            self._project = None  # it was of other columns
        notes: list[str] = []

        def show(record: Record) -> None:
            self._forget_record()
            self._record, self._choice, self._notes = record, choice, notes
            self._say(panels.told(record, notes))
            self._first_view = FirstView(record)
            self._show_pane("Record")
            self._examine(record, upload)

        work = partial(upload.record, {**choice, "announce": notes.append})
        self._start("reading the columns", lambda progress: work(), show)

    def _examine(self, record: Record, upload: Upload) -> None:
        """Look at the record while its plot stands already, then fit it."""
        roles = {
            role if role in ("time", "input", "output") else "aux": channel.name
            for role, channel in record.channels.items()
        }

        def work(progress: Progress) -> Look:
            return look(record, columns=columns_of(upload.table, roles), notes=self._notes)

        def show(found: Look) -> None:
            self._look = found
            if self._first_view is not None:
                self._first_view.mark(found)
            self._show_pane("Record")
            self._fit()

        self._start("looking at the record", work, show)

    def _record_pane(self) -> list[Any]:
        upload, first, found = self._upload, self._first_view, self._look
        parts = [plots(first.layout)] if first is not None else []
        if found is not None:
            parts.append(panels.facts_pane(found))
        preview = [panels.pane(panels.table(*upload.first_rows()))] if upload is not None else []
        return [beside(*parts), *preview]

    def _refuse(self, error: Exception) -> None:
        """Say why a file is not taken; what was open stays."""
        self._say(panels.failure(error))

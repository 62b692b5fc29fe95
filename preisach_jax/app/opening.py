"""What is open in the page: a file, its columns, its record, and what a look at it finds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from preisach_jax.app import panels
from preisach_jax.app.columns import ColumnChoice
from preisach_jax.app.first import Curves, FirstView
from preisach_jax.app.jobs import Working
from preisach_jax.app.layout import Layout
from preisach_jax.app.steps import SUFFIX, Project, unpacked
from preisach_jax.app.upload import Upload
from preisach_jax.errors import InputError
from preisach_jax.fit import Progress
from preisach_jax.look import Look, columns_of, look
from preisach_jax.record.columns import ReadOptions
from preisach_jax.record.core import Record
from preisach_jax.record.joined import as_one


@dataclass(frozen=True)
class Content:
    """What the chosen columns of a file hold.

    Attributes:
        choice: the columns.
        record: the record in them; several that were joined.
        first: the first of them, at which a look is taken.
        curves: what is drawn of it.
        notes: what was assumed when it was read.
    """

    choice: ReadOptions
    record: Record
    first: Record
    curves: Curves
    notes: list[str]

    @staticmethod
    def of(upload: Upload, choice: ReadOptions) -> Content:
        """Read the chosen columns of a file."""
        notes: list[str] = []
        records = upload.records({**choice, "announce": notes.append})
        if all(choice.get(role) == upload.guess[role] for role in ("input", "output")):
            notes += upload.said
        record = as_one(records)
        return Content(choice, record, records[0], Curves.of(record), list(dict.fromkeys(notes)))


@dataclass(frozen=True)
class Opened:
    """A file that was read.

    Attributes:
        upload: its table.
        choosing: the menus of its columns.
        content: the record, None while a column is missing.
        error: why there is none, where the columns are known and cannot be used.
    """

    upload: Upload
    choosing: ColumnChoice
    content: Content | None
    error: InputError | None

    @staticmethod
    def of(
        upload: Upload, chosen: Callable[[ReadOptions], None], before: ReadOptions | None = None
    ) -> Opened:
        """Read the columns of a file as they are guessed, or as they were chosen before."""
        choosing = ColumnChoice(upload, chosen, before)
        choice = choosing.first()
        content, error = None, None
        if choice is not None:
            try:
                content = Content.of(upload, choice)
            except InputError as wrong:
                error = wrong
        return Opened(upload, choosing, content, error)


class Opening(Working):
    """From a file that came to its record; what is then done with it is the page's."""

    def __init__(self, layout: Layout):
        self._layout = layout
        self._upload: Upload | None = None
        self._choosing: ColumnChoice | None = None
        self._choice: ReadOptions | None = None
        self._record: Record | None = None
        self._first_view = FirstView()
        layout.place_record(self._first_view.layout)
        self._look: Look | None = None
        self._notes: list[str] = []
        self._project: Project | None = None
        super().__init__(layout.doing, layout.message)

    def close(self) -> None:
        """Let go of everything when the tab is closed."""
        self._stop_job()

    def _show_pane(self, name: str) -> None:
        """Show one of the panes in the great part of the page."""

    def _fit(self) -> None:
        """Fit the record that has been opened."""

    def _forget_record(self) -> None:
        """Let go of the record; called when another one takes its place."""
        self._record = self._look = None
        self._notes = []

    def open_file(self, path: Path) -> None:
        """Open a file of this machine, which is read once: what is saved later is what was read."""
        self._open(path.name, lambda: Upload.of(path.name, path.read_bytes()))

    def _on_drop(self, name: str, content: bytes) -> None:
        if name.lower().endswith(SUFFIX):
            self._open_project(name, content)
        else:
            self._open(name, lambda: Upload.of(name, content))

    def _open(self, name: str, read: Callable[[], Upload]) -> None:
        # What was there before is let go only once the file has been read.
        self._start(f"reading {name}", lambda progress: self._opened(read()), self._show_opened)

    def _opened(self, upload: Upload, before: ReadOptions | None = None) -> Opened:
        return Opened.of(upload, self._on_columns, before)

    def _open_project(self, name: str, content: bytes) -> None:
        def read(progress: Progress) -> tuple[Project, Opened]:
            project = unpacked(name, content)
            upload = Upload.of(project.name, project.content)
            return project, self._opened(upload, project.choice)

        self._start(f"opening {name}", read, lambda both: self._show_opened(both[1], both[0]))

    def _show_opened(self, opened: Opened, project: Project | None = None) -> None:
        if opened.error is not None and self._record is not None:
            self._refuse(opened.error)
            return
        upload = self._upload = opened.upload
        self._choosing, self._project = opened.choosing, project
        self._choice = project.choice if project else None
        self._forget_record()
        self._layout.dropper.compact = True
        self._layout.file.object = panels.brand(upload.name)
        self._layout.chips.objects = [opened.choosing.view]
        self._layout.preview.object = panels.table(*upload.first_rows(), "First rows of the file")
        self._say("")
        if opened.content is not None:
            self._show_content(opened.content)
            return
        if opened.error is not None:
            self._refuse(opened.error)
        self._show_pane("Record")

    def _on_columns(self, choice: ReadOptions) -> None:
        upload = self._upload
        assert upload is not None  # the columns are those of an upload
        if self._project is not None and choice != self._project.choice:
            self._project = None  # it was of other columns

        def show(content: Content) -> None:
            self._forget_record()
            self._show_content(content)

        self._start("reading the columns", lambda progress: Content.of(upload, choice), show)

    def _show_content(self, content: Content) -> None:
        """Draw a record, and look at it while its plot stands already."""
        self._record, self._choice, self._notes = content.record, content.choice, content.notes
        self._say(panels.told(content.record, content.notes))
        self._first_view.show(content.curves)
        self._layout.facts.object = panels.doing(panels.LOOKING)
        self._show_pane("Record")
        assert self._upload is not None  # the record is that of an upload
        self._examine(content.first, self._upload)

    def _examine(self, record: Record, upload: Upload) -> None:
        """Look at the record, then fit it."""

        def work(progress: Progress) -> Look:
            columns = columns_of(upload.table, record.channels)
            return look(record, columns=columns, notes=self._notes)

        def show(found: Look) -> None:
            self._look = found
            self._first_view.mark(found)
            self._layout.facts.object = panels.facts(found)
            self._fit()

        self._start("looking at the record", work, show)

    def _refuse(self, error: Exception) -> None:
        """Say why a file is not taken; what was open stays."""
        self._say(panels.failure(error))

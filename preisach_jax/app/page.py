"""The page: a file is drawn as it comes, fitted by itself, and what it may lack is compared."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from preisach_jax.app import compare, panels
from preisach_jax.app.compare import Compared, compared
from preisach_jax.app.drive import NEEDED, Driven, DriveView, driven
from preisach_jax.app.jobs import Job
from preisach_jax.app.layout import Layout, beside, card, plots, show
from preisach_jax.app.opening import Opened, Opening
from preisach_jax.app.steps import (
    Click,
    Project,
    Walk,
    exports,
    repeated,
    saved,
    searched,
    time_line,
)
from preisach_jax.app.views import Views
from preisach_jax.diagnosis.exploration import Exploration, explore
from preisach_jax.diagnosis.result import Candidate, Diagnosis
from preisach_jax.fit import Progress


class Page(Opening):
    """One tab of a browser: its file, its model, and the work that goes on for it."""

    def __init__(self):
        self._walk: Walk | None = None
        self._candidates: tuple[Candidate, ...] = ()
        self._lined_up: Walk | None = None  # the walk whose steps stand in the time line
        self._views: Views | None = None
        self._drive: DriveView | None = None
        self._drive_job: Job | None = None
        self._compare: compare.CompareView | None = None
        self._before_search: tuple[Walk | None, tuple[Candidate, ...]] | None = None
        self._rows: dict[str, panels.CandidateRow] = {}
        # What can be shown in the great part of the page, by what its switch calls it.
        self._panes: dict[str, Callable[[], list[Any]]] = {
            "Record": list, "Model": self._model_pane, "Drive": self._drive_pane,
            "Compare": self._compare_pane,
        }  # fmt: skip
        self._is_drawn = ""
        self._columns_are_folded = True
        layout = Layout(
            {
                "drop": self._on_drop, "refuse": self._refuse, "levels": self._on_levels,
                "fit": self._on_fit, "find": self._on_find, "form": self._on_form,
                "undo": self._on_undo, "cancel": self._on_cancel, "axis": self._on_axis,
                "fold": self._on_fold, "shown": self._on_shown, "export": self._on_export,
                "save": self._on_save,
            }
        )  # fmt: skip
        super().__init__(layout)
        self.view: Any = layout.view
        self._refresh()

    # What stands in the great part of the page

    def _show_opened(self, opened: Opened, project: Project | None = None) -> None:
        self._columns_are_folded = True
        super()._show_opened(opened, project)
        self._refresh()

    def _forget_record(self) -> None:
        super()._forget_record()
        self._walk = self._views = self._drive = self._compare = None
        self._candidates = ()
        self._layout.downloads.objects = self._layout.project.objects = []

    def _model_pane(self) -> list[Any]:
        return [beside(plots(self._views.layout))] if self._views is not None else []

    def _drive_pane(self) -> list[Any]:
        walk = self._walk
        if walk is None:
            return [panels.pane(panels.paragraph(NEEDED))]
        if self._drive is None:
            self._drive = DriveView(
                walk.step, self._find_drive, self._stop_driving, self._hand_over
            )
            self._refresh()
        return [self._drive.view]

    def _compare_pane(self) -> list[Any]:
        if self._walk is None:
            return [panels.pane(panels.paragraph(compare.NEEDED))]
        if self._compare is None:
            self._compare = compare.CompareView(self._find_compared, self._refuse)
        return [self._compare.view]

    def _show_pane(self, name: str) -> None:
        """Show one of the panes, drawn anew; its switch follows."""
        self._is_drawn = name
        panes = [each for each in self._panes if each != "Model" or self._walk is not None]
        self._layout.shown.param.update(options=panes, value=name)  # at once: None is no pane
        self._layout.axis.visible = name == "Model"
        show(self._layout.record, name == "Record")
        show(self._layout.first, self._record is not None)
        self._layout.drawn.objects = self._panes[name]()
        if name == "Model" and self._views is not None:
            self._hand_over(self._views.begin)

    def _on_shown(self, event: Any) -> None:
        if event.new != self._is_drawn:
            self._show_pane(event.new)

    def _on_fold(self, event: Any) -> None:
        del event
        self._columns_are_folded = not self._columns_are_folded
        self._refresh()

    # Fit, add, find, go back

    def _on_fit(self, event: Any) -> None:
        del event
        self._fit()

    def _on_levels(self, event: Any) -> None:
        del event
        if self._record is not None and self._before_search is None:
            self._fit()

    def _fit(self) -> None:
        record, levels = self._record, self._layout.levels.value or None
        project, self._project = self._project, None
        if record is None:
            return
        if project is not None and project.clicks:
            self._start(
                "repeating the steps of the project",
                lambda progress: repeated(record, project.clicks, progress),
                lambda walk: self._repeated(walk, project),
            )
            return
        self._start(
            "fitting",
            lambda progress: explore(record, levels=levels, progress=progress),
            lambda step: self._go_to(Walk(step, (Click("fit", levels),))),
        )

    def _repeated(self, walk: Walk, project: Project) -> None:
        self._go_to(walk)
        errors = [each.fit.rms_validation for each in walk.step.steps]
        if not panels.agree(errors, project.errors):
            self._say(panels.mistake(
                "The repeated steps give other errors than those saved in the project: another "
                "version of the program or of its libraries computes them now."
            ))  # fmt: skip

    def _on_add(self, name: str) -> None:
        walk = self._walk
        if walk is None or name in walk.step.effects or self._before_search:
            return  # pressed before the page has shown that it was added
        self._start(
            f"adding {name}",
            lambda progress: walk.step.add(name, progress),
            lambda new: self._go_to(walk.on(new, Click("add", effect=name))),
        )

    def _on_undo(self, event: Any) -> None:
        del event
        if self._walk is not None and self._walk.step.before is not None:
            self._back_to(len(self._walk.step.effects) - 1)

    def _back_to(self, place: int) -> None:
        if self._walk is not None and self._before_search is None:
            self._stop_job()
            self._go_to(self._walk.at(place))

    def _on_find(self, event: Any) -> None:
        del event
        record, levels = self._record, self._layout.levels.value or None
        if record is None:
            return

        def find(progress: Progress) -> tuple[Diagnosis, Exploration]:
            def watch(step: Exploration, candidates: tuple[Candidate, ...]) -> None:
                self._hand_over(lambda: self._watch(step, candidates))

            return searched(record, levels, watch, progress)

        before = (self._walk, self._candidates)
        self._start("searching", find, lambda both: self._found_it(both[0], both[1], levels))
        self._before_search = before
        self._refresh()

    def _watch(self, step: Exploration, candidates: tuple[Candidate, ...]) -> None:
        """Show a step of the search while it goes on."""
        self._walk = Walk(step, ())
        last = max((c.step for c in candidates), default=0)
        self._candidates = tuple(c for c in candidates if c.step == last)
        self._show_step()

    def _found_it(self, found: Diagnosis, step: Exploration, levels: int | None) -> None:
        self._before_search = None
        self._go_to(Walk(step, (Click("find", levels),), found))

    def _on_form(self, event: Any) -> None:
        del event
        walk = self._walk
        if walk is not None and walk.asks_for_form:
            self._start("looking for a form of what remains", walk.with_form, self._show_form)

    def _show_form(self, walk: Walk) -> None:
        self._walk = walk
        self._rank_if_cut_short()

    def _go_to(self, walk: Walk) -> None:
        self._walk, found = walk, walk.diagnosis
        if found is None:
            self._candidates = walk.step.known_candidates
        else:
            self._candidates = tuple(c for c in found.candidates if c.step == len(found.effects))
        self._show_step()
        if not self._candidates:
            self._rank(walk.step)

    def _rank(self, step: Exploration) -> None:
        """Compare what may be missing, while the step can be looked at."""

        def rank(progress: Progress) -> tuple[Candidate, ...]:
            step.budget()
            self._hand_over(self._refresh)
            return step.candidates(progress)

        def show(candidates: tuple[Candidate, ...]) -> None:
            self._candidates = candidates
            self._refresh()

        self._start("comparing what may be missing", rank, show)

    def _show_step(self) -> None:
        walk = self._walk
        assert walk is not None  # called for a step only
        if self._views is None or self._views.drawn_plane != walk.step.fit.model.plane:
            self._views = Views(walk.step, self._layout.axis.value)
            kept = self._is_drawn in ("Drive", "Compare")
            self._show_pane(self._is_drawn if kept else "Model")
        else:
            self._views.show(walk.step)
            self._hand_over(self._views.begin)
        if self._drive is not None:
            self._drive.use(walk.step)
        if self._compare is not None:
            self._compare.outdated(walk.step.fit.name)
        self._layout.downloads.objects = self._layout.project.objects = []
        self._refresh()

    def _on_axis(self, event: Any) -> None:
        if self._views is not None:
            self._views.show_axis(event.new)
            self._views.begin()

    # The drive for a wanted course

    def _find_drive(self) -> None:
        walk, view = self._walk, self._drive
        order = view.order() if view is not None else None
        if walk is None or view is None or order is None:
            return

        def show(result: Driven) -> None:
            view.show(result)
            self._rank_if_cut_short()

        def refuse(error: Exception) -> None:
            view.refuse(error)
            self._rank_if_cut_short()

        work = partial(driven, walk.step, order)
        self._start("finding the drive", work, show, refuse)
        self._drive_job = self._job
        self._refresh()

    @property
    def _is_driving(self) -> bool:
        return self._job is not None and self._job is self._drive_job

    def _stop_driving(self) -> None:
        """Give up a drive for a course that has become another."""
        if self._is_driving:
            self._stop_job()
            self._rank_if_cut_short()
            self._refresh()

    def _find_compared(self) -> None:
        """Compare what was dropped, with the model as it is now."""
        walk, view = self._walk, self._compare
        if walk is None or view is None:
            return

        def show(result: Compared) -> None:
            view.show(result)
            self._rank_if_cut_short()

        def refuse(error: Exception) -> None:
            view.refuse(error)
            self._rank_if_cut_short()

        work = partial(compared, walk.step, view.files)
        self._start("comparing", work, show, refuse)

    # What can be taken away

    def _on_export(self, event: Any) -> None:
        del event
        walk, upload, choice = self._walk, self._upload, self._choice
        if walk is None or upload is None or choice is None:
            return

        def work(progress: Progress) -> dict[str, bytes]:
            return exports(walk.step, walk.diagnosis, upload.name, choice, walk.way, progress)

        self._start("writing the report", work, self._offer)

    def _offer(self, files: dict[str, bytes]) -> None:
        self._layout.downloads.objects = panels.downloads(files)
        self._rank_if_cut_short()
        self._refresh()

    def _rank_if_cut_short(self) -> None:
        """Compare effects where an export or a drive has taken the place of that."""
        if self._walk is not None and not self._candidates:
            self._rank(self._walk.step)

    def _on_save(self, event: Any) -> None:
        del event
        walk, upload, choice = self._walk, self._upload, self._choice
        if upload is None or choice is None:
            return
        self._layout.project.objects = panels.downloads(saved(upload, choice, walk))

    # What is said

    def _let_go(self) -> None:
        if self._before_search is not None:
            # A search that is cut short leaves nothing: a half of it can not be repeated.
            before, self._before_search = self._before_search, None
            self._walk, self._candidates = before

    def _on_cancel(self, event: Any) -> None:
        del event
        was_searching = self._before_search is not None
        self._stop_job()
        if was_searching and self._walk is not None:
            self._show_step()
        elif was_searching:
            self._views = self._drive = None
            self._show_pane("Record")
        self._refresh()

    def _refresh(self) -> None:
        """What can be pressed now, and what is said of the present step."""
        walk, busy, shown = self._walk, self._job is not None, self._layout
        searching = self._before_search is not None
        has_record = self._record is not None
        shown.fold_columns(has_record, has_record and self._columns_are_folded)
        shown.advice.object = panels.paragraph(self._advise())
        shown.fit.visible = has_record and walk is None and not busy
        shown.find.disabled = not has_record or searching
        shown.form.visible = walk is not None and walk.asks_for_form
        shown.form.disabled = searching
        shown.undo.disabled = walk is None or walk.step.before is None or searching
        shown.cancel.disabled = not busy
        shown.prepare.disabled = walk is None or searching
        shown.save.disabled = not has_record or searching
        if walk is not self._lined_up:  # a button that is made anew loses the click on the old one
            shown.steps.objects = time_line(walk, self._back_to)
            self._lined_up = walk
        if self._drive is not None:
            self._drive.find.disabled = searching or self._is_driving
        if walk is None:
            shown.ladder.object = shown.verdict.object = ""
            shown.cards.objects = []
            return
        shown.ladder.object = panels.ladder(walk.step, walk.diagnosis)
        shown.verdict.object = panels.verdict(walk.step, walk.diagnosis)
        self._show_candidates(walk.step)

    def _advise(self) -> str:
        """What to do next."""
        if self._walk is not None:
            return "" if self._candidates else panels.NOT_COMPARED
        if self._record is not None:
            return panels.FIT
        return panels.DROP if self._upload is None else panels.CHOOSE

    def _show_candidates(self, step: Exploration) -> None:
        compared = {candidate.effect: candidate for candidate in self._candidates}
        shown: list[Any] = []
        for name in panels.order_of(step, self._candidates):
            if name not in self._rows:
                self._rows[name] = panels.CandidateRow(name, partial(self._on_add, name), card)
            self._rows[name].show(compared.get(name), step)
            shown.append(self._rows[name].view)
        if shown != self._layout.cards.objects:
            self._layout.cards.objects = shown

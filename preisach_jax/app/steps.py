"""The time line: every step from the record to the present model, to go back to and on from."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from preisach_jax.app import panels
from preisach_jax.app.layout import button
from preisach_jax.app.project import SUFFIX, packed
from preisach_jax.app.script import Click, without_detours
from preisach_jax.app.upload import Upload
from preisach_jax.diagnosis import diagnose, find_form
from preisach_jax.diagnosis.exploration import Exploration, explore
from preisach_jax.diagnosis.result import Candidate, Diagnosis
from preisach_jax.diagnosis.selection import effects_to_try
from preisach_jax.errors import InputError
from preisach_jax.fit import Fit, Progress
from preisach_jax.quantity import quantity
from preisach_jax.record import ReadOptions, Record


@dataclass(frozen=True)
class Walk:
    """The steps that were taken, and where among them the page is.

    Attributes:
        last: the furthest step.
        clicks: what led to it.
        found: the diagnosis that led to it, None if it was reached by hand.
        back: how many steps the page has gone back from it.
    """

    last: Exploration
    clicks: tuple[Click, ...]
    found: Diagnosis | None = None
    back: int = 0

    @property
    def step(self) -> Exploration:
        """The step that is shown."""
        return self.last.steps[len(self.last.steps) - 1 - self.back]

    @property
    def diagnosis(self) -> Diagnosis | None:
        """The diagnosis, where it is its last step that is shown."""
        return self.found if self.back == 0 else None

    @property
    def way(self) -> tuple[Click, ...]:
        """What leads to the step that is shown."""
        return (*self.clicks, *[Click("undo")] * self.back)

    @property
    def asks_for_form(self) -> bool:
        """Whether effects were compared, something remains, and no form of it was sought."""
        found, budget = self.diagnosis, self.step.known_budget
        if found is None:
            was_compared = bool(self.step.known_candidates)
            return was_compared and budget is not None and not budget.is_met
        return found.form is None and found.leaves_a_part

    def with_form(self, progress: Progress) -> Walk:
        """The walk up to the step that is shown, with a form of what remains of it."""
        found = self.diagnosis or self.step.conclude(progress)
        found = replace(found, form=find_form(found, progress=progress))
        return Walk(self.step, self.way, found)

    def at(self, place: int) -> Walk:
        """The same walk with another of its steps shown, counted from the plain model."""
        return Walk(self.last, self.clicks, self.found, len(self.last.steps) - 1 - place)

    def on(self, step: Exploration, click: Click) -> Walk:
        """The walk with one more step; those that it had gone back from are left."""
        return Walk(step, (*self.way, click))


def searched(
    record: Record,
    levels: int | None,
    watch: Callable[[Exploration, tuple[Candidate, ...]], None],
    progress: Progress,
) -> tuple[Diagnosis, Exploration]:
    """Run a whole diagnosis, and show each of its steps.

    Returns:
        The diagnosis, and its last step.
    """
    tried, steps = effects_to_try(record, None), list[Exploration]()

    def on_step(fit: Fit, candidates: tuple[Candidate, ...]) -> None:
        before = next((s for s in reversed(steps) if s.effects == fit.effects[:-1]), None)
        steps.append(Exploration(fit, tried, before))
        watch(steps[-1], candidates)

    found = diagnose(record, levels=levels, progress=progress, watch=on_step)
    return found, Exploration.of(found)


def repeated(record: Record, clicks: Sequence[Click], progress: Progress) -> Walk:
    """Take the steps of clicks again."""
    walk: Walk | None = None
    for click in clicks:
        if click.what == "fit":
            walk = Walk(explore(record, levels=click.levels, progress=progress), (click,))
        elif click.what == "find":
            found = diagnose(record, levels=click.levels, progress=progress)
            walk = Walk(Exploration.of(found), (click,), found)
        elif walk is None:
            raise InputError(f"the steps begin with {click.what!r}; the first step must be a fit")
        elif click.what == "add":
            walk = walk.on(walk.step.add(click.effect, progress), click)
        elif walk.step.before is not None:
            walk = walk.at(len(walk.step.effects) - 1)
    if walk is None:
        raise InputError(f"the project {record.name!r} holds no steps; open the record itself")
    return walk


def saved(upload: Upload, choice: ReadOptions, walk: Walk | None) -> dict[str, bytes]:
    """A project of a file and the steps on it, by the name that it is offered under."""
    clicks = without_detours(walk.way) if walk else []
    whole = packed(upload.name, upload.content, choice, clicks, walk.step if walk else None)
    return {Path(upload.name).stem + SUFFIX: whole}


def time_line(walk: Walk | None, show: Callable[[int], None]) -> list[Any]:
    """A button for each step of a walk, with its error; the one that is shown stands out."""
    if walk is None:
        return []
    buttons: list[Any] = [panels.pane(panels.doing("Steps:"))]
    buttons[0].sizing_mode = None
    shown = len(walk.last.steps) - 1 - walk.back
    for place, (step, rung) in enumerate(zip(walk.last.steps, walk.last.ladder, strict=True)):
        name = f"+ {rung.effects[-1]}" if rung.effects else "Preisach model"
        error = quantity(rung.rms_validation, step.record.output_unit, 3)
        label = f"{name}: {error}" + (" (shown)" if place == shown else "")
        kind = "primary" if place == shown else "default"
        buttons.append(button(label, partial(_go, show, place), kind))
    return buttons


def _go(show: Callable[[int], None], place: int, event: Any) -> None:
    del event
    show(place)

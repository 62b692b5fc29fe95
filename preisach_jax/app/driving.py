"""From a wanted course to its drive: what the page computes, says and offers of it."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from preisach_jax.app.course import MADE, CourseFile
from preisach_jax.app.upload import table_of
from preisach_jax.compensation import Compensation, compensate
from preisach_jax.compensation.exchange import drive_csv, wanted_course
from preisach_jax.compensation.straight import Tracking, tracking
from preisach_jax.diagnosis.exploration import Exploration
from preisach_jax.files import json_bytes
from preisach_jax.fit import Progress
from preisach_jax.model import Model
from preisach_jax.quantity import number, quantity
from preisach_jax.record import Record
from preisach_jax.record.marks import spans


@dataclass(frozen=True)
class Order:
    """What is to be driven.

    Attributes:
        course: makes the wanted course; called where the page need not wait for it.
        low, high: limits of the drive, None for those of the model.
        slew: maximum slew rate of the drive, per s, None for any.
    """

    course: Callable[[], CourseFile]
    low: float | None = None
    high: float | None = None
    slew: float | None = None

    def limits(self, model: Model) -> tuple[float, float] | None:
        """Both limits; one that was not given is the end of the range of the model."""
        if self.low is None and self.high is None:
            return None
        plane = model.plane
        low = plane.low if self.low is None else self.low
        return low, plane.high if self.high is None else self.high


@dataclass(frozen=True, eq=False)
class Driven:
    """A drive, and what is said and offered of it.

    Attributes:
        wanted: the course.
        found: its drive.
        errors: tracking errors to expect.
        files: contents by name: `drive.csv`, the course where it was made here, `model.json`.
        command: the command line that writes the same drive.
        notes: a sentence for everything that the owner must know.
    """

    wanted: Record
    found: Compensation
    errors: Tracking
    files: dict[str, bytes]
    command: str
    notes: tuple[str, ...]


def course_of(step: Exploration, course: CourseFile) -> Record:
    """Read a wanted course as `preisach compensate` does."""
    return wanted_course(
        step.fit.model, table_of(course.name, course.content), course.name,
        time=course.columns.get("time"), output=course.columns.get("output"), units=course.units,
    )  # fmt: skip


def driven(step: Exploration, order: Order, progress: Progress) -> Driven:
    """Find the drive for a wanted course, and what a straight line would miss."""
    model, limits = step.fit.model, order.limits(step.fit.model)
    progress("making the wanted course", 0.0)
    course = order.course()
    wanted = course_of(step, course)
    found = compensate(model, wanted, limits=limits, slew=order.slew, progress=progress)
    progress("comparing with a straight line", 0.97)
    errors = tracking(model, wanted, found, limits=limits, slew=order.slew)
    files = {"drive.csv": drive_csv(found)}
    if course.name == MADE:
        files[MADE] = course.content
    files["model.json"] = json_bytes(model.to_json())
    notes = (*found.notes, *course.notes)
    return Driven(wanted, found, errors, files, command(course, limits, order.slew), notes)


def command(
    course: CourseFile, limits: Sequence[float] | None = None, slew: float | None = None
) -> str:
    """The command line that writes the same drive."""
    words = ["preisach", "compensate", "model.json", course.name, "--out", "drive.csv"]
    if limits is not None:
        # Joined by a sign of equality, as a lower limit may begin with a minus.
        words.append(f"--limits={_exact(limits[0])},{_exact(limits[1])}")
    if slew is not None:
        words += ["--slew", _exact(slew)]
    for role, name in course.columns.items():
        words += [f"--{role}", name]
    for role, unit in course.units.items():
        words += ["--unit", f"{role}={unit}"]
    return shlex.join(words)


def _exact(value: float) -> str:
    return repr(float(value)).removesuffix(".0")


def outcome(result: Driven, record: Record) -> str:
    """What is to be expected of a drive: the error in large type, what cannot be had, in words."""
    errors, unit, stroke = result.errors, record.output_unit, record.output_range
    lost = int((~result.found.reachable).sum())
    rows = len(result.found.time)
    head = f"{lost:,} of {rows:,} rows cannot be reached" if lost else "Every row can be reached"
    straight = (
        f"With a straight line (affine map) instead of the model it would be "
        f"{quantity(errors.straight, unit, 3)}, {_percent(errors.straight, stroke)} of the stroke. "
        f"Both contain the model's own held-out error, {quantity(errors.model, unit, 3)}."
    )
    lines = Markup("").join(
        Markup("<p>{}</p>").format(_sentence(text)) for text in (straight, *result.notes)
    )
    return str(
        Markup(
            '<div class="outcome {}" role="status"><div><div class="size">{}</div>'
            '<div class="share">{} of the stroke: RMS tracking error to expect</div></div>'
            '<div class="words"><b>{}</b>{}</div></div>'
        ).format(
            "unmet" if lost else "met", quantity(errors.compensated, unit, 3),
            _percent(errors.compensated, stroke), head, lines,
        )
    )  # fmt: skip


def _percent(value: float, whole: float) -> str:
    return f"{number(100 * value / whole, 2)}\N{NO-BREAK SPACE}%"


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:].rstrip(".") + "."


def command_shown(text: str) -> str:
    """A command line to be copied, as HTML: one click chooses all of it."""
    return str(
        Markup('<p class="soft">The same on the command line:</p><pre class="command">{}</pre>')
        .format(text)
    )  # fmt: skip


def unreached(result: Driven) -> tuple[np.ndarray, np.ndarray]:
    """(stretch,) first and last time in s of the stretches of a course that cannot be reached."""
    time = result.wanted.time
    first, behind = np.array(spans(~result.found.reachable), int).reshape(-1, 2).T
    return time[first], time[np.minimum(behind, len(time) - 1)]

"""The view "Drive": a wanted course of the output, and the input that makes the stage follow it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import panel as pn

from preisach_jax.app import panels
from preisach_jax.app.course import (
    SHAPES,
    CourseFile,
    Shape,
    course_file,
    resting,
    shaped,
    told_units,
    usual_shape,
)
from preisach_jax.app.drive_figures import DriveFigures
from preisach_jax.app.driving import Driven, Order, command_shown, course_of, outcome
from preisach_jax.app.dropper import Dropper
from preisach_jax.app.layout import BLOCK, WRAP, button, plots, styled
from preisach_jax.diagnosis.exploration import Exploration
from preisach_jax.errors import InputError
from preisach_jax.quantity import pretty_unit

FROM_FILE = "From a file"
MOST_BYTES = 20_000_000
"""Size of the greatest file of a course that the page takes."""

NEEDED = (
    "The drive is found with the model of a record. Drop a record above; as soon as its model "
    "stands, choose here what the output is to do."
)
"""What stands in the view before there is a model."""

_ROW: dict[str, Any] = {"sizing_mode": "stretch_width", "stylesheets": [WRAP]}


class DriveView:
    """A course, its limits, and the drive that was found for it.

    Attributes:
        view: what to show in the page.
        find: the button that asks for the drive.
        figures: the figures.
    """

    def __init__(
        self,
        step: Exploration,
        find: Callable[[], None],
        changed: Callable[[], None],
        hand_over: Callable[[Callable[[], None]], object] = lambda function: function(),
    ):
        self._step, self._changed = step, changed
        self._hand_over = hand_over
        self._file: CourseFile | None = None
        self._make_fields()
        self.find: Any = button("Find the drive", lambda event: find(), "primary")
        self.find.align = "end"
        self._told = panels.pane()
        self._outcome = panels.pane()
        self._files = pn.Row(**_ROW)
        self._command = panels.pane()
        self._drawn = pn.Column(sizing_mode="stretch_width", stylesheets=[BLOCK])
        self.figures: DriveFigures
        course = pn.Row(self._kind, *self._shape.values(), **_ROW)
        limits = pn.Row(*self._limits.values(), self.find, **_ROW)
        self.view: Any = pn.Column(
            course, self._dropper, limits, self._told, self._outcome,
            self._drawn, self._files, self._command,
            sizing_mode="stretch_width", stylesheets=[BLOCK],
        )  # fmt: skip
        self._show_kind()
        self._show_course()

    def use(self, step: Exploration) -> None:
        """Go on with another model of the same record; what was found with the last one goes."""
        if step is self._step:
            return
        self._step = step
        had_result = bool(self._outcome.object)
        self._forget_result()

        def show() -> None:
            self._preview()
            if had_result and not self._told.object:
                name = step.fit.name
                self._told.object = panels.doing(f"The model is now {name}: find the drive again.")

        self._hand_over(show)

    def order(self) -> Order | None:
        """What is to be driven; None where something is missing, and then it is said."""
        step, row_s, kind = self._step, self._row_s, self._kind.value
        limits = [field.value for field in self._limits.values()]
        try:
            if kind == FROM_FILE:
                given = self._given()
                return Order(lambda: given, *limits)
            shape = self._typed_shape()
            shaped(shape, self._begin, row_s)  # refused here, what is no course
        except InputError as error:
            self.refuse(error)
            return None
        # Where the stage goes by itself takes a run of the model.
        return Order(lambda: course_file(step, *shaped(shape, resting(step), row_s)), *limits)

    def show(self, result: Driven) -> None:
        """Show a drive that was found."""
        self._told.object = ""
        self.figures.show(result)
        self._outcome.object = outcome(result, self._step.record)
        self._files.objects = panels.downloads(result.files)
        self._command.object = command_shown(result.command)

    def refuse(self, error: Exception) -> None:
        """Say why there is no drive; the course stays."""
        self._told.object = str(panels.failure(error))

    # The fields

    def _make_fields(self) -> None:
        record, usual = self._step.record, usual_shape(self._step)
        output, drive = (pretty_unit(unit) for unit in (record.output_unit, record.input_unit))
        self._kind = styled(
            pn.widgets.Select(label="Wanted course", options=[*SHAPES, FROM_FILE], width=170)
        )
        self._kind.param.watch(self._on_kind, "value")
        self._shape = {
            "swing": _number("Swing, end to end", output, usual.swing),
            "middle": _number("Middle", output, usual.middle),
            "frequency": _number("Frequency", "Hz", usual.frequency),
            "periods": _number("Periods", "", usual.periods),
        }
        plane = self._step.fit.model.plane
        self._limits = {
            "low": _number("Lowest drive", drive, None, f"{plane.low:.4g}"),
            "high": _number("Highest drive", drive, None, f"{plane.high:.4g}"),
            "slew": _number("Greatest rate", f"{drive or 'units'}/s", None, "any"),
        }
        for field in (*self._shape.values(), *self._limits.values()):
            field.param.watch(self._on_field, "value")
        self._dropper = Dropper(
            self._on_drop, self.refuse, MOST_BYTES,
            f"Drop or choose a file with the columns {self._columns_named()}",
        )  # fmt: skip

    def _on_kind(self, event: Any) -> None:
        self._show_kind()
        self._on_field()

    def _show_kind(self) -> None:
        kind = self._kind.value
        for field in self._shape.values():
            field.visible = kind in SHAPES
        self._dropper.visible = kind == FROM_FILE
        self.figures = DriveFigures(self._step.record)
        self._drawn.objects = [] if kind == FROM_FILE else [plots(self.figures.layout)]

    def _on_field(self, event: Any = None) -> None:
        self._changed()
        self._show_course()

    def _show_course(self) -> None:
        self._forget_result()
        # The change of a widget may come without the lock that a change of a figure needs.
        self._hand_over(self._preview)

    def _columns_named(self) -> str:
        columns = self._step.fit.model.columns
        return " and ".join(columns[role] for role in ("time", "output"))

    def _on_drop(self, name: str, content: bytes) -> None:
        self._file = CourseFile(name, content, {}, told_units(self._step))
        self._on_field()

    # The course

    @property
    def _begin(self) -> float:
        """Where the output is at the end of the record."""
        return float(self._step.fit.prediction[-1])

    @property
    def _row_s(self) -> float:
        """Time between two rows, without the rounding of a clock."""
        return float(f"{self._step.fit.model.origin.step_s:.9g}")

    def _typed_shape(self) -> Shape:
        numbers = {name: field.value for name, field in self._shape.items()}
        if missing := [name for name, value in numbers.items() if value is None]:
            raise InputError(f"the {missing[0]} is missing; give a number")
        return Shape(self._kind.value, **numbers)

    def _given(self) -> CourseFile:
        if self._file is None:
            raise InputError("there is no wanted course yet; drop its file above")
        return self._file

    def _preview(self) -> None:
        """Show the course as it is now, or what is wrong with it."""
        try:
            self._step.fit.model.check_invertible()
            if self._kind.value != FROM_FILE:
                typed = shaped(self._typed_shape(), self._begin, self._row_s)
                self.figures.show_course(*typed)
            elif self._file is not None:
                course = course_of(self._step, self._file)
                self.figures.show_course(course.time, course.output)
                self._drawn.objects = [plots(self.figures.layout)]
        except InputError as error:
            self.refuse(error)

    def _forget_result(self) -> None:
        self._told.object = self._outcome.object = self._command.object = ""
        self._files.objects = []


def _number(title: str, unit: str, value: float | None, usual: str = "") -> Any:
    label = f"{title} ({unit})" if unit else title
    width = 150 if len(label) > 15 else 120
    return styled(pn.widgets.FloatInput(label=label, value=value, placeholder=usual, width=width))

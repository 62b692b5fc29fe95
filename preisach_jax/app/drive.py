"""The view "Drive": a wanted course of the output, and the input that makes the stage follow it."""

from __future__ import annotations

import csv
import io
import re
import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import panel as pn
from bokeh.layouts import column
from bokeh.models import Column, ColumnDataSource, Range1d
from markupsafe import Markup

from preisach_jax.app import panels
from preisach_jax.app.layout import BLOCK, WRAP, Dropper, button, plots, styled
from preisach_jax.app.upload import tables_of
from preisach_jax.app.views import MOST_DRAWN, NARROW, drawn_figure, limits_of, place_legend, span
from preisach_jax.compensation import Compensation, compensate
from preisach_jax.compensation.drive import Tracking, drive_csv, tracking, wanted_course
from preisach_jax.diagnosis import residuals as stats
from preisach_jax.diagnosis.exploration import Exploration
from preisach_jax.effects.base import auxiliary_columns
from preisach_jax.errors import InputError
from preisach_jax.files import json_bytes
from preisach_jax.fit import Progress
from preisach_jax.model import Model
from preisach_jax.plot.axes import column_name, greatest, with_unit
from preisach_jax.plot.style import AFTER, FLOOR, MEASURED, REFUSED
from preisach_jax.quantity import number, pretty_unit, quantity, scaled
from preisach_jax.record.core import Record
from preisach_jax.record.marks import spans
from preisach_jax.record.units import seconds_per, split_unit

MOST_ROWS = 200_000
"""Rows of a course that is made here; the command line drives longer ones."""

LEAST_PER_PERIOD = 8
"""Rows in which a period still has its shape."""

SHARE = 0.6
"""Share of the stroke that a shape spans unless another swing is typed."""

STEPS = 5
"""Steps of a staircase from its foot to its top."""

FLANK = 0.2
"""Share of a step in which a staircase goes to the next one: no stage jumps."""

LEAD = 0.5
"""Periods in which the stage is led to the beginning of a shape."""

REST = 0.1
"""Share of that in which the stage is left where it is: a delay passes nothing sooner."""

HOLD = 0.15
"""Share of a period for which a scan holds at either end."""

RESTING_ROWS = 256
"""Rows for which it is reckoned how the output goes on by itself; delays and lags are shorter."""

MADE = "wanted.csv"
"""What a course that is made here is called as a file."""

SHAPES = ("Triangle", "Sine", "Staircase", "Scan with holds")
"""Shapes by the name that the menu has."""


@dataclass(frozen=True)
class Shape:
    """A course that repeats.

    Attributes:
        kind: one of `SHAPES`.
        middle, swing: middle of the course, and from its lowest to its highest, in the unit of the
            output.
        frequency: periods per s.
        periods: how many.
    """

    kind: str
    middle: float
    swing: float
    frequency: float
    periods: float


def usual_shape(step: Exploration) -> Shape:
    """Three triangles over 60 % of the stroke, as fast as the record usually goes."""
    record = step.record
    output = step.fit.prediction
    low, high = float(output.min()), float(output.max())
    swing = _short(SHARE * (high - low))
    speed = np.abs(stats.input_rate(record.time, record.input))
    moving = speed[speed > 0.01 * speed.max()]
    per_s = float(np.median(moving)) * (high - low) / float(np.ptp(record.input))
    # Neither so fast that a period has few rows, nor so slow that there are very many of them.
    slowest, fastest = (1 / (rows * record.step_s) for rows in (MOST_ROWS / 40, 40))
    frequency = min(max(per_s / (2 * swing), slowest), fastest)
    return Shape(SHAPES[0], _short((low + high) / 2, 3), swing, _short(frequency), 3.0)


def _short(value: float, digits: int = 2) -> float:
    return float(f"{value:.{digits}g}")


def resting(step: Exploration) -> np.ndarray:
    """(row,) how the output goes on behind the record while the input rests: delays, creep."""
    model, record = step.fit.model, step.record
    time = model.origin.stop_s + model.origin.step_s * np.arange(1, RESTING_ROWS + 1)
    names = auxiliary_columns(model.effects)
    aux = {name: np.full(len(time), record.aux[name][-1]) for name in names}
    held = np.full(len(time), record.input[-1])
    rest = Record.from_arrays(time, held, np.full(len(time), np.nan), aux=aux, name="the rest")
    return model.predict(rest).output


def shaped(shape: Shape, begin: np.ndarray | float, step_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Time and output of a shape, to which the stage is led from where it is.

    Arguments:
        begin: output from which half a period leads to that, or (row,) how it would go on by
            itself: what is on its way already cannot be had otherwise.
        step_s: time between two rows, in s.

    Returns:
        (time,) time in s from 0, and output in the unit of the shape.
    """
    _check(shape, step_s)
    low = shape.middle - shape.swing / 2
    count = 1 + round((LEAD + shape.periods) / (shape.frequency * step_s))
    time = step_s * np.arange(count)
    phase = shape.frequency * time - LEAD
    own = np.atleast_1d(begin)
    own = own[np.minimum(np.arange(count), len(own) - 1)]
    led = own + (low - own) * _smooth((1 + phase / LEAD - REST) / (1 - REST))
    return time, np.where(phase < 0, led, low + shape.swing * _level(shape.kind, phase))


def _check(shape: Shape, step_s: float) -> None:
    for name, value in (
        ("swing", shape.swing), ("frequency", shape.frequency), ("number of periods", shape.periods)
    ):  # fmt: skip
        if not 0 < value < np.inf:
            raise InputError(f"the {name} is {value:g}; give a number above 0")
    if not np.isfinite(shape.middle):
        raise InputError(f"the middle is {shape.middle:g}; give a number")
    rows = 1 / (shape.frequency * step_s)
    if rows < LEAST_PER_PERIOD:
        raise InputError(
            f"at {quantity(shape.frequency, 'Hz')} a period has {rows:.2g} rows of "
            f"{quantity(step_s, 's')}; give at most "
            f"{quantity(1 / (LEAST_PER_PERIOD * step_s), 'Hz')}"
        )
    if rows * (shape.periods + LEAD) > MOST_ROWS:
        raise InputError(
            f"{shape.periods:g} periods at {quantity(shape.frequency, 'Hz')} are "
            f"{rows * shape.periods:,.0f} rows, and the page makes {MOST_ROWS:,} at most: give "
            "fewer periods or a higher frequency, or use preisach compensate"
        )


def _level(kind: str, phase: np.ndarray) -> np.ndarray:
    """A shape between 0 and 1 over its phase in periods."""
    part = phase % 1.0
    rising = 1 - np.abs(2 * part - 1)
    if kind == "Triangle":
        return rising
    if kind == "Sine":
        return (1 - np.cos(2 * np.pi * part)) / 2
    if kind == "Staircase":
        place = 2 * STEPS * part
        slot = np.floor(place)
        held, then = (np.minimum(k, 2 * STEPS - k) for k in (slot, slot + 1))
        return (held + (then - held) * _smooth((place - slot - (1 - FLANK)) / FLANK)) / STEPS
    run = 0.5 - HOLD
    return np.clip(np.minimum(part / run, (1 - HOLD - part) / run), 0.0, 1.0)


def _smooth(share: np.ndarray) -> np.ndarray:
    """From 0 to 1 without a jump of speed or acceleration."""
    held = np.clip(share, 0.0, 1.0)
    return held**3 * (10 + held * (6 * held - 15))


@dataclass(frozen=True)
class CourseFile:
    """A wanted course as a file.

    Attributes:
        name: what it is called.
        content: its bytes.
        columns: names of its columns by role, where they are not those of the model.
        units: units by role, where the names of the columns do not tell them.
        notes: what was assumed, in sentences.
    """

    name: str
    content: bytes
    columns: Mapping[str, str]
    units: Mapping[str, str]
    notes: tuple[str, ...] = ()


def course_file(step: Exploration, time: np.ndarray, output: np.ndarray) -> CourseFile:
    """A course as a file with the model's columns, as `preisach compensate` reads it.

    Auxiliary columns that the model needs stay at their last values in the record.

    Arguments:
        time: (time,) in s.
        output: (time,) in the unit of the model's output.
    """
    model, record = step.fit.model, step.record
    own = {"time": "t_s", "output": "z"}
    # A number for a name is that of a column, in a file without names.
    columns = {role: own[role] for role in own if re.fullmatch(r"\d*", model.columns[role])}
    names = [columns.get(role) or model.columns[role] for role in own]
    multiplier, divisor = seconds_per(model.units["time"]) or (1.0, 1.0)
    values = [time if "time" in columns else time * divisor / multiplier, output]
    units = {} if "output" in columns else told_units(step)
    notes: list[str] = []
    for name in auxiliary_columns(model.effects):
        last = float(record.aux[name][-1])
        names.append(name)
        values.append(np.full(len(time), last))
        unit = record.channels[name].unit
        notes.append(f"{name} is assumed to stay at {quantity(last, unit)}, its last value")
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(names)
    writer.writerows(zip(*(each.tolist() for each in values), strict=True))
    return CourseFile(MADE, text.getvalue().encode(), columns, units, tuple(notes))


def told_units(step: Exploration) -> dict[str, str]:
    """The unit of the output, where it was told otherwise than the name of its column says it."""
    model = step.fit.model
    own = model.units["output"]
    by_name = split_unit(model.columns["output"])[1]
    return {"output": own} if own and by_name and own != by_name else {}


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
        step.fit.model, tables_of(course.name, course.content)[0], course.name,
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


SERIES = ("time", "wanted", "expected", "low", "high", "error", "drive")

TIME = "time (s)"
TITLE = "Wanted and expected output"

STACK = f"""
:host {{ min-width: 0 !important; height: max(620px, calc(100vh - 22rem)) !important; }}
{NARROW} {{ :host {{ width: 100% !important; height: 820px !important; }} }}
"""
"""Style of the figures together."""

ALONE = ":host { min-width: 0 !important; height: 360px !important; }"
"""Style of the course while nothing else is known."""


class DriveFigures:
    """The figures of one record; another course or drive changes what they show.

    Arguments:
        record: whose units and names they have.

    Attributes:
        layout: the Bokeh object to show.
        course: corners of the wanted course before its drive is found.
        rows: the rows of a drive.
        lost: the stretches that cannot be reached, from `x0` to `x1`.
    """

    def __init__(self, record: Record):
        self._record = record
        self.course: Any = ColumnDataSource({"x": [], "y": []})
        self.rows: Any = ColumnDataSource({name: [] for name in SERIES})
        self.lost: Any = ColumnDataSource({"x0": [], "x1": []})
        self._time = Range1d(start=0.0, end=1.0)
        self._output = self._output_figure()
        self._error = self._small_figure("Error (wanted minus expected)", "error")
        self._drive = self._small_figure("Drive", "drive")
        self._drive.xaxis.axis_label = TIME
        self.layout: Column = column(
            self._output, self._error, self._drive, sizing_mode="stretch_both", stylesheets=[ALONE]
        )
        self._with_result(False)

    def show_course(self, time: np.ndarray, output: np.ndarray) -> None:
        """Show a course whose drive is not known yet."""
        few = slice(None, None, -(-len(time) // 20_000))
        self.course.data = {"x": time[few], "y": output[few]}
        self.rows.data = {name: [] for name in SERIES}
        self.lost.data = {"x0": [], "x1": []}
        self._with_result(False)
        self._frame(time, output)

    def show(self, result: Driven) -> None:
        """Show a drive."""
        found, time = result.found, result.wanted.time
        error = found.wanted - found.expected
        factor, unit = scaled(greatest(error), self._record.output_unit)
        self._error.yaxis.axis_label = with_unit("error", unit)
        rows = slice(None, None, -(-len(time) // MOST_DRAWN))
        values = (time, found.wanted, found.expected, found.low, found.high, factor * error)
        columns = dict(zip(SERIES, (*values, found.drive), strict=True))
        self.rows.data = {name: each[rows] for name, each in columns.items()}
        first, last = unreached(result)
        self.lost.data = {"x0": first, "x1": last}
        self.course.data = {"x": [], "y": []}
        self._with_result(True)
        if len(first):  # strips have no entry in a legend
            self._output.title.text = f"{TITLE} (grey: not reached)"
        self._frame(time, found.wanted, found.expected)

    def _with_result(self, is_there: bool) -> None:
        """Make room for the course alone, or for all figures."""
        self._error.visible = self._drive.visible = is_there
        self._output.legend.visible = is_there
        self._output.title.text = TITLE if is_there else "Wanted output"
        self._output.xaxis.axis_label = "" if is_there else TIME
        self.layout.stylesheets = [STACK if is_there else ALONE]

    def _frame(self, time: np.ndarray, *outputs: np.ndarray) -> None:
        span(self._time, float(time[0]), float(time[-1]))
        lows, highs = zip(*(limits_of(each) for each in outputs), strict=True)
        low, high = min(lows), max(highs)
        if low == high:
            low, high = low - 1.0, high + 1.0
        span(self._output.y_range, low, high)

    def _output_figure(self) -> Any:
        record = self._record
        drawn = drawn_figure(
            TITLE, "",
            with_unit(column_name(record, "output"), pretty_unit(record.output_unit)),
            min_height=220, x_range=self._time, y_range=Range1d(start=0.0, end=1.0),
        )  # fmt: skip
        self._shade(drawn)
        drawn.varea(
            "time", "low", "high", source=self.rows, fill_color=AFTER, alpha=0.25,
            legend_label="95 % band",
        )  # fmt: skip
        drawn.line("x", "y", source=self.course, color=MEASURED, width=3)
        drawn.line(
            "time", "wanted", source=self.rows, color=MEASURED, width=3, legend_label="wanted"
        )
        drawn.line(
            "time", "expected", source=self.rows, color=AFTER, width=1.5, line_dash="dashed",
            legend_label="expected",
        )  # fmt: skip
        place_legend(drawn, "top_left")
        return drawn

    def _small_figure(self, title: str, name: str) -> Any:
        record = self._record
        unit = pretty_unit(record.input_unit)
        label = with_unit(column_name(record, "input"), unit) if name == "drive" else name
        drawn = drawn_figure(title, "", label, min_height=150, x_range=self._time)
        self._shade(drawn)
        shade = FLOOR if name == "drive" else AFTER
        drawn.line("time", name, source=self.rows, color=shade, width=1.5)
        return drawn

    def _shade(self, drawn: Any) -> None:
        drawn.vstrip("x0", "x1", source=self.lost, color=REFUSED, alpha=0.5, level="underlay")


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

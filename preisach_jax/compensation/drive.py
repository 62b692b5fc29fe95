"""The input that makes a stage follow a wanted output, what it is worth, and its files."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np

from preisach_jax.compensation.causes import Attempt, sentences
from preisach_jax.compensation.forward import Forward
from preisach_jax.compensation.past import Past, past_of
from preisach_jax.compensation.search import DriveSearch, Limits, limited
from preisach_jax.cores import on_processor
from preisach_jax.effects.base import auxiliary_columns
from preisach_jax.errors import InputError
from preisach_jax.model import Model
from preisach_jax.quantity import pretty_unit, quantity
from preisach_jax.record.channels import SAMPLES
from preisach_jax.record.columns import NO_CLOCK
from preisach_jax.record.core import Record
from preisach_jax.record.table import Table

GAP_STEPS = 5.0
"""A step this many times the usual one is a gap in the course."""

REACHED = 1e-6
"""Share of the stroke within which an output counts as reached, however exact the model is."""


@dataclass(frozen=True, eq=False)
class Compensation:
    """A drive, and what it makes of the stage, `(time,)` each.

    Attributes:
        time: time of the wanted course, as in its file.
        drive: the input, in its unit.
        wanted: the wanted output, in its unit.
        expected: the output that the model expects of the drive.
        low, high: its 95 % band.
        reachable: bool: whether the wanted output lies in the 95 % band of what the model expects,
            1.96 times its held-out RMS error, with all effects that can be inverted.
        notes: a sentence for everything that the owner must know.
    """

    time: np.ndarray
    drive: np.ndarray
    wanted: np.ndarray
    expected: np.ndarray
    low: np.ndarray
    high: np.ndarray
    reachable: np.ndarray
    notes: tuple[str, ...]


def compensate(
    model: Model,
    wanted: Record,
    *,
    after: Record | None = None,
    limits: Sequence[float] | None = None,
    slew: float | None = None,
    progress: Callable[[str, float], object] | None = None,
) -> Compensation:
    r"""Find the input that makes the output follow a wanted course, through all effects.

    The chain is inverted in its order: what adds to the output is subtracted, what filters it led,
    the operator inverted along its monotone branches, and what acts on the input led.  The drive
    is exact for the model, to a small part of its held-out error, wherever the limits, the slew and
    the speed of the effects let it be; elsewhere it comes as near as it can, and `reachable` says
    so.

    Arguments:
        model: the model.
        wanted: the course as its output, with time and the auxiliary columns that the model needs;
            its input is not used.
        after: what was played before, from which the memory of the stage comes; by default the
            record on which the model was identified.  Where the clock of the course does not go on
            from it, the course follows by one time step.
        limits: lowest and highest value of the drive, by default the range of the plane.
        slew: greatest rate of the drive, in its unit per s; by default unlimited.
        progress: called with a text and the share done before each pass; what it raises ends the
            work.

    Returns:
        The drive.

    Raises:
        InputError: the course has no number in a row, or a gap, or another unit than the model; an
            auxiliary column is missing; the limits or the slew are none; or the model has weights
            of both signs.

    Example:
        >>> import preisach_jax as pj
        >>> t = np.arange(3000) / 100
        >>> u = 5 - 5 * np.cos(t * (1 + t / 40))
        >>> model = pj.fit(pj.Record.from_arrays(t, u, u**1.1), levels=9).model
        >>> z = 6 + 2 * np.sin(t[:400])
        >>> course = pj.compensate(model, pj.Record.from_arrays(t[:400], 0 * z, z))
        >>> bool(np.allclose(course.expected, z, atol=1e-6)), bool(course.reachable.all())
        (True, True)
    """
    model.check_invertible()
    _check_course(model, wanted)
    allowed, notes = limits_of(model, limits, slew)
    aux = {name: wanted.aux[name] for name in auxiliary_columns(model.effects)}
    wanted = _with_aux(wanted, aux)
    with on_processor():
        past = past_of(model, wanted, after)
        forward = Forward.of(model, past, aux)
        aim = np.asarray(forward.before_sensor(jnp.asarray(wanted.output)))
        stroke = float(np.abs(model.weights).sum())
        good = max(1.96 * model.rms_validation, REACHED * stroke)
        search = DriveSearch(forward, aim, allowed, good)
        found = search.found(progress)
        prediction = model.predict(past.record(found.drive, aux))
        rows = slice(-len(aim), None)
        expected = prediction.output[rows]
        attempt = Attempt(
            wanted.output, found.output - aim, found, good, search.away, search.memory,
            search.limits, search.dt, past.last_input, _span(model, past, allowed, aux),
        )  # fmt: skip
        reachable = attempt.reached
        notes += sentences(model, attempt, allowed.slew)
    notes += _notes(model, wanted, reachable, expected)
    return Compensation(
        wanted.time_values,
        found.drive,
        wanted.output,
        expected,
        prediction.low[rows],
        prediction.high[rows],
        reachable,
        tuple(notes),
    )


def _with_aux(wanted: Record, aux: dict[str, np.ndarray]) -> Record:
    """The course with the auxiliary columns of the model alone."""
    if set(aux) == set(wanted.aux):
        return wanted
    return replace(wanted, aux=aux)


def _check_course(model: Model, wanted: Record) -> None:
    bad = np.flatnonzero(~np.isfinite(wanted.output))
    if len(bad):
        raise InputError(
            f"{wanted.name}: the wanted output is missing in row {bad[0] + 1} "
            f"({_more(bad, 'rows')}); fill it in"
        )
    for role in ("output", *wanted.aux):
        own, given = (
            pretty_unit(units) for units in (model.units.get(role, ""), wanted.channels[role].unit)
        )
        if own and given and own != given:
            raise InputError(
                f"{wanted.name}, column {wanted.channels[role].name}: its unit is {given}, and the "
                f"model was identified in {own}; convert the column"
            )
    for name in auxiliary_columns(model.effects):
        if name not in wanted.aux:
            raise InputError(
                f"{wanted.name}: the model needs the auxiliary column {name!r}, as it "
                "will run along the course; add it"
            )
    steps = np.diff(wanted.time)
    gaps = np.flatnonzero(steps > GAP_STEPS * np.median(steps))
    if len(gaps):
        row = int(gaps[0])
        raise InputError(
            f"{wanted.name}: there is a gap of {quantity(float(steps[row]), 's')} behind row "
            f"{row + 1}, where the usual step is {quantity(float(np.median(steps)), 's')} "
            f"({_more(gaps, 'gaps')}); the course must cover it: fill in its rows"
        )


def _more(found: np.ndarray, things: str) -> str:
    return f"{len(found):,} such {things}" if len(found) > 1 else "the only one"


def limits_of(
    model: Model, limits: Sequence[float] | None, slew: float | None
) -> tuple[Limits, list[str]]:
    """Limits inside the plane, and a sentence where they reached beyond it."""
    plane, unit = model.plane, pretty_unit(model.units.get("input", ""))
    low, high, notes = plane.low, plane.high, list[str]()
    if limits is not None:
        if len(limits) != 2 or not limits[0] < limits[1] or not np.all(np.isfinite(limits)):
            raise InputError(
                f"the limits are {','.join(f'{limit:g}' for limit in limits)}; give two numbers, "
                "the lower one first"
            )
        low, high = max(low, float(limits[0])), min(high, float(limits[1]))
        if not low < high:
            raise InputError(
                f"the limits {limits[0]:g} to {limits[1]:g} {unit} lie outside the range "
                f"{plane.low:g} to {plane.high:g} {unit} on which the model was identified; give "
                "limits in it, or identify a model on a record that covers them"
            )
        if limits[0] < plane.low or limits[1] > plane.high:
            notes.append(
                f"the limits reach beyond the range {plane.low:g} to {plane.high:g} {unit} on "
                "which the model was identified, and the drive stays in it"
            )
    if slew is not None and not slew > 0:
        raise InputError(f"the slew is {slew:g}; give a rate above 0, in {unit or 'units'} per s")
    return Limits(low, high, np.inf if slew is None else float(slew)), notes


def _span(
    model: Model, past: Past, allowed: Limits, aux: dict[str, np.ndarray]
) -> tuple[float, float]:
    """Least and greatest output of a drive to its nearer limit, to the other one, and back."""
    (low, high), start, count = allowed[:2], past.last_input, len(past.time)
    near, far = (low, high) if start - low < high - start else (high, low)
    corners = np.rint(np.array([0, 0.2, 0.6, 1]) * (count - 1))  # rows, so that no end is cut off
    sweep = np.interp(np.arange(count), corners, [start, near, far, near])
    within = replace(model, band=None).predict(past.record(sweep, aux)).output[-count:]
    return float(within.min()), float(within.max())


def _notes(model: Model, wanted: Record, reachable: np.ndarray, expected: np.ndarray) -> list[str]:
    unit, notes = model.units.get("output", ""), list[str]()
    left = [effect.name for effect in model.chain.converters]
    if left:
        off = _rms((expected - wanted.output)[reachable]) if reachable.any() else 0.0
        notes.append(
            f"{' and '.join(left)} cannot be inverted and left out; that means an RMS error of "
            f"{quantity(off, unit)} where the course can be reached"
        )
    ratio = wanted.step_s / model.origin.step_s
    if not 0.5 <= ratio <= 2:
        notes.append(
            f"the median time step of the course is {ratio:.3g} times that of the record on which "
            "the model was identified; the band does not allow for that"
        )
    return notes


@dataclass(frozen=True)
class Tracking:
    """RMS tracking errors to expect on a course, in the unit of the output.

    Attributes:
        compensated: with the drive of the inverse.
        straight: with the affine map that fits that drive best.
        model: held-out error of the model, which both contain.
    """

    compensated: float
    straight: float
    model: float


def tracking(
    model: Model,
    wanted: Record,
    found: Compensation,
    *,
    after: Record | None = None,
    limits: Sequence[float] | None = None,
    slew: float | None = None,
) -> Tracking:
    r"""How well a drive follows its course, and how well a straight line would.

    What the model expects differs from the course by an RMS of \(e\), and the stage from the model
    by its held-out error \(\sigma\): together \(\sqrt{e^2 + \sigma^2}\).  The affine map
    \(u = a + b\,z\) is that which fits the drive of the inverse best, within the same limits.
    """
    rows = slice(-len(found.time), None)
    aux = {name: wanted.aux[name] for name in auxiliary_columns(model.effects)}
    with on_processor():
        past = past_of(model, wanted, after)
        dt = np.diff(past.time, prepend=past.time[0] - past.pause_s)
        line = _fitted(found.wanted, found.drive)
        straight = limited(line, dt, limits_of(model, limits, slew)[0], past.last_input)
        output = replace(model, band=None).predict(past.record(straight, aux)).output[rows]
    own = model.rms_validation
    return Tracking(
        float(np.hypot(_rms(found.expected - found.wanted), own)),
        float(np.hypot(_rms(output - found.wanted), own)),
        own,
    )


def _fitted(wanted: np.ndarray, drive: np.ndarray) -> np.ndarray:
    """The drive as a straight line of the course, by least squares."""
    centred = wanted - wanted.mean()
    power = float(centred @ centred)
    slope = float(centred @ drive) / power if power > 0 else 0.0
    return drive.mean() + slope * centred


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


COLUMNS = ("t", "u", "z_expected", "z_low", "z_high", "reachable")
"""Columns of a drive's file."""


def drive_csv(found: Compensation) -> bytes:
    """A drive as the text of its file, one row for each row of the course."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    series = (found.time, found.drive, found.expected, found.low, found.high)
    reachable = found.reachable.astype(int)
    writer.writerows(zip(*(values.tolist() for values in (*series, reachable)), strict=True))
    return text.getvalue().encode()


def wanted_course(
    model: Model,
    table: Table,
    name: str,
    *,
    time: str | None = None,
    output: str | None = None,
    aux: Sequence[str] = (),
    rate: float | None = None,
    units: Mapping[str, str] | None = None,
) -> Record:
    """The wanted course in a file, as a record whose output it is."""
    output = output or model.columns["output"]
    own_time = NO_CLOCK if model.units.get("time") == SAMPLES else model.columns["time"]
    time = time or (None if rate is not None else own_time)
    units = dict(units or {})
    if "output" in units:
        units["input"] = units.pop("output")
    else:
        units.pop("input", None)
    if time not in (None, NO_CLOCK) and (own := model.units.get("time")):
        units.setdefault("time", own)
    names = [*aux, *(column for column in auxiliary_columns(model.effects) if column not in aux)]
    # A record has an input without holes: of a course that is its output, which goes by that name
    # in what the reader says of it.
    try:
        course = Record.of_table(
            table,
            name,
            time=time,
            input=output,
            aux=names,
            rate=rate,
            units=units,
            need_output=False,
        )
    except InputError as error:
        said = str(error).replace("--input", "--output")
        raise InputError(said.replace("the input must be", "the wanted output must be")) from error
    if course.torn_row is not None:
        raise InputError(
            f"{table.source}: the last row, {course.torn_row}, breaks off; complete or remove it"
        )
    channels = {**course.channels, "output": course.channels["input"]}
    return replace(course, output=course.input, channels=channels)

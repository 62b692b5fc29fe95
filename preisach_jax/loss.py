"""The energy that closed cycles lose, as measured and as a model has it; units of magnets."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from preisach_jax.errors import InputError
from preisach_jax.model import Model, Prediction
from preisach_jax.model.band import COVERAGE_Z, InputMotion, VarianceLaw
from preisach_jax.quantity import pretty_unit
from preisach_jax.record.core import Record
from preisach_jax.record.course import reversals
from preisach_jax.record.units import split_unit

SAME_KIND = 0.05
"""Share of the swing, and of the duration, by which cycles of one kind may differ."""

CLOSES = 0.02
"""Share of a cycle's swing by which the input may miss its first turning point at the end."""

LEAST_SAMPLES = 16
"""Samples of the shortest cycle that is counted: the polygon of a sine of so many lacks 2.6 %."""

BRIDGED = 0.1
"""Greatest share of a cycle's samples without a measured output that is bridged."""

MU_0 = 4e-7 * math.pi
"""Magnetic constant, in T m/A; it differs from the measured one by 2e-10."""

FIELD_UNITS = {
    "A/m": 1.0, "kA/m": 1e3, "MA/m": 1e6, "mA/m": 1e-3, "A/cm": 1e2, "A/mm": 1e3,
    "Oe": 1e3 / (4 * math.pi), "kOe": 1e6 / (4 * math.pi), "mOe": 1 / (4 * math.pi),
}  # fmt: skip
"""What one of a unit of H is in A/m."""

INDUCTION_UNITS = {
    "T": 1.0, "mT": 1e-3, "uT": 1e-6, "µT": 1e-6, "nT": 1e-9, "G": 1e-4, "kG": 1e-1, "mG": 1e-7,
    "Wb/m2": 1.0, "Wb/m²": 1.0, "Vs/m2": 1.0, "Vs/m²": 1.0,
}  # fmt: skip
"""What one of a unit of B is in T."""

JOULES = "J/m3"

REACH = 4.0
"""Cells over which what cells miss is the same: the longer one of the two decays of the law."""


@dataclass(frozen=True)
class Cycle:
    """A closed cycle, or the mean of several of one kind, and what energy it loses.

    Attributes:
        count: how many cycles it stands for.
        start_s: time at which it, or the first one, begins, in s.
        duration_s: in s, with cycles that lie inside it.
        input_low, input_high: ends of the input, in its unit.
        output_low, output_high: ends of the measured output, in its unit; NaN where it was not
            measured.
        measured: the loss of the measured loop; NaN where the output was not measured.
        model: the loss of the model's loop; NaN without a model.
        low, high: 95 % band of what a measurement would give if the model holds.
    """

    count: int
    start_s: float
    duration_s: float
    input_low: float
    input_high: float
    output_low: float
    output_high: float
    measured: float
    model: float
    low: float
    high: float

    @property
    def difference_percent(self) -> float:
        """By how much the model's loss is above the measured one, in per cent."""
        return 100 * (self.model / self.measured - 1) if self.measured else math.nan


@dataclass(frozen=True)
class Loss:
    """What the closed cycles of a record lose.

    Attributes:
        unit: of the losses: `"J/m3"`, or that of the input times that of the output.
        field: which signal is the magnetic field, `"input"` or `"output"`; empty if none is.
        cycles: each closed cycle, in the order of their ends.
    """

    unit: str
    field: str
    cycles: tuple[Cycle, ...]

    @property
    def kinds(self) -> tuple[Cycle, ...]:
        """Means over cycles of like ends and duration, the slowest ones first."""
        groups: list[list[Cycle]] = []
        for cycle in self.cycles:
            for group in groups:
                if _same_kind(group[0], cycle):
                    group.append(cycle)
                    break
            else:
                groups.append([cycle])
        return tuple(sorted(map(_mean, groups), key=lambda kind: -kind.duration_s))

    def to_json(self) -> dict[str, Any]:
        """The losses of each kind of cycle as plain numbers; None for what is unknown."""
        rows = [
            asdict(kind) | {"difference_percent": kind.difference_percent} for kind in self.kinds
        ]
        known = [{key: None if math.isnan(x) else x for key, x in row.items()} for row in rows]
        return {"unit": self.unit, "field": self.field, "cycles": known}


def loss_per_cycle(record: Record, model: Model | None = None) -> Loss:
    r"""The energy that each closed cycle of a record loses, and what a model says of it.

    \[ W = \oint H\,dB \]

    of a magnet, whichever of the two is the input; of other records \(\oint u\,dz\), which is
    positive where the output lags behind the input.  The model's loss is that of the output that
    it predicts from the input, and its band holds the measured loss of 95 of 100 cycles: it is
    made of the losses of the `Others` of its band, and of what its `VarianceLaw` adds to them.

    Arguments:
        record: the measurement.
        model: a model of it; by default none.

    Returns:
        The losses, in J/m³ where the units are those of H (A/m, Oe, or T of a name such as mu0H)
        and B (T, G); else in the input's unit times the output's.

    Raises:
        InputError: if `record` is no record, the unit of a signal is unknown, or the model cannot
            be used with the record.

    Example:
        >>> t = np.arange(2000) / 1000
        >>> h, b = 100 * np.cos(6.283 * t), 1.5 * np.cos(6.283 * t - 0.1)
        >>> record = Record.from_arrays(t, h, b, units={"input": "A/m", "output": "T"})
        >>> loss = loss_per_cycle(record)
        >>> area = np.pi * 100 * 1.5 * np.sin(0.1)
        >>> round(loss.cycles[0].measured, 1), round(float(area), 1), loss.unit
        (47.0, 47.0, 'J/m3')
    """
    if not isinstance(record, Record):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise InputError(
            f"record is a {type(record).__name__}; give a Record, as Record.load makes it"
        )
    magnet = magnet_of(record)
    unit = JOULES if magnet else area_unit(record)
    factor = 1.0
    if magnet is not None:
        factor = magnet.joules * (1 if magnet.field == "input" else -1)
    loops = closed_cycles(record)
    modelled = half = np.full(len(loops), np.nan)
    if model is not None and loops:
        output = model.predict(record)
        modelled = np.array([_area(loop, record.input, output.output) for loop in loops])
        half = half_widths(model, record, output, loops)
    cycles = [
        _cycle(record, loop, factor, factor * area, abs(factor) * width)
        for loop, area, width in zip(loops, modelled.tolist(), half.tolist(), strict=True)
    ]
    return Loss(unit, magnet.field if magnet else "", tuple(cycles))


def _cycle(record: Record, loop: ClosedPath, factor: float, modelled: float, half: float) -> Cycle:
    driven, output = loop.along(record.input), loop.along(record.output)
    known = ~np.isnan(output)
    enough = np.mean(known) >= 1 - BRIDGED
    ends = np.interp([loop.start, loop.stop], np.arange(len(record)), record.time)
    return Cycle(
        count=1,
        start_s=float(ends[0]),
        duration_s=float(ends[1] - ends[0]),
        input_low=float(driven.min()),
        input_high=float(driven.max()),
        output_low=float(output[known].min()) if enough else math.nan,
        output_high=float(output[known].max()) if enough else math.nan,
        measured=factor * _area(loop, record.input, record.output) if enough else math.nan,
        model=modelled,
        low=modelled - half,
        high=modelled + half,
    )


def _area(loop: ClosedPath, input: np.ndarray, output: np.ndarray) -> float:
    """Area of a loop, straight where the output was not measured."""
    x, y = loop.along(input), loop.along(output)
    known = ~np.isnan(y)
    return enclosed(x[known], y[known])


def _same_kind(one: Cycle, other: Cycle) -> bool:
    near = SAME_KIND * (one.input_high - one.input_low)
    return (
        abs(one.input_low - other.input_low) <= near
        and abs(one.input_high - other.input_high) <= near
        and abs(one.duration_s - other.duration_s) <= SAME_KIND * one.duration_s
    )


def _mean(cycles: Sequence[Cycle]) -> Cycle:
    """The mean of some cycles; their model's error is one and the same, so its band is as wide."""
    columns = {name: [row[name] for row in map(asdict, cycles)] for name in asdict(cycles[0])}
    means = {name: _mean_of_known(values) for name, values in columns.items()}
    return replace(Cycle(**means), count=len(cycles), start_s=cycles[0].start_s)


def _mean_of_known(values: Sequence[float]) -> Any:
    known = [value for value in values if not math.isnan(value)]
    return sum(known) / len(known) if known else math.nan


@dataclass(frozen=True, eq=False)
class ClosedPath:
    """A closed cycle of the input.

    Attributes:
        start, stop: where it begins and ends, in samples of the record.
        path: (corner,) samples in between, without cycles that lie inside; the last one, where the
            input comes back, lies between two samples.
    """

    start: float
    stop: float
    path: np.ndarray

    def along(self, values: np.ndarray) -> np.ndarray:
        """(corner,) a signal on its path, straight between samples."""
        low = np.floor(self.path).astype(int)
        high = np.minimum(low + 1, len(values) - 1)
        share = self.path - low
        # A neighbour that was not measured says nothing where its share is nought.
        return np.where(share > 0, (1 - share) * values[low] + share * values[high], values[low])


def closed_cycles(record: Record) -> list[ClosedPath]:
    """The cycles of a record's input that close, by counting rainflow.

    From a turning point, a cycle goes to the next one and back to the value of the first, with an
    allowance of `CLOSES`.  A cycle inside another one is taken out of its path, as a Preisach
    operator forgets it, so that each stretch of the input belongs to one cycle (S. D. Downing,
    D. F. Socie, Int. J. Fatigue 4 (1982) 31-40).
    """
    found: list[ClosedPath] = []
    band = 0.01 * float(np.ptp(record.input))
    for rows in record.stretches:
        turns = rows.start + reversals(record.input[rows], band)
        found += _rainflow(record.input, [rows.start, *turns.tolist(), rows.stop - 1])
    return sorted(
        (loop for loop in found if len(loop.path) >= LEAST_SAMPLES), key=lambda loop: loop.stop
    )


def _rainflow(values: np.ndarray, corners: list[int]) -> list[ClosedPath]:
    """Closed cycles between corners, of which the first and the last one are ends and no turns."""
    found: list[ClosedPath] = []
    points, paths = [corners[0]], [np.array([float(corners[0])])]
    for corner in corners[1:]:
        paths[-1] = np.arange(points[-1], corner, dtype=float)
        points.append(corner)
        paths.append(np.array([float(corner)]))
        while len(points) >= 3:
            first, turn, last = points[-3:]
            swing = abs(values[turn] - values[first])
            if abs(values[last] - values[turn]) < (1 - CLOSES) * swing:
                break
            if first == corners[0]:  # it is an end, at which no cycle begins
                del points[0], paths[0]
                continue
            back = _crossing(values, paths[-2], last, values[first])
            there = paths[-2][paths[-2] < back]
            found.append(ClosedPath(float(first), back, np.concatenate([paths[-3], there, [back]])))
            rest = paths[-2][paths[-2] > back]
            del points[-3:-1], paths[-3:-1]
            if points[:-1]:
                paths[-2] = np.concatenate([paths[-2], [float(first), back], rest])
    return found


def _crossing(values: np.ndarray, path: np.ndarray, last: int, level: float) -> float:
    """Where a branch first comes to a level, between samples; its end if it stays below."""
    places = np.append(path, float(last))
    along = np.interp(places, np.arange(len(values)), values)
    rising = along[-1] > along[0]
    passed = np.flatnonzero((along >= level) if rising else (along <= level))
    if not len(passed):
        return float(last)
    k = int(passed[0])
    share = (level - along[k - 1]) / (along[k] - along[k - 1])
    return float(places[k - 1] + share * (places[k] - places[k - 1]))


def enclosed(x: np.ndarray, y: np.ndarray) -> float:
    r"""Area that a closed path encloses, positive where it runs counterclockwise.

    \[ \oint x\,dy = \tfrac12 \sum_k (x_k\,y_{k+1} - x_{k+1}\,y_k) \]

    From the last of the (corner,) coordinates the path goes straight to the first.
    """
    x, y = x - x.mean(), y - y.mean()
    return 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def half_widths(
    model: Model, record: Record, predicted: Prediction, loops: Sequence[ClosedPath]
) -> np.ndarray:
    r"""(loop,) half widths of the 95 % band of the loss of some cycles.

    What a prediction misses, e(t), changes the area of a loop by \(\oint e\,du\). Its variance is
    a sum of parts, with the sizes of the `VarianceLaw` of the prediction's band, which differ in
    how far e is the same along the path:

    - of other models that the record could have led to, each has a loop of its own, and its area
      is taken as it is;
    - what goes with the speed has one sign on each branch, so that it adds up along the whole
      path, \((\oint \sigma\,|du|)^2\);
    - what cells of width c miss is the same over four of them, \(\oint \sigma^2\,4 c\,|du|\);
    - noise is the same over no step at all, \(\sum \sigma^2 (\Delta u)^2\).

    The half width is the conformal quantile of the band times the deviation. Where the memory is
    unknown, the area of what the input forces on the way comes to it, at most its height times
    the swing.
    """
    half = 0.5 * (predicted.high - predicted.low)
    band = model.band
    if band is None:  # which says nothing of the parts
        return np.array([_of_one_sign(loop, record.input, half) for loop in loops])
    course = InputMotion.of(record)
    rows, apart = model.others_along(record)
    of_blocks = band.others.of_blocks if band.others is not None else 0
    parts = apart[:of_blocks], apart[of_blocks:]
    open_memory = np.maximum(half - model.half_width(record), 0.0)
    slices = band.by_slice(course)
    found: list[float] = []
    for loop in loops:
        variance = _of_law(loop, record.input, course, band.law)
        for differences, share in zip(parts, band.law.shares[-2:].tolist(), strict=True):
            variance += share * _of_others(loop, record.input, rows, differences)
        deviations = float(np.mean(loop.along(slices)))
        # A hysteron of unknown state adds a constant, and so no area, until the input forces it.
        forced = float(np.ptp(loop.along(open_memory)))
        more = forced * float(np.ptp(loop.along(record.input)))
        found.append(deviations * float(np.sqrt(variance)) + more)
    return np.array(found)


def _of_one_sign(loop: ClosedPath, input: np.ndarray, size: np.ndarray) -> float:
    """What an error of one sign on each branch makes of an area."""
    steps, along = np.abs(np.diff(loop.along(input))), loop.along(size)
    return float(np.sum(0.5 * (along[1:] + along[:-1]) * steps))


def _of_law(loop: ClosedPath, input: np.ndarray, course: InputMotion, law: VarianceLaw) -> float:
    """Variance of an area by what goes with the speed, what cells miss, and noise."""
    of_speed, rest = law.by_origin(course)
    noise = np.minimum(rest, (law.least / COVERAGE_Z) ** 2)
    steps = np.abs(np.diff(loop.along(input)))
    of_steps = loop.along(noise)[1:] @ steps**2
    of_cells = loop.along(rest - noise)[1:] @ (steps * np.maximum(REACH * law.cell, steps))
    return float(_of_one_sign(loop, input, np.sqrt(of_speed)) ** 2 + of_steps + of_cells)


def _of_others(
    loop: ClosedPath, input: np.ndarray, rows: np.ndarray, differences: np.ndarray
) -> float:
    """Sum of the squared areas by which some other models differ."""
    x = loop.along(input)
    curves: list[np.ndarray] = [np.interp(loop.path, rows, row) for row in differences]
    return sum(enclosed(x, curve) ** 2 for curve in curves)


@dataclass(frozen=True)
class Magnet:
    """Which signal of a record is the field.

    Attributes:
        field: `"input"` or `"output"`; the other one is the induction.
        joules: energy in J/m³ of a loop whose area in input unit times output unit is one.
    """

    field: str
    joules: float


def magnet_of(record: Record) -> Magnet | None:
    r"""The field and the induction of a record by their units, or None if it is of no magnet.

    The field is in A/m, Oe and their multiples, or as \(\mu_0 H\) in units of the induction, if
    its name then begins with H or has mu0H in it. The induction is in T, G and their multiples.
    """
    units = {role: record.channels[role].unit for role in ("input", "output")}
    inductions = [role for role, unit in units.items() if unit in INDUCTION_UNITS]
    fields = [role for role, unit in units.items() if unit in FIELD_UNITS]
    if len(inductions) == 2:
        fields = [role for role in inductions if _is_field(record.channels[role].name)]
        inductions = [role for role in inductions if role not in fields]
    if len(fields) != 1 or len(inductions) != 1:
        return None
    (field,), (induction,) = fields, inductions
    unit = units[field]
    amperes = FIELD_UNITS[unit] if unit in FIELD_UNITS else INDUCTION_UNITS[unit] / MU_0
    # A product first: 1000 times 0.001 is 1 to the last bit.
    return Magnet(field, amperes * INDUCTION_UNITS[units[induction]])


def _is_field(name: str) -> bool:
    quantity = split_unit(name)[0].strip().lower().replace("μ", "u").replace("µ", "u")
    return quantity.startswith("h") or any(word in quantity for word in ("mu0h", "mu0_h", "u0h"))


def area_unit(record: Record) -> str:
    """Unit of the area of a loop of a record that is of no magnet."""
    units = [pretty_unit(record.channels[role].unit) for role in ("input", "output")]
    if not all(units):
        given = ", ".join(f"{role} {record.channels[role].unit!r}" for role in ("input", "output"))
        raise InputError(
            f"{record.name}: the units are {given}, and a loop has an energy only in units; give "
            'them, as in units={"input": "A/m", "output": "T"}'
        )
    return "·".join(units)

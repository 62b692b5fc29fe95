"""The energy that closed cycles lose, as measured and as a model has it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from preisach_jax.errors import InputError
from preisach_jax.loss.cycles import BRIDGED, ClosedPath, closed_cycles, enclosed
from preisach_jax.loss.magnetic import JOULES, area_unit, magnet_of
from preisach_jax.loss.uncertainty import half_widths
from preisach_jax.model import Model
from preisach_jax.record import Record

ALIKE = 0.05
"""Share of the swing, and of the duration, by which cycles of one kind may differ."""


@dataclass(frozen=True)
class Cycle:
    """A closed cycle, or the mean of several that are alike, and what energy it loses.

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
                if _alike(group[0], cycle):
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
    made of the losses of the `Others` of its band, and of what its `Law` says beside them.

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


def _alike(one: Cycle, other: Cycle) -> bool:
    near = ALIKE * (one.input_high - one.input_low)
    return (
        abs(one.input_low - other.input_low) <= near
        and abs(one.input_high - other.input_high) <= near
        and abs(one.duration_s - other.duration_s) <= ALIKE * one.duration_s
    )


def _mean(cycles: Sequence[Cycle]) -> Cycle:
    """The mean of some cycles; their model's error is one and the same, so its band is as wide."""
    columns = {name: [row[name] for row in map(asdict, cycles)] for name in asdict(cycles[0])}
    means = {name: _mean_of_known(values) for name, values in columns.items()}
    return replace(Cycle(**means), count=len(cycles), start_s=cycles[0].start_s)


def _mean_of_known(values: Sequence[float]) -> Any:
    known = [value for value in values if not math.isnan(value)]
    return sum(known) / len(known) if known else math.nan

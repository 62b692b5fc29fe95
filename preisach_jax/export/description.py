"""What a model is in discrete time: its parts, with their numbers for one sample interval."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

from preisach_jax.chain.compiled import LEAST_LENGTHS, as_arrays, law_over_steps
from preisach_jax.chain.description import Chain
from preisach_jax.cores import on_processor
from preisach_jax.effects.base import (
    AddedEffect,
    Effect,
    HysteresisEffect,
    OfColumn,
    OutputEffect,
    Place,
    SensorEffect,
    Stepped,
)
from preisach_jax.effects.linear import StateSpace
from preisach_jax.errors import InputError
from preisach_jax.export.template import filled, piece_of
from preisach_jax.model import (
    RANGE_TOLERANCE,
    Model,
    check_not_inside,
    exactly_summable,
    without_effects,
)
from preisach_jax.operator.plane import Plane
from preisach_jax.record.channels import SAMPLES

MOST_DELAYED = 1_000_000
"""Samples beyond which a delay is refused: they would all have to be kept."""

LEAST_PASSED = 0.5
"""Share of a move that a linear effect passes in the same sample, above which its inverse is that
of this sample and stable; below, it is taken as settled and led."""


class Linear(NamedTuple):
    """A linear effect over one sample interval, as numbers, see `StateSpace`."""

    a: np.ndarray
    b: np.ndarray
    c: np.ndarray
    d: float

    @staticmethod
    def of(law: StateSpace, amounts: tuple[float, ...]) -> Linear:
        """Those of a state space, whose outputs are summed by the coefficients where it has any."""
        a, b, c, d = (np.asarray(each, dtype=float) for each in law)
        if amounts:
            c, d = np.tensordot(amounts, c, 1), np.dot(amounts, d)
        return Linear(a, b, c, float(d))

    @property
    def numbers(self) -> int:
        """Numbers that it remembers of a signal: the last value, and the states."""
        return 1 + self.b.size

    @property
    def passes(self) -> bool:
        """Whether so much of a move comes out in the same sample that it can be inverted there."""
        return abs(self.d + float(np.sum(self.c * self.b))) >= LEAST_PASSED

    @property
    def lead(self) -> float:
        """Samples by which a straight course comes out late."""
        size = self.a.shape[-1]
        late = np.linalg.solve(np.eye(size) - self.a, self.b[..., None])[..., 0]
        return -float(np.sum(self.c * late)) / self.d if self.d else 0.0


@dataclass(frozen=True, eq=False)
class Part:
    """One effect in discrete time.

    Attributes:
        effect: the effect, where it acts.
        identifier: its name in C.
        linear: what it is where it is linear.
        numbers: its numbers where it is not, and what is not linear in it.
        amounts: its linear coefficients.
        said: its parameters as the model has them, for the reader of the code.
        file: its piece of the C code where it is neither linear nor a delay, see `template`.
    """

    effect: Effect
    identifier: str
    linear: Linear | None
    numbers: Mapping[str, Any]
    amounts: tuple[float, ...]
    said: str
    file: Path | None

    @property
    def name(self) -> str:
        """The effect's name in the model."""
        return self.effect.name

    @property
    def is_delay(self) -> bool:
        """Whether it is a pure delay."""
        return isinstance(self.effect, OutputEffect) and self.effect.is_delay

    @property
    def function(self) -> str:
        """Name of its function in C."""
        return f"effect_{self.identifier}"

    @cached_property
    def piece(self) -> Any:
        """Its piece of the C code, filled with its numbers; None where it has none."""
        if self.file is None:
            return None
        names = {"name": self.function, "id": self.identifier}
        return filled(self.file, {"part": self, "n": self.numbers} | names)

    @property
    def in_sensor(self) -> bool:
        """Whether it acts last of all, on the reading."""
        return isinstance(self.effect, SensorEffect)

    @property
    def feeds_back(self) -> bool:
        """Whether the hysterons see their own output through it."""
        return isinstance(self.effect, HysteresisEffect) and self.effect.feeds_back

    @property
    def resolution(self) -> float:
        """Step of the sensor's converter; 0 where it is none."""
        return float(self.effect.resolution) if isinstance(self.effect, SensorEffect) else 0.0

    @property
    def column(self) -> str:
        """The auxiliary column that it acts through; empty if it is the input."""
        return self.effect.column if isinstance(self.effect, OfColumn) else ""


@dataclass(frozen=True)
class Column:
    """A column of the record: its name there, its identifier in C, its unit."""

    name: str
    identifier: str
    unit: str


@dataclass(frozen=True, eq=False)
class Description:
    """A model in discrete time.

    Attributes:
        chain: the model's chain, whose effects act.
        levels, low, high: the Preisach plane.
        plane: the same from 0 to 1, with its thresholds.
        hysteron: `"ramp"` or `"relay"`.
        polarity: 1 where the output rises with the input, -1 where it falls.
        weights: (cells,) weights in output units, in the order of the plane.
        offset: output with all hysterons off, in output units.
        step_s: sample interval, in s; 1 where samples are only counted.
        has_clock: whether they are not.
        parts: the effects, in the order in which a signal passes them.
        input, output: these columns.
        aux: auxiliary columns, in the order of the model.
        record: name of the record on which the model was identified.
        rms_validation: its held-out RMS error, in output units.
        signed: whether there are weights of both signs.
        input_low, input_high: limits to which an input is moved: those that `predict` allows.
    """

    chain: Chain
    levels: int
    low: float
    high: float
    plane: Plane
    hysteron: str
    polarity: int
    weights: np.ndarray
    offset: float
    step_s: float
    has_clock: bool
    parts: tuple[Part, ...]
    input: Column
    output: Column
    aux: tuple[Column, ...]
    record: str
    rms_validation: float
    signed: bool
    input_low: float
    input_high: float

    @property
    def delay(self) -> Part | None:
        """The part that is a delay, if there is one."""
        return next((part for part in self.parts if part.is_delay), None)

    @property
    def widening(self) -> Part | None:
        """The part that moves thresholds with the speed of the input, if there is one."""
        inside = self.at(Place.HYSTERESIS)
        return next((p for p in inside if getattr(p.effect, "widens", False)), None)

    @property
    def by_path(self) -> bool:
        """Whether slow effects go with the path of the input, as nothing tells the time."""
        return self.chain.by_path

    def at(self, place: Place) -> list[Part]:
        """The parts at a place, in order, without those of the sensor."""
        parts = (part for part in self.parts if not part.in_sensor)
        return [part for part in parts if part.effect.place == place]

    @property
    def sensor(self) -> list[Part]:
        """The parts of the sensor, in order."""
        return [part for part in self.parts if part.in_sensor]


def describe(
    model: Model, rate_hz: float | None = None, without: Sequence[str] = ()
) -> Description:
    """Describe a model in discrete time.

    Arguments:
        rate_hz: sampling rate in Hz; by default that of the record of the identification.
    """
    check_not_inside(model.chain, model.origin.record, "code sample by sample")
    model = without_effects(model, without)
    if rate_hz is not None and not (math.isfinite(rate_hz) and rate_hz > 0):
        raise InputError(f"the sampling rate is {rate_hz} Hz: give a positive number")
    has_clock = model.units.get("time") != SAMPLES
    if rate_hz is not None and not has_clock:
        raise InputError(
            f"{model.origin.record} has no clock, so that the model counts samples and a rate of "
            f"{rate_hz:g} Hz changes nothing: leave the rate out"
        )
    step_s = model.origin.step_s if rate_hz is None else 1 / rate_hz
    own = _own_coefficients(model)
    taken: set[str] = set()
    with on_processor():
        parts = tuple(
            _part(model, effect, own.get(effect.name, ()), step_s, taken)
            for effect in model.chain.in_order
        )
    plane, weights = model.plane, np.asarray(model.weights, dtype=float)
    reach = RANGE_TOLERANCE * (plane.high - plane.low)
    aux = _columns(model.columns["aux"], model.units)
    return Description(
        model.chain.with_effects(tuple(part.effect for part in parts)),
        plane.levels,
        plane.low,
        plane.high,
        plane.scaled(),
        model.chain.hysteron,
        model.chain.polarity,
        exactly_summable(weights) if model.chain.hysteron == "relay" else weights,
        model.offset,
        step_s,
        has_clock,
        parts,
        Column(model.columns["input"], "u", model.units.get("input", "")),
        Column(model.columns["output"], "z", model.units.get("output", "")),
        aux,
        model.origin.record,
        model.rms_validation,
        model.chain.signed,
        plane.low - reach,
        plane.high + reach,
    )


def _own_coefficients(model: Model) -> dict[str, tuple[float, ...]]:
    """Linear coefficients by effect; those that belong to a past that is not known are zero."""
    own: dict[str, tuple[float, ...]] = {}
    linear = zip(model.chain.coefficients, model.coefficients.added.tolist(), strict=True)
    for (name, parameter), value in linear:
        own[name] = (*own.get(name, ()), value if parameter.amount else 0.0)
    return own


def _columns(names: Sequence[str], units: Mapping[str, str]) -> tuple[Column, ...]:
    """Columns with identifiers of C, none of them twice."""
    taken: set[str] = {"u", "z", "s", "state"}
    return tuple(
        Column(name, _identifier(f"aux_{name}", taken), units.get(name, "")) for name in names
    )


def _identifier(name: str, taken: set[str]) -> str:
    """A name as an identifier of C that is not taken, and now is."""
    found = "".join(c if c.isascii() and c.isalnum() else "_" for c in name).strip("_")
    while found in taken:
        found += "_"
    taken.add(found)
    return found


def _part(
    model: Model, effect: Effect, amounts: tuple[float, ...], step_s: float, taken: set[str]
) -> Part:
    acting = effect.at(model.values[effect.name])
    free = effect.coefficients() if isinstance(effect, OutputEffect) else ()
    said = ", ".join(
        f"{name} = {estimate.value:.6g} {estimate.unit.removeprefix('1')}".rstrip()
        for name, estimate in model.parameters[effect.name].items()
        if name not in [each.name for each in free]
    )
    file, linear, numbers = None, None, acting.sampled(step_s, amounts)
    if isinstance(acting, Stepped) and acting.is_linear:
        numbers = numbers or {}
        # Of as many lengths as in a prediction, whose code serves.
        own, steps = as_arrays(model.values[effect.name]), np.full(LEAST_LENGTHS, step_s)
        stepped: Any = effect
        laws: Any = jax.tree.map(np.asarray, law_over_steps(stepped, own, steps))
        law = laws._replace(a=laws.a[0], b=laws.b[0])
        linear = Linear.of(law, amounts if isinstance(acting, AddedEffect) else ())
    elif isinstance(acting, OutputEffect) and acting.is_delay:
        numbers = _delayed(acting, step_s)
    elif numbers is not None and (file := piece_of(effect)) is None:
        # What a class of one's own has changed in one of the library, that one's piece of the code
        # does not know.
        numbers = None
    if numbers is None:
        raise InputError(
            f"no C code is known for the effect {effect.name!r}: leave it out with --without "
            f"{effect.name}, which adds its part of the output to the error"
        )
    name = _identifier(effect.name, taken)
    return Part(acting, name, linear, numbers, amounts, said, file)


def _delayed(effect: OutputEffect, step_s: float) -> dict[str, Any]:
    samples = float(effect.late_s) / step_s
    if samples > MOST_DELAYED:
        raise InputError(
            f"the {effect.name} of {float(effect.late_s):.4g} s is {samples:.3g} samples at "
            f"{1 / step_s:.4g} Hz, all of which the state would keep: take a lower --rate, or "
            f"leave it out with --without {effect.name}"
        )
    whole = int(samples)
    return {"whole": whole, "part": samples - whole}

"""What a model is in discrete time: its parts, with their coefficients for one sample interval."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from preisach_jax.effects.base import Effect, OutputEffect, SensorEffect
from preisach_jax.effects.places import Place
from preisach_jax.errors import InputError
from preisach_jax.export.laws import LAWS
from preisach_jax.model import (
    RANGE_TOLERANCE,
    Model,
    check_not_inside,
    exactly_summable,
    without_effects,
)
from preisach_jax.operator.plane import Plane


@dataclass(frozen=True)
class Part:
    """One effect in discrete time.

    Attributes:
        kind: the law that it follows, the name of its section in the templates.
        name: the effect's name in the model.
        place: where it acts.
        in_sensor: whether it acts last of all, on the reading.
        numbers: its coefficients for the sample interval.
        said: its parameters as the model has them, for the reader of the code.
    """

    kind: str
    name: str
    place: Place
    in_sensor: bool
    numbers: Mapping[str, float | int | bool | tuple[float, ...]]
    said: str


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
        levels, low, high: the Preisach plane.
        plane: the same from 0 to 1, with its thresholds.
        hysteron: `"ramp"` or `"relay"`.
        polarity: 1 where the output rises with the input, -1 where it falls.
        weights: (cells,) weights in output units, in the order of the plane.
        offset: output with all hysterons off, in output units.
        step_s: sample interval, in s.
        parts: the effects, in the order in which a signal passes them.
        input, output: these columns.
        aux: auxiliary columns, in the order of the model.
        record: name of the record on which the model was identified.
        rms_validation: its held-out RMS error, in output units.
        signed: whether there are weights of both signs.
        input_low, input_high: limits to which an input is moved: those that `predict` allows.
    """

    levels: int
    low: float
    high: float
    plane: Plane
    hysteron: str
    polarity: int
    weights: np.ndarray
    offset: float
    step_s: float
    parts: tuple[Part, ...]
    input: Column
    output: Column
    aux: tuple[Column, ...]
    record: str
    rms_validation: float
    signed: bool
    input_low: float
    input_high: float

    def part(self, kind: str) -> Part | None:
        """The part of a kind, if there is one."""
        return next((part for part in self.parts if part.kind == kind), None)

    def at(self, place: Place) -> list[Part]:
        """The parts at a place, in order, without those of the sensor."""
        return [part for part in self.parts if part.place == place and not part.in_sensor]

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
    step_s = model.origin.step_s if rate_hz is None else 1 / rate_hz
    own = _own_coefficients(model)
    parts = tuple(
        _part(model, effect, own.get(effect.name, ()), step_s) for effect in model.chain.in_order
    )
    plane, weights = model.plane, np.asarray(model.weights, dtype=float)
    reach = RANGE_TOLERANCE * (plane.high - plane.low)
    aux = _columns(model.columns["aux"], model.units)
    return Description(
        plane.levels,
        plane.low,
        plane.high,
        plane.scaled(),
        model.chain.hysteron,
        model.chain.polarity,
        exactly_summable(weights) if model.chain.hysteron == "relay" else weights,
        model.offset,
        step_s,
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
    columns: list[Column] = []
    for name in names:
        plain = "".join(c if c.isascii() and c.isalnum() else "_" for c in name).strip("_")
        identifier = f"aux_{plain}" if plain else "aux"
        while identifier in taken:
            identifier += "_"
        taken.add(identifier)
        columns.append(Column(name, identifier, units.get(name, "")))
    return tuple(columns)


def _part(model: Model, effect: Effect, own: tuple[float, ...], step_s: float) -> Part:
    law = LAWS.get(type(effect))
    if law is None:
        raise InputError(
            f"no C code is known for the effect {effect.name!r}: leave it out with --without "
            f"{effect.name}, which adds its part of the output to the error"
        )
    kind, numbers_of = law
    values = dict(model.values[effect.name])
    said = ", ".join(
        f"{name} = {estimate.value:.6g} {estimate.unit.removeprefix('1')}".rstrip()
        for name, estimate in model.parameters[effect.name].items()
        if not (isinstance(effect, OutputEffect) and name in _free(effect))
    )
    in_sensor = isinstance(effect, SensorEffect)
    numbers = numbers_of(effect, values, own, step_s)
    return Part(kind, effect.name, effect.place, in_sensor, numbers, said)


def _free(effect: OutputEffect) -> set[str]:
    return {each.name for each in effect.coefficients()}

"""What a model is in discrete time: its parts, with their coefficients for one sample interval."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from preisach_jax.effects.ageing import Ageing
from preisach_jax.effects.auxiliary import Auxiliary
from preisach_jax.effects.base import Effect, OutputEffect
from preisach_jax.effects.creep import Creep
from preisach_jax.effects.delay import Delay
from preisach_jax.effects.drift import Drift
from preisach_jax.effects.eddy_currents import EddyCurrents
from preisach_jax.effects.hum import Hum
from preisach_jax.effects.input_lag import InputLag
from preisach_jax.effects.input_quantisation import InputQuantisation
from preisach_jax.effects.moving import Moving
from preisach_jax.effects.operator_creep import SHARES as CREEP_SHARES
from preisach_jax.effects.operator_creep import OperatorCreep
from preisach_jax.effects.output_lag import OutputLag
from preisach_jax.effects.output_nonlinearity import OutputNonlinearity
from preisach_jax.effects.output_quantisation import OutputQuantisation
from preisach_jax.effects.rate_dependence import RateDependence
from preisach_jax.effects.reptation import SHARES as PLAY_SHARES
from preisach_jax.effects.reptation import Reptation
from preisach_jax.effects.resonance import Resonance
from preisach_jax.effects.slew_limit import SlewLimit
from preisach_jax.errors import InputError
from preisach_jax.model import RANGE_TOLERANCE, Model, exactly_summable

MOST_DELAYED = 1_000_000
"""Samples beyond which a delay is refused: they would all have to be kept."""

Numbers = dict[str, float | int | bool | tuple[float, ...]]


@dataclass(frozen=True)
class Part:
    """One effect in discrete time.

    Attributes:
        kind: the law that it follows, the name of its section in the templates.
        name: the effect's name in the model.
        place: where it acts, one of `PLACE_NAMES`.
        numbers: its coefficients for the sample interval.
        said: its parameters as the model has them, for the reader of the code.
    """

    kind: str
    name: str
    place: str
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
        input_low, input_high: limits to which an input is moved: those that `predict` allows.
    """

    levels: int
    low: float
    high: float
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
    input_low: float
    input_high: float

    def part(self, kind: str) -> Part | None:
        """The part of a kind, if there is one."""
        return next((part for part in self.parts if part.kind == kind), None)

    def at(self, place: str) -> list[Part]:
        """The parts at a place, in order."""
        return [part for part in self.parts if part.place == place]


def describe(
    model: Model, rate_hz: float | None = None, without: Sequence[str] = ()
) -> Description:
    """Describe a model in discrete time.

    Arguments:
        model: the model.
        rate_hz: sampling rate in Hz; by default that of the record on which it was identified.
        without: names of effects that are left out.

    Returns:
        The description; its parts begin as `Model.predict` begins a record that continues none.

    Raises:
        InputError: if the rate is not positive, an effect to leave out is not in the model, or an
            effect is not one of the built-in library.
    """
    model = left_out(model, without)
    if rate_hz is not None and not (math.isfinite(rate_hz) and rate_hz > 0):
        raise InputError(f"the sampling rate is {rate_hz} Hz: give a positive number")
    step_s = model.origin.step_s if rate_hz is None else 1 / rate_hz
    own = _own_coefficients(model)
    parts = tuple(
        _part(model, effect, place, own.get(effect.name, ()), step_s)
        for place, effect in model.chain.stations
    )
    plane, weights = model.plane, np.asarray(model.weights, dtype=float)
    reach = RANGE_TOLERANCE * (plane.high - plane.low)
    aux = _columns(model.columns["aux"], model.units)
    return Description(
        plane.levels,
        plane.low,
        plane.high,
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
        plane.low - reach,
        plane.high + reach,
    )


def left_out(model: Model, without: Sequence[str]) -> Model:
    """The model without some of its effects.

    Arguments:
        model: the model.
        without: names of the effects that are left out.

    Returns:
        The model of the others, with their numbers as they were.

    Raises:
        InputError: if one of the effects is not in the model.
    """
    names = [effect.name for effect in model.effects]
    for name in without:
        if name not in names:
            have = ", ".join(names) or "none"
            raise InputError(f"there is no effect {name!r} to leave out (in the model: {have})")
    if not without:
        return model
    linear = zip(model.chain.coefficients, model.coefficients.added.tolist(), strict=True)
    added = [value for (name, _), value in linear if name not in without]
    effects = tuple(effect for effect in model.effects if effect.name not in without)
    return replace(
        model,
        chain=model.chain.with_effects(effects),
        coefficients=replace(model.coefficients, added=np.array(added)),
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


def _part(model: Model, effect: Effect, place: str, own: tuple[float, ...], step_s: float) -> Part:
    law = _LAWS.get(type(effect))
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
    return Part(kind, effect.name, place, numbers_of(effect, values, own, step_s), said)


def _free(effect: OutputEffect) -> set[str]:
    return {each.name for each in effect.coefficients()}


def _low_pass(tau_s: float, step_s: float) -> tuple[float, float]:
    """Decay of a first-order low-pass in a step, and its part of the signal's move."""
    return math.exp(-step_s / tau_s), -math.expm1(-step_s / tau_s) * tau_s / step_s


def _lag(effect: Any, values: dict[str, float], own: tuple[float, ...], step_s: float) -> Numbers:
    decay, share = _low_pass(values["tau_s"], step_s)
    return {"decay": decay, "share": share, "lead": values["tau_s"] / step_s}


def _slew(effect: Any, values: dict[str, float], own: tuple[float, ...], step_s: float) -> Numbers:
    return {"most": values["slew"] * step_s}


def _rounding(
    effect: Any, values: dict[str, float], own: tuple[float, ...], step_s: float
) -> Numbers:
    return {"step": values["step"]}


def _widening(
    effect: Any, values: dict[str, float], own: tuple[float, ...], step_s: float
) -> Numbers:
    return {
        "coefficient": values["coefficient"],
        "exponent": values["exponent"],
        "per_sample": effect.reference_per_s * step_s,
        "corners": effect.with_corners,
        "reversible": effect.with_reversible,
    }


def _eddy(effect: Any, values: dict[str, float], own: tuple[float, ...], step_s: float) -> Numbers:
    return {"gain": values["k"] / step_s}


def _moving(
    effect: Any, values: dict[str, float], own: tuple[float, ...], step_s: float
) -> Numbers:
    return {
        "gain": values["a"],
        "low": effect.low_u,
        "scale": 1 + values["a"] * effect.range_z / effect.range_u,
    }


def _ageing(
    effect: Any, values: dict[str, float], own: tuple[float, ...], step_s: float
) -> Numbers:
    tau_s = values["tau_s"]
    return {
        "loss": values["loss"] / math.expm1(-effect.horizon_s / tau_s),
        "per_sample": -step_s / tau_s,
    }


def _creep(effect: Any, values: dict[str, float], own: tuple[float, ...], step_s: float) -> Numbers:
    passes = [_low_pass(tau_s, step_s) for tau_s in effect.tau_s]
    return {
        "gain": tuple(values[f"c_{i + 1}"] for i in range(len(effect.tau_s))),
        "decay": tuple(decay for decay, _ in passes),
        "share": tuple(share for _, share in passes),
    }


def _delay(effect: Any, values: dict[str, float], own: tuple[float, ...], step_s: float) -> Numbers:
    samples = values["delay_s"] / step_s
    if samples > MOST_DELAYED:
        raise InputError(
            f"the delay of {values['delay_s']:.4g} s is {samples:.3g} samples at "
            f"{1 / step_s:.4g} Hz, all of which the state would keep: take a lower --rate, or "
            "leave it out with --without delay"
        )
    whole = int(samples)
    return {"whole": whole, "part": samples - whole}


def _resonance(
    effect: Any, values: dict[str, float], own: tuple[float, ...], step_s: float
) -> Numbers:
    zeta, angle = values["zeta"], 2 * math.pi * values["f_hz"] * step_s
    root, decay = math.sqrt(1 - zeta**2), math.exp(-zeta * angle)
    cosine, sine = decay * math.cos(root * angle), decay * math.sin(root * angle) / root
    gone = 1 - cosine - zeta * sine
    return {
        "away": (1 - gone, sine, -(sine + 2 * zeta * gone) / angle),
        "speed": (-sine, cosine - zeta * sine, gone / angle),
    }


def _drift(effect: Any, values: dict[str, float], own: tuple[float, ...], step_s: float) -> Numbers:
    if effect.waves:
        return {"waves": own, "per_sample": step_s / effect.horizon_s}
    tau_s = values["tau_s"]
    return {
        "amplitude": own[0] / math.expm1(-effect.horizon_s / tau_s),
        "per_sample": -step_s / tau_s,
    }


def _hum(effect: Any, values: dict[str, float], own: tuple[float, ...], step_s: float) -> Numbers:
    turns = values["f_hz"] * step_s
    return {
        "cosine": own[0::2],
        "sine": own[1::2],
        "turns": turns,
        "phase": round((turns - math.floor(turns)) * 2**64) % 2**64,
    }


def _auxiliary(
    effect: Any, values: dict[str, float], own: tuple[float, ...], step_s: float
) -> Numbers:
    decay, share = _low_pass(values["tau_s"], step_s)
    return {"gain": own[0], "decay": decay, "share": share}


def _reptation(
    effect: Any, values: dict[str, float], own: tuple[float, ...], step_s: float
) -> Numbers:
    return {
        "reach": tuple(effect.range_u * share for share in PLAY_SHARES),
        "gain": own,
        "path": values["path"],
    }


def _operator_creep(
    effect: Any, values: dict[str, float], own: tuple[float, ...], step_s: float
) -> Numbers:
    count = len(effect.tau_s)
    even = np.linspace(-1.0, 1.0, count)
    spectrum = np.stack([np.ones_like(even), even, 1.5 * even**2 - 0.5], axis=1)
    spectrum *= math.log10(effect.tau_s[-1] / effect.tau_s[0]) / (count - 1)
    gains = np.asarray(own).reshape(len(CREEP_SHARES), 3) @ spectrum.T
    return {
        "threshold": tuple(effect.range_u * share for share in CREEP_SHARES),
        "tau": tuple(tau_s / step_s for tau_s in effect.tau_s),
        "gain": tuple(gains.ravel().tolist()),
    }


def _sensor_map(
    effect: Any, values: dict[str, float], own: tuple[float, ...], step_s: float
) -> Numbers:
    return {"low": effect.low_z, "range": effect.range_z, "cubic": own[:2], "ripples": own[2:]}


_LAWS: dict[type[Effect], tuple[str, Callable[..., Numbers]]] = {
    InputLag: ("input_lag", _lag),
    SlewLimit: ("slew_limit", _slew),
    InputQuantisation: ("input_quantisation", _rounding),
    RateDependence: ("rate_dependence", _widening),
    EddyCurrents: ("eddy_currents", _eddy),
    Moving: ("moving", _moving),
    Ageing: ("ageing", _ageing),
    Creep: ("creep", _creep),
    OutputLag: ("output_lag", _lag),
    Delay: ("delay", _delay),
    Resonance: ("resonance", _resonance),
    Drift: ("drift", _drift),
    Hum: ("hum", _hum),
    Auxiliary: ("auxiliary", _auxiliary),
    Reptation: ("reptation", _reptation),
    OperatorCreep: ("operator_creep", _operator_creep),
    OutputNonlinearity: ("output_nonlinearity", _sensor_map),
    OutputQuantisation: ("output_quantisation", _rounding),
}
"""The law of each effect of the library, and what gives its coefficients."""

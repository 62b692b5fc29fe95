"""The law of each effect in discrete time: its coefficients for one sample interval."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from preisach_jax.effects.ageing import Ageing
from preisach_jax.effects.auxiliary import Auxiliary
from preisach_jax.effects.base import Effect
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

MOST_DELAYED = 1_000_000
"""Samples beyond which a delay is refused: they would all have to be kept."""

Numbers = dict[str, float | int | bool | tuple[float, ...]]


def _low_pass(tau_s: float, step_s: float) -> tuple[float, float]:
    """Decay of a first-order low-pass in a step, and its part of the signal's move."""
    return math.exp(-step_s / tau_s), -math.expm1(-step_s / tau_s) * tau_s / step_s


def _lag(effect: Any, values: dict[str, float], own: tuple[float, ...], step_s: float) -> Numbers:
    decay, share = _low_pass(values["tau_s"], step_s)
    if effect.of_samples:  # a move acts at once, as if the signal had jumped after the last sample
        return {"decay": decay, "share": decay, "lead": decay / (1 - decay), "arc": 0.0}
    return {"decay": decay, "share": share, "lead": values["tau_s"] / step_s, "arc": 1 / 12}


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
    if effect.modes > 1:
        raise InputError(
            f"the resonance has {effect.modes} modes, and the C code has one: fit the record with "
            "one mode, effects=('resonance',), or leave it out with --without resonance"
        )
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


LAWS: dict[type[Effect], tuple[str, Callable[..., Numbers]]] = {
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

"""Sizes of effects as they occur, drawn from a seed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from preisach_jax.errors import InputError, require_list
from preisach_jax.plant.stage import RANGE_V

CREEP_DECADES = (-2.0, 1.0)  # of the time constants in s


@dataclass(frozen=True)
class Measurement:
    """What sizes of effects go by."""

    duration_s: float
    stroke_um: float
    fastest: float


SHORT = {"aux": "aux:load_N", "gain": "gain:temp_C", "cross": "cross:y_V"}
"""Short names of the effects of a column."""

OF_THE_PLAYS = ("rate_dependence", "log_rate", "moving")
"""Effects that act on the plays of the stage."""


def effect_names(effects: Sequence[str]) -> list[str]:
    """Full names of effects."""
    require_list("effects", effects)
    names = [SHORT.get(name, name) for name in effects]
    for name in names:
        if name not in EFFECTS:
            raise InputError(f"the stage has no effect {name!r}: choose from {', '.join(EFFECTS)}")
    if len(set(names)) < len(names):
        raise InputError(f"effects are {', '.join(names)}: name each only once")
    idle = [name for name in names if name in OF_THE_PLAYS]
    if "restoring_force" in names and idle:
        raise InputError(
            f"effects are {', '.join(names)}: the springs of restoring_force take the place of the "
            f"plays, on which {idle[0]} acts; leave one of the two out"
        )
    return names


def draw_effect(name: str, seed: int, measurement: Measurement) -> dict[str, Any]:
    """Parameters of an effect; each has its own stream, so that effects can be combined."""
    rng = np.random.default_rng([seed, 10 + EFFECTS.index(name)])
    swing = float(rng.uniform(0.010, 0.020) * measurement.stroke_um)
    return _DRAWS[name](rng, measurement, swing)


def _draw_creep(rng: np.random.Generator, measurement: Measurement, swing: float) -> dict[str, Any]:
    count = int(rng.integers(6, 10))
    first, last = CREEP_DECADES
    places = first + (last - first) * (np.arange(count) + rng.uniform(0.0, 1.0, count)) / count
    gain = float(rng.uniform(0.012, 0.030))
    parts = rng.uniform(0.7, 1.3, count)
    return {
        "gain_per_decade": gain,
        "tau_s": (10.0**places).tolist(),
        "gains": (gain * (last - first) * parts / parts.sum()).tolist(),
    }


def _draw_lag(rng: np.random.Generator, measurement: Measurement, swing: float) -> dict[str, Any]:
    return {"tau_s": float(rng.uniform(1e-3, 5e-3))}


def _draw_delay(rng: np.random.Generator, measurement: Measurement, swing: float) -> dict[str, Any]:
    return {"delay_s": float(rng.uniform(1e-3, 4e-3))}


def _draw_drift(rng: np.random.Generator, measurement: Measurement, swing: float) -> dict[str, Any]:
    sign = float(rng.choice([-1.0, 1.0]))
    tau = float(rng.uniform(0.2, 1.5) * measurement.duration_s)
    return {"amplitude_um": sign * swing, "tau_s": tau}


def _draw_ageing(
    rng: np.random.Generator, measurement: Measurement, swing: float
) -> dict[str, Any]:
    loss = float(rng.uniform(0.015, 0.04))
    return {"loss": loss, "tau_s": float(rng.uniform(0.3, 2.0) * measurement.duration_s)}


def _draw_load(rng: np.random.Generator, measurement: Measurement, swing: float) -> dict[str, Any]:
    return {"gain_um_per_N": swing / 10.0, "tau_s": 0.0}


def _draw_slew(rng: np.random.Generator, measurement: Measurement, swing: float) -> dict[str, Any]:
    return {"slew_V_per_s": float(rng.uniform(0.3, 0.8) * measurement.fastest)}


def _draw_rate(rng: np.random.Generator, measurement: Measurement, swing: float) -> dict[str, Any]:
    exponent = float(rng.uniform(0.5, 1.2))
    shift = float(rng.uniform(0.005, 0.03) * RANGE_V)  # at the greatest rate
    return {"coefficient": shift / (measurement.fastest or 1.0) ** exponent, "exponent": exponent}


def _draw_resonance(
    rng: np.random.Generator, measurement: Measurement, swing: float
) -> dict[str, Any]:
    return {"f_hz": float(60.0 * 5.0 ** rng.uniform()), "zeta": float(0.02 * 10.0 ** rng.uniform())}


def _draw_hum(rng: np.random.Generator, measurement: Measurement, swing: float) -> dict[str, Any]:
    lines = int(rng.integers(2, 4))
    main = 0.02 * 10.0 ** rng.uniform()
    parts = np.concatenate([[1.0], rng.uniform(0.1, 0.5, lines - 1)])
    return {
        # A grid is held to its frequency within a few hundredths of a hertz.
        "f_hz": float(rng.choice([50.0, 60.0]) + rng.uniform(-0.03, 0.03)),
        "amplitude_um": (main * parts).tolist(),
        "phase_rad": rng.uniform(-np.pi, np.pi, lines).tolist(),
    }


def _draw_bend(rng: np.random.Generator, measurement: Measurement, swing: float) -> dict[str, Any]:
    size = float(rng.uniform(0.015, 0.03) * measurement.stroke_um)
    share = float(rng.uniform(0.2, 0.5))
    signs = rng.choice([-1.0, 1.0], 2)
    return {
        "coefficients_um": [float(signs[0]) * share * size, float(signs[1] * (1 - share)) * size]
    }


def _draw_moving(
    rng: np.random.Generator, measurement: Measurement, swing: float
) -> dict[str, Any]:
    # Weaker feedback is absorbed by the weights of a plain model, for loops stay nearly congruent.
    return {"a_V_per_um": float(rng.uniform(0.10, 0.30) * RANGE_V / measurement.stroke_um)}


def _draw_converter(
    rng: np.random.Generator, measurement: Measurement, swing: float
) -> dict[str, Any]:
    return {"step_V": RANGE_V / 2 ** int(rng.integers(10, 13))}


def _draw_grating(
    rng: np.random.Generator, measurement: Measurement, swing: float
) -> dict[str, Any]:
    return {"step_um": float(rng.uniform(0.05, 0.3))}


def _draw_viscosity(
    rng: np.random.Generator, measurement: Measurement, swing: float
) -> dict[str, Any]:
    """A viscous part, and in half of all cases one that saturates well below the greatest rate."""
    fastest = measurement.fastest or 1.0
    saturates = bool(rng.uniform() < 0.5)
    return {
        "viscous_um_s_per_V": float(rng.uniform(1.0, 2.0)) * swing / fastest,
        "saturating_um": saturates * float(rng.uniform(1.0, 2.0)) * swing,
        "speed_V_per_s": float(rng.uniform(0.02, 0.1)) * fastest,
        "tau_s": float(rng.uniform(1e-3, 4e-3)),
    }


def _draw_gain(rng: np.random.Generator, measurement: Measurement, swing: float) -> dict[str, Any]:
    """Change of the whole loop by a degree."""
    return {"gain_per_C": float(rng.choice([-1.0, 1.0]) * rng.uniform(0.003, 0.008))}


def _draw_cross(rng: np.random.Generator, measurement: Measurement, swing: float) -> dict[str, Any]:
    """Leak of another axis of 10 V through a mode that its drive reaches."""
    return {
        "gain_um_per_V": float(rng.choice([-1.0, 1.0])) * swing / 20.0,
        "f_hz": float(rng.uniform(25.0, 70.0)),
        "zeta": float(rng.uniform(0.03, 0.15)),
    }


def _draw_leakage(
    rng: np.random.Generator, measurement: Measurement, swing: float
) -> dict[str, Any]:
    """Time constant of a charge amplifier, of the order of the record."""
    return {"tau_s": float(measurement.duration_s * 10.0 ** rng.uniform(-0.5, 0.5))}


def _draw_log_rate(
    rng: np.random.Generator, measurement: Measurement, swing: float
) -> dict[str, Any]:
    """Widening by a decade of the rate, V, and the rate below which there is none, V/s."""
    return {
        "coefficient_V": float(rng.uniform(0.004, 0.012) * RANGE_V),
        "slow_V_per_s": float((measurement.fastest or 1.0) * 10.0 ** rng.uniform(-4.0, -3.0)),
    }


def _draw_body(rng: np.random.Generator, measurement: Measurement, swing: float) -> dict[str, Any]:
    """A body on two springs, one of which yields, of the stage's stroke over its range."""
    return {
        "f_hz": float(rng.uniform(4.0, 8.0)),
        "zeta": float(0.01 * 3.0 ** rng.uniform()),
        "share": float(rng.uniform(0.3, 0.6)),
        "stiffness_V_per_um": RANGE_V / measurement.stroke_um,
        "beta": float(rng.uniform(0.3, 0.7)),
        "gamma": float(rng.uniform(-0.2, 0.2)),
        "yield_um": float(rng.uniform(0.15, 0.3) * measurement.stroke_um),
    }


def _draw_excess(
    rng: np.random.Generator, measurement: Measurement, swing: float
) -> dict[str, Any]:
    """A part that goes with the root of the rate, µm/(V/s)^(1/2)."""
    return {
        "coefficient": float(rng.uniform(1.0, 2.0)) * swing / (measurement.fastest or 1.0) ** 0.5
    }


# New effects go to the end: the place is part of the seed.
_DRAWS: dict[str, Callable[[np.random.Generator, Measurement, float], dict[str, Any]]] = {
    "creep": _draw_creep,
    "input_lag": _draw_lag,
    "delay": _draw_delay,
    "drift": _draw_drift,
    "ageing": _draw_ageing,
    "aux:load_N": _draw_load,
    "output_lag": _draw_lag,
    "slew_limit": _draw_slew,
    "rate_dependence": _draw_rate,
    "resonance": _draw_resonance,
    "hum": _draw_hum,
    "output_nonlinearity": _draw_bend,
    "moving": _draw_moving,
    "input_quantisation": _draw_converter,
    "output_quantisation": _draw_grating,
    "viscosity": _draw_viscosity,
    "gain:temp_C": _draw_gain,
    "cross:y_V": _draw_cross,
    "leakage": _draw_leakage,
    "log_rate": _draw_log_rate,
    "restoring_force": _draw_body,
    "excess_loss": _draw_excess,
}

EFFECTS = tuple(_DRAWS)

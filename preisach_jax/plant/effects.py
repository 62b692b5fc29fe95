"""What else a stage does: the physics of each effect, and sizes as they occur, drawn from a seed.

u is the drive, h the output of the hysteresis, y what it has become up to there, z the reading.

| effect | what it does | parameters of the truth |
|---|---|---|
| `input_quantisation` | u' = step ⌊u/step + 1/2⌋ at every inner instant | `step_V` |
| `slew_limit` | u' follows u at no more than slew | `slew_V_per_s` |
| `input_lag` | tau du'/dt = u - u' | `tau_s` |
| `rate_dependence` | slacks grow by coefficient (rate of u)^exponent | `coefficient`, `exponent` |
| `moving` | u + a h drives the hysteresis | `a_V_per_um` |
| `ageing` | h (1 - loss s(t)), s from 0 to 1 with tau | `loss`, `tau_s` |
| `creep` | y + Σ_i gain_i lag_i(y) | `gain_per_decade`, `gains`, `tau_s` |
| `resonance` | y'' + 2 zeta ω y' + ω² y = ω² h, ω = 2π f | `f_hz`, `zeta` |
| `output_lag` | tau dy/dt = h - y | `tau_s` |
| `delay` | y(t - delay) | `delay_s` |
| `drift` | + amplitude s(t), s as for ageing | `amplitude_um`, `tau_s` |
| `hum` | + Σ_n amplitude_n sin(2π n f t + phase_n) | `f_hz`, `amplitude_um`, `phase_rad` |
| `aux:load_N` | + gain (load - load at the beginning) | `gain_um_per_N`, `tau_s` (0) |
| `output_nonlinearity` | y bent between the ends of the stroke, see `bend` | `coefficients_um` |
| `output_quantisation` | z = step ⌊y/step + 1/2⌋, after the noise | `step_um` |

Those of `machines` come with `rate_dependence`, `ageing`, and `drift`; a leakage is the last.

This is also their order. The unit of `coefficient` is V/(V/s)^exponent.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from preisach_jax.errors import InputError
from preisach_jax.plant import machines
from preisach_jax.plant.stage import RANGE_V, Stage

Hidden = Mapping[str, Mapping[str, Any]]  # parameters of each hidden effect by its name

CREEP_DECADES = (-2.0, 1.0)  # of the time constants in s


@dataclass(frozen=True)
class Measurement:
    """What sizes of effects go by.

    Args:
        duration_s: of the record, s.
        stroke_um: stroke over the whole range, µm, without feedback.
        fastest: greatest rate of the drive, V/s.
    """

    duration_s: float
    stroke_um: float
    fastest: float


def effect_names(effects: Sequence[str]) -> list[str]:
    """Full names of effects.

    Args:
        effects: names out of `EFFECTS`; "aux", "gain", "cross" are short for those of a column.

    Returns:
        The names.

    Raises:
        InputError: one is unknown or named twice.

    Example:
        >>> effect_names(("creep", "aux"))
        ['creep', 'aux:load_N']
    """
    if isinstance(effects, str):
        raise InputError(f"effects is {effects!r}: give a list of names, as in ({effects!r},)")
    names = [machines.SHORT.get(name, name) for name in effects]
    for name in names:
        if name not in EFFECTS:
            raise InputError(f"the stage has no effect {name!r}: choose from {', '.join(EFFECTS)}")
    if len(set(names)) < len(names):
        raise InputError(f"effects are {', '.join(names)}: name each only once")
    return names


def draw_effect(name: str, seed: int, measurement: Measurement) -> dict[str, Any]:
    """Parameters of an effect; each has its own stream, so that effects can be combined.

    Args:
        name: out of `EFFECTS`.
        seed: whole number, at least 0.
        measurement: what its size goes by.

    Returns:
        The parameters, ready for JSON.

    Example:
        >>> draw_effect("output_lag", 1, Measurement(24.0, 60.0, 3000.0)).keys()
        dict_keys(['tau_s'])
    """
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
    return {
        "f_hz": float(60.0 * 5.0 ** rng.uniform()),
        "zeta": float(0.02 * 10.0 ** rng.uniform()),
    }


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
    "viscosity": lambda rng, made, swing: machines.draw_viscosity(rng, made.fastest, swing),
    "gain:temp_C": lambda rng, made, swing: machines.draw_gain(rng),
    "cross:y_V": lambda rng, made, swing: machines.draw_cross(rng, swing),
    "leakage": lambda rng, made, swing: machines.draw_leakage(rng, made.duration_s),
    "log_rate": lambda rng, made, swing: machines.draw_log_rate(rng, made.fastest),
}
EFFECTS = tuple(_DRAWS)


def move(stage: Stage, hidden: Hidden, command: np.ndarray, step_s: float) -> np.ndarray:
    """What the hysteresis makes of a command, with all that acts on the drive and on the plays.

    The rate that widens the slacks is du/dt on the way to each instant, of the drive as it arrives
    behind the amplifier but without the steps of the converter, which are quick and small.

    Args:
        stage: the hysteresis.
        hidden: parameters of the hidden effects.
        command: (time,) V, at inner instants.
        step_s: inner time step, s.

    Returns:
        (time,) position, µm.
    """
    drive = _amplify(hidden, command, step_s)
    rate = np.abs(np.diff(drive, prepend=drive[0])) / step_s
    widening = machines.log_slack(hidden, rate)  # thermal activation
    if "rate_dependence" in hidden:  # domain walls need a greater field to move faster
        loss = hidden["rate_dependence"]
        widening = widening + loss["coefficient"] * rate ** loss["exponent"]
    if "input_quantisation" in hidden:
        rounded = round_to(command, hidden["input_quantisation"]["step_V"])
        drive = _amplify(hidden, rounded, step_s)
    if "moving" in hidden:  # strain of its neighbours helps a domain to switch
        return stage.moving_hysteresis(drive, hidden["moving"]["a_V_per_um"], widening)
    return stage.hysteresis(drive, widening)


def _amplify(hidden: Hidden, drive: np.ndarray, step_s: float) -> np.ndarray:
    if "slew_limit" in hidden:  # the amplifier's current charges the piezo's capacitance
        drive = limit_rate(drive, hidden["slew_limit"]["slew_V_per_s"], step_s)
    if "input_lag" in hidden:  # and so it does through its resistance
        drive = np.clip(low_pass(drive, hidden["input_lag"]["tau_s"], step_s), 0.0, RANGE_V)
    return drive


def respond(hidden: Hidden, h: np.ndarray, time: np.ndarray, step_s: float) -> np.ndarray:
    """Position of the mechanics, late by the electronics behind its sensor.

    Args:
        hidden: parameters of the hidden effects.
        h: (time,) output of the hysteresis, µm, at inner instants.
        time: (time,) s.
        step_s: inner time step, s.

    Returns:
        (time,) position, µm.
    """
    z = h
    if "ageing" in hidden:  # domains lose their poling: all strain shrinks
        z = z * (1.0 - hidden["ageing"]["loss"] * _settling(time, hidden["ageing"]["tau_s"]))
    if "creep" in hidden:  # domains that follow late: Kelvin-Voigt elements in series
        creep = hidden["creep"]
        pairs = zip(creep["gains"], creep["tau_s"], strict=True)
        z = z + np.sum([gain * low_pass(z, tau, step_s) for gain, tau in pairs], axis=0)
    if "resonance" in hidden:  # the platform's mass on its flexures
        z = resonate(z, hidden["resonance"]["f_hz"], hidden["resonance"]["zeta"], step_s)
    if "output_lag" in hidden:  # the filter of the sensor
        z = low_pass(z, hidden["output_lag"]["tau_s"], step_s)
    if "delay" in hidden:  # its digital link
        delay_s: float = hidden["delay"]["delay_s"]
        z = np.interp(time - delay_s, time, z)
    return z


def add_disturbances(
    hidden: Hidden, z: np.ndarray, time: np.ndarray, seed: int
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Position with what comes without the drive, and the column of the load.

    Args:
        hidden: parameters of the hidden effects.
        z: (time,) position, µm, at inner instants.
        time: (time,) s.
        seed: draws the course of the load.

    Returns:
        (time,) position, µm, and the load by its name, if there is one.
    """
    if "drift" in hidden:  # the frame warms up
        drift = hidden["drift"]
        z = z + drift["amplitude_um"] * _settling(time, drift["tau_s"])
    if "hum" in hidden:  # the mains in the sensor's cable
        hum = hidden["hum"]
        lines = enumerate(zip(hum["amplitude_um"], hum["phase_rad"], strict=True), start=1)
        angle = 2.0 * np.pi * hum["f_hz"] * time
        z = z + np.sum([size * np.sin(n * angle + phase) for n, (size, phase) in lines], axis=0)
    if "aux:load_N" not in hidden:
        return z, {}
    load = _load(time, np.random.default_rng([seed, 3]))
    return z + hidden["aux:load_N"]["gain_um_per_N"] * (load - load[0]), {"load_N": load}


def low_pass(x: np.ndarray, tau_s: float, step_s: float) -> np.ndarray:
    """First-order lag by the trapezoidal rule, settled at the first value.

    τ y' = x - y, (τ/T + 1/2) y(k) = (τ/T - 1/2) y(k-1) + (x(k) + x(k-1))/2.

    Args:
        x: (time,) signal.
        tau_s: time constant τ, s.
        step_s: time step T, s.

    Returns:
        (time,) lagged signal.

    Example:
        >>> low_pass(np.array([0.0, 1.0, 1.0]), tau_s=0.5, step_s=1.0).tolist()
        [0.0, 0.5, 1.0]
    """
    ratio = tau_s / step_s
    return scipy.signal.lfilter(
        [0.5 / (ratio + 0.5)] * 2,
        [1.0, -(ratio - 0.5) / (ratio + 0.5)],
        x,
        zi=x[:1] * (1.0 - 0.5 / (ratio + 0.5)),
    )[0]


def resonate(x: np.ndarray, f_hz: float, zeta: float, step_s: float) -> np.ndarray:
    """Second-order mode of unit gain at rest, exact for a straight course, settled at first.

    y'' + 2 ζ ω y' + ω² y = ω² x, ω = 2π f.

    Args:
        x: (time,) signal.
        f_hz: natural frequency f without damping, Hz.
        zeta: damping ratio ζ.
        step_s: time step, s.

    Returns:
        (time,) signal behind the mode.

    Example:
        >>> resonate(np.array([2.0, 2.0, 2.0]), f_hz=100.0, zeta=0.1, step_s=1e-3).tolist()
        [2.0, 2.0, 2.0]
    """
    omega = 2.0 * math.pi * f_hz
    mode = ([omega**2], [1.0, 2.0 * zeta * omega, omega**2])
    discrete: Any = scipy.signal.cont2discrete(mode, step_s, method="foh")
    return x[0] + scipy.signal.lfilter(discrete[0].ravel(), discrete[1], x - x[0])


def limit_rate(x: np.ndarray, slew: float, step_s: float) -> np.ndarray:
    """Follow a signal at no more than a given rate, from its first value.

    y(k) = y(k-1) + max(-s T, min(s T, x(k) - y(k-1))).

    Args:
        x: (time,) signal.
        slew: greatest rate s, in the unit of the signal per s.
        step_s: time step T, s.

    Returns:
        (time,) limited signal.

    Example:
        >>> limit_rate(np.array([0.0, 3.0, 3.0, 1.5]), slew=2.0, step_s=1.0).tolist()
        [0.0, 2.0, 3.0, 1.5]
    """
    reach, y = slew * step_s, float(x[0])
    limited: list[float] = []
    for value in x.tolist():
        y = min(max(value, y - reach), y + reach)
        limited.append(y)
    return np.array(limited)


def round_to(x: np.ndarray, step: float) -> np.ndarray:
    """Nearest multiple of a step, halves upward.

    Args:
        x: signal of any shape.
        step: of the converter, in the unit of the signal.

    Returns:
        The rounded signal, of the same shape.

    Example:
        >>> round_to(np.array([0.2, 0.25, -0.2]), step=0.5).tolist()
        [0.0, 0.5, 0.0]
    """
    return step * np.floor(x / step + 0.5) + 0.0  # no negative zero


def bend(z: np.ndarray, coefficients_um: Sequence[float], stroke_um: float) -> np.ndarray:
    """Reading of a sensor that is right at both ends of the stroke and bends between them.

    z + a₂ (1 - s²) + a₃ (3√3/2) (s - s³) with s = 2 z / stroke - 1, so that a₂ and a₃ are the
    greatest deviations within the stroke.

    Args:
        z: position, µm, of any shape.
        coefficients_um: a₂ and a₃, µm.
        stroke_um: stroke, µm.

    Returns:
        Reading, µm, of the same shape.

    Example:
        >>> bend(np.array([0.0, 5.0, 10.0]), (0.1, 0.2), stroke_um=10.0).tolist()
        [0.0, 5.1, 10.0]
    """
    s = 2.0 * z / stroke_um - 1.0
    a2, a3 = coefficients_um
    return z + a2 * (1.0 - s**2) + a3 * 1.5 * math.sqrt(3.0) * (s - s**3)


def _settling(time: np.ndarray, tau: float) -> np.ndarray:
    """From 0 at the beginning to 1 at the end, exponentially."""
    return np.expm1(-time / tau) / np.expm1(-time[-1] / tau)


def _load(time: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A weight of 20 N whose lever moves slowly at random by about 10 N, with two handlings."""
    duration = time[-1]
    swing = np.zeros_like(time)
    for _ in range(4):
        f, phase = rng.uniform(0.8, 7.0) / duration, rng.uniform(0.0, 2.0 * np.pi)
        swing += rng.normal() * np.cos(2.0 * np.pi * f * time + phase)
    swing /= max(float(np.max(np.abs(swing))), 1e-9)
    for place in rng.uniform(0.15, 0.85, 2):
        sign = float(rng.choice([-1.0, 1.0]))
        swing += 0.3 * sign * np.tanh((time - place * duration) / (0.004 * duration))
    return 20.0 + 10.0 * swing

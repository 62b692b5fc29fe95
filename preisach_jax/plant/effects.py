"""What else a stage does: the physics of each effect.

u is the drive, h the output of the hysteresis, y what it has become up to there, z the reading.

| effect | what it does | parameters of the truth |
|---|---|---|
| `input_quantisation` | u' = step ⌊u/step + 1/2⌋ at every inner instant | `step_V` |
| `slew_limit` | u' follows u at no more than slew | `slew_V_per_s` |
| `input_lag` | tau du'/dt = u - u' | `tau_s` |
| `rate_dependence` | slacks grow by coefficient (rate of u)^exponent | `coefficient`, `exponent` |
| `log_rate` | slacks grow by c log10(1 + rate of u / slow) | `coefficient_V`, `slow_V_per_s` |
| `restoring_force` | a body on a spring that yields, in place of the plays | see `swung` |
| `moving` | u + a h drives the hysteresis | `a_V_per_um` |
| `gain:temp_C` | h (1 + gain (temp - 20 °C)) | `gain_per_C` |
| `ageing` | h (1 - loss s(t)), s from 0 to 1 with tau | `loss`, `tau_s` |
| `creep` | y + Σ_i gain_i lag_i(y) | `gain_per_decade`, `gains`, `tau_s` |
| `resonance` | y'' + 2 zeta ω y' + ω² y = ω² h, ω = 2π f | `f_hz`, `zeta` |
| `output_lag` | tau dy/dt = h - y | `tau_s` |
| `delay` | y(t - delay) | `delay_s` |
| `viscosity` | + a w + b tanh(w / speed), tau dw/dt = du/dt - w | see `with_forces` |
| `excess_loss` | + coefficient sgn(du/dt) |du/dt|^(1/2) | `coefficient` |
| `cross:y_V` | + gain (y behind a mode) | `gain_um_per_V`, `f_hz`, `zeta` |
| `drift` | + amplitude s(t), s as for ageing | `amplitude_um`, `tau_s` |
| `hum` | + Σ_n amplitude_n sin(2π n f t + phase_n) | `f_hz`, `amplitude_um`, `phase_rad` |
| `aux:load_N` | + gain (load - load at the beginning) | `gain_um_per_N`, `tau_s` (0) |
| `leakage` | dz/dt = dy/dt - z/tau | `tau_s` |
| `output_nonlinearity` | y bent between the ends of the stroke, see `bend` | `coefficients_um` |
| `output_quantisation` | z = step ⌊y/step + 1/2⌋, after the noise | `step_um` |

This is also their order. The unit of `coefficient` is V/(V/s)^exponent.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import scipy

from preisach_jax.plant.stage import RANGE_V, Stage

Hidden = Mapping[str, Mapping[str, Any]]  # parameters of each hidden effect by its name


def move(stage: Stage, hidden: Hidden, command: np.ndarray, step_s: float) -> np.ndarray:
    """What the hysteresis makes of a command, with all that acts on the drive and on the plays.

    The rate that widens the slacks is du/dt on the way to each instant, of the drive as it arrives
    behind the amplifier but without the steps of the converter, which are quick and small.
    """
    drive = _amplify(hidden, command, step_s)
    rate = np.abs(np.diff(drive, prepend=drive[0])) / step_s
    widening: np.ndarray | float = 0.0
    if "log_rate" in hidden:  # thermal activation
        law = hidden["log_rate"]
        widening = law["coefficient_V"] * np.log10(1.0 + rate / law["slow_V_per_s"])
    if "rate_dependence" in hidden:  # domain walls need a greater field to move faster
        loss = hidden["rate_dependence"]
        widening = widening + loss["coefficient"] * rate ** loss["exponent"]
    if "input_quantisation" in hidden:
        rounded = round_to(command, hidden["input_quantisation"]["step_V"])
        drive = _amplify(hidden, rounded, step_s)
    if "restoring_force" in hidden:  # the hysteresis is that of the springs, not of the material
        return swung(hidden["restoring_force"], drive, step_s)
    if "moving" in hidden:  # strain of its neighbours helps a domain to switch
        return stage.moving_hysteresis(drive, hidden["moving"]["a_V_per_um"], widening)
    return stage.hysteresis(drive, widening)


def _amplify(hidden: Hidden, drive: np.ndarray, step_s: float) -> np.ndarray:
    if "slew_limit" in hidden:  # the amplifier's current charges the piezo's capacitance
        drive = limit_rate(drive, hidden["slew_limit"]["slew_V_per_s"], step_s)
    if "input_lag" in hidden:  # and so it does through its resistance
        drive = np.clip(low_pass(drive, hidden["input_lag"]["tau_s"], step_s), 0.0, RANGE_V)
    return drive


def respond(
    hidden: Hidden, h: np.ndarray, time: np.ndarray, made: Mapping[str, np.ndarray], step_s: float
) -> np.ndarray:
    """Position of the mechanics, late by the electronics behind its sensor."""
    z = h
    if "gain:temp_C" in hidden:  # piezoelectric strain goes with the temperature
        z = z * (1.0 + hidden["gain:temp_C"]["gain_per_C"] * (made["temp_C"] - 20.0))
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


def with_forces(
    hidden: Hidden, z: np.ndarray, drive: np.ndarray, made: Mapping[str, np.ndarray], step_s: float
) -> np.ndarray:
    """Position, µm, with what goes with the speed of the drive and what leaks from another axis."""
    if "viscosity" in hidden:
        law = hidden["viscosity"]
        # The semi-implicit rule: half of the lag's pull at either end of a step.
        ratio = law["tau_s"] / step_s
        rate = np.diff(drive, prepend=drive[0]) / step_s
        filtered = scipy.signal.lfilter([1.0], [ratio + 0.5, 0.5 - ratio], rate)
        speed = np.asarray(filtered)
        z = z + law["viscous_um_s_per_V"] * speed
        z = z + law["saturating_um"] * np.tanh(speed / law["speed_V_per_s"])
    if "excess_loss" in hidden:
        rate = np.diff(drive, prepend=drive[0]) / step_s
        z = z + hidden["excess_loss"]["coefficient"] * np.sign(rate) * np.sqrt(np.abs(rate))
    if "cross:y_V" in hidden:
        law = hidden["cross:y_V"]
        axis = made["y_V"] - made["y_V"][0]
        z = z + law["gain_um_per_V"] * resonate(axis, law["f_hz"], law["zeta"], step_s)
    return z


def add_disturbances(
    hidden: Hidden, z: np.ndarray, time: np.ndarray, seed: int
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Position with what comes without the drive, and the column of the load."""
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


def leaked(hidden: Hidden, z: np.ndarray, step_s: float) -> np.ndarray:
    """Reading, µm, of a charge amplifier that begins at rest: z' = y' - z/tau, trapezoidal."""
    if "leakage" not in hidden:
        return z
    half = 0.5 * step_s / hidden["leakage"]["tau_s"]
    gone = scipy.signal.lfilter([1.0, -1.0], [1.0 + half, half - 1.0], z - z[0])
    return z[0] + np.asarray(gone)


def columns(hidden: Hidden, time: np.ndarray, seed: int) -> dict[str, np.ndarray]:
    """Courses of a temperature about 20 °C and of another axis, as far as they are asked for."""
    made: dict[str, np.ndarray] = {}
    if "gain:temp_C" in hidden:
        course = _sines(np.random.default_rng([seed, 4]), time, 1.0 / time[-1], 8.0 / time[-1])
        made["temp_C"] = 20.0 + 5.0 * course
    if "cross:y_V" in hidden:
        made["y_V"] = 10.0 * _sines(np.random.default_rng([seed, 5]), time, 0.5, 50.0)
    return made


def _sines(rng: np.random.Generator, time: np.ndarray, low_hz: float, high_hz: float) -> np.ndarray:
    """Eight sines of random frequency and phase, of greatest size one."""
    total = np.zeros_like(time)
    for share in (np.arange(8) + rng.uniform(0.0, 1.0, 8)) / 8:
        frequency = low_hz * (high_hz / low_hz) ** share
        total += np.sin(2.0 * np.pi * (frequency * time + rng.uniform()))
    return total / max(float(np.max(np.abs(total))), 1e-9)


def swung(law: Mapping[str, float], force: np.ndarray, step_s: float) -> np.ndarray:
    """Position of a body on a spring that yields (Bouc-Wen), from rest under the first force.

    z'' = w² (u / K - (1 - share) z - share h) - 2 zeta w z', w = 2π f,
    h' = z' - |h / yield| (beta |z'| sgn h + gamma z'), by Runge-Kutta steps of fourth order.
    """
    w, damping = 2.0 * np.pi * law["f_hz"], 2.0 * law["zeta"]
    share, beta, gamma, yields = law["share"], law["beta"], law["gamma"], law["yield_um"]

    def slope(z: float, v: float, h: float, pull: float) -> tuple[float, float, float]:
        rest = w * w * (pull - (1.0 - share) * z - share * h) - damping * w * v
        bent = beta * abs(v) * (1.0 if h > 0 else -1.0) + gamma * v
        return v, rest, v - abs(h) / yields * bent

    pulls = ((force - force[0]) / law["stiffness_V_per_um"]).tolist()
    z = v = h = 0.0
    path = [0.0]
    for first, last in itertools.pairwise(pulls):
        middle, half = 0.5 * (first + last), 0.5 * step_s
        a = slope(z, v, h, first)
        b = slope(z + half * a[0], v + half * a[1], h + half * a[2], middle)
        c = slope(z + half * b[0], v + half * b[1], h + half * b[2], middle)
        d = slope(z + step_s * c[0], v + step_s * c[1], h + step_s * c[2], last)
        sixth = step_s / 6.0
        z += sixth * (a[0] + 2 * b[0] + 2 * c[0] + d[0])
        v += sixth * (a[1] + 2 * b[1] + 2 * c[1] + d[1])
        h += sixth * (a[2] + 2 * b[2] + 2 * c[2] + d[2])
        path.append(z)
    return np.array(path)


def low_pass(x: np.ndarray, tau_s: float, step_s: float) -> np.ndarray:
    """First-order lag by the trapezoidal rule, settled at the first value.

    τ y' = x - y, (τ/T + 1/2) y(k) = (τ/T - 1/2) y(k-1) + (x(k) + x(k-1))/2.
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
    """
    omega = 2.0 * math.pi * f_hz
    mode = ([omega**2], [1.0, 2.0 * zeta * omega, omega**2])
    discrete: Any = scipy.signal.cont2discrete(mode, step_s, method="foh")
    return x[0] + scipy.signal.lfilter(discrete[0].ravel(), discrete[1], x - x[0])


def limit_rate(x: np.ndarray, slew: float, step_s: float) -> np.ndarray:
    """Follow a signal at no more than a given rate, from its first value.

    y(k) = y(k-1) + max(-s T, min(s T, x(k) - y(k-1))).
    """
    reach, y = slew * step_s, float(x[0])
    limited: list[float] = []
    for value in x.tolist():
        y = min(max(value, y - reach), y + reach)
        limited.append(y)
    return np.array(limited)


def round_to(x: np.ndarray, step: float) -> np.ndarray:
    """Nearest multiple of a step, halves upward."""
    return step * np.floor(x / step + 0.5) + 0.0  # no negative zero


def bend(z: np.ndarray, coefficients_um: Sequence[float], stroke_um: float) -> np.ndarray:
    """Reading of a sensor that is right at both ends of the stroke and bends between them.

    z + a₂ (1 - s²) + a₃ (3√3/2) (s - s³) with s = 2 z / stroke - 1, so that a₂ and a₃ are the
    greatest deviations within the stroke.
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

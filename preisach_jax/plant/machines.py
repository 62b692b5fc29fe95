"""What machines other than a bare stage do: velocity, scaled loops, leakage, and other axes.

| effect | what it does | parameters of the truth |
|---|---|---|
| `log_rate` | slacks grow by c log10(1 + rate of u / slow) | `coefficient_V`, `slow_V_per_s` |
| `gain:temp_C` | h (1 + gain (temp - 20 °C)) | `gain_per_C` |
| `viscosity` | + a w + b tanh(w / speed), tau dw/dt = du/dt - w | see `draw_viscosity` |
| `excess_loss` | + coefficient sgn(du/dt) |du/dt|^(1/2) | `coefficient` |
| `cross:y_V` | + gain (y behind a mode) | `gain_um_per_V`, `f_hz`, `zeta` |
| `leakage` | dz/dt = dy/dt - z/tau | `tau_s` |
| `restoring_force` | a body on a spring that yields, in place of the plays | see `draw_body` |
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any

import numpy as np
import scipy

from preisach_jax.plant.stage import RANGE_V

SHORT = {"aux": "aux:load_N", "gain": "gain:temp_C", "cross": "cross:y_V"}
"""Short names of the effects of a column."""

Hidden = Mapping[str, Mapping[str, Any]]


def draw_log_rate(rng: np.random.Generator, fastest: float) -> dict[str, float]:
    """Widening by a decade of the rate, V, and the rate below which there is none, V/s."""
    return {
        "coefficient_V": float(rng.uniform(0.004, 0.012) * RANGE_V),
        "slow_V_per_s": float((fastest or 1.0) * 10.0 ** rng.uniform(-4.0, -3.0)),
    }


def draw_gain(rng: np.random.Generator) -> dict[str, float]:
    """Change of the whole loop by a degree."""
    return {"gain_per_C": float(rng.choice([-1.0, 1.0]) * rng.uniform(0.003, 0.008))}


def draw_viscosity(rng: np.random.Generator, fastest: float, swing: float) -> dict[str, float]:
    """A viscous part, and in half of all cases one that saturates well below the greatest rate."""
    fastest = fastest or 1.0
    saturates = bool(rng.uniform() < 0.5)
    return {
        "viscous_um_s_per_V": float(rng.uniform(1.0, 2.0)) * swing / fastest,
        "saturating_um": saturates * float(rng.uniform(1.0, 2.0)) * swing,
        "speed_V_per_s": float(rng.uniform(0.02, 0.1)) * fastest,
        "tau_s": float(rng.uniform(1e-3, 4e-3)),
    }


def draw_excess(rng: np.random.Generator, fastest: float, swing: float) -> dict[str, float]:
    """A part that goes with the root of the rate, µm/(V/s)^(1/2)."""
    return {"coefficient": float(rng.uniform(1.0, 2.0)) * swing / (fastest or 1.0) ** 0.5}


def draw_cross(rng: np.random.Generator, swing: float) -> dict[str, float]:
    """Leak of another axis of 10 V through a mode that its drive reaches."""
    return {
        "gain_um_per_V": float(rng.choice([-1.0, 1.0])) * swing / 20.0,
        "f_hz": float(rng.uniform(25.0, 70.0)),
        "zeta": float(rng.uniform(0.03, 0.15)),
    }


def draw_leakage(rng: np.random.Generator, duration_s: float) -> dict[str, float]:
    """Time constant of a charge amplifier, of the order of the record."""
    return {"tau_s": float(duration_s * 10.0 ** rng.uniform(-0.5, 0.5))}


def draw_body(rng: np.random.Generator, stroke_um: float) -> dict[str, float]:
    """A body on two springs, one of which yields, of the stage's stroke over its range."""
    return {
        "f_hz": float(rng.uniform(4.0, 8.0)),
        "zeta": float(0.01 * 3.0 ** rng.uniform()),
        "share": float(rng.uniform(0.3, 0.6)),
        "stiffness_V_per_um": RANGE_V / stroke_um,
        "beta": float(rng.uniform(0.3, 0.7)),
        "gamma": float(rng.uniform(-0.2, 0.2)),
        "yield_um": float(rng.uniform(0.15, 0.3) * stroke_um),
    }


def columns(hidden: Hidden, time: np.ndarray, seed: int) -> dict[str, np.ndarray]:
    """Courses of a temperature about 20 °C and of another axis, as far as they are asked for.

    Arguments:
        time: (time,) s.

    Returns:
        (time,) columns by name.
    """
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


def log_slack(hidden: Hidden, rate: np.ndarray) -> np.ndarray | float:
    """By how much slacks grow at a rate, V/s, of the drive; V."""
    if "log_rate" not in hidden:
        return 0.0
    law = hidden["log_rate"]
    return law["coefficient_V"] * np.log10(1.0 + rate / law["slow_V_per_s"])


def swung(law: Mapping[str, float], force: np.ndarray, step_s: float) -> np.ndarray:
    """Position of a body on a spring that yields (Bouc-Wen), from rest under the first force.

    z'' = w² (u / K - (1 - share) z - share h) - 2 zeta w z', w = 2π f,
    h' = z' - |h / yield| (beta |z'| sgn h + gamma z'), by Runge-Kutta steps of fourth order.

    Arguments:
        force: (time,) V.

    Returns:
        (time,) position from rest, µm.
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


def warmed(hidden: Hidden, h: np.ndarray, made: Mapping[str, np.ndarray]) -> np.ndarray:
    """Output of the hysteresis, µm, scaled by the temperature."""
    if "gain:temp_C" not in hidden:
        return h
    return h * (1.0 + hidden["gain:temp_C"]["gain_per_C"] * (made["temp_C"] - 20.0))


def with_forces(
    hidden: Hidden, z: np.ndarray, drive: np.ndarray, made: Mapping[str, np.ndarray], step_s: float
) -> np.ndarray:
    """Position, µm, with what goes with the speed of the drive and what leaks from another axis.

    Arguments:
        z: (time,) position, µm.
        drive: (time,) V.
    """
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
        omega = 2.0 * np.pi * law["f_hz"]
        mode = ([omega**2], [1.0, 2.0 * law["zeta"] * omega, omega**2])
        (numerator, denominator, _) = scipy.signal.cont2discrete(mode, step_s, method="foh")
        axis = made["y_V"] - made["y_V"][0]
        through = scipy.signal.lfilter(np.ravel(numerator), denominator, axis)
        z = z + law["gain_um_per_V"] * np.asarray(through)
    return z


def leaked(hidden: Hidden, z: np.ndarray, step_s: float) -> np.ndarray:
    """Reading, µm, of a charge amplifier that begins at rest: z' = y' - z/tau, trapezoidal."""
    if "leakage" not in hidden:
        return z
    half = 0.5 * step_s / hidden["leakage"]["tau_s"]
    gone = scipy.signal.lfilter([1.0, -1.0], [1.0 + half, half - 1.0], z - z[0])
    return z[0] + np.asarray(gone)

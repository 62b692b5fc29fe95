"""What is hidden in machines: forces of velocity, gains, several modes, leakage, another axis.

Strengths and signals as in `hidden`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from blind import hidden
from blind.hidden import LOAD_N, Scene, Truth, either

AXIS_V = 40.0
"""Reach of the other axis to both sides of its middle."""


def _viscosity(rng, size, scene: Scene) -> Truth:
    form = str(rng.choice(["viscous", "dry"]))
    force = scene.stroke_um * rng.uniform(0.005, 0.015) * size  # um, at a fast rate
    lag = rng.uniform(2e-3, 1e-2)
    truth: Truth = {"form": form, "tau_s": lag if rng.uniform() < 0.5 else 0.0}
    if form == "viscous":
        return truth | {"viscous": force / scene.fast_v_s}
    return truth | {"saturating": force, "speed": scene.usual_v_s * rng.uniform(0.1, 0.5)}


def _gain(rng, size, scene: Scene) -> Truth:
    lag = rng.uniform(0.02, 0.5)
    return {
        "gain": rng.uniform(0.01, 0.03) * either(rng) * size / LOAD_N,
        "tau_s": lag if rng.uniform() < 0.5 else 0.0,
        "column_seed": int(rng.integers(2**31)),
    }


def _leakage(rng, size, scene: Scene) -> Truth:
    nominal = scene.seconds * rng.uniform(1.0, 5.0)
    return {"tau_s": nominal / size if size else np.inf}


def _log_rate(rng, size, scene: Scene) -> Truth:
    return {
        "coefficient": scene.span_v * rng.uniform(0.004, 0.012) * size,
        "slow_speed": scene.usual_v_s / 10 ** rng.uniform(1.0, 2.5),
    }


def _cross(rng, size, scene: Scene) -> Truth:
    return {
        "gain": scene.stroke_um * rng.uniform(0.005, 0.02) * either(rng) * size / AXIS_V,
        "f_hz": 10 ** rng.uniform(np.log10(15), np.log10(60)),
        "zeta": 10 ** rng.uniform(-1.5, -0.7),
        "column_seed": int(rng.integers(2**31)),
    }


def _modes(rng, size, scene: Scene) -> Truth:
    nominal = 10 ** rng.uniform(np.log10(30), np.log10(100))
    lower = nominal / np.sqrt(size) if size else np.inf
    return {
        "f_hz": lower,
        "zeta": 10 ** rng.uniform(-1.7, -0.9),
        "f_hz_2": lower * rng.uniform(1.8, 3.2),
        "zeta_2": 10 ** rng.uniform(-1.7, -0.9),
        "share_2": rng.uniform(0.2, 0.5),
    }


STRENGTHS: dict[str, Callable[..., Truth]] = {
    "viscosity": _viscosity,
    "gain": _gain,
    "leakage": _leakage,
    "log_rate": _log_rate,
    "cross": _cross,
    "modes": _modes,
}


# Signals -------------------------------------------------------------------------------------


def viscosity(rate: np.ndarray, truth: Truth, step_s: float) -> np.ndarray:
    """A force that goes with the rate, or saturates in it, behind a lag, in um."""
    late = hidden.lag(rate, truth["tau_s"], step_s)
    if truth["form"] == "viscous":
        return truth["viscous"] * late
    return truth["saturating"] * np.tanh(late / truth["speed"])


def gain(t: np.ndarray, seconds: float, truth: Truth, step_s: float) -> np.ndarray:
    """Factor on the loop by the load."""
    return 1 + truth["gain"] * hidden.late_force(t, seconds, truth, step_s)


def leakage(t: np.ndarray, z: np.ndarray, truth: Truth, step_s: float) -> np.ndarray:
    """The reading of an amplifier that was reset as the record began, and forgets since."""
    if not np.isfinite(truth["tau_s"]):
        return z
    begin = int(np.searchsorted(t, 0.0))
    forgotten = np.zeros_like(z)
    forgotten[begin:] = hidden.lag(z[begin:], truth["tau_s"], step_s) - z[begin]
    return z - forgotten


def log_widening(rate: np.ndarray, truth: Truth) -> np.ndarray:
    """By how much the thresholds lie further apart, in V."""
    return truth["coefficient"] * np.log10(1 + np.abs(rate) / truth["slow_speed"])


def axis(t: np.ndarray, seconds: float, seed: int) -> np.ndarray:
    """Drive of another axis: steps of 4 ms between levels, -1 to 1, at times of its own."""
    rng = np.random.default_rng(seed)
    at = np.sort(rng.uniform(0.02, 0.98, 40)) * seconds
    levels = rng.uniform(-1.0, 1.0, 41)
    return hidden.moved_between(levels, at, t, 2e-3)


def cross(t: np.ndarray, seconds: float, truth: Truth, step_s: float) -> np.ndarray:
    """What another axis adds through a mode between the axes, in um."""
    drive = AXIS_V * axis(t, seconds, truth["column_seed"])
    return truth["gain"] * hidden.resonance(drive, truth, step_s)


def modes(h: np.ndarray, truth: Truth, step_s: float) -> np.ndarray:
    """Two modes beside each other, of unit gain at rest together."""
    second = {"f_hz": truth["f_hz_2"], "zeta": truth["zeta_2"]}
    parts = [hidden.resonance(h, one, step_s) for one in (truth, second)]
    return (1 - truth["share_2"]) * parts[0] + truth["share_2"] * parts[1]

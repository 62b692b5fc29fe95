"""What no effect of the library is: jitter, one-way creep, a spring that stiffens, and the like.

Strengths and signals as in `hidden`, where the other kinds outside the library stand.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from blind import hidden
from blind.hidden import Scene, Truth

JUMPS, SHOCKS = 8, 25


def _jitter(rng, size, scene: Scene) -> Truth:
    nominal = rng.uniform(0.002, 0.008) * scene.span_v / scene.fast_v_s
    return {"rms_s": nominal * size, "walk_seed": int(rng.integers(2**31))}


def _wandering_hum(rng, size, scene: Scene) -> Truth:
    return {
        "f_hz": rng.uniform(20.0, 90.0),
        "wander": rng.uniform(0.03, 0.1) * min(size, 1.0),
        "amplitude_um": scene.stroke_um * rng.uniform(0.002, 0.008) * size,
        "walk_seed": int(rng.integers(2**31)),
    }


def _one_way_creep(rng, size, scene: Scene) -> Truth:
    return {"gain": rng.uniform(0.01, 0.03) * size, "tau_s": rng.uniform(0.1, 2.0), "back_s": 5e-3}


def _resets(rng, size, scene: Scene) -> Truth:
    jump = scene.stroke_um * rng.uniform(0.003, 0.01) * size
    return {"jump_um": jump, "walk_seed": int(rng.integers(2**31))}


def _shocks(rng, size, scene: Scene) -> Truth:
    return {
        "f_hz": rng.uniform(30.0, 150.0),
        "zeta": rng.uniform(0.02, 0.1),
        "amplitude_um": scene.stroke_um * rng.uniform(0.01, 0.03) * size,
        "walk_seed": int(rng.integers(2**31)),
    }


def _stiffening(rng, size, scene: Scene) -> Truth:
    nominal = 10 ** rng.uniform(np.log10(30), np.log10(80))
    return {
        "f_hz": nominal / np.sqrt(size) if size else np.inf,
        "zeta": 10 ** rng.uniform(-1.5, -0.7),
        "stiffening": rng.uniform(1.0, 3.0),  # of the spring, along the stroke
    }


STRENGTHS: dict[str, Callable[..., Truth]] = {
    "jitter": _jitter,
    "wandering_hum": _wandering_hum,
    "one_way_creep": _one_way_creep,
    "resets": _resets,
    "shocks": _shocks,
    "stiffening": _stiffening,
}


def jitter(t: np.ndarray, z: np.ndarray, rows: slice, truth: Truth) -> np.ndarray:
    """(row,) z as it is read at instants that scatter around those of the record."""
    at = t[rows]
    late = truth["rms_s"] * np.random.default_rng(truth["walk_seed"]).normal(size=len(at))
    return np.interp(at + late, t, z)


def wandering_hum(t: np.ndarray, seconds: float, truth: Truth) -> np.ndarray:
    """A line whose frequency wanders, such as that of a fan, in um."""
    wander = truth["wander"] * hidden.slow_walk(t, seconds, truth["walk_seed"])
    turns = np.cumsum(truth["f_hz"] * (1 + wander)) * (t[1] - t[0])
    return truth["amplitude_um"] * np.sin(2 * np.pi * turns)


def one_way_creep(h: np.ndarray, truth: Truth, step_s: float) -> np.ndarray:
    """What gives way slowly under a rising h and comes back with a falling one, in um."""
    slow, quick = -np.expm1(-step_s / np.array([truth["tau_s"], truth["back_s"]]))
    now, out = float(h[0]), []
    for goal in h.tolist():
        now += (slow if goal > now else quick) * (goal - now)
        out.append(now)
    return truth["gain"] * np.array(out)


def resets(t: np.ndarray, seconds: float, truth: Truth) -> np.ndarray:
    """A sensor that jumps now and then and stays there, in um."""
    rng = np.random.default_rng(truth["walk_seed"])
    at = np.sort(rng.uniform(0.05, 0.95, JUMPS)) * seconds
    heights = truth["jump_um"] * rng.choice([-1.0, 1.0], JUMPS) * rng.uniform(0.5, 1.5, JUMPS)
    return np.concatenate([[0.0], np.cumsum(heights)])[np.searchsorted(at, t)]


def shocks(t: np.ndarray, seconds: float, truth: Truth) -> np.ndarray:
    """What doors and steps make the bench ring with, at random times, in um."""
    rng = np.random.default_rng(truth["walk_seed"])
    w, total = 2 * np.pi * truth["f_hz"], np.zeros_like(t)
    for begin, height in zip(
        rng.uniform(0.0, seconds, SHOCKS), rng.normal(size=SHOCKS), strict=True
    ):
        since = np.clip(t - begin, 0.0, None)
        total += height * np.exp(-truth["zeta"] * w * since) * np.sin(w * since)
    return truth["amplitude_um"] * total


def stiffening(h: np.ndarray, truth: Truth, stroke_um: float, step_s: float) -> np.ndarray:
    """A mode whose spring stiffens along the stroke; of unit gain at rest."""
    if not np.isfinite(truth["f_hz"]):
        return h
    w = 2 * np.pi * truth["f_hz"]
    place, speed, out = float(h[0]), 0.0, []
    for goal in h.tolist():
        stiff = w * w * (1 + truth["stiffening"] * min(max(place / stroke_um, 0.0), 1.0))
        pull = stiff * (goal - place) - 2 * truth["zeta"] * w * speed
        speed += step_s * pull
        place += step_s * speed
        out.append(place)
    return np.array(out)

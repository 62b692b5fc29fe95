"""What is hidden in a stage: how strong each effect is, and what it does to a signal.

The strength of an effect is drawn from a seed and multiplied by its size: 1 is nominal, 0 is
nothing.  Signals are (time,) on a fine, even raster from the begin of the history on; times below
zero lie before the record.  Every function returns its signal unchanged where the strength is 0.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any
from zlib import crc32

import numpy as np
from scipy import signal
from scipy.interpolate import CubicSpline

Truth = dict[str, Any]
"""Parameters of a hidden effect by name, in s, V, um; those the library has too bear its names."""


@dataclass(frozen=True)
class Scene:
    """What the strength of an effect is measured by.

    Attributes:
        low_v, span_v: lower end and width of the drive's range, in V.
        stroke_um: the stage's stroke.
        seconds: length of the record, in s.
        usual_v_s, fast_v_s: median and 90 % quantile of the input's rate while it moves.
        peak_v_s: its greatest rate.
    """

    low_v: float
    span_v: float
    stroke_um: float
    seconds: float
    usual_v_s: float
    fast_v_s: float
    peak_v_s: float


def draw(
    name: str,
    size: float,
    scene: Scene,
    seed: int,
    strengths: Mapping[str, Callable[..., Truth]] | None = None,
) -> Truth:
    """The true parameters of a hidden effect.

    Arguments:
        name: name of the effect, of `strengths`.
        size: factor on its nominal strength; 0 is nothing.
        scene: the stage and the record.
        seed: the same seed gives the same effect, stronger or weaker with its size.
        strengths: what draws each effect; `STRENGTHS` if None.

    Returns:
        Its parameters.

    Raises:
        KeyError: if there is no such effect.

    Example:
        >>> scene = Scene(0.0, 100.0, 50.0, 20.0, 100.0, 400.0, 6e3)
        >>> weak, strong = (draw("delay", size, scene, seed=1)["delay_s"] for size in (1, 2))
        >>> strong / weak
        2.0
    """
    chosen = STRENGTHS if strengths is None else strengths
    return chosen[name](np.random.default_rng([seed, crc32(name.encode())]), size, scene)


def either(rng: np.random.Generator) -> float:
    """A sign at random."""
    return float(rng.choice([-1.0, 1.0]))


def _milliseconds(name: str) -> Callable[..., Truth]:
    return lambda rng, size, scene: {name: rng.uniform(1e-3, 5e-3) * size}


def _slew_limit(rng, size, scene) -> Truth:
    nominal = scene.fast_v_s * rng.uniform(1.5, 3.0)
    return {"slew": nominal / size if size else np.inf}


def _rate_dependence(rng, size, scene) -> Truth:
    exponent = rng.uniform(0.3, 0.7)
    usual = scene.span_v * rng.uniform(0.01, 0.04) * size  # V
    peak = usual * (scene.peak_v_s / scene.usual_v_s) ** exponent
    return {"exponent": exponent, "widening_v": peak, "at_v_s": scene.peak_v_s}


def _creep(rng, size, scene) -> Truth:
    gain = rng.uniform(0.008, 0.02) * size
    return {"gain_per_decade": gain, "onset_s": 10 ** rng.uniform(-2.3, -1.0)}


def _resonance(rng, size, scene) -> Truth:
    # A mode follows slow motion with an error that falls with the square of its frequency.
    nominal, zeta = 10 ** rng.uniform(np.log10(40), np.log10(250)), 10 ** rng.uniform(-1.7, -0.7)
    return {"f_hz": nominal / np.sqrt(size) if size else np.inf, "zeta": zeta}


def _drift(rng, size, scene) -> Truth:
    form = str(rng.choice(["exponential", "linear", "random_walk"]))
    change = scene.stroke_um * rng.uniform(0.01, 0.05) * either(rng) * size
    tau, walk = rng.uniform(0.15, 0.6) * scene.seconds, int(rng.integers(2**31))
    if form == "random_walk":
        return {"form": form, "rms_um": abs(change) / 3, "walk_seed": walk}
    return {"form": form, "amplitude": change} | ({"tau_s": tau} if form == "exponential" else {})


def _hum(rng, size, scene) -> Truth:
    return {
        "f_hz": float(rng.choice([50.0, 60.0])) * rng.uniform(0.999, 1.001),
        "amplitude_um": scene.stroke_um * rng.uniform(0.001, 0.005) * size,
        "harmonics": [1.0, *rng.uniform(0.0, 0.3, 2)],
        "phases": list(rng.uniform(0.0, 2 * np.pi, 3)),
    }


def _ageing(rng, size, scene) -> Truth:
    return {"loss": rng.uniform(0.01, 0.05) * size, "tau_s": rng.uniform(0.3, 3.0) * scene.seconds}


def _output_nonlinearity(rng, size, scene) -> Truth:
    form = str(rng.choice(["cubic", "wave", "saturation"]))
    amplitude = scene.stroke_um * rng.uniform(0.01, 0.03) * size
    return {"form": form, "amplitude_um": amplitude, "waves": rng.uniform(1.0, 4.0)}


def _moving(rng, size, scene) -> Truth:
    share = rng.uniform(0.02, 0.06) * either(rng) * size
    return {"a": share * scene.span_v / scene.stroke_um}


def _aux(rng, size, scene) -> Truth:
    lag = rng.uniform(0.02, 0.5)
    return {
        "gain": scene.stroke_um * rng.uniform(0.01, 0.03) * either(rng) * size / LOAD_N,
        "tau_s": lag if rng.uniform() < 0.5 else 0.0,
        "column_seed": int(rng.integers(2**31)),
    }


def _converter(scale: str) -> Callable[..., Truth]:
    def steps(rng, size, scene) -> Truth:
        return {"step": getattr(scene, scale) / 2 ** rng.uniform(8.0, 11.0) * size}

    return steps


def _reach(name: str, low: float, high: float) -> Callable[..., Truth]:
    """A length in um, between two parts of the stroke, and a seed."""

    def length(rng, size, scene) -> Truth:
        reach = scene.stroke_um * rng.uniform(low, high) * size
        return {name: reach, "walk_seed": int(rng.integers(2**31))}

    return length


def _friction(rng, size, scene) -> Truth:
    offset = scene.stroke_um * rng.uniform(0.005, 0.02) * size
    return {
        "offset_um": offset,
        "tau_s": rng.uniform(0.01, 0.1),
        "threshold_v_s": scene.usual_v_s * rng.uniform(0.3, 0.9),
    }


def _gain_walk(rng, size, scene) -> Truth:
    return {"rms": rng.uniform(0.005, 0.02) * size, "walk_seed": int(rng.integers(2**31))}


def _accommodation(rng, size, scene) -> Truth:
    return {"fade_per_range": rng.uniform(0.2, 0.8) * size}


STRENGTHS: dict[str, Callable[..., Truth]] = {
    "input_lag": _milliseconds("tau_s"),
    "output_lag": _milliseconds("tau_s"),
    "delay": _milliseconds("delay_s"),
    "slew_limit": _slew_limit,
    "rate_dependence": _rate_dependence,
    "creep": _creep,
    "resonance": _resonance,
    "drift": _drift,
    "hum": _hum,
    "ageing": _ageing,
    "output_nonlinearity": _output_nonlinearity,
    "moving": _moving,
    "aux": _aux,
    "input_quantisation": _converter("span_v"),
    "output_quantisation": _converter("stroke_um"),
    "stick_slip": _reach("reach_um", 0.003, 0.01),
    "backlash": _reach("reach_um", 0.003, 0.015),
    "friction": _friction,
    "telegraph": _reach("jump_um", 0.005, 0.02),
    "gain_walk": _gain_walk,
    "accommodation": _accommodation,
}
LOAD_N = 10.0  # amplitude of the load column


# Signals -------------------------------------------------------------------------------------


def lag(values: np.ndarray, tau_s: float, step_s: float) -> np.ndarray:
    """First-order lag of a signal that is straight between its samples, and at rest before."""
    if tau_s == 0:
        return values
    keep = np.exp(-step_s / tau_s)
    late = tau_s / step_s * (1 - keep)
    start = [late * values[0]]
    return signal.lfilter([1 - late, late - keep], [1, -keep], values, zi=start)[0]


def limit_slew(u: np.ndarray, slew: float, step_s: float) -> np.ndarray:
    """A signal that follows u at no more than `slew` per s."""
    most = slew * step_s
    if not np.any(np.abs(np.diff(u)) > most):
        return u
    out, now = [], float(u[0])
    for goal in u.tolist():
        now = min(max(goal, now - most), now + most)
        out.append(now)
    return np.array(out)


def rounded(values: np.ndarray, step: float) -> np.ndarray:
    """Values on the lattice of a converter."""
    return np.round(values / step) * step if step else values


def creep(h: np.ndarray, truth: Truth, step_s: float) -> np.ndarray:
    """h and what follows it with the compliance gain log10(1 + t / onset), at any time scale."""
    if truth["gain_per_decade"] == 0:
        return h
    age = (np.arange(len(h)) + 0.5) * step_s
    compliance = truth["gain_per_decade"] * np.log10(1 + age / truth["onset_s"])
    return h + signal.fftconvolve(np.diff(h, prepend=h[0]), compliance)[: len(h)]


def resonance(h: np.ndarray, truth: Truth, step_s: float) -> np.ndarray:
    """One mode of unit gain at rest, exact for h straight between its samples."""
    if not np.isfinite(truth["f_hz"]):
        return h
    w, zeta = 2 * np.pi * truth["f_hz"], truth["zeta"]
    system = ([w * w], [1, 2 * zeta * w, w * w])
    numerator, denominator, _ = signal.cont2discrete(system, step_s, "foh")  # pyright: ignore
    return h[0] + signal.lfilter(np.ravel(numerator), denominator, h - h[0])


def slow_walk(t: np.ndarray, seconds: float, seed: int) -> np.ndarray:
    """A smooth random walk of RMS 1 and mean 0 over the record; at rest before it."""
    steps = np.random.default_rng(seed).normal(size=25)
    path = CubicSpline(np.linspace(0.0, seconds, 26), np.concatenate([[0.0], np.cumsum(steps)]))
    even = path(np.linspace(0.0, seconds, 2000))
    return (path(np.clip(t, 0.0, seconds)) - even.mean()) / even.std()


def drift(t: np.ndarray, seconds: float, truth: Truth) -> np.ndarray:
    """What is added in um."""
    if truth["form"] == "random_walk":
        return truth["rms_um"] * slow_walk(t, seconds, truth["walk_seed"])
    t = np.clip(t, 0.0, None)
    if truth["form"] == "linear":
        return truth["amplitude"] * t / seconds
    return truth["amplitude"] * np.expm1(-t / truth["tau_s"]) / np.expm1(-seconds / truth["tau_s"])


def hum(t: np.ndarray, truth: Truth) -> np.ndarray:
    """Mains and two harmonics, in um."""
    lines = zip(truth["harmonics"], truth["phases"], strict=True)
    waves = [a * np.sin(2 * np.pi * truth["f_hz"] * k * t + p) for k, (a, p) in enumerate(lines, 1)]
    return truth["amplitude_um"] * np.sum(waves, axis=0)


def remaining(t: np.ndarray, seconds: float, truth: Truth) -> np.ndarray:
    """Share of the stroke that ageing leaves."""
    tau = truth["tau_s"]
    return 1 - truth["loss"] * np.expm1(-np.clip(t, 0.0, None) / tau) / np.expm1(-seconds / tau)


def distorted(z: np.ndarray, stroke_um: float, truth: Truth) -> np.ndarray:
    """The reading of a sensor that is not straight."""
    x = z / stroke_um - 0.5
    if truth["form"] == "cubic":
        bend = 20.8 * x * (x * x - 0.25)  # 1 at its greatest
    elif truth["form"] == "wave":
        bend = np.sin(2 * np.pi * truth["waves"] * x)
    else:
        bend = -8 * np.clip(x, 0.0, None) ** 3  # only the upper half
    return z + truth["amplitude_um"] * bend


def load(t: np.ndarray, seconds: float, seed: int) -> np.ndarray:
    """A load that is put on, changed and taken off, between -1 and 1, smooth over 20 ms."""
    rng = np.random.default_rng(seed)
    at = np.sort(rng.uniform(0.02, 0.98, 12)) * seconds
    levels = rng.uniform(-1.0, 1.0, 13)
    sway = 0.15 * np.sin(2 * np.pi * rng.uniform(0.1, 0.5) * t + rng.uniform(0, 6.28))
    return 0.85 * moved_between(levels, at, t, 0.02) + sway


def moved_between(levels: np.ndarray, at: np.ndarray, t: np.ndarray, smooth_s: float) -> np.ndarray:
    """(time,) levels that follow one another at some times, smooth over `smooth_s`."""
    moves = np.diff(levels)[:, None] * 0.5 * (1 + np.tanh((t - at[:, None]) / smooth_s))
    return levels[0] + moves.sum(axis=0)


def late_force(t: np.ndarray, seconds: float, truth: Truth, step_s: float) -> np.ndarray:
    """(time,) the load in N behind its lag, as it acts."""
    force = LOAD_N * load(t, seconds, truth["column_seed"])
    return lag(force, truth["tau_s"], step_s)


def stick_slip(h: np.ndarray, truth: Truth) -> np.ndarray:
    """The output rests until the drive has left it by a random distance, then catches up."""
    if truth["reach_um"] == 0:
        return h
    rng = np.random.default_rng(truth["walk_seed"])
    out, place, limit = [], float(h[0]), truth["reach_um"]
    for drive in h.tolist():
        if abs(drive - place) > limit:
            place = drive
            limit = truth["reach_um"] * rng.uniform(0.3, 1.0)
        out.append(place)
    return np.array(out)


def backlash(h: np.ndarray, truth: Truth) -> np.ndarray:
    """Play in the mechanics: a classical dead band behind the actuator."""
    if truth["reach_um"] == 0:
        return h
    half, out, place = truth["reach_um"] / 2, [], float(h[0])
    for drive in h.tolist():
        place = min(max(place, drive - half), drive + half)
        out.append(place)
    return np.array(out)


def friction(rate: np.ndarray, truth: Truth, step_s: float) -> np.ndarray:
    """An offset against fast motion that comes and goes with a lag, in um."""
    opposing = -np.sign(rate) * (np.abs(rate) > truth["threshold_v_s"])
    return truth["offset_um"] * lag(opposing, truth["tau_s"], step_s)


def telegraph(t: np.ndarray, seconds: float, truth: Truth) -> np.ndarray:
    """Random steps of a sensor between two readings, in um."""
    at = np.sort(np.random.default_rng(truth["walk_seed"]).uniform(0.0, seconds, 14))
    return truth["jump_um"] * (np.searchsorted(at, t) % 2)

"""What is hidden in a stage: how strong each effect is, and what it does to a signal.

The strength of an effect is drawn from a seed and multiplied by its size: 1 is nominal, 0 is
nothing.  Signals are (time,) on a fine, even raster from the begin of the history on; times below
zero lie before the record.  Every function returns its signal unchanged where the strength is 0.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any
from zlib import crc32

import numpy as np
from scipy import signal
from scipy.interpolate import CubicSpline

Truth = dict[str, Any]
"""Parameters of a hidden effect by name, in s, V, um; those the library has too bear its names."""

LOAD_N = 10.0  # amplitude of the load column
AXIS_V = 40.0
"""Reach of the other axis to both sides of its middle."""
JUMPS, SHOCKS = 8, 25


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


def draw(name: str, size: float, scene: Scene, seed: int) -> Truth:
    """The true parameters of a hidden effect: the same seed gives it stronger or weaker by size."""
    return STRENGTHS[name](np.random.default_rng([seed, crc32(name.encode())]), size, scene)


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


PLAIN: dict[str, Callable[..., Truth]] = {
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


# In machines: forces of velocity, gains, several modes, leakage, another axis.


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


MACHINES: dict[str, Callable[..., Truth]] = {
    "viscosity": _viscosity,
    "gain": _gain,
    "leakage": _leakage,
    "log_rate": _log_rate,
    "cross": _cross,
    "modes": _modes,
}


# Of fields and of masses: what a diagnosis tries on request only.


def _excess_loss(rng, size, scene: Scene) -> Truth:
    reach = scene.stroke_um * rng.uniform(0.005, 0.02) * size  # at a fast rate
    return {"c": reach / np.sqrt(scene.fast_v_s)}


def _eddy_currents(rng, size, scene: Scene) -> Truth:
    late = rng.uniform(1e-3, 5e-3) * size  # s, where the loop has its mean slope
    return {"k": late * scene.span_v / scene.stroke_um}


def _operator_creep(rng, size, scene: Scene) -> Truth:
    return {
        "gain": scene.stroke_um / scene.span_v * rng.uniform(0.01, 0.03) * size,
        "lowest": rng.uniform(0.02, 0.1),
        "slowest_s": rng.uniform(2.0, 20.0),
    }


def _restoring_force(rng, size, scene: Scene) -> Truth:
    return {
        "f_hz": 10 ** rng.uniform(np.log10(8), np.log10(40)),
        "zeta": 10 ** rng.uniform(-1.7, -1.0),
        "share": min(rng.uniform(0.2, 0.4) * size, 0.8),
        "yields": rng.uniform(0.05, 0.2),
    }


FIELDS: dict[str, Callable[..., Truth]] = {
    "excess_loss": _excess_loss,
    "eddy_currents": _eddy_currents,
    "operator_creep": _operator_creep,
    "restoring_force": _restoring_force,
}


# What no effect of the library is: jitter, one-way creep, a spring that stiffens, and the like.


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


def _self_heating(rng, size, scene: Scene) -> Truth:
    reach = scene.stroke_um * rng.uniform(0.01, 0.04) * either(rng) * size
    return {"gain": reach / scene.fast_v_s**2, "tau_s": rng.uniform(0.5, 5.0)}


def _coercivity_walk(rng, size, scene: Scene) -> Truth:
    rms = scene.span_v * rng.uniform(0.005, 0.015) * size
    return {"rms_v": rms, "walk_seed": int(rng.integers(2**31))}


FOREIGN: dict[str, Callable[..., Truth]] = {
    "jitter": _jitter,
    "wandering_hum": _wandering_hum,
    "one_way_creep": _one_way_creep,
    "resets": _resets,
    "shocks": _shocks,
    "stiffening": _stiffening,
    "self_heating": _self_heating,
    "coercivity_walk": _coercivity_walk,
}

STRENGTHS = PLAIN | MACHINES | FIELDS | FOREIGN


# Signals


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


def viscosity(rate: np.ndarray, truth: Truth, step_s: float) -> np.ndarray:
    """A force that goes with the rate, or saturates in it, behind a lag, in um."""
    late = lag(rate, truth["tau_s"], step_s)
    if truth["form"] == "viscous":
        return truth["viscous"] * late
    return truth["saturating"] * np.tanh(late / truth["speed"])


def gain(t: np.ndarray, seconds: float, truth: Truth, step_s: float) -> np.ndarray:
    """Factor on the loop by the load."""
    return 1 + truth["gain"] * late_force(t, seconds, truth, step_s)


def leakage(t: np.ndarray, z: np.ndarray, truth: Truth, step_s: float) -> np.ndarray:
    """The reading of an amplifier that was reset as the record began, and forgets since."""
    if not np.isfinite(truth["tau_s"]):
        return z
    begin = int(np.searchsorted(t, 0.0))
    forgotten = np.zeros_like(z)
    forgotten[begin:] = lag(z[begin:], truth["tau_s"], step_s) - z[begin]
    return z - forgotten


def log_widening(rate: np.ndarray, truth: Truth) -> np.ndarray:
    """By how much the thresholds lie further apart, in V."""
    return truth["coefficient"] * np.log10(1 + np.abs(rate) / truth["slow_speed"])


def axis(t: np.ndarray, seconds: float, seed: int) -> np.ndarray:
    """Drive of another axis: steps of 4 ms between levels, -1 to 1, at times of its own."""
    rng = np.random.default_rng(seed)
    at = np.sort(rng.uniform(0.02, 0.98, 40)) * seconds
    levels = rng.uniform(-1.0, 1.0, 41)
    return moved_between(levels, at, t, 2e-3)


def cross(t: np.ndarray, seconds: float, truth: Truth, step_s: float) -> np.ndarray:
    """What another axis adds through a mode between the axes, in um."""
    drive = AXIS_V * axis(t, seconds, truth["column_seed"])
    return truth["gain"] * resonance(drive, truth, step_s)


def modes(h: np.ndarray, truth: Truth, step_s: float) -> np.ndarray:
    """Two modes beside each other, of unit gain at rest together."""
    second = {"f_hz": truth["f_hz_2"], "zeta": truth["zeta_2"]}
    parts = [resonance(h, one, step_s) for one in (truth, second)]
    return (1 - truth["share_2"]) * parts[0] + truth["share_2"] * parts[1]


def jitter(t: np.ndarray, z: np.ndarray, rows: slice, truth: Truth) -> np.ndarray:
    """(row,) z as it is read at instants that scatter around those of the record."""
    at = t[rows]
    late = truth["rms_s"] * np.random.default_rng(truth["walk_seed"]).normal(size=len(at))
    return np.interp(at + late, t, z)


def wandering_hum(t: np.ndarray, seconds: float, truth: Truth) -> np.ndarray:
    """A line whose frequency wanders, such as that of a fan, in um."""
    wander = truth["wander"] * slow_walk(t, seconds, truth["walk_seed"])
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


def self_heating(rate: np.ndarray, truth: Truth, step_s: float) -> np.ndarray:
    """What the heat of the losses adds, which leaves the stage slowly, in um."""
    return truth["gain"] * lag(rate**2, truth["tau_s"], step_s)


def operator_creep(u: np.ndarray, truth: Truth, span_v: float, step_s: float) -> np.ndarray:
    """Creep that small moves do not start, in um: plays behind dashpots."""
    reach = span_v * np.geomspace(truth["lowest"], 8 * truth["lowest"], 8)[:, None]
    keep = np.exp(-step_s / np.geomspace(0.02, truth["slowest_s"], 6))
    place, out = np.full((8, 6), u[0]), np.empty_like(u)
    for n, now in enumerate(u.tolist()):
        goal = np.clip(place, now - reach, now + reach)
        place = goal + (place - goal) * keep
        out[n] = place.sum()
    return truth["gain"] * out / 8


def restoring_force(x: np.ndarray, truth: Truth, stroke_um: float, step_s: float) -> np.ndarray:
    """Place in um of a mass on a spring, part of which yields as that of Bouc and Wen does (n = 1).

    The drive is a force, of which 1 bends the spring by the stroke where nothing yields.
    """
    w, share, reach = 2 * np.pi * truth["f_hz"], truth["share"], truth["yields"]
    place, speed, bent, out = float(x[0]), 0.0, 0.0, np.empty_like(x)
    for n, force in enumerate(x.tolist()):
        pull = force - (1 - share) * place - share * reach * bent
        speed += step_s * (w * w * pull - 2 * truth["zeta"] * w * speed)
        moved = step_s * speed
        place += moved
        bent += (moved - 0.5 * (abs(moved) * bent + moved * abs(bent))) / reach
        out[n] = place
    return stroke_um * out

"""Records of simulated stages, with hidden effects, that share no code with `preisach_jax`.

A stage of generalised plays (`stage`) is driven (`excitation`) on a raster at least five times
finer than the record's, with a history that nobody recorded, through the hidden effects
(`hidden`).  Noise, a converter and decoys make a measurement of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy import signal

from blind import hidden
from blind.excitation import HISTORY_S, Drive, make_drive
from blind.hidden import FIELDS, FOREIGN, LOAD_N, MACHINES, Scene, Truth
from blind.stage import Stage, make_stage

EFFECTS = (
    "input_lag",
    "output_lag",
    "delay",
    "slew_limit",
    "rate_dependence",
    "creep",
    "resonance",
    "drift",
    "hum",
    "ageing",
    "output_nonlinearity",
    "moving",
    "aux",
    "input_quantisation",
    "output_quantisation",
    "accommodation",
    *MACHINES,
    *FIELDS,
)
ON_REQUEST = frozenset({"moving", *FIELDS})
"""Effects that a diagnosis tries only where they are asked for by name."""
OUTSIDE = ("stick_slip", "backlash", "friction", "telegraph", "gain_walk", *FOREIGN)
NOTHING = ("plain", "converters", "coloured", "ridges", "relays", "decoys")
LOAD, AXIS, DECOYS = "load_N", "y_V", ("temp_C", "pressure_kPa")
KNOWN_AS = {  # in the library
    "aux": f"aux:{LOAD}",
    "accommodation": "reptation",
    "gain": f"gain:{LOAD}",
    "cross": f"cross:{AXIS}",
    "modes": "resonance",
}
KIN = {  # names of the library that say the same in its words, though not by the same law
    "friction": ("viscosity",),
    "wandering_hum": ("hum",),
    "one_way_creep": ("creep", "operator_creep"),
    "stiffening": ("resonance",),
}
LEAST_RATE_HZ = 6000.0  # of the fine raster


@dataclass(frozen=True, eq=False)
class Measurement:
    """What was measured, and the truth behind it.

    Attributes:
        time, input, output: (time,) in s, V, um.
        aux: (time,) auxiliary columns by name.
        truth: parameters of each hidden effect, by the name a diagnosis should give.
        stroke_um: the stage's stroke.
        noise_um: RMS of noise and converter together.
        change: RMS of what the hidden effects change, as a part of the stroke.
        circumstances: what else was drawn.
    """

    time: np.ndarray
    input: np.ndarray
    output: np.ndarray
    aux: Mapping[str, np.ndarray]
    truth: Mapping[str, Truth]
    stroke_um: float
    noise_um: float
    change: float
    circumstances: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Setting:
    """A stage, its drive and the fine raster of a record."""

    stage: Stage
    scene: Scene
    drive: Drive
    t: np.ndarray
    step_s: float
    rows: slice

    def volts(self, t: np.ndarray) -> np.ndarray:
        """(time,) the drive in V."""
        return self.scene.low_v + self.scene.span_v * self.drive(t)

    def position(self, volts: np.ndarray) -> np.ndarray:
        """(time,) V as a part of the drive's range."""
        return (volts - self.scene.low_v) / self.scene.span_v


def make_measurement(
    effects: Mapping[str, float],
    seed: int,
    excitation: str = "rich",
    seconds: float = 20.0,
    rate_hz: float = 1350.0,
    nothing: str = "plain",
) -> Measurement:
    """One record with hidden effects."""
    if unknown := set(effects) - {*EFFECTS, *OUTSIDE}:
        raise ValueError(f"no effect {', '.join(sorted(unknown))}")
    if nothing not in NOTHING:
        raise ValueError(f"no circumstance {nothing!r}: one of {', '.join(NOTHING)}")
    density = nothing if nothing in ("ridges", "relays") else "smooth"
    setting = _setting(seed, excitation, seconds, rate_hz, density)
    truth = {name: hidden.draw(name, size, setting.scene, seed) for name, size in effects.items()}
    clean = _clean(setting, truth)
    bare = _clean(setting, {}) if truth else clean
    time = np.arange(len(clean)) / rate_hz
    misled = nothing == "decoys" or any(name in truth for name in ("aux", "gain", "cross"))
    decoys = np.random.default_rng([seed, 4]) if misled else None
    output, noise, circumstances = _measured(setting, clean, truth, seed, nothing)
    coarse = hidden.rounded(clean, truth.get("output_quantisation", {}).get("step", 0.0))
    return Measurement(
        time=time,
        input=_recorded_input(setting, nothing),
        output=output,
        aux=_columns(setting, truth, time, decoys),
        truth={KNOWN_AS.get(name, name): truth[name] for name in truth},
        stroke_um=setting.stage.stroke_um,
        noise_um=noise,
        change=float(np.std(coarse - bare)) / setting.stage.stroke_um,
        circumstances=circumstances | {"nothing": nothing, "width": setting.stage.width},
    )


def _setting(seed: int, excitation: str, seconds: float, rate_hz: float, density: str) -> Setting:
    rng = np.random.default_rng([seed, 3])
    low = rng.uniform(-20.0, 0.0)
    span = rng.uniform(60.0, 150.0) - low
    stage, drive = make_stage(seed, density), make_drive(excitation, seconds, seed, rate_hz)
    finer = max(5, int(np.ceil(LEAST_RATE_HZ / rate_hz)))
    step = 1 / (rate_hz * finer)
    count, lead = round(seconds * rate_hz), round(HISTORY_S * rate_hz) * finer
    t = (np.arange((count - 1) * finer + 1 + lead) - lead) * step
    rate = np.abs(np.diff(drive(t[lead:]))) / step * span
    moving = rate[rate > 1e-3 * span]
    usual, fast = np.quantile(moving, [0.5, 0.9])
    rates = (float(usual), float(fast), float(moving.max()))
    scene = Scene(low, span, stage.stroke_um, seconds, *rates)
    return Setting(stage, scene, drive, t, step, slice(lead, None, finer))


def _clean(setting: Setting, truth: Mapping[str, Truth]) -> np.ndarray:
    """(row,) output in um before noise, at the sampling instants of the record."""
    u = _driven(setting, truth)
    z = _added(setting, truth, _moved(setting, truth, u))
    if "jitter" in truth:
        return hidden.jitter(setting.t, z, setting.rows, truth["jitter"])
    return z[setting.rows]


def _driven(setting: Setting, truth: Mapping[str, Truth]) -> np.ndarray:
    """(time,) what reaches the material, in V."""
    u = setting.volts(setting.t - truth.get("delay", {}).get("delay_s", 0.0))
    if "slew_limit" in truth:
        u = hidden.limit_slew(u, truth["slew_limit"]["slew"], setting.step_s)
    if "input_lag" in truth:
        u = hidden.lag(u, truth["input_lag"]["tau_s"], setting.step_s)
    return u


def _moved(setting: Setting, truth: Mapping[str, Truth], u: np.ndarray) -> np.ndarray:
    """(time,) where the stage goes when u (V) drives its material, in um."""
    scene, step = setting.scene, setting.step_s
    rate = np.gradient(u, step)
    x = setting.position(hidden.rounded(u, truth.get("input_quantisation", {}).get("step", 0.0)))
    if "restoring_force" in truth:
        h = hidden.restoring_force(x, truth["restoring_force"], scene.stroke_um, step)
    elif "moving" in truth:
        h = setting.stage.response_with_feedback(x, truth["moving"]["a"] / scene.span_v)
    elif "eddy_currents" in truth:
        h = setting.stage.response_behind_currents(
            x, truth["eddy_currents"]["k"] / scene.span_v / step
        )
    else:
        shift, fade = _widened(setting, truth, rate), None
        if "accommodation" in truth:
            travel = np.abs(np.diff(x, prepend=x[0]))
            fade = -np.expm1(-truth["accommodation"]["fade_per_range"] * travel)
        h = setting.stage.response(x, shift, fade)
    return _behind(setting, truth, h, u, rate)


def _behind(
    setting: Setting, truth: Mapping[str, Truth], h: np.ndarray, u: np.ndarray, rate: np.ndarray
) -> np.ndarray:
    """(time,) where the stage goes, in um, when its hysteresis asks for h."""
    scene, step = setting.scene, setting.step_s
    if "ageing" in truth:
        h = h * hidden.remaining(setting.t, scene.seconds, truth["ageing"])
    if "gain_walk" in truth:
        walk = truth["gain_walk"]
        h = h * (1 + walk["rms"] * hidden.slow_walk(setting.t, scene.seconds, walk["walk_seed"]))
    if "gain" in truth:
        h = h * hidden.gain(setting.t, scene.seconds, truth["gain"], step)
    if "creep" in truth:
        h = hidden.creep(h, truth["creep"], step)
    if "operator_creep" in truth:
        h = h + hidden.operator_creep(u, truth["operator_creep"], scene.span_v, step)
    if "excess_loss" in truth:
        h = h + truth["excess_loss"]["c"] * np.sign(rate) * np.sqrt(np.abs(rate))
    if "self_heating" in truth:
        h = h + hidden.self_heating(rate, truth["self_heating"], step)
    if "one_way_creep" in truth:
        h = h + hidden.one_way_creep(h, truth["one_way_creep"], step)
    return _mechanics(setting, truth, h, rate)


def _mechanics(
    setting: Setting, truth: Mapping[str, Truth], h: np.ndarray, rate: np.ndarray
) -> np.ndarray:
    """(time,) where what is coupled to the material goes, in um."""
    step = setting.step_s
    if "stick_slip" in truth:
        h = hidden.stick_slip(h, truth["stick_slip"])
    if "backlash" in truth:
        h = hidden.backlash(h, truth["backlash"])
    if "friction" in truth:
        h = h + hidden.friction(rate, truth["friction"], step)
    if "viscosity" in truth:
        h = h + hidden.viscosity(rate, truth["viscosity"], step)
    if "modes" in truth:
        h = hidden.modes(h, truth["modes"], step)
    if "stiffening" in truth:
        h = hidden.stiffening(h, truth["stiffening"], setting.stage.stroke_um, step)
    return hidden.resonance(h, truth["resonance"], step) if "resonance" in truth else h


def _widened(setting: Setting, truth: Mapping[str, Truth], rate: np.ndarray) -> np.ndarray | None:
    """(time,) by how much the thresholds lie further apart, in parts of the drive's range."""
    shifts: list[np.ndarray] = []
    if "rate_dependence" in truth:
        law = truth["rate_dependence"]
        shifts.append(law["widening_v"] * (np.abs(rate) / law["at_v_s"]) ** law["exponent"])
    if "log_rate" in truth:
        shifts.append(hidden.log_widening(rate, truth["log_rate"]))
    if "coercivity_walk" in truth:
        walk = truth["coercivity_walk"]
        path = hidden.slow_walk(setting.t, setting.scene.seconds, walk["walk_seed"])
        shifts.append(walk["rms_v"] * path)
    return np.sum(shifts, axis=0) / setting.scene.span_v if shifts else None


def _added(setting: Setting, truth: Mapping[str, Truth], z: np.ndarray) -> np.ndarray:
    """(time,) what the sensor makes of where the stage is, in um."""
    t, seconds = setting.t, setting.scene.seconds
    if "aux" in truth:
        force = hidden.late_force(t, seconds, truth["aux"], setting.step_s)
        z = z + truth["aux"]["gain"] * force
    if "cross" in truth:
        z = z + hidden.cross(t, seconds, truth["cross"], setting.step_s)
    if "output_nonlinearity" in truth:
        z = hidden.distorted(z, setting.stage.stroke_um, truth["output_nonlinearity"])
    if "output_lag" in truth:
        z = hidden.lag(z, truth["output_lag"]["tau_s"], setting.step_s)
    if "leakage" in truth:
        z = hidden.leakage(t, z, truth["leakage"], setting.step_s)
    if "drift" in truth:
        z = z + hidden.drift(t, seconds, truth["drift"])
    if "telegraph" in truth:
        z = z + hidden.telegraph(t, seconds, truth["telegraph"])
    for name, added in (
        ("resets", hidden.resets),
        ("shocks", hidden.shocks),
        ("wandering_hum", hidden.wandering_hum),
    ):
        if name in truth:
            z = z + added(t, seconds, truth[name])
    return z + hidden.hum(t, truth["hum"]) if "hum" in truth else z


def _columns(
    setting: Setting,
    truth: Mapping[str, Truth],
    time: np.ndarray,
    decoys: np.random.Generator | None,
) -> dict[str, np.ndarray]:
    """Auxiliary columns: what acts, and decoys that look as the load does and do nothing."""
    seconds, columns = setting.scene.seconds, {}
    for name in ("aux", "gain"):
        if name in truth:
            columns[LOAD] = 15 + LOAD_N * hidden.load(time, seconds, truth[name]["column_seed"])
    if "cross" in truth:
        drive = hidden.axis(time, seconds, truth["cross"]["column_seed"])
        columns[AXIS] = 50 + hidden.AXIS_V * drive
    if decoys is not None:
        slow, quick = decoys.integers(2**31, size=2)
        columns[DECOYS[0]] = 20 + 3 * hidden.slow_walk(time, seconds, int(slow))
        columns[DECOYS[1]] = 20 + 3 * hidden.load(time, seconds, int(quick))
    return columns


def _measured(
    setting: Setting, clean: np.ndarray, truth: Mapping[str, Truth], seed: int, nothing: str
) -> tuple[np.ndarray, float, dict[str, Any]]:
    """The output with noise, on the lattice of the encoder; RMS of both; what was drawn."""
    rng = np.random.default_rng([seed, 5])
    rms = setting.stage.stroke_um * 10 ** rng.uniform(np.log10(2e-5), np.log10(2e-4))
    colours = ("ar1", "pink") if nothing == "coloured" else ("white", "ar1", "pink")
    colour = str(rng.choice(colours))
    encoder = 10 ** rng.uniform(-4.0, np.log10(3e-3))
    if nothing == "converters":
        encoder = rms * rng.uniform(1.0, 2.0)
    step = max(truth.get("output_quantisation", {}).get("step", 0.0), encoder)
    noisy = clean + rms * _noise(rng, colour, len(clean))
    total = float(np.hypot(rms, step / np.sqrt(12)))
    return hidden.rounded(noisy, step), total, {"colour": colour, "encoder_um": encoder}


def _recorded_input(setting: Setting, nothing: str) -> np.ndarray:
    """(row,) the input as it was recorded, in V; the stage sees it smooth."""
    bits = 12 if nothing == "converters" else 18
    return hidden.rounded(setting.volts(setting.t[setting.rows]), setting.scene.span_v / 2**bits)


def _noise(rng: np.random.Generator, colour: str, count: int) -> np.ndarray:
    """(row,) noise of RMS 1: white, an autoregression of 0.9, or with a spectrum as 1/f."""
    white = rng.normal(size=count)
    if colour == "ar1":
        return np.asarray(signal.lfilter([np.sqrt(1 - 0.9**2)], [1, -0.9], white))
    if colour == "pink":
        spectrum = np.fft.rfft(white) / np.sqrt(np.maximum(np.arange(count // 2 + 1), 3))
        pink = np.fft.irfft(spectrum, count)
        return (pink - pink.mean()) / pink.std()
    return white

"""The simulated experiment: a piezo stage with hysteresis, chosen further effects and an encoder.

It is the judge of what the diagnosis says, so it shares nothing with the models: its hysteresis is
a bundle of generalised plays, integrated at a finer step than the record's, and each effect is
written down here from its physics. Arrays are NumPy in double precision.
"""

from __future__ import annotations

import csv
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import signal

from preisach_jax.errors import InputError
from preisach_jax.signals import diagnostic_record

EFFECTS = ("creep", "input_lag", "delay", "drift", "ageing", "aux:load_N")
RANGE_V = 75.0  # drive from 0 to here
ENCODER_STEP_UM = 1.22e-3  # of a common interpolated grating, and of the paper's stage
INNER_RATE_HZ = 10_000.0  # the stage is integrated at least this often
PLAYS = 64
CHUNK = 20_000  # samples of a ramp that are in memory at once, for all plays


@dataclass(frozen=True)
class StageRecord:
    """What the simulated experiment has measured, and what was hidden in it.

    Args:
        time: (time,) s.
        input: (time,) drive, V.
        output: (time,) position, µm, with noise and encoder steps.
        aux: (time,) auxiliary columns by name; the unit is the end of the name.
        truth: the hidden effects and their parameters, ready for JSON.
    """

    time: np.ndarray
    input: np.ndarray
    output: np.ndarray
    aux: Mapping[str, np.ndarray]
    truth: dict

    def save(self, path: str | Path) -> None:
        """Write the measured columns t_s, u_V, z_um and the auxiliary ones, comma-separated.

        Args:
            path: the file to write.

        Example:
            >>> import tempfile
            >>> with tempfile.TemporaryDirectory() as folder:
            ...     simulate_stage(seconds=3.0).save(Path(folder) / "stage.csv")
            ...     print((Path(folder) / "stage.csv").read_text().splitlines()[0])
            t_s,u_V,z_um
        """
        columns = {"t_s": self.time, "u_V": self.input, "z_um": self.output, **self.aux}
        # Ten digits hold an encoder step, a sixteen-bit drive and half a microsecond in an hour.
        texts = [[f"{value:.10g}" for value in column.tolist()] for column in columns.values()]
        with Path(path).open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(columns)
            writer.writerows(zip(*texts, strict=True))


@dataclass(frozen=True)
class Stage:
    """Rate-independent hysteresis of the stage: generalised plays, asymmetric and with a dead zone.

    A play with slack keeps v between u - slack_up and u + slack_down; the stage moves by
    h = Σ_k weight_k g(v_k) with the generating function g(v) = s ln(1 + e^((v - d)/s)), flat below
    the dead zone d (generalised play: Visintin, Differential Models of Hysteresis, 1994; for smart
    actuators: Al Janaideh, Rakheja and Su, Smart Mater. Struct. 18, 045001, 2009). A slack of zero
    is the reversible part.

    Args:
        slack_up: (plays,) V, by which a rising drive is ahead.
        slack_down: (plays,) V, by which a falling drive is behind.
        weights: (plays,) µm per V of generating function.
        dead_zone: d, V.
        softness: s, V.

    Example:
        >>> stage = make_stage(seed=1)
        >>> up, down = stage.hysteresis(np.array([0.0, 40.0, 75.0, 40.0]))[[1, 3]]
        >>> bool(down > up)
        True
    """

    slack_up: np.ndarray
    slack_down: np.ndarray
    weights: np.ndarray
    dead_zone: float
    softness: float

    def generate(self, v: np.ndarray) -> np.ndarray:
        """Generating function g, V.

        Args:
            v: play, V, of any shape.

        Returns:
            g(v), V, of the same shape.
        """
        return self.softness * np.logaddexp(0.0, (v - self.dead_zone) / self.softness)

    def hysteresis(self, u: np.ndarray) -> np.ndarray:
        """Output along a drive, after one loop over the whole range that is not recorded.

        Args:
            u: (time,) drive, V.

        Returns:
            (time,) position, µm, zero at rest at 0 V.
        """
        u = np.asarray(u, float)
        v = np.minimum(RANGE_V - self.slack_up, self.slack_down)  # of that loop: up, then to 0
        rest = self.weights @ self.generate(v)
        path = np.concatenate([[0.0], u])
        moves = np.diff(path)
        sign = np.sign(moves)
        held = np.maximum.accumulate(np.where(sign != 0, np.arange(sign.size), 0))
        heading = sign[held]  # a hold belongs to the ramp before it
        turns = np.flatnonzero(np.diff(heading)) + 1
        cuts = np.unique(np.concatenate([turns, np.arange(0, u.size, CHUNK), [u.size]]))
        h = np.empty(u.size)
        for begin, end in itertools.pairwise(cuts.tolist()):
            stretch, back = np.unique(u[begin:end], return_inverse=True)
            if heading[begin] < 0:
                plays = np.minimum(v[:, None], stretch + self.slack_down[:, None])
                v = np.minimum(v, u[end - 1] + self.slack_down)
            else:
                plays = np.maximum(v[:, None], stretch - self.slack_up[:, None])
                v = np.maximum(v, u[end - 1] - self.slack_up)
            h[begin:end] = (self.weights @ self.generate(plays))[back]
        return h - rest


def make_stage(seed: int = 0) -> Stage:
    """Draw a stage with 40 to 90 µm stroke and a loop 10 to 18 % of it wide.

    Args:
        seed: whole number, at least 0; the same seed gives the same stage.

    Returns:
        The stage.

    Example:
        >>> 40.0 < make_stage(seed=3).hysteresis(np.array([75.0])).item() < 90.0
        True
    """
    rng = np.random.default_rng([seed, 1])
    quantile = (np.arange(PLAYS - 1) + rng.uniform(0.2, 0.8, PLAYS - 1)) / (PLAYS - 1)
    # Radii reach as far as the drive and get rarer with size, as measured on piezo ceramics.
    radius = np.concatenate([[0.0], rng.uniform(22.0, 34.0) * quantile ** rng.uniform(1.1, 1.5)])
    skew = rng.uniform(-0.25, 0.25)
    dead_zone, softness = rng.uniform(-12.0, 4.0), rng.uniform(9.0, 18.0)
    stroke, width = rng.uniform(40.0, 90.0), rng.uniform(0.10, 0.18)
    ups, downs = radius * (1.0 + skew), radius * (1.0 - skew)

    def part(chosen: slice, size: float) -> tuple[np.ndarray, float]:
        """Weights of some of the plays so that they move by `size` together, and their width."""
        weights = np.zeros(PLAYS)
        weights[chosen] = 1.0
        bare = Stage(ups, downs, weights, dead_zone, softness)
        axis = np.linspace(0.0, RANGE_V, 151)
        up, down = np.split(bare.hysteresis(np.concatenate([axis, axis[::-1]])), 2)
        return weights * size / up[-1], float(np.max(down[::-1] - up) / up[-1])

    openness = part(slice(1, None), 1.0)[1]
    share = min(0.9, width / openness)
    reversible = part(slice(0, 1), (1.0 - share) * stroke)[0]
    return Stage(
        ups, downs, part(slice(1, None), share * stroke)[0] + reversible, dead_zone, softness
    )


def simulate_stage(
    seed: int = 0,
    seconds: float = 24.0,
    effects: Sequence[str] = (),
    rate_hz: float = 2000.0,
    *,
    drive: np.ndarray | None = None,
    noise_um: float = 0.006,
    encoder_step_um: float = ENCODER_STEP_UM,
) -> StageRecord:
    """Simulate the measurement of a piezo stage with the chosen effects hidden in it.

    The drive runs straight from sample to sample and has been at its first value for ever; effects
    on the input come first, then the hysteresis, ageing, creep, and what is added to the position.

    Args:
        seed: whole number, at least 0, which draws the stage, the effects and the noise.
        seconds: duration, s; with `drive`, its own length counts.
        effects: names out of `EFFECTS`; "aux" is short for "aux:load_N", which adds a column.
        rate_hz: sampling rate, Hz.
        drive: (time,) drive from 0 to 75 V; None is `diagnostic_record`.
        noise_um: standard deviation of the sensor's white noise, µm.
        encoder_step_um: step of the encoder, µm; 0 is none.

    Returns:
        The record and the truth.

    Raises:
        InputError: an effect is unknown, or the drive, a size or a rate cannot be used.

    Example:
        >>> record = simulate_stage(seed=1, seconds=6.0, effects=("creep",), rate_hz=1000.0)
        >>> record.output.shape, record.truth["effects"]
        ((6000,), ['creep'])
    """
    names = _names(effects)
    if seed != int(seed) or seed < 0:
        raise InputError(f"seed is {seed!r}: give a whole number, at least 0")
    for name, value in (("seconds", seconds), ("rate_hz", rate_hz)):
        if not 0.0 < value < math.inf:
            raise InputError(f"{name} is {value!r}: give a number above 0")
    for name, value in (("noise_um", noise_um), ("encoder_step_um", encoder_step_um)):
        if not 0.0 <= value < math.inf:
            raise InputError(f"{name} is {value!r}: give 0 or a number above it")
    u = _drive(drive, seconds, rate_hz)
    fine = math.ceil(INNER_RATE_HZ / rate_hz - 1e-9)
    step = 1.0 / (rate_hz * fine)
    stage = make_stage(int(seed))
    stroke = float(stage.hysteresis(np.array([RANGE_V]))[0])
    hidden = {name: _draw(name, int(seed), u.size / rate_hz, stroke) for name in names}

    time = np.arange(u.size) / rate_hz
    inner = np.arange((u.size - 1) * fine + 1) * step
    position, aux = _position(stage, hidden, time, u, inner, step, int(seed))
    rows = slice(None, None, fine)
    z = position[rows] + np.random.default_rng([seed, 2]).normal(0.0, noise_um, u.size)
    if encoder_step_um:
        z = np.round(z / encoder_step_um) * encoder_step_um + 0.0  # no negative zero
    truth = {
        "effects": names,
        "parameters": hidden,
        "seed": int(seed),
        "seconds": u.size / rate_hz,
        "rate_hz": float(rate_hz),
        "stroke_um": stroke,
        "noise_um": float(noise_um),
        "encoder_step_um": float(encoder_step_um),
    }
    return StageRecord(time, u, z, {name: column[rows] for name, column in aux.items()}, truth)


def _names(effects: Sequence[str]) -> list[str]:
    if isinstance(effects, str):
        raise InputError(f"effects is {effects!r}: give a list of names, as in ({effects!r},)")
    names = ["aux:load_N" if name == "aux" else name for name in effects]
    for name in names:
        if name not in EFFECTS:
            raise InputError(f"the stage has no effect {name!r}: choose from {', '.join(EFFECTS)}")
    if len(set(names)) < len(names):
        raise InputError(f"effects are {', '.join(names)}: name each only once")
    return names


def _drive(drive: np.ndarray | None, seconds: float, rate_hz: float) -> np.ndarray:
    if drive is None:
        return diagnostic_record(seconds, rate_hz, 0.0, RANGE_V)
    u = np.asarray(drive, float)
    if u.ndim != 1 or u.size < 2:
        raise InputError(f"the drive has the shape {u.shape}: give (time,) with two values or more")
    if not np.all((u >= 0.0) & (u <= RANGE_V)):
        raise InputError(f"the drive runs from {u.min()} to {u.max()}: keep it in 0 to 75 V")
    return u


def _draw(name: str, seed: int, duration: float, stroke: float) -> dict:
    """Parameters of a hidden effect; each has its own stream, so that effects can be combined."""
    rng = np.random.default_rng([seed, 10 + EFFECTS.index(name)])
    swing = float(rng.uniform(0.010, 0.020) * stroke)
    if name == "creep":
        count = int(rng.integers(6, 10))
        decades = -2.0 + 3.0 * (np.arange(count) + rng.uniform(0.0, 1.0, count)) / count
        gain = float(rng.uniform(0.012, 0.030))
        parts = rng.uniform(0.7, 1.3, count)
        return {
            "gain_per_decade": gain,
            "tau_s": (10.0**decades).tolist(),
            "gains": (gain * 3.0 * parts / parts.sum()).tolist(),
        }
    if name == "input_lag":
        return {"tau_s": float(rng.uniform(1e-3, 5e-3))}
    if name == "delay":
        return {"delay_s": float(rng.uniform(1e-3, 4e-3))}
    if name == "drift":
        sign = float(rng.choice([-1.0, 1.0]))
        return {"amplitude_um": sign * swing, "tau_s": float(rng.uniform(0.2, 1.5) * duration)}
    if name == "ageing":
        return {
            "loss": float(rng.uniform(0.015, 0.04)),
            "tau_s": float(rng.uniform(0.3, 2.0) * duration),
        }
    return {"gain_um_per_N": swing / 10.0, "tau_s": 0.0}


def _position(
    stage: Stage,
    hidden: Mapping[str, dict],
    time: np.ndarray,
    u: np.ndarray,
    inner: np.ndarray,
    step: float,
    seed: int,
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Position, µm, at the inner instants, and the auxiliary columns there."""
    late = hidden["delay"]["delay_s"] if "delay" in hidden else 0.0
    drive = np.interp(inner - late, time, u)  # a controller's dead time
    if "input_lag" in hidden:  # the amplifier's resistance charges the piezo's capacitance
        drive = np.clip(low_pass(drive, hidden["input_lag"]["tau_s"], step), 0.0, RANGE_V)
    z = stage.hysteresis(drive)
    if "ageing" in hidden:  # domains lose their poling: all strain shrinks
        z = z * (1.0 - hidden["ageing"]["loss"] * _settling(inner, hidden["ageing"]["tau_s"]))
    if "creep" in hidden:  # domains that follow late: Kelvin-Voigt elements in series
        creep = hidden["creep"]
        pairs = zip(creep["gains"], creep["tau_s"], strict=True)
        z = z + np.sum([gain * low_pass(z, tau, step) for gain, tau in pairs], axis=0)
    if "drift" in hidden:  # the frame warms up
        drift = hidden["drift"]
        z = z + drift["amplitude_um"] * _settling(inner, drift["tau_s"])
    if "aux:load_N" not in hidden:
        return z, {}
    load = _load(inner, np.random.default_rng([seed, 3]))
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
    return signal.lfilter(
        [0.5 / (ratio + 0.5)] * 2,
        [1.0, -(ratio - 0.5) / (ratio + 0.5)],
        x,
        zi=x[:1] * (1.0 - 0.5 / (ratio + 0.5)),
    )[0]


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

"""A simulated actuator with one hidden effect, for tests of the diagnosis.

It shares no code with the package. Its hysteresis is a continuous Everett function with a stack of
turning points instead of a grid of hysterons; it is driven, and its effects are hidden on a raster
several times finer than the record's, as those of the blind benchmark are. Units are s, V, um.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from blind import hidden
from blind.excitation import HISTORY_S, make_drive
from scipy import signal, special
from scipy.interpolate import CubicSpline

TOP = 75.0  # V, upper end of the excitation
INNER_RATE = 10_000.0  # Hz, the least rate at which the actuator is integrated
ENCODER_STEP = 1.22e-3  # um


@dataclass(frozen=True)
class World:
    """A smooth Preisach operator; its density is sum_k p_k(alpha) q_k(beta), alpha >= beta >= 0.

    A separable density has the Everett function
    E(a, b) = G(a) - G(b) - sum_k Q_k(b) (P_k(a) - P_k(b)) with P' = p, Q' = q, G' = sum_k p_k Q_k,
    which needs functions of one variable only, so it is exact at every path and not on a grid.
    """

    gain: float  # um, of the irreversible part
    joint: Callable[[np.ndarray], np.ndarray]  # G
    up: tuple[Callable[[np.ndarray], np.ndarray], ...]  # P_k
    down: tuple[Callable[[np.ndarray], np.ndarray], ...]  # Q_k
    reversible: Callable[[np.ndarray], np.ndarray]  # um, memoryless and increasing
    stroke: float  # um, from 0 to TOP
    width: float  # largest vertical width of the major loop, part of the stroke

    def everett(self, a, b):
        """Irreversible rise (um) when the input goes from a falling-to b up to a >= b."""
        a, b = np.asarray(a, float), np.asarray(b, float)
        total = self.joint(a) - self.joint(b)
        for p, q in zip(self.up, self.down, strict=True):
            total = total - q(b) * (p(a) - p(b))
        return self.gain * total

    def hysteresis(self, u):
        """Output (um) along the path u (V), which starts at 0 V with everything switched off."""
        u = np.asarray(u, float)
        if u.min() < 0.0 or u.max() > 1.2 * TOP:
            raise ValueError(f"path from {u.min():.3g} to {u.max():.3g} V leaves 0..{1.2 * TOP} V")
        whole = np.concatenate([[0.0], u])
        moved = np.diff(whole, prepend=-1.0) != 0.0
        rows = np.cumsum(moved)[1:] - 1  # at rest, the last value stays
        return self._irreversible(whole[moved])[rows] + self.reversible(u)

    def _irreversible(self, path):
        joint = self.joint(path)
        up = np.stack([p(path) for p in self.up])
        down = np.stack([q(path) for q in self.down])

        def rise(low, part):  # E(path[part], path[low])
            return (joint[part] - joint[low]) - down[:, low] @ (up[:, part] - up[:, low, None])

        def fall(high, part):  # E(path[high], path[part])
            reach = up[:, high, None] - up[:, part]
            return (joint[high] - joint[part]) - np.sum(down[:, part] * reach, axis=0)

        z = np.zeros(len(path))
        sign = np.sign(np.diff(path))
        corners = np.flatnonzero(sign[1:] != sign[:-1]) + 1 if len(sign) > 1 else []
        lows, highs = [0], []  # turning points that are still remembered, as rows of path
        begin = 0
        for end in [*corners, len(path) - 1]:
            row = begin + 1
            if row > end:
                continue
            if path[end] > path[begin]:
                while row <= end:
                    limit = path[highs[-1]] if highs else np.inf
                    stop = row + int(np.searchsorted(path[row : end + 1], limit, "right"))
                    z[row:stop] = z[lows[-1]] + rise(lows[-1], slice(row, stop))
                    row = stop
                    if row <= end:  # wiped out
                        highs.pop()
                        lows.pop()
                highs.append(end)
            else:
                while row <= end:
                    limit = path[lows[-1]]
                    stop = row + int(np.searchsorted(-path[row : end + 1], -limit, "right"))
                    z[row:stop] = z[highs[-1]] - fall(highs[-1], slice(row, stop))
                    row = stop
                    if row <= end:
                        highs.pop()
                        lows.pop()
                lows.append(end)
            begin = end
        return self.gain * z


def make_world(seed: int) -> World:
    """An actuator with 40-90 um stroke and loops 10-18 % wide, asymmetric as a piezo's are."""
    rng = np.random.default_rng([seed, 1])
    grid = np.linspace(-2.0, 1.25 * TOP, 6001)
    bumps = int(rng.integers(5, 8))
    centres = np.linspace(0.0, 1.0, bumps) + rng.uniform(-0.3, 0.3, bumps) / bumps
    heights = rng.uniform(0.8, 1.25, bumps) * np.exp(rng.uniform(-0.8, 0.8) * centres)
    apart = rng.uniform(4.0, 9.0) * rng.uniform(0.8, 1.2, bumps)  # V, half of alpha - beta
    up, down, joint_slope = [], [], np.zeros_like(grid)
    for centre, height, half in zip(centres * TOP, heights, apart, strict=True):
        p = height * _skew_normal(grid, centre + half, rng.uniform(11, 18), rng.uniform(-1.5, 1.5))
        q = _skew_normal(grid, centre - half, rng.uniform(11, 18), rng.uniform(-1.5, 1.5))
        up.append(CubicSpline(grid, p).antiderivative())
        down.append(CubicSpline(grid, q).antiderivative())
        joint_slope += p * down[-1](grid)
    joint = CubicSpline(grid, joint_slope).antiderivative()
    stroke, width = rng.uniform(40.0, 90.0), rng.uniform(0.10, 0.18)

    bare = World(1.0, joint, tuple(up), tuple(down), np.zeros_like, 1.0, 1.0)
    ends = bare.everett(TOP, 0.0)
    axis = np.linspace(0.0, TOP, 301)
    open_ = np.max(ends - bare.everett(TOP, axis) - bare.everett(axis, 0.0)) / ends
    share = min(0.85, width / open_)  # irreversible part of the stroke
    bend, tilt = rng.uniform(-0.25, 0.35), rng.uniform(-0.05, 0.05)
    full = 1.0 + bend + tilt
    rest = (1.0 - share) * stroke / full

    def reversible(u):
        x = np.asarray(u, float) / TOP
        return rest * (x + bend * x**2 + tilt * np.sin(np.pi * x / 2) ** 2)

    gain = float(share * stroke / ends)
    return World(
        gain, joint, tuple(up), tuple(down), reversible, float(stroke), float(share * open_)
    )


def _skew_normal(x, centre, scale, skew):
    y = (x - centre) / scale
    return np.exp(-0.5 * y**2) * special.ndtr(skew * y) * 2 / (scale * np.sqrt(2 * np.pi))


def excitation(kind: str, duration_s: float, rate_hz: float, seed: int):
    """(time,) samples in V of a drive of the blind benchmark, without its history."""
    drive = make_drive(kind, duration_s, seed, rate_hz)
    return TOP * drive(np.arange(round(duration_s * rate_hz)) / rate_hz)


def _behind(effect, h, t, seconds, truth, step_s):
    """(time,) what comes out, in um, where the hysteresis makes h."""
    if effect == "creep":
        return hidden.creep(h, truth, step_s)
    if effect == "drift":
        return h + hidden.drift(t, seconds, truth)
    if effect == "aux":
        return h + truth["gain"] * hidden.late_force(t, seconds, truth, step_s)
    if effect == "stick_slip":
        return hidden.stick_slip(h, truth)
    if effect == "output_lag":
        return hidden.lag(h, truth["tau_s"], step_s)
    if effect == "ageing":
        return h * hidden.remaining(t, seconds, truth)
    return h + hidden.hum(t, truth) if effect == "hum" else h


def hidden_record(
    effect: str | None,
    seed: int,
    duration_s: float,
    rate_hz: float,
    size: float = 1.0,
    unknown_start: bool = False,
    decoy: bool = False,
    noise_um: float = 0.006,
    noise_colour: float = 0.0,
) -> dict:
    """One measured record under the rich drive with at most one hidden effect.

    `size` scales the effect, `decoy` adds an auxiliary column that does nothing, `noise_colour` is
    the correlation of neighbouring noise samples. Returns t, x, z (K,), aux {name: (K,)}, clean
    (K,), noise_um and truth.
    """
    world, drive = make_world(seed), make_drive("rich", duration_s, seed, rate_hz)
    fine, count = max(1, int(np.ceil(INNER_RATE / rate_hz - 1e-9))), round(duration_s * rate_hz)
    lead, step = round(HISTORY_S * rate_hz) * fine * unknown_start, 1 / (rate_hz * fine)
    t = (np.arange((count - 1) * fine + 1 + lead) - lead) * step
    scene = hidden.Scene(0.0, TOP, world.stroke, duration_s, *[np.nan] * 3)
    truth = hidden.draw(effect, size, scene, seed) if effect else {}
    u = TOP * drive(np.maximum(t - truth.get("delay_s", 0.0), t[0]))
    if effect == "input_lag":
        u = hidden.lag(u, truth["tau_s"], step)
    clean = _behind(effect, world.hysteresis(u), t, duration_s, truth, step)[lead::fine]
    time, rng = t[lead::fine], np.random.default_rng([seed, 5])
    aux = {}
    if effect == "aux":
        aux["load_N"] = 15 + hidden.LOAD_N * hidden.load(time, duration_s, truth["column_seed"])
    if decoy:
        aux["temp_C"] = 20 + 3 * hidden.slow_walk(time, duration_s, seed)
    white = rng.normal(0.0, noise_um, count)
    if noise_colour:
        blend = np.sqrt(1.0 - noise_colour**2)
        white = signal.lfilter([blend], [1.0, -noise_colour], white)
    return {
        "t": time,
        "x": TOP * drive(time),
        "z": np.round((clean + white) / ENCODER_STEP) * ENCODER_STEP,
        "aux": aux,
        "clean": clean,
        "noise_um": float(np.hypot(noise_um, ENCODER_STEP / np.sqrt(12.0))),
        "truth": truth,
    }

"""A simulated actuator with one hidden effect, for tests of the diagnosis.

It shares no code and no method with the package: a continuous Everett function with a stack of
turning points instead of a grid of hysterons, an inner step several times finer than the record's,
and each effect integrated by a scheme of its own. Arrays are NumPy, units are s, V, um.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import signal, special
from scipy.interpolate import CubicSpline

TOP = 75.0  # V, upper end of the excitation
INNER_RATE = 10_000.0  # Hz, the least rate at which the actuator is integrated
ENCODER_STEP = 1.22e-3  # um
HISTORY = 4.0  # s before the record, when its start is unknown
TICK = 1e-3  # s, corners of the excitation lie on this raster
SEEDED = {"world": 1, "excitation": 2, "history": 3, "effect": 4, "noise": 5, "decoy": 6}


def _rng(seed: int, purpose: str) -> np.random.Generator:
    return np.random.default_rng([seed, SEEDED[purpose]])


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
    rng = _rng(seed, "world")
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


def _round(t):
    return np.round(np.asarray(t) / TICK) * TICK


class _Track:
    """Corners of a piecewise linear signal, drawn with a pen that moves at given rates."""

    def __init__(self, start):
        self.t, self.u = [0.0], [float(start)]

    def go(self, u, rate):  # V/s
        u = float(np.clip(u, 0.0, TOP))
        took = max(float(_round(abs(u - self.u[-1]) / rate)), TICK)
        self.t.append(self.t[-1] + took)
        self.u.append(u)

    def hold(self, seconds):
        self.t.append(self.t[-1] + max(float(_round(seconds)), TICK))
        self.u.append(self.u[-1])


def _spread(rng, count, low=0.0, high=TOP):
    """Levels that cover low..high evenly, jittered, in random order."""
    cells = (np.arange(count) + rng.uniform(0.0, 1.0, count)) / count
    return rng.permutation(low + (high - low) * cells)


def _zigzag(track, rng, count, rate):
    """Turning points all over the range, upper and lower ones in turn."""
    levels = np.sort(_spread(rng, 2 * count)).reshape(2, count)
    for low, high in zip(rng.permutation(levels[0]), rng.permutation(levels[1]), strict=True):
        track.go(high, rate)
        track.go(low, rate)


def _decay(track, rng, turns, rate):
    """Triangles that shrink from the full range to a random centre."""
    centre = rng.uniform(0.3, 0.7) * TOP
    for k in range(turns):
        left = 1.0 - (k + rng.uniform(0.0, 0.6)) / turns
        track.go(centre + left * (TOP - centre), rate)
        track.go(centre - left * centre, rate)


def _staircase(track, rng, count, seconds):
    """Steps with holds, upward and then downward."""
    levels = np.sort(_spread(rng, count, 4.0, TOP - 4.0))
    for level in [*levels, *(levels[::-1][1:] + rng.uniform(-3.0, 3.0, count - 1))]:
        track.go(level, 3000.0)
        track.hold(seconds * rng.uniform(0.6, 1.4))


def _rich(rng, start):
    """Corners of a record of about 24 s, and the chirp that is laid on one of its holds."""
    track = _Track(start)
    track.hold(0.2)
    if start > 0.0:  # stay inside for a while, so that the unknown memory is seen
        for level in start + rng.uniform(-0.25, 0.25, 6) * TOP:
            track.go(level, 60.0)
    track.go(0.0, 150.0)
    for level in (TOP, 0.0):
        track.go(level, 150.0)
    _decay(track, rng, 5, 150.0)
    _staircase(track, rng, 6, 0.4)
    _zigzag(track, rng, 9, 700.0)
    track.hold(0.4)
    _decay(track, rng, 8, 600.0)
    track.go(rng.uniform(0.7, 0.9) * TOP, 400.0)
    track.hold(1.2)
    _zigzag(track, rng, 2, 60.0)
    track.go(rng.uniform(0.1, 0.3) * TOP, 400.0)
    track.hold(1.2)
    track.go(rng.uniform(0.4, 0.6) * TOP, 200.0)
    chirp_from = track.t[-1] + 0.1
    track.hold(2.2)
    chirp = (chirp_from, 2.0, rng.uniform(6.0, 10.0), 1.0, 15.0)
    _zigzag(track, rng, 6, 250.0)
    track.go(0.0, 150.0)
    for level in (TOP, 0.0):
        track.go(level, 150.0)
    return track, chirp


def _poor(rng, start):
    """One rate only: every 0.1 s a coin says up or down; the ends of the range reflect."""
    track, rate, direction = _Track(start), 173.0, 1.0
    while track.t[-1] < 24.0:
        direction = direction if rng.uniform() < 0.5 else -direction
        run = track.u[-1] + direction * rate * 0.1
        if run > TOP or run < 0.0:
            edge = TOP if run > TOP else 0.0
            if abs(edge - track.u[-1]) > 2 * rate * TICK:
                track.go(edge, rate)
            track.go(2 * edge - run, rate)
            direction = -direction
        else:
            track.go(run, rate)
    return track, None


def waveform(kind: str, duration_s: float, seed: int, start: float = 0.0):
    """The excitation as a function of continuous time (s) that returns V, at rest before 0."""
    rng = _rng(seed, "excitation")
    if kind not in ("rich", "poor"):
        raise ValueError(f"no excitation {kind!r}: rich or poor")
    track, chirp = (_rich if kind == "rich" else _poor)(rng, start)
    stretch = duration_s / track.t[-1] if kind == "rich" else 1.0
    corners, levels = _round(np.array(track.t) * stretch), np.array(track.u)

    def at(t):
        u = np.interp(t, corners, levels)
        if chirp is not None:
            begin, length, amplitude, low, high = chirp  # frequencies do not stretch
            s = (np.asarray(t) / stretch - begin) / length
            phase = 2 * np.pi * length * stretch * (low * s + 0.5 * (high - low) * s**2)
            window = np.sin(np.pi * np.clip(s, 0.0, 1.0)) ** 0.5
            u = u + np.where((s > 0) & (s < 1), amplitude * window * np.sin(phase), 0.0)
        return u

    return at


def excitation(kind: str, duration_s: float, rate_hz: float, seed: int, start: float = 0.0):
    """Samples (V) of `waveform` at rate_hz; the same signal at every rate."""
    return waveform(kind, duration_s, seed, start)(np.arange(round(duration_s * rate_hz)) / rate_hz)


def _history(seed: int):
    """What happened in the HISTORY seconds before the record: a function of t <= 0, and its end."""
    rng = _rng(seed, "history")
    track = _Track(0.0)
    for level in _spread(rng, 14):
        track.go(level, 250.0)
    track.go(rng.uniform(0.35, 0.65) * TOP, 250.0)
    corners = np.array(track.t) * (HISTORY - 0.5) / track.t[-1] - HISTORY
    levels = np.array(track.u)
    return (lambda t: np.interp(t, corners, levels)), float(levels[-1])


def runge_kutta_lag(before, middle, after, tau, step, start):
    """tau v' = u - v by classical Runge-Kutta; the scheme is linear, so it runs as a filter."""

    def one(v, u0, um, u1):
        k1 = (u0 - v) / tau
        k2 = (um - v - step / 2 * k1) / tau
        k3 = (um - v - step / 2 * k2) / tau
        k4 = (u1 - v - step * k3) / tau
        return v + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)

    keep = one(1.0, 0.0, 0.0, 0.0)
    push = one(0.0, 1.0, 0, 0) * before + one(0.0, 0, 1.0, 0) * middle + one(0.0, 0, 0, 1.0) * after
    v, _ = signal.lfilter([1.0], [1.0, -keep], push, zi=np.array([keep * start]))
    return np.concatenate([[start], v])


def ramp_lag(h, tau, step):
    """tau y' = h - y, exact for h linear between samples, at rest before the first sample."""
    keep = np.exp(-step / tau)
    late = tau / step * (1.0 - keep)
    y, _ = signal.lfilter([1.0 - late, late - keep], [1.0, -keep], h, zi=np.array([late * h[0]]))
    return y


def _kelvin_voigt(rng, size):
    """Times and compliances of some Kelvin-Voigt elements, spread unevenly over 3 decades."""
    count = int(rng.integers(5, 9))
    decades = -1.9 + 3.0 * (np.arange(count) + rng.uniform(0.0, 1.0, count)) / count
    per_decade = rng.uniform(0.010, 0.030) * size
    share = rng.uniform(0.7, 1.3, count)
    return 10.0**decades, per_decade * 3.0 * share / share.sum(), per_decade


def _slow(rng, t, duration):
    """A slow random signal about 1 in amplitude: a few sinusoids and two soft steps."""
    y = np.zeros_like(t)
    for _ in range(5):
        f = rng.uniform(0.6, 6.0) / duration
        y += rng.normal() * np.sin(2 * np.pi * f * t + rng.uniform(0, 2 * np.pi)) / np.sqrt(f)
    y /= np.std(y)
    for place in rng.uniform(0.1, 0.9, 2):
        y += rng.normal() * np.tanh((t - place * duration) / (0.01 * duration))
    return (y - y.mean()) / np.max(np.abs(y - y.mean()))


def _drift(rng, t, duration, swing):
    kind = str(rng.choice(["exponential", "linear", "polynomial"]))
    amplitude = swing * float(rng.choice([-1.0, 1.0]))
    truth = {"kind": kind, "amplitude_um": amplitude}
    x = np.clip(t, 0.0, None) / duration
    if kind == "exponential":
        truth["tau_s"] = float(rng.uniform(0.15, 0.6) * duration)
        return amplitude * -np.expm1(-x * duration / truth["tau_s"]), truth
    if kind == "linear":
        return amplitude * x, truth
    bend = rng.uniform(-1.0, 1.0, 2)
    truth["coefficients"] = bend.tolist()
    return amplitude * (x + bend[0] * x * (1 - x) + bend[1] * x * (1 - x) * (1 - 2 * x)), truth


def _stick_slip(rng, h, swing):
    """The output rests until the drive has left it by a random distance, then catches up."""
    y = np.empty_like(h)
    place, begin = h[0], 0
    while begin < len(h):
        reach = swing * rng.uniform(0.3, 1.0)
        away = np.flatnonzero(np.abs(h[begin : begin + 2_000] - place) > reach)
        stop = begin + int(away[0]) if len(away) else min(begin + 2_000, len(h))
        y[begin:stop] = place
        if len(away):
            place = h[stop] - 0.2 * reach * np.sign(h[stop] - place)
        begin = stop
    return y


def _drive(effect, at, t, step, rng, size, truth):
    """What the hysteresis sees, at the instants t: effects on the input."""
    if effect == "delay":
        truth["delay_s"] = float(rng.uniform(1e-3, 4e-3) * size)
        return at(t - truth["delay_s"])
    if effect == "input_lag":
        truth["tau_s"] = tau = float(rng.uniform(1e-3, 5e-3) * size)
        u, middle = at(t), at(t[:-1] + step / 2)
        v = runge_kutta_lag(u[:-1], middle, u[1:], tau, step, u[0])
        return np.clip(v, 0.0, None)  # rounding alone can pass below zero
    return at(t)


def _respond(world, effect, h, t, step, duration, rng, size, truth):
    """What comes out, at the instants t, and the auxiliary column if there is one."""
    swing = float(rng.uniform(0.010, 0.020)) * world.stroke * size
    if effect == "creep":
        taus, gains, truth["gain_per_decade"] = _kelvin_voigt(rng, size)
        truth.update(tau_s=taus.tolist(), gains=gains.tolist())
        lags = [c * ramp_lag(h, tau, step) for tau, c in zip(taus, gains, strict=True)]
        return h + np.sum(lags, axis=0), {}
    if effect == "drift":
        slow, extra = _drift(rng, t, duration, swing)
        truth.update(extra)
        return h + slow, {}
    if effect == "aux":
        warm = bool(rng.uniform() < 0.5)
        name, scale = ("temp_C", 2.0) if warm else ("load_N", 10.0)
        column = _slow(rng, t, duration)
        truth.update(column=name, gain_um_per_unit=swing / scale, tau_s=0.0)
        force = column
        if warm:
            truth["tau_s"] = tau = float(rng.uniform(0.01, 0.06)) * duration
            force = ramp_lag(column, tau, step)
        return h + swing * force, {name: (20.0 if warm else 15.0) + scale * column}
    if effect == "stick_slip":
        truth["reach_um"] = swing / 3
        return _stick_slip(rng, h, swing / 3), {}
    if effect == "output_lag":
        truth["tau_s"] = tau = float(rng.uniform(1e-3, 5e-3) * size)
        return ramp_lag(h, tau, step), {}
    if effect == "ageing":
        truth["loss"] = loss = float(rng.uniform(0.01, 0.04)) * size
        truth["tau_s"] = tau = float(rng.uniform(0.3, 3.0)) * duration
        done = np.expm1(-np.clip(t, 0.0, None) / tau) / np.expm1(-duration / tau)
        return h * (1.0 - loss * done), {}
    if effect == "hum":
        truth.update(f_hz=50.0, amplitude_um=0.17 * size, phase=float(rng.uniform(0, 2 * np.pi)))
        return h + 0.17 * size * np.sin(2 * np.pi * 50.0 * t + truth["phase"]), {}
    return h, {}


EFFECTS = ("creep", "input_lag", "delay", "drift", "ageing", "aux", "output_lag", "hum")
OUTSIDE = ("stick_slip",)


def hidden_record(
    effect: str | None,
    seed: int,
    duration_s: float = 24.0,
    rate_hz: float = 2000.0,
    excitation: str = "rich",
    size: float = 1.0,
    unknown_start: bool = False,
    decoy: bool = False,
    noise_um: float = 0.006,
    noise_colour: float = 0.0,
) -> dict:
    """One measured record with at most one hidden effect.

    `size` scales the effect, `decoy` adds an auxiliary column that does nothing, `noise_colour` is
    the correlation of neighbouring noise samples. Returns t, x, z (K,), aux {name: (K,)}, clean
    (K,), noise_um and truth.
    """
    effect = None if effect in (None, "none") else effect
    if effect is not None and effect not in EFFECTS + OUTSIDE:
        raise ValueError(f"no effect {effect!r}: one of {', '.join(EFFECTS + OUTSIDE)}")
    world, rng = make_world(seed), _rng(seed, "effect")
    before, start = _history(seed) if unknown_start else (None, 0.0)
    inside = waveform(excitation, duration_s, seed, start)

    def at(t):
        return inside(t) if before is None else np.where(t < 0.0, before(t), inside(t))

    fine = max(1, int(np.ceil(INNER_RATE / rate_hz - 1e-9)))
    step = 1.0 / (rate_hz * fine)
    count = round(duration_s * rate_hz)
    lead = round(HISTORY * rate_hz) * fine if unknown_start else 0
    t_in = (np.arange((count - 1) * fine + 1 + lead) - lead) * step
    truth: dict = {"effect": effect, "stroke_um": world.stroke, "seed": seed}
    h = world.hysteresis(_drive(effect, at, t_in, step, rng, size, truth))
    out, aux = _respond(world, effect, h, t_in, step, duration_s, rng, size, truth)
    rows = slice(lead, None, fine)
    clean, t = out[rows], np.arange(count) / rate_hz
    aux = {name: column[rows] for name, column in aux.items()}
    if decoy:
        free = "temp_C" if "load_N" in aux else "load_N"
        aux[free] = 15.0 + 10.0 * _slow(_rng(seed, "decoy"), t, duration_s)
    white = _rng(seed, "noise").normal(0.0, noise_um, count)
    if noise_colour:
        blend = np.sqrt(1.0 - noise_colour**2)
        white = signal.lfilter([blend], [1.0, -noise_colour], white)
    z = np.round((clean + white) / ENCODER_STEP) * ENCODER_STEP
    return {
        "t": t,
        "x": at(t),
        "z": z,
        "aux": aux,
        "clean": clean,
        "noise_um": float(np.hypot(noise_um, ENCODER_STEP / np.sqrt(12.0))),
        "truth": truth,
    }

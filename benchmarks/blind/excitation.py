"""What drives the hidden stages: a history before the record, and four kinds of record.

`poor` has one ramp rate, `periodic` repeats one loop, `fair` has a few rates and some holds, `rich`
is the universal diagnostic record.  Levels are parts of the drive's range, 0 to 1, and rates ranges
per second.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

KINDS = ("poor", "periodic", "fair", "rich")
HISTORY_S = 3.0
MULTISINE_S = 2.2  # of the hold that it lies on
STEP_RATE = 60.0  # ranges/s, of what counts as a step


@dataclass(frozen=True, eq=False)
class Multisine:
    """Sines under a window, laid on a hold of the record."""

    begin_s: float
    length_s: float
    frequency_hz: np.ndarray
    amplitude: np.ndarray
    phase: np.ndarray

    def __call__(self, t: np.ndarray) -> np.ndarray:
        """(time,) what is added to the level."""
        part = (t - self.begin_s) / self.length_s
        window = np.sin(np.pi * np.clip(part, 0.0, 1.0)) ** 0.5
        total = np.zeros_like(t)
        for f, a, phase in zip(self.frequency_hz, self.amplitude, self.phase, strict=True):
            total += a * np.sin(2 * np.pi * f * t + phase)
        return np.where((part > 0) & (part < 1), window * total, 0.0)


@dataclass(frozen=True, eq=False)
class Drive:
    """A drive as a function of continuous time.

    Attributes:
        corner_s: (corner,) times of the corners, from `-HISTORY_S` on.
        level: (corner,) levels there, 0 to 1, straight in between.
        multisine: what is laid on it, or None.
    """

    corner_s: np.ndarray
    level: np.ndarray
    multisine: Multisine | None = None

    def __call__(self, t: np.ndarray) -> np.ndarray:
        """(time,) level at the times t, in s."""
        level = np.interp(t, self.corner_s, self.level)
        return level if self.multisine is None else level + self.multisine(t)


class Pen:
    """Draws corners of a piecewise straight signal, on a raster as a controller's clock has."""

    def __init__(self, level: float, tick_s: float):
        self.t, self.level, self.tick_s = [0.0], [level], tick_s

    @property
    def now(self) -> float:
        return self.t[-1]

    def go(self, level: float, rate: float) -> None:
        """Move to a level at a rate in ranges/s."""
        level = float(np.clip(level, 0.0, 1.0))
        self._add(level, abs(level - self.level[-1]) / rate)

    def hold(self, seconds: float) -> None:
        """Rest."""
        self._add(self.level[-1], seconds)

    def _add(self, level: float, seconds: float) -> None:
        self.t.append(self.now + max(round(seconds / self.tick_s), 1) * self.tick_s)
        self.level.append(level)


def make_drive(kind: str, seconds: float, seed: int, rate_hz: float = 1350.0) -> Drive:
    """A drive of `seconds`, with a history before it; its corners lie on sampling instants."""
    if kind not in KINDS:
        raise ValueError(f"no excitation {kind!r}: one of {', '.join(KINDS)}")
    tick_s = 1 / rate_hz
    before = _history(np.random.default_rng([seed, 1]), tick_s)
    level, multisine = before.level[-1], None
    if kind == "rich":
        pen, multisine = _rich(level, seconds, [seed, 6], tick_s)
    else:
        pen = Pen(level, tick_s)
        draw = {"poor": _poor, "periodic": _periodic, "fair": _fair}[kind]
        draw(pen, np.random.default_rng([seed, 6]), seconds)
    corner_s = np.concatenate([np.array(before.t) - before.now, pen.t[1:]])
    return Drive(corner_s, np.concatenate([before.level, pen.level[1:]]), multisine)


def _history(rng: np.random.Generator, tick_s: float) -> Pen:
    """What nobody recorded: turning points all over the range, and a rest at a random level."""
    pen = Pen(0.0, tick_s)
    levels = np.array([1.0, *rng.uniform(0.0, 1.0, 10), rng.uniform(0.2, 0.8)])
    rate = np.sum(np.abs(np.diff(levels, prepend=0.0))) / (HISTORY_S - 0.3)
    for level in levels:
        pen.go(float(level), rate)
    pen.hold(0.3)
    return pen


def _poor(pen: Pen, rng: np.random.Generator, seconds: float) -> None:
    """Every 0.1 s a coin says up or down, at one rate; the ends of the range reflect."""
    rate, sign = rng.uniform(1.5, 3.0), 1.0
    while pen.now < seconds:
        sign = sign if rng.uniform() < 0.5 else -sign
        goal = pen.level[-1] + 0.1 * sign * rate
        edge = float(np.clip(goal, 0.0, 1.0))
        if edge != goal:
            pen.go(edge, rate)
            goal, sign = 2 * edge - goal, -sign
        pen.go(goal, rate)


def _periodic(pen: Pen, rng: np.random.Generator, seconds: float) -> None:
    """One loop over and over at one rate, half of them with a minor loop on each branch."""
    rate, low, high = rng.uniform(0.8, 3.0), rng.uniform(0.0, 0.2), rng.uniform(0.8, 1.0)
    minor = rng.uniform(low, high, 4) if rng.uniform() < 0.5 else np.zeros(0)
    up, down = np.sort(minor[:2])[::-1], np.sort(minor[2:])
    pen.go(low, rate)
    while pen.now < seconds:
        for level in (*up, high, *down, low):
            pen.go(float(level), rate)


def _fair(pen: Pen, rng: np.random.Generator, seconds: float) -> None:
    """Turning points at random levels, at three rates, with a hold now and then."""
    rates = rng.uniform(0.8, 1.2) * np.array([0.8, 3.0, 10.0])
    pen.go(0.0, rates[1])
    pen.go(1.0, rates[1])
    while pen.now < seconds:
        rate = rates[rng.integers(3)]
        for _ in range(int(rng.integers(2, 7)) if rate > 1 else 1):
            pen.go(rng.uniform(0.0, 0.5), rate)
            pen.go(rng.uniform(0.5, 1.0), rate)
        if rng.uniform() < 0.4:
            pen.go(rng.uniform(0.1, 0.9), rate)
            pen.hold(rng.uniform(0.2, 0.8))


def _rich(level: float, seconds: float, seed: list[int], tick_s: float) -> tuple[Pen, Multisine]:
    """The universal diagnostic record, stretched to its length."""
    trial = Pen(level, tick_s)
    _universal(trial, np.random.default_rng(seed))
    stretch = seconds / trial.now
    pen, rng = Pen(level, tick_s / stretch), np.random.default_rng(seed)
    begin = _universal(pen, rng) + 0.1
    pen.t = [t * stretch for t in pen.t]
    count = 10
    multisine = Multisine(
        begin * stretch,
        (MULTISINE_S - 0.2) * stretch,
        np.geomspace(1.0, 40.0, count) * rng.uniform(0.95, 1.05, count),
        0.12 * np.geomspace(1.0, 0.2, count) / np.sqrt(count),
        rng.uniform(0.0, 2 * np.pi, count),
    )
    return pen, multisine


def _universal(pen: Pen, rng: np.random.Generator) -> float:
    """Draw the universal diagnostic record; the time at which the multisine's hold begins."""
    reference = rng.uniform(2.2, 3.0)
    for level in pen.level[-1] + rng.uniform(-0.15, 0.15, 4):  # shows the unknown memory
        pen.go(level, 2.0)
    pen.go(0.0, reference)
    for _ in range(3):
        _loop(pen, reference)
    slow = rng.uniform(0.45, 0.55)
    for rate, swings in ((6 * slow, 8), (40 * slow, 12), (slow, 3)):
        _decay(pen, rng, rate, swings)
    _staircases(pen, rng)
    for up in (True, False):
        _minor_loops(pen, rng, up)
    pen.hold(0.5)
    pen.go(rng.uniform(0.4, 0.6), reference)
    begin = pen.now
    pen.hold(MULTISINE_S)
    pen.go(0.0, reference)
    _loop(pen, reference)
    return begin


def _loop(pen: Pen, rate: float) -> None:
    """The reference loop, over the whole range."""
    pen.go(1.0, rate)
    pen.go(0.0, rate)


def _decay(pen: Pen, rng: np.random.Generator, rate: float, swings: int) -> None:
    """Triangles that shrink from the whole range to a random centre."""
    centre = rng.uniform(0.35, 0.65)
    for k in range(swings):
        left = 1.0 - (k + rng.uniform(0.0, 0.6)) / swings
        pen.go(centre + left * (1.0 - centre), rate)
        pen.go(centre - left * centre, rate)


def _staircases(pen: Pen, rng: np.random.Generator) -> None:
    """Steps and holds upward and then downward; the holds span two decades."""
    pen.go(0.05, 3.0)
    up = np.array([0.25, 0.5, 0.75, 0.95])
    for levels in (up, 0.95 - up + 0.05):
        for level, seconds in zip(levels, rng.permutation(np.geomspace(0.02, 2.0, 4)), strict=True):
            pen.go(level + rng.uniform(-0.05, 0.05), STEP_RATE)
            pen.hold(seconds)


def _minor_loops(pen: Pen, rng: np.random.Generator, up: bool) -> None:
    """Minor loops of equal swing at five biases of one branch."""
    pen.go(0.0 if up else 1.0, 3.0)
    for bias in np.linspace(0.2, 0.8, 5) + rng.uniform(-0.04, 0.04, 5):
        level = bias if up else 1.0 - bias
        swing = -0.15 if up else 0.15
        pen.go(level, 4.0)
        pen.go(level + swing, 4.0)
        pen.go(level, 4.0)
    pen.go(1.0 if up else 0.0, 3.0)

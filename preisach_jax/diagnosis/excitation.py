"""Excitations that bring out what two models would do differently, within range and rate."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import jax
import numpy as np

from preisach_jax.errors import InputError
from preisach_jax.quantity import quantity
from preisach_jax.signals import multisine

LEAST_SAMPLES = 3000
"""Samples below which a hundredth of the longest hold is not a few of them."""

LEAST_STROKES = 40
"""Strokes at the greatest rate that must fit into the time, so that all parts have room."""

SAMPLES_A_STROKE = 20
"""Samples that the fastest stroke must have at least."""

LEAST_DECADES = 1.6
"""From the fastest triangle to the slowest; more where the time lets the slowest one be full."""

RATES = 5
MOST_TURNS = 24
TWO_TURNS = 1.75
"""Travel of a decaying triangle of two turns and full swing, in parts of the range."""

HOLDS = (0.1, 0.01, 1.0, 0.0316, 0.316)
"""Lengths of the holds in one direction, as parts of the longest: two decades."""

UPWARD = (0.15, 0.35, 0.55, 0.75, 0.95)
DOWNWARD = (0.8, 0.6, 0.4, 0.2, 0.05)
BIASES = (0.05, 0.225, 0.4, 0.575, 0.75)
MINOR_SWING = 0.15
SINES = 20


@dataclass(frozen=True)
class Bounds:
    """What an excitation keeps to.

    Attributes:
        low, high: ends of the range, in the unit of the input.
        fastest: greatest rate, in that unit per second.
        rate_hz: sampling rate in Hz.
        samples: number of samples.
        unit: unit of the input.
    """

    low: float
    high: float
    fastest: float
    rate_hz: float
    samples: int
    unit: str

    @staticmethod
    def of(
        history: np.ndarray,
        step_s: float,
        unit: str,
        seconds: float | None = None,
        rate_limit: float | None = None,
        ends: tuple[float, float] | None = None,
    ) -> Bounds:
        """Bounds that a record has kept to itself.

        Arguments:
            history: (2, point) time in s and input of the record.
            step_s: its time step in s.
            unit: unit of the input.
            seconds: duration in s; by default that of the record, or more if the rate needs it.
        """
        low, high = (history[1].min(), history[1].max()) if ends is None else ends
        # A time step is a difference of times, and carries their rounding.
        rate_hz = float(f"{1 / step_s:.9g}")
        fastest = greatest_rate(history) if rate_limit is None else rate_limit
        fastest = min(fastest, (high - low) * rate_hz / SAMPLES_A_STROKE)
        least = max(LEAST_SAMPLES / rate_hz, LEAST_STROKES * (high - low) / fastest)
        if seconds is None:
            seconds = max(float(np.ptp(history[0])), least)
        if not least <= seconds * (1 + 1e-9):
            raise InputError(
                f"seconds is {seconds:g}: at {quantity(rate_hz, 'Hz')} and at most "
                f"{quantity(fastest, f'{unit}/s')} the excitations need at least "
                f"{math.ceil(10 * least) / 10:g} s; give more, or a higher rate limit"
            )
        samples = math.ceil(seconds * rate_hz - 1e-6)
        return Bounds(float(low), float(high), float(fastest), rate_hz, samples, unit)

    @property
    def span(self) -> float:
        """Width of the range, in the unit of the input."""
        return self.high - self.low

    @property
    def seconds(self) -> float:
        """Duration in s."""
        return self.samples / self.rate_hz

    @property
    def stroke_s(self) -> float:
        """Time in s of a stroke from one end to the other at the greatest rate."""
        return self.span / self.fastest

    def shown(self, *values: float) -> str:
        """Values of the input with their unit, as in `15, 30 and 45 V`."""
        numbers = [f"{float(f'{value:.3g}'):g}" for value in values]
        joined = " and ".join([", ".join(numbers[:-1]), numbers[-1]] if numbers[1:] else numbers)
        return f"{joined} {self.unit}".rstrip()

    def rates(self, *values: float) -> str:
        """Rates of the input with their unit."""
        return f"{self.shown(*values)}/s" if self.unit else f"{self.shown(*values)} per s"


def greatest_rate(history: np.ndarray) -> float:
    """Greatest rate of an input over a tenth of its range: no noise, and no small step.

    Arguments:
        history: (2, point) time in s and input.

    Returns:
        The greatest slope of a chord that spans a tenth of the range or more, in input units per s.
    """
    time, values = history
    enough = 0.1 * np.ptp(values)
    greatest = 0.0
    for apart in range(1, len(time)):
        move = np.abs(values[apart:] - values[:-apart])
        slope = move / (time[apart:] - time[:-apart])
        greatest = max(greatest, float(np.max(slope, where=move >= enough, initial=0.0)))
    return greatest


@dataclass(frozen=True, eq=False)
class PlannedExcitation:
    """An input to play.

    Attributes:
        name: its name.
        input: (time,) in the unit of the input; begins and ends at the low end.
        text: what it is in words.
    """

    name: str
    input: np.ndarray
    text: str


class _Path:
    """Draws an excitation: corners at whole samples, levels in parts of the range."""

    def __init__(self, bounds: Bounds):
        self.bounds = bounds
        self.corners: list[float] = [0.0]
        self.levels: list[float] = [0.0]

    def go(self, level: float, rate: float | None = None) -> None:
        """Moves to a level at a rate in input units per s, by default the greatest."""
        bounds = self.bounds
        seconds = abs(level - self.levels[-1]) * bounds.span / (rate or bounds.fastest)
        if seconds > 0:
            self._add(max(1, math.ceil(seconds * bounds.rate_hz * (1 - 1e-9))), level)

    def hold(self, seconds: float) -> None:
        """Rests."""
        self._add(max(1, int(seconds * self.bounds.rate_hz)), self.levels[-1])

    def wave(self, levels: np.ndarray) -> None:
        """Appends samples."""
        first = self.corners[-1] + 1
        self.corners += np.arange(first, first + len(levels)).tolist()
        self.levels += levels.tolist()

    def loop(self) -> None:
        """The reference loop, to the high end and back."""
        self.go(1.0)
        self.go(0.0)

    def _add(self, samples: int, level: float) -> None:
        self.corners.append(self.corners[-1] + samples)
        self.levels.append(level)

    def played(self) -> np.ndarray:
        """(time,) the samples, resting at the end until the time is over."""
        bounds = self.bounds
        if self.corners[-1] >= bounds.samples:
            raise AssertionError(f"{self.corners[-1]} samples are drawn, more than fit")
        shape = np.interp(np.arange(bounds.samples), self.corners, self.levels)
        # Weighted, not scaled, so that both ends are hit to the last digit.
        return (1 - shape) * bounds.low + shape * bounds.high


def candidates(bounds: Bounds) -> list[PlannedExcitation]:
    """Excitations that each bring out another kind of effect, and one that holds them all."""
    drawn: list[PlannedExcitation] = []
    for draw in (*_PARTS, combination):
        path = _Path(bounds)
        text = draw(path, (bounds.samples - 1) / bounds.rate_hz)
        drawn.append(PlannedExcitation(draw.__name__.removeprefix("_"), path.played(), text))
    return drawn


def _triangles(path: _Path, seconds: float) -> str:
    bounds = path.bounds
    # Before, between and behind the rates the path crosses three quarters of the range, at most.
    share = (seconds - (2 + 0.75 * (RATES + 1)) * bounds.stroke_s) / RATES - 30 / bounds.rate_hz
    path.loop()
    rates: list[float] = []
    swings: list[float] = []
    slowest = TWO_TURNS * bounds.span / share
    decades = max(LEAST_DECADES, math.log10(bounds.fastest / slowest))
    for rate in bounds.fastest * 10 ** -np.linspace(0.0, decades, RATES):
        turns, half = _decay(rate * share / bounds.span)
        levels = 0.5 + half * _shrinking(turns)
        path.go(levels[0])
        before = path.corners[-1]
        path.go(levels[1], rate)
        rates.append(2 * half * bounds.span * bounds.rate_hz / (path.corners[-1] - before))
        swings.append(2 * half * bounds.span)
        for level in levels[2:]:
            path.go(level, rate)
        once = path.corners[-1] - before
        for _ in range(int((share * bounds.rate_hz - once) // (2 * once))):  # and back, twice
            for level in (*levels[::-1], *levels[1:]):
                path.go(level, rate)
    path.go(0.0)
    firsts = swings if np.ptp(swings) else swings[:1]
    return (
        f"triangles at {bounds.rates(*rates)}, {quantity(share, 's', 3)} at each, about the middle "
        f"of the range, with swings that begin with {bounds.shown(*firsts)}, shrink and grow again"
    )


def _shrinking(turns: int) -> np.ndarray:
    """Turning points of a decaying triangle of half swing one, the start included."""
    left = 1 - np.arange(turns) / turns
    return np.concatenate([[-1.0], left * (-1.0) ** np.arange(turns)])


def _decay(travel: float) -> tuple[int, float]:
    """Turns and half swing of a decaying triangle of some travel, both in parts of the range."""
    turns = 2
    while turns < MOST_TURNS and 0.5 * np.abs(np.diff(_shrinking(turns + 1))).sum() <= travel:
        turns += 1
    return turns, min(0.5, travel / np.abs(np.diff(_shrinking(turns))).sum())


def _holds(path: _Path, seconds: float) -> str:
    bounds = path.bounds
    longest = (seconds - 4 * bounds.stroke_s - 30 / bounds.rate_hz) / (2 * sum(HOLDS))
    path.loop()
    for level, part in zip((*UPWARD, *DOWNWARD), 2 * HOLDS, strict=True):
        path.go(level)
        path.hold(part * longest)
    path.go(0.0)
    upward, downward = (
        bounds.shown(*(bounds.low + bounds.span * np.array(levels)))
        for levels in (UPWARD, DOWNWARD)
    )
    times = ", ".join(quantity(part * longest, "s", 3) for part in HOLDS)
    return (
        f"holds of {times}, after moves at {bounds.rates(bounds.fastest)} upward to {upward} and, "
        f"of the same lengths, downward to {downward}"
    )


def _minor_loops(path: _Path, seconds: float) -> str:
    bounds = path.bounds
    ends = [(bias, bias + MINOR_SWING) for bias in BIASES]
    rising = [level for low, high in ends for level in (high, low, high, low, high)]
    falling = [level for low, high in reversed(ends) for level in (low, high, low, high, low)]
    levels = [0.0, *rising, 1.0, *falling, 0.0]
    travel = bounds.span * np.abs(np.diff(levels)).sum()
    rate = min(bounds.fastest, travel / (seconds - (len(levels) + 1) / bounds.rate_hz))
    for level in levels:
        path.go(level, rate)
    biases = bounds.shown(*(bounds.low + bounds.span * np.array(BIASES)))
    return (
        f"at {bounds.rates(rate)}, minor loops of {bounds.shown(MINOR_SWING * bounds.span)} that "
        f"begin at {biases}, two at each, on the rising branch and then on the falling one"
    )


def _multisine(path: _Path, seconds: float) -> str:
    bounds = path.bounds
    path.loop()
    samples = int((seconds - 4 * bounds.stroke_s) * bounds.rate_hz) - 5
    highest = min(2.6 / bounds.stroke_s, bounds.rate_hz / 8)
    lines = np.geomspace(max(1.0, highest * samples / bounds.rate_hz / 30),
                         highest * samples / bounds.rate_hz, SINES)  # fmt: skip
    lines = np.unique(np.maximum(np.round(lines), 1).astype(int))
    with jax.enable_x64(True):
        wave = np.asarray(multisine(jax.random.key(0), samples, lines.tolist(), 0.0, 1.0))
    steepest = np.abs(np.diff(wave)).max() * bounds.rate_hz * bounds.stroke_s
    amplitude = min(0.4, 1 / steepest)
    path.go(0.5 + amplitude * wave[0])
    path.wave(0.5 + amplitude * wave[1:])
    path.go(0.0)
    slowest, fastest = (
        quantity(line * bounds.rate_hz / samples, "Hz", 3) for line in lines[[0, -1]]
    )
    return (
        f"a multisine of {len(lines)} equal sines from {slowest} to {fastest}, "
        f"{bounds.shown(bounds.low + 0.5 * bounds.span)} ± {bounds.shown(amplitude * bounds.span)}"
    )


def _reference_loops(path: _Path, seconds: float) -> str:
    bounds = path.bounds
    loops = int(np.clip(seconds / bounds.stroke_s / 18, 1, 3))
    rest = seconds - 4 * loops * (bounds.stroke_s + 1 / bounds.rate_hz) - 2 / bounds.rate_hz
    for _ in range(loops):
        path.loop()
    path.hold(rest)
    for _ in range(loops):
        path.loop()
    times = ("one reference loop", "two reference loops", "three reference loops")[loops - 1]
    return (
        f"{times} ({bounds.shown(bounds.low)} to {bounds.shown(bounds.high)} and back at "
        f"{bounds.rates(bounds.fastest)}), a rest of {quantity(rest, 's', 3)}, and the same again"
    )


_PARTS: tuple[Callable[[_Path, float], str], ...] = (
    _triangles, _holds, _minor_loops, _multisine, _reference_loops,
)  # fmt: skip

_SHARES = (0.32, 0.17, 0.17, 0.17, 0.17)


def combination(path: _Path, seconds: float) -> str:
    """Draw all the others one after the other, with shares of the time; returns its text."""
    texts = [
        draw(path, share * seconds - 1 / path.bounds.rate_hz)
        for draw, share in zip(_PARTS, _SHARES, strict=True)
    ]
    return "one after the other: " + "; ".join(texts)

"""The drive for a wanted course: the chain inverted in its order, then corrected by its own error.

The effects behind the operator are inverted linearly, the operator from sample to sample, and what
acts on its input last.  What the first pass leaves (states of effects that hang on the drive, time
steps that are not even, corners) the model's own error tells, and the next pass takes away
(iterative learning control: S. Arimoto, S. Kawamura, F. Miyazaki, J. Robotic Syst. 1 (1984)
123-140, with the model in place of the stage).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from preisach_jax.compensation.branch import BranchBounds, follow, inverse
from preisach_jax.compensation.forward import Course, Forward
from preisach_jax.compensation.lead import Lead
from preisach_jax.effects.base import InputEffect, OutputEffect

MOST_PASSES = 24
"""Passes of correction; without a resonance or a lag two or three are usual."""

WIDENING_PASSES = 6
"""First passes, in which a widening is sought that agrees with the speed of the drive."""

PATIENCE = 4
"""Passes without a gain of a tenth after which no more are made."""

NEIGHBOURS = 41
"""Rows whose greatest error says whether that of the middle one gets smaller."""

BELL = np.array([1.0, 2.0, 3.0, 2.0, 1.0]) / 9
"""Mean over neighbours by which corrections of a widened operator are smoothed."""

LEAST_SLOPE = 0.2
"""Share of the mean slope that the operator is taken to have where the speed acts beside it."""

INPUT_PASSES = 8
"""Passes in which what acts on the input is inverted by itself."""


class Limits(NamedTuple):
    """What the drive may be: its least and greatest value, and its greatest rate per s."""

    low: float
    high: float
    slew: float


@dataclass(frozen=True, eq=False)
class Found:
    """A drive, and what it gives.

    Attributes:
        drive: (time,) the input.
        output: (time,) output before the sensor.
        joins: row from which on the course itself was asked for; 0 where that is its first one.
    """

    drive: np.ndarray
    output: np.ndarray
    joins: int = 0


class DriveSearch:
    """The passes of one inversion, and what they share.

    Arguments:
        wanted: (time,) wanted output before the sensor.

    Attributes:
        limits: those, with the slew of the stage itself.
        dt: (time,) time since the row before, in s.
    """

    def __init__(self, forward: Forward, wanted: np.ndarray, limits: Limits, good: float):
        self._forward, self._wanted, self._good = forward, wanted, good
        self._close = 0.05 * good
        chain, past = forward.chain, forward.past
        self.limits = limits._replace(slew=min(limits.slew, forward.greatest_rate))
        plane = chain.plane
        self._unit = (plane.high - plane.low) / plane.levels
        self._widens = chain.widens
        self.dt = np.diff(past.time, prepend=past.time[0] - past.pause_s)
        size, step_s = len(wanted), float(np.median(self.dt))
        behind = chain.at(OutputEffect)
        stroke = float(np.abs(forward.coefficients.weights).sum())
        self._behind = Lead.of(behind, forward.values, size, step_s, stroke)
        before = [e for e in chain.at(InputEffect) if not e.limits_rate]
        width = plane.high - plane.low
        beside = [pair for pair in forward.added() if pair[0].goes_with_speed]
        slope = LEAST_SLOPE * stroke / width
        self._beside = Lead.beside(beside, forward.values, size, step_s, slope)
        self._before = Lead.of(before, forward.values, size, step_s, width)
        self._leads_input = bool(before)
        self._sign = chain.polarity
        self._operator = forward.operator()

    def found(self, progress: Callable[[str, float], object] | None = None) -> Found:
        """The best drive of all passes; before each, progress is told."""
        found = self._passes(self._wanted, MOST_PASSES, progress)
        reached = np.abs(found.output - self._wanted) <= self._good
        if abs(self.away) <= self._good or reached.all():
            return found
        # A course that begins elsewhere is a jump, and what of it the limits do not let through
        # rings on: a smooth way there, of the length that the first pass does best with.
        rows = self._best_approach()
        other = self._passes(self._approaching(rows), MOST_PASSES, progress)
        better = self._size(other.output) < self._size(found.output)
        return replace(other, joins=rows) if better else found

    @property
    def away(self) -> float:
        """How far the course begins from where the output would be in its first row at rest."""
        return float(self._wanted[0] - self._resting.output[0])

    @property
    def memory(self) -> int:
        """Rows after which the effects have forgotten what the drive was."""
        return self._before.memory + self._behind.memory

    def _best_approach(self) -> int:
        """Rows of the way to the course with which the first pass does best, about."""
        sizes: dict[int, float] = {}

        def best() -> int:
            return min(sizes, key=lambda rows: sizes[rows])

        def tries(rows: int) -> None:
            sizes[rows] = self._size(self._passes(self._approaching(rows), 1).output)

        rows, most = 1, max(len(self._wanted) - 1, 1)
        while not sizes or (rows <= most and rows <= 2**PATIENCE * best()):
            tries(rows)
            rows *= 2
        around = best()
        for share in (0.6, 0.8, 1.25):
            tries(min(max(round(share * around), 1), most))
        return best()

    def _approaching(self, rows: int) -> np.ndarray:
        """The course, joined in so many rows from rest with its speed and its acceleration."""
        elapsed = np.cumsum(self.dt)
        done = np.clip(elapsed / elapsed[min(rows, len(elapsed) - 1)], 0.0, 1.0)
        share = done**3 * (10 - 15 * done + 6 * done**2)
        rest = self._resting.output
        return rest + share * (self._wanted - rest)

    def _size(self, output: np.ndarray) -> float:
        """How badly an output follows the course: a row that is far off counts little more."""
        return float(np.mean(np.log1p(((output - self._wanted) / self._good) ** 2)))

    @cached_property
    def _held(self) -> Course:
        """The model, its drive held where the past has left it."""
        return self._forward.whole(np.full(len(self._wanted), self._forward.past.last_input))

    @cached_property
    def _resting(self) -> Course:
        return self._forward.beyond_past(self._held)

    def _passes(
        self, wanted: np.ndarray, most: int, progress: Callable[[str, float], object] | None = None
    ) -> Found:
        """The best drive of so many passes for a course, or a way to it."""
        resting, state = self._resting, self._state(self._held)
        gain = self._sign * self._forward.gain(np.full(len(wanted), self._forward.past.last_input))
        aim = self._sign * resting.hysteresis
        aim = aim + self._asked(wanted - resting.output) / gain
        widening, first_run = resting.widening, self._sign * resting.first_run
        forced = np.full(len(aim), np.nan)
        best, least, tries = None, np.inf, 0
        trust, before = np.ones(len(aim)), np.full(len(aim), np.inf)
        for count in range(most):
            if progress is not None:
                progress("finding the drive", count / most)
            given, seen = self._inverted(state, aim - first_run, widening, forced)
            drive, cut = self._drive(seen, given + first_run, resting)
            course = self._forward.beyond_past(self._forward.whole(drive))
            error = wanted - course.output
            beyond = aim - first_run - given
            stopped = (np.abs(beyond) > self._close / 4) & self._at_an_end(seen, drive)
            # At an end only an error that asks for less than the aim can still be taken away.
            blocked = cut | (stopped & (beyond * error / gain >= 0))
            aim = np.where(stopped & ~blocked, given + first_run, aim)
            size = float(np.mean(np.log1p((error / self._good) ** 2)))
            tries = 0 if size < 0.9 * least else tries + 1
            if size < least:
                best, least = Found(drive, course.output), size
            left = np.where(blocked, 0.0, error)
            if self._is_enough(left) or tries > PATIENCE:
                break
            seeks = count < WIDENING_PASSES and (self._widens or bool(first_run.any()))
            forced = np.where(cut, self._positions(course.seen), np.nan)
            # What does not get smaller cannot be had there, and is no longer asked for.
            around = _greatest_nearby(np.abs(left))
            stays = (around > self._close) & (around > 0.8 * before) & (not seeks)
            trust, before = np.where(stays, trust / 2, np.minimum(1.0, 1.5 * trust)), around
            learnt = trust * self._asked(left) / gain
            if self._operator.relays:
                learnt = learnt - (aim - first_run - given)  # what no step of a relay gives
            actual = self._sign * course.hysteresis
            if seeks:
                # The model's own widening replaces the one that was assumed; of the error, only
                # what that does not explain is learnt.
                learnt = np.where(blocked, 0.0, learnt + actual - given - first_run)
                kernel = self._kernel(course)
                widening = (widening + _smoothed(course.widening, kernel)) / 2
                first_run = self._sign * course.first_run
            elif self._widens:
                learnt = _smoothed(_against_widening(learnt, self._steepness(course)), BELL)
            aim = aim + learnt
        assert best is not None
        return best

    def _asked(self, error: np.ndarray) -> np.ndarray:
        """What an error of the output asks of the operator."""
        return self._beside(self._behind(error))

    def _kernel(self, course: Course) -> np.ndarray:
        """Weights of a mean over so many rows that the widening follows the drive slowly enough."""
        box = np.ones(1 + int(np.ceil(2 * self._steepness(course))))
        return np.convolve(box, box) / len(box) ** 2

    def _steepness(self, course: Course) -> float:
        """Widening over the move of the input in a row, of a usual one."""
        moves = np.abs(np.diff(course.path))
        moving = moves > 0.1 * moves.max(initial=0.0)
        ratio = course.widening[1:][moving] / moves[moving]
        return min(float(np.median(ratio)), 20.0) if moving.any() else 0.0

    def _is_enough(self, left: np.ndarray) -> bool:
        worst, rms = np.abs(left).max(), np.sqrt(np.mean(left**2))
        return bool(worst <= self._close or (worst <= self._good and rms <= self._close))

    def _state(self, held: Course) -> tuple[jax.Array, jax.Array]:
        count = self._forward.past.count
        positions = jnp.asarray(self._positions(held.seen[:count]))
        return follow(self._operator, positions, jnp.asarray(held.widening[:count] / self._unit))

    def _positions(self, values: np.ndarray) -> np.ndarray:
        plane = self._forward.chain.plane
        return np.clip((values - plane.low) / self._unit, 0.0, plane.levels)

    def _inverted(
        self,
        state: tuple[jax.Array, jax.Array],
        aim: np.ndarray,
        widening: np.ndarray,
        forced: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Outputs of the operator along an aim, and what its hysterons must see for them."""
        plane = self._forward.chain.plane
        low, high = self._seen_limits(aim)
        step = np.where(self._feeds_back, np.inf, self.limits.slew * self.dt / self._unit)
        bounds = BranchBounds(*(jnp.asarray(b) for b in (low, high, step, forced)))
        shift = jnp.asarray(widening / self._unit)
        positions, given = inverse(self._operator, state, jnp.asarray(aim), shift, bounds)
        return np.asarray(given), plane.low + self._unit * np.asarray(positions)

    @property
    def _feeds_back(self) -> bool:
        return self._forward.chain.feeds_back

    def _seen_limits(self, aim: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Positions of the hysterons' input at the limits of the drive."""
        ends = [np.full(len(aim), end) for end in (self.limits.low, self.limits.high)]
        if self._feeds_back:
            slope, none = self._feedback(aim)
            ends = [none + slope * end for end in ends]
        low, high = (self._positions(end) for end in ends)
        return low, high

    def _feedback(self, output: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What the hysterons see of an output, as slope over the input and value at none."""
        past = self._forward.past
        count = self._forward.past.count
        before = self._sign * self._held.hysteresis[:count]
        whole = self._sign * np.concatenate([before, output])
        zero = np.zeros(past.count + len(output))
        none = self._forward.fed_back(zero, whole)[past.count :]
        one = self._forward.fed_back(zero + 1.0, whole)[past.count :]
        return one - none, none

    def _at_an_end(self, seen: np.ndarray, drive: np.ndarray) -> np.ndarray:
        """Whether the operator is where its limits hold it."""
        low, high = self.limits.low, self.limits.high
        near = 1e-9 * (high - low)
        before = np.concatenate([[self._forward.past.last_input], drive[:-1]])
        fast = np.abs(drive - before) >= self.limits.slew * self.dt * (1 - 1e-9)
        plane = self._forward.chain.plane
        ends = (seen <= plane.low + near) | (seen >= plane.high - near)
        return ends | (drive <= low + near) | (drive >= high - near) | fast

    def _drive(
        self, seen: np.ndarray, output: np.ndarray, resting: Course
    ) -> tuple[np.ndarray, np.ndarray]:
        """The drive behind which the hysterons see what they must, and where limits have cut it."""
        path = seen
        if self._feeds_back:
            slope, none = self._feedback(output)
            path = (seen - none) / slope
        drive = path
        if self._leads_input:
            count = self._forward.past.count
            drive = resting.drive + self._before(path - resting.path)
            for _ in range(INPUT_PASSES):
                cut = limited(drive, self.dt, self.limits, self._forward.past.last_input)
                error = path - self._forward.path(cut)[count:]
                drive = drive + self._before(np.where(cut == drive, error, 0.0))
        cut = limited(drive, self.dt, self.limits, self._forward.past.last_input)
        near = 1e-9 * (self.limits.high - self.limits.low)
        return cut, np.abs(cut - drive) > near


def limited(drive: np.ndarray, dt: np.ndarray, limits: Limits, last: float) -> np.ndarray:
    """A drive kept in its limits, and as near to itself as the slew lets it."""
    inside = np.clip(drive, limits.low, limits.high)
    reach = limits.slew * dt
    if np.all(np.abs(np.diff(inside, prepend=last)) <= reach):
        return inside
    kept, place = np.empty_like(inside), last
    for k, (value, most) in enumerate(zip(inside.tolist(), reach.tolist(), strict=True)):
        place = min(max(value, place - most), place + most)
        kept[k] = place
    return kept


def _against_widening(error: np.ndarray, steep: float) -> np.ndarray:
    r"""What an error asks of the input where a move m of a row widens thresholds by steep times m.

    The thresholds see \(1 - g (1 - z^{-1})\) of the input, which no causal filter inverts beyond
    g = 1; its regularised inverse looks ahead.
    """
    count = 1 << (2 * len(error)).bit_length()
    turn = np.exp(-2j * np.pi * np.arange(count // 2 + 1) / count)
    passed = 1 - steep * (1 - turn)
    inverse = np.conj(passed) / (np.abs(passed) ** 2 + 0.1)
    return np.fft.irfft(np.fft.rfft(error, count) * inverse, count)[: len(error)]


def _smoothed(values: np.ndarray, kernel: np.ndarray) -> np.ndarray:
    return np.convolve(np.pad(values, len(kernel) // 2, mode="edge"), kernel, "valid")


def _greatest_nearby(values: np.ndarray) -> np.ndarray:
    """Greatest of the values in the rows around each, `(time,)`."""
    padded = np.pad(values, NEIGHBOURS // 2, mode="edge")
    return np.lib.stride_tricks.sliding_window_view(padded, NEIGHBOURS).max(axis=1)

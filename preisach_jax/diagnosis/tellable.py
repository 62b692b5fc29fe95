"""What the excitation of a record can tell at all, asked before any effect is named.

A Preisach density takes up whatever is the same each time that the input passes a place: at one
rate a lag is a wider loop, in one cycle a drift is an open one, and in loops of one height a bent
sensor is another density.  A name would be a guess.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

from preisach_jax.chain.signals import ThinnedSignals, parts_of
from preisach_jax.diagnosis.residuals import reversals
from preisach_jax.effects.base import CYCLES, HEIGHTS, RATES, Effect
from preisach_jax.effects.spectrum import strongest_lines, without
from preisach_jax.errors import EffectError
from preisach_jax.identify.problem import Problem
from preisach_jax.look.stretches import Period

PLACES = 10
"""Parts of the input's range in which its passages are timed."""

OTHER_RATE = 1.5
"""Ratio of the times of two passages of one place from which on their rates are not the same."""

LEAST_VARIED = 0.1
"""Share of the places that must be passed at more than one rate."""

REST = 0.01
"""Share of the input's range within which it is at rest."""

LONG_REST = 3.0
"""Length of a rest over the median time of a passage, from which on it shows what is slow."""

LEAST_RESTS = 2

LEAST_PASSAGES = 2.0
"""Passages of a place in one direction, in the median, from which on there is more than one cycle.
"""

INNER = 0.1
"""Share of the input's range between its ends and a turn from which on that lies inside."""

LEAST_INNER_TURNS = 2

FEWEST_HALVES = 6
"""Half cycles of the drive from which on it can be seen whether they are regular."""

REGULAR = 0.1
"""Scatter of the half cycles' lengths, over the median, below which the drive is periodic."""

SAME_LINE = 0.003
"""Relative distance of two lines that may be one."""

DRIVE_LINES = 3
"""Lines of the input's spectrum that are looked for."""

OF_LINES = 0.9
"""Share of the input's power in these lines from which on its drive is periodic."""

HARMONICS, SUMS = 8, 3
"""Order up to which multiples of a drive's one line, or sums of several, come from the drive."""


@dataclass(frozen=True, eq=False)
class InputSurvey:
    """What an input does: how often and how fast it passes each place, and where it rests.

    Attributes:
        time: (time,) in s.
        input: (time,) in its unit.
        span: least and greatest value between which its places lie; by default its own.
    """

    time: np.ndarray
    input: np.ndarray
    span: tuple[float, float] | None = None

    def shows(self, need: str) -> bool:
        """Whether a record of this input can tell what an effect needs to be told apart."""
        if need == RATES:
            return self._varied >= LEAST_VARIED or self._rests >= LEAST_RESTS
        if need == CYCLES:
            return self._passages_of_a_place >= LEAST_PASSAGES
        if need == HEIGHTS:
            return self._inner_turns >= LEAST_INNER_TURNS
        raise EffectError(
            f"{need!r} is no need of an effect: give {RATES!r}, {CYCLES!r} or {HEIGHTS!r}"
        )

    @property
    def runs(self) -> tuple[tuple[np.ndarray, np.ndarray], ...]:
        """Time and input of each run."""
        return ((self.time, self.input),)

    @cached_property
    def cycle_s(self) -> float:
        """Time between two passages of a place in one direction, in the median."""
        passages = self._passages_of_a_place
        return float(np.ptp(self.time)) / passages if passages else np.inf

    @cached_property
    def lines_hz(self) -> tuple[float, ...]:
        """The lines of a periodic drive, the strongest first; none if it is not periodic."""
        turns = self.time[reversals(self.input, 0.1 * float(np.ptp(self.input)))]
        halves = np.diff(turns)
        if len(halves) >= FEWEST_HALVES:
            lower, middle, upper = np.quantile(halves, (0.1, 0.5, 0.9))
            if upper - lower < REGULAR * middle:
                return (0.5 / float(middle),)
        span, step = float(np.ptp(self.time)), float(np.median(np.diff(self.time)))
        lowest, highest = 2.0 / span, 0.3 / step
        if not lowest < highest:
            return ()
        values = self.input - self.input.mean()
        lines = strongest_lines(self.time, values, lowest, highest, step, DRIVE_LINES, white=True)
        if not lines:
            return ()
        phase = 2 * np.pi * np.outer(self.time, lines)
        waves = np.concatenate([np.cos(phase), np.sin(phase)], axis=1)
        left = float(np.var(without(values, waves)))
        return tuple(lines) if left < (1 - OF_LINES) * float(np.var(values)) else ()

    @cached_property
    def period(self) -> Period | None:
        """After which the input repeats itself; None if it does not."""
        return Period.of(self.time, self.input)

    def makes(self, frequency_hz: float) -> bool:
        """Whether a line may come from the drive: a sum of few multiples of the drive's lines."""
        reach = max(1.0 / float(np.ptp(self.time)), SAME_LINE * frequency_hz)
        order = HARMONICS if len(self.lines_hz) == 1 else SUMS
        for orders in product(range(-order, order + 1), repeat=len(self.lines_hz)):
            if 0 < sum(map(abs, orders)) <= order:
                made = abs(sum(k * f for k, f in zip(orders, self.lines_hz, strict=True)))
                if abs(made - frequency_hz) < reach:
                    return True
        return False

    @property
    def _ends(self) -> tuple[float, float]:
        return self.span or (float(self.input.min()), float(self.input.max()))

    @cached_property
    def _passages(self) -> dict[tuple[int, int], list[float]]:
        """Times, in s, of all passages of a place from one edge to the other, by direction."""
        low, high = self._ends
        edges = low + (high - low) * np.arange(1, PLACES) / PLACES
        place = np.searchsorted(edges, self.input, side="right")
        moves = np.flatnonzero(np.diff(place))
        passages: dict[tuple[int, int], list[float]] = {}
        last_edge, last_time = -1, 0.0
        for k in moves.tolist():
            before, after = int(place[k]), int(place[k + 1])
            up = 1 if after > before else -1
            crossed = range(before, after) if up > 0 else range(before - 1, after - 1, -1)
            for edge in crossed:
                share = (edges[edge] - self.input[k]) / (self.input[k + 1] - self.input[k])
                at = float(self.time[k] + share * (self.time[k + 1] - self.time[k]))
                if last_edge == edge - up:
                    passages.setdefault((max(edge, last_edge), up), []).append(at - last_time)
                last_edge, last_time = edge, at
        return passages

    @cached_property
    def _varied(self) -> float:
        """Share of the places and directions that are passed at more than one rate."""
        if not self._passages:
            return 0.0
        ratios = [
            np.quantile(times, 0.9) / max(float(np.quantile(times, 0.1)), np.finfo(float).tiny)
            for times in self._passages.values()
        ]
        return float(np.mean(np.array(ratios) >= OTHER_RATE))

    @cached_property
    def _passages_of_a_place(self) -> float:
        counts = [len(times) for times in self._passages.values()]
        return float(np.median(counts)) if counts else 0.0

    @cached_property
    def _inner_turns(self) -> int:
        """How often the input turns well between the ends of its range."""
        low, high = self._ends
        edge = INNER * (high - low)
        turns = self.input[reversals(self.input, edge)]
        return int(np.sum((turns > low + edge) & (turns < high - edge)))

    @cached_property
    def _rests(self) -> int:
        """How often the input rests for long."""
        times = [time for passed in self._passages.values() for time in passed]
        if not times:
            return 0
        cell = np.round(self.input / (REST * max(float(np.ptp(self.input)), 1e-300)))
        begins = np.flatnonzero(np.diff(cell, prepend=np.nan) != 0)
        lengths = np.diff(np.append(self.time[begins], self.time[-1]))
        return int(np.sum(lengths > LONG_REST * float(np.median(times))))


@dataclass(frozen=True, eq=False)
class JoinedSurvey(InputSurvey):
    """What the inputs of several records do together; nothing counts from one to the next.

    Attributes:
        parts: what that of each does.
    """

    parts: tuple[InputSurvey, ...] = ()

    @staticmethod
    def of(parts: Sequence[InputSurvey]) -> JoinedSurvey:
        """The survey of several, whose places are those of the range of all."""
        whole = np.concatenate([part.input for part in parts])
        span = float(whole.min()), float(whole.max())
        alike = tuple(InputSurvey(part.time, part.input, span) for part in parts)
        return JoinedSurvey(np.concatenate([part.time for part in parts]), whole, span, alike)

    @property
    def runs(self) -> tuple[tuple[np.ndarray, np.ndarray], ...]:
        return tuple(run for part in self.parts for run in part.runs)

    @cached_property
    def period(self) -> Period | None:
        return None

    @cached_property
    def cycle_s(self) -> float:
        passages = self._passages_of_a_place
        spans = sum(float(np.ptp(part.time)) for part in self.parts)
        return spans / passages if passages else np.inf

    def makes(self, frequency_hz: float) -> bool:
        return any(part.makes(frequency_hz) for part in self.parts)

    @cached_property
    def _passages(self) -> dict[tuple[int, int], list[float]]:
        passages: dict[tuple[int, int], list[float]] = {}
        for part in self.parts:
            for place, times in part._passages.items():
                passages.setdefault(place, []).extend(times)
        return passages

    @cached_property
    def _inner_turns(self) -> int:
        return sum(part._inner_turns for part in self.parts)

    @cached_property
    def _rests(self) -> int:
        return sum(part._rests for part in self.parts)


def surveyed(problem: Problem) -> InputSurvey:
    """What the input of a record does, before it was thinned; found once."""
    slot = ("input survey",)
    if slot not in problem.cache:
        surveys: list[InputSurvey] = []
        for signals in parts_of(problem.signals):
            whole = signals.whole if isinstance(signals, ThinnedSignals) else signals
            surveys.append(InputSurvey(np.asarray(whole.time), np.asarray(whole.input)))
        problem.cache[slot] = JoinedSurvey.of(surveys) if len(surveys) > 1 else surveys[0]
    return problem.cache[slot]


REASONS = {
    RATES: "not tried: the input passes each place at one rate only, so that the density absorbs "
    "whatever depends on the rate",
    CYCLES: "not tried: the input passes each place hardly more than once, so that the density "
    "absorbs whatever changes with time",
    HEIGHTS: "not tried: all loops of the input are of one height, so that the density absorbs "
    "whatever bends them",
}


def untellable(problem: Problem, effect: Effect) -> str:
    """Why a record cannot tell an effect from the density; empty if it can."""
    missing = [need for need in effect.needs if not surveyed(problem).shows(need)]
    return REASONS[missing[0]] if missing else ""


MOST_HIDDEN = 0.5
"""Share of the effects that were tried which a record cannot tell, from which on it must be said
that it could not show what is missing."""


def shows_little(problem: Problem, tried: Sequence[Effect]) -> bool:
    """Whether a record cannot tell most of some effects from the density."""
    hidden = sum(bool(untellable(problem, effect)) for effect in tried)
    return hidden > MOST_HIDDEN * len(tried)


def notes(problem: Problem, tried: Sequence[Effect]) -> tuple[str, ...]:
    """What a reader must know of the effects that a record cannot tell, one sentence a need."""
    told: list[str] = []
    passes = "The input passes each place"
    for need, what, remedy in (
        (
            RATES,
            f"{passes} at one rate only",
            "Record the same loops at three rates, or with rests.",
        ),
        (CYCLES, f"{passes} hardly more than once", "Record at least three cycles."),
        (HEIGHTS, "All loops of the input are of one height", "Record minor loops at five biases."),
    ):
        names = [effect.name for effect in tried if need in effect.needs]
        if names and not surveyed(problem).shows(need):
            verb = "is" if len(names) == 1 else "are"
            told.append(
                f"{what}: {', '.join(names)} cannot be told from the density of hysterons, and "
                f"{verb} not named. {remedy}"
            )
    return tuple(told)

"""Why a drive does not give its course in some rows, and the advice that fits each cause."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np

from preisach_jax.compensation.search import Found, Limits
from preisach_jax.effects.base import HysteresisEffect, InputEffect, OutputEffect
from preisach_jax.model import Model
from preisach_jax.quantity import number, pretty_unit, quantity
from preisach_jax.record.marks import spans


class Cause(Enum):
    """What keeps an output from its course."""

    NONE = 0
    BEGINNING = 1
    RANGE = 2
    SLEW = 3
    LIMITS = 4
    SPEED = 5


@dataclass(frozen=True, eq=False)
class Attempt:
    """A course, the drive that was found for it, and what it was held to.

    Attributes:
        wanted: (time,) the course, as the sensor reads it.
        error: (time,) by how much its output before the sensor misses it.
        found: the drive.
        good: error within which an output counts as reached.
        away: how far the course begins from where the output would be at rest.
        memory: rows after which the effects have forgotten what the drive was.
        limits: of the drive, with the slew of the stage itself.
        dt: (time,) time since the row before, in s.
        last: the input in the row before the first.
        span: least and greatest output of a drive that goes from one limit to the other.
    """

    wanted: np.ndarray
    error: np.ndarray
    found: Found
    good: float
    away: float
    memory: int
    limits: Limits
    dt: np.ndarray
    last: float
    span: tuple[float, float]

    @property
    def reached(self) -> np.ndarray:
        """(time,) bool: whether the output is as wanted."""
        return np.abs(self.error) <= self.good

    @property
    def beyond(self) -> np.ndarray:
        """(time,) bool: whether the course is outside what the limits let the output reach."""
        low, high = self.span
        return (self.wanted < low - self.good) | (self.wanted > high + self.good)

    def causes(self) -> np.ndarray:
        """(time,) `Cause` of each row.

        What rings on after the drive was held has the cause of that, for as long as it does: rows
        that are not reached belong together where the effects remember from one to the next.  The
        leads look ahead, so that the rows before the first of these have its cause as well.
        """
        held = self._held()
        causes = np.full(len(self.wanted), Cause.NONE)
        stretches = list[tuple[int, int]]()
        for first, behind in spans(~self.reached):
            if stretches and first - stretches[-1][1] <= self.memory:
                stretches[-1] = (stretches[-1][0], behind)
            else:
                stretches.append((first, behind))
        approach = self.approach
        for first, behind in stretches:
            known = [row for row in range(max(first, approach), behind) if held[row]]
            begins = first <= approach and abs(self.away) > self.good
            then = Cause.BEGINNING if begins else held[known[0]] if known else Cause.SPEED
            for row in range(first, behind):
                then = held[row] if row >= approach and held[row] else then
                causes[row] = Cause.RANGE if self.beyond[row] else then
        causes[self.reached] = Cause.NONE
        return causes

    @property
    def approach(self) -> int:
        """Rows at the beginning in which the course is not reached as it begins elsewhere."""
        if abs(self.away) <= self.good:
            return 0
        later = self.reached[self.found.joins :]
        return self.found.joins + int(np.argmax(later)) if later.any() else len(later)

    def _held(self) -> list[Cause | None]:
        """By what the drive is held in each row."""
        drive, limits = self.found.drive, self.limits
        before = np.concatenate([[self.last], drive[:-1]])
        near = 1e-9 * (limits.high - limits.low)
        fast = np.abs(drive - before) >= limits.slew * self.dt * (1 - 1e-9)
        at_end = (drive <= limits.low + near) | (drive >= limits.high - near)
        marks = zip(self.beyond, fast, at_end, strict=True)
        return [
            Cause.RANGE if out else Cause.SLEW if quick else Cause.LIMITS if end else None
            for out, quick, end in marks
        ]


def sentences(model: Model, attempt: Attempt, asked_slew: float) -> list[str]:
    """What an owner must know of a course that cannot be reached, each cause with its advice."""
    notes = list[str]()
    if abs(attempt.away) > attempt.good:
        notes.append(_beginning(model, attempt))
    if attempt.reached.all():
        return notes
    unit, in_unit = model.units.get("output", ""), pretty_unit(model.units.get("input", ""))
    missed, causes = np.abs(attempt.error), attempt.causes()
    row, first = int(np.argmax(missed)), int(np.argmin(attempt.reached))
    notes.insert(
        0,
        f"the wanted output cannot be reached in {int((~attempt.reached).sum()):,} of "
        f"{len(missed):,} rows, first in row {first + 1}, by up to {quantity(missed[row], unit)} "
        f"(row {row + 1}): there the drive comes as near as it can, and reachable is 0",
    )
    low, high, slew = attempt.limits
    drive = f"a drive from {low:g} to {high:g} {in_unit}".rstrip()
    rate = f"{slew:g} {in_unit}/s" if in_unit else f"{slew:g} per s"
    names = " and ".join(_that_lag(model))
    fast = f"the course asks for a motion faster than {names} lets it follow: slow it down there"
    ends = [quantity(end, unit) for end in attempt.span]
    least, most = (quantity(f(attempt.wanted), unit) for f in (np.min, np.max))
    whose = "the slew" if slew == asked_slew else "the slew limit of the stage"
    remedy = "raise it, or slow the course down there" if slew == asked_slew else "slow it down"
    narrow = low > model.plane.low or high < model.plane.high
    said = {
        Cause.RANGE: f"{drive} moves the output from {ends[0]} to {ends[1]}, and the course asks "
        f"for {least} to {most}: keep it within that range" + ", or widen the limits" * narrow,
        Cause.SLEW: f"{whose}, {rate}, holds the drive back in the course: {remedy}",
        Cause.LIMITS: f"{drive} is at its ends there"
        + (f", as {fast}" + ", or widen the limits" * narrow if names else ""),
        Cause.SPEED: fast if names else "no drive comes nearer there",
    }
    counts = {cause: int((causes == cause).sum()) for cause in said}
    return notes + [
        f"{text} ({_rows(counts[cause])})" for cause, text in said.items() if counts[cause]
    ]


def _that_lag(model: Model) -> list[str]:
    """Names of the effects that hold an output back from a fast motion."""
    chain = model.chain
    inside = [effect for effect in chain.at(HysteresisEffect) if effect.widens]
    before = [effect for effect in chain.at(InputEffect) if not effect.limits_rate]
    return [effect.name for effect in (*before, *inside, *chain.at(OutputEffect))]


def _rows(count: int) -> str:
    return "1 row" if count == 1 else f"{count:,} rows"


def _beginning(model: Model, attempt: Attempt) -> str:
    unit, rows = model.units.get("output", ""), attempt.approach
    stroke = float(np.abs(model.weights).sum())
    share = f"{number(100 * abs(attempt.away) / stroke, 2)} % of the stroke"
    start = (
        f"the course begins {quantity(abs(attempt.away), unit)} ({share}) away from where the "
        f"stage is, {quantity(attempt.wanted[0] - attempt.away, unit)}"
    )
    if attempt.beyond[0]:
        return f"{start}, and outside the range that the drive reaches"
    if not rows:
        return f"{start}: the drive jumps there in its first row"
    lasts = quantity(float(attempt.dt[:rows].sum()), "s")
    return (
        f"{start}: the drive takes {lasts} to get there ({_rows(rows)}); begin the course where "
        "the stage is"
    )

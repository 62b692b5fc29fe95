"""Stretches in which a sensor does not read its stage: stuck, at the end of its range, wrapped."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from preisach_jax.record.core import Record
from preisach_jax.record.marks import spans

Kind = Literal["stuck", "clipped", "wrapped"]

EQUAL_SAMPLES = 8
"""Equal readings in a row, at least, that are no chance."""

MOVED = 0.05
"""Share of its range by which the input must move meanwhile."""

MOST_EQUAL = 0.25
"""Share of the rows in such runs, but the longest two, from which on the output itself rests, as
behind backlash."""

NEVER_FREE = 0.5
"""Share of its range by which the input moves while an output stands still to the end of the
record, from which on the sensor is stuck although nothing shows that it comes free."""

SHARP = 0.5
"""Share of the usual slope with which an output runs into the end of its sensor; into saturation it
runs ever more slowly."""

RELEASED = 0.3
"""Share of what was missed meanwhile that an output jumps by when a sensor comes free."""

NEAR = 12
"""Samples beside a run in which its slope is measured."""

GREAT_JUMP = 0.5
"""Share of its range by which an output jumps in one sample when its counter wraps."""

DRIVEN = 0.2
"""Share of its range by which the input moves meanwhile, from which on a jump is its doing."""

AGAINST = 0.55
"""Share of such jumps, at least, that go against the way of the output."""

ALIKE = 0.3
"""Relative difference of jumps of one counter."""


class Fault(NamedTuple):
    """Rows `start` up to, not including, `stop`, in which an output is not that of the stage."""

    kind: Kind
    start: int
    stop: int


def faults(record: Record) -> tuple[Fault, ...]:
    """Stretches of the output that are the sensor's and not the stage's.

    Stuck: one value is read on and on while the input moves by `MOVED` of its range, and at the end
    the output jumps to where it is, or the record ends.  Clipped: the same at the greatest or the
    least of all readings, reached at `SHARP` of the usual slope or more.  Wrapped: jumps of one
    size, over `GREAT_JUMP` of the range, against the way of the output and without a jump of the
    input, lead there and back; of its levels the one with most rows is the stage's.

    An output that rests by itself, as behind backlash or in a simulation without noise, does so in
    many runs (`MOST_EQUAL`), or goes on from where it was; it has no faults.
    """
    output = record.output[record.measured]
    if len(output) < 4 * NEAR or not np.ptp(output):
        return ()
    rows = np.flatnonzero(record.measured)
    found = [*_constant(record, rows, output), *_wrapped(record, rows, output)]
    return tuple(sorted(found, key=lambda fault: fault.start))


def _slope(path: np.ndarray, output: np.ndarray, row: int, way: int, span: float) -> float:
    """Output per input from a row backwards or forwards, until the input has moved by `MOVED`."""
    count = len(path)
    end = row
    while 0 <= end + way < count and (
        abs(end - row) < NEAR or abs(path[end] - path[row]) < MOVED * span
    ):
        end += way
    moved = abs(float(path[end] - path[row]))
    return abs(float(output[end] - output[row])) / moved if moved else 0.0


def _constant(record: Record, rows: np.ndarray, output: np.ndarray) -> list[Fault]:
    path = record.input[rows]
    runs = [
        (start, stop + 1)
        for start, stop in spans(np.diff(output) == 0)
        if stop + 1 - start >= EQUAL_SAMPLES
    ]
    longest = sum(sorted(stop - start for start, stop in runs)[-2:])
    rested = sum(stop - start for start, stop in runs)
    low, high = float(output.min()), float(output.max())
    at_ends = sum(stop - start for start, stop in runs if output[start] in (low, high))
    # Between the ends of its range a sensor reads what moves.
    between = len(output) - at_ends
    if rested - at_ends - longest > MOST_EQUAL * between or between < 4 * NEAR:
        return []
    span = float(np.ptp(path))
    # Where noise makes neighbours differ, equal ones tell even if the input hardly moves.
    inner = output[(output > low) & (output < high)]
    is_noisy = np.count_nonzero(np.diff(inner) == 0) < MOVED * len(inner)
    moves = [float(np.ptp(path[start:stop])) / span for start, stop in runs]
    moving = [run for run, move in zip(runs, moves, strict=True) if move > MOVED]
    ends = [
        run
        for run, move in zip(runs, moves, strict=True)
        if output[run[0]] in (low, high) and move > (MOVED / 10 if is_noisy else MOVED)
    ]
    usual = (high - low) / span
    found: list[Fault] = []
    rails: set[float] = set()
    for start, stop in ends:
        before = _slope(path, output, start, -1, span)
        after = _slope(path, output, stop - 1, 1, span)
        if max(before, after) >= SHARP * usual:
            rails.add(float(output[start]))
    for start, stop in moving:
        if stop < len(output) and output[start] not in rails:
            missed = usual * abs(float(path[stop] - path[start]))
            jump = abs(float(output[stop] - output[stop - 1]))
            if jump > RELEASED * max(missed, MOVED * (high - low)):
                found.append(Fault("stuck", int(rows[start]) + 1, int(rows[stop - 1]) + 1))
        elif output[start] not in rails and np.ptp(path[start:stop]) > NEVER_FREE * span:
            found.append(Fault("stuck", int(rows[start]) + 1, int(rows[stop - 1]) + 1))
    at_rails = spans(np.isin(output, list(rails)))
    return found + [Fault("clipped", int(rows[b]), int(rows[e - 1]) + 1) for b, e in at_rails]


def _wrapped(record: Record, rows: np.ndarray, output: np.ndarray) -> list[Fault]:
    moves = np.diff(output)
    great = np.abs(moves) > GREAT_JUMP * np.ptp(output)
    # An output follows an input that jumps, as reversal curves do from saturation.
    driven = np.abs(np.diff(record.input[rows])) > DRIVEN * np.ptp(record.input)
    great &= ~driven
    jumps = np.flatnonzero(great)
    if len(jumps) < 2:
        return []
    size = float(np.median(np.abs(moves[jumps])))
    if np.any(np.abs(np.abs(moves[jumps]) - size) > ALIKE * size):
        return []
    steady = np.where(great, 0.0, moves)
    ways = [float(np.sum(steady[max(k - NEAR, 0) : k + NEAR + 1])) for k in jumps.tolist()]
    # Noise takes a reading to and fro across the end of its counter.
    if np.mean(np.sign(moves[jumps]) * np.sign(ways) < 0) < AGAINST:
        return []
    turn = np.zeros(len(output), int)
    turn[jumps + 1] = -np.sign(moves[jumps])
    turns = np.cumsum(turn)
    values, counts = np.unique(turns, return_counts=True)
    own = values[np.argmax(counts)]
    off = spans(turns != own)
    if max(stop - start for start, stop in off) < EQUAL_SAMPLES:
        return []  # spikes
    return [Fault("wrapped", int(rows[start]), int(rows[stop - 1]) + 1) for start, stop in off]

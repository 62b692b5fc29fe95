"""Samples that stand out alone, as a bad contact or a lost bit makes them."""

from __future__ import annotations

import numpy as np
import scipy

from preisach_jax.record.core import Record
from preisach_jax.record.course import middle_range, resolution, spread

WINDOW = 9
"""Samples over which a running median follows what a model leaves: it passes by spikes of up to
four samples, and keeps the edges of steps."""

LEAST_ROWS = 4 * WINDOW
"""Measured samples below which there is no course to stand out of."""

LEAST_SIGMAS = 7.0
"""Least height of a spike in standard deviations of what the running median leaves elsewhere."""

LEAST_SHARE = 1e-3
"""Least height of a spike as a share of the output's range."""

SHARPEST = (0.1, 0.01)
"""Shares of the samples, those at the sharpest bends, by which it is judged how a model follows."""

MARGIN = 5.0
"""Times what a model usually misses of a bend that it may miss at one."""

MOST = 0.05
"""Share of the samples beyond which what stands out is no exception."""

MOST_IN_COMPANY = 0.3
"""Share of what stands out that may lie within `WINDOW` samples of more of it, beside what does by
chance: ringing comes in trains."""

LEAST_JUMP = 0.7
"""Share of its height that a spike must rise and fall within one sample: bumps take longer."""

OUT_OF_COMPANY = 2.0
"""Times the highest of a train that a spike beside trains must be."""

LEAST_INPUT_SHARE = 0.01
"""Least height of a spike of the input as a share of the input's range."""

BESIDE = 5
"""Samples before a spike of the input, and from it on, whose mean outputs are compared: a stage
that is slower than its sampling has begun to answer by then."""

STEEPER = 2.0
"""Times the usual step around it that a spike is high: the peak of a fast course is not."""

NOT_MODELLED = 0.7
"""Share of the height of a sample that stands out of the output's course, which a model must miss:
else it is a peak that the model follows."""

AT_ONCE = 0.25
"""Share of what the stage's gain lets expect, by which a fast output answers in the same sample."""

ANSWERED = 3.0
"""Standard errors of that comparison beyond which the output answers, and the input did move."""


def gross_spikes(record: Record) -> np.ndarray:
    """Where the output leaves its course by more than its range, whatever a model says."""
    rows = np.flatnonzero(record.measured)
    if len(rows) < LEAST_ROWS:
        return np.zeros(len(record), dtype=bool)
    output = record.output[rows]
    return _among(record, rows, output, _height(output), middle_range(output))


def isolated_spikes(record: Record, modelled: np.ndarray) -> np.ndarray:
    """Where the output leaves its course for a few samples, and nothing else moves.

    What a model leaves is compared with its running median.  A spike is higher than the noise, than
    a thousandth of the range, and than what the model misses where the course bends as it does
    there: what comes a few samples late looks like a spike.  Or the output itself steps there by
    more than it does around, and the model does not.  What is frequent, or comes in trains as
    ringing does, is no spike.
    """
    rows = np.flatnonzero(record.measured)
    if len(rows) < LEAST_ROWS:
        return np.zeros(len(record), dtype=bool)
    output = record.output[rows]
    residual = output - modelled[rows]
    height = _height(residual)
    floor = max(LEAST_SHARE * middle_range(output), 2 * resolution(output))
    bend = _bend(modelled[rows]) + _bend(_median(output))
    least = _least(height, floor) + _missed(height, bend) * bend
    beside_the_model = _among(record, rows, residual, height, least)
    # However bad the model is where it bends: what its own course does not show is not its doing.
    own = _height(output)
    alone = own > _least_alone(output, own, LEAST_SHARE)
    least = np.where(alone, NOT_MODELLED * own, np.inf)
    return beside_the_model | _among(record, rows, residual, height, least)


def input_spikes(record: Record) -> np.ndarray:
    """Where the input leaves its course for a few samples, and the output does not answer.

    One that the output answers is a pulse of the drive.
    """
    if record.measured.sum() < LEAST_ROWS:
        return np.zeros(len(record), dtype=bool)
    height = _height(record.input)
    least = _least_alone(record.input, height, LEAST_INPUT_SHARE)
    spikes = _among(record, np.arange(len(record)), record.input, height, least)
    for start, stop in zip(*_runs(spikes), strict=True):
        # Where nothing was measured the input is told for the sake of the memory.
        spikes[start:stop] = record.measured[start:stop].all()
    return spikes & ~_answered(record, spikes) if spikes.any() else spikes


def _answered(record: Record, spikes: np.ndarray) -> np.ndarray:
    """(time,) spikes of the input with which the output moves: each at once, or all of the rest.

    A stage that is slower than its sampling shows its answer to one pulse in no sample, but in the
    mean of several samples after many.
    """
    mended = record.bridged(spikes).input
    rose, expected = (_rise(course) for course in (record.output, mended))
    known = np.isfinite(rose)
    if not expected[known].any():
        return np.zeros_like(spikes)
    gain = rose[known] @ expected[known] / (expected[known] @ expected[known])
    jumped = gain * (record.input - mended)
    bridge = known & ~spikes & record.measured
    beside = np.interp(record.time, record.time[bridge], record.output[bridge])
    at_once = np.sign(jumped) * (record.output - beside)
    noise = spread(np.abs(np.diff(record.output[bridge], 2)))
    pulses = np.zeros_like(spikes)
    for start, stop in zip(*_runs(spikes), strict=True):
        share = AT_ONCE * np.median(np.abs(jumped[start:stop]))
        pulses[start:stop] = np.median(at_once[start:stop]) > max(share, ANSWERED * noise)
    rest = spikes & ~pulses
    if not rest.any():
        return pulses
    if np.median(at_once[rest]) > AT_ONCE * np.median(np.abs(jumped[rest])):
        return spikes
    left = rose - gain * expected
    moved = (np.sign(jumped) * left)[rest & known]
    if not moved.any():
        return pulses
    # Of an output that rests for most of a record, any motion is an answer.
    usual = max(spread(np.abs(left[known])), 1e-9 * np.abs(moved).max())
    # An output that has spikes of its own answers by no more than it usually moves.
    score = np.clip(moved / usual, -ANSWERED, ANSWERED).sum() / np.sqrt(len(moved))
    return spikes if score >= ANSWERED else pulses


def _rise(course: np.ndarray) -> np.ndarray:
    """Mean of each sample and the next ones minus that of those before it; NaN where none is."""
    there = np.isfinite(course)
    sums = np.concatenate([[0.0], np.cumsum(np.where(there, course, 0.0))])
    counts = np.concatenate([[0], np.cumsum(there)])
    here = np.arange(len(course))
    before, after = np.maximum(here - BESIDE, 0), np.minimum(here + BESIDE, len(course))
    with np.errstate(invalid="ignore", divide="ignore"):
        return (sums[after] - sums[here]) / (counts[after] - counts[here]) - (
            sums[here] - sums[before]
        ) / (counts[here] - counts[before])


def _height(course: np.ndarray) -> np.ndarray:
    """By how much each sample departs from the running median."""
    return np.abs(course - _median(course))


def _least(height: np.ndarray, floor: float) -> float:
    """Height above which a sample is no noise; `floor` at least."""
    return max(LEAST_SIGMAS * spread(height), floor)


def _least_alone(course: np.ndarray, height: np.ndarray, share: float) -> np.ndarray:
    """Height above which a sample is neither noise nor a fast peak of a course."""
    steps = np.abs(np.diff(course, prepend=course[:1]))
    usual = scipy.ndimage.percentile_filter(steps, 75, 2 * WINDOW + 1)
    return np.maximum(_least(height, share * middle_range(course)), STEEPER * usual)


def _among(
    record: Record,
    rows: np.ndarray,
    course: np.ndarray,
    height: np.ndarray,
    least: np.ndarray | float,
) -> np.ndarray:
    """(time,) which of some rows stand out of a course, and neither often nor in trains."""
    found = np.zeros(len(record), dtype=bool)
    jump = np.abs(np.diff(course, prepend=course[:1], append=course[-1:]))
    high = height > least
    rises = np.flatnonzero(high & (jump[:-1] > LEAST_JUMP * height))
    falls = np.flatnonzero(high & (jump[1:] > LEAST_JUMP * height))
    # Beside a spike at a turning point the median departs from the course itself.
    starts, stops = _runs(high)
    first = np.append(rises, len(course))[np.searchsorted(rises, starts)]
    last = np.append(-1, falls)[np.searchsorted(falls, stops)]
    starts, stops = first[first <= last], last[first <= last] + 1
    if not len(starts) or (stops - starts).sum() > MOST * len(rows):
        return found
    highest = np.array(
        [height[start:stop].max() for start, stop in zip(starts, stops, strict=True)]
    )
    near = starts[1:] - stops[:-1] < WINDOW
    in_company = np.concatenate([[False], near]) | np.concatenate([near, [False]])
    by_chance = 1 - np.exp(-2 * WINDOW * len(starts) / len(rows))
    kept = np.ones(len(starts), dtype=bool)
    if in_company.mean() > MOST_IN_COMPANY + by_chance:
        kept = ~in_company & (highest > OUT_OF_COMPANY * highest[in_company].max())
    for start, stop in zip(starts[kept], stops[kept], strict=True):
        found[rows[start:stop]] = True
    return found


def _runs(mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First sample of each stretch where a mask holds, and the first one after it."""
    edges = np.diff(mask.astype(int), prepend=0, append=0)
    return np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)


def _missed(height: np.ndarray, bend: np.ndarray) -> float:
    """Share of the sharpest bends that a model may miss around them, with a margin; at most 1."""
    # The second highest: a spike at a bend is not what the model misses of it.
    around = scipy.ndimage.rank_filter(height, -2, WINDOW)
    order = np.argsort(bend)
    missed = [0.0]
    for share in SHARPEST:
        rows = order[len(order) - max(int(share * len(order)), 2 * WINDOW) :]
        rows = rows[bend[rows] > 0]
        if len(rows):
            missed.append(float(np.quantile(around[rows] / bend[rows], 0.75)))
    return min(1.0, MARGIN * max(missed))


def _median(values: np.ndarray) -> np.ndarray:
    return scipy.ndimage.median_filter(values, WINDOW, mode="nearest")


def _bend(course: np.ndarray) -> np.ndarray:
    """By how much a course leaves a straight line within half a window to either side."""
    half = WINDOW // 2
    ends = np.pad(course, half, mode="edge")
    bend = np.abs(ends[2 * half :] - 2 * course + ends[: -2 * half])
    return scipy.ndimage.maximum_filter1d(bend, WINDOW)

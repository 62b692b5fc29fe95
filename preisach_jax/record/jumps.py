"""Jumps of a sensor: from one sample to the next its readings are elsewhere, and stay there."""

from __future__ import annotations

import numpy as np
import scipy
from numpy.lib.stride_tricks import sliding_window_view

from preisach_jax.record.core import Record
from preisach_jax.record.course import middle_range, resolution, spread

SIDE = 8
"""Samples on either side of a jump along which a straight line is fitted."""

WIDER = (SIDE, 32, 128, 512)
"""Samples on either side from which the height of a jump is estimated, whichever says it best."""

AROUND = 48
"""Samples on either side among which a jump must stand out."""

LEAST_SIGMAS = 8.0
"""Least height of a jump in standard deviations of what the same statistic is elsewhere."""

STANDS_OUT = 5.0
"""Least height in what three quarters of the samples around it stay below."""

LEAST_SHARE = 5e-4
"""Least height as a share of the output's range."""

STEPS = 3.0
"""Least height in steps of the output's converter."""

AT_ONCE = 0.7
"""Share of its height by which the output itself must jump within one sample."""

GAIN = 3.0
"""Times the ratio of its range to the input's by which an output may answer a jump of the input."""

COLUMN_SIDE, OF_COLUMN = 32, 4.0
"""Samples on either side from which it is seen whether an auxiliary column jumps, and standard
deviations above which it does: a column may be noisier than what it does."""

LATE = 20
"""Samples by which a column may be recorded late."""

AFTER, AFTER_ONE = 200, 20
"""Samples within which it may answer; fewer once the sensor is known to jump."""

FEW = 3
"""Jumps below which their ways say nothing."""

MOST_ALONG = 0.8
"""Share of the jumps that may go the way of the output, as those of relays and of what sticks and
slips do."""

STAYS_AGAINST = 0.1
"""Share of its height by which what a model leaves is still off at the next jump, on the average,
where the sensor jumps either way, or is known to jump."""

STAYS, FALLS = 0.4, 0.2
"""The same where jumps are few or nearly all go the way of the output; what a model leaves must
then fall by such a share of its square without them."""

SURE = 2.0
"""Times the standard error that lines tell: they are chosen for the least one, and noise has a
longer memory than they see."""

CORRECTED = 0.25
"""Standard errors by which the height of a jump that was taken back is corrected."""

MOST = 5e-3
"""Share of the samples beyond which jumps belong to what is measured."""

MOST_JUMPS = 200
"""Jumps beyond which a sensor measures nothing."""

CLEAR = 4.0
"""Standard errors of a rise from which on a course goes up or down."""

ENOUGH_ROWS = 50_000
"""Samples of a record by which it is seen whether jumps stay."""

LEAST_ROWS = 4 * AROUND
"""Measured samples below which there is no course to jump from."""


def jumps(record: Record, modelled: np.ndarray) -> np.ndarray:
    """By how much the output is off from a row on, as if its sensor had slipped.

    On either side of each pair of samples a straight line is fitted to what a model leaves; a jump
    is where the two lines lie apart by more than noise and misfit let them elsewhere and around,
    and where the output itself jumps in that sample.  It is not the sensor's where the input or an
    auxiliary column jumped about then.  Relays, and what sticks and slips, jump the way that the
    output goes, and a model catches up with them: what a sensor is off by stays.  Jumps that were
    taken back before are corrected where this model tells their heights better.

    Returns (time, 2) heights of new jumps and corrections of known ones, and their standard errors.
    """
    found = np.zeros((len(record), 2))
    rows = np.flatnonzero(record.measured)
    if len(rows) < LEAST_ROWS:
        return found
    residual = record.output[rows] - modelled[rows]
    at = _apart(record, rows, residual)
    rows_of_known = np.searchsorted(rows, list(record.jumps)).tolist()
    known = {
        k: jump.error
        for k, jump in zip(rows_of_known, record.jumps.values(), strict=True)
        if SIDE <= k <= len(rows) - SIDE
    }
    edges = np.union1d(at, np.array(list(known), dtype=int))
    heights, errors = _heights(residual, edges)
    # A model that tells a height worse than one before would take its correction back.
    before = np.array([known.get(k, np.inf) for k in edges.tolist()])
    taken = (errors < before) & (np.abs(heights) > CORRECTED * errors)
    is_new = np.isin(edges, at)
    taken[is_new] = _of_sensor(record, rows, residual, at, heights[is_new])
    found[rows[edges[taken]]] = np.stack([heights, errors], axis=1)[taken]
    return found


def wander_rms(record: Record) -> float:
    """RMS by which the level of a record is open, since the heights of its jumps are."""
    total = 0.0
    for rows in record.stretches:
        inside = [row for row in record.jumps if rows.start <= row < rows.stop]
        later = (rows.stop - np.array(inside)) / len(record)
        errors = np.array([record.jumps[row].error for row in inside])
        # Of a step between two levels around their mean, on shares a and b of the samples.
        total += float(np.sum(errors**2 * later * ((rows.stop - rows.start) / len(record) - later)))
    return total**0.5


def _of_sensor(
    record: Record, rows: np.ndarray, residual: np.ndarray, at: np.ndarray, heights: np.ndarray
) -> np.ndarray:
    """(jump,) which of the jumps found are those of a sensor."""
    output, drive = record.output[rows], record.input[rows]
    after = AFTER_ONE if record.jumps else AFTER
    unasked = np.abs(heights) > _answer(record, after)[rows[at]]
    turning = np.array([_bends(output, drive, k) for k in at.tolist()], dtype=bool)
    along = np.array([_way_on(output, k) for k in at.tolist()]) * heights > 0
    clear = unasked & ~turning
    count = np.count_nonzero(clear)
    if not count or len(at) > min(MOST * len(rows), MOST_JUMPS):
        return np.zeros(len(at), dtype=bool)
    stays, falls = _stays(residual, at[clear], heights[clear])
    against = bool(record.jumps) or (count >= FEW and np.mean(along[clear]) <= MOST_ALONG)
    if stays < (STAYS_AGAINST if against else STAYS) or (not against and falls < FALLS):
        return np.zeros(len(at), dtype=bool)
    # Dry friction jumps at every turn, the way that the output goes on.
    at_turns = unasked & turning & along
    return unasked if np.count_nonzero(at_turns) <= count else unasked & ~at_turns


def _stays(residual: np.ndarray, at: np.ndarray, heights: np.ndarray) -> tuple[float, float]:
    """Share of the jumps that stays to the end, and by which share of its square a residual falls.

    Both by least squares of all samples over steps at the jumps.
    """
    rows = np.arange(0, len(residual), max(1, len(residual) // ENOUGH_ROWS))
    steps = (rows[:, None] >= at).astype(float)
    steps -= steps.mean(axis=0)
    off = residual[rows] - residual[rows].mean()
    stay = np.asarray(np.linalg.lstsq(steps, off, rcond=None)[0], dtype=float)
    left = off - steps @ stay
    power = float(off @ off)
    return float(heights @ stay / (heights @ heights)), 1 - float(left @ left) / power


def _apart(record: Record, rows: np.ndarray, residual: np.ndarray) -> np.ndarray:
    """Measured samples before which what a model leaves jumps, and the output with it."""
    output = record.output[rows]
    step = _step(residual, SIDE)
    size = np.abs(step)
    around = scipy.ndimage.percentile_filter(size, 75, 2 * AROUND + 1)
    floor = max(
        LEAST_SIGMAS * spread(size), LEAST_SHARE * middle_range(output), STEPS * resolution(output)
    )
    highest = size == scipy.ndimage.maximum_filter1d(size, 2 * SIDE + 1)
    found = highest & (size > np.maximum(floor, STANDS_OUT * around))
    own = np.diff(output, prepend=output[:1]) - _usual_move(output)
    left = np.diff(residual, prepend=residual[:1])
    found &= np.minimum(own * np.sign(step), left * np.sign(step)) > AT_ONCE * size
    # What lies between two samples far apart is not known to be at once.
    apart = np.diff(record.time[rows], prepend=record.time[rows[0]])
    found &= apart < 1.5 * record.step_s
    at = np.flatnonzero(found)
    return at[(at >= SIDE) & (at <= len(rows) - SIDE)]


def _step(course: np.ndarray, side: int) -> np.ndarray:
    """By how much a line through the next samples lies above one through those before, each time.

    Both are extended to the middle between the sample before and the sample itself.
    """
    place = np.arange(side) + 0.5
    basis = np.stack([np.ones(side), place])
    weight = np.linalg.solve(basis @ basis.T, basis)[0]  # of a line's value at place 0
    both = np.concatenate([-weight[::-1], weight])
    found = np.zeros(len(course))
    found[side : len(course) - side + 1] = sliding_window_view(course, 2 * side) @ both
    return found


def _usual_move(output: np.ndarray) -> np.ndarray:
    """(row,) median move from sample to sample around each one."""
    moves = np.diff(output, prepend=output[:1])
    return scipy.ndimage.median_filter(moves, 2 * SIDE + 1, mode="nearest")


def _bends(output: np.ndarray, drive: np.ndarray, k: int) -> bool:
    """Whether an output turns at a row, or an input turns, starts or stops: dry friction jumps."""
    before, after = slice(max(k - SIDE, 0), k), slice(k, k + SIDE)
    turns = _way(output[before]) * _way(output[after]) < 0
    return turns or _way(drive[before]) != _way(drive[after])


def _way(course: np.ndarray) -> int:
    """Which way a course goes: up (1), down (-1), or neither for its noise (0)."""
    place = np.arange(len(course)) - (len(course) - 1) / 2
    rise = len(course) * float(place @ course) / float(place @ place)
    noise = float(np.median(np.abs(np.diff(course, 2)))) / (0.6745 * 6**0.5)
    return int(np.sign(rise)) if abs(rise) > CLEAR * noise * (12 / len(course)) ** 0.5 else 0


def _way_on(course: np.ndarray, k: int) -> int:
    """Which way a course goes on from a row, seen as far as it takes to tell."""
    ways = (_way(course[k : k + side]) for side in WIDER)
    return next((way for way in ways if way), 0)


def _answer(record: Record, after: int) -> np.ndarray:
    """(time,) by how much an output may jump as the input or an auxiliary column did about then."""
    span = np.nanmax(record.output) - np.nanmin(record.output)
    most = np.zeros(len(record))
    moves = np.diff(record.input, prepend=record.input[:1]) - _usual_move(record.input)
    told = [(record.input, moves, LEAST_SIGMAS)]
    told += [(values, _step(values, COLUMN_SIDE), OF_COLUMN) for values in record.aux.values()]
    for values, steps, sigmas in told:
        own = np.abs(steps)
        own[own < sigmas * spread(own)] = 0.0
        if own.any():
            most = np.maximum(most, GAIN * span / np.ptp(values) * own)
    # The greatest of those from `after` samples before to `LATE` samples later.
    window, shift = after + LATE + 1, (after - LATE) // 2
    return np.asarray(scipy.ndimage.maximum_filter1d(most, window, origin=shift, mode="constant"))


def _heights(residual: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Heights of jumps and their standard errors, by the samples beside each that tell it best."""
    ends = np.concatenate([[0], at, [len(residual)]])
    told: list[tuple[float, float]] = []
    for k, first, last in zip(at.tolist(), ends[:-2], ends[2:], strict=True):
        free = max(min(k - first, last - k), SIDE)
        every = [_told(residual, k, side) for side in WIDER if side <= free]
        # Wider lines that say something else follow the misfit of the model.
        error, near = every[0]
        told.append(min(one for one in every if abs(one[1] - near) <= error))
    both = np.array(told, dtype=float).reshape(-1, 2)
    return both[:, 1], both[:, 0]


def _told(residual: np.ndarray, k: int, side: int) -> tuple[float, float]:
    """A jump as lines through `side` samples before and after tell it: its standard error, and it.

    What the lines leave counts as noise, of the correlation that it shows from sample to sample.
    """
    place = np.arange(side) + 0.5
    before, after = residual[k - side : k][::-1], residual[k : k + side]
    lines = [np.polynomial.Polynomial.fit(place, part, 1) for part in (before, after)]
    left = [part - line(place) for part, line in zip((before, after), lines, strict=True)]
    power = sum(float(e @ e) for e in left)
    alike = sum(float(e[1:] @ e[:-1]) for e in left) / power if power else 0.0
    alike = float(np.clip(alike, 0.0, 0.95))
    error = SURE * np.sqrt(power / (2 * side - 4) * 8 / side * (1 + alike) / (1 - alike))
    return float(error), float(lines[1](0.0) - lines[0](0.0))

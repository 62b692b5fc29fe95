"""Stretches of a record: rests of the input, strokes, faults of the sensor."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy

from preisach_jax.record.core import Record
from preisach_jax.record.course import reversals
from preisach_jax.record.faults import Fault, Kind

BEGINNING = 8
"""A record's first part, one in so many, in which a drive need not repeat itself yet."""

REST_SAMPLES = 20
"""Samples over which the input must keep still for a rest."""

REST_BAND = 0.003
"""Share of its range within which an input that is free of noise keeps still."""

FINEST_STEP = 1e-6
"""Share of its range below which a step of a reading is that of the digits it is written in."""

STROKE = 0.1
"""Share of the input's range that a move must have for its rate to count."""

STROKE_SAMPLES = 4
"""Samples that it must have at least, and most of them measured."""


@dataclass(frozen=True)
class Stretch:
    """Rows `start` up to, not including, `stop`, with their time in s and a level in its unit."""

    start: int
    stop: int
    begin_s: float
    length_s: float
    level: float


@dataclass(frozen=True)
class Stroke:
    """A move from one turn or rest to the next: rows, ends of the input, and mean rate per s."""

    start: int
    stop: int
    first: float
    last: float
    rate: float


def noise_rms(values: np.ndarray) -> float:
    r"""RMS of white noise on a smooth course, from its third differences.

    Their variance is \(20 \sigma^2\); the median of their sizes does not see steps and spikes.
    A course that bends within a few samples adds to it, so the value is an upper one.
    """
    third = np.diff(values, 3)
    third = third[np.isfinite(third)]
    if third.size < 5:
        return 0.0
    return float(np.median(np.abs(third)) / scipy.special.ndtri(0.75) / np.sqrt(20))


def resolution(values: np.ndarray) -> float:
    """The step of a converter, in the unit of the values; 0 where they do not lie on steps."""
    levels = np.unique(values[np.isfinite(values)])
    steps = np.diff(levels)
    # Equal numbers may differ in their last bits.
    steps = steps[steps > FINEST_STEP * float(np.ptp(levels))] if levels.size else steps
    if steps.size < 3:
        return 0.0
    step = float(np.median(steps[steps < 1.5 * steps.min()]))
    off = np.abs(steps / step - np.round(steps / step))
    return float(f"{step:.6g}") if np.mean(off < 0.1) > 0.95 else 0.0


def rests(record: Record) -> list[Stretch]:
    """Stretches of `REST_SAMPLES` or more in which the input keeps still."""
    values = record.input
    noise = min(6 * noise_rms(values), 0.02 * record.input_range)
    band = max(REST_BAND * record.input_range, noise, 1.01 * resolution(values))
    ends = np.concatenate([[0], turns(record), [len(record) - 1]])
    usual = float(np.sum(np.abs(np.diff(values[ends])))) / record.duration_s
    # While it moves on at its usual rate, the input is within the band for a while, too.
    least_s = 3 * band / max(usual, 1e-300)
    found: list[Stretch] = []
    least = int(min(max(least_s / record.step_s, REST_SAMPLES), len(values)))
    for start, stop in _still(values, (0, len(values)), REST_SAMPLES, band, least):
        time = record.time[start:stop]
        level = float(np.mean(values[start:stop]))
        found.append(Stretch(start, stop, float(time[0]), float(time[-1] - time[0]), level))
    return found


def _still(
    values: np.ndarray, rows: tuple[int, int], width: int, band: float, least: int
) -> Iterator[tuple[int, int]]:
    """Runs of `least` samples within a band; what creeps is looked at with wider windows."""
    begin, end = rows
    if end - begin < width:
        return
    part = values[begin:end]
    left = (width - 1) // 2
    greatest = scipy.ndimage.maximum_filter1d(part, width)[width // 2 : len(part) - left]
    smallest = scipy.ndimage.minimum_filter1d(part, width)[width // 2 : len(part) - left]
    starts, stops = runs(greatest - smallest <= band)
    stops += width - 1
    long = stops - starts >= least
    for start, stop in zip(starts[long] + begin, stops[long] + begin, strict=True):
        run = values[start:stop]
        tenth = max(len(run) // 10, 1)
        creeps = abs(np.median(run[-tenth:]) - np.median(run[:tenth])) > 0.5 * band
        if np.ptp(run) <= band or not creeps:
            yield int(start), int(stop)
        elif 4 * width < stop - start:
            yield from _still(values, (int(start), int(stop)), 4 * width, band, least)


def runs(mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First sample of each stretch where a mask holds, and the first one after it."""
    edges = np.diff(mask.astype(np.int8), prepend=0, append=0)
    return np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)


def turns(record: Record) -> np.ndarray:
    """Rows at which the input turns, whatever its noise."""
    noise = min(6 * noise_rms(record.input), 0.03 * record.input_range)
    return reversals(record.input, max(0.01 * record.input_range, noise))


def strokes(record: Record, turning: np.ndarray, still: list[Stretch]) -> list[Stroke]:
    """The moves between turns and rests that cover a tenth of the range, gaps left out."""
    ends = {0, len(record) - 1, *turning.tolist()}
    ends |= {row for rest in still for row in (rest.start, rest.stop - 1)}
    resting = {rest.start for rest in still}
    gaps = np.array([row for row, _ in record.gaps], dtype=int)
    places = sorted(ends)
    # Each is a pass over the whole record: once, and not for every stroke.
    least, counts = STROKE * record.input_range, np.concatenate([[0], np.cumsum(record.measured)])
    found: list[Stroke] = []
    for start, stop in pairwise(places):
        move = record.input[stop] - record.input[start]
        seconds = record.time[stop] - record.time[start]
        broken = np.any((gaps > start) & (gaps <= stop))
        seen = (counts[stop] - counts[start]) / (stop - start)
        is_seen = stop - start >= STROKE_SAMPLES and seen > 0.5
        is_great = abs(move) >= least
        if start not in resting and is_great and is_seen and not broken:
            first, last = float(record.input[start]), float(record.input[stop])
            found.append(Stroke(start, stop, first, last, float(abs(move) / seconds)))
    return found


def period(values: np.ndarray) -> int | None:
    """Samples after which a signal repeats itself to a hundredth of its variance, if it does."""
    centred = values - values.mean()
    count, power = len(values), float(np.var(values))
    if power == 0:
        return None
    size = scipy.fft.next_fast_len(2 * count)
    spectrum = np.asarray(scipy.fft.rfft(centred, size))
    along = np.asarray(scipy.fft.irfft(np.abs(spectrum) ** 2, size))[: count // 2 + 1]
    sums = np.concatenate([[0.0], np.cumsum(centred**2)])
    lags = np.arange(len(along))
    energy = sums[count - lags] + sums[-1] - sums[lags]
    apart = (energy - 2 * along) / (count - lags) / (2 * power)
    left = np.flatnonzero(apart > 0.5)
    if not left.size:
        return None
    back = np.flatnonzero(apart[left[0] :] < 0.01)
    if not back.size:
        return None
    first = left[0] + back[0]
    return int(first + np.argmin(apart[first : 2 * first]))


def repeating_period(values: np.ndarray) -> int | None:
    """The period of a drive, which need not repeat itself yet as its record begins."""
    return period(values[len(values) // BEGINNING :]) or period(values)


@dataclass(frozen=True)
class Period:
    """The time after which a drive repeats itself.

    Attributes:
        seconds: it.
        spread: its uncertainty, as a part of it.
    """

    seconds: float
    spread: float

    @staticmethod
    def of(time: np.ndarray, values: np.ndarray) -> Period | None:
        """The period of a drive, to a sample over as many periods as its record can tell."""
        samples = repeating_period(values)
        if samples is None:
            return None
        values = values[len(values) // BEGINNING :]
        lag, count = samples, 1
        while 4 * lag <= len(values):
            near = np.arange(2 * lag - 2, 2 * lag + 3)
            left = [np.mean((values[one:] - values[:-one]) ** 2) for one in near]
            lag, count = int(near[np.argmin(left)]), 2 * count
        return Period(lag * float(np.median(np.diff(time))) / count, 0.5 / lag)

    def has_multiple(self, f_hz: float, span_s: float) -> bool:
        """Whether a line of a record of some length may be at a multiple of the drive's."""
        order = f_hz * self.seconds
        return abs(order - round(order)) < self.seconds / span_s + self.spread * order


def band_decades(values: np.ndarray) -> float:
    """Decades of frequency that hold 96 % of a signal's power; 0 of a single line."""
    spectrum = np.abs(np.asarray(scipy.fft.rfft(values - values.mean()))) ** 2
    share = np.cumsum(spectrum[1:]) / spectrum[1:].sum()
    low, high = (int(np.searchsorted(share, part)) + 1 for part in (0.02, 0.98))
    return float(np.log10(high / low))


def at_fault(record: Record, kind: Kind, found: Iterable[Fault]) -> tuple[Stretch, ...]:
    """The stretches of one kind of fault, with their times and the first reading of each."""
    return tuple(
        Stretch(
            each.start,
            each.stop,
            float(record.time[each.start]),
            float(record.time[each.stop - 1] - record.time[each.start]),
            float(record.output[each.start]),
        )
        for each in found
        if each.kind == kind
    )

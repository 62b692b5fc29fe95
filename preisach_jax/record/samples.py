"""What a measured record holds: its samples, what they span, and cuts and repairs of them."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Self

import numpy as np

from preisach_jax.errors import InputError
from preisach_jax.escape import printable, unit
from preisach_jax.record.channels import SAMPLES, Channel
from preisach_jax.record.marks import Jump, Run

MIN_MEASURED = 50
"""Fewest measured samples from which a model may be identified."""

LEAST_SOUND = 0.3
"""Share of the measured samples that faults of a sensor must leave."""

INITIAL_MEMORIES = ("low", "high", "demagnetised", "free")

AS_FITTED = "as-fitted"
"""That of the record on which a model was identified, where a model predicts along another one."""
"""What is known of the state at the first sample; `"free"`: nothing, it is identified."""

LEAST, GREATEST = 1e-60, 1e60
"""Between ranges and values of these sizes, fourth powers, as statistics form them, are numbers."""

_GAP = 5.0  # a step this many times the usual one is a gap


@dataclass(frozen=True, eq=False)
class Samples:
    """K samples of a record. Values are in the file's own units, time is in seconds."""

    time: np.ndarray
    input: np.ndarray
    output: np.ndarray
    aux: Mapping[str, np.ndarray]
    channels: Mapping[str, Channel]
    name: str
    sha256: str
    initial_memory: str
    time_values: np.ndarray
    spikes: Mapping[int, float] = field(default_factory=dict[int, float])
    input_spikes: Mapping[int, float] = field(default_factory=dict[int, float])
    faults: tuple[tuple[str, int, int], ...] = ()
    jumps: Mapping[int, Jump] = field(default_factory=dict[int, Jump])
    torn_row: int | None = None
    runs: tuple[Run, ...] = ()

    @classmethod
    def _of(
        cls,
        *,
        time: np.ndarray,
        input: np.ndarray,
        output: np.ndarray,
        aux: Mapping[str, np.ndarray],
        channels: Mapping[str, Channel],
        name: str,
        initial_memory: str,
        time_values: np.ndarray,
    ) -> Self:
        """The record of checked arrays, made read-only, with its digest."""
        if initial_memory not in (known := (*INITIAL_MEMORIES, AS_FITTED)):
            raise InputError(
                f"initial_memory is {initial_memory!r}; give one of {', '.join(known)}"
            )
        for role, values in {"time": time, "input": input, "output": output, **aux}.items():
            least, most = np.fmin.reduce(values), np.fmax.reduce(values)
            beyond = most if most > GREATEST else least if least < -GREATEST else None
            if beyond is not None:
                raise InputError(
                    f"{name}, column {channels[role].name}: the value {beyond:g} is too great "
                    f"to compute with (up to {GREATEST:g}); give the column in another unit"
                )
        # A NaN has many bit patterns; the digest knows one.
        if (missing := np.isnan(output)).any():
            output = np.where(missing, np.nan, output)
        digest = hashlib.sha256()
        for values in (time, input, output):
            digest.update(np.ascontiguousarray(values, "<f8").data)
        seconds = _frozen(time)
        return cls(
            time=seconds,
            input=_frozen(input),
            output=_frozen(output),
            aux={key: _frozen(values) for key, values in aux.items()},
            channels={
                role: Channel(printable(each.name), unit(each.unit))
                for role, each in channels.items()
            },
            name=printable(name),
            sha256=digest.hexdigest(),
            initial_memory=initial_memory,
            time_values=seconds if time_values is time else _frozen(time_values),
        )

    def __len__(self) -> int:
        """K, the number of samples."""
        return self.time.size

    @property
    def has_clock(self) -> bool:
        """Whether its times are times; without a clock they count samples."""
        return self.channels["time"].unit != SAMPLES

    @property
    def time_unit(self) -> str:
        """Unit in which its times are shown: `s`, or `samples` where they are only counted."""
        return "s" if self.has_clock else SAMPLES

    @property
    def time_label(self) -> str:
        """What stands on an axis of its times."""
        return "time (s)" if self.has_clock else "sample"

    @property
    def frequency_unit(self) -> str:
        """Unit of what is counted in a time: `Hz`, or `1/sample`."""
        return "Hz" if self.has_clock else "1/sample"

    @property
    def rate_unit(self) -> str:
        """Unit in which rates of the input are shown."""
        return f"{self.input_unit or 1}/{'s' if self.has_clock else 'sample'}"

    @property
    def measured(self) -> np.ndarray:
        """(K,) bool: where the output was measured."""
        return ~np.isnan(self.output)

    @property
    def starts(self) -> tuple[int, ...]:
        """First rows of the runs behind the first one; none of a record by itself."""
        return tuple(run.start for run in self.runs[1:])

    @property
    def stretches(self) -> list[slice]:
        """The rows of each run; all of a record by itself."""
        return [run.rows for run in self.runs] or [slice(0, len(self))]

    @property
    def duration_s(self) -> float:
        """Time from the first to the last sample, s; of several runs that of the longest one."""
        return max(float(self.time[rows][-1] - self.time[rows][0]) for rows in self.stretches)

    @cached_property
    def step_s(self) -> float:
        """Median time step, s."""
        return float(np.median(np.diff(self.time)))

    @property
    def gaps(self) -> list[tuple[int, float]]:
        """Steps over 5 times the median one of their run: (first sample after, length in s)."""
        found: list[tuple[int, float]] = []
        for rows in self.stretches:
            steps = np.diff(self.time[rows])
            late = np.flatnonzero(steps > _GAP * np.median(steps))
            found += [(rows.start + int(k) + 1, float(steps[k])) for k in late]
        return found

    @property
    def jitter(self) -> float:
        """Standard deviation of the time steps that are no gaps, as a share of the median one."""
        shares: list[np.ndarray] = []
        for rows in self.stretches:
            steps = np.diff(self.time[rows])
            shares.append(steps[steps <= _GAP * np.median(steps)] / np.median(steps))
        return float(np.std(np.concatenate(shares)))

    @property
    def input_unit(self) -> str:
        """Unit of the input, `""` where unknown."""
        return self.channels["input"].unit

    @property
    def output_unit(self) -> str:
        """Unit of the output, `""` where unknown."""
        return self.channels["output"].unit

    @cached_property
    def input_range(self) -> float:
        """Peak-to-peak input over all samples, in its unit."""
        return float(np.ptp(self.input))

    @cached_property
    def output_range(self) -> float:
        """Peak-to-peak measured output in its unit; NaN where nothing was measured."""
        values = self.output[self.measured]
        return float(np.ptp(values)) if values.size else float("nan")

    def part(self, start: int, stop: int) -> Self:
        """The samples from `start` up to, not including, `stop`."""
        first, last, _ = slice(start, stop).indices(len(self))
        if last - first < 2:
            raise InputError(
                f"{self.name}: part({start}, {stop}) of {len(self)} samples has "
                f"{max(last - first, 0)}; give a range of at least 2"
            )
        rows = slice(first, last)
        return type(self)._of(
            time=self.time[rows],
            input=self.input[rows],
            output=self.output[rows],
            aux={name: values[rows] for name, values in self.aux.items()},
            channels=self.channels,
            name=self.name,
            initial_memory=self.initial_memory if first == 0 else "free",
            time_values=self.time_values[rows],
        )

    def without(self, spikes: np.ndarray) -> Self:
        """The same measurement with some outputs left out, which `spikes` remembers."""
        if not spikes.any():
            return self
        left_out = {int(row): float(self.output[row]) for row in np.flatnonzero(spikes)}
        return replace(
            self,
            output=_frozen(np.where(spikes, np.nan, self.output)),
            spikes={**self.spikes, **left_out},
        )

    def masked(self, faults: Sequence[tuple[str, int, int]]) -> Self:
        """The same measurement without the output of stretches in which its sensor was at fault."""
        if not faults:
            return self
        output = self.output.copy()
        for _, start, stop in faults:
            output[start:stop] = np.nan
        left = int(np.isfinite(output).sum())
        if left < max(LEAST_SOUND * self.measured.sum(), MIN_MEASURED):
            kinds = " and ".join(sorted({kind for kind, _, _ in faults}))
            raise InputError(
                f"{self.name}, column {self.channels['output'].name}: the sensor is {kinds} in all "
                f"but {left:,} of its {int(self.measured.sum()):,} readings; record the output "
                "anew, within the range of its sensor"
            )
        return replace(self, output=_frozen(output), faults=(*self.faults, *faults))

    def levelled(self, jumps: np.ndarray) -> Self:
        """The same with jumps of the output taken back: (K, 2) heights and standard errors."""
        heights, errors = jumps.T
        if not heights.any():
            return self
        known = dict(self.jumps)
        for row in np.flatnonzero(errors).tolist():
            before = known[row].height if row in known else 0.0
            known[row] = Jump(before + float(heights[row]), float(errors[row]))
        off = np.concatenate([np.cumsum(heights[rows]) for rows in self.stretches])
        return replace(self, output=_frozen(self.output - off), jumps=known)

    def bridged(self, spikes: np.ndarray) -> Self:
        """The same measurement with some inputs replaced by straight lines between the others."""
        if not spikes.any():
            return self
        replaced = {int(row): float(self.input[row]) for row in np.flatnonzero(spikes)}
        parts = [(self.time[rows], self.input[rows], ~spikes[rows]) for rows in self.stretches]
        line = np.concatenate([np.interp(t, t[kept], u[kept]) for t, u, kept in parts])
        return replace(
            self,
            input=_frozen(np.where(spikes, line, self.input)),
            input_spikes={**self.input_spikes, **replaced},
        )

    def inputs_digest(self, n: int) -> str:
        """Digest of the first `n` samples of time and input.

        Two records with the same digest of `n` samples begin with the same `n` samples.
        """
        if not 0 <= n <= len(self):
            raise InputError(f"n is {n}: give at least 0 and at most {len(self)} samples")
        rows = np.column_stack([self.time[:n], self.input[:n]]).astype("<f8")
        return hashlib.sha256(rows.tobytes()).hexdigest()

    def check_identifiable(self, source: str | None = None) -> None:
        """Check that a model can be identified from the record."""
        if self.initial_memory == AS_FITTED:
            raise InputError(
                f"{source or self.name}: the initial memory is {AS_FITTED!r}, which says where a "
                "prediction begins; for a fit give low, high, demagnetised or free"
            )
        source = self.name if source is None else source
        if self.input_range == 0:
            raise InputError(
                f"{source}, column {self.channels['input'].name}: the input is constant "
                f"({self.input[0]:g} in all {len(self)} rows), so nothing can be learnt from it; "
                "record while the input moves"
            )
        output = f"{source}, column {self.channels['output'].name}"
        count = int(np.sum(self.measured))
        if count == 0:
            raise InputError(
                f"{output}: all {len(self)} cells are empty; give the column that holds the "
                "measured output"
            )
        if count < MIN_MEASURED:
            raise InputError(
                f"{output}: {count} measured samples are too few, at least {MIN_MEASURED} are "
                "needed; record longer or sample faster"
            )
        if self.output_range == 0:
            value = self.output[self.measured][0]
            raise InputError(
                f"{output}: the output is constant ({value:g} in all {count} measured rows); check "
                "the sensor and the choice of column"
            )
        self._check_ranges(source)

    def _check_ranges(self, source: str) -> None:
        """Refuse ranges, and a time step, that are too small to compute with."""
        spans = {role: float(np.ptp(values)) for role, values in self.aux.items()}
        spans |= {"time": self.step_s, "input": self.input_range, "output": self.output_range}
        for role, span in spans.items():
            if 0 < span < LEAST:
                what = "median step" if role == "time" else "range"
                raise InputError(
                    f"{source}, column {self.channels[role].name}: its {what}, {span:g}, is too "
                    f"small to compute with (from {LEAST:g}); give the column in another unit"
                )


_STRAIGHT, _LEAST_LEFT = 1.25, 1e-9
"""Times the noise, and share of the range, that a straight line leaves at most of its like."""


def without_hysteresis(record: Samples) -> str:
    """A sentence where a straight line from input to output leaves noise alone; else `""`.

    The noise is that of third differences of the output, which is too great where it bends; what a
    line leaves of one with a loop then runs on from row to row, and noise does not.
    """
    there = record.measured
    path, output = record.input[there], record.output[there]
    if len(path) < MIN_MEASURED or not np.ptp(path) or not np.ptp(output):
        return ""
    x, y = path - path.mean(), output - output.mean()
    left: np.ndarray = y - x * (x @ y) / (x @ x)
    rms = float(np.sqrt(left @ left / len(left)))
    thirds: np.ndarray = np.diff(output, 3)
    noise = float(np.sqrt(thirds @ thirds / len(thirds) / 20))
    follows = float(left[1:] @ left[:-1]) > 0.2 * float(left @ left)
    if rms > max(_STRAIGHT * noise, _LEAST_LEFT * float(np.ptp(output))) or rms > 0.5 * y.std():
        return ""
    if follows and rms > _LEAST_LEFT * float(np.ptp(output)):
        return ""
    share = 100 * rms / float(np.ptp(output))
    return (
        f"no hysteresis: a straight line does as well as any loop (it leaves {share:.2g} % of the "
        "output's range, which is its noise)"
    )


def _frozen(values: np.ndarray) -> np.ndarray:
    values = np.array(values, dtype=np.float64)
    values.setflags(write=False)
    return values

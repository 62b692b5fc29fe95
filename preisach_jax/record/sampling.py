"""Times that a file states instead of holding them, and channels of unequal rates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from preisach_jax.errors import InputError
from preisach_jax.quantity import quantity
from preisach_jax.record.clock import evenly_spread
from preisach_jax.record.columns import could_be_time, several_clocks, unit_of
from preisach_jax.record.settings import Sampling
from preisach_jax.record.table import Table, check_names, shortened
from preisach_jax.record.units import seconds_per

MADE_TIME = "time"
"""Name of a column of time that was made of a sample interval."""

_ALIKE = 1e-6  # of a step, by which two channels' times may differ and still be the same


@dataclass(frozen=True, eq=False)
class Signal:
    """A channel with times of its own.

    Arguments:
        values: (K,) the samples.
        unit: unit of the values, `""` if unknown.
        times: (K,) times in s, where they are not evenly spaced.
    """

    values: np.ndarray
    start_s: float = 0.0
    step_s: float | None = None
    unit: str = ""
    times: np.ndarray | None = None

    def clock(self) -> np.ndarray:
        """(K,) times in s."""
        if self.times is not None:
            return self.times
        assert self.step_s is not None
        return self.start_s + np.arange(self.values.size) * self.step_s


def with_stated_time(table: Table, sampling: Sampling | None) -> Table:
    """The same with a column of time, where the file states the interval and has no such column."""
    if sampling is None or MADE_TIME in table.columns:
        return table
    if any(could_be_time(table, name) for name in table.columns):
        return table
    times = np.arange(table.rows.size) * sampling.step_s
    note = (
        f"{table.source}: time from row {sampling.row}, {sampling.name}: "
        f"{quantity(sampling.step_s, 's')} between two rows"
    )
    return replace(
        table,
        columns={**table.columns, MADE_TIME: times},
        units={**table.units, MADE_TIME: "s"},
        roles={**table.roles, "time": MADE_TIME},
        notes=(*table.notes, note),
    )


def on_one_clock(table: Table) -> Table:
    """The same with the signals of several clocks brought on one, where each has its own."""
    own = several_clocks(table)
    if not own:
        return table
    clocks: dict[str, np.ndarray] = {}
    for clock in own:
        values = table.numbers(clock, "correct or remove the row")
        multiplier, divisor = seconds_per(unit_of(table, clock)) or (1.0, 1.0)
        clocks[clock] = evenly_spread(values * multiplier / divisor)
    signals: dict[str, Signal] = {}
    for clock, names in own.items():
        for name in names:
            values, there = table.lenient_numbers(name), np.isfinite(clocks[clock])
            assert values is not None  # or it were no signal
            there &= np.isfinite(values)
            unit = unit_of(table, name)
            signals[name] = Signal(values[there], unit=unit, times=clocks[clock][there])
    made = table_of_signals(signals, table.source)
    first, *others = own
    late = ", ".join(
        f"{each} begins {quantity(abs(float(clocks[each][0] - clocks[first][0])), 's', 3)} "
        f"{'later' if clocks[each][0] >= clocks[first][0] else 'earlier'} than {first}"
        for each in others
    )
    note = f"{table.source}: {len(own)} clocks, {' and '.join(own)}, were brought on one ({late})"
    return replace(made, named=table.named, notes=(*table.notes, note, *made.notes))


def table_of_signals(signals: Mapping[str, Signal], source: str) -> Table:
    """A table of channels, brought to the times of the fastest one where their times differ.

    The others are interpolated by straight lines within the time that all of them cover.
    """
    check_names([*signals, MADE_TIME], source)
    if not signals:
        raise InputError(f"{source}: the file holds no channels of numbers; record some")
    clocks = {name: signal.clock() for name, signal in signals.items()}
    for name, clock in clocks.items():
        if clock.size < 2 or not np.all(np.diff(clock) > 0):
            raise InputError(
                f"{source}, channel {name}: its {clock.size} times do not increase; correct its "
                "time or its sample interval"
            )
    fastest = min(clocks, key=lambda name: float(np.median(np.diff(clocks[name]))))
    step = float(np.median(np.diff(clocks[fastest])))
    low = max(clock[0] for clock in clocks.values()) - _ALIKE * step
    high = min(clock[-1] for clock in clocks.values()) + _ALIKE * step
    within = (clocks[fastest] >= low) & (clocks[fastest] <= high)
    times = clocks[fastest][within]
    if times.size < 2:
        raise InputError(
            f"{source}: the channels {shortened(list(signals))} were not recorded at the same time "
            "(no time is covered by all of them); give one of them a file of its own"
        )
    columns: dict[str, np.ndarray] = {MADE_TIME: times}
    resampled: list[str] = []
    for name, signal in signals.items():
        clock, values = clocks[name], np.asarray(signal.values, np.float64)
        same = clock.size == within.size and bool(
            np.all(np.abs(clock - clocks[fastest]) <= _ALIKE * step)
        )
        columns[name] = values[within] if same else np.interp(times, clock, values)
        if not same:
            rate = 1 / float(np.median(np.diff(clock)))
            resampled.append(f"{name} ({quantity(rate, 'Hz')})")
    return Table(
        source,
        columns,
        np.flatnonzero(within) + 1,
        units={MADE_TIME: "s"} | {name: s.unit for name, s in signals.items() if s.unit},
        roles={"time": MADE_TIME},
        makes_time=True,
        notes=_told(source, resampled, fastest, step, int((~within).sum())),
    )


def _told(
    source: str, resampled: Sequence[str], fastest: str, step: float, outside: int
) -> tuple[str, ...]:
    notes: list[str] = []
    if resampled:
        notes.append(
            f"{source}: {shortened(resampled)} interpolated by straight lines to the times of "
            f"{fastest} ({quantity(1 / step, 'Hz')})"
        )
    if outside:
        notes.append(f"{source}: {outside:,} samples outside the time of all channels left out")
    return tuple(notes)

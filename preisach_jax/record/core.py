"""A measured record: input, output and auxiliary channels over time, checked."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from preisach_jax import html
from preisach_jax.errors import InputError
from preisach_jax.record import exchange
from preisach_jax.record.channels import (
    Channel,
    assumptions,
    name_channels,
    read_aux,
    read_input,
    read_output,
    read_time,
)
from preisach_jax.record.checks import (
    as_vector,
    check_aux_names,
    check_finite,
    check_increasing,
    check_not_infinite,
    check_unit_keys,
)
from preisach_jax.record.columns import assign_roles
from preisach_jax.record.reading import read_table
from preisach_jax.record.table import Table
from preisach_jax.rows import column_rows, holes, record_line, span_rows

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from preisach_jax.record.joined import Run

MIN_MEASURED = 50
"""Fewest measured samples from which a model may be identified."""

LEAST_SOUND = 0.3
"""Share of the measured samples that faults of a sensor must leave."""

INITIAL_MEMORIES = ("low", "high", "demagnetised", "free")
"""What is known of the state at the first sample; `"free"`: nothing, it is identified."""

_GAP = 5.0  # a step this many times the usual one is a gap


@dataclass(frozen=True, eq=False)
class Record:
    """A measured record of K samples. Values are in the file's own units, time is in seconds.

    Made by `Record.load`, `from_arrays`, `from_pandas`, `from_xarray` or `from_response`, which
    check what is promised here.

    Arguments:
        time: (K,) float64, s, strictly increasing.
        input: (K,) float64, finite, in the input's unit.
        output: (K,) float64 in the output's unit, NaN where nothing was measured: such a sample
            belongs to the history of the input only.
        aux: auxiliary columns by name, each (K,) float64, finite.
        channels: name and unit of `"time"`, `"input"`, `"output"` and each auxiliary column.
        name: the file's name without its folder.
        sha256: digest of time, input and output as little-endian float64.
        initial_memory: state at the first sample, one of `"low"`, `"high"` (saturated),
            `"demagnetised"`, `"free"` (unknown).
        time_values: (K,) float64, the time column as in the file, in the file's unit.
        spikes: what was measured at the outputs that `without` left out, by row.
        input_spikes: what was measured at the inputs that `bridged` replaced, by row.
        faults: stretches of the output that `masked` left out, as `(kind, start, stop)`.
        torn_row: the last row of the file, counted from 1, if it breaks off and was left out.
        runs: where each of several records lies that were joined; empty for a record by itself.

    Example:
        >>> t = np.linspace(0.0, 1.0, 101)
        >>> record = Record.from_arrays(t, np.sin(6 * t), np.cos(6 * t), units={"input": "V"})
        >>> len(record), record.duration_s, record.input_unit
        (101, 1.0, 'V')
    """

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
    torn_row: int | None = None
    runs: tuple[Run, ...] = ()

    @classmethod
    def load(
        cls,
        path: str | os.PathLike[str],
        *,
        time: str | None = None,
        input: str | None = None,
        output: str | None = None,
        aux: Sequence[str] = (),
        rate: float | None = None,
        units: Mapping[str, str] | None = None,
        initial_memory: str | None = None,
        need_output: bool = True,
        announce: Callable[[str], object] | None = None,
    ) -> Record:
        """Load and check a record.

        Arguments:
            path: a text file of any common delimiter with or without settings above it, or a file
                of any kind in `preisach_jax.record.readers`, packed by gzip or ZIP or not.
            time, input, output: columns by name, number (`"2"`) or unit (`"V"`); None to guess from
                names and units.
            aux: names of auxiliary columns.
            rate: sampling rate in Hz, in place of a time column.
            units: units by role (`"time"`, `"input"`, `"output"`) or column, where the columns'
                names do not state them or state them wrongly.
            initial_memory: state at the first sample; None: what the format knows, else `"free"`.
            need_output: False to load the input alone, as for a prediction: the output may then be
                absent, the input constant and the record short.
            announce: called with a sentence for everything that was guessed or assumed.

        Returns:
            The record.

        Raises:
            InputError: the file or a column cannot be used; the message says where and why.

        Example:
            >>> import tempfile, pathlib
            >>> path = pathlib.Path(tempfile.mkdtemp()) / "stage.csv"
            >>> _ = path.write_text("t_ms,u_V,z_um\\n" + "".join(
            ...     f"{k},{k % 10},{(k % 10) ** 2}\\n" for k in range(60)))
            >>> record = Record.load(path, time="t_ms", input="u_V", output="z_um")
            >>> record.duration_s, record.input_unit, record.output_unit
            (0.059, 'V', 'um')
        """
        return cls.of_table(
            read_table(path),
            Path(path).name,
            time=time,
            input=input,
            output=output,
            aux=aux,
            rate=rate,
            units=units,
            initial_memory=initial_memory,
            need_output=need_output,
            announce=announce,
        )

    @classmethod
    def from_pandas(
        cls,
        frame: pd.DataFrame,
        *,
        time: str | None = None,
        input: str | None = None,
        output: str | None = None,
        aux: Sequence[str] = (),
        rate: float | None = None,
        units: Mapping[str, str] | None = None,
        name: str | None = None,
        initial_memory: str | None = None,
        need_output: bool = True,
        announce: Callable[[str], object] | None = None,
    ) -> Record:
        """Make a record of a data frame, as `load` does of a file.

        Arguments:
            frame: its columns, and its index where that is named or no count of rows; dates and
                durations become seconds, an index without name goes by `time`.
            name: what messages and reports call the record; by default the name that `to_pandas`
                wrote, else `frame`.
            time, input, output, aux, rate, units, initial_memory, need_output, announce: as for
                `load`; what is not given is as `to_pandas` wrote it.

        Returns:
            The record.

        Raises:
            InputError: the frame or a column cannot be used; the message says where and why.

        Example:
            >>> import pandas as pd
            >>> frame = pd.DataFrame({"u_V": np.arange(60) % 9, "z_um": np.arange(60) % 8},
            ...                      index=pd.timedelta_range("0s", freq="10ms", periods=60))
            >>> record = Record.from_pandas(frame)
            >>> record.duration_s, record.input_unit, record.output_unit
            (0.59, 'V', 'um')
        """
        name = exchange.name_of_frame(frame) if name is None else name
        table, known_aux = exchange.table_of_frame(frame, name)
        return cls.of_table(
            table,
            name,
            time=time,
            input=input,
            output=output,
            aux=aux or known_aux,
            rate=rate,
            units=units,
            initial_memory=initial_memory,
            need_output=need_output,
            announce=announce,
        )

    @classmethod
    def from_xarray(
        cls,
        dataset: xr.Dataset,
        *,
        time: str | None = None,
        input: str | None = None,
        output: str | None = None,
        aux: Sequence[str] = (),
        rate: float | None = None,
        units: Mapping[str, str] | None = None,
        name: str | None = None,
        initial_memory: str | None = None,
        need_output: bool = True,
        announce: Callable[[str], object] | None = None,
    ) -> Record:
        """Make a record of a dataset, as `load` does of a file.

        Arguments:
            dataset: its variables along the longest dimension, whose coordinate is the time;
                units from their attribute `units`.
            name: what messages and reports call the record; by default the dataset's attribute
                `name`, else `dataset`.
            time, input, output, aux, rate, units, initial_memory, need_output, announce: as for
                `load`; what is not given is as `to_xarray` wrote it.

        Returns:
            The record.

        Raises:
            InputError: the dataset or a variable cannot be used; the message says where and why.

        Example:
            >>> import xarray as xr
            >>> dataset = xr.Dataset(
            ...     {"u": ("time", np.arange(60.0) % 9, {"units": "V"}),
            ...      "z": ("time", np.arange(60.0) % 8, {"units": "um"})},
            ...     coords={"time": np.arange(60) / 100})
            >>> Record.from_xarray(dataset).input_unit
            'V'
        """
        if name is None:
            name = str(getattr(dataset, "attrs", {}).get("name", "dataset"))
        table, known_aux = exchange.table_of_dataset(dataset, name)
        return cls.of_table(
            table,
            name,
            time=time,
            input=input,
            output=output,
            aux=aux or known_aux,
            rate=rate,
            units=units,
            initial_memory=initial_memory,
            need_output=need_output,
            announce=announce,
        )

    @classmethod
    def from_response(
        cls,
        response: Any,
        *,
        input: ArrayLike | None = None,
        units: Mapping[str, str] | None = None,
        name: str = "response",
        initial_memory: str = "free",
    ) -> Record:
        """Make a record of a simulated response, as python-control and SciPy give it.

        Arguments:
            response: an object with `time` (s), `inputs` and `outputs`, as python-control's
                `TimeResponseData`; or (time, input, output); or, together with `input`,
                (time, output) or (time, output, states). Signals are (K,) or (1, K).
            input: the input where the response does not hold it.
            units, name, initial_memory: as for `from_arrays`.

        Returns:
            The record.

        Raises:
            InputError: the response is none of these, or holds more than one signal.

        Example:
            >>> from scipy.signal import lsim
            >>> t = np.arange(200) / 100
            >>> u = np.sin(9 * t)
            >>> record = Record.from_response(lsim(([1.0], [0.1, 1.0]), u, t), input=u)
            >>> len(record)
            200
        """
        time, driven, output = exchange.response_arrays(response, input, name)
        return cls.from_arrays(
            time, driven, output, units=units, name=name, initial_memory=initial_memory
        )

    @classmethod
    def of_table(
        cls,
        table: Table,
        name: str,
        *,
        time: str | None = None,
        input: str | None = None,
        output: str | None = None,
        aux: Sequence[str] = (),
        rate: float | None = None,
        units: Mapping[str, str] | None = None,
        initial_memory: str | None = None,
        need_output: bool = True,
        announce: Callable[[str], object] | None = None,
    ) -> Record:
        """Make a record of the columns of a table; `load` and its like do so with what they read.

        Arguments:
            table: the columns.
            name: what reports call the record.
            time, input, output, aux, rate, units, initial_memory, need_output, announce: as for
                `load`.

        Returns:
            The record.

        Raises:
            InputError: a column cannot be used; the message says where and why.
        """
        if time is not None and rate is not None:
            raise InputError(
                f"time is {time!r} and rate is {rate}: give a time column or a rate, not both"
            )
        if isinstance(aux, str):
            aux = (aux,)
        table.check_rows()
        table = table.with_clocks()
        roles = assign_roles(
            table,
            time=time,
            input=input,
            output=output,
            aux=aux,
            has_rate=rate is not None,
            need_output=need_output,
        )
        channels = name_channels(table, roles, units)
        if announce is not None:  # before the checks: a wrong guess explains what they find
            for note in assumptions(table, roles, channels, units):
                announce(note)
        time_values, seconds = read_time(table, roles.time, channels["time"].unit, rate)
        record = cls._of(
            time=seconds,
            input=read_input(table, roles.input),
            output=read_output(table, roles.output),
            aux={name: read_aux(table, name) for name in roles.aux},
            channels=channels,
            name=name,
            initial_memory=table.initial_memory if initial_memory is None else initial_memory,
            time_values=time_values,
        )
        if need_output:
            record.check_identifiable(source=table.source)
        return replace(record, torn_row=table.torn_row)

    @classmethod
    def from_arrays(
        cls,
        time: ArrayLike,
        input: ArrayLike,
        output: ArrayLike,
        *,
        aux: Mapping[str, ArrayLike] | None = None,
        units: Mapping[str, str] | None = None,
        name: str = "record",
        initial_memory: str = "free",
    ) -> Record:
        """Make a record of arrays.

        Arguments:
            time: (K,) s, strictly increasing.
            input: (K,) finite.
            output: (K,), NaN where nothing was measured.
            aux: auxiliary channels by name, each (K,) and finite.
            units: units by `"input"`, `"output"` and auxiliary name.
            name: what messages and reports call the record.
            initial_memory: state at the first sample.

        Returns:
            The record, with copies of the arrays.

        Raises:
            InputError: the arrays are not vectors of one length, or hold values they must not.

        Example:
            >>> record = Record.from_arrays([0.0, 0.1, 0.3], [0, 1, 0], [0.0, float("nan"), 0.2])
            >>> record.measured
            array([ True, False,  True])
        """
        check_aux_names(aux or (), name)
        arrays = {"time": time, "input": input, "output": output} | dict(aux or {})
        vectors = {key: as_vector(value, key, name) for key, value in arrays.items()}
        size = vectors["time"].size
        for key, vector in vectors.items():
            if vector.size != size:
                raise InputError(
                    f"{name}, {key}: it has {vector.size} values and time has {size}; give arrays "
                    "of one length"
                )
        check_increasing(vectors["time"], vectors["time"], lambda k: f"{name}, time[{k}]")
        for key in ("input", *(aux or {})):
            check_finite(vectors[key], lambda k, key=key: f"{name}, {key}[{k}]")
        check_not_infinite(vectors["output"], lambda k: f"{name}, output[{k}]")
        check_unit_keys(units, vectors, name)
        labels = {"time": "s"} | dict(units or {})
        if labels["time"] != "s":
            raise InputError(f"{name}: the unit of time is {labels['time']!r}; give time in s")
        return cls._of(
            time=vectors["time"],
            input=vectors["input"],
            output=vectors["output"],
            aux={key: vectors[key] for key in aux or {}},
            channels={key: Channel(key, labels.get(key, "")) for key in vectors},
            name=name,
            initial_memory=initial_memory,
            time_values=vectors["time"],
        )

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
    ) -> Record:
        """The record of checked arrays, made read-only, with its digest."""
        if initial_memory not in INITIAL_MEMORIES:
            raise InputError(
                f"initial_memory is {initial_memory!r}; give one of {', '.join(INITIAL_MEMORIES)}"
            )
        # A NaN has many bit patterns; the digest knows one.
        output = np.where(np.isnan(output), np.nan, output)
        digest = hashlib.sha256()
        for values in (time, input, output):
            digest.update(values.astype("<f8").tobytes())
        return cls(
            time=_frozen(time),
            input=_frozen(input),
            output=_frozen(output),
            aux={key: _frozen(values) for key, values in aux.items()},
            channels=dict(channels),
            name=name,
            sha256=digest.hexdigest(),
            initial_memory=initial_memory,
            time_values=_frozen(time_values),
        )

    def __repr__(self) -> str:
        return f"<Record {record_line(self)}>"

    def _repr_html_(self) -> str:
        """Columns with units and ranges, duration, gaps and missing outputs, for notebooks."""
        return html.block(
            html.heading(record_line(self)),
            html.table(("", "column", "unit", "from", "to"), column_rows(self), numbers_from=3),
            html.table((), span_rows(self)),
            *map(html.sentence, holes(self)),
        )

    def __len__(self) -> int:
        """K, the number of samples."""
        return self.time.size

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

    @property
    def step_s(self) -> float:
        """Median time step, s."""
        return float(np.median(np.diff(self.time)))

    @property
    def gaps(self) -> list[tuple[int, float]]:
        """Steps over 5 times the median one: (index of the first sample after, length in s).

        Where another run starts there is none.
        """
        steps = np.diff(self.time)
        found = np.flatnonzero(steps > _GAP * np.median(steps))
        return [(int(k) + 1, float(steps[k])) for k in found if int(k) + 1 not in self.starts]

    @property
    def jitter(self) -> float:
        """Standard deviation of the time steps that are no gaps, as a share of the median one."""
        steps = np.diff(self.time)
        usual = np.median(steps)
        return float(np.std(steps[steps <= _GAP * usual]) / usual)

    @property
    def input_unit(self) -> str:
        """Unit of the input, `""` where unknown."""
        return self.channels["input"].unit

    @property
    def output_unit(self) -> str:
        """Unit of the output, `""` where unknown."""
        return self.channels["output"].unit

    @property
    def input_range(self) -> float:
        """Peak-to-peak input over all samples, in its unit."""
        return float(np.ptp(self.input))

    @property
    def output_range(self) -> float:
        """Peak-to-peak measured output in its unit; NaN where nothing was measured."""
        values = self.output[self.measured]
        return float(np.ptp(values)) if values.size else float("nan")

    def part(self, start: int, stop: int) -> Record:
        """The samples from `start` up to, not including, `stop`.

        Arguments:
            start, stop: indices as for a slice.

        Returns:
            The record of these samples; its initial memory is `"free"` unless it starts with the
            first sample.

        Raises:
            InputError: there are fewer than two samples in that range.

        Example:
            >>> record = Record.from_arrays([0.0, 1.0, 2.0], [0, 1, 0], [0, 1, 1])
            >>> record.part(1, 3).time
            array([1., 2.])
        """
        first, last, _ = slice(start, stop).indices(len(self))
        if last - first < 2:
            raise InputError(
                f"{self.name}: part({start}, {stop}) of {len(self)} samples has "
                f"{max(last - first, 0)}; give a range of at least 2"
            )
        rows = slice(first, last)
        return Record._of(
            time=self.time[rows],
            input=self.input[rows],
            output=self.output[rows],
            aux={name: values[rows] for name, values in self.aux.items()},
            channels=self.channels,
            name=self.name,
            initial_memory=self.initial_memory if first == 0 else "free",
            time_values=self.time_values[rows],
        )

    def without(self, spikes: np.ndarray) -> Record:
        """The same measurement with some outputs left out, which `spikes` remembers.

        Arguments:
            spikes: (K,) bool: whose output is not to be used.

        Returns:
            The record with the same digest, its output NaN there; itself if nothing is left out.

        Example:
            >>> record = Record.from_arrays([0.0, 1.0, 2.0], [0, 1, 2], [0, 50, 2])
            >>> record.without(np.array([False, True, False])).spikes
            {1: 50.0}
        """
        if not spikes.any():
            return self
        left_out = {int(row): float(self.output[row]) for row in np.flatnonzero(spikes)}
        return replace(
            self,
            output=_frozen(np.where(spikes, np.nan, self.output)),
            spikes={**self.spikes, **left_out},
        )

    def masked(self, faults: Sequence[tuple[str, int, int]]) -> Record:
        """The same measurement without the output of stretches in which its sensor was at fault.

        Arguments:
            faults: kind, first row, and first row after it, of each stretch.

        Returns:
            The record with the same digest, its output NaN there, which `faults` remembers; itself
            if nothing is left out.

        Raises:
            InputError: if too little of the output is left to identify anything.

        Example:
            >>> record = Record.from_arrays(np.arange(99.0), np.arange(99.0), np.arange(99.0))
            >>> int(record.masked([("stuck", 3, 7)]).measured.sum())
            95
        """
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

    def bridged(self, spikes: np.ndarray) -> Record:
        """The same measurement with some inputs replaced by straight lines between the others.

        Arguments:
            spikes: (K,) bool: whose input is not to be used.

        Returns:
            The record with the same digest, whose `input_spikes` remember what was measured; itself
            if nothing is replaced.

        Example:
            >>> record = Record.from_arrays([0.0, 1.0, 2.0], [0, 50, 2], [0, 1, 2])
            >>> bridged = record.bridged(np.array([False, True, False]))
            >>> bridged.input, bridged.input_spikes
            (array([0., 1., 2.]), {1: 50.0})
        """
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

    def to_arrays(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Time in s, input and output, in their units.

        Returns:
            (K,) each, read-only; the output is NaN where nothing was measured.

        Example:
            >>> time, input, output = Record.from_arrays([0, 1], [2, 3], [4, 5]).to_arrays()
            >>> output
            array([4., 5.])
        """
        return self.time, self.input, self.output

    def to_pandas(self) -> pd.DataFrame:
        """The record as a data frame that `from_pandas` reads back to the last bit.

        Returns:
            A frame of the columns as in the file, time in the file's unit (in s where the file's
            times count from an epoch); units and roles are in its `attrs`.

        Example:
            >>> frame = Record.from_arrays([0, 1], [2, 3], [4, 5]).to_pandas()
            >>> list(frame.columns)
            ['time', 'input', 'output']
        """
        return exchange.frame_of(self)

    def to_xarray(self) -> xr.Dataset:
        """The record as a dataset that `from_xarray` reads back to the last bit.

        Returns:
            A dataset of the columns along the coordinate `time` in s, with attributes `units` and
            `role`.

        Raises:
            InputError: xarray is not installed, or a column is called `time`.

        Example:
            >>> record = Record.from_arrays([0, 1], [2, 3], [4, 5], units={"input": "V"})
            >>> record.to_xarray()["input"].attrs["units"]
            'V'
        """
        return exchange.dataset_of(self)

    def inputs_digest(self, n: int) -> str:
        """Digest of the first `n` samples of time and input.

        Two records with the same digest of `n` samples begin with the same `n` samples.

        Arguments:
            n: number of samples, at most K.

        Returns:
            SHA-256 of the `n` rows (time, input) as little-endian float64.

        Raises:
            ValueError: `n` is negative or above K.

        Example:
            >>> record = Record.from_arrays([0.0, 1.0, 2.0], [0, 1, 0], [0, 1, 1])
            >>> record.inputs_digest(2) == record.part(0, 2).inputs_digest(2)
            True
        """
        if not 0 <= n <= len(self):
            raise ValueError(f"n is {n}: give at least 0 and at most {len(self)} samples")
        rows = np.column_stack([self.time[:n], self.input[:n]]).astype("<f8")
        return hashlib.sha256(rows.tobytes()).hexdigest()

    def check_identifiable(self, source: str | None = None) -> None:
        """Check that a model can be identified from the record.

        Arguments:
            source: the file for messages; the record's name by default.

        Raises:
            InputError: the input or the measured output is constant, nothing was measured, or fewer
                than `MIN_MEASURED` samples were.

        Example:
            >>> Record.from_arrays([0.0, 1.0], [2, 2], [0, 1]).check_identifiable()
            Traceback (most recent call last):
            ...
            preisach_jax.errors.InputError: record, column input: the input is constant (2 in all 2
            rows), so nothing can be learnt from it; record while the input moves
        """
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


def _frozen(values: np.ndarray) -> np.ndarray:
    values = np.array(values, dtype=np.float64)
    values.setflags(write=False)
    return values

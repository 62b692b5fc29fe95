"""A measured record, made of files, frames, datasets, simulations or arrays, and checked."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np
from numpy.typing import ArrayLike

from preisach_jax.errors import InputError, require_no_record
from preisach_jax.hooks import HOOKS
from preisach_jax.quantity import quantity
from preisach_jax.record import exchange
from preisach_jax.record.channels import (
    Channel,
    assumptions,
    check_turns,
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
from preisach_jax.record.columns import ReadOptions, all_runs, assign_roles, checked, numbered
from preisach_jax.record.reading import read_table, read_tables
from preisach_jax.record.samples import Samples, without_hysteresis
from preisach_jax.record.sampling import MADE_TIME, on_one_clock
from preisach_jax.record.table import Table

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


@dataclass(frozen=True, eq=False)
class Record(Samples):
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
        jumps: by how much the output jumped, which `levelled` took back, by row.
        torn_row: the last row of the file, counted from 1, if it breaks off and was left out.
        runs: where each of several records lies that were joined; empty for a record by itself.

    Example:
        >>> t = np.linspace(0.0, 1.0, 101)
        >>> record = Record.from_arrays(t, np.sin(6 * t), np.cos(6 * t), units={"input": "V"})
        >>> len(record), record.duration_s, record.input_unit
        (101, 1.0, 'V')
    """

    @classmethod
    def load(cls, path: str | os.PathLike[str], **options: Unpack[ReadOptions]) -> Record:
        """Load and check a record.

        Arguments:
            path: a text file of any common delimiter with or without settings above it, or a file
                of any kind in `preisach_jax.record.readers`, packed by gzip or ZIP or not.
            options: `time`, `input`, `output`, `aux`, `rate`, `units`, `initial_memory`,
                `need_output`, `announce` and `table`, see `ReadOptions`.

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
        if options.get("table") is not None:
            return cls.load_all(path, **options)[0]
        return cls.of_table(read_table(path), Path(path).name, **options)

    @classmethod
    def load_all(cls, path: str | os.PathLike[str], **options: Unpack[ReadOptions]) -> list[Record]:
        """Load all records of a file: one of each table, sheet, or run with a time of its own.

        Arguments:
            path, options: as for `load`; the option `table` picks one.

        Returns:
            The records, which `fit` and `diagnose` take as several of one specimen.

        Raises:
            InputError: the file or a column cannot be used; the message says where and why.

        Example:
            >>> import tempfile, pathlib
            >>> path = pathlib.Path(tempfile.mkdtemp()) / "runs.csv"
            >>> run = "t_s,u_V,z_um\\n" + "".join(f"{k},{k % 9},{k % 8}\\n" for k in range(60))
            >>> _ = path.write_text(run + "\\n" + run)
            >>> [record.name for record in Record.load_all(path)]
            ['runs.csv, table 1', 'runs.csv, table 2']
        """
        tables = all_runs(read_tables(path), options)
        return cls.of_tables(tables, Path(path).name, **options)

    @classmethod
    def of_tables(
        cls, tables: Sequence[Table], name: str, /, **options: Unpack[ReadOptions]
    ) -> list[Record]:
        """The records of the tables of a file, or of the one that the option `table` picks."""
        if (number := options.get("table")) is not None:
            tables = [numbered(tables, number)]
        if len(tables) == 1:
            return [cls.of_table(tables[0], name, **options)]
        return [
            cls.of_table(table, f"{name}, table {k}", **options)
            for k, table in enumerate(tables, start=1)
        ]

    @classmethod
    def from_pandas(
        cls, frame: pd.DataFrame, *, name: str | None = None, **options: Unpack[ReadOptions]
    ) -> Record:
        """Make a record of a data frame, as `load` does of a file.

        Arguments:
            frame: its columns, and its index where that is named or no count of rows; dates and
                durations become seconds, an index without name goes by `time`.
            name: what messages and reports call the record; by default the name that `to_pandas`
                wrote, else `frame`.
            options: see `ReadOptions`; what is not given is as `to_pandas` wrote it.

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
        options["aux"] = options.get("aux") or known_aux
        return cls.of_table(table, name, **options)

    @classmethod
    def from_xarray(
        cls, dataset: xr.Dataset, *, name: str | None = None, **options: Unpack[ReadOptions]
    ) -> Record:
        """Make a record of a dataset, as `load` does of a file.

        Arguments:
            dataset: its variables along the longest dimension, whose coordinate is the time;
                units from their attribute `units`.
            name: what messages and reports call the record; by default the dataset's attribute
                `name`, else `dataset`.
            options: see `ReadOptions`; what is not given is as `to_xarray` wrote it.

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
        options["aux"] = options.get("aux") or known_aux
        return cls.of_table(table, name, **options)

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
    def of_table(cls, given: Table, name: str, /, **options: Unpack[ReadOptions]) -> Record:
        """Make a record of the columns of a table, as `load` does with what it reads."""
        options = checked(options)
        rate, units = options.get("rate"), options.get("units")
        need_output = options.get("need_output", True)
        given.check_rows()
        table = given.with_clocks()
        if options.get("time") in (None, MADE_TIME) and rate is None:
            table = on_one_clock(table)
        roles = assign_roles(
            table,
            time=options.get("time"),
            input=options.get("input"),
            output=options.get("output"),
            aux=options.get("aux", ()),
            has_rate=rate is not None,
            need_output=need_output,
        )
        channels = name_channels(table, roles, units)
        announce, known = options.get("announce"), options.get("initial_memory")
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
            initial_memory=table.initial_memory if known is None else known,
            time_values=time_values,
        )
        if need_output:
            if roles.counted:
                check_turns(table, roles, record.input, record.output)
            record.check_identifiable(source=table.source)
            if not roles.counted:
                check_turns(table, roles, record.input, record.output)
            if announce is not None and (line := without_hysteresis(record)):
                announce(f"{table.source}: {line}")
        return replace(record, torn_row=table.torn_row)

    @classmethod
    def from_arrays(
        cls,
        time: ArrayLike,
        input: ArrayLike | None = None,
        output: ArrayLike | None = None,
        *,
        aux: Mapping[str, ArrayLike] | None = None,
        units: Mapping[str, str] | None = None,
        name: str = "record",
        initial_memory: str = "free",
    ) -> Record:
        """Make a record of arrays.

        Arguments:
            time: (K,) s, strictly increasing.
            input: (K,) finite; needed, as the output is.
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
        require_no_record(f"{name}, time", time)
        if input is None or output is None:
            lacks = "input" if input is None else "output"
            raise InputError(f"{name}: there is no {lacks}; give time, input and output")
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

    @property
    def line(self) -> str:
        """Name, rows and duration in one line."""
        duration = quantity(self.duration_s, "s") if self.has_clock else "without a clock"
        if self.runs:
            of_several = f"{len(self):,} rows of {len(self.runs)} records"
            return f"{self.name}: {of_several}, {'up to ' * self.has_clock}{duration}"
        return f"{self.name}: {len(self):,} rows, {duration}"

    def __repr__(self) -> str:
        return f"<Record {self.line}>"

    def _repr_html_(self) -> str:
        return HOOKS["Record._repr_html_"](self)

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

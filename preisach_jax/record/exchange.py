"""Records from and to what other libraries hold: data frames, datasets, simulated responses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from preisach_jax.errors import InputError
from preisach_jax.record.containers import table_of_arrays
from preisach_jax.record.table import Table
from preisach_jax.record.units import seconds_per

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from preisach_jax.record.samples import Samples

_ROLES = ("time", "input", "output")
_ATTRIBUTE = "preisach_jax"
"""Where a frame remembers units, roles and the rest of a record."""


def table_of_frame(frame: pd.DataFrame, source: str) -> tuple[Table, tuple[str, ...]]:
    """The columns of a frame, an index that does not count rows among them; auxiliary ones."""
    import pandas as pd

    if not isinstance(frame, pd.DataFrame):
        raise InputError(f"{source}: this is a {type(frame).__name__}; give a pandas.DataFrame")
    index = frame.index
    series: list[tuple[str, pd.Series]] = [
        (str(label), frame.iloc[:, k]) for k, label in enumerate(frame.columns)
    ]
    if index.name is not None or not pd.api.types.is_integer_dtype(index.dtype):
        series.insert(0, (str(index.name or "time"), index.to_series()))
    names = [name for name, _ in series]
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise InputError(
            f"{source}: the column name {twice[0]!r} stands {names.count(twice[0])} times; give "
            "every column its own name"
        )
    about = frame.attrs.get(_ATTRIBUTE, {})
    table = table_of_arrays(
        {name: _plain(column) for name, column in series},
        source,
        units=_known(about.get("units", {}), names),
        roles={role: c for role, c in about.get("roles", {}).items() if c in names},
        initial_memory=about.get("initial_memory", "free"),
    )
    is_record = "time" in table.roles
    aux = tuple(name for name in about.get("aux", ()) if name in names)
    return replace(table, is_record=is_record), aux


def _plain(column: pd.Series) -> np.ndarray:
    """A column as NumPy's numbers, times or objects; what is missing is NaN."""
    import pandas as pd

    kind = column.dtype
    if isinstance(kind, pd.DatetimeTZDtype):
        return cast(Any, column.dt).tz_convert("UTC").dt.tz_localize(None).to_numpy()
    if pd.api.types.is_bool_dtype(kind) or not pd.api.types.is_numeric_dtype(kind):
        plain = column.to_numpy()
        return plain if plain.dtype.kind in "mM" else column.astype(object).to_numpy()
    if pd.api.types.is_integer_dtype(kind) and not column.hasnans:
        return column.to_numpy(np.int64)
    return column.to_numpy(np.float64, na_value=np.nan)


def _known(by_column: Mapping[str, str], names: list[str]) -> dict[str, str]:
    return {column: unit for column, unit in by_column.items() if column in names}


def frame_of(record: Samples) -> pd.DataFrame:
    """A record as a data frame that `table_of_frame` reads back; see `Record.to_pandas`."""
    import pandas as pd

    names = {role: record.channels[role].name for role in _ROLES}
    units = {names[role]: record.channels[role].unit for role in _ROLES[1:]}
    units |= {name: record.channels[name].unit for name in record.aux}
    time, unit = record.time_values, record.channels["time"].unit
    factors = seconds_per(unit)
    # Times that do not give the seconds back, such as those since 1970, are written in seconds.
    if factors is None or not np.array_equal(time * factors[0] / factors[1], record.time):
        names["time"], time, unit = "time", record.time, "s"
    if names["time"] in units:
        names["time"] = "time"
    columns = {names["time"]: time, names["input"]: record.input, names["output"]: record.output}
    frame = pd.DataFrame(columns | dict(record.aux))
    frame.attrs[_ATTRIBUTE] = {
        "units": {names["time"]: unit, **units},
        "roles": names,
        "aux": list(record.aux),
        "name": record.name,
        "initial_memory": record.initial_memory,
    }
    return frame


def name_of_frame(frame: Any) -> str:
    """The name of the record that a frame was made from, else `frame`."""
    about = getattr(frame, "attrs", {}).get(_ATTRIBUTE, {})
    return str(about.get("name", "frame"))


def table_of_dataset(dataset: xr.Dataset, source: str) -> tuple[Table, tuple[str, ...]]:
    """The variables along the longest dimension, whose coordinate is the time; auxiliary ones."""
    if not hasattr(dataset, "data_vars"):
        raise InputError(f"{source}: this is a {type(dataset).__name__}; give an xarray.Dataset")
    lengths = {str(name): size for name, size in dataset.sizes.items()}
    along = max(lengths, key=lengths.__getitem__, default="")
    found = {
        str(name): variable
        for name, variable in dataset.variables.items()
        if variable.dims == (along,)
    }
    roles = {"time": along} if along in found else {}
    roles |= {v.attrs["role"]: name for name, v in found.items() if v.attrs.get("role") in _ROLES}
    table = table_of_arrays(
        {name: np.asarray(variable.values) for name, variable in found.items()},
        source,
        units={name: str(v.attrs["units"]) for name, v in found.items() if "units" in v.attrs},
        roles=roles,
        initial_memory=str(dataset.attrs.get("initial_memory", "free")),
    )
    is_record = "initial_memory" in dataset.attrs
    aux = tuple(name for name, v in found.items() if v.attrs.get("role") == "aux")
    return replace(table, is_record=is_record), aux


def dataset_of(record: Samples) -> xr.Dataset:
    """A record as a dataset that `table_of_dataset` reads back; see `Record.to_xarray`."""
    try:
        import xarray as xr
    except ImportError:
        raise InputError(
            f"{record.name}: a Dataset needs the package xarray; install it with "
            "pip install 'preisach_jax[xarray]'"
        ) from None
    arrays = {"input": record.input, "output": record.output, **record.aux}
    variables: dict[str, Any] = {}
    for role, values in arrays.items():
        channel = record.channels[role]
        about = {"units": channel.unit, "role": role if role in _ROLES else "aux"}
        variables[channel.name if role in _ROLES else role] = ("time", values, about)
    if "time" in variables:
        raise InputError(
            f"{record.name}: a channel has the name 'time', which the coordinate needs; rename it"
        )
    return xr.Dataset(
        variables,
        coords={"time": ("time", record.time, {"units": "s"})},
        attrs={"name": record.name, "initial_memory": record.initial_memory},
    )


def response_arrays(
    response: Any, input: Any, source: str
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time, input and output of a simulated response; see `Record.from_response`."""
    own = None
    if isinstance(response, tuple | list):
        arrays = cast(Sequence[Any], response)
        if input is not None and len(arrays) in (2, 3):
            time, output = arrays[:2]
        elif input is None and len(arrays) == 3:
            time, own, output = arrays
        else:
            raise InputError(
                f"{source}: a response of {len(arrays)} arrays; give (time, input, output), or "
                "(time, output) as SciPy has it together with input=..."
            )
    elif all(hasattr(response, name) for name in ("time", "outputs")):
        time, output = response.time, response.outputs
        own = getattr(response, "inputs", None)
    else:
        raise InputError(
            f"{source}: this is a {type(response).__name__}; give an object with time, inputs and "
            "outputs, or (time, input, output)"
        )
    driven = own if input is None else input
    if driven is None:
        raise InputError(f"{source}: the response holds no input; give it as input=...")
    return _row(time, "time", source), _row(driven, "input", source), _row(output, "output", source)


def _row(values: Any, role: str, source: str) -> np.ndarray:
    """(K,) of an array of one row."""
    array = np.asarray(values)
    if array.ndim > 1 and array.size == max(array.shape):
        return array.reshape(-1)
    if array.ndim > 1:
        raise InputError(
            f"{source}, {role}: an array of shape {array.shape}; give one signal, of shape "
            "(samples,) or (1, samples)"
        )
    return array

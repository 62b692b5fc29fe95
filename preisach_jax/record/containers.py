"""Binary files of arrays: NPZ, MAT and Parquet."""

from __future__ import annotations

import math
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from preisach_jax.errors import InputError
from preisach_jax.record.matlab import TooMuchError, matlab_arrays
from preisach_jax.record.table import Table, check_names, shortened

if TYPE_CHECKING:
    import pandas as pd

MOST_VALUES = 2**22
"""Values that any file may hold, however small it is."""
MOST_VALUES_A_BYTE = 12
"""Values a byte that a greater file may hold: one of float64 that is compressed a hundredfold."""

_SECONDS = {
    "W": (604800.0, 1.0),
    "D": (86400.0, 1.0),
    "h": (3600.0, 1.0),
    "m": (60.0, 1.0),
    "s": (1.0, 1.0),
    "ms": (1.0, 1e3),
    "us": (1.0, 1e6),
    "ns": (1.0, 1e9),
    "ps": (1.0, 1e12),
    "fs": (1.0, 1e15),
    "as": (1.0, 1e18),
}


def read_npz(path: Path, source: str) -> Table:
    """Read the one-dimensional arrays of an NPZ file; their names are the columns.

    Arguments:
        path: the file.
        source: the file as the user named it.

    Returns:
        The table; a row of it counts from 1 within the arrays.

    Raises:
        InputError: the file is broken, holds Python objects, or no arrays of one length.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            members = [member for member in archive.infolist() if _is_array(archive, member)]
            values = sum(_values_in(archive, member) for member in members)
            _check_unpacked(values, path.stat().st_size, source, "numpy.savez")
            arrays = dict(_array_in(archive, member) for member in members)
    except InputError:
        raise
    except Exception as error:  # zipfile, its decompressors and NumPy raise many kinds
        raise InputError(
            f"{source}: not a readable NPZ file ({_brief(error)}); write it with "
            "numpy.savez(path, t=..., u=..., z=...)"
        ) from None
    return table_of_arrays(arrays, source)


def _is_array(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> bool:
    """Whether a member of an NPZ file says that it is an array; what else there is is left out."""
    with archive.open(member) as file:
        return file.read(len(np.lib.format.MAGIC_PREFIX)) == np.lib.format.MAGIC_PREFIX


def _values_in(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> int:
    """Values of an array of an NPZ file, by its header; ValueError if they cannot be in it."""
    with archive.open(member) as file:
        version = np.lib.format.read_magic(file)
        read = (
            np.lib.format.read_array_header_1_0
            if version == (1, 0)
            else np.lib.format.read_array_header_2_0
        )
        shape, _, dtype = read(file)
        values = math.prod(shape)
        if dtype.hasobject:
            raise ValueError(f"{member.filename[:60]} holds Python objects, which may be programs")
        if min(shape, default=0) < 0 or dtype.itemsize == 0:
            raise ValueError(f"{member.filename[:60]} has the shape {shape} of {dtype}")
        if values * dtype.itemsize > member.file_size:
            raise ValueError(f"{member.filename[:60]} breaks off")
    return values


def _array_in(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> tuple[str, np.ndarray]:
    """Name and values of an array of an NPZ file."""
    with archive.open(member) as file:
        array = np.lib.format.read_array(file, allow_pickle=False)
    if array.dtype.kind == "U":
        array = array.astype(object)  # fails where there is no such character
    return member.filename.removesuffix(".npy"), array


def _most_values(size: int) -> int:
    return max(MOST_VALUES, MOST_VALUES_A_BYTE * size)


def _check_unpacked(values: float, size: int, source: str, remedy: str) -> None:
    """Refuse before it is unpacked what unpacks to far more than records do."""
    if values > _most_values(size):
        raise _too_much(values, size, source, remedy)


def _too_much(values: float, size: int, source: str, remedy: str) -> InputError:
    return InputError(
        f"{source}: its {size:,} bytes unpack to {values:.3g} values or more, and no record is "
        f"compressed so far; if they are right, save it without compression, by {remedy}"
    )


def _brief(error: Exception) -> str:
    """What an exception of a library says, in a line."""
    said = str(error)
    return said if len(said) <= 200 else f"{said[:200]}..."


def read_mat(path: Path, source: str) -> Table:
    """Read the vectors of a MATLAB file; fields of structures go by `structure.field`.

    Arguments:
        path: the file, of version 7 or older.
        source: the file as the user named it.

    Returns:
        The table; a row of it counts from 1 within the vectors.

    Raises:
        InputError: the file is broken, of version 7.3, or holds no vectors of one length.
    """
    import scipy

    size = path.stat().st_size
    try:
        version = scipy.io.matlab.matfile_version(path)
        if version[0] == 0:  # older than level 5, and nothing in it is compressed
            content = cast(dict[str, Any], scipy.io.loadmat(path, simplify_cells=True))
        elif version[0] == 1:
            content = matlab_arrays(path.read_bytes(), _most_values(size))
        else:
            raise InputError(
                f"{source}: a MAT file of version 7.3 (HDF5) cannot be read; save it in MATLAB "
                "with save(name, '-v7')"
            )
        arrays = dict(_leaves(content))
    except InputError:
        raise
    except TooMuchError as error:
        raise _too_much(error.args[0], size, source, "save(name, '-v6')") from None
    except Exception as error:  # SciPy raises many kinds on a broken file
        raise InputError(
            f"{source}: not a readable MAT file ({_brief(error)}); save it in MATLAB with "
            "save(name, '-v7')"
        ) from None
    return table_of_arrays(arrays, source)


def read_parquet(path: Path, source: str) -> Table:
    """Read the columns of a Parquet file; needs the optional package pyarrow.

    Arguments:
        path: the file.
        source: the file as the user named it.

    Returns:
        The table; a row of it counts from 1.

    Raises:
        InputError: pyarrow is not installed, or the file is broken.
    """
    try:
        from pyarrow import parquet
    except ImportError:
        raise InputError(
            f"{source}: Parquet files need the package pyarrow; install it with "
            "pip install 'preisach_jax[parquet]', or give the record as CSV"
        ) from None
    try:
        with cast(Any, parquet.ParquetFile(path)) as file:
            about, schema = file.metadata, file.schema_arrow
        values = about.num_rows * about.num_columns
        size = path.stat().st_size
        _check_unpacked(values, size, source, "compression='none', use_dictionary=False")
        check_names(schema.names, source)
        arrays, nested = _flat_columns(path, schema)
    except InputError:
        raise
    except Exception as error:  # pyarrow raises many kinds on a broken file, Python's among them
        raise InputError(
            f"{source}: not a readable Parquet file ({_brief(error)}); write it again, or give the "
            "record as CSV"
        ) from None
    return replace(table_of_arrays(arrays, source), left_aside=nested)


def _flat_columns(path: Path, schema: Any) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """The columns of a Parquet file that are no lists or the like, and why not the others."""
    import pyarrow
    from pyarrow import parquet

    types = cast(Any, pyarrow.types)
    kinds = dict(zip(schema.names, schema.types, strict=True))
    flat = [name for name, kind in kinds.items() if not types.is_nested(kind)]
    is_text = (types.is_string, types.is_binary, types.is_large_string, types.is_large_binary)
    # A text is kept once, however many rows repeat it.
    texts = [name for name in flat if any(check(kinds[name]) for check in is_text)]
    content = cast(Any, parquet.read_table(path, columns=flat, read_dictionary=texts))
    frame: pd.DataFrame = content.to_pandas(ignore_metadata=True)
    nested = {name: "it holds lists or structures" for name in kinds if name not in flat}
    return {name: _cells(cast("pd.Series", frame[name])) for name in flat}, nested


def _cells(column: pd.Series) -> np.ndarray:
    """The cells of a column; equal texts of a categorical one are one object."""
    if column.dtype != "category":
        return column.to_numpy()
    coded = cast(Any, column.cat)
    categories = np.append(coded.categories.to_numpy(dtype=object), np.nan)
    return categories[coded.codes]  # -1, the last, where there is none


def _leaves(content: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, np.ndarray]]:
    """Every array in nested structures, by its dotted name."""
    for name, value in content.items():
        if name.startswith("__"):
            continue
        if isinstance(value, Mapping):
            yield from _leaves(cast(Mapping[str, Any], value), f"{prefix}{name}.")
        elif isinstance(value, np.ndarray):
            yield prefix + name, value


def table_of_arrays(
    arrays: Mapping[str, np.ndarray],
    source: str,
    *,
    units: Mapping[str, str] | None = None,
    roles: Mapping[str, str] | None = None,
    initial_memory: str = "free",
) -> Table:
    """A table of those arrays that are vectors of the greatest length.

    Arguments:
        arrays: arrays by name.
        source: what messages call them.
        units, roles, initial_memory: what is known of them, as in `Table`.

    Returns:
        The table; a row of it counts from 1.

    Raises:
        InputError: there are no vectors.

    Example:
        >>> table_of_arrays({"t": np.arange(3), "scale": np.eye(2)}, "arrays").columns
        {'t': array([0., 1., 2.])}
    """
    check_names(list(arrays), source)
    vectors = {name: np.squeeze(array) for name, array in arrays.items()}
    vectors = {name: vector for name, vector in vectors.items() if vector.ndim == 1}
    if not vectors:
        held = shortened(list(arrays)) or "nothing"
        raise InputError(
            f"{source}: the file holds no vectors (it holds {held}); "
            "give time, input and output as one-dimensional arrays of one length"
        )
    length = max(vector.size for vector in vectors.values())
    kept = {name: vector for name, vector in vectors.items() if vector.size == length}
    left_aside = {
        name: f"it has {v.size} values where others have {length}; give arrays of one length"
        for name, v in vectors.items()
        if v.size != length
    }
    return Table(
        source,
        {name: _as_cells(vector) for name, vector in kept.items()},
        np.arange(1, length + 1),
        units=dict(units or {})
        | {name: "s" for name, vector in kept.items() if vector.dtype.kind in "mM"},
        left_aside=left_aside,
        roles=roles or {},
        initial_memory=initial_memory,
        exact={name: vector for name, vector in kept.items() if vector.dtype.kind == "i"},
    )


def _as_cells(vector: np.ndarray) -> np.ndarray:
    """Numbers as float64, durations as seconds, dates as seconds since the first, else objects."""
    if vector.dtype.kind in "iuf":
        with np.errstate(all="ignore"):  # what is beyond float64 is infinite, and refused as such
            values = vector.astype(np.float64)
        values[np.isnan(values)] = np.nan  # of its many bit patterns some signal an error
        return values
    if vector.dtype.kind in "mM":
        return _as_seconds(vector)
    return vector.astype(object)


def _as_seconds(vector: np.ndarray) -> np.ndarray:
    """Durations as seconds, dates as seconds since the first, NaN where there is none."""
    unit = np.datetime_data(vector.dtype)[0]
    if unit in {"Y", "M"} and vector.dtype.kind == "M":
        vector, unit = vector.astype("M8[D]"), "D"
    if unit not in _SECONDS:  # years and months are no durations, nor are numbers without a unit
        counts = vector.astype(np.int64)
        texts = [f"{count} {unit}" for count in counts.tolist()]
        return np.where(np.isnat(vector), np.nan, np.array(texts, object))
    steps = vector - vector[:1] if vector.dtype.kind == "M" else vector
    multiplier, divisor = _SECONDS[unit]
    counted = steps.astype(np.int64) * float(np.datetime_data(vector.dtype)[1])
    return np.where(np.isnat(steps), np.nan, counted * multiplier / divisor)

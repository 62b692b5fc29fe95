"""Binary files of arrays: NPZ, MAT and Parquet."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from preisach_jax.errors import InputError
from preisach_jax.record.table import Table


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
        with np.load(path, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except (ValueError, OSError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(
            f"{source}: not a readable NPZ file ({error}); write it with numpy.savez(path, t=..., "
            "u=..., z=...)"
        ) from None
    return table_of_arrays(arrays, source)


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
    from scipy.io import loadmat

    try:
        content = loadmat(path, simplify_cells=True)
    except NotImplementedError:
        raise InputError(
            f"{source}: a MAT file of version 7.3 (HDF5) cannot be read; save it in MATLAB with "
            "save(name, '-v7')"
        ) from None
    except Exception as error:  # loadmat raises many kinds on a broken file
        raise InputError(
            f"{source}: not a readable MAT file ({error}); save it in MATLAB with save(name, '-v7')"
        ) from None
    return table_of_arrays(dict(_leaves(content)), source)


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
        from pyarrow import ArrowException, parquet
    except ImportError:
        raise InputError(
            f"{source}: Parquet files need the package pyarrow; install it with "
            "pip install 'preisach_jax[parquet]', or give the record as CSV"
        ) from None
    try:
        content = parquet.read_table(path)
    except (ArrowException, OSError, ValueError) as error:
        raise InputError(
            f"{source}: not a readable Parquet file ({error}); write it again, or give the record "
            "as CSV"
        ) from None
    names = content.column_names
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise InputError(
            f"{source}: the column name {twice[0]!r} stands {names.count(twice[0])} times; give "
            "every column its own name"
        )
    frame = content.to_pandas(ignore_metadata=True)
    return table_of_arrays({name: frame[name].to_numpy() for name in names}, source)


def _leaves(content: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, np.ndarray]]:
    """Every array in nested structures, by its dotted name."""
    for name, value in content.items():
        if name.startswith("__"):
            continue
        if isinstance(value, Mapping):
            yield from _leaves(value, f"{prefix}{name}.")
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
    vectors = {name: np.squeeze(array) for name, array in arrays.items()}
    vectors = {name: vector for name, vector in vectors.items() if vector.ndim == 1}
    if not vectors:
        raise InputError(
            f"{source}: the file holds no vectors (it holds {', '.join(arrays) or 'nothing'}); "
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
        return vector.astype(np.float64)
    if vector.dtype.kind in "mM":
        steps = vector - vector[0] if vector.dtype.kind == "M" else vector
        steps = steps / np.timedelta64(1, "ns") / 1e9
        return np.where(np.isnat(vector), np.nan, steps)
    return vector.astype(object)

"""Arrays of NumPy: NPZ archives, and NPY files of one array."""

from __future__ import annotations

import math
import zipfile
from pathlib import Path
from typing import Any, cast

import numpy as np

from preisach_jax.errors import ContentError, InputError
from preisach_jax.record.containers import table_of_arrays
from preisach_jax.record.readers.base import Reader, check_unpacked, not_readable
from preisach_jax.record.table import Table


def read_npz(path: Path, source: str) -> Table:
    """Read the one-dimensional arrays of an NPZ file; their names are the columns."""
    try:
        with zipfile.ZipFile(path) as archive:
            members = [member for member in archive.infolist() if _is_array(archive, member)]
            values = sum(_values_in(archive, member) for member in members)
            check_unpacked(values, path.stat().st_size, source, "numpy.savez")
            arrays = dict(_array_in(archive, member) for member in members)
    except InputError:
        raise
    except Exception as error:  # zipfile, its decompressors and NumPy raise many kinds
        remedy = "write it with numpy.savez(path, t=..., u=..., z=...)"
        raise not_readable("NPZ", error, source, remedy) from None
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
            raise ContentError(
                f"{member.filename[:60]} holds Python objects, which may be programs"
            )
        if min(shape, default=0) < 0 or dtype.itemsize == 0:
            raise ContentError(f"{member.filename[:60]} has the shape {shape} of {dtype}")
        if values * dtype.itemsize > member.file_size:
            raise ContentError(f"{member.filename[:60]} breaks off")
    return math.ceil(values * dtype.itemsize / 8)  # of texts, as many as take so many bytes


def _array_in(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> tuple[str, np.ndarray]:
    """Name and values of an array of an NPZ file."""
    with archive.open(member) as file:
        array = np.lib.format.read_array(file, allow_pickle=False)
    if array.dtype.kind == "U":
        array = array.astype(object)  # fails where there is no such character
    return member.filename.removesuffix(".npy"), array


def read_npy(path: Path, source: str) -> Table:
    """Read an array of NumPy: the columns of a matrix, or the fields of a structured array."""
    try:
        array: Any = np.load(path, allow_pickle=False)
        if not isinstance(array, np.ndarray):
            raise ContentError("it is an archive of several arrays")
    except Exception as error:  # NumPy raises many kinds on a broken file
        raise not_readable("NPY", error, source, "write it with numpy.save(path, array)") from None
    if names := cast(tuple[str, ...] | None, array.dtype.names):
        fields: dict[str, Any] = {name: array[name] for name in names}
        return table_of_arrays(fields, source)
    return table_of_arrays({path.stem: np.array(cast(Any, array))}, source)


NPZ = Reader(
    "NPZ",
    (".npz",),
    read=read_npz,
    note="vectors or matrices of one length; their names are the columns",
)
NPY = Reader(
    "NPY",
    (".npy",),
    (np.lib.format.MAGIC_PREFIX,),
    read_npy,
    note="a matrix, its columns by number, or a structured array",
)

"""HDF5 files of any layout: data sets by their path; MATLAB files of version 7.3."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from preisach_jax.errors import InputError
from preisach_jax.record.containers import table_of_arrays
from preisach_jax.record.readers.base import Reader, check_unpacked, library, not_readable
from preisach_jax.record.sampling import Signal, table_of_signals, with_stated_time
from preisach_jax.record.settings import Sampling
from preisach_jax.record.table import Table

_UNITS = ("units", "unit", "Unit", "Units", "unit_string", "UNIT")
_STEPS = ("wf_increment", "dt", "sample_interval", "sampling_interval", "delta_t", "step")
_RATES = ("sample_rate", "sampling_rate", "samplerate", "fs", "rate", "frequency")
_REMEDIES = {
    "/": "check that it was closed after writing, or give the record as CSV or NPZ",
    ".": "save it in MATLAB with save(name, '-v7')",
}


def read_hdf5(path: Path, source: str) -> Table:
    """Read the data sets of an HDF5 file by their paths, units and rates by their attributes."""
    return _read(path, source, "/")


def read_mat_73(path: Path, source: str) -> Table:
    """Read a MATLAB file of version 7.3, whose fields of structures go by `structure.field`."""
    return _read(path, source, ".")


def _read(path: Path, source: str, between: str) -> Table:
    h5py = library("h5py", "h5py", "HDF5 and MATLAB 7.3 files", source)
    try:
        with h5py.File(path, "r") as file:
            sets = list(_data_sets(file, h5py))
            values = sum(max(each.size * len(each.dtype.names or (0,)), each.nbytes / 8)
                         for each in sets)  # fmt: skip
            check_unpacked(values, path.stat().st_size, source, "compression=None")
            arrays: dict[str, np.ndarray] = {}
            units: dict[str, str] = {}
            steps: dict[str, float] = {}
            for each in sets:
                name = each.name.strip("/").replace("/", between)
                content = each[()]
                fields = content.dtype.names or ()
                for field in fields:
                    arrays[f"{name}{between}{field}"] = content[field]
                if fields:
                    continue
                arrays[name] = content
                units |= {name: unit} if (unit := _text(each.attrs, _UNITS)) else {}
                step = _step(each.attrs) or _step(each.parent.attrs)
                steps |= {name: step} if step else {}
    except InputError:
        raise
    except Exception as error:  # h5py raises many kinds on a broken file
        raise not_readable("HDF5", error, source, _REMEDIES[between]) from None
    arrays = {name: _plain(array) for name, array in arrays.items()}
    sizes = {name: array.size for name, array in arrays.items() if array.size > 1}
    if steps and len({sizes.get(name) for name in steps}) > 1:
        return table_of_signals(
            {
                name: Signal(np.squeeze(arrays[name]), step_s=step, unit=units.get(name, ""))
                for name, step in steps.items()
            },
            source,
        )
    table = table_of_arrays(arrays, source, units=units)
    step = next(iter(steps.values()), None)
    return with_stated_time(table, None if step is None else Sampling(step, "an attribute", 0))


def _data_sets(file: Any, h5py: Any) -> Iterator[Any]:
    """Data sets of numbers or texts; links to other files are not followed."""
    found: list[Any] = []

    def visit(name: str, item: Any) -> None:
        is_data = isinstance(item, h5py.Dataset) and not name.startswith("#")
        if is_data and not item.is_virtual and item.external is None and item.ndim > 0:
            kind = item.attrs.get("MATLAB_class", b"double")
            if kind not in {b"char", b"cell", b"function_handle"} and item.dtype.kind != "O":
                found.append(item)

    file.visititems(visit)
    yield from found


def _plain(array: np.ndarray) -> np.ndarray:
    """An array without dimensions of one; bytes as texts."""
    array = np.squeeze(array)
    if array.dtype.kind == "S":
        texts = [cell.decode(errors="replace") for cell in array.reshape(-1).tolist()]
        return np.array(texts, dtype=object).reshape(array.shape)
    return array


def _text(attributes: Any, names: tuple[str, ...]) -> str:
    value = next((attributes[name] for name in names if name in attributes), "")
    return value.decode(errors="replace") if isinstance(value, bytes) else str(value)


def _step(attributes: Any) -> float | None:
    """The time between two samples, s, as attributes state it."""
    for names, is_rate in ((_STEPS, False), (_RATES, True)):
        for name in names:
            if name not in attributes:
                continue
            value = np.asarray(attributes[name])
            if value.size == 1 and value.dtype.kind in "iuf" and value.item() > 0:
                return 1 / float(value.item()) if is_rate else float(value.item())
    return None


HDF5 = Reader(
    "HDF5",
    (".h5", ".hdf5", ".hdf", ".he5"),
    (b"\x89HDF\r\n\x1a\n",),
    read_hdf5,
    note="data sets by path, `--input group/u`; units and rates from attributes",
    foreign=True,
)

"""Files of MATLAB: SciPy or our own reader up to version 7, HDF5 from version 7.3 on."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, cast

import numpy as np

from preisach_jax.errors import InputError
from preisach_jax.record.containers import table_of_arrays
from preisach_jax.record.matlab import TooMuchError, matlab_arrays
from preisach_jax.record.readers.base import Reader, most_values, not_readable, too_much
from preisach_jax.record.readers.hdf5 import read_mat_73
from preisach_jax.record.sampling import Signal, table_of_signals
from preisach_jax.record.table import Table


def read_mat(path: Path, source: str) -> Table:
    """Read the vectors of a MATLAB file; fields of structures go by `structure.field`."""
    import scipy

    size = path.stat().st_size
    try:
        version = scipy.io.matlab.matfile_version(path)
        if version[0] == 0:  # older than level 5, and nothing in it is compressed
            content = cast(dict[str, Any], scipy.io.loadmat(path, simplify_cells=True))
        elif version[0] == 1:
            content = matlab_arrays(path.read_bytes(), most_values(size))
        else:
            return read_mat_73(path, source)
        arrays = dict(_leaves(content))
    except InputError:
        raise
    except TooMuchError as error:
        raise too_much(error.args[0], size, source, "save(name, '-v6')") from None
    except Exception as error:  # SciPy raises many kinds on a broken file
        remedy = "save it in MATLAB with save(name, '-v7')"
        raise not_readable("MAT", error, source, remedy) from None
    return _picoscope(arrays, source) or table_of_arrays(arrays, source)


def _leaves(content: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, np.ndarray]]:
    """Every array in nested structures, by its dotted name."""
    for name, value in content.items():
        if name.startswith("__"):
            continue
        if isinstance(value, Mapping):
            yield from _leaves(cast(Mapping[str, Any], value), f"{prefix}{name}.")
        elif isinstance(value, np.ndarray):
            yield prefix + name, value


def _picoscope(arrays: Mapping[str, np.ndarray], source: str) -> Table | None:
    """Channels with `Tstart`, `Tinterval` and `Length`, as PicoScope 6 writes them; else None."""
    about = {"Tstart", "Tinterval", "Length"}
    if not about <= set(arrays) or any(arrays[name].size != 1 for name in about):
        return None
    start, step, length = (float(arrays[name].item()) for name in ("Tstart", "Tinterval", "Length"))
    channels = {
        name: Signal(np.squeeze(values), start, step)
        for name, values in arrays.items()
        if name not in about and values.size == length
    }
    return table_of_signals(channels, source) if step > 0 and channels else None


MAT = Reader(
    "MATLAB",
    (".mat",),
    read=read_mat,
    note="vectors, fields of structures as `structure.field`, matrices by number; version 7.3 too",
)

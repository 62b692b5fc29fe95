"""Tables of Apache Arrow: Parquet, Feather and IPC files."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any, cast

import numpy as np

from preisach_jax.errors import InputError
from preisach_jax.record.containers import table_of_arrays
from preisach_jax.record.readers.base import Reader, check_unpacked, library, not_readable
from preisach_jax.record.table import Table, check_names


def read_parquet(path: Path, source: str) -> Table:
    """Read the columns of a Parquet file; needs the optional package pyarrow."""
    parquet = library("pyarrow.parquet", "pyarrow", "Parquet files", source)
    try:
        with parquet.ParquetFile(path) as file:
            about, schema = file.metadata, file.schema_arrow
        unpacked = sum(about.row_group(k).total_byte_size for k in range(about.num_row_groups))
        values = max(about.num_rows * about.num_columns, unpacked / 8)
        size = path.stat().st_size
        check_unpacked(values, size, source, "compression='none', use_dictionary=False")
        check_names(schema.names, source)
        flat, nested, texts = _kinds(schema)
        with parquet.ParquetFile(path, read_dictionary=texts) as file:
            content = file.read(columns=flat)
    except InputError:
        raise
    except Exception as error:  # pyarrow raises many kinds on a broken file, Python's among them
        remedy = "write it again, or give the record as CSV"
        raise not_readable("Parquet", error, source, remedy) from None
    return _table(content, flat, nested, source)


def read_feather(path: Path, source: str) -> Table:
    """Read the columns of a Feather or Arrow IPC file; needs the optional package pyarrow."""
    feather = library("pyarrow.feather", "pyarrow", "Feather files", source)
    try:
        content = feather.read_table(str(path), memory_map=False)
        values = content.num_rows * content.num_columns
        check_unpacked(values, path.stat().st_size, source, "compression='uncompressed'")
        check_names(content.schema.names, source)
        flat, nested, _ = _kinds(content.schema)
    except InputError:
        raise
    except Exception as error:  # pyarrow raises many kinds on a broken file, Python's among them
        remedy = "write it again, or give the record as CSV"
        raise not_readable("Feather", error, source, remedy) from None
    return _table(content, flat, nested, source)


def _kinds(schema: Any) -> tuple[list[str], dict[str, str], list[str]]:
    """The columns that are no lists or the like, why not the others, and those of text."""
    import pyarrow

    types = cast(Any, pyarrow.types)
    kinds = dict(zip(schema.names, schema.types, strict=True))
    flat = [name for name, kind in kinds.items() if not types.is_nested(kind)]
    is_text = (types.is_string, types.is_binary, types.is_large_string, types.is_large_binary)
    # A text is kept once, however many rows repeat it.
    texts = [name for name in flat if any(check(kinds[name]) for check in is_text)]
    nested = {name: "it holds lists or structures" for name in kinds if name not in flat}
    return flat, nested, texts


def _table(content: Any, flat: list[str], nested: dict[str, str], source: str) -> Table:
    try:
        arrays = {name: _cells(content[name]) for name in flat}
    except Exception as error:  # as above: what is broken is found only when it is converted
        remedy = "write it again, or give the record as CSV"
        raise not_readable("Parquet", error, source, remedy) from None
    about: dict[str, dict[bytes, bytes]] = {n: content.schema.field(n).metadata or {} for n in flat}
    units = {n: each[b"unit"].decode(errors="replace") for n, each in about.items()
             if b"unit" in each}  # fmt: skip
    return replace(table_of_arrays(arrays, source, units=units), left_aside=nested)


def _cells(column: Any) -> np.ndarray:
    """The cells of a column; equal texts of a categorical one are one object."""
    types, kind = cast(Any, import_module("pyarrow.types")), column.type
    is_number = types.is_integer(kind) or types.is_floating(kind)
    if is_number and column.num_chunks and not column.null_count:
        # What `to_numpy` gives, without the 0.6 s of loading pandas.
        return np.concatenate([np.from_dlpack(chunk) for chunk in column.chunks])
    if not types.is_dictionary(kind):
        return column.to_numpy()
    coded = column.unify_dictionaries().combine_chunks()
    categories = np.append(coded.dictionary.to_numpy(zero_copy_only=False).astype(object), np.nan)
    return categories[coded.indices.fill_null(-1).to_numpy()]  # the last where there is none


PARQUET = Reader(
    "Parquet",
    (".parquet", ".pq"),
    (b"PAR1",),
    read_parquet,
    note="names are the columns",
    foreign=True,
)
FEATHER = Reader(
    "Feather, Arrow",
    (".feather", ".arrow", ".ipc"),
    (b"ARROW1", b"FEA1"),
    read_feather,
    note="names are the columns",
    foreign=True,
)

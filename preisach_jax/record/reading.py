"""From a path to a table, whatever the format."""

from __future__ import annotations

import difflib
import os
from dataclasses import replace
from pathlib import Path

from preisach_jax.errors import InputError
from preisach_jax.record.containers import read_mat, read_npz, read_parquet
from preisach_jax.record.delimited import read_delimited
from preisach_jax.record.encoding import HEAD_BYTES, check_text, decode
from preisach_jax.record.micromag import is_micromag, read_micromag
from preisach_jax.record.table import Table

MAX_TEXT_BYTES = 2**29
"""Greatest text file that is read, in bytes: it takes ten times as much memory."""

_CONTAINERS = {
    ".npz": read_npz,
    ".mat": read_mat,
    ".parquet": read_parquet,
    ".pq": read_parquet,
}


def read_table(path: str | os.PathLike[str], source: str | None = None) -> Table:
    """Read the columns of a file.

    Arguments:
        path: NPZ, MAT and Parquet files are known by their ending, MicroMag files by how they
            begin, anything else is delimiter-separated text.
        source: the file as the user named it, where that is not its path.

    Returns:
        The columns with their names and places in the file.

    Raises:
        InputError: there is no such file, it cannot be read, or it holds no table.
    """
    source = str(path) if source is None else source
    path = Path(path)
    _check_file(path, source)
    if reader := _CONTAINERS.get(path.suffix.lower()):
        table = reader(path, source)
    else:
        table = _read_text(path, source)
    return table


def _check_file(path: Path, source: str) -> None:
    if path.is_dir():
        raise InputError(f"{source}: this is a folder; give a file in it")
    if not path.exists():
        raise InputError(f"{source}: there is no such file{_near(path)}; check the path")
    if path.stat().st_size == 0:
        raise InputError(f"{source}: the file is empty; give a file with columns of data")


def _read_text(path: Path, source: str) -> Table:
    size = path.stat().st_size
    try:
        with path.open("rb") as file:
            check_text(file.read(HEAD_BYTES), source)
        if size > MAX_TEXT_BYTES:
            raise InputError(
                f"{source}: the file has {size:,} bytes, and texts of up to {MAX_TEXT_BYTES:,} are "
                "read; cut or thin it, or save its columns with numpy.savez"
            )
        content = path.read_bytes()
    except OSError as error:
        raise InputError(
            f"{source}: cannot be read ({error.strerror}); check its permissions"
        ) from None
    text, assumed = decode(content)
    table = read_micromag(text, source) if is_micromag(text) else read_delimited(text, source)
    return replace(table, notes=(f"{source}: {assumed}", *table.notes)) if assumed else table


def _near(path: Path) -> str:
    """A hint to a file of a similar name in the same folder, if there is one."""
    try:
        names = [entry.name for entry in path.parent.iterdir() if entry.is_file()]
    except OSError:
        return ""
    near = difflib.get_close_matches(path.name, names, n=1)
    return f" (there is {near[0]})" if near else ""

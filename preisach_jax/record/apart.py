"""Files of other people's formats, read in a process of their own, which may fall or be stopped.

Libraries in C and Rust end their process where a file asks for more memory than there is, or finds
an error in them.  The child imports NumPy and one such library, limits itself, and writes one
line of JSON and the bytes of arrays to a file: nothing that would have to be unpickled.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess  # noqa: TID251
import sys
import tempfile
from dataclasses import fields
from pathlib import Path
from typing import Any, BinaryIO, cast

import numpy as np

from preisach_jax.errors import InputError
from preisach_jax.record.readers import BINARY
from preisach_jax.record.readers.base import Reader
from preisach_jax.record.readers.workbook import WORKBOOK, read_workbook
from preisach_jax.record.table import Table

try:
    import resource
except ImportError:  # on Windows, where the limits below do not hold
    resource = None

MEMORY, MEMORY_A_BYTE = 2**30, 100
"""Bytes that reading any file may take, and those for each of its bytes."""

SECONDS, BYTES_A_SECOND = 60, 100_000
"""Processor time that reading any file may take, and the bytes that a further second allows."""

_PROGRAM = """
import json, sys
told = json.load(sys.stdin)
sys.path[:] = told["places"]
from preisach_jax.record.apart import answer
answer(told)
"""
_REMEDY = "save its columns as CSV, or with numpy.savez"


def read_apart(reader: Reader, path: Path, source: str, sheet: str | None = None) -> list[Table]:
    """Read a file in a child process with limits of memory and time."""
    if not sys.executable or getattr(sys, "frozen", False):  # there is no Python to start
        return read_here(reader, path, source, sheet)
    seconds = SECONDS + path.stat().st_size // BYTES_A_SECOND
    told = {
        "places": sys.path, "reader": reader.name, "path": str(path), "source": source,
        "sheet": sheet, "seconds": seconds,
    }  # fmt: skip
    # A pool of threads takes memory for each of the machine's cores, and Arrow's own allocator sets
    # 1 GiB of addresses aside, which may be all that the limit allows.
    threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MALLOC_ARENA_MAX"), "1")
    small = {**threads, "ARROW_DEFAULT_MEMORY_POOL": "system"}
    with tempfile.TemporaryFile() as answered:
        try:
            done = subprocess.run(
                [sys.executable, "-I", "-c", _PROGRAM], input=json.dumps(told).encode(),
                stdout=answered, stderr=subprocess.PIPE, env={**os.environ, **small},
                timeout=10 * seconds, check=False,
            )  # fmt: skip
            cause = _cause(done.returncode, done.stderr.decode(errors="replace"))
        except subprocess.TimeoutExpired:
            done, cause = None, f"the limit of {10 * seconds} s"
        if done is None or done.returncode:
            raise InputError(
                f"{source}: reading it as {reader.name} was ended by {cause}; {_REMEDY}"
            )
        answered.seek(0)
        content = json.loads(answered.readline())
        if isinstance(content, dict):
            refusal = cast(Any, content)["refusal"]
            raise InputError(refusal)
        return _unpacked(content, answered)


def read_here(reader: Reader, path: Path, source: str, sheet: str | None = None) -> list[Table]:
    """Read a file in this process, as `read_apart` does in another."""
    if reader is WORKBOOK:
        return read_workbook(path, source, sheet)
    return [cast(Any, reader.read)(path, source)]


def _cause(status: int, said: str) -> str:
    """What ended a process, in a few words."""
    if status == -getattr(signal, "SIGXCPU", 0):
        return "the limit of its processor time"
    if status < 0:
        return f"{signal.Signals(-status).name} (a crash, or more memory than it may take)"
    last = " ".join((said.strip().splitlines() or ["nothing said"])[-1].split())
    return f"an error ({last:.200})"


def answer(told: dict[str, Any]) -> None:
    """In the child: read the file and write its tables, or why there are none, to the output."""
    with os.fdopen(os.dup(1), "wb") as out:
        os.dup2(2, 1)  # what a library prints is no part of the answer
        path, source, sheet = Path(told["path"]), told["source"], told["sheet"]
        reader = next(each for each in BINARY if each.name == told["reader"])
        _limit(path.stat().st_size, told["seconds"])
        try:
            parts = [_packed(table) for table in read_here(reader, path, source, sheet)]
            head = json.dumps([packed for packed, _ in parts])
            arrays = [array for _, each in parts for array in each]
        except InputError as error:
            head, arrays = json.dumps({"refusal": str(error)}), []
        except MemoryError:
            line = f"reading it as {reader.name} takes more memory than it may; {_REMEDY}"
            head, arrays = json.dumps({"refusal": f"{source}: {line}"}), []
        out.write(head.encode() + b"\n")
        for array in arrays:
            out.write(array.data)


def _limit(size: int, seconds: int) -> None:
    if resource is None:
        return
    pages = Path("/proc/self/statm")
    used = int(pages.read_text().split()[0]) * resource.getpagesize() if pages.exists() else 0
    for which, most in (
        (resource.RLIMIT_AS, used + MEMORY + MEMORY_A_BYTE * size),
        (resource.RLIMIT_CPU, seconds),
        (resource.RLIMIT_CORE, 0),
    ):
        hard = resource.getrlimit(which)[1]
        soft = most if hard == resource.RLIM_INFINITY else min(most, hard)
        try:
            resource.setrlimit(which, (soft, hard))
        except (OSError, ValueError):  # macOS has no limit of the address space
            continue


_ARRAYS = ("columns", "exact")


def _packed(table: Table) -> tuple[dict[str, Any], list[np.ndarray]]:
    """A table as JSON, in which arrays of numbers are described, and these arrays."""
    arrays: list[np.ndarray] = []

    def described(values: np.ndarray) -> Any:
        if values.dtype == object:  # a text is sent once, however many rows repeat it
            known: dict[Any, int] = {}
            plain = [_cell(cell) for cell in values]
            keys = [cell if isinstance(cell, str) else (repr(cell),) for cell in plain]
            codes = [known.setdefault(key, len(known)) for key in keys]
            cells = dict(zip(codes, plain, strict=True))
            return {"cells": [*cells.values()], "codes": described(np.array(codes, np.int64))}
        arrays.append(np.ascontiguousarray(values))
        return {"type": values.dtype.str, "count": values.size}

    head = {each.name: getattr(table, each.name) for each in fields(table)}
    for name in _ARRAYS:
        head[name] = {key: described(values) for key, values in head[name].items()}
    head["rows"] = described(table.rows)
    return head, arrays


def _cell(cell: Any) -> Any:
    """A cell as JSON has it: of what is neither number, text nor truth value, the text."""
    plain = cast(Any, cell).item() if isinstance(cell, np.generic) else cell
    if isinstance(plain, bytes):
        return plain.decode(errors="replace")
    return plain if plain is None or isinstance(plain, str | bool | int | float) else str(plain)


def _unpacked(heads: list[dict[str, Any]], body: BinaryIO) -> list[Table]:
    """The tables of what `_packed` made of each."""

    def restored(found: Any) -> np.ndarray:
        if "cells" in found:
            return np.array([*found["cells"], None], dtype=object)[restored(found["codes"])]
        array = np.empty(found["count"], found["type"])
        body.readinto(array.data)  # pyright: ignore[reportAttributeAccessIssue]
        return array

    tables: list[Table] = []
    for head in heads:
        plain = {"notes": tuple(head["notes"]), "sheets": tuple(head["sheets"])}
        table: dict[str, Any] = {**head, **plain}
        for name in _ARRAYS:
            table[name] = {key: restored(values) for key, values in head[name].items()}
        table["rows"] = restored(head["rows"])
        tables.append(Table(**table))
    return tables

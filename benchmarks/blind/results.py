"""Results of the benchmark on disk: one JSON line a finished case."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

FILE = "results.jsonl"

RIVALS = ("forward", "held_out", "correlation", "sparse")
"""Simpler ways to name an effect, which `rivals` explains."""


def read_results(folder: Path) -> list[dict[str, Any]]:
    """The finished cases; a line that was torn by a sudden end is left out.

    Arguments:
        folder: where the benchmark writes.

    Returns:
        One dictionary a case, in the order in which they were finished; empty if there is no file.
    """
    path = folder / FILE
    return list(_whole(path.read_bytes())) if path.exists() else []


def _whole(content: bytes) -> Iterator[dict[str, Any]]:
    for line in content.split(b"\n"):
        try:
            yield json.loads(line)
        except ValueError:  # empty, or torn
            continue


class ResultsFile:
    """Results to append to; each line reaches the disk before `append` returns.

    Arguments:
        folder: where to write; made if it is not there.
    """

    def __init__(self, folder: Path):
        folder.mkdir(parents=True, exist_ok=True)
        self._file = (folder / FILE).open("ab+")
        size = self._file.seek(0, os.SEEK_END)
        if size:
            self._file.seek(size - 1)
            if self._file.read(1) != b"\n":  # torn: what follows gets a line of its own
                self._file.write(b"\n")

    def append(self, result: dict[str, Any]) -> None:
        """Write the result of a case."""
        self._file.write(json.dumps(result).encode() + b"\n")
        self._file.flush()
        os.fsync(self._file.fileno())

    def __enter__(self) -> ResultsFile:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

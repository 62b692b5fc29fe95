"""What is marked in a record: spans of rows, the runs that it was joined of, jumps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from jaxtyping import Bool


@dataclass(frozen=True)
class Run:
    """One of several records that were joined.

    Attributes:
        name: the record's name.
        sha256: digest of its values.
        start, stop: its first row in the joined record, and the first row after it.
        clock_s: time of its first row on its own clock, in s.
        initial_memory: state at its first sample.
        held_out: whether all its rows are held out.
    """

    name: str
    sha256: str
    start: int
    stop: int
    clock_s: float
    initial_memory: str
    held_out: bool = False

    @property
    def rows(self) -> slice:
        """Its rows in the joined record."""
        return slice(self.start, self.stop)

    def __contains__(self, row: int) -> bool:
        """Whether a row of the joined record is one of its own."""
        return self.start <= row < self.stop


class Jump(NamedTuple):
    """By how much an output jumped, and the standard error of that, in its unit."""

    height: float
    error: float


def spans(marked: Bool[np.ndarray, " time"]) -> list[tuple[int, int]]:
    """First row of each unbroken span of marked rows, and the row behind its last."""
    edges = np.flatnonzero(np.diff(marked.astype(np.int8), prepend=0, append=0))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))

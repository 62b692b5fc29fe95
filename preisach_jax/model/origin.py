"""What a model remembers of its record and of its parameters, and the format of its file."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from preisach_jax.record.core import Record

FORMAT = "preisach_jax model"

FORMAT_VERSION = 3


@dataclass(frozen=True)
class ParameterEstimate:
    """A value with its 95 % interval and its unit."""

    value: float
    low: float
    high: float
    unit: str


@dataclass(frozen=True, eq=False)
class Origin:
    """The record on which a model was identified.

    Attributes:
        record: its name.
        sha256: hash of its values.
        rows: its number of rows.
        inputs_sha256: hash of its time and input columns.
        start_s, stop_s: time of its first and its last row, in s.
        step_s: its median time step, in s.
        initial_memory: what was assumed of the hysterons before the first row.
        history: (2, point) time in s and input, thinned without losing a reversal, from which a
            record that begins where this one ended is continued.
    """

    record: str
    sha256: str
    rows: int
    inputs_sha256: str
    start_s: float
    stop_s: float
    step_s: float
    initial_memory: str
    history: np.ndarray

    @property
    def span_s(self) -> tuple[float, float]:
        """Time of its first and its last row, in s."""
        return self.start_s, self.stop_s

    @staticmethod
    def of(record: Record) -> Origin:
        """What a model remembers of its record."""
        rows = len(record.time)
        return Origin(
            record.name,
            record.sha256,
            rows,
            record.inputs_digest(rows),
            float(record.time[0]),
            float(record.time[-1]),
            record.step_s,
            record.initial_memory,
            _thinned(record.time, record.input),
        )


def _thinned(time: np.ndarray, values: np.ndarray, bins: int = 600) -> np.ndarray:
    """A course with its first, last, least and greatest value in each of some stretches."""
    keep = {0, len(values) - 1}
    for rows in np.array_split(np.arange(len(values)), min(bins, len(values))):
        part = values[rows]
        keep |= {int(rows[0]), int(rows[np.argmin(part)]), int(rows[np.argmax(part)])}
    order = np.array(sorted(keep))
    return np.stack([time[order], values[order]])

r"""The 95 % band of a prediction, calibrated on rows that were held out.

A model errs more where the input is fast, and behind a reversal, than elsewhere.  So the rows that
were held out are cut into slices by the speed of the input and by the time since its last
reversal, and in each the half width is the conformal quantile

\[ q = |e|_{(\lceil 0.95\,(n + 1) \rceil)} \]

of its n absolute residuals (V. Vovk, A. Gammerman, G. Shafer, Algorithmic Learning in a Random
World, Springer 2005; by slices, "Mondrian").  Slices of few rows have that of all of their speed,
or of all rows.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from preisach_jax.record import Record
from preisach_jax.record.course import input_rate, time_since_reversal

COVERAGE = 0.95
"""Share of the rows that a band holds."""

SLICES = 3
"""Slices by the speed, and by the time since the last reversal."""

LEAST_ROWS = 300
"""Rows of a slice from which its own quantile is taken."""


@dataclass(frozen=True, eq=False)
class Band:
    """Half widths of a 95 % band.

    Attributes:
        speed: (SLICES - 1,) speeds of the input between the slices, in its unit per s.
        since: (SLICES - 1,) times since the last reversal between the slices, in s.
        half: (SLICES, SLICES) half width by speed and time, in output units.
    """

    speed: np.ndarray
    since: np.ndarray
    half: np.ndarray

    @staticmethod
    def calibrated(record: Record, residual: np.ndarray, rows: np.ndarray) -> Band:
        """The band that holds 95 % of the residuals of each slice.

        Arguments:
            record: the record.
            residual: (time,) measured minus predicted output.
            rows: (time,) bool: the rows that were held out.

        Returns:
            The band.

        Example:
            >>> t = np.arange(4000) / 100
            >>> record = Record.from_arrays(t, np.sin(t), np.sin(t))
            >>> noise = np.random.default_rng(0).normal(size=4000)
            >>> band = Band.calibrated(record, noise, np.ones(4000, dtype=bool))
            >>> bool(np.all(np.abs(band.half - 1.96) < 0.3))
            True
        """
        speed, since = _slicing(record)
        share = np.arange(1, SLICES) / SLICES
        edges = np.quantile(speed[rows], share), np.quantile(since[rows], share)
        errors = np.abs(residual[rows])
        by_speed, by_time = (
            np.searchsorted(edge, values[rows])
            for edge, values in zip(edges, (speed, since), strict=True)
        )
        half = np.full((SLICES, SLICES), conformal(errors))
        for i in range(SLICES):
            own = by_speed == i
            if own.sum() >= LEAST_ROWS:
                half[i] = conformal(errors[own])
            for j in range(SLICES):
                both = own & (by_time == j)
                if both.sum() >= LEAST_ROWS:
                    half[i, j] = conformal(errors[both])
        return Band(*edges, half)

    def along(self, record: Record) -> np.ndarray:
        """(time,) half width along a record, in output units."""
        speed, since = _slicing(record)
        return self.half[np.searchsorted(self.speed, speed), np.searchsorted(self.since, since)]

    def to_json(self) -> dict[str, Any]:
        """The band as plain numbers."""
        return {
            "speed": self.speed.tolist(), "since_s": self.since.tolist(),
            "half": self.half.ravel().tolist(),
        }  # fmt: skip

    @staticmethod
    def from_json(content: Mapping[str, np.ndarray]) -> Band:
        """The band of a file's checked numbers."""
        half = np.reshape(content["half"], (SLICES, SLICES))
        return Band(content["speed"], content["since_s"], half)


def conformal(errors: np.ndarray) -> float:
    """The least width that holds 95 % of what comes, if it is like these absolute errors.

    Example:
        >>> conformal(np.arange(1.0, 100.0))
        95.0
    """
    rank = min(math.ceil(COVERAGE * (len(errors) + 1)), len(errors))
    return float(np.partition(errors, rank - 1)[rank - 1])


def _slicing(record: Record) -> tuple[np.ndarray, np.ndarray]:
    """(time,) speed of the input, and time since it last turned."""
    speed = np.abs(input_rate(record.time, record.input, record.starts))
    return speed, time_since_reversal(record.time, record.input, starts=record.starts)

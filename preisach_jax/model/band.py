r"""The 95 % band of a prediction, calibrated on rows that did not identify what predicts them.

What a row misses has the variance of a sum of parts, each with a share \(a_i \ge 0\) that the
residuals themselves decide (non-negative least squares, reweighted by the variance):

\[ \sigma^2 = a_0 + a_1 v + a_2 v^2 + a_3 e^{-d/c} + a_4 e^{-d/4c} + a_5 s^2 + a_6 p^2 \]

noise; what goes with the speed v of the input; what the cells of the plane, of width c, miss behind
a reversal, at a distance d; what the record's own blocks would move the prediction by (s, the
sandwich covariance of all coefficients and parameters); and what the smoothness prior has to
decide, since hardly any row tells of it (p, the posterior covariance of the weights).  The last two
come from simulating a few other models, `Others`, along the record that is predicted; so they grow
where the plane was seldom visited, and with the horizon of a forecast.  The half width is
\(q\,\sigma\) with the conformal quantile

\[ q = (|e| / \sigma)_{(\lceil 0.95\,(n + 1) \rceil)} \]

of n residuals (V. Vovk, A. Gammerman, G. Shafer, Algorithmic Learning in a Random World, Springer
2005; J. Lei et al., J. Am. Stat. Assoc. 113 (2018) 1094-1111, sec. 5.2), in slices by speed and
time since the last reversal ("Mondrian") where each has many rows.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from preisach_jax.record import Record
from preisach_jax.record.course import input_rate, last_reversal

COVERAGE = 0.95
"""Share of the rows that a band holds."""

COVERAGE_Z = 1.959963984540054
"""Half width of that of a normal distribution, in deviations."""

SLICES = 3
"""Slices by the speed, and by the time since the last reversal."""

LEAST_ROWS = 3000
"""Rows of a slice from which its own quantile is taken: neighbours in time are much alike."""

LEAST_SHARE = 0.2
"""Least share of the variances that come from other models: where few rows were held out of a
continuation, they would leave its growth to chance."""

OUTLYING = 0.995
"""Quantile of the squared residuals to which greater ones are cut where shares are found."""

CLEAN = 1e-9
"""Least variance of a row over that of all."""

ROUNDS = 8
"""Rounds of reweighting."""

PARTS = 7
"""Parts of the variance."""

STEPS = 512
"""Steps to which what another model differs by is rounded: finer ones only make files longer."""


@dataclass(frozen=True, eq=False)
class Others:
    """Other models that the record could have led to, as differences from the one it did.

    Attributes:
        of_blocks: how many of them, the first ones, come from the record's own blocks; the others
            from the prior.
        weights: (model, cells) weights, in output units.
        offset: (model,) offset, in output units.
        added: (model, coefficient) coefficients of the effects, in their units.
        parameters: (model, parameter) nonlinear parameters of the effects, in their units.
    """

    of_blocks: int
    weights: np.ndarray
    offset: np.ndarray
    added: np.ndarray
    parameters: np.ndarray

    def to_json(self) -> dict[str, Any]:
        """The differences as plain numbers."""
        rows = [_as_text(row) for row in self.weights]
        found: dict[str, Any] = {
            "of_blocks": self.of_blocks,
            "step": [step for step, _ in rows],
            "weights": [text for _, text in rows],
        }
        for name in ("offset", "added", "parameters"):
            found[name] = np.reshape(getattr(self, name), (len(self.offset), -1)).tolist()
        return found

    @staticmethod
    def from_json(content: Mapping[str, Any]) -> Others:
        """The differences of a file's checked numbers."""
        offset, added, parameters = (
            np.array(content[name], dtype=float).reshape(len(content["offset"]), -1)
            for name in ("offset", "added", "parameters")
        )
        weights = np.array(content["weights"], dtype=float) * np.reshape(content["step"], (-1, 1))
        return Others(content["of_blocks"], weights, offset[:, 0], added, parameters)


@dataclass(frozen=True, eq=False)
class Law:
    """How the variance of what a prediction misses goes with what the input does.

    Attributes:
        shares: (7,) of the parts, in squared output units; the last two in 1.
        usual_speed: RMS speed of the input, in its unit per s.
        cell: width of the plane's cells, in the unit of the input.
        least: least half width, that of the noise, in output units.
    """

    shares: np.ndarray
    usual_speed: float
    cell: float
    least: float

    @staticmethod
    def fitted(
        course: Course, residual: np.ndarray, spread: np.ndarray, cell: float, noise: float
    ) -> Law:
        """The law that residuals follow.

        Arguments:
            residual: (row,) measured minus predicted output.
            spread: (row, 2) deviation among other models: of the blocks, and of the prior.
        """
        usual = float(np.sqrt(np.mean(course.speed**2))) or 1.0
        parts = _parts(course, spread, usual, cell)
        squares = np.minimum(residual**2, np.quantile(residual**2, OUTLYING))
        least = np.array([0.0] * (PARTS - 2) + [LEAST_SHARE] * 2)
        size = np.maximum(parts.mean(axis=0), np.finfo(float).tiny)
        shares = least
        variance = np.full(len(squares), squares.mean())
        floor = max(noise**2 / 4, CLEAN * float(squares.mean()))
        for _ in range(ROUNDS if squares.any() else 0):
            scaled = parts / size / variance[:, None]
            left = (squares - parts @ least) / variance
            # Behind a QR decomposition the search does not grow with the rows.
            turned, factor = np.linalg.qr(scaled)
            shares = scipy.optimize.nnls(factor, turned.T @ left)[0] / size + least
            variance = np.maximum(parts @ shares, floor)
        return Law(shares, usual, cell, COVERAGE_Z * noise)

    def deviation(self, course: Course, spread: np.ndarray) -> np.ndarray:
        """(row,) standard deviation of what is missed, in output units."""
        variance = _parts(course, spread, self.usual_speed, self.cell) @ self.shares
        return np.sqrt(np.maximum(variance, np.finfo(float).tiny))

    def by_origin(self, course: Course) -> tuple[np.ndarray, np.ndarray]:
        """(row,) variances beside those of other models: what goes with the speed, and the rest."""
        parts = _parts(course, np.zeros((len(course.speed), 2)), self.usual_speed, self.cell)
        of_speed = parts[:, 1:3] @ self.shares[1:3]
        return of_speed, parts[:, :5] @ self.shares[:5] - of_speed


@dataclass(frozen=True, eq=False)
class Course:
    """What the input does at each row.

    Attributes:
        speed: (row,) in its unit per s.
        since: (row,) time since it last turned, in s.
        travel: (row,) distance from where it last turned, in its unit.
    """

    speed: np.ndarray
    since: np.ndarray
    travel: np.ndarray

    @staticmethod
    def of(record: Record, rows: np.ndarray | slice = slice(None)) -> Course:
        """The course of a record's input at some of its rows."""
        last = last_reversal(record.input, starts=record.starts)
        speed = np.abs(input_rate(record.time, record.input, record.starts))
        since, travel = record.time - record.time[last], np.abs(record.input - record.input[last])
        return Course(speed[rows], since[rows], travel[rows])


@dataclass(frozen=True, eq=False)
class Band:
    """Half widths of a 95 % band.

    Attributes:
        speed: (SLICES - 1,) speeds of the input between the slices, in its unit per s.
        since: (SLICES - 1,) times since the last reversal between the slices, in s.
        half: (SLICES, SLICES) half width by speed and time, in deviations by the law; without one,
            in output units.
        law: how the deviation goes with the input; of files that were written before there was
            one, None.
        others: the models that the law needs; None without a law, and where there are none.
    """

    speed: np.ndarray
    since: np.ndarray
    half: np.ndarray
    law: Law | None = None
    others: Others | None = None

    @staticmethod
    def calibrated(
        course: Course,
        residual: np.ndarray,
        spread: np.ndarray,
        cell: float,
        noise: float,
        others: Others | None = None,
    ) -> Band:
        """The band that holds 95 % of the residuals of each slice.

        Arguments:
            residual: (row,) measured minus predicted output, of predictions by other rows.
            spread: (row, 2) deviation among other models: of the blocks, and of the prior.
            cell: width of the plane's cells, in the unit of the input.
            noise: RMS of the noise, in output units.
        """
        law = Law.fitted(course, residual, spread, cell, noise)
        share = np.arange(1, SLICES) / SLICES
        edges = np.quantile(course.speed, share), np.quantile(course.since, share)
        errors = np.abs(residual) / law.deviation(course, spread)
        by_speed = np.searchsorted(edges[0], course.speed)
        by_time = np.searchsorted(edges[1], course.since)
        half = np.full((SLICES, SLICES), conformal(errors))
        for i in range(SLICES):
            own = by_speed == i
            if own.sum() >= LEAST_ROWS:
                half[i] = conformal(errors[own])
            for j in range(SLICES):
                both = own & (by_time == j)
                if both.sum() >= LEAST_ROWS:
                    half[i, j] = conformal(errors[both])
        return Band(*edges, half, law, others)

    def by_slice(self, course: Course) -> np.ndarray:
        """(row,) half width of the slice of each row, in deviations by the law."""
        by_speed = np.searchsorted(self.speed, course.speed)
        return self.half[by_speed, np.searchsorted(self.since, course.since)]

    def along(self, course: Course, spread: np.ndarray) -> np.ndarray:
        """(row,) half width along a record, in output units.

        Arguments:
            spread: (row, 2) deviation among other models along the input.
        """
        half = self.by_slice(course)
        if self.law is None:
            return half
        return np.maximum(half * self.law.deviation(course, spread), self.law.least)

    def to_json(self) -> dict[str, Any]:
        """The band as plain numbers."""
        law = None
        if self.law is not None:
            law = {
                "shares": self.law.shares.tolist(), "usual_speed": self.law.usual_speed,
                "cell": self.law.cell, "least": self.law.least,
            }  # fmt: skip
        return {
            "speed": self.speed.tolist(), "since_s": self.since.tolist(),
            "half": self.half.ravel().tolist(), "law": law,
            "others": None if self.others is None else self.others.to_json(),
        }  # fmt: skip

    @staticmethod
    def from_json(content: Mapping[str, Any]) -> Band:
        """The band of a file's checked numbers."""
        half = np.reshape(content["half"], (SLICES, SLICES))
        law, others = content["law"], content["others"]
        return Band(
            content["speed"],
            content["since_s"],
            half,
            None if law is None else Law(**law),
            None if others is None else Others.from_json(others),
        )


def conformal(errors: np.ndarray) -> float:
    """The least width that holds 95 % of what comes, if it is like these absolute errors."""
    rank = min(math.ceil(COVERAGE * (len(errors) + 1)), len(errors))
    return float(np.partition(errors, rank - 1)[rank - 1])


def rounded(rows: np.ndarray) -> np.ndarray:
    """Each row to multiples of a power of two, at most `STEPS` of which make its greatest value."""
    steps = np.array([_step(row) for row in rows]).reshape(-1, 1)
    return np.round(rows / steps) * steps


def _step(row: np.ndarray) -> float:
    """The power of two of which at most `STEPS` make the greatest of some values."""
    greatest = float(np.abs(row).max(initial=0.0))
    return math.ldexp(1.0, math.frexp(greatest)[1]) / STEPS if greatest else 1.0


def _as_text(row: np.ndarray) -> tuple[float, str]:
    """A rounded row as its step, and how many of them each value is."""
    step = _step(row)
    return step, " ".join(str(round(count)) for count in (row / step).tolist())


def _parts(course: Course, spread: np.ndarray, usual: float, cell: float) -> np.ndarray:
    """(row, 7) the parts of the variance that `Law.shares` multiply."""
    speed, cells = course.speed / usual, course.travel / cell
    behind = (np.exp(-cells), np.exp(-cells / 4))
    return np.stack([np.ones_like(speed), speed, speed**2, *behind, *(spread.T**2)], axis=1)

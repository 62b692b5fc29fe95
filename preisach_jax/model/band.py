r"""The 95 % band of a prediction, calibrated on rows that did not identify what predicts them.

What a row misses has the variance of a sum of parts, each with a share \(a_i \ge 0\) that the
residuals themselves decide (non-negative least squares, reweighted by the variance):

\[ \sigma^2 = a_0 + a_1 v + a_2 v^2 + a_3 e^{-d/c} + a_4 e^{-d/4c} + a_5 s^2 + a_6 p^2 \]

noise; what goes with the speed v of the input; what the cells of the plane, of width c, miss behind
a reversal, at a distance d; what the record's own blocks would move the prediction by (s, the
sandwich covariance of all coefficients and parameters); and what the smoothness prior has to
decide, since hardly any row decides it (p, the posterior covariance of the weights).  The last two
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
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import jax.numpy as jnp
import numpy as np
import scipy

from preisach_jax.chain.coefficients import Coefficients
from preisach_jax.chain.description import Chain, EffectValues
from preisach_jax.cores import on_processor
from preisach_jax.effects.base import AddedEffect, Signals
from preisach_jax.record.core import Record
from preisach_jax.record.course import input_rate, last_reversal, reversals
from preisach_jax.record.joined import without_rows

COVERAGE = 0.95
"""Share of the rows that a band holds."""

COVERAGE_Z = 1.959963984540054
"""Half width of that of a normal distribution, in deviations."""

SLICES = 3
"""Slices by the speed, and by the time since the last reversal."""

LEAST_ROWS = 3000
"""Rows of a slice from which its own quantile is taken: neighbours in time are much the same."""

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
class VarianceLaw:
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
        motion: InputMotion, residual: np.ndarray, spread: np.ndarray, cell: float, noise: float
    ) -> VarianceLaw:
        """The law that (row,) residuals follow, with a (row, 2) spread among `Others`."""
        usual = float(np.sqrt(np.mean(motion.speed**2))) or 1.0
        parts = _parts(motion, spread, usual, cell)
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
        return VarianceLaw(shares, usual, cell, COVERAGE_Z * noise)

    def deviation(self, motion: InputMotion, spread: np.ndarray) -> np.ndarray:
        """(row,) standard deviation of what is missed, in output units."""
        variance = _parts(motion, spread, self.usual_speed, self.cell) @ self.shares
        return np.sqrt(np.maximum(variance, np.finfo(float).tiny))

    def by_origin(self, motion: InputMotion) -> tuple[np.ndarray, np.ndarray]:
        """(row,) variances but for other models: what goes with the speed, and the rest."""
        parts = _parts(motion, np.zeros((len(motion.speed), 2)), self.usual_speed, self.cell)
        of_speed = parts[:, 1:3] @ self.shares[1:3]
        return of_speed, parts[:, :5] @ self.shares[:5] - of_speed


@dataclass(frozen=True, eq=False)
class InputMotion:
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
    def of(record: Record, rows: np.ndarray | slice = slice(None)) -> InputMotion:
        """That of some of a record's rows."""
        last = last_reversal(record.input, starts=record.starts)
        speed = np.abs(input_rate(record.time, record.input, record.starts))
        since, travel = record.time - record.time[last], np.abs(record.input - record.input[last])
        return InputMotion(speed[rows], since[rows], travel[rows])


@dataclass(frozen=True, eq=False)
class Band:
    """Half widths of a 95 % band.

    Attributes:
        speed: (SLICES - 1,) speeds of the input between the slices, in its unit per s.
        since: (SLICES - 1,) times since the last reversal between the slices, in s.
        half: (SLICES, SLICES) half width by speed and time, in deviations by the law.
        law: how the deviation goes with the input.
        others: the models that the law needs; None where there are none.
    """

    speed: np.ndarray
    since: np.ndarray
    half: np.ndarray
    law: VarianceLaw
    others: Others | None = None

    @staticmethod
    def calibrated(
        motion: InputMotion,
        residual: np.ndarray,
        spread: np.ndarray,
        cell: float,
        noise: float,
        others: Others | None = None,
    ) -> Band:
        """The band that holds 95 % of each slice's (row,) residuals of predictions by other rows.

        `spread` is (row, 2) among `Others`, `cell` the width of a cell of the plane, `noise` RMS.
        """
        law = VarianceLaw.fitted(motion, residual, spread, cell, noise)
        share = np.arange(1, SLICES) / SLICES
        edges = np.quantile(motion.speed, share), np.quantile(motion.since, share)
        errors = np.abs(residual) / law.deviation(motion, spread)
        by_speed = np.searchsorted(edges[0], motion.speed)
        by_time = np.searchsorted(edges[1], motion.since)
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

    def by_slice(self, motion: InputMotion) -> np.ndarray:
        """(row,) half width of the slice of each row, in deviations by the law."""
        by_speed = np.searchsorted(self.speed, motion.speed)
        return self.half[by_speed, np.searchsorted(self.since, motion.since)]

    def along(self, motion: InputMotion, spread: np.ndarray) -> np.ndarray:
        """(row,) half width along a record, in output units."""
        half = self.by_slice(motion) * self.law.deviation(motion, spread)
        return np.maximum(half, self.law.least)

    def to_json(self) -> dict[str, Any]:
        """The band as plain numbers."""
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
        law, others = VarianceLaw(**content["law"]), content["others"]
        others = None if others is None else Others.from_json(others)
        return Band(content["speed"], content["since_s"], half, law, others)


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


def _parts(motion: InputMotion, spread: np.ndarray, usual: float, cell: float) -> np.ndarray:
    """(row, 7) the parts of the variance that `VarianceLaw.shares` multiply."""
    speed, cells = motion.speed / usual, motion.travel / cell
    behind = (np.exp(-cells), np.exp(-cells / 4))
    return np.stack([np.ones_like(speed), speed, speed**2, *behind, *(spread.T**2)], axis=1)


Numbers = tuple[Mapping[str, Mapping[str, float]], Coefficients]
"""Nonlinear parameters by effect and name, and linear coefficients."""

MOST_ROWS = 8_000
"""Samples of a longer record along which other models are simulated, straight in between."""

SMALL_TURN = 0.002
"""Share of the input's range by which it must come back for a turn to be among them."""


def differences(
    chain: Chain,
    here: Numbers,
    others: Others | None,
    record: Record,
    run: Callable[[Numbers, Record], np.ndarray],
) -> tuple[np.ndarray, np.ndarray]:
    """Rows, all or the `few_rows`, and (model, row) what others predict minus what `here` does."""
    count = len(record.time)
    rows = few_rows(record) if count > MOST_ROWS else np.arange(count)
    if others is None or not len(others.offset):
        return rows, np.zeros((0, len(rows)))
    few = without_rows(record, rows) if count > MOST_ROWS else record
    middle = run(here, few)
    apart = [run(_other(chain, here, others, k), few) - middle for k in range(len(others.offset))]
    return rows, np.stack(apart)


def spread_of(
    chain: Chain,
    here: Numbers,
    others: Others | None,
    record: Record,
    run: Callable[[Numbers, Record], np.ndarray],
) -> np.ndarray:
    """(time, 2) deviation of the output among models of the record's blocks, and of the prior."""
    if others is None:
        return np.zeros((len(record.time), 2))
    kept, apart = differences(chain, here, others, record, run)
    parts = (apart[: others.of_blocks], apart[others.of_blocks :])
    spread = np.sqrt(np.stack([np.sum(part**2, axis=0) for part in parts], axis=1))
    if len(kept) == len(record.time):
        return spread
    rows = np.arange(len(record.time))
    columns: list[np.ndarray] = [np.interp(rows, kept, column) for column in spread.T]
    return np.stack(columns, axis=1)


def few_rows(record: Record) -> np.ndarray:
    """Samples of a long record to keep: its ends, where the input turns, and evenly in between."""
    count = len(record.time)
    turns = reversals(record.input, SMALL_TURN * float(np.ptp(record.input)), record.starts)
    kept = np.zeros(count, dtype=bool)
    kept[[0, count - 1, *record.starts]] = True
    kept[turns] = True
    left = np.flatnonzero(~kept)
    more = max(MOST_ROWS - int(kept.sum()), 0)
    kept[left[np.arange(more) * len(left) // max(more, 1)]] = True
    return np.flatnonzero(kept)


def _other(chain: Chain, here: Numbers, others: Others, k: int) -> Numbers:
    values = {effect: dict(own) for effect, own in here[0].items()}
    names = [(e.name, p.name) for e in chain.effects for p in e.parameters()]
    for (effect, name), change in zip(names, others.parameters[k].tolist(), strict=True):
        values[effect][name] += change
    coefficients = replace(
        here[1],
        weights=here[1].weights + others.weights[k],
        offset=here[1].offset + float(others.offset[k]),
        added=here[1].added + others.added[k],
    )
    return values, coefficients


POINTS = 512
"""Times at which what an effect did along the record is looked at."""

LONGEST_LAG = 0.5
"""Share of the record up to which lags are measured; beyond it variance grows with time."""


def drift_deviation(
    chain: Chain,
    values: EffectValues,
    coefficients: Coefficients,
    span: tuple[float, float],
    time: np.ndarray,
    goes_on: bool,
) -> np.ndarray:
    r"""Standard deviation of what effects that depend on time alone do beyond what was recorded.

    Behind the record, a drift that follows no law stays where it was, and a prediction misses it by
    the structure function of the drift at the lag since then,
    \(D(h) = \langle (d(t + h) - d(t))^2 \rangle\) (A. M. Yaglom, Correlation Theory of Stationary
    and Related Random Functions I, Springer 1987, ch. 4), which grows as that of a random walk
    beyond the lags that can be measured. In another record, any drift or hum has another course,
    of which that of this one is a sample: twice its variance.

    `span` is that of the identified record, `time` (time,) of the predicted one, in s; `goes_on`
    says whether the second begins with the first.
    """
    variance = np.zeros(len(time))
    seen = np.linspace(0.0, span[1] - span[0], POINTS)
    first = 0
    for effect in chain.at(AddedEffect):
        count = len(effect.coefficients())
        own, first = coefficients.added[first : first + count], first + count
        if not effect.of_time_alone or (goes_on and not effect.nonparametric):
            continue
        with on_processor():
            path = jnp.linspace(0.0, getattr(effect, "horizon_s", 0.0), POINTS)
            along = Signals(jnp.asarray(seen), jnp.zeros(POINTS), {}, gone=path)
            course = np.asarray(effect.at(values[effect.name]).columns(along)) @ own
        if goes_on:
            ahead = np.maximum(time - span[1], 0.0)
            variance += _structure(course, ahead / seen[1])
        else:
            variance += 2 * course.var()
    return np.sqrt(variance)


def _structure(course: np.ndarray, lag: np.ndarray) -> np.ndarray:
    """Mean square of the increments of a course over lags in samples."""
    most = round(LONGEST_LAG * len(course))
    known = [0.0, *(float(np.mean((course[k:] - course[:-k]) ** 2)) for k in range(1, most + 1))]
    found: np.ndarray = np.interp(lag, np.arange(most + 1), known)
    return found * np.maximum(lag / most, 1.0)

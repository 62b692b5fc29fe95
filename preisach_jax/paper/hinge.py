"""Two straight lines that meet: the asymptotes of a convergence, by least squares."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from preisach_jax.errors import InputError


class Hinge(NamedTuple):
    """Two straight lines that meet, the later one level.

    Attributes:
        knee: where they meet.
        slope: slope of the earlier line.
        level: height of the later one.
        deviation: RMS distance of the points from the lines.
    """

    knee: float
    slope: float
    level: float
    deviation: float

    def __call__(self, k: ArrayLike) -> np.ndarray:
        """Height of the lines at k."""
        return self.level + self.slope * np.minimum(np.asarray(k) - self.knee, 0.0)


def fit_hinge(k: ArrayLike, y: ArrayLike, candidates: int = 500) -> Hinge:
    """Fit a line and, after it, a level, which meet, by least squares.

    y = level + slope · min(k - knee, 0). Level and slope are solved for at each candidate knee.

    Arguments:
        k: (points,) abscissae, ascending.
        y: (points,) values.
    """
    k, y = np.asarray(k, float), np.asarray(y, float)
    if k.size < 10:
        raise InputError(f"there are {k.size} points: give at least 10 for two lines")
    knees = np.linspace(float(k[1]), float(k[-2]), candidates)
    bent = np.minimum(k - knees[:, np.newaxis], 0.0)
    bent_mean, y_mean = bent.mean(axis=1), y.mean()
    spread = np.sum(bent * bent, axis=1) - k.size * bent_mean**2
    slopes = (bent @ y - k.size * bent_mean * y_mean) / spread
    best = int(np.argmax(slopes**2 * spread))
    level = y_mean - slopes[best] * bent_mean[best]
    rest: np.ndarray = y - level - slopes[best] * bent[best]
    return Hinge(
        knee=float(knees[best]),
        slope=float(slopes[best]),
        level=float(level),
        deviation=float(np.sqrt(np.mean(rest**2))),
    )


def knee_interval(
    k: ArrayLike, rows: ArrayLike, draws: int = 400, seed: int = 0
) -> tuple[float, float]:
    """95 % interval of the knee of log10 of the mean of rows, by drawing rows with replacement.

    Arguments:
        k: (points,) abscissae, ascending.
        rows: (rows, points) positive values, each row an independent realisation.

    Returns:
        `(low, high)`.
    """
    rows = np.asarray(rows, float)
    rng = np.random.default_rng(seed)
    picks = rng.integers(len(rows), size=(draws, len(rows)))
    knees = [fit_hinge(k, np.log10(rows[pick].mean(axis=0))).knee for pick in picks]
    low, high = np.quantile(knees, [0.025, 0.975])
    return float(low), float(high)

"""The grid of the Preisach half-plane: its levels, limits, thresholds and cells."""

from __future__ import annotations

import math

import equinox as eqx
import numpy as np

from preisach_jax.errors import InputError, shown, whole_number

MOST_LEVELS = 10_000
"""Of a plane: it has 50 million hysterons, each with a weight."""


def _levels(value: int) -> int:
    return whole_number("levels is", value, least=2, most=MOST_LEVELS)


def _limit(value: float) -> float:
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"a limit of the plane is {shown(value)}: give a number") from error


class Grid(eqx.Module):
    """Where the thresholds of a `Plane` lie.

    Arguments:
        levels: N ≥ 2, the levels of each axis.
        low: lower limit of the input, in its unit.
        high: upper limit of the input, in its unit; above `low`.

    Raises:
        InputError: `levels` is below 2, or the limits are not finite and ascending.
    """

    levels: int = eqx.field(static=True, converter=_levels)
    low: float = eqx.field(static=True, converter=_limit)
    high: float = eqx.field(static=True, converter=_limit)

    def __check_init__(self) -> None:
        for name, limit in (("low", self.low), ("high", self.high)):
            if not math.isfinite(limit):
                raise InputError(f"{name} is {limit}: the limits of the plane must be finite")
        if not self.low < self.high:
            raise InputError(f"low is {self.low} and high is {self.high}: low must be below high")

    @property
    def cells(self) -> int:
        """L = N(N+1)/2, the number of hysterons."""
        return self.levels * (self.levels + 1) // 2

    @property
    def delta_x(self) -> float:
        """δx = (high - low)/N, the width of a cell in the unit of the input."""
        return (self.high - self.low) / self.levels

    @property
    def thresholds(self) -> np.ndarray:
        """(levels,) thresholds, ascending, in the unit of the input."""
        return self.low + (np.arange(self.levels) + 0.5) * self.delta_x

    @property
    def alpha_index(self) -> np.ndarray:
        """(cells,) index of each cell's α in `thresholds`."""
        return np.tril_indices(self.levels)[0]

    @property
    def beta_index(self) -> np.ndarray:
        """(cells,) index of each cell's β in `thresholds`."""
        return np.tril_indices(self.levels)[1]

    @property
    def alpha(self) -> np.ndarray:
        """(cells,) upper threshold α of each hysteron, in the unit of the input."""
        return self.thresholds[self.alpha_index]

    @property
    def beta(self) -> np.ndarray:
        """(cells,) lower threshold β of each hysteron, in the unit of the input."""
        return self.thresholds[self.beta_index]

"""The grid of the Preisach half-plane: its levels, limits, thresholds and cells."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, cast

import equinox as eqx
import jax
import numpy as np
from jax.core import Tracer
from jax.typing import ArrayLike

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
    """Where the thresholds of a `Plane` lie."""

    levels: int = eqx.field(static=True)
    low: float = eqx.field(static=True)
    high: float = eqx.field(static=True)
    own_thresholds: Any

    def __init__(
        self,
        levels: int,
        low: float,
        high: float,
        thresholds: ArrayLike | Sequence[float] | None = None,
    ) -> None:
        self.levels, self.low, self.high = _levels(levels), _limit(low), _limit(high)
        for name, limit in (("low", self.low), ("high", self.high)):
            if not math.isfinite(limit):
                raise InputError(f"{name} is {limit}: the limits of the plane must be finite")
        if not self.low < self.high:
            raise InputError(f"low is {self.low} and high is {self.high}: low must be below high")
        self.own_thresholds = None if thresholds is None else self._checked(thresholds)

    def _checked(self, thresholds: Any) -> Any:
        """Thresholds of one's own, in double precision if they are known."""
        if np.shape(thresholds) != (self.levels,):
            raise InputError(
                f"thresholds has the shape {np.shape(thresholds)}: give ({self.levels},), one each"
            )
        if isinstance(thresholds, Tracer):
            return cast(Any, thresholds)
        try:
            values = np.asarray(thresholds, float)
        except (TypeError, ValueError) as error:
            raise InputError(f"thresholds holds {shown(thresholds)}: give numbers") from error
        used = values[: int(np.isfinite(values).sum())]
        if not used.size or not np.all(values[used.size :] == np.inf):
            raise InputError(
                f"thresholds holds {shown(values)}: give numbers, and infinity only after the last"
            )
        steps = np.diff(used, prepend=self.low, append=self.high)
        if not np.all(steps > 0):
            k = int(np.argmax(steps <= 0))
            raise InputError(
                f"thresholds[{min(k, used.size - 1)}] is {used[min(k, used.size - 1)]}: give "
                f"ascending thresholds between low, {self.low}, and high, {self.high}"
            )
        return thresholds if isinstance(thresholds, jax.Array) else values

    @property
    def cells(self) -> int:
        """L = N(N+1)/2, the number of hysterons."""
        return self.levels * (self.levels + 1) // 2

    @property
    def delta_x(self) -> float:
        """δx = (high - low)/N, the (mean) width of a cell in the unit of the input."""
        return (self.high - self.low) / self.levels

    @property
    def thresholds(self) -> Any:
        """(levels,) thresholds, ascending, in the unit of the input; JAX's if they are traced."""
        if self.own_thresholds is not None:
            return self.own_thresholds
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
    def alpha(self) -> Any:
        """(cells,) upper threshold α of each hysteron, in the unit of the input."""
        return self.thresholds[self.alpha_index]

    @property
    def beta(self) -> Any:
        """(cells,) lower threshold β of each hysteron, in the unit of the input."""
        return self.thresholds[self.beta_index]

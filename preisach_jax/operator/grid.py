"""The grid of the Preisach half-plane: its levels, limits, thresholds and cells."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import numpy as np


class Grid(eqx.Module):
    """Where the thresholds of a `Plane` lie."""

    levels: int = eqx.field(static=True)
    low: float = eqx.field(static=True)
    high: float = eqx.field(static=True)
    own_thresholds: Any

    def __hash__(self) -> int:
        return hash((self.levels, self.low, self.high))  # arrays have none

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

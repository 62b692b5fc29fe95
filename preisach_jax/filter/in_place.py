"""The adaptive filter's step in NumPy, on arrays that are changed in place."""

from __future__ import annotations

import dataclasses
import math
from bisect import bisect_left, bisect_right
from functools import lru_cache

import jax.numpy as jnp
import numpy as np

from preisach_jax.errors import InputError
from preisach_jax.filter.adaptive import AdaptiveFilter
from preisach_jax.filter.state import FilterState
from preisach_jax.operator.hysteron import position_on
from preisach_jax.operator.moves import EVENT_SIZE


class Recursion:
    """`AdaptiveFilter.step` in NumPy, on arrays that are changed in place.

    Where the input has moved from one place between levels to another, only those hysterons can
    have moved that lie on a row or a column of the plane passed on the way (`_cells_passed`). The
    places since the sample before bound what the states need, (2), and those since the reference
    sample what the weights need, (7), (8). The output (6) is summed afresh whenever a state or a
    weight has changed, so that rounding does not pile up.
    """

    def __init__(self, filt: AdaptiveFilter, state: FilterState):
        dtype, plane = np.dtype(state.weights.dtype), filt.plane
        self._type, self._levels, self._ramps = dtype.type, plane.levels, filt.hysteron == "ramp"
        self._thresholds = np.asarray(plane.thresholds, dtype).tolist()
        self._plane = plane
        self._on_below = np.tri(plane.levels + 1, plane.levels, -1, dtype)
        self._every_sample = filt.sampling == "sample"
        self._least = float(np.finfo(dtype).eps) if self._every_sample else EVENT_SIZE
        self._largest = float(np.finfo(dtype).max)
        self._step_size = float(np.asarray(filt.step_size, dtype))
        dead_zone, limit = filt.dead_zone, filt.error_limit
        self._dead_zone = -1.0 if dead_zone is None else float(np.asarray(dead_zone, dtype))
        self._error_limit = math.inf if limit is None else float(np.asarray(limit, dtype))
        self._nonnegative, self._plain = filt.nonnegative, not filt.options()
        self._leakage = None if filt.leakage is None else np.asarray(filt.leakage, dtype)
        self._prior = np.asarray(filt.initial_weight, dtype)

        self.weights, self.states = np.array(state.weights), np.array(state.states, dtype)
        self.input, self.reference_output = float(state.input), float(state.reference_output)
        self.reference_states = np.array(state.reference_states, dtype)
        # Hysterons with α below `_risen` are on, those with β above `_fallen` off. Of a state from
        # elsewhere nothing is taken for granted, and it may differ everywhere from its reference.
        self._risen, self._fallen = 0, plane.levels
        self._passed: tuple[int, int] | None = (0, plane.levels)
        self._output: float | None = None

    @classmethod
    def start(cls, filt: AdaptiveFilter, x: float, z: float) -> Recursion:
        """Start from saturated low as `AdaptiveFilter.init` does, with nothing to compile."""
        dtype = jnp.result_type(float)
        zeros = np.zeros(filt.plane.cells, dtype)
        weights = np.broadcast_to(np.asarray(filt.initial_weight, dtype), zeros.shape)
        arrays = (weights, zeros, np.asarray(x, dtype), zeros, np.asarray(np.nan, dtype))
        begun = cls(filt, FilterState(*(jnp.asarray(array) for array in arrays)))
        begun.step(x, math.nan)
        begun._refer_to(begun._rounded(z))
        return begun

    def state(self) -> FilterState:
        """A copy of the state for JAX."""
        arrays = {f.name: getattr(self, f.name) for f in dataclasses.fields(FilterState)}
        return FilterState(**{n: jnp.asarray(np.array(a, self._type)) for n, a in arrays.items()})

    def step(self, x: float, z: float, adapt: bool = True) -> tuple[float, float, float]:
        """Take in one sample; what `FilterInfo` records of it, eq. (6), (7), (11)."""
        z = self._rounded(z)
        self._move(self._rounded(x))
        if self._output is None:
            self._output = dot(self.weights, self.states)
        output, error, switched = self._output, z - self.reference_output, 0.0
        renew = self._every_sample
        if self._passed and not math.isnan(error):
            cells, _, _ = _cells_passed(self._levels, *self._passed)
            s = self.states[cells] - self.reference_states[cells]
            squared = dot(s, s)
            error -= dot(self.weights[cells], s)
            if squared >= self._least and abs(error) <= self._largest:
                renew = True
                if adapt and abs(error) > self._dead_zone:
                    if self._plain:
                        self.weights[cells] += self._step_size * error / squared * s
                    else:
                        self._learn(cells, s, squared, error)
                    self._output, switched = None, squared
            elif squared == 0.0:
                self._passed = None
        starting = math.isfinite(z) and not math.isfinite(self.reference_output)
        if renew or starting:
            self._refer_to(z)
        return output, error, switched

    def _learn(self, cells: np.ndarray, s: np.ndarray, squared: float, error: float) -> None:
        """Update the weights with the options of the filter."""
        if self._leakage is not None:
            self.weights += self._leakage * (self._prior - self.weights)
        error = min(max(error, -self._error_limit), self._error_limit)
        new: np.ndarray = self.weights[cells] + self._type(self._step_size * error / squared) * s
        if self._nonnegative:
            new = np.where(s != 0, np.maximum(new, 0), new)
        self.weights[cells] = new

    def _rounded(self, value: float) -> float:
        """A number in the precision of the filter."""
        if abs(value) > self._largest:
            raise InputError(f"{value} is beyond what {self._type.__name__} holds: change the unit")
        return float(self._type(value))

    def _refer_to(self, z: float) -> None:
        """Let differences run from this sample."""
        if self._passed:
            cells, _, _ = _cells_passed(self._levels, *self._passed)
            self.reference_states[cells] = self.states[cells]
        self.reference_output, self._passed = z, None

    def _move(self, x: float) -> None:
        """Bring the states to the next input, eq. (2)-(4)."""
        if self._ramps:
            place = position_on(self._plane, self._type(x))
            risen = fallen = min(max(float(place), 0.0), float(self._levels))
        else:
            # Of a threshold on which the input rests, `thresholds_reached` tells what is decided.
            below, up_to = bisect_left(self._thresholds, x), bisect_right(self._thresholds, x)
            risen = up_to if x > self.input else below
            fallen = below if x < self.input else up_to
        if risen > self._risen or fallen < self._fallen:
            first = math.floor(min(self._risen, fallen))
            last = math.ceil(max(risen, self._fallen))
            cells, rows, columns = _cells_passed(self._levels, first, last)
            states = np.maximum(self.states[cells], self._on(risen)[rows])
            least, most = self._passed or (first, last)
            self._passed, self._output = (min(first, least), max(last, most)), None
            self.states[cells] = np.minimum(states, self._on(fallen)[columns])
        self.input, self._risen, self._fallen = x, risen, fallen

    def _on(self, place: float) -> np.ndarray:
        """(levels,) how far thresholds are reached: ones below a place, and its part of a level."""
        whole = int(place)
        on = self._on_below[whole]
        if place > whole:
            on = on.copy()
            on[whole] = place - whole
        return on


def dot(a: np.ndarray, b: np.ndarray) -> float:
    """Σ a b, in pieces for which BLAS starts no threads: these can be late by milliseconds."""
    return sum(float(a[i : i + 8192] @ b[i : i + 8192]) for i in range(0, a.size, 8192))


@lru_cache(maxsize=32)
def _cells_passed(levels: int, first: int, last: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Flat, α and β indices of the cells with first ≤ i < last or first ≤ j < last."""
    passed, beyond = np.arange(first, last), np.arange(last, levels)
    whole_rows = np.arange(first * (first + 1) // 2, last * (last + 1) // 2)
    of_columns = (beyond * (beyond + 1) // 2)[:, np.newaxis] + passed
    cells = np.concatenate([whole_rows, of_columns.ravel()])
    rows = np.concatenate([np.repeat(passed, passed + 1), np.repeat(beyond, passed.size)])
    return cells, rows, cells - rows * (rows + 1) // 2

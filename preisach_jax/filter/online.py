"""The adaptive filter fed by sample or by block, with a state that can be kept on disk."""

from __future__ import annotations

import dataclasses
import math
import os
from bisect import bisect_left, bisect_right
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from preisach_jax.errors import InputError
from preisach_jax.files import read_arrays, write_arrays
from preisach_jax.filter.adaptive import AdaptiveFilter
from preisach_jax.filter.state import (
    FilterInfo,
    FilterState,
    checked_adapt,
    input_and_output,
    require_state,
)
from preisach_jax.operator.events import rounded_up
from preisach_jax.operator.inputs import as_float
from preisach_jax.operator.moves import EVENT_SIZE
from preisach_jax.operator.plane import Plane, position_on
from preisach_jax.operator.states import require_on_plane

# 1 had no step size: it was 1.0; 2 had no count of missing samples and no last output; 3 had no
# options, of the filter or for inputs beyond the plane.
FORMAT = 4

FEW_SAMPLES = 16
"""Blocks of fewer samples are not filled up: that would take longer than their lengths are many."""


class Missing(NamedTuple):
    """How many samples were not there.

    Attributes:
        inputs: samples without an input, which were skipped.
        outputs: samples with an input and no measured output, by which no weight was changed.
    """

    inputs: int
    outputs: int


class OnlineFilter:
    """The adaptive filter for a running machine: one sample or block in, the model's output out.

    Holds the state of `filt` between calls, eq. (5)-(12). It is the state of `AdaptiveFilter.run`:
    a batch can be continued here (`state=result.state`) and this in a batch
    (`filt.run(x, z, state=online.state)`). Single samples are taken in by NumPy, at a cost of
    O(N w) for an input that passes w levels, and blocks by the compiled `run`; the results are
    the same to rounding.

    A sample whose output is missing (NaN) moves the hysterons and leaves the weights. One whose
    input is missing is skipped: the next one follows the one before it. Both are counted.

    An input beyond the plane is refused, or with `saturate` taken for that at the plane's limit, at
    which all hysterons are on, or off: none moves, and none is changed, until it comes back.

    What is kept does not age: ẑ is summed afresh from weights and states whenever one of them has
    changed, differences run from the last event alone, and counts are whole numbers of any size.

    Arguments:
        filt: the adaptive filter.
        state: the state to continue from; without it the first call starts from saturated low.
        saturate: whether inputs beyond the plane are moved to its limits, and counted.

    Raises:
        InputError: `filt` is no adaptive filter, `state` is not one of its plane, or `saturate` is
            not a truth value.

    Example:
        >>> online = OnlineFilter(AdaptiveFilter(Plane(levels=4, low=0.0, high=1.0)))
        >>> outputs = [online(x, 3.0 * x) for x in (0.0, 0.3, 0.6, 0.9, 0.4)]
        >>> round(outputs[-1], 3)
        2.314
        >>> online(math.nan, 1.2) == outputs[-1], online.missing
        (True, Missing(inputs=1, outputs=0))
    """

    def __init__(
        self, filt: AdaptiveFilter, state: FilterState | None = None, saturate: bool = False
    ):
        if not isinstance(filt, AdaptiveFilter):
            raise InputError(f"the filter is {type(filt).__name__}: give an AdaptiveFilter")
        if not isinstance(saturate, bool):
            raise InputError(f"saturate is {saturate!r}: give True or False")
        self._filter, self._saturate = filt, saturate
        # Looked up at every sample, and quicker here than in an equinox module.
        self._low, self._high = filt.plane.low, filt.plane.high
        self._rows: tuple[Any, Any, Any] | None = None
        self._inputs_missing = self._outputs_missing = self._saturated = 0
        self.state = state

    @property
    def filter(self) -> AdaptiveFilter:
        """The adaptive filter."""
        return self._filter

    @property
    def state(self) -> FilterState | None:
        """The state after the last sample (None before the first); it may be replaced."""
        if self._state is None and self._recursion is not None:
            self._state = self._recursion.state()
        return self._state

    @state.setter
    def state(self, state: FilterState | None) -> None:
        self._output = math.nan
        if state is not None:
            require_state(self._filter.plane, state, FilterState)
            self._output = _dot(np.asarray(state.weights), np.asarray(state.states))
        # Of a state for JAX and one in NumPy, what is not up to date is None.
        self._state, self._recursion = state, None

    @property
    def info(self) -> FilterInfo | None:
        """What was recorded of the last sample; after a block, the rows of its samples."""
        return None if self._rows is None else FilterInfo(*self._rows)

    @property
    def missing(self) -> Missing:
        """How many samples came without an input, and how many without an output."""
        return Missing(self._inputs_missing, self._outputs_missing)

    @property
    def saturated(self) -> int:
        """How many samples had an input beyond the plane, and were moved to its limit."""
        return self._saturated

    def __call__(self, x: float, z: float = math.nan, adapt: bool = True) -> float:
        """Take in one sample, adapt, and return the model's output.

        Arguments:
            x: input, in the unit of the plane; NaN if it is missing (the sample is then skipped).
            z: measured output, in its unit; NaN if it is missing (the weights then stay).
            adapt: whether to learn; without it the weights stay, and all else goes on.

        Returns:
            ẑ with the weights before this sample's update, in the unit of the output; of a skipped
            sample, that of the sample before (NaN if there was none).

        Raises:
            InputError: `x` or `z` is no number or is infinite, `x` leaves the plane and does not
                saturate, or `adapt` is not a truth value; the state is then as before.
        """
        try:
            x, z = float(x), float(z)
        except (TypeError, ValueError):
            raise InputError(
                f"x is {x!r} and z is {z!r}: give two numbers, and arrays to `block`"
            ) from None
        missing, beyond = math.isnan(x), False
        if not (missing or self._low <= x <= self._high):
            beyond = self._saturate and math.isfinite(x)
            if beyond:
                x = min(max(x, self._low), self._high)
            else:
                require_on_plane(self._filter.plane, x)
        if math.isinf(z):
            raise InputError(f"the output z is {z}: give NaN where the output is missing")
        if adapt is not True:
            adapt = checked_adapt(adapt)
        if missing:
            self._inputs_missing += 1
            self._rows = self._output, math.nan, 0.0
            return self._output
        recursion, state = self._recursion, self._state
        if recursion is None:
            recursion = (
                _SampleRecursion.start(self._filter, x, z)
                if state is None
                else _SampleRecursion(self._filter, state)
            )
        self._rows = recursion.step(x, z, adapt)
        self._recursion, self._state = recursion, None
        if beyond:
            self._saturated += 1
        self._outputs_missing += math.isnan(z)
        self._output = self._rows[0]
        return self._output

    def block(self, x: ArrayLike, z: ArrayLike | None = None, adapt: bool = True) -> np.ndarray:
        """Take in a block of samples, adapt, and return the model's output.

        The same as one call a sample. Blocks of like lengths share what is compiled: there are at
        most eight lengths an octave.

        Arguments:
            x: (time,) input, in the unit of the plane; NaN where it is missing.
            z: (time,) measured output, in its unit; NaN where it is missing, and None if it is
                missing throughout.
            adapt: whether to learn; without it the weights stay, and all else goes on.

        Returns:
            (time,) outputs ẑ, each with the weights before that sample's update, in the unit of the
            output.

        Raises:
            InputError: lengths or types are wrong, an input leaves the plane and does not saturate,
                a value is infinite, or `adapt` is not a truth value; the state is then as before.

        Example:
            >>> online = OnlineFilter(AdaptiveFilter(Plane(levels=4, low=0.0, high=1.0)))
            >>> x = np.array([0.0, 0.3, 0.6, 0.9, 0.4])
            >>> round(float(online.block(x, 3.0 * x)[-1]), 3)
            2.314
        """
        x = _float_array(x, "the input x")
        z = np.full_like(x, np.nan) if z is None else _float_array(z, "the output z")
        samples = x.size
        # A last sample that is repeated changes nothing, and so fills the block up to a length that
        # is compiled already.
        if x.ndim == 1 and x.shape == z.shape and samples >= FEW_SAMPLES:
            x, z = (np.pad(row, (0, rounded_up(samples) - samples), mode="edge") for row in (x, z))
        there, beyond = ~np.isnan(x), np.zeros(x.shape, bool)
        if self._saturate:
            beyond = np.isfinite(x) & ((x < self._low) | (x > self._high))
            x = np.where(beyond, np.clip(x, self._low, self._high), x)
        x, z = input_and_output(self._filter.plane, np.where(there, x, x.dtype.type(self._low)), z)
        # What is there comes first, and then its last sample once more for each that is missing.
        nth = np.cumsum(there) - 1  # of those that are there, the last up to each sample
        if nth[-1] < 0:
            output = np.full(x.shape, self._output)
            error, switched = np.full_like(output, np.nan), np.zeros_like(output)
        else:
            order = np.flatnonzero(there)[np.minimum(np.arange(x.size), nth[-1])]
            result = self._filter.run(
                np.asarray(x)[order], np.asarray(z)[order], self.state, adapt=adapt
            )
            output, error, switched = (np.asarray(rows)[nth] for rows in result[1:4])
            output = np.where(nth < 0, output.dtype.type(self._output), output)
            error, switched = np.where(there, error, np.nan), np.where(there, switched, 0.0)
            self.state = result.state
        output, error, switched = (row[:samples] for row in (output, error, switched))
        there, beyond, z = (row[:samples] for row in (there, beyond, np.asarray(z)))
        self._rows, self._output = (output, error, switched), float(output[-1])
        self._saturated += int(np.sum(beyond))
        self._inputs_missing += int(np.sum(~there))
        self._outputs_missing += int(np.sum(there & np.isnan(z)))
        return output

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the filter and its state to a file; an existing one is replaced in one go.

        Arguments:
            path: the file, NumPy's `.npz` format whatever its name.

        Raises:
            InputError: the file cannot be written.
        """
        plane = self.filter.plane
        about = {
            "format": FORMAT,
            "levels": plane.levels,
            "low": plane.low,
            "high": plane.high,
            "hysteron": self.filter.hysteron,
            "sampling": self.filter.sampling,
            "options": self.filter.options(),
            "saturate": self._saturate,
        }
        arrays = {
            "initial_weight": np.asarray(self.filter.initial_weight),
            "step_size": np.asarray(self.filter.step_size),
            "missing": np.asarray(self.missing),
            "saturated": np.asarray(self.saturated),
            "output": np.asarray(self._output),
        }
        if plane.own_thresholds is not None:
            arrays["thresholds"] = np.asarray(plane.thresholds)
        if self.state is not None:
            arrays |= {f"state.{name}": np.asarray(a) for name, a in vars(self.state).items()}
        write_arrays(Path(path), about, arrays)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> OnlineFilter:
        """Read a filter and its state from a file written by `save`.

        Arguments:
            path: the file.

        Returns:
            A filter that goes on as the saved one would have (in single precision, where JAX is not
            set to double).

        Raises:
            InputError: the file is missing, broken, or of another format.
        """
        remedy = "give a file that `save` wrote"
        with read_arrays(Path(path), FORMAT, "a saved filter", remedy) as (about, stored):
            thresholds = stored["thresholds"] if "thresholds" in stored.files else None
            filt = AdaptiveFilter(
                Plane(about["levels"], about["low"], about["high"], thresholds),
                about["hysteron"],
                about["sampling"],
                stored["initial_weight"],
                stored["step_size"],
                **about["options"],
            )
            names = [name for name in stored.files if name.startswith("state.")]
            arrays = {n.removeprefix("state."): jnp.asarray(stored[n]) for n in names}
            online = cls(filt, FilterState(**arrays) if arrays else None, about["saturate"])
            online._inputs_missing, online._outputs_missing = stored["missing"].tolist()
            online._output = stored["output"].item()
            online._saturated = stored["saturated"].item()
        return online


def _float_array(values: ArrayLike, name: str) -> np.ndarray:
    """What `as_float` gives, in NumPy: JAX compiles for each shape that it is handed."""
    if isinstance(values, np.ndarray) and values.dtype.kind == "f":
        return values.astype(jax.dtypes.canonicalize_dtype(values.dtype), copy=False)
    return np.asarray(as_float(values, name))


# --- single samples, in NumPy ---


class _SampleRecursion:
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
    def start(cls, filt: AdaptiveFilter, x: float, z: float) -> _SampleRecursion:
        """Start from saturated low as `AdaptiveFilter.init` does, with nothing to compile."""
        dtype = jnp.result_type(float)
        zeros = np.zeros(filt.plane.cells, dtype)
        weights = np.broadcast_to(np.asarray(filt.initial_weight, dtype), zeros.shape)
        arrays = (weights, zeros, np.asarray(x, dtype), zeros, np.asarray(np.nan, dtype))
        started = cls(filt, FilterState(*(jnp.asarray(array) for array in arrays)))
        started.step(x, math.nan)
        started._refer_to(started._rounded(z))
        return started

    def state(self) -> FilterState:
        """A copy of the state for JAX."""
        arrays = {f.name: getattr(self, f.name) for f in dataclasses.fields(FilterState)}
        return FilterState(**{n: jnp.asarray(np.array(a, self._type)) for n, a in arrays.items()})

    def step(self, x: float, z: float, adapt: bool = True) -> tuple[float, float, float]:
        """Take in one sample; what `FilterInfo` records of it, eq. (6), (7), (11)."""
        z = self._rounded(z)
        self._move(self._rounded(x))
        if self._output is None:
            self._output = _dot(self.weights, self.states)
        output, error, switched = self._output, z - self.reference_output, 0.0
        renew = self._every_sample
        if self._passed and not math.isnan(error):
            cells, _, _ = _cells_passed(self._levels, *self._passed)
            s = self.states[cells] - self.reference_states[cells]
            squared = _dot(s, s)
            error -= _dot(self.weights[cells], s)
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


def _dot(a: np.ndarray, b: np.ndarray) -> float:
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

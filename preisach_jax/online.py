"""The adaptive filter fed one sample at a time, with a state that can be kept on disk."""

from __future__ import annotations

import math
import os
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from preisach_jax.errors import InputError
from preisach_jax.files import read_arrays, write_arrays
from preisach_jax.filter import AdaptiveFilter, FilterInfo, FilterState, require_state
from preisach_jax.hysteron import require_on_plane
from preisach_jax.plane import Plane

FORMAT = 2  # 1 had no step size: it was 1.0

_start = jax.jit(AdaptiveFilter.init)
_step = jax.jit(AdaptiveFilter.step)


class OnlineFilter:
    """The adaptive filter for a running machine: one sample in, the model's output out.

    Holds the state of `filt` between calls, eq. (5)-(12). It is the state of `AdaptiveFilter.run`:
    a batch can be continued here (`state=result.state`) and this in a batch
    (`filt.run(x, z, state=online.state)`).

    Args:
        filt: the adaptive filter.
        state: the state to continue from; without it the first call starts from saturated low.

    Raises:
        InputError: `filt` is no adaptive filter, or `state` is not one of its plane.

    Example:
        >>> online = OnlineFilter(AdaptiveFilter(Plane(levels=4, low=0.0, high=1.0)))
        >>> outputs = [online(x, 3.0 * x) for x in (0.0, 0.3, 0.6, 0.9, 0.4)]
        >>> round(outputs[-1], 3)
        2.314
    """

    filter: AdaptiveFilter
    state: FilterState | None
    info: FilterInfo | None
    """What was recorded of the last sample."""

    def __init__(self, filt: AdaptiveFilter, state: FilterState | None = None):
        if not isinstance(filt, AdaptiveFilter):
            raise InputError(f"the filter is {type(filt).__name__}: give an AdaptiveFilter")
        if state is not None:
            require_state(filt.plane, state, FilterState)
        self.filter = filt
        self.state = state
        self.info = None

    def __call__(self, x: float, z: float = math.nan) -> float:
        """Take in one sample, adapt, and return the model's output.

        Args:
            x: input, in the unit of the plane.
            z: measured output, in its unit; NaN if it is missing (the weights then stay).

        Returns:
            ẑ with the weights before this sample's update, in the unit of the output.

        Raises:
            InputError: `x` or `z` is no number, `x` is not finite or leaves the plane, or `z` is
                infinite; the state is then as before.
        """
        try:
            x, z = float(x), float(z)
        except (TypeError, ValueError):
            raise InputError(f"x is {x!r} and z is {z!r}: give two numbers") from None
        plane = self.filter.plane
        # The comparison costs next to nothing; NaN fails it and so is refused below.
        if not plane.low <= x <= plane.high:
            require_on_plane(plane, x)
        if math.isinf(z):
            raise InputError(f"the output z is {z}: give NaN where the output is missing")
        if self.state is None:
            self.state = _start(self.filter, x, z)
        self.state, info = _step(self.filter, self.state, x, z)
        self.info = info
        return float(info.output)

    def save(self, path: str | os.PathLike) -> None:
        """Write the filter and its state to a file; an existing one is replaced in one go.

        Args:
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
        }
        arrays = {
            "initial_weight": np.asarray(self.filter.initial_weight),
            "step_size": np.asarray(self.filter.step_size),
        }
        if self.state is not None:
            arrays |= {f"state.{name}": np.asarray(a) for name, a in vars(self.state).items()}
        write_arrays(Path(path), about, arrays)

    @classmethod
    def load(cls, path: str | os.PathLike) -> OnlineFilter:
        """Read a filter and its state from a file written by `save`.

        Args:
            path: the file.

        Returns:
            A filter that goes on as the saved one would have (in single precision, where JAX is not
            set to double).

        Raises:
            InputError: the file is missing, broken, or written by a newer version.
        """
        remedy = "give a file that `save` wrote"
        with read_arrays(Path(path), FORMAT, "a saved filter", remedy) as (about, stored):
            filt = AdaptiveFilter(
                Plane(levels=about["levels"], low=about["low"], high=about["high"]),
                about["hysteron"],
                about["sampling"],
                stored["initial_weight"],
                1.0 if about["format"] == 1 else stored["step_size"],
            )
            names = [name for name in stored.files if name.startswith("state.")]
            arrays = {n.removeprefix("state."): jnp.asarray(stored[n]) for n in names}
            state = FilterState(**arrays) if arrays else None
        return cls(filt, state)

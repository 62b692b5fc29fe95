"""The adaptive filter fed one sample at a time, with a state that can be kept on disk."""

from __future__ import annotations

import json
import math
import os
import zipfile
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from preisach_jax.errors import InputError
from preisach_jax.filter import AdaptiveFilter, FilterInfo, FilterState
from preisach_jax.plane import Plane

FORMAT = 1

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
            InputError: `x` is not finite or `z` is infinite; the state is then as before.
        """
        x, z = float(x), float(z)
        if not math.isfinite(x):
            raise InputError(f"the input x is {x}: give a finite number")
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
            "about": np.asarray(json.dumps(about)),
            "initial_weight": np.asarray(self.filter.initial_weight),
        }
        if self.state is not None:
            arrays |= {f"state.{name}": np.asarray(a) for name, a in vars(self.state).items()}
        path = Path(path)
        unfinished = path.with_name(path.name + ".part")
        try:
            with unfinished.open("wb") as file:
                np.savez(file, **arrays)  # pyright: ignore[reportArgumentType]
            os.replace(unfinished, path)
        finally:
            unfinished.unlink(missing_ok=True)

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
        try:
            with Path(path).open("rb") as file, np.load(file, allow_pickle=False) as stored:
                about = json.loads(str(stored["about"]))
                if about["format"] > FORMAT:
                    raise InputError(
                        f"{path} has the format {about['format']}, and {FORMAT} is the newest that "
                        "this version reads: update preisach_jax"
                    )
                plane = Plane(levels=about["levels"], low=about["low"], high=about["high"])
                filt = AdaptiveFilter(
                    plane, about["hysteron"], about["sampling"], stored["initial_weight"]
                )
                names = [name for name in stored.files if name.startswith("state.")]
                state = None
                if names:
                    arrays = {n.removeprefix("state."): jnp.asarray(stored[n]) for n in names}
                    state = FilterState(**arrays)
        except InputError:
            raise
        except FileNotFoundError:
            raise InputError(f"{path} does not exist: give a file that `save` wrote") from None
        except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile) as error:
            raise InputError(
                f"{path} cannot be read as a saved filter ({error}): give a file that `save` wrote"
            ) from error
        return cls(filt, state)

"""What a noise sweep found: labelled arrays, the exponents of Fig. 8, files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np
import scipy

from preisach_jax.errors import InputError
from preisach_jax.files import read_arrays, write_arrays
from preisach_jax.plant import RANGE_V
from preisach_jax.theory import auxiliary_norm, quantisation_noise_power

if TYPE_CHECKING:
    import xarray

FORMAT = 2


class PowerLaw(NamedTuple):
    """A fitted power law y = c x^value.

    Attributes:
        value: the exponent.
        low: lower end of its 95 % confidence interval.
        high: upper end.
        r_squared: share of the variance of log y that it explains.
        correlation: linear correlation of x and y themselves; of several rows, the lowest.
    """

    value: float
    low: float
    high: float
    r_squared: float
    correlation: float


def fit_power_law(x: np.ndarray, y: np.ndarray) -> PowerLaw:
    """Fit a power law by least squares of the logarithms.

    log y = log c_g + value · log x, with one constant for each row g; the interval is Student's.

    Arguments:
        x: (points,) or (rows, points) positive numbers.
        y: positive numbers of the same shape.

    Returns:
        The exponent, common to all rows.

    Raises:
        InputError: a number is not positive, or there are too few.

    Example:
        >>> fit_power_law(np.array([1.0, 2.0, 4.0]), np.array([3.0, 12.0, 48.0])).value.__round__(6)
        2.0
    """
    x, y = np.atleast_2d(np.asarray(x, float)), np.atleast_2d(np.asarray(y, float))
    if not (np.all(x > 0) and np.all(y > 0)):
        raise InputError(f"a power law is fitted to {min(x.min(), y.min())}: give positive numbers")
    freedom = x.size - x.shape[0] - 1
    if freedom < 1:
        raise InputError(
            f"there are {x.size} points in {x.shape[0]} rows: give at least two more points than "
            "rows to fit an exponent"
        )
    u, v = (np.log(a) - np.log(a).mean(axis=1, keepdims=True) for a in (x, y))
    value = float(np.sum(u * v) / np.sum(u * u))
    left = float(np.sum((v - value * u) ** 2))
    spread = float(scipy.special.stdtrit(freedom, 0.975)) * np.sqrt(left / freedom / np.sum(u * u))
    return PowerLaw(
        value,
        value - float(spread),
        value + float(spread),
        1.0 - left / float(np.sum(v * v)),
        min(float(np.corrcoef(*row)[0, 1]) for row in zip(x, y, strict=True)),
    )


@dataclass(frozen=True, eq=False)
class Sweep:
    """What a noise sweep found: NumPy arrays with named axes and units.

    Averages are over the residual interval of (30). Where the truth is known, ‖E‖² is averaged over
    its samples; its parts are the square of the mean error, which a run without noise shows, and
    what noise adds to that.

    Attributes:
        levels: (level,) N.
        noise_um: (noise,) standard deviation √W of the noise, µm.
        seeds: (seed,) numbers of the realisations of input and noise.
        samples: time steps of a record.
        first: m of (30): residuals are taken over the samples from here to the end.
        slope: I, eq. (27), of the stage, µm/V.
        events: (level, seed) switching events in the residual interval.
        output_error: (level, seed) ⟨e⟩, eq. (30), over the switching samples, µm; NaN of fewer
            than two of them.
        noisy_output_error: (level, noise, seed) the same with noise on the stage's output, µm.
        weight_error_squared: (level, noise, seed) ⟨‖E‖²⟩, µm².
        bias_squared: (level, seed) the same without noise, the rest of the initial error, µm².
        noise_part: (level, noise, seed) ⟨‖E - E without noise‖²⟩, µm².
        weights: by level, (seed, output, cells) weights at the end, µm; outputs are the stage's,
            without noise and with each, and the known truth's, likewise.
        compile_s: seconds that compilation took.
        run_s: seconds that the computation took.
        device: the device that computed.
        key: data of the random key.
    """

    levels: np.ndarray
    noise_um: np.ndarray
    seeds: np.ndarray
    samples: int
    first: int
    slope: float
    events: np.ndarray
    output_error: np.ndarray
    noisy_output_error: np.ndarray
    weight_error_squared: np.ndarray
    bias_squared: np.ndarray
    noise_part: np.ndarray
    weights: tuple[np.ndarray, ...]
    compile_s: float
    run_s: float
    device: str
    key: np.ndarray

    AXES: ClassVar[Mapping[str, tuple[tuple[str, ...], str]]] = {
        "events": (("level", "seed"), "1"),
        "output_error": (("level", "seed"), "um"),
        "noisy_output_error": (("level", "noise", "seed"), "um"),
        "weight_error_squared": (("level", "noise", "seed"), "um^2"),
        "bias_squared": (("level", "seed"), "um^2"),
        "noise_part": (("level", "noise", "seed"), "um^2"),
    }
    """Axes and unit of each result."""

    def __repr__(self) -> str:
        sizes = f"levels={self.levels.tolist()}, noise_um={self.noise_um.tolist()}"
        return f"Sweep({sizes}, seeds={self.seeds.tolist()}, samples={self.samples})"

    @property
    def cells(self) -> np.ndarray:
        """(level,) L = N(N+1)/2."""
        return self.levels * (self.levels + 1) // 2

    @property
    def delta_x(self) -> np.ndarray:
        """(level,) δx, V."""
        return RANGE_V / self.levels

    @property
    def noise_power(self) -> np.ndarray:
        """(level,) W of the quantisation, eq. (29), µm²."""
        return quantisation_noise_power(self.slope, self.delta_x)

    def mean_output_error(self, over: str = "events") -> np.ndarray:
        """⟨e⟩, eq. (30), of all seeds together.

        Arguments:
            over: "events" averages e² over the switching samples; "samples" over all of them, with
                e = 0 where nothing switches, as (7) has it.

        Returns:
            (level,) ⟨e⟩, µm; NaN where no seed has two switching samples.

        Raises:
            InputError: `over` is neither.
        """
        counts = np.maximum(self.events - 1, 0)
        total = np.sum(np.where(counts > 0, self.output_error**2, 0.0) * counts, axis=1)
        if over == "events":
            every = counts.sum(axis=1)
            return np.where(every > 0, np.sqrt(total / np.maximum(every, 1)), np.nan)
        if over == "samples":
            return np.sqrt(total / (len(self.seeds) * (self.samples - self.first - 1)))
        raise InputError(f"over is {over!r}: it must be 'events' or 'samples'")

    def auxiliary_norm(self, over: str = "events") -> np.ndarray:
        """Auxiliary norm of the weight error, eq. (31).

        Arguments:
            over: what ⟨e⟩ is averaged over, "events" or "samples".

        Returns:
            (level,) norm, µm.

        Raises:
            InputError: `over` is neither.
        """
        return auxiliary_norm(self.mean_output_error(over), self.cells)

    @property
    def noisy_auxiliary_norm(self) -> np.ndarray:
        """(level, noise) auxiliary norm (31) with noise on the stage's output, µm, of all seeds."""
        rms = np.sqrt(np.mean(self.noisy_output_error**2, axis=2))
        return auxiliary_norm(rms, self.cells[:, np.newaxis])

    @property
    def unsettled(self) -> np.ndarray:
        """(level,) whether there are fewer events than cells: the initial error dominates."""
        return self.events.min(axis=1) < self.cells

    @property
    def coefficient(self) -> np.ndarray:
        """(level,) coefficient of proportionality between what noise adds to ⟨‖E‖²⟩ and W."""
        return np.mean(self.noise_part / self.noise_um[:, np.newaxis] ** 2, axis=(1, 2))

    @property
    def coefficient_error(self) -> np.ndarray:
        """(level,) standard error of `coefficient` over noise and seeds; NaN of a single one."""
        ratio = self.noise_part / self.noise_um[:, np.newaxis] ** 2
        count = ratio[0].size
        if count == 1:
            return np.full(len(self.levels), np.nan)
        return np.std(ratio, axis=(1, 2), ddof=1) / np.sqrt(count)

    def exponents(self) -> dict[str, PowerLaw]:
        """Exponents of the power laws of Fig. 8, expected 1.

        Returns:
            "paper": auxiliary norm (31) against W (29), e² averaged over switching samples;
            "paper_all_samples": the same averaged over all samples; "truth": what noise adds to
            ⟨‖E‖²⟩ against W, the levels as rows. Only those for which there are points enough.
        """
        points = {
            "paper": (self.noise_power, self.auxiliary_norm()),
            "paper_all_samples": (self.noise_power, self.auxiliary_norm("samples")),
            "truth": (
                np.broadcast_to(self.noise_um**2, (len(self.levels), len(self.noise_um))),
                self.noise_part.mean(axis=2),
            ),
        }
        enough = {"paper": 3, "paper_all_samples": 3, "truth": 3 * len(self.levels)}
        return {
            name: fit_power_law(x, y) for name, (x, y) in points.items() if x.size >= enough[name]
        }

    def to_json(self) -> dict[str, Any]:
        """Content of `sweep.json`: one row a level, the exponents, and how it was computed."""
        rows = [
            {
                "levels": int(N),
                "cells": int(self.cells[n]),
                "delta_x": float(self.delta_x[n]),
                "noise_power": float(self.noise_power[n]),
                "auxiliary_norm": float(self.auxiliary_norm()[n]),
                "auxiliary_norm_all_samples": float(self.auxiliary_norm("samples")[n]),
                "mean_output_error": float(self.mean_output_error()[n]),
                "events": int(self.events[n].sum()),
                "unsettled": bool(self.unsettled[n]),
                "bias_squared": float(self.bias_squared[n].mean()),
                "coefficient": float(self.coefficient[n]),
                "coefficient_error": float(self.coefficient_error[n]),
                "noise_variance": (self.noise_um**2).tolist(),
                "auxiliary_norm_with_noise": self.noisy_auxiliary_norm[n].tolist(),
                "weight_error_squared": self.weight_error_squared[n].mean(axis=1).tolist(),
                "noise_part": self.noise_part[n].mean(axis=1).tolist(),
            }
            for n, N in enumerate(self.levels)
        ]
        return {
            "format": FORMAT,
            "rows": rows,
            "exponent": {name: law._asdict() for name, law in self.exponents().items()},
            "slope": self.slope,
            "units": {
                "delta_x": "V",
                "slope": "um/V",
                **dict.fromkeys(
                    ("auxiliary_norm", "auxiliary_norm_with_noise", "mean_output_error"), "um"
                ),
                **dict.fromkeys(
                    ("noise_power", "noise_variance", "weight_error_squared", "noise_part"), "um^2"
                ),
                "bias_squared": "um^2",
                "coefficient": "1",
            },
            "samples": self.samples,
            "residual_interval": [self.first, self.samples],
            "seeds": self.seeds.tolist(),
            "key": self.key.tolist(),
            "compile_s": self.compile_s,
            "run_s": self.run_s,
            "device": self.device,
            "versions": {name: version(name) for name in ("preisach_jax", "jax", "numpy")},
        }

    def to_xarray(self) -> xarray.Dataset:
        """The results as an xarray dataset with coordinates and units.

        Returns:
            The dataset.

        Raises:
            InputError: xarray is not installed.
        """
        try:
            import xarray as xr
        except ImportError:
            raise InputError(
                "xarray is not installed: pip install 'preisach_jax[xarray]'"
            ) from None
        variables = {
            name: (axes, getattr(self, name), {"units": unit})
            for name, (axes, unit) in self.AXES.items()
        }
        coordinates = {
            "level": ("level", self.levels, {"long_name": "levels N of the plane"}),
            "noise": ("noise", self.noise_um, {"units": "um", "long_name": "noise, rms"}),
            "seed": ("seed", self.seeds),
        }
        about = {"samples": self.samples, "first": self.first, "slope_um_per_V": self.slope}
        return xr.Dataset(variables, coordinates, about)

    def save(self, path: str | Path) -> None:
        """Write everything into one file of NumPy's `.npz` format; it replaces an old one whole.

        Arguments:
            path: the file.

        Raises:
            InputError: it cannot be written.
        """
        about = {"format": FORMAT, **{name: getattr(self, name) for name in _PLAIN}}
        arrays = {name: getattr(self, name) for name in (*self.AXES, *_LABELS)}
        weights = zip(self.levels, self.weights, strict=True)
        write_arrays(Path(path), about, arrays | {f"weights_{N}": rows for N, rows in weights})

    @classmethod
    def load(cls, path: str | Path) -> Sweep:
        """Read a file that `save` wrote, or the folder of a sweep on the command line.

        Arguments:
            path: the file or folder.

        Returns:
            The sweep.

        Raises:
            InputError: the file is missing, broken, or of a newer version.
        """
        if Path(path).is_dir():
            from preisach_jax.sweep.storage import load_folder

            return load_folder(Path(path))
        return cls.from_file(
            Path(path), "give a file that Sweep.save wrote, or the folder of a sweep"
        )

    @classmethod
    def from_file(cls, path: Path, remedy: str) -> Sweep:
        """Read a file that `save` wrote; `remedy` ends the message if it cannot be read."""
        with read_arrays(path, FORMAT, "a sweep", remedy) as (about, stored):
            arrays = {name: stored[name] for name in (*cls.AXES, *_LABELS)}
            weights = tuple(stored[f"weights_{N}"] for N in arrays["levels"])
            return cls(weights=weights, **arrays, **{name: about[name] for name in _PLAIN})


_LABELS = ("levels", "noise_um", "seeds", "key")
_PLAIN = ("samples", "first", "slope", "compile_s", "run_s", "device")


def merge(parts: Sequence[Sweep]) -> Sweep:
    """Join sweeps that differ in their seeds only."""
    one = parts[0]
    for other in parts[1:]:
        for name in ("levels", "noise_um", "key", "samples"):
            if not np.array_equal(getattr(one, name), getattr(other, name)):
                raise InputError(
                    f"{name} is {getattr(one, name)} in one part of a sweep and "
                    f"{getattr(other, name)} in another: join parts of one sweep only"
                )
    joined = {
        name: np.concatenate([getattr(part, name) for part in parts], axis=axes.index("seed"))
        for name, (axes, _) in one.AXES.items()
    }
    by_level = zip(*(part.weights for part in parts), strict=True)
    return Sweep(
        levels=one.levels,
        noise_um=one.noise_um,
        seeds=np.concatenate([part.seeds for part in parts]),
        samples=one.samples,
        first=one.first,
        slope=max(part.slope for part in parts),
        weights=tuple(np.concatenate(rows) for rows in by_level),
        compile_s=sum(part.compile_s for part in parts),
        run_s=sum(part.run_s for part in parts),
        device=one.device,
        key=one.key,
        **joined,
    )

"""The noise sweep of the paper's Fig. 8: levels × noise × seeds as one batched computation.

One experiment a seed: the piezo stage is driven by its own Bernoulli ramp and read by its encoder,
and five planes are identified from it. Beside the stage's output, whose noise is that of
quantisation, every plane gets outputs of which the truth is known: weights on its own grid. Both
come without noise and with white noise of several powers. The planes are padded to the largest, so
that one program, `vmap` of `AdaptiveFilter.run`, serves all.

In a folder a sweep is a file for each chunk of seeds, so that an interruption loses little: the
realisation of a seed depends on the key and its number only.
"""

from __future__ import annotations

import functools
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
import scipy

from preisach_jax.devices import compiled, evenly
from preisach_jax.errors import InputError, whole_number
from preisach_jax.files import json_bytes, read_arrays, write_arrays, write_files
from preisach_jax.filter.adaptive import AdaptiveFilter
from preisach_jax.filter.relays import levels_along
from preisach_jax.filter.state import FilterResult
from preisach_jax.operator.events import Room, rounded_up
from preisach_jax.operator.plane import Plane
from preisach_jax.operator.simulation import simulate
from preisach_jax.piezo import PiezoRecord, experiment, paper_stage
from preisach_jax.plant import RANGE_V
from preisach_jax.signals.checks import as_key
from preisach_jax.theory import Progress, auxiliary_norm, largest_slope, quantisation_noise_power

if TYPE_CHECKING:
    import xarray

FORMAT = 2
RESULT = "sweep.json"
CHUNKS = "seeds_*.npz"

LEVELS = (75, 37, 19, 13, 9)
NOISE_UM = tuple(float(f"{sigma:.3g}") for sigma in np.logspace(-3.0, 1.0, 8))
"""Standard deviations of the noise, µm: W over eight decades, from a good encoder's to absurd."""

INITIAL_WEIGHT_UM = 1e-9
TRUE_STROKE_UM = 100.0
RESIDUAL_FROM = 0.2
"""The residual interval m ... M of (30) begins after this part of the samples: 10⁴ of 5·10⁴."""

PLAYS = 128
"""Plays of the stage: many more than there are levels, and 0.6 nm (rms) from infinitely many."""


def true_weights(plane: Plane, stroke: float = TRUE_STROKE_UM) -> np.ndarray:
    """Weights of a smooth density on a plane's own grid: the truth that a sweep knows.

    R ∝ exp(-4 (α - β)/range) (1 + (α + β - 2 low)/(2 range)), scaled so that Σ R is the stroke.
    """
    span = plane.high - plane.low
    bias = (plane.alpha + plane.beta - 2 * plane.low) / (2 * span)
    density = np.exp(-4.0 * (plane.alpha - plane.beta) / span) * (1.0 + bias)
    return stroke * density / density.sum()


class Realisation(NamedTuple):
    """Experiment of one seed, and (time, noise) unit white noise, one column for each power."""

    record: PiezoRecord
    noise: jax.Array


def realisation(key: jax.Array, seed: int | jax.Array, samples: int, noises: int) -> Realisation:
    """Draw the experiment and the noise of one seed of a sweep."""
    input_key, noise_key = jax.random.split(jax.random.fold_in(key, seed))
    record = experiment(input_key, samples, paper_stage(PLAYS))
    # Seven digits of noise are enough, and take half the time.
    noise = jax.random.normal(noise_key, (samples, noises), jnp.float32)
    return Realisation(record, noise.astype(record.stroke_um.dtype))


# --- what it found ---


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
        """(level,) ⟨e⟩, eq. (30), of all seeds together, µm; NaN without two switching samples.

        Averaged `over` "events", the switching samples, or "samples", all of them, with e = 0 where
        nothing switches, as (7) has it.
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
        """(level,) auxiliary norm, eq. (31), µm; of ⟨e⟩ `over` "events" or "samples"."""
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
        """The results as an xarray dataset with named axes, coordinates and units."""
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
        """Write everything into one file of NumPy's `.npz` format; it replaces an old one whole."""
        about = {"format": FORMAT, **{name: getattr(self, name) for name in _PLAIN}}
        arrays = {name: getattr(self, name) for name in (*self.AXES, *_LABELS)}
        weights = zip(self.levels, self.weights, strict=True)
        write_arrays(Path(path), about, arrays | {f"weights_{N}": rows for N, rows in weights})

    @classmethod
    def load(cls, path: str | Path) -> Sweep:
        """Read a file that `save` wrote, or the folder of a sweep on the command line."""
        path = Path(path)
        if not path.is_dir():
            return _read(path, "give a file that Sweep.save wrote, or the folder of a sweep")
        parts = [_read_chunk(chunk) for chunk in sorted(path.glob(CHUNKS))]
        if not parts:
            raise InputError(
                f"{path}: there is no {CHUNKS} in it; give a folder that a sweep wrote"
            )
        return merge(parts)


_LABELS = ("levels", "noise_um", "seeds", "key")
_PLAIN = ("samples", "first", "slope", "compile_s", "run_s", "device")


def _read(path: Path, remedy: str) -> Sweep:
    with read_arrays(path, FORMAT, "a sweep", remedy) as (about, stored):
        arrays = {name: stored[name] for name in (*Sweep.AXES, *_LABELS)}
        weights = tuple(stored[f"weights_{N}"] for N in arrays["levels"])
        return Sweep(weights=weights, **arrays, **{name: about[name] for name in _PLAIN})


def _read_chunk(path: Path) -> Sweep:
    return _read(
        path, f"remove {path.name} and give the same command again, which computes its seeds anew"
    )


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
    return replace(
        one,
        seeds=np.concatenate([part.seeds for part in parts]),
        slope=max(part.slope for part in parts),
        weights=tuple(np.concatenate(rows) for rows in by_level),
        compile_s=sum(part.compile_s for part in parts),
        run_s=sum(part.run_s for part in parts),
        **joined,
    )


# --- how it is computed ---


def sweep(
    key: jax.Array,
    levels: Sequence[int] = LEVELS,
    noise: Sequence[float] = NOISE_UM,
    seeds: int | Sequence[int] = 8,
    samples: int = 50_000,
) -> Sweep:
    """Identify planes of several sizes from noisy outputs, for several seeds, in one batch.

    The paper's experiment of section IV for Fig. 8, and the same with the truth known. Computes in
    double precision whatever JAX is set to, and shares the seeds among all devices.

    Arguments:
        key: random key (`jax.random.key`); realisation i depends on the key and on i only.
        levels: N of the planes, each at least 2.
        noise: standard deviations of the noise on the outputs, µm; the noise-free case is
            always there.
        seeds: how many realisations of input and noise, or their numbers.
        samples: time steps at 2 kHz; residuals are taken over the last 80 %.

    Returns:
        The labelled results.

    Raises:
        InputError: a number is out of its range.

    Example:
        >>> settings = {"levels": (5, 3), "noise": (0.05, 0.2, 0.5), "seeds": 2, "samples": 1000}
        >>> found = sweep(jax.random.key(7), **settings)
        >>> found.weight_error_squared.shape, found.auxiliary_norm().shape
        ((2, 3, 2), (2,))
    """
    key = as_key(key)
    levels, noise, numbers, samples = checked_settings(levels, noise, seeds, samples)
    count = evenly(len(numbers))
    padded = np.array([*numbers, *numbers[-1:] * (count - len(numbers))], np.int32)
    with jax.enable_x64(True):
        begin = time.perf_counter()
        draw = _compiled_draw(count, samples, len(noise))
        compile_s = time.perf_counter() - begin
        begin = time.perf_counter()
        drawn = draw(jax.random.key_data(key), padded)
        x, z = (np.asarray(rows) for rows in (drawn.record.input_v, drawn.record.stroke_um))
        room = _room(levels, x)
        slope = max(largest_slope(*pair) for pair in zip(x, z, strict=True))
        run_s = time.perf_counter() - begin
        begin = time.perf_counter()
        identify = _compiled_identify(levels, room, count, samples, len(noise))
        compile_s += time.perf_counter() - begin
        begin = time.perf_counter()
        found = identify(np.array(noise), drawn)
        run_s += time.perf_counter() - begin

    def without_fillings(rows: jax.Array) -> np.ndarray:
        return np.asarray(rows)[: len(numbers)]

    found = jax.tree.map(without_fillings, found)
    return Sweep(
        levels=np.array(levels),
        noise_um=np.array(noise),
        seeds=np.array(numbers),
        samples=samples,
        first=_first(samples),
        slope=slope,
        weights=tuple(found.weights[:, n, :, : N * (N + 1) // 2] for n, N in enumerate(levels)),
        compile_s=compile_s,
        run_s=run_s,
        device=cast(str, jax.devices()[0].device_kind),
        key=np.asarray(jax.random.key_data(key)),
        events=found.events.T,
        output_error=found.output_error[..., 0].T,
        noisy_output_error=np.moveaxis(found.output_error[..., 1:], 0, -1),
        bias_squared=found.bias_squared.T,
        weight_error_squared=np.moveaxis(found.weight_error_squared, 0, -1),
        noise_part=np.moveaxis(found.noise_part, 0, -1),
    )


class _Identified(NamedTuple):
    """What the outputs of one input gave on one plane; names as in `Sweep`."""

    weights: jax.Array
    events: jax.Array
    output_error: jax.Array
    weight_error_squared: jax.Array
    bias_squared: jax.Array
    noise_part: jax.Array


def _room(levels: Sequence[int], x: np.ndarray) -> tuple[int, Room]:
    """Room for the samples of inputs that pass a threshold, and for a run along them."""
    needs = [
        np.append(
            [np.count_nonzero(np.diff(levels_along(plane, row, row[0])))],
            AdaptiveFilter(plane).room(row),
        )
        for plane in map(_plane, levels)
        for row in x
    ]
    samples, *room = (rounded_up(int(one)) for one in np.max(needs, axis=0))
    return samples, Room(*room)


def _identify(
    plane: Plane, truth: jax.Array, room: tuple[int, Room], noise_um: jax.Array, drawn: Realisation
) -> _Identified:
    """Run the filter for the stage's output and for those of a known truth."""
    record, samples = drawn.record, drawn.noise.shape[0]
    # Samples that pass no threshold change nothing.
    moves = jnp.diff(levels_along(plane, record.input_v, record.input_v[0]))
    at = jnp.nonzero(moves, size=room[0], fill_value=samples - 1)[0]
    at = jnp.append(0, at)
    x, stage, noise = record.input_v[at], record.stroke_um[at], drawn.noise[at].T
    noise = jnp.concatenate([jnp.zeros_like(noise[:1]), noise * noise_um[:, jnp.newaxis]])
    clean = simulate(plane, truth, x, "relay")
    outputs = jnp.concatenate([one[jnp.newaxis] + noise for one in (stage, clean)])
    filt = AdaptiveFilter(plane, initial_weight=INITIAL_WEIGHT_UM)

    def run(z: jax.Array) -> FilterResult:
        return filt.run(x, z, room=room[1], missing=False)

    found = jax.vmap(run)(outputs)

    first, area = _first(samples), found.switched[0]
    of_stage, of_truth = jnp.split(jnp.where(area > 0, found.error, 0.0), 2)
    residual = (at >= first) & (area > 0)
    events = jnp.sum(residual)
    stage_errors = of_stage**2 @ residual.astype(of_stage.dtype)
    # ‖E‖² after each event, by (15) with Σ_S E = ν - e.
    nu = jnp.diff(noise, axis=1, prepend=noise[:, :1])
    lengths = jnp.diff(jnp.clip(jnp.append(at, samples), first, samples))

    def added(errors: jax.Array, nu: jax.Array) -> jax.Array:
        steps = (2.0 * nu - errors) * errors / jnp.maximum(area, 1.0)
        return jnp.sum(lengths * jnp.cumsum(steps)) / (samples - first)

    # Of a padded plane, the cells that are there are those of the truth.
    initial = jnp.sum(jnp.where(truth > 0, (INITIAL_WEIGHT_UM - truth) ** 2, 0.0))
    total = initial + jax.vmap(added)(of_truth, nu)
    return _Identified(
        weights=found.weights,
        events=events,
        output_error=jnp.where(
            events > 1, jnp.sqrt(stage_errors / jnp.maximum(events - 1, 1)), jnp.nan
        ),
        weight_error_squared=total[1:],
        bias_squared=total[0],
        noise_part=jax.vmap(added)(of_truth[1:] - of_truth[:1], nu[1:]),
    )


def _first(samples: int) -> int:
    return round(RESIDUAL_FROM * samples)


def _plane(levels: int) -> Plane:
    return Plane(levels=levels, low=0.0, high=RANGE_V)


@functools.lru_cache(maxsize=8)
def _compiled_draw(seeds: int, samples: int, noises: int) -> Callable[[Any, Any], Any]:
    return compiled(*_draw_with_shapes(seeds, samples, noises))


def _draw_with_shapes(
    seeds: int, samples: int, noises: int
) -> tuple[Callable[[Any, Any], Any], Any, Any]:
    def draw(key_data: jax.Array, numbers: jax.Array) -> Realisation:
        key = cast(jax.Array, jax.random.wrap_key_data(key_data))
        one = functools.partial(realisation, samples=samples, noises=noises)
        return jax.vmap(one, (None, 0))(key, numbers)

    return draw, jax.random.key_data(jax.random.key(0)), jax.ShapeDtypeStruct((seeds,), jnp.int32)


@functools.lru_cache(maxsize=8)
def _compiled_identify(
    levels: tuple[int, ...], room: tuple[int, Room], seeds: int, samples: int, noises: int
) -> Callable[[Any, Any], Any]:
    planes = [_plane(N).padded(max(levels)) for N in levels]
    truths = [
        np.pad(w, (0, planes[0].cells - len(w))) for w in map(true_weights, map(_plane, levels))
    ]
    several = jax.tree.map(lambda *each: np.stack(each), *planes), np.stack(truths)

    def identify(noise_um: jax.Array, drawn: Realisation) -> _Identified:
        def of_seed(drawn: Realisation) -> _Identified:
            def of_plane(one: tuple[Plane, jax.Array]) -> _Identified:
                return _identify(*one, room, noise_um, drawn)

            return cast(_Identified, over(of_plane, several))

        return cast(_Identified, over(of_seed, drawn))

    drawn = jax.eval_shape(*_draw_with_shapes(seeds, samples, noises))
    noise_um = jax.ShapeDtypeStruct((noises,), jnp.result_type(float))
    # One input after the other on a processor, whose cache holds the weights of one; else at once.
    over = cast(Any, jax.lax.map) if jax.default_backend() == "cpu" else _at_once
    return compiled(identify, noise_um, drawn)


def _at_once(function: Callable[[Any], Any], rows: Any) -> Any:
    return jax.vmap(function)(rows)


def checked_settings(
    levels: Sequence[int], noise: Sequence[float], seeds: int | Sequence[int], samples: int
) -> tuple[tuple[int, ...], tuple[float, ...], tuple[int, ...], int]:
    """Settings of a sweep as plain numbers, the seeds by their numbers."""
    if isinstance(seeds, Sequence | np.ndarray):
        numbers = tuple(seeds)
    else:
        numbers = tuple(range(whole_number("seeds is", seeds, 1)))
    levels = tuple(whole_number("levels holds", N, 2) for N in levels)
    numbers = tuple(whole_number("seeds holds", number, 0) for number in numbers)
    noise = tuple(float(sigma) for sigma in noise)
    for sigma in noise:
        if not 0.0 < sigma < math.inf:
            raise InputError(
                f"noise holds {sigma}: give standard deviations above 0, in µm (the case without "
                "noise is always computed)"
            )
    for name, values in (("levels", levels), ("noise", noise), ("seeds", numbers)):
        if not values:
            raise InputError(f"{name} is empty: give at least one")
        if len(set(values)) < len(values):
            raise InputError(f"{name} holds {values}: name each only once")
    return levels, noise, numbers, whole_number("samples is", samples, 1000)


# --- in a folder ---


def sweep_to_folder(
    folder: str | Path,
    key: jax.Array,
    levels: Sequence[int] = LEVELS,
    noise: Sequence[float] = NOISE_UM,
    seeds: int | Sequence[int] = 8,
    samples: int = 50_000,
    chunk: int = 8,
    resume: bool = True,
    progress: Progress | None = None,
) -> Sweep:
    """Run a sweep by chunks of seeds into a folder, or go on with one that was interrupted."""
    folder = Path(folder)
    levels, noise, numbers, samples = checked_settings(levels, noise, seeds, samples)
    chunk = whole_number("chunk is", chunk, 1)
    there = {path: _read_chunk(path) for path in sorted(folder.glob(CHUNKS))}
    if resume:
        asked = {"levels": levels, "noise_um": noise, "samples": samples,
                 "key": jax.random.key_data(key)}  # fmt: skip
        for path, part in there.items():
            _check_same(path, part, asked)
    else:
        for path in there:
            path.unlink(missing_ok=True)
        there = {}
    parts = list(there.values())
    held = {seed for part in parts for seed in part.seeds.tolist()}
    missing = [seed for seed in numbers if seed not in held]
    count = len(held) + len(missing)
    for begin in range(0, len(missing), chunk):
        own = missing[begin : begin + chunk]
        if progress is not None:
            done = len(held) + begin
            progress(f"seed {done + 1} of {count}", done / count)
        try:
            parts.append(sweep(key, levels, noise, own, samples))
        except (MemoryError, cast(type[Exception], jax.errors.JaxRuntimeError)) as error:
            if not (isinstance(error, MemoryError) or "RESOURCE_EXHAUSTED" in str(error)):
                raise
            raise InputError(
                f"memory is too small for {len(own)} seeds at once: give a smaller chunk; the "
                "seeds that were finished stay"
            ) from error
        parts[-1].save(folder / f"seeds_{own[0]:04d}-{own[-1]:04d}.npz")
    found = merge(sorted(parts, key=lambda part: int(part.seeds[0])))
    write_files({folder / RESULT: json_bytes(found.to_json())})
    return found


def _check_same(path: Path, part: Sweep, asked: Mapping[str, object]) -> None:
    """Refuse a chunk of other settings than those that are asked for."""
    for name, value in asked.items():
        held, wanted = np.ravel(getattr(part, name)), np.ravel(cast(float, value))
        if not np.array_equal(held, wanted):
            held, wanted = (",".join(f"{one:g}" for one in each) for each in (held, wanted))
            raise InputError(
                f"{path.parent} holds a sweep with {name.removesuffix('_um')} {held} and not "
                f"{wanted}: choose another folder with --out, or start again with --restart"
            )

"""The noise sweep of the paper's Fig. 8: levels × noise × seeds as one batched computation.

One experiment a seed: the piezo stage is driven by its own Bernoulli ramp and read by its encoder,
and five planes are identified from it. Beside the stage's output, whose noise is that of
quantisation, every plane gets outputs of which the truth is known: weights on its own grid, without
noise and with white noise of several powers. All outputs of one input share its switching events,
and lie last in the arrays that the recursion over these events updates.
"""

from __future__ import annotations

import functools
import math
import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np

from preisach_jax.devices import compiled, evenly, gathered, greatest, local
from preisach_jax.errors import InputError, whole_number
from preisach_jax.operator.events import room_for_events, switching_events
from preisach_jax.operator.learning import adapt_over_events, measured_rises, output_rises
from preisach_jax.operator.plane import Plane
from preisach_jax.operator.switching import Switching
from preisach_jax.piezo import PiezoRecord, experiment, paper_stage
from preisach_jax.plant import RANGE_V
from preisach_jax.signals.checks import as_key
from preisach_jax.sweep.result import PowerLaw, Sweep, fit_power_law, merge
from preisach_jax.theory import largest_slope

__all__ = [
    "INITIAL_WEIGHT_UM",
    "LEVELS",
    "NOISE_UM",
    "RESIDUAL_FROM",
    "PowerLaw",
    "Sweep",
    "fit_power_law",
    "merge",
    "realisation",
    "sweep",
    "true_weights",
]

LEVELS = (75, 37, 19, 13, 9)
NOISE_UM = tuple(float(f"{sigma:.3g}") for sigma in np.logspace(-3.0, 1.0, 8))
"""Standard deviations of the noise, µm: W over eight decades, from a good encoder's to absurd."""

INITIAL_WEIGHT_UM = 1e-9
TRUE_STROKE_UM = 100.0
RESIDUAL_FROM = 0.2
"""The residual interval m ... M of (30) begins after this part of the samples: 10⁴ of 5·10⁴."""

PLAYS = 128
"""Plays of the stage: many more than there are levels, and 0.6 nm (rms) from infinitely many."""

_ROOM = 64
"""Room for events comes in steps of so many, so that new inputs rarely need a compilation."""

_CACHED = 2**16
"""Weights that a core's cache holds, while a recursion over events updates them."""


def true_weights(plane: Plane, stroke: float = TRUE_STROKE_UM) -> np.ndarray:
    """Weights of a smooth density on a plane's own grid: the truth that a sweep knows.

    R ∝ exp(-4 (α - β)/range) (1 + (α + β - 2 low)/(2 range)), scaled so that Σ R is the stroke.

    Arguments:
        plane: the Preisach plane.
        stroke: Σ R, in the unit of the output.

    Returns:
        (cells,) weights R, in the unit of the output.

    Example:
        >>> round(float(true_weights(Plane(levels=9, low=0.0, high=75.0)).sum()), 6)
        100.0
    """
    span = plane.high - plane.low
    bias = (plane.alpha + plane.beta - 2 * plane.low) / (2 * span)
    density = np.exp(-4.0 * (plane.alpha - plane.beta) / span) * (1.0 + bias)
    return stroke * density / density.sum()


class Realisation(NamedTuple):
    """Input and noise of one seed.

    Attributes:
        record: the experiment on the piezo stage, (time,) each.
        noise: (time, noise) unit white noise, one column for each power.
    """

    record: PiezoRecord
    noise: jax.Array


def realisation(key: jax.Array, seed: int | jax.Array, samples: int, noises: int) -> Realisation:
    """Draw the experiment and the noise of one seed of a sweep.

    Arguments:
        key: random key of the sweep (`jax.random.key`).
        seed: number of the realisation.
        samples: time steps at 2 kHz.
        noises: how many powers of noise the sweep has.

    Returns:
        The record of the stage, and noise of unit variance.

    Example:
        >>> drawn = realisation(jax.random.key(0), 3, samples=100, noises=2)
        >>> drawn.record.stroke_um.shape, drawn.noise.shape
        ((100,), (100, 2))
    """
    input_key, noise_key = jax.random.split(jax.random.fold_in(key, seed))
    record = experiment(input_key, samples, paper_stage(PLAYS))
    # Seven digits of noise are enough, and take half the time.
    noise = jax.random.normal(noise_key, (samples, noises), jnp.float32)
    return Realisation(record, noise.astype(record.stroke_um.dtype))


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
        noise: standard deviations of the noise where the truth is known, µm; the noise-free case is
            always there.
        seeds: how many realisations of input and noise, or their numbers.
        samples: time steps at 2 kHz; residuals are taken over the last 80 %.

    Returns:
        The labelled results.

    Raises:
        InputError: a number is out of its range.

    Example:
        >>> found = sweep(jax.random.key(0), levels=(5, 3), noise=(0.1,), seeds=2, samples=2000)
        >>> found.weight_error_squared.shape, found.auxiliary_norm().shape
        ((2, 1, 2), (2,))
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
        x, z = (local(rows) for rows in (drawn.record.input_v, drawn.record.stroke_um))
        rooms = np.array([room_for_events(_plane(N), x, _ROOM) for N in levels])
        room = tuple((int(events), int(width)) for events, width in greatest(rooms))
        slope = max(largest_slope(*pair) for pair in zip(x, z, strict=True))
        run_s = time.perf_counter() - begin
        begin = time.perf_counter()
        identify = _compiled_identify(levels, room, count, samples, len(noise))
        compile_s += time.perf_counter() - begin
        begin = time.perf_counter()
        found = gathered(identify(np.array(noise), drawn))
        run_s += time.perf_counter() - begin
        slope = float(greatest(np.array(slope)))

    def without_fillings(rows: np.ndarray) -> np.ndarray:
        return rows[: len(numbers)]

    found = jax.tree.map(without_fillings, found)
    return Sweep(
        levels=np.array(levels),
        noise_um=np.array(noise),
        seeds=np.array(numbers),
        samples=samples,
        first=_first(samples),
        slope=slope,
        weights=tuple(one.weights for one in found),
        compile_s=compile_s,
        run_s=run_s,
        device=cast(str, jax.devices()[0].device_kind),
        key=np.asarray(jax.random.key_data(key)),
        events=np.stack([one.events for one in found]),
        output_error=np.stack([one.output_error for one in found]),
        bias_squared=np.stack([one.bias_squared for one in found]),
        weight_error_squared=np.stack([one.weight_error_squared.T for one in found]),
        noise_part=np.stack([one.noise_part.T for one in found]),
    )


class _Identified(NamedTuple):
    """What the outputs of one input gave on one plane; names as in `Sweep`."""

    weights: jax.Array
    events: jax.Array
    output_error: jax.Array
    weight_error_squared: jax.Array
    bias_squared: jax.Array
    noise_part: jax.Array


def _identify_seeds(
    plane: Plane, room: tuple[int, int], noise_um: jax.Array, drawn: Realisation
) -> _Identified:
    """Identify a plane from all seeds, as many at a time as the processor's cache holds."""

    def events(x: jax.Array) -> Switching:
        return switching_events(plane, x, *room)

    switching = jax.vmap(events)(drawn.record.input_v)
    seeds, outputs = drawn.noise.shape[0], drawn.noise.shape[2] + 2
    at_once = max(1, _CACHED // (plane.cells * outputs))
    if jax.default_backend() != "cpu" or at_once >= seeds:
        at_once = seeds

    def one(seed: tuple[Switching, Realisation]) -> _Identified:
        return _identify(plane, noise_um, *seed)

    return cast(_Identified, jax.lax.map(one, (switching, drawn), batch_size=at_once))


def _identify(
    plane: Plane, noise_um: jax.Array, switching: Switching, drawn: Realisation
) -> _Identified:
    """Run the recursion for the stage's output and for those of a known truth."""
    record, samples = drawn.record, drawn.noise.shape[0]
    truth = jnp.asarray(true_weights(plane))
    clean = output_rises(plane, switching, truth)[:, jnp.newaxis]
    noise = drawn.noise * noise_um[jnp.newaxis]
    nu = jnp.pad(measured_rises(switching, noise), ((0, 0), (1, 0)))  # none in the first of them
    stage = measured_rises(switching, record.stroke_um[:, jnp.newaxis])
    rises = jnp.concatenate([stage, clean + nu], 1)
    start = jnp.full((plane.cells, rises.shape[1]), INITIAL_WEIGHT_UM, rises.dtype)
    weights, errors = adapt_over_events(plane, switching, rises, start)

    first = _first(samples)
    residual = (switching.sample >= first) & (switching.area > 0)
    events = jnp.sum(residual)
    stage_errors = jnp.sum(jnp.where(residual, errors[:, 0] ** 2, 0.0))
    initial = jnp.sum((start[:, 0] - truth) ** 2)
    total = _squared_error(initial, errors[:, 1:], nu, switching)
    added = _squared_error(0.0, errors[:, 2:] - errors[:, 1:2], nu[:, 1:], switching)
    total, added = (_residual_average(rows, switching, first, samples) for rows in (total, added))
    return _Identified(
        weights=weights.T,
        events=events,
        output_error=jnp.where(
            events > 1, jnp.sqrt(stage_errors / jnp.maximum(events - 1, 1)), jnp.nan
        ),
        weight_error_squared=total[1:],
        bias_squared=total[0],
        noise_part=added,
    )


def _squared_error(
    initial: jax.Array | float, errors: jax.Array, nu: jax.Array, switching: Switching
) -> jax.Array:
    """(1 + events, lanes) ‖E‖² at the start and after each event, by (15) with Σ_S E = ν - e."""
    area = jnp.maximum(switching.area, 1)[:, jnp.newaxis]
    steps = (2.0 * nu - errors) * errors / area
    return jnp.cumsum(jnp.pad(steps, ((1, 0), (0, 0))).at[0].set(initial), axis=0)


def _residual_average(
    values: jax.Array, switching: Switching, first: int, samples: int
) -> jax.Array:
    """(lanes,) average over the samples of the residual interval."""
    begin = jnp.concatenate([jnp.zeros(1, int), switching.sample, jnp.full(1, samples)])
    lengths = jnp.diff(jnp.clip(begin, first, samples))
    return jnp.sum(lengths[:, jnp.newaxis] * values, axis=0) / (samples - first)


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
    levels: tuple[int, ...],
    room: tuple[tuple[int, int], ...],
    seeds: int,
    samples: int,
    noises: int,
) -> Callable[[Any, Any], Any]:
    def identify(noise_um: jax.Array, drawn: Realisation) -> list[_Identified]:
        return [
            _identify_seeds(_plane(N), space, noise_um, drawn)
            for N, space in zip(levels, room, strict=True)
        ]

    drawn = jax.eval_shape(*_draw_with_shapes(seeds, samples, noises))
    noise_um = jax.ShapeDtypeStruct((noises,), jnp.result_type(float))
    return compiled(identify, noise_um, drawn)


def checked_settings(
    levels: Sequence[int], noise: Sequence[float], seeds: int | Sequence[int], samples: int
) -> tuple[tuple[int, ...], tuple[float, ...], tuple[int, ...], int]:
    """Settings of a sweep as plain numbers.

    Arguments:
        levels: N of the planes.
        noise: standard deviations of the noise, µm.
        seeds: how many realisations, or their numbers.
        samples: time steps.

    Returns:
        `(levels, noise, seeds, samples)`, the seeds by their numbers.

    Raises:
        InputError: a number is out of its range; the message begins with the argument's name.

    Example:
        >>> checked_settings((9, 5), (0.1,), 3, 2000)
        ((9, 5), (0.1,), (0, 1, 2), 2000)
    """
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

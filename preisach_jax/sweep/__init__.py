"""The noise sweep of the paper's Fig. 8: levels × noise × seeds as one batched computation.

One experiment a seed: the piezo stage is driven by its own Bernoulli ramp and read by its encoder,
and five planes are identified from it. Beside the stage's output, whose noise is that of
quantisation, every plane gets outputs of which the truth is known: weights on its own grid. Both
come without noise and with white noise of several powers. The planes are padded to the largest, so
that one program, `vmap` of `AdaptiveFilter.run`, serves all.
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

from preisach_jax.devices import compiled, evenly
from preisach_jax.errors import InputError, whole_number
from preisach_jax.filter.adaptive import AdaptiveFilter
from preisach_jax.filter.relays import levels_along
from preisach_jax.filter.state import FilterResult
from preisach_jax.operator.blocks import Room
from preisach_jax.operator.events import rounded_up
from preisach_jax.operator.plane import Plane
from preisach_jax.operator.simulation import simulate
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


def true_weights(plane: Plane, stroke: float = TRUE_STROKE_UM) -> np.ndarray:
    """Weights of a smooth density on a plane's own grid: the truth that a sweep knows.

    R ∝ exp(-4 (α - β)/range) (1 + (α + β - 2 low)/(2 range)), scaled so that Σ R is the stroke.

    Arguments:
        stroke: Σ R, in the unit of the output.

    Returns:
        (cells,) weights R, in the unit of the output.
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

    Returns:
        The record of the stage, and noise of unit variance.
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
        noise: standard deviations of the noise on the outputs, µm; the noise-free case is
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
    """Settings of a sweep as plain numbers.

    Returns:
        `(levels, noise, seeds, samples)`, the seeds by their numbers.
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

"""Excitations that repeat or shrink after a rule: triangles, decays, stairs, chirps, multisines."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any, cast

import jax
import jax.numpy as jnp
import numpy as np

from preisach_jax.errors import InputError, require_positive
from preisach_jax.signals.checks import checked_lines, index_of, ordered, uniform


def triangle(
    samples: int, rate_hz: float, frequency_hz: float, low: float = 0.0, high: float = 75.0
) -> jax.Array:
    """Triangle between two levels, which starts at the lower one and rises.

    u(t) = low + (high - low) (1 - |2 frac(f t) - 1|).

    Arguments:
        samples: number of samples.
        rate_hz: sampling rate, Hz.
        frequency_hz: loops a second; the rate of the input is 2 (high - low) f.
        low: lower level, in the unit of the input.
        high: upper level, same unit.

    Returns:
        (samples,) input.

    Raises:
        InputError: a rate is not positive or the range is empty.

    Example:
        >>> triangle(5, rate_hz=4.0, frequency_hz=1.0, low=0.0, high=2.0).tolist()
        [0.0, 1.0, 2.0, 1.0, 0.0]
    """
    require_positive(rate_hz=rate_hz, frequency_hz=frequency_hz)
    ordered(low, high)
    if 2 * frequency_hz > rate_hz:
        raise InputError(
            f"frequency_hz is {frequency_hz!r}: give at most {rate_hz / 2:g}, half the rate"
        )
    # Modulo in samples, not in seconds: where a period is whole, its repeats are exact.
    period = rate_hz / frequency_hz
    part = jnp.mod(index_of(samples), period) / period
    return low + (high - low) * (1.0 - jnp.abs(2.0 * part - 1.0))


def decaying_triangles(
    samples: int,
    rate_hz: float,
    slope: float,
    turns: int = 10,
    low: float = 0.0,
    high: float = 75.0,
    centre: float | None = None,
) -> jax.Array:
    """Triangles of constant slope that shrink to a level and rest there: they demagnetise.

    Turning point j = 1 ... turns has the distance (1 - (j-1)/turns) (end - centre) from the centre,
    upper end first.

    Arguments:
        samples: number of samples.
        rate_hz: sampling rate, Hz.
        slope: rate of the input, in its unit per second.
        turns: number of turning points.
        low: lower end, in the unit of the input; the signal starts here.
        high: upper end, same unit.
        centre: level to shrink to, same unit; None is the middle.

    Returns:
        (samples,) input; it stays at `centre` once it is there.

    Raises:
        InputError: a rate is not positive, the range is empty or the centre outside of it.

    Example:
        >>> u = decaying_triangles(9, rate_hz=1.0, slope=1.0, turns=2, low=-2.0, high=2.0)
        >>> u.round(4).astype(int).tolist()
        [-2, -1, 0, 1, 2, 1, 0, -1, 0]
    """
    require_positive(rate_hz=rate_hz, slope=slope, turns=turns)
    ordered(low, high)
    centre = 0.5 * (low + high) if centre is None else centre
    if not low <= centre <= high:
        raise InputError(f"centre is {centre!r}: it must lie in {low!r} to {high!r}")
    levels = np.array([low, *shrinking(low, high, centre, turns), centre])
    corners = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(levels)))]) * (rate_hz / slope)
    return lines_through(samples, corners, levels)


def shrinking(low: float, high: float, centre: float, turns: int) -> list[float]:
    """Turning points about a centre, whose distances from it fall evenly to nothing."""
    ends = (high - centre, low - centre)
    return [centre + (1.0 - j / turns) * ends[j % 2] for j in range(turns)]


def lines_through(samples: int, corners: np.ndarray, levels: np.ndarray) -> jax.Array:
    """Piecewise linear signal through levels at corners, which are counted in samples."""
    k = index_of(samples)
    return jnp.interp(k, jnp.asarray(corners, k.dtype), jnp.asarray(levels, k.dtype))


def staircase(
    samples: int,
    rate_hz: float,
    hold_s: float,
    steps: int = 10,
    low: float = 0.0,
    high: float = 75.0,
) -> jax.Array:
    """Equal steps from the lower level to the upper one and back, with a hold after each.

    Arguments:
        samples: number of samples.
        rate_hz: sampling rate, Hz.
        hold_s: duration of a hold, s; at least one sample.
        steps: steps from `low` to `high`.
        low: lower level, in the unit of the input.
        high: upper level, same unit.

    Returns:
        (samples,) input; it moves within one sample.

    Raises:
        InputError: a rate, a time or the number of steps is not positive, or the range is empty.

    Example:
        >>> staircase(6, rate_hz=1.0, hold_s=1.0, steps=2, low=0.0, high=2.0).tolist()
        [0.0, 1.0, 2.0, 1.0, 0.0, 1.0]
    """
    require_positive(rate_hz=rate_hz, hold_s=hold_s, steps=steps)
    ordered(low, high)
    if steps != int(steps):
        raise InputError(f"steps is {steps!r}: give a whole number")
    k = index_of(samples)
    # Counted before JAX: a compiled division by a constant may round to the step below.
    stair = np.arange(samples) // max(1, round(hold_s * rate_hz)) % (2 * steps)
    return jnp.asarray(low + (high - low) / steps * np.minimum(stair, 2 * steps - stair), k.dtype)


def chirp(
    samples: int,
    rate_hz: float,
    low_hz: float,
    high_hz: float,
    centre: float = 37.5,
    amplitude: float = 37.5,
) -> jax.Array:
    """Sine whose frequency rises linearly with time.

    u(t) = centre + amplitude sin(2 pi (f0 t + (f1 - f0) t^2 / 2T)).

    Arguments:
        samples: number of samples.
        rate_hz: sampling rate, Hz.
        low_hz: frequency f0 at the first sample, Hz.
        high_hz: frequency f1 at the end T, Hz; below half the sampling rate.
        centre: mean level, in the unit of the input.
        amplitude: of the sine, same unit.

    Returns:
        (samples,) input.

    Raises:
        InputError: the sampling rate is not positive or a frequency cannot be sampled.

    Example:
        >>> [round(u, 6) + 0.0 for u in chirp(4, 4.0, 1.0, 1.0, 0.0, 1.0).tolist()]
        [0.0, 1.0, 0.0, -1.0]
    """
    require_positive(rate_hz=rate_hz)
    for name, value in (("low_hz", low_hz), ("high_hz", high_hz)):
        if not 0.0 <= value < rate_hz / 2:
            raise InputError(f"{name} is {value!r}: give 0 to below {rate_hz / 2!r}, half the rate")
    k = index_of(samples)
    slow, rise = low_hz / rate_hz, (high_hz - low_hz) / rate_hz
    # Whole cycles are dropped before the sine, which loses less in single precision.
    cycles = jnp.mod(k * slow, 1.0) + jnp.mod(0.5 * rise * k * (k / samples), 1.0)
    return centre + amplitude * jnp.sin(2.0 * jnp.pi * cycles)


def multisine(
    key: jax.Array,
    samples: int,
    lines: Sequence[int],
    centre: float = 37.5,
    amplitude: float = 37.5,
) -> jax.Array:
    """Sum of equal sines with random phases, periodic in its own length, so without leakage.

    Arguments:
        key: random key (`jax.random.key`).
        samples: number of samples, one period.
        lines: whole cycles a period of each sine: line n has the frequency n rate / samples.
        centre: mean level, in the unit of the input.
        amplitude: largest distance from the centre, same unit.

    Returns:
        (samples,) input.

    Raises:
        InputError: a line is not whole, is out of range or occurs twice.

    Example:
        >>> import jax
        >>> u = multisine(jax.random.key(0), 64, lines=(3, 5), centre=0.0, amplitude=2.0)
        >>> round(float(abs(u).max()), 5)
        2.0
    """
    rows = checked_lines(lines, samples)
    turns = uniform(key, rows.size)
    return cast(Any, _of_phases)(turns, jnp.asarray(rows), samples, centre, amplitude)


@partial(jax.jit, static_argnums=2)
def _of_phases(
    turns: jax.Array, lines: jax.Array, samples: int, centre: Any, amplitude: Any
) -> jax.Array:
    """The sum of equal sines whose phases are given in turns; one program for all amplitudes."""
    phases = 2.0 * jnp.pi * turns
    spectrum = jnp.zeros(samples // 2 + 1, jnp.result_type(phases.dtype, jnp.complex64))
    wave = jnp.fft.irfft(spectrum.at[lines].set(jnp.exp(1j * phases)), samples)
    return centre + amplitude * wave / jnp.max(jnp.abs(wave))

"""Excitations: what to play to an actuator in order to see its hysteresis and its other effects."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import cast

import jax
import jax.numpy as jnp
import numpy as np

from preisach_jax.errors import InputError, require_positive

# No number is harder to approximate by fractions than the golden section and what ends like it, so
# that its multiples, wrapped into a range, fall evenly over it and not on a lattice.
GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0


def _index(samples: int) -> jax.Array:
    if samples != int(samples) or samples < 1:
        raise InputError(f"samples is {samples}: give a whole number of at least 1")
    return jnp.arange(samples, dtype=jnp.result_type(float))


def _uniform(key: jax.Array, count: int) -> jax.Array:
    """Numbers in [0, 1); drawn in single precision, so that a key means one signal in both."""
    return jax.random.uniform(as_key(key), (count,), jnp.float32).astype(jnp.result_type(float))


def as_key(key: jax.Array) -> jax.Array:
    """A random key, or an error that says how to make one.

    Args:
        key: a key of `jax.random.key`, or the older kind of `jax.random.PRNGKey`.

    Returns:
        A key of the newer kind.

    Raises:
        InputError: it is no key.

    Example:
        >>> import jax
        >>> as_key(jax.random.PRNGKey(0)) == jax.random.key(0)
        Array(True, dtype=bool)
    """
    kind = getattr(key, "dtype", None)
    if kind is not None and jnp.issubdtype(kind, jax.dtypes.prng_key):
        return key
    if kind == jnp.uint32 and key.shape == (2,):
        return cast(jax.Array, jax.random.wrap_key_data(key))
    raise InputError(f"the key is {key!r}: make one by jax.random.key(0)")


def _ordered(low: float, high: float) -> None:
    if not -math.inf < low < high < math.inf:
        raise InputError(
            f"the range is {low!r} to {high!r}: low must be below high, and both finite"
        )


def triangle(
    samples: int, rate_hz: float, frequency_hz: float, low: float = 0.0, high: float = 75.0
) -> jax.Array:
    """Triangle between two levels, which starts at the lower one and rises.

    u(t) = low + (high - low) (1 - |2 frac(f t) - 1|).

    Args:
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
    _ordered(low, high)
    if 2 * frequency_hz > rate_hz:
        raise InputError(
            f"frequency_hz is {frequency_hz!r}: give at most {rate_hz / 2:g}, half the rate"
        )
    # Modulo in samples, not in seconds: where a period is whole, its repeats are exact.
    period = rate_hz / frequency_hz
    part = jnp.mod(_index(samples), period) / period
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

    Args:
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
    _ordered(low, high)
    centre = 0.5 * (low + high) if centre is None else centre
    if not low <= centre <= high:
        raise InputError(f"centre is {centre!r}: it must lie in {low!r} to {high!r}")
    levels = np.array([low, *_shrinking(low, high, centre, turns), centre])
    corners = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(levels)))]) * (rate_hz / slope)
    return _lines(samples, corners, levels)


def _shrinking(low: float, high: float, centre: float, turns: int) -> list[float]:
    ends = (high - centre, low - centre)
    return [centre + (1.0 - j / turns) * ends[j % 2] for j in range(turns)]


def _lines(samples: int, corners: np.ndarray, levels: np.ndarray) -> jax.Array:
    """Piecewise linear signal through levels at corners, which are counted in samples."""
    k = _index(samples)
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

    Args:
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
    _ordered(low, high)
    if steps != int(steps):
        raise InputError(f"steps is {steps!r}: give a whole number")
    k = _index(samples)
    # Counted before JAX: a compiled division by a constant may round to the step below.
    stair = np.arange(samples) // max(1, round(hold_s * rate_hz)) % (2 * steps)
    return low + (high - low) / steps * jnp.asarray(np.minimum(stair, 2 * steps - stair), k.dtype)


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

    Args:
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
    k = _index(samples)
    slow, rise = low_hz / rate_hz, (high_hz - low_hz) / rate_hz
    # Whole cycles are dropped before the sine, which loses less in single precision.
    cycles = jnp.mod(k * slow, 1.0) + jnp.mod(0.5 * rise * k * (k / samples), 1.0)
    return centre + amplitude * jnp.sin(2.0 * jnp.pi * cycles)


def checked_lines(lines: Sequence[int], period: int) -> np.ndarray:
    """Lines of a periodic excitation, for those who play it and those who measure its response.

    Args:
        lines: whole cycles a period of each sine.
        period: samples of a period.

    Returns:
        (lines,) whole numbers, in the order given.

    Raises:
        InputError: there is no line, or one is not whole, is below 1, is not below half the number
            of samples or occurs twice.

    Example:
        >>> checked_lines((3, 5), 64).tolist()
        [3, 5]
    """
    given = np.asarray(lines).reshape(-1)
    rows = given.astype(int)
    if rows.size == 0 or np.any(rows != given) or rows.min() < 1 or 2 * rows.max() >= period:
        raise InputError(
            f"lines are {given.tolist()}: give whole numbers from 1 to below {period / 2:g}"
        )
    if np.unique(rows).size < rows.size:
        raise InputError(f"lines are {given.tolist()}: name each only once")
    return rows


def multisine(
    key: jax.Array,
    samples: int,
    lines: Sequence[int],
    centre: float = 37.5,
    amplitude: float = 37.5,
) -> jax.Array:
    """Sum of equal sines with random phases, periodic in its own length, so without leakage.

    Args:
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
    phases = 2.0 * jnp.pi * _uniform(key, rows.size)
    spectrum = jnp.zeros(samples // 2 + 1, jnp.result_type(phases.dtype, jnp.complex64))
    wave = jnp.fft.irfft(spectrum.at[rows].set(jnp.exp(1j * phases)), samples)
    return centre + amplitude * wave / jnp.max(jnp.abs(wave))


def bernoulli_ramp(
    key: jax.Array,
    samples: int,
    rate_hz: float,
    coin_hz: float = 10.0,
    slope: float | None = None,
    low: float = 0.0,
    high: float = 75.0,
) -> jax.Array:
    """Ramp that a coin turns up or down and the ends of the range reflect: a Bernoulli process.

    The excitation of the paper's experiment, a coin tossed at 10 Hz. A folded random walk:
    turning points are u(0) plus multiples of slope / coin_hz, folded into the range.

    Args:
        key: random key (`jax.random.key`).
        samples: number of samples.
        rate_hz: sampling rate, Hz.
        coin_hz: tosses a second.
        slope: rate of the input, in its unit per second. It should share no fraction with the
            tosses, or the turning points lie on a coarse lattice; None moves by
            1/(5 + (sqrt 5 - 1)/2) of the way there and back in one toss (267 V/s over 75 V).
        low: lower end, in the unit of the input; the signal starts here.
        high: upper end, same unit.

    Returns:
        (samples,) input.

    Raises:
        InputError: a rate is not positive or the range is empty.

    Example:
        >>> import jax
        >>> u = bernoulli_ramp(jax.random.key(0), samples=1000, rate_hz=2000.0)
        >>> bool(((u >= 0.0) & (u <= 75.0)).all())
        True
    """
    require_positive(samples=samples, rate_hz=rate_hz, coin_hz=coin_hz)
    _ordered(low, high)
    slope = 2.0 * (high - low) * coin_hz / (5.0 + GOLDEN) if slope is None else slope
    require_positive(slope=slope)
    toss = (np.arange(samples) * coin_hz / rate_hz).astype(int)
    coins = _uniform(key, math.ceil(samples * coin_hz / rate_hz) + 1) < 0.5
    # Whole numbers, so that a long walk is as exact as a short one.
    step = jnp.where(coins, 1, -1)[toss]
    walk = jnp.cumsum(step) - step
    span = high - low
    place = jnp.mod(walk * (slope / rate_hz), 2.0 * span)
    return jnp.clip(low + span - jnp.abs(place - span), low, high)


def random_steps(
    key: jax.Array,
    samples: int,
    rate_hz: float,
    hold_s: float,
    low: float = 0.0,
    high: float = 75.0,
) -> jax.Array:
    """Steps to uniformly drawn levels, each held for the same time.

    Args:
        key: random key (`jax.random.key`).
        samples: number of samples.
        rate_hz: sampling rate, Hz.
        hold_s: duration of a hold, s; at least one sample.
        low: lower end, in the unit of the input.
        high: upper end, same unit.

    Returns:
        (samples,) input.

    Raises:
        InputError: a rate or time is not positive or the range is empty.

    Example:
        >>> import jax
        >>> u = random_steps(jax.random.key(0), samples=6, rate_hz=1.0, hold_s=3.0)
        >>> len(set(u.tolist()))
        2
    """
    require_positive(samples=samples, rate_hz=rate_hz, hold_s=hold_s)
    _ordered(low, high)
    hold = max(1, round(hold_s * rate_hz))
    levels = low + (high - low) * _uniform(key, math.ceil(samples / hold))
    return levels[np.arange(samples) // hold]


class _Pen:
    """Draws a piecewise linear signal: corners at whole samples, levels in parts of the range."""

    def __init__(self, samples_per_second: float):
        self.per_second = samples_per_second
        self.corners, self.levels = [0], [0.0]

    def _after(self, seconds: float) -> int:
        return self.corners[-1] + max(1, round(seconds * self.per_second))

    def go(self, level: float, rate: float) -> None:
        """Moves to a level at a rate in parts of the range per second."""
        self.corners.append(self._after(abs(level - self.levels[-1]) / rate))
        self.levels.append(level)

    def hold(self, seconds: float) -> tuple[int, int]:
        """Rests; returns the first and last sample."""
        begin = self.corners[-1]
        self.corners.append(self._after(seconds))
        self.levels.append(self.levels[-1])
        return begin, self.corners[-1]

    def loop(self) -> None:
        """The reference loop: to the top and back."""
        self.go(1.0, 4.0)
        self.go(0.0, 4.0)


def _decays(pen: _Pen) -> None:
    """Decaying triangles at three rates over 1.5 decades, to centres that differ."""
    for rate, turns, centre in ((0.8, 5, 0.47), (4.0, 9, 0.61), (26.0, 14, 0.38)):
        pen.go(0.0, 3.5)
        for level in _shrinking(0.0, 1.0, centre, turns):
            pen.go(level, rate)
        pen.hold(0.1)


def _holds(pen: _Pen) -> None:
    """Steps upward and downward, held for times over two decades."""
    times = (0.018, 0.2, 0.06, 1.9, 0.6)
    pen.go(0.0, 3.5)
    for level, seconds in zip((0.13, 0.34, 0.52, 0.71, 0.92), times, strict=True):
        pen.go(level, 40.0)
        pen.hold(seconds)
    for level, seconds in zip((0.81, 0.63, 0.43, 0.24, 0.08), times, strict=True):
        pen.go(level, 40.0)
        pen.hold(seconds)


def _minor_loops(pen: _Pen) -> None:
    """Loops of equal swing at five biases, on the rising branch and on the falling one."""
    swing, biases = 0.16, (0.1, 0.27, 0.44, 0.61, 0.78)
    pen.go(0.0, 3.5)
    for bias in biases:
        for level in (bias + swing, bias, bias + swing):
            pen.go(level, 3.5)
    pen.go(1.0, 3.5)
    for bias in biases[::-1]:
        for level in (bias, bias + swing, bias):
            pen.go(level, 3.5)
    pen.go(0.0, 3.5)


def _spread(pen: _Pen) -> None:
    """Turning points that fill the plane evenly, at alternating rates."""
    for j in range(19):
        upper, lower = (0.5 + j * GOLDEN) % 1.0, (0.25 + j * math.sqrt(2.0)) % 1.0
        upper, lower = max(upper, lower), min(upper, lower)
        pen.go(upper, (2.0, 6.0, 18.0)[j % 3])
        pen.go(lower, (2.0, 6.0, 18.0)[j % 3])


def _diagnostic_pen(samples_per_second: float) -> tuple[_Pen, tuple[int, int]]:
    pen = _Pen(samples_per_second)
    pen.hold(0.2)
    for _ in range(3):
        pen.loop()
    _decays(pen)
    _holds(pen)
    _minor_loops(pen)
    pen.go(0.64, 3.5)
    pen.hold(1.2)
    _spread(pen)
    pen.go(0.5, 3.5)
    vibration = pen.hold(2.0)
    pen.go(0.0, 3.5)
    pen.loop()
    pen.hold(0.2)
    return pen, vibration


def _vibration(samples: int) -> np.ndarray:
    """Twenty equal sines with Schroeder's phases and soft ends, in parts of the range."""
    lines = np.arange(2, 61, 3)
    phases = -np.pi * np.arange(lines.size) * np.arange(1, lines.size + 1) / lines.size
    place = (np.arange(samples) + 0.5) / samples
    wave = np.sin(2.0 * np.pi * lines * place[:, None] + phases).sum(axis=1)
    # Both ends have to meet the rest around it.
    taper = np.clip(10.0 * np.minimum(place, 1.0 - place), 0.0, 1.0)
    return 0.12 * wave / np.max(np.abs(wave)) * np.sin(0.5 * np.pi * taper) ** 2


def diagnostic_record(
    seconds: float = 24.0, rate_hz: float = 2000.0, low: float = 0.0, high: float = 75.0
) -> np.ndarray:
    """One excitation that shows every effect of the library at least once.

    In this order: three exact repeats of a reference loop (noise floor), decaying triangles at
    three rates over 1.5 decades (rate, lag), steps in both directions held over two decades of time
    (creep), minor loops of equal swing at five biases on both branches (congruency), a pause
    (drift), turning points all over the range, a short multisine (delay against lag), and the
    reference loop again (drift, ageing).

    Args:
        seconds: duration, s; all times stretch with it, and rates in proportion fall. In 24 s the
            slowest decaying triangle moves 0.8 ranges a second and the fastest 26.
        rate_hz: sampling rate, Hz.
        low: lower end, in the unit of the input; the signal starts and ends here.
        high: upper end, same unit.

    Returns:
        (round(seconds * rate_hz),) input; a NumPy array in double precision whatever JAX works in,
        because it is to be played and written to files. Its corners are sampled exactly.

    Raises:
        InputError: a time or rate is not positive, the range is empty, or the samples are too few.

    Example:
        >>> diagnostic_record(seconds=24.0, rate_hz=500.0).shape
        (12000,)
    """
    require_positive(seconds=seconds, rate_hz=rate_hz)
    _ordered(low, high)
    samples = round(seconds * rate_hz)
    if samples < 6000:
        raise InputError(
            f"{seconds:g} s at {rate_hz:g} Hz are {samples} samples, too few for the fast parts: "
            "give at least 6000"
        )
    ruler = 100_000.0
    plan_s = _diagnostic_pen(ruler)[0].corners[-1] / ruler
    pen, (begin, end) = _diagnostic_pen((samples - 1) / plan_s)
    shape = np.interp(np.arange(samples), pen.corners, pen.levels)
    shape[begin:end] += _vibration(end - begin)
    return low + (high - low) * shape

"""Excitations that a coin drives: ramps that turn at random, and random steps."""

from __future__ import annotations

import math

import jax
import jax.numpy as jnp
import numpy as np

from preisach_jax.errors import require_positive
from preisach_jax.signals.checks import known, ordered, uniform

# No number is harder to approximate by fractions than the golden section and what ends like it, so
# that its multiples, wrapped into a range, fall evenly over it and not on a lattice.
GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0


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

    Arguments:
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
    ordered(low, high)
    slope = 2.0 * (high - low) * coin_hz / (5.0 + GOLDEN) if slope is None else slope
    require_positive(slope=slope)
    toss = (np.arange(samples) * coin_hz / rate_hz).astype(int)
    xp, drawn = known(uniform(key, math.ceil(samples * coin_hz / rate_hz) + 1))
    # Whole numbers, so that a long walk is as exact as a short one.
    step = xp.where(drawn < 0.5, 1, -1)[toss]
    walk = (xp.cumsum(step) - step).astype(drawn.dtype)
    span = high - low
    place = xp.mod(walk * (slope / rate_hz), 2.0 * span)
    return jnp.asarray(xp.clip(low + span - xp.abs(place - span), low, high))


def random_steps(
    key: jax.Array,
    samples: int,
    rate_hz: float,
    hold_s: float,
    low: float = 0.0,
    high: float = 75.0,
) -> jax.Array:
    """Steps to uniformly drawn levels, each held for the same time.

    Arguments:
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
    ordered(low, high)
    hold = max(1, round(hold_s * rate_hz))
    _, drawn = known(uniform(key, math.ceil(samples / hold)))
    levels = low + (high - low) * drawn
    return jnp.asarray(levels[np.arange(samples) // hold])

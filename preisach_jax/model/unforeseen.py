"""What nothing in a record foretells: how a drift goes on behind it, and which one another has."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np

from preisach_jax.chain import Chain, Coefficients, EffectValues
from preisach_jax.cores import on_processor
from preisach_jax.effects.base import AddedEffect, Signals

POINTS = 512
"""Times at which what an effect did along the record is looked at."""

LONGEST_LAG = 0.5
"""Share of the record up to which lags are measured; beyond it variance grows with time."""


def unforeseen(
    chain: Chain,
    values: EffectValues,
    coefficients: Coefficients,
    span: tuple[float, float],
    time: np.ndarray,
    goes_on: bool,
) -> np.ndarray:
    r"""Standard deviation of what effects that depend on time alone do beyond what was recorded.

    Behind the record, a drift that follows no law stays where it was, and a prediction misses it by
    the structure function of the drift at the lag since then,
    \(D(h) = \langle (d(t + h) - d(t))^2 \rangle\) (A. M. Yaglom, Correlation Theory of Stationary
    and Related Random Functions I, Springer 1987, ch. 4), which grows as that of a random walk
    beyond the lags that can be measured.  In another record, any drift or hum has another course,
    of which that of this one is a sample: twice its variance.

    Arguments:
        span: first and last time of the record on which the model was identified, in s.
        time: (time,) of the record that is predicted, in s.
        goes_on: whether that is the same record, and what comes behind it.

    Returns:
        (time,) in output units.
    """
    variance = np.zeros(len(time))
    seen = np.linspace(0.0, span[1] - span[0], POINTS)
    first = 0
    for effect in chain.at(AddedEffect):
        count = len(effect.coefficients())
        own, first = coefficients.added[first : first + count], first + count
        if not effect.of_time_alone or (goes_on and not effect.lawless):
            continue
        with on_processor():
            along = Signals(jnp.asarray(seen), jnp.zeros(POINTS), {})
            course = np.asarray(effect.at(values[effect.name]).columns(along)) @ own
        if goes_on:
            ahead = np.maximum(time - span[1], 0.0)
            variance += _structure(course, ahead / seen[1])
        else:
            variance += 2 * course.var()
    return np.sqrt(variance)


def _structure(course: np.ndarray, lag: np.ndarray) -> np.ndarray:
    """Mean square of the increments of a course over lags in samples."""
    most = round(LONGEST_LAG * len(course))
    known = [0.0, *(float(np.mean((course[k:] - course[:-k]) ** 2)) for k in range(1, most + 1))]
    found: np.ndarray = np.interp(lag, np.arange(most + 1), known)
    return found * np.maximum(lag / most, 1.0)

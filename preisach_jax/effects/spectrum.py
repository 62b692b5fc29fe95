"""Spectral lines of a signal whose samples are unevenly spaced."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy

FINENESS = 4
"""Least number of frequencies searched in one over the span; a line loses 5 % between two."""

BACKGROUND = 81
"""Frequencies over which the level around a line is averaged."""

PROMINENCE = 2.0
"""Least power of a line, over what the greatest of as many noise values reaches."""


def strongest_lines(
    position: np.ndarray,
    signal: np.ndarray,
    low: float,
    high: float,
    pitch: float,
    count: int,
    white: bool = False,
) -> list[float]:
    r"""Frequencies of the lines that stand out most from the level around them.

    The line of greatest \(|\sum_k r_k e^{-2\pi i f x_k}|^2\) over that level is found on a raster,
    refined without one, fitted and subtracted, and so on (the CLEAN method: D. H. Roberts,
    J. Lehár, J. W. Dreher, Astron. J. 93 (1987) 968-989).

    Arguments:
        position: (sample,) times or places x, in any order.
        signal: (sample,) values r.
        low, high: range of frequencies, per unit of position; `low` is a few over the span.
        white: whether the level is alike at all frequencies; a line that crowded samples spread
            stands out of that, but not of its own skirts.
    """
    position = position - position.min()
    span = float(position.max())
    # Uneven samples would spread what is slower over all frequencies.  A gap of two over the span
    # keeps the notch out of the level around the lowest lines.
    slow = np.pi * np.outer(position / span, np.arange(1 + max(0, int(2 * (low * span - 2)))))
    rest = without(signal, np.concatenate([np.cos(slow), np.sin(slow[:, 1:])], axis=1))

    def height(f: float, values: np.ndarray) -> float:
        return -float(np.abs(np.exp(-2j * np.pi * f * position) @ values))

    found: list[float] = []
    while len(found) < count and rest.any():
        frequency, prominence = _most_prominent(position, rest, low, high, pitch, white)
        if prominence < PROMINENCE:
            break
        reach = 1 / (FINENESS * span)
        refined: Any = scipy.optimize.minimize_scalar(
            height,
            bounds=(max(frequency - reach, low), min(frequency + reach, high)),
            args=(rest,),
            method="bounded",
            options={"xatol": 1e-3 / span},
        )
        found.append(float(refined.x))
        phase = 2 * np.pi * found[-1] * position
        rest = without(rest, np.stack([np.cos(phase), np.sin(phase)], axis=1))
    return found


def without(values: np.ndarray, waves: np.ndarray) -> np.ndarray:
    """What remains of values behind their best fit by some waves."""
    return values - waves @ np.linalg.lstsq(waves, values, rcond=None)[0]


def _most_prominent(
    position: np.ndarray, values: np.ndarray, low: float, high: float, pitch: float, white: bool
) -> tuple[float, float]:
    """Frequency of the most prominent line on a raster, and its prominence."""
    place = position / pitch
    left = np.floor(place).astype(int)
    share = place - left
    count = int(left.max()) + 2
    raster = np.bincount(left, values * (1 - share), count)
    raster += np.bincount(left + 1, values * share, count)
    size = 2 ** int(np.ceil(np.log2(FINENESS * count)))
    power = np.abs(np.fft.rfft(raster, size)) ** 2
    first = max(1, round(low * size * pitch))
    last = max(first + 1, round(high * size * pitch))
    power = power[first : last + 1]
    level = np.log(power + np.finfo(float).tiny)
    # The mean logarithm of exponentially distributed powers lies Euler's gamma below their mean.
    around = scipy.ndimage.uniform_filter1d(level, BACKGROUND, mode="reflect") + np.euler_gamma
    if white:
        around = np.full_like(level, np.log(np.sum(values**2)))
    best = int(np.argmax(level - around))
    # A line that is modulated has skirts, which are the level around it: then it must stand out
    # from the white noise that has the power of all.
    noise = min(np.exp(around[best]), np.sum(values**2))
    return (first + best) / (size * pitch), float(power[best] / noise / np.log(len(power)))

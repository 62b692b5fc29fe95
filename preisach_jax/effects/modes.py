"""Modes of the mechanics in a measured frequency response, as starting values."""

from __future__ import annotations

import numpy as np
import scipy

SEGMENTS = 16
"""Least number of segments, which overlap by half, over which the response is averaged."""

FINEST = 2048
"""Longest segment, in samples."""

DAMPINGS = (0.005, 0.02, 0.08)
"""Damping ratios at which a mode is first looked for."""

Mode = tuple[float, float]
"""Natural frequency in Hz, and damping ratio."""


def frequency_response(
    time: np.ndarray, drive: np.ndarray, response: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    r"""Response at each frequency, \(S_{ur} / S_{uu}\), averaged over segments (Welch).

    Arguments:
        time: (sample,) times in s; uneven ones are brought to the median step.
        drive, response: (sample,) input and output of what is between.

    Returns:
        Frequencies in Hz, complex responses, and power of the drive, each (frequency,).
    """
    step = float(np.median(np.diff(time)))
    even = np.arange(time[0], time[-1], step)
    drive, response = (np.interp(even, time, each - each.mean()) for each in (drive, response))
    size = min(FINEST, max(len(even) // SEGMENTS, 16))
    hz, cross = scipy.signal.csd(drive, response, fs=1 / step, nperseg=size)
    power = scipy.signal.csd(drive, drive, fs=1 / step, nperseg=size)[1].real
    return hz[1:], cross[1:] / np.maximum(power[1:], np.finfo(float).tiny), power[1:]


def modal_columns(hz: np.ndarray, modes: list[Mode]) -> np.ndarray:
    """(frequency, 2 mode) responses of modes of unit gain at rest, and their rates over ω."""
    columns: list[np.ndarray] = []
    for f, zeta in modes:
        ratio = hz / f
        column = 1 / (1 - ratio**2 + 2j * zeta * ratio)
        columns += [column, 1j * ratio * column]
    return np.stack(columns, axis=1)


def modes_in(
    time: np.ndarray, drive: np.ndarray, response: np.ndarray, low: float, high: float, most: int
) -> list[list[Mode]]:
    """Modes by which one signal follows another, found one after the other.

    Each next mode is the one that takes most off what the others leave of the response, at any
    frequency of the spectrum; then all are refined together, their gains by least squares
    (G. H. Golub, V. Pereyra, SIAM J. Numer. Anal. 10 (1973) 413-432).

    Arguments:
        time: (sample,) times in s.
        drive, response: (sample,) input and output of what is between.
        low, high: least and greatest natural frequency, in Hz.
        most: how many modes at most.

    Returns:
        For each number of modes from one to `most`, the modes, strongest first.

    Example:
        >>> rng = np.random.default_rng(0)
        >>> t, u = np.arange(4096) / 1000.0, rng.normal(size=4096)
        >>> mode = scipy.signal.cont2discrete(([1.0], [1 / 628.3**2, 0.1 / 628.3, 1.0]), 1e-3)
        >>> z = scipy.signal.lfilter(mode[0].ravel(), mode[1], u)
        >>> [round(f) for f, _ in modes_in(t, u, z, 10.0, 450.0, most=1)[0]]
        [100]
    """
    hz, measured, power = frequency_response(time, drive, response)
    weight = np.sqrt(power)
    inside = (hz >= low) & (hz <= high) & (power > 1e-4 * power.max())
    if inside.sum() < 2:
        return []
    # Of unit size, so that the tolerances of the search hold in any unit.
    weight = weight / np.sqrt(np.sum(np.abs(measured * weight) ** 2))
    goal = _split(measured * weight)

    def left(modes: list[Mode]) -> np.ndarray:
        columns = _split(modal_columns(hz, modes) * weight[:, None])
        return goal - columns @ np.linalg.lstsq(columns, goal, rcond=1e-10)[0]

    def of(coordinates: np.ndarray) -> list[Mode]:
        pairs = np.exp(coordinates).reshape(-1, 2)
        return [(float(f), float(zeta)) for f, zeta in pairs]

    found: list[list[Mode]] = []
    modes: list[Mode] = []
    grid = [(float(f), zeta) for f in hz[inside] for zeta in DAMPINGS]
    for _ in range(most):
        rest = left(modes) if modes else goal
        modes = [*modes, max(grid, key=lambda mode: _taken(hz, weight, rest, mode))]
        bounds = np.log([(low, high), (1e-3, 0.7)] * len(modes)).T
        start = np.clip(np.log(modes).ravel(), *(bounds + [[1e-6], [-1e-6]]))
        fitted = scipy.optimize.least_squares(
            lambda x: left(of(x)), start, bounds=bounds, x_scale="jac", max_nfev=20
        )
        modes = of(fitted.x)
        found.append(modes)
    return found


def _split(values: np.ndarray) -> np.ndarray:
    return np.concatenate([values.real, values.imag])


def _taken(hz: np.ndarray, weight: np.ndarray, rest: np.ndarray, mode: Mode) -> float:
    """Power that one mode takes off what is left."""
    columns = np.linalg.qr(_split(modal_columns(hz, [mode]) * weight[:, None]))[0]
    return float(np.sum((columns.T @ rest) ** 2))

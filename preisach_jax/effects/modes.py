"""Modes of the mechanics in a measured frequency response, as starting values."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

SEGMENTS = 8
"""Least number of segments, which overlap by half, over which a response is averaged."""

FINEST = 1024
"""Longest segment, in samples."""

DAMPINGS = (0.005, 0.015, 0.04, 0.12)
"""Damping ratios at which a mode is looked for."""

LEAST_POWER = 1e-4
"""Power of the drive, over its greatest, at a frequency at which a mode is looked for."""


@dataclass(frozen=True)
class Mode:
    """A mode by which a signal follows another.

    Attributes:
        f_hz: natural frequency.
        zeta: damping ratio.
        gain: response to a slow drive, in units of the response over those of the drive.
        quadrature: the same for the rate over the natural frequency; a delay brings some.
    """

    f_hz: float
    zeta: float
    gain: float
    quadrature: float = 0.0


def frequency_response(
    time: np.ndarray, drive: np.ndarray, response: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    r"""Response at each frequency, \(S_{ur} / S_{uu}\), averaged over segments (P. D. Welch).

    Arguments:
        time: (sample,) times in s; uneven ones are brought to the median step.
        drive, response: (sample,) input and output of what is between.

    Returns:
        Frequencies in Hz, complex responses, and power of the drive, each (frequency,).
    """
    step = float(np.median(np.diff(time)))
    even = np.arange(time[0], time[-1], step)
    moved = np.asarray(np.interp(even, time, drive - drive.mean()), float)
    answer = np.asarray(np.interp(even, time, response - response.mean()), float)
    size = min(FINEST, max(2 * len(even) // (SEGMENTS + 1), 16))
    hz, cross = scipy.signal.csd(moved, answer, fs=1 / step, nperseg=size)
    power = scipy.signal.csd(moved, moved, fs=1 / step, nperseg=size)[1].real
    return hz[1:], cross[1:] / np.maximum(power[1:], np.finfo(float).tiny), power[1:]


def modes_in(
    time: np.ndarray,
    drive: np.ndarray,
    response: np.ndarray,
    low: float,
    high: float,
    count: int,
    settled: bool,
) -> tuple[Mode, ...]:
    r"""Modes by which one signal follows another, found one after the other.

    Each next mode is the one that takes most off what the others leave of the response, with a
    residue of any phase, since a delay turns it; then all residues are found again together by
    least squares.

    Arguments:
        time: (sample,) times in s.
        drive, response: (sample,) input and output of what is between.
        low, high: least and greatest natural frequency, in Hz.
        settled: whether the response to a slow drive is known, so that of each mode only what it
            adds to that, \(H - 1\), is looked for.

    Returns:
        The modes, the strongest first; fewer where the drive has power at fewer frequencies.
    """
    hz, measured, power = frequency_response(time, drive, response)
    inside = (hz >= low) & (hz <= high) & (power > LEAST_POWER * power.max())
    grid = [(float(f), zeta) for f in hz[inside] for zeta in DAMPINGS]
    weight = np.sqrt(power)
    candidates = _residues(hz, grid, settled) * weight[:, None, None]
    size = np.maximum(np.sum(np.abs(candidates) ** 2, axis=0), np.finfo(float).tiny)
    goal, found = _split(measured * weight), list[int]()
    left, residues = goal, np.zeros(0)
    for _ in range(min(count, int(inside.sum()))):
        moment = np.einsum("fmc,f->mc", candidates.conj(), left[: len(hz)] + 1j * left[len(hz) :])
        # The two residues of a mode are a quarter of a turn apart, and so orthogonal.
        taken = np.sum(moment.real**2 / size, axis=1)
        taken[found] = 0.0
        found.append(int(taken.argmax()))
        columns = _split(candidates[:, found].reshape(len(hz), -1))
        residues = np.linalg.lstsq(columns, goal, rcond=1e-10)[0]
        left = goal - columns @ residues
    pairs = residues.reshape(-1, 2).tolist()
    modes = [Mode(*grid[at], *both) for at, both in zip(found, pairs, strict=True)]
    return tuple(sorted(modes, key=lambda mode: -np.hypot(mode.gain, mode.quadrature) / mode.zeta))


def _residues(hz: np.ndarray, modes: list[tuple[float, float]], settled: bool) -> np.ndarray:
    """(frequency, mode, 2) responses of modes of unit gain at rest, and their rates over ω."""
    f, zeta = np.array(modes).reshape(-1, 2).T
    ratio = hz[:, None] / f
    response = 1 / (1 - ratio**2 + 2j * zeta * ratio)
    in_phase = ratio**2 * response if settled else response
    return np.stack([in_phase, 1j * ratio * response], axis=2)


def _split(values: np.ndarray) -> np.ndarray:
    return np.concatenate([np.real(values), np.imag(values)])

"""A first guess of a body, from measured force and displacement."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

POWER = 0.98
"""Share of the power of a force up to whose frequency the equation of motion is asked."""

TAPER = 0.05
"""Share of a record that is faded at each end."""


class Guess(NamedTuple):
    """The linear body that comes closest to a record.

    Attributes:
        mass, damping, stiffness: its parameters.
        explained: share of the power of the force that it explains.
        band_hz: frequency below which nearly all power of the force lies, in Hz.
    """

    mass: float
    damping: float
    stiffness: float
    explained: float
    band_hz: float

    @property
    def is_body(self) -> bool:
        """Whether it has a mass and a spring, whose resonance lies in the band of the force."""
        if not (self.mass > 0 and self.stiffness > 0):
            return False
        return np.sqrt(self.stiffness / self.mass) <= 2 * np.pi * self.band_hz


def first_guess(time: np.ndarray, force: np.ndarray, z: np.ndarray) -> Guess:
    """The linear body m, c, k that comes closest to a record, by its equation of motion.

    Both signals are faded at the ends and lose what lies above the band of the force by the same
    filter, so that the equation holds between what is left of them.

    Arguments:
        time: (time,) evenly spaced times, in s.
        force, z: (time,) force and displacement.
    """
    count = len(time)
    frequency = np.fft.rfftfreq(count, float(time[-1] - time[0]) / (count - 1))
    fade = np.clip(np.minimum(np.arange(count), np.arange(count)[::-1]) / (TAPER * count), 0, 1)
    window = np.sin(np.pi / 2 * fade) ** 2
    driving, moving = (np.fft.rfft((each - each.mean()) * window) for each in (force, z))
    power = np.asarray(np.cumsum(np.abs(driving) ** 2), float)
    last = int(np.sum(power < POWER * power[-1]))
    edge = float(frequency[max(min(last, count // 2), 1)])
    passed = 1 / (1 + (frequency / edge) ** 8)
    omega = 2j * np.pi * frequency
    columns: np.ndarray = np.stack(
        [np.fft.irfft(moving * passed * omega**order, count) for order in (2, 1, 0)], axis=1
    )
    goal = np.fft.irfft(driving * passed, count)
    scale = np.maximum(np.linalg.norm(columns, axis=0), np.finfo(float).tiny)
    scaled: np.ndarray = columns / scale
    found: np.ndarray = np.linalg.lstsq(scaled, goal, rcond=None)[0] / scale
    rest = goal - columns @ found
    explained = 1 - float(rest @ rest) / max(float(goal @ goal), np.finfo(float).tiny)
    return Guess(float(found[0]), float(found[1]), float(found[2]), explained, edge)

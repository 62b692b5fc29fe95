r"""Linear effects led: their inverse over a whole course, within the bandwidth that there is.

Effects in series have one frequency response P, that of what they make of an impulse.  Its
regularised inverse \(\bar P / (|P|^2 + \lambda^2)\) looks ahead of a delay, leads a lag, shapes
what excites a mode, and leaves alone what the effects hardly pass (A. N. Tikhonov, V. Y. Arsenin,
Solutions of Ill-Posed Problems, Winston 1977; for lagging stages: D. Croft, G. Shed, S. Devasia,
J. Dyn. Syst. Meas. Control 123 (2001) 35-43).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from preisach_jax.chain.compiled import added_columns_of, apply_effect, as_arrays
from preisach_jax.effects.base import AddedEffect, InputEffect, OutputEffect, Signals

FLOOR = 0.1
"""Share of a course that effects must pass to be led in full: λ above."""

FORGOTTEN = 0.02
"""Share of the greatest response to an impulse that is no longer felt."""

IMPULSE = 1e-3
"""Height of the impulse in units of the signal's range, for effects that are not quite linear."""


@dataclass(frozen=True, eq=False)
class Lead:
    """The inverse of effects in series, for courses of one length and time step.

    Attributes:
        inverse: its frequency response, `(frequency,)`; None where there is nothing to invert.
        samples: length of the courses.
        memory: samples after which the effects have forgotten an impulse, see `FORGOTTEN`.
    """

    inverse: np.ndarray | None
    samples: int
    memory: int = 0

    @staticmethod
    def of(
        effects: Sequence[InputEffect | OutputEffect],
        values: Mapping[str, Mapping[str, Any]],
        samples: int,
        step_s: float,
        scale: float,
    ) -> Lead:
        """The inverse of some effects."""
        if not effects:
            return Lead(None, samples)
        count = 1 << max(2 * samples - 1, 64).bit_length()
        height = IMPULSE * scale
        time: Any = step_s * np.arange(count // 2)
        signal: Any = np.where(np.arange(count // 2) == 1, height, 0.0)
        for effect in effects:
            signal = apply_effect(effect, as_arrays(values[effect.name]), signal, time)
        return Lead.through(np.asarray(signal)[1:] / height, count, samples)

    @staticmethod
    def through(response: np.ndarray, count: int, samples: int) -> Lead:
        """The inverse of a (time,) response to an impulse of height 1 in the first row."""
        passed = np.fft.rfft(response, count)
        inverse = (1 + FLOOR**2) * np.conj(passed) / (np.abs(passed) ** 2 + FLOOR**2)
        size = np.abs(response)
        return Lead(inverse, samples, int(np.flatnonzero(size >= FORGOTTEN * size.max())[-1]))

    @staticmethod
    def beside(
        effects: Sequence[tuple[AddedEffect, np.ndarray]],
        values: Mapping[str, Mapping[str, Any]],
        samples: int,
        step_s: float,
        slope: float,
    ) -> Lead:
        """The inverse of an operator with effects beside it that go with the speed of its input."""
        if not effects:
            return Lead(None, samples)
        count = 1 << max(2 * samples - 1, 64).bit_length()
        time: Any = step_s * np.arange(count // 2)
        response: Any = np.where(np.arange(count // 2) == 1, 1.0, 0.0)
        signals = Signals(time, IMPULSE * response / slope, {})
        for effect, share in effects:
            own = as_arrays(values[effect.name])
            added = np.asarray(added_columns_of(effect, len(share), own, signals)) @ share
            response = response + added / IMPULSE
        return Lead.through(response[1:], count, samples)

    def __call__(self, course: np.ndarray) -> np.ndarray:
        """What must go into the effects for a course to come out, both zero before the first row.

        Behind its last row the course is taken to stay.
        """
        if self.inverse is None:
            return course
        count = 2 * (len(self.inverse) - 1)
        beyond = count - self.samples
        # It stays for a while, and is back at zero when the transform begins anew.
        fade = np.clip(2 - 2 * np.arange(beyond) / (0.9 * beyond), 0.0, 1.0)
        fade = fade * fade * (3 - 2 * fade)
        whole = np.concatenate([course, course[-1] * fade])
        return np.fft.irfft(np.fft.rfft(whole) * self.inverse, count)[: self.samples]

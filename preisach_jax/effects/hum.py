"""Hum: a line of fixed frequency and its harmonics on the recorded output."""

from __future__ import annotations

import math
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from preisach_jax.effects.base import AddedEffect, Signals, Survey
from preisach_jax.effects.parameter import Parameter, coefficient, parameter
from preisach_jax.effects.spectrum import strongest_lines

MAINS_HZ = (50.0, 60.0)
LEAST_PERIODS = 30
"""Periods in the record from which on a line is a hum; slower waves are a drift that wanders."""

CROWD = 8
"""Lines that are looked at to see whether one of them stands alone."""

MOST_COMPANIONS = 2
"""Other lines, at least half as high and no multiples, beside which a line is still a hum; what
repeats with the input makes a comb of many, and so does a sum of sines that a model follows badly.
"""

MOST_STEPS = 2**19
"""Time steps to which a longer record is coarsened for the spectrum, to bound its memory."""


class Hum(AddedEffect):
    r"""A line and its harmonics: \(\sum_k a_k \cos(2\pi k f t) + b_k \sin(2\pi k f t)\).

    Arguments:
        starts_hz: frequencies from which the search starts; the bounds lie one per cent outside.
        harmonics: how many multiples of the frequency, with itself, lie below half the sampling
            rate; at most three.

    Example:
        >>> [c.name for c in Hum(harmonics=2).coefficients()]
        ['cosine_1', 'sine_1', 'cosine_2', 'sine_2']
    """

    name = "hum"
    rank = 14
    in_words = "a hum of fixed frequency in the reading"
    physics = (
        "The mains couple into the wiring of sensor and drive by ground loops and stray fields, at "
        "their frequency and, from rectifiers, at multiples of it; fans and pumps shake the bench "
        "at that of their rotation.  Both go on without regard to the input."
    )
    source = "H. W. Ott, Electromagnetic Compatibility Engineering, Wiley 2009, ch. 2 and 3"
    signature = (
        "sharp lines in the spectrum of the residual, of the same height at rest and in motion"
    )
    confused_with = ("resonance",)
    experiment = (
        "a hold that is much longer than a mode rings: a resonance dies away, a hum goes on"
    )
    found_in_residual = True
    of_time_alone = True
    line = "f_hz"
    starts_hz: tuple[float, ...] = MAINS_HZ
    harmonics: int = eqx.field(static=True, default=3)
    f_hz: float = parameter(
        "Hz",
        lambda own: 0.99 * min(own.starts_hz),
        lambda own: 1.01 * max(own.starts_hz),
        start=lambda own: own.starts_hz,
        meaning="frequency",
    )

    def coefficients(self) -> tuple[Parameter, ...]:
        return tuple(
            coefficient(f"{part}_{k}", "{z}", f"{part} of {k} f_hz")
            for k in range(1, self.harmonics + 1)
            for part in ("cosine", "sine")
        )

    def bound_to(self, survey: Survey) -> Hum:
        starts = MAINS_HZ
        if len(survey.residual) and np.ptp(survey.residual) > 0:
            # A coarser raster keeps to whole steps, so that even samples still lie on it.
            step = survey.step_s * math.ceil(survey.duration_s / survey.step_s / MOST_STEPS)
            high = 0.45 / step
            low = min(LEAST_PERIODS / survey.duration_s, high / 2)
            lines = strongest_lines(survey.time, survey.residual, low, high, step / 4, count=CROWD)
            lines = _standing_alone(lines, survey)[:3]
            far = [f for f in MAINS_HZ if all(abs(line / f - 1) > 0.01 for line in lines)]
            least = min(5 / survey.duration_s, high / 2)
            starts = (*lines, *(f for f in far if least <= f <= high)) or (high / 2,)
        below = int(0.5 / survey.step_s / (1.01 * max(starts)))
        return Hum(starts_hz=starts, harmonics=min(max(below, 1), 3))

    def sampled(self, step_s: float, amounts: tuple[float, ...]) -> dict[str, Any]:
        turns = self.f_hz * step_s
        phase = round((turns - math.floor(turns)) * 2**64) % 2**64
        return {"cosine": amounts[0::2], "sine": amounts[1::2], "phase": phase}

    def columns(self, signals: Signals) -> Float[Array, "time column"]:
        phase = 2 * jnp.pi * self.f_hz * signals.time
        waves = [
            part(k * phase) for k in range(1, self.harmonics + 1) for part in (jnp.cos, jnp.sin)
        ]
        return jnp.stack(waves, axis=1)


def _standing_alone(lines: list[float], survey: Survey) -> list[float]:
    """Those of some lines of a residual that are not one of a crowd."""
    phase = 2 * np.pi * np.outer(survey.time, lines)
    waves = np.concatenate([np.cos(phase), np.sin(phase)], axis=1)
    parts = np.linalg.lstsq(waves, survey.residual, rcond=None)[0]
    height = np.hypot(*parts.reshape(2, -1))

    def related(one: float, other: float) -> bool:
        ratio = max(one, other) / min(one, other)
        return abs(ratio - round(ratio)) * min(one, other) * survey.duration_s < 1

    return [
        line
        for line, own in zip(lines, height, strict=True)
        if sum(
            each > own / 2 and not related(line, other)
            for other, each in zip(lines, height, strict=True)
        )
        <= MOST_COMPANIONS
    ]

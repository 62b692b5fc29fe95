"""A simulated ring core: the field that drives a chosen induction, with chosen losses hidden.

| effect | what it does | parameters of the truth |
|---|---|---|
| `gain:temp_C` | static field (1 + gain (temp - 20 °C)) | `gain_per_C` |
| `eddy_currents` | + k dB/dt, k = conductivity thickness² / 12 | see `draw_losses` |
| `excess_loss` | + c sgn(dB/dt) |dB/dt|^(1/2) | `coefficient` |

The static field is a curve without hysteresis and a bundle of stops (elastic, perfectly plastic
elements) of the induction; a stop of threshold r and slope k loses 4 k r (A - r) in a cycle of
amplitude A > r. Eddy currents are those of a lamination without skin effect, the excess loss is
that of Bertotti (Hysteresis in Magnetism, Academic Press 1998, ch. 12).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from preisach_jax.errors import InputError, require_list
from preisach_jax.plant.experiment import save_columns

LOSSES = ("gain:temp_C", "eddy_currents", "excess_loss")
STOPS = 40
PEAK_T = 1.5
"""Greatest induction of the drive, T."""

BURSTS = ((1, 2), (3, 3), (10, 5))
"""Frequencies over the lowest one, and cycles at each, of each amplitude."""

AMPLITUDES = (1.0, 0.7, 0.4)


@dataclass(frozen=True)
class Core:
    """The static field of a core: H = line b + knee b^7 + Σ slope stop(B), b = B / 1.5 T.

    Attributes:
        threshold: (stop,) T.
        slope: (stop,) A/m per T.
        line, knee: A/m.
    """

    threshold: np.ndarray
    slope: np.ndarray
    line: float
    knee: float

    def field(self, induction: np.ndarray) -> np.ndarray:
        """(time,) static field, A/m, of a course of induction, T, from a demagnetised state."""
        stops, last = np.zeros(STOPS), 0.0
        along = np.empty(len(induction))
        for place, value in enumerate(induction.tolist()):
            stops = np.clip(stops + value - last, -self.threshold, self.threshold)
            along[place] = self.slope @ stops
            last = value
        b = induction / PEAK_T
        return self.line * b + self.knee * b**7 + along

    def loss(self, amplitude: float) -> float:
        """Energy of a static cycle between -A and A, J/m³."""
        moved = np.maximum(amplitude - self.threshold, 0.0)
        return float(4.0 * (self.slope * self.threshold) @ moved)


@dataclass(frozen=True)
class MagnetRecord:
    """What was measured on a core, and what was hidden in it.

    Attributes:
        time: (time,) s.
        field: (time,) A/m, with noise.
        induction: (time,) T, with noise.
        aux: (time,) auxiliary columns by name.
        core: the static hysteresis.
        truth: the hidden effects and their parameters, ready for JSON.
    """

    time: np.ndarray
    field: np.ndarray
    induction: np.ndarray
    aux: Mapping[str, np.ndarray]
    core: Core
    truth: dict[str, Any]

    def save(self, path: str | Path) -> None:
        """Write the columns t_s, H_A_per_m, B_T and the auxiliary ones, comma-separated."""
        columns = {"t_s": self.time, "H_A_per_m": self.field, "B_T": self.induction, **self.aux}
        save_columns(path, columns)


def make_core(seed: int) -> Core:
    """A core of soft steel, drawn from a seed."""
    rng = np.random.default_rng([seed, 31])
    threshold = np.sort(0.9 * rng.uniform(0.05, 1.0, STOPS))
    # Few walls move in a small field, so that small loops are thin (Rayleigh).
    force = threshold * np.exp(-threshold / 0.25) * rng.uniform(0.6, 1.4, STOPS)
    force *= rng.uniform(30.0, 50.0) / force.sum()  # its sum is the coercive field
    line, knee = rng.uniform(15.0, 30.0), rng.uniform(30.0, 60.0)
    return Core(threshold, force / threshold, float(line), float(knee))


def draw_losses(name: str, seed: int) -> dict[str, float]:
    """Parameters of a hidden effect: shares per °C, S/m and m, or (A/m)/(T/s)^(1/2)."""
    rng = np.random.default_rng([seed, 32, LOSSES.index(name)])
    if name == "gain:temp_C":
        return {"gain_per_C": float(-rng.uniform(0.004, 0.008))}
    if name == "eddy_currents":
        return {
            "conductivity_S_per_m": float(rng.uniform(2e6, 3e6)),
            "thickness_m": float(rng.uniform(0.5e-3, 0.8e-3)),
        }
    return {"coefficient": float(rng.uniform(0.6, 1.2))}


def sine_bursts(seconds: float, rate_hz: float) -> np.ndarray:
    """(time,) induction, T: sines of three amplitudes at three frequencies over a decade."""
    lowest = len(AMPLITUDES) * sum(cycles / ratio for ratio, cycles in BURSTS) / seconds
    time = np.arange(round(seconds * rate_hz)) / rate_hz
    course, start = np.zeros_like(time), 0.0
    for amplitude in AMPLITUDES:
        for ratio, cycles in BURSTS:
            stop = start + cycles / (ratio * lowest)
            here = (time >= start) & (time < stop)
            phase = 2.0 * math.pi * ratio * lowest * (time[here] - start)
            course[here] = PEAK_T * amplitude * np.sin(phase)
            start = stop
    return course


def simulate_magnet(
    seed: int = 0,
    seconds: float = 10.5,
    effects: Sequence[str] = (),
    rate_hz: float = 500.0,
    *,
    drive: np.ndarray | None = None,
    noise_field: float = 0.1,
    noise_induction: float = 2e-4,
) -> MagnetRecord:
    """Simulate a ring core whose induction is controlled, with chosen losses hidden in it.

    Arguments:
        drive: (time,) induction, T; None is `sine_bursts`.
    """
    require_list("effects", effects)
    for name in effects:
        if name not in LOSSES:
            raise InputError(f"the core has no effect {name!r}: choose from {', '.join(LOSSES)}")
    hidden = {name: draw_losses(name, seed) for name in effects}
    induction = sine_bursts(seconds, rate_hz) if drive is None else np.asarray(drive, float)
    time, core = np.arange(induction.size) / rate_hz, make_core(seed)
    aux: dict[str, np.ndarray] = {}
    field = core.field(induction)
    if "gain:temp_C" in hidden:
        warming = np.sin(2.0 * math.pi * time / time[-1]) + 0.5 * np.sin(9.0 * time / time[-1])
        aux["temp_C"] = 40.0 + 20.0 * warming
        field = field * (1.0 + hidden["gain:temp_C"]["gain_per_C"] * (aux["temp_C"] - 20.0))
    rate = np.gradient(induction, 1.0 / rate_hz)
    if "eddy_currents" in hidden:
        law = hidden["eddy_currents"]
        field = field + law["conductivity_S_per_m"] * law["thickness_m"] ** 2 / 12.0 * rate
    if "excess_loss" in hidden:
        field = field + hidden["excess_loss"]["coefficient"] * np.sign(rate) * abs(rate) ** 0.5
    rng = np.random.default_rng([seed, 33])
    truth = {"effects": list(effects), "parameters": hidden, "seed": seed, "rate_hz": rate_hz}
    noisy = (field + rng.normal(0.0, noise_field, time.size),
             induction + rng.normal(0.0, noise_induction, time.size))  # fmt: skip
    return MagnetRecord(time, *noisy, aux, core, truth)

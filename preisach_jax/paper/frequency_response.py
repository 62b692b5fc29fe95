"""Fig. 4: the frequency response of the stage, its linear model, and the notch."""

from __future__ import annotations

import math
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from preisach_jax.errors import InputError
from preisach_jax.frequency import fit_modes, frequency_response, measure_frequency_response
from preisach_jax.paper.numbers import FigureData, Progress, report
from preisach_jax.piezo import NOTCH_DENOMINATOR, NOTCH_NUMERATOR, RATE_HZ, encode, paper_stage
from preisach_jax.plant import ENCODER_STEP_UM, RANGE_V
from preisach_jax.signals import multisine

PERIOD = 5000  # samples of a multisine at 5 kHz, so that its lines are whole hertz
PERIODS = 3
MIDDLE_V, AMPLITUDE_V = RANGE_V / 2, 2.0
NOISE_UM = 0.006


@dataclass(frozen=True, eq=False)
class Bode(FigureData):
    """Fig. 4: frequency response of the stage, its linear model, and the notch filter.

    Magnitudes of the stage are in decibels of 1 µm/V, those of the notch filter of 1.

    Attributes:
        frequency_hz: (lines,) measured lines.
        measured_db: (lines,) magnitude, the mean over realisations of the excitation.
        measured_deg: (lines,) phase, unwrapped.
        deviation_db: (lines,) standard deviation of the magnitude between realisations.
        grid_hz: (grid,) frequencies of the lines that are drawn.
        model_db: (grid,) magnitude of the linear model.
        model_deg: (grid,) phase of the linear model.
        notch_db: (grid,) magnitude of F(d), eq. (26).
        notch_deg: (grid,) phase of F(d).
        mode_hz: (2,) natural frequencies of the model.
        mode_error_hz: (2,) their standard errors over realisations.
        damping: (2,) damping ratios.
        damping_error: (2,) their standard errors.
        gain_um_per_v: gain of the model at rest.
        realisations: how many excitations were measured.
        amplitude_v: largest distance of the excitation from the middle of the range.
        noise_um: standard deviation of the sensor's noise.
    """

    frequency_hz: np.ndarray
    measured_db: np.ndarray
    measured_deg: np.ndarray
    deviation_db: np.ndarray
    grid_hz: np.ndarray
    model_db: np.ndarray
    model_deg: np.ndarray
    notch_db: np.ndarray
    notch_deg: np.ndarray
    mode_hz: np.ndarray
    mode_error_hz: np.ndarray
    damping: np.ndarray
    damping_error: np.ndarray
    gain_um_per_v: float
    realisations: int
    amplitude_v: float
    noise_um: float

    @property
    def caption(self) -> str:
        modes = " and ".join(
            f"{f:.2f} ± {df:.2f} Hz (damping {d:.5f} ± {dd:.5f})"
            for f, df, d, dd in zip(
                self.mode_hz, self.mode_error_hz, self.damping, self.damping_error, strict=True
            )
        )
        return (
            f"Frequency response of the simulated stage, measured with {self.realisations} random "
            f"multisines of {self.amplitude_v:g} V about {MIDDLE_V:g} V and "
            f"{1e3 * self.noise_um:g} nm noise (bars: standard deviation between them), a linear "
            f"model fitted to it, with modes at {modes}, and the notch filter (26). Magnitudes of "
            "the stage refer to 1 µm/V, that of the filter to 1."
        )


def bode(
    realisations: int = 6,
    seed: int = 4,
    noise_um: float = NOISE_UM,
    progress: Progress | None = None,
) -> Bode:
    """Measure the frequency response of the simulated stage and fit a linear model, Fig. 4."""
    if realisations < 2:
        raise InputError(f"realisations is {realisations}: give at least 2, to see their spread")
    lines = np.unique(np.round(np.geomspace(5, 2000, 150)).astype(int))
    stage = paper_stage()
    responses: list[np.ndarray] = []
    with jax.enable_x64(True):
        for number in range(realisations):
            report(progress, "frequency response", number / realisations)
            wave_key, noise_key = jax.random.split(jax.random.fold_in(jax.random.key(seed), number))
            wave = multisine(wave_key, PERIOD, lines.tolist(), MIDDLE_V, AMPLITUDE_V)
            u = jnp.tile(wave, PERIODS)
            z = stage.response(u) + noise_um * jax.random.normal(noise_key, u.shape, u.dtype)
            z = encode(z, ENCODER_STEP_UM)
            measured = measure_frequency_response(
                np.asarray(u), np.asarray(z), PERIODS, RATE_HZ, lines.tolist()
            )
            responses.append(measured.response)
    each = np.array(responses)
    mean, frequency = each.mean(axis=0), lines * (RATE_HZ / PERIOD)
    model = fit_modes(frequency, mean, RATE_HZ)
    fits = [fit_modes(frequency, response, RATE_HZ) for response in each]
    grid = np.unique(np.concatenate([np.geomspace(5, 2400, 500), *_near(model.frequency_hz)]))
    notch = frequency_response(NOTCH_NUMERATOR, NOTCH_DENOMINATOR, grid, RATE_HZ)
    frequencies = np.array([fit.frequency_hz for fit in fits])
    dampings = np.array([fit.damping for fit in fits])
    return Bode(
        frequency_hz=frequency,
        measured_db=_decibels(mean),
        measured_deg=_degrees(mean),
        deviation_db=np.std(_decibels(each), axis=0, ddof=1),
        grid_hz=grid,
        model_db=_decibels(model.response(grid)),
        model_deg=_degrees(model.response(grid)),
        notch_db=_decibels(notch),
        notch_deg=_degrees(notch),
        mode_hz=model.frequency_hz,
        mode_error_hz=np.std(frequencies, axis=0, ddof=1) / math.sqrt(realisations),
        damping=model.damping,
        damping_error=np.std(dampings, axis=0, ddof=1) / math.sqrt(realisations),
        gain_um_per_v=model.gain,
        realisations=realisations,
        amplitude_v=AMPLITUDE_V,
        noise_um=noise_um,
    )


def _near(frequencies: np.ndarray) -> list[np.ndarray]:
    """More points of the grid where a lightly damped mode is narrow."""
    return [f * np.linspace(0.92, 1.08, 81) for f in frequencies]


def _decibels(response: np.ndarray) -> np.ndarray:
    return 20.0 * np.log10(np.abs(response))


def _degrees(response: np.ndarray) -> np.ndarray:
    return np.rad2deg(np.unwrap(np.angle(response)))

"""Frequency responses are measured and modelled as they are, on the stage and on known systems."""

from typing import Any

import numpy as np
import pytest
import scipy.signal

from preisach_jax.errors import InputError
from preisach_jax.frequency import fit_modes, frequency_response, measure_frequency_response
from preisach_jax.piezo import NOTCH_DENOMINATOR, NOTCH_NUMERATOR, RATE_HZ

signal: Any = scipy.signal  # whose results are typed as one of many
POLES = ((130.0, 0.02), (310.0, 0.05))  # of a known system at 1 kHz


def known_system():
    """Numerator and denominator of a filter with two modes."""
    f, damping = np.array(POLES).T
    poles = np.exp(2e-3 * np.pi * f * (-damping + 1j * np.sqrt(1 - damping**2)))
    a = np.real(np.poly(np.concatenate([poles, poles.conj()])))
    return np.array([0.4, 0.3, -0.2, 0.35, 0.3]), a


def test_response_of_a_linear_system_is_measured_exactly():
    b, a = known_system()
    rng = np.random.default_rng(0)
    wave = np.fft.irfft(np.exp(2j * np.pi * rng.uniform(size=401)) * (np.arange(401) > 0), 1000)
    u = np.tile(wave, 4)
    z = 5.0 + signal.lfilter(b, a, u)
    lines = list(range(1, 400, 7))
    measured = measure_frequency_response(u, z, 4, 1000.0, lines)
    expected = signal.freqz(b, a, worN=measured.frequency_hz, fs=1000.0)[1]
    np.testing.assert_array_equal(measured.frequency_hz, lines)
    np.testing.assert_allclose(measured.response, expected, rtol=1e-6)
    # Only the second period still holds some of the transient.
    assert np.max(measured.deviation) < 1e-6


def test_deviation_is_that_of_repeated_measurements():
    """Noise in the output alone: the errors over their deviations have unit variance."""
    rng = np.random.default_rng(1)
    lines = list(range(3, 240, 2))
    phases = 7.0 * np.array(lines)[:, None] ** 2
    wave = np.cos(2 * np.pi * np.outer(lines, np.arange(500)) / 500 + phases)
    u = np.tile(wave.sum(axis=0), 41)
    z = 2.0 * u + rng.normal(0.0, 3.0, u.size)
    measured = measure_frequency_response(u, z, 41, 500.0, lines)
    ratio = np.abs(measured.response - 2.0) / measured.deviation
    assert np.sqrt(np.mean(ratio**2)) == pytest.approx(1.0, abs=0.15)
    # Closed form: white noise of variance W on n samples over a line of amplitude 1.
    expected = 3.0 * np.sqrt(500) / 250 / np.sqrt(40)
    assert np.mean(measured.deviation) == pytest.approx(expected, rel=0.05)


def test_response_of_a_filter_against_scipy():
    f = np.linspace(0.0, 0.5 * RATE_HZ, 200)
    expected = signal.freqz(NOTCH_NUMERATOR, NOTCH_DENOMINATOR, worN=f, fs=RATE_HZ)[1]
    got = frequency_response(NOTCH_NUMERATOR, NOTCH_DENOMINATOR, f, RATE_HZ)
    np.testing.assert_allclose(got, expected, rtol=1e-10)
    assert got[0] == pytest.approx(1.0, abs=1e-12)
    with pytest.raises(InputError, match=r"rate_hz is 0\.0: give a number above 0"):
        frequency_response([1.0], [1.0], f, 0.0)


def test_modes_of_a_known_system():
    delay = 3
    b, a = known_system()
    f = np.linspace(5.0, 480.0, 96)
    h = signal.freqz(b, a, worN=f, fs=1000.0)[1] * np.exp(-2j * np.pi * f * delay / 1000.0)
    fit = fit_modes(f, h, 1000.0, modes=2, delay_samples=delay)
    np.testing.assert_allclose(fit.frequency_hz, [130.0, 310.0], rtol=1e-6)
    np.testing.assert_allclose(fit.damping, [0.02, 0.05], rtol=1e-5)
    np.testing.assert_allclose(fit.numerator, b, atol=1e-5)
    np.testing.assert_allclose(fit.denominator, a, atol=1e-5)
    assert fit.gain == pytest.approx(b.sum() / a.sum(), rel=1e-5)
    assert fit.error < 1e-6
    np.testing.assert_allclose(fit.response(f), h, rtol=1e-5)


def test_error_of_a_fit_is_the_scatter_of_the_response():
    b, a = known_system()
    f = np.linspace(2.0, 490.0, 400)
    rng = np.random.default_rng(2)
    scatter = rng.normal(0.0, 0.01, (2, f.size))
    h = signal.freqz(b, a, worN=f, fs=1000.0)[1] * (1.0 + scatter[0] + 1j * scatter[1])
    fit = fit_modes(f, h, 1000.0)
    assert fit.error == pytest.approx(0.01 * np.sqrt(2.0), rel=0.05)
    np.testing.assert_allclose(fit.frequency_hz, [130.0, 310.0], rtol=2e-3)


WAVE = np.tile(np.sin(2 * np.pi * 3 * np.arange(100) / 100), 4)
F = np.linspace(1.0, 49.0, 49)
PEAK = 1.0 / (1.0 - (F / 20.0) ** 2 + 0.05j * F / 20.0)
MEASURED = {"u": WAVE, "z": WAVE, "periods": 4, "rate_hz": 100.0, "lines": [3]}
FITTED = {"frequency_hz": F, "response": PEAK, "rate_hz": 100.0, "modes": 1}


@pytest.mark.parametrize(
    ("function", "changes", "message"),
    [
        (measure_frequency_response, {"periods": 2}, "periods is 2"),
        (measure_frequency_response, {"periods": 7}, "a multiple of 7 periods"),
        (measure_frequency_response, {"z": np.zeros(10)}, r"z \(10,\)"),
        (measure_frequency_response, {"lines": [0]}, r"lines are \[0\].* from 1 to below 50"),
        (measure_frequency_response, {"lines": [3, 3]}, "name each only once"),
        (measure_frequency_response, {"lines": [3, 4]}, r"nothing on the lines \[4\]"),
        (fit_modes, {"response": PEAK[1:]}, r"response \(48,\)"),
        (fit_modes, {"modes": 2}, "has 1 peaks and modes is 2"),
        (fit_modes, {"delay_samples": -1}, "delay_samples -1"),
        (fit_modes, {"rate_hz": 90.0}, "half the rate"),
        (fit_modes, {"response": 0.0 * PEAK}, "zero or not finite"),
        (fit_modes, {"frequency_hz": F[:2], "response": PEAK[:2]}, "2 lines for 1 modes"),
    ],
)
def test_what_cannot_be_used_is_refused(function, changes, message):
    with pytest.raises(InputError, match=message):
        function(**(FITTED if function is fit_modes else MEASURED) | changes)

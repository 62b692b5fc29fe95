"""Residual statistics against slow sums, closed forms and their distribution under chance."""

import numpy as np
import pytest
import scipy.signal
import scipy.stats
from hypothesis import given
from hypothesis import strategies as st

from preisach_jax.diagnosis import residuals
from preisach_jax.record.core import Record


def slow_turns(values, dead_band):
    """Reversals by walking sample by sample, as one would with a finger."""
    turns, direction, extreme = [], 0, 0
    low = high = 0
    for k, value in enumerate(values):
        if direction == 0:
            low = k if value < values[low] else low
            high = k if value > values[high] else high
            if values[high] - value > dead_band:
                direction, extreme = -1, k
            elif value - values[low] > dead_band:
                direction, extreme = 1, k
        elif (value - values[extreme]) * direction > 0:
            extreme = k
        elif (values[extreme] - value) * direction > dead_band:
            turns.append(extreme)
            direction, extreme = -direction, k
    return turns


def test_autocorrelation_is_the_sum_over_pairs_that_are_there():
    rng = np.random.default_rng(3)
    values = rng.normal(size=60)
    values[[4, 5, 40]] = np.nan
    clean = values - np.nanmean(values)
    found = residuals.autocorrelation(values, longest=20, step_s=0.5)
    for lag in range(21):
        pairs = clean[: 60 - lag] * clean[lag:]
        assert found.value[lag] == pytest.approx(np.nanmean(pairs) / np.nanmean(clean**2))
        there = np.sum(np.isfinite(pairs))
        assert found.band[lag] == pytest.approx(scipy.stats.norm.ppf(0.995) / np.sqrt(there))
    np.testing.assert_allclose(found.lag_s, 0.5 * np.arange(21))


def test_bands_hold_99_percent_of_white_noise():
    rng = np.random.default_rng(5)
    shares = []
    for _ in range(60):
        noise = rng.normal(size=2000)
        noise[300:420] = np.nan
        shares.append(residuals.autocorrelation(noise, 80).outside)
    assert 0.005 < np.mean(shares) < 0.016


def test_cross_correlation_band_widens_where_both_are_slow():
    rng = np.random.default_rng(6)
    outside = []
    for _ in range(60):
        slow = [np.convolve(rng.normal(size=4049), np.ones(50) / 50, "valid") for _ in range(2)]
        slow[0][300:420] = np.nan
        found = residuals.cross_correlation(*slow, longest=200)
        outside.append(found.outside)
    assert np.mean(outside) < 0.05
    assert found.band.min() > 3 * scipy.stats.norm.ppf(0.995) / np.sqrt(4000)


@pytest.mark.parametrize("shift", [-7, 0, 12])
def test_cross_correlation_finds_by_how_much_the_residual_follows(shift):
    drive = np.random.default_rng(1).normal(size=3000)
    residual = -2.0 * np.roll(drive, shift)
    found = residuals.cross_correlation(residual, drive, longest=30, step_s=0.1)
    at = np.argmax(np.abs(found.value))
    assert found.lag[at] == shift
    assert found.lag_s[at] == pytest.approx(0.1 * shift)
    assert found.value[at] == pytest.approx(-1.0, abs=0.01)


def test_cumulated_periodogram_agrees_with_scipy():
    values = np.random.default_rng(8).normal(size=501)
    frequency, power = scipy.signal.periodogram(values, fs=100.0)
    found = residuals.cumulated_periodogram(values, step_s=0.01)
    np.testing.assert_allclose(found.frequency_hz, frequency[1:])
    np.testing.assert_allclose(found.value, np.cumsum(power[1:]) / power[1:].sum())
    assert found.band == pytest.approx(1.628 / np.sqrt(250), rel=1e-3)
    with pytest.raises(ValueError, match="at least 5"):
        residuals.cumulated_periodogram(np.ones(4))


@given(
    st.lists(st.integers(-20, 20), min_size=1, max_size=60), st.sampled_from([0.0, 0.5, 3.0, 7.5])
)
def test_reversals_are_those_found_by_walking(values, dead_band):
    values = np.array(values, dtype=float)
    assert residuals.reversals(values, dead_band).tolist() == slow_turns(values, dead_band)


def test_noise_at_rest_does_not_turn_the_input():
    rng = np.random.default_rng(4)
    ramp = np.concatenate([np.linspace(0, 10, 400), np.full(300, 10.0), np.linspace(10, 2, 400)])
    noisy = ramp + rng.uniform(-0.02, 0.02, ramp.size)
    assert len(residuals.reversals(noisy)) == 1
    time = np.arange(ramp.size) * 0.1
    since = residuals.time_since_reversal(time, ramp)
    assert since[399] == 0.0
    assert since[-1] == pytest.approx(time[-1] - time[399])
    assert since[200] == pytest.approx(time[200])
    # The rate uses the actual steps.
    time = np.array([0.0, 0.1, 0.15, 0.4, 0.5])
    np.testing.assert_allclose(residuals.input_rate(time, 3.0 * time + 1.0), 3.0)


def test_pauses_and_unmeasured_rows_are_blank_and_said():
    time = np.concatenate([np.arange(50.0), 100 + np.arange(50.0)])
    output = np.arange(100.0)
    output[10] = np.nan
    record = Record.from_arrays(time, np.arange(100.0), output)
    sequence = residuals.in_sequence(record, record.output, longest=20)
    assert sequence.size == 120
    assert np.isnan(sequence[50:70]).all()
    np.testing.assert_array_equal(sequence[70:], output[50:])
    note = residuals.sampling_note(record)
    assert "1 pause" in note
    assert "1 row without" in note
    even = Record.from_arrays(np.arange(100.0), np.arange(100.0), np.arange(100.0))
    assert residuals.sampling_note(even) == ""


def test_bins_hold_the_quantiles_of_their_points():
    rng = np.random.default_rng(7)
    position = rng.uniform(0, 1, 40_000)
    values = position + rng.normal(size=position.size)
    values[::100] = np.nan
    found = residuals.binned(position, values, bins=20)
    assert found.centre.size == 20
    np.testing.assert_allclose(found.median - found.centre, 0.0, atol=0.1)
    np.testing.assert_allclose(found.high - found.median, 1.645, atol=0.15)
    np.testing.assert_allclose(found.median - found.low, 1.645, atol=0.15)
    # Of few or equal points:
    assert residuals.binned(np.ones(5), np.arange(5.0)).centre.size == 0
    equal = residuals.binned(np.ones(50), np.arange(50.0))
    np.testing.assert_array_equal(equal.median, [24.5])
    assert residuals.binned(np.full(50, np.nan), np.arange(50.0)).centre.size == 0

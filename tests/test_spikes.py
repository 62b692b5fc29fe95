"""Spikes and lost samples of the output change neither what is named nor the error much."""

import numpy as np
import pytest
import world

import preisach_jax as pj
from preisach_jax.fit import begun, double_precision
from preisach_jax.record.spikes import isolated_spikes

EFFECTS = (None, "creep", "input_lag", "delay", "ageing", "slew_limit", "rate_dependence", "hum")


def record_of(made, output):
    units = {"input": "V", "output": "um"}
    return pj.Record.from_arrays(made["t"], made["x"], output, units=units, name="hidden")


def spiked(made, seed, share=0.01, height=0.2):
    rng = np.random.default_rng(seed)
    rows = rng.choice(len(made["z"]), int(share * len(made["z"])), replace=False)
    output = made["z"].copy()
    output[rows] += height * np.ptp(output) * rng.normal(size=len(rows))
    return output, rows


def freed(record):
    with double_precision():
        return begun(record, 9)[0]


@pytest.mark.parametrize("effect", EFFECTS)
def test_nothing_is_left_out_of_a_clean_record_whatever_is_hidden(effect):
    made = world.hidden_record(effect, 305, 6.0, 1000.0)
    record = record_of(made, made["z"])
    assert freed(record) is record


@pytest.mark.parametrize("height", [0.1, 1e5])
def test_spikes_are_found_and_little_else(height):
    made = world.hidden_record("creep", 306, 6.0, 1000.0)
    output, rows = spiked(made, 1, height=height)
    found = set(freed(record_of(made, output)).spikes)
    high = {row for row in rows if abs(output[row] - made["z"][row]) > 0.01 * np.ptp(made["z"])}
    assert len(found & high) >= 0.95 * len(high)
    assert not found - set(rows)


def test_what_was_measured_at_a_spike_is_kept_and_told():
    made = world.hidden_record(None, 307, 6.0, 500.0)
    output = made["z"].copy()
    output[[100, 1700]] += 9.0
    record = freed(record_of(made, output))
    assert record.spikes == {100: output[100], 1700: output[1700]}
    assert record.sha256 == record_of(made, output).sha256
    assert np.isnan(record.output[[100, 1700]]).all()
    assert "2 outputs (0.067 %) stand out" in record._repr_html_()
    assert "samples 101, 1,701" in record._repr_html_()


def test_ringing_steps_and_frequent_outliers_are_no_spikes():
    rng = np.random.default_rng(2)
    t = np.arange(4000) / 1000
    flat = 1e-3 * rng.normal(size=4000)
    since = t % 0.2
    ringing = np.exp(-since / 0.01) * np.sin(2 * np.pi * 120 * since)
    steps = np.repeat(rng.normal(size=20), 200)
    often = np.where(rng.random(4000) < 0.1, rng.normal(size=4000), 0.0)
    for left in (ringing, steps, often):
        record = pj.Record.from_arrays(t, np.sin(t), left + flat)
        assert not isolated_spikes(record, np.zeros(4000)).any()


def test_a_spike_beside_ringing_is_found_if_it_is_higher():
    t = np.arange(4000) / 1000
    since = t % 0.2
    left = np.exp(-since / 0.01) * np.sin(2 * np.pi * 120 * since)
    left = left + 1e-3 * np.random.default_rng(3).normal(size=4000)
    left[1350] += 20.0
    record = pj.Record.from_arrays(t, np.sin(t), left)
    assert np.flatnonzero(isolated_spikes(record, np.zeros(4000))).tolist() == [1350]


@pytest.mark.parametrize("effect", [None, "input_lag"])
def test_spikes_and_lost_samples_change_neither_verdict_nor_error(effect):
    made = world.hidden_record(effect, 308, 8.0, 1000.0)
    output, _ = spiked(made, 4)
    output[np.random.default_rng(5).random(len(output)) < 0.1] = np.nan
    asked = ["input_lag", "drift"]
    clean, bad = (pj.diagnose(record_of(made, z), asked, levels=13) for z in (made["z"], output))
    assert (bad.verdict, bad.effects) == (clean.verdict, clean.effects)
    assert bad.effects == ((effect,) if effect else ())
    assert bad.ladder[-1].rms_validation == pytest.approx(clean.ladder[-1].rms_validation, rel=0.1)
    assert any("stand out" in note for note in bad.notes)

"""Spikes and lost samples of the output change neither what is named nor the error much."""

import numpy as np
import pytest
import world
from scipy import signal

import preisach_jax as pj
from preisach_jax.diagnosis.comparison import compare
from preisach_jax.fit import begun, double_precision
from preisach_jax.record.spikes import input_spikes, isolated_spikes

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


def with_input(made, read):
    units = {"input": "V", "output": "um"}
    return pj.Record.from_arrays(made["t"], read, made["z"], units=units, name="hidden")


def misread(made, seed, count=25):
    rng = np.random.default_rng(seed)
    rows = rng.choice(np.arange(20, len(made["x"]) - 20), count, replace=False)
    read = made["x"].copy()
    read[rows] += np.ptp(read) * rng.choice([-0.4, 0.15, 0.3, 5.0], count)
    return read, rows


@pytest.mark.parametrize("effect", EFFECTS)
def test_inputs_that_were_misread_are_bridged_and_others_believed(effect):
    made = world.hidden_record(effect, 309, 6.0, 1000.0)
    assert not input_spikes(with_input(made, made["x"])).any()
    read, rows = misread(made, 3)
    found = np.flatnonzero(input_spikes(with_input(made, read)))
    assert len(set(rows) & set(found)) >= 0.95 * len(rows)
    assert len(set(found) - set(rows)) <= 2


@pytest.mark.parametrize("effect", [None, "input_lag"])
def test_misread_inputs_do_not_move_the_memory_of_a_fit_or_of_a_comparison(effect):
    made = world.hidden_record(effect, 310, 6.0, 1000.0)
    read, rows = misread(made, 4)
    effects = [effect] if effect else []
    clean = pj.fit(with_input(made, made["x"]), effects, levels=9)
    bad = pj.fit(with_input(made, read), effects, levels=9)
    assert len(set(rows) & set(bad.record.input_spikes)) >= 0.9 * len(rows)
    assert all(bad.record.input_spikes[row] == read[row] for row in bad.record.input_spikes)
    assert bad.rms_validation == pytest.approx(clean.rms_validation, rel=0.1)
    assert "inputs (0.4" in bad.summary()
    compared = compare(clean.model, with_input(made, read))
    assert compared.rms == pytest.approx(compare(clean.model, clean.record).rms, rel=0.1)
    assert any("replaced by straight lines" in note for note in compared.notes)


@pytest.mark.parametrize("slowness", [0, 1, 20])
def test_pulses_that_the_output_answers_are_no_spikes_of_the_input(slowness):
    t = np.arange(4000) / 1000
    drive = np.sin(5 * t) + 0.5 * (np.arange(4000) % 317 == 100)
    # The exact answer of a first-order stage to a staircase.
    share = np.exp(-1 / slowness) if slowness else 0.0
    output = signal.lfilter([1 - share], [1, -share], drive)
    output += 1e-3 * np.random.default_rng(6).normal(size=4000)
    assert not input_spikes(pj.Record.from_arrays(t, drive, output)).any()


def test_an_output_that_rests_does_not_answer_misread_inputs():
    steps = np.repeat([0.0, 1.0, 3.0, 2.0], 500)
    read = steps.copy()
    read[[200, 1250, 1800]] += 2.0
    record = pj.Record.from_arrays(np.arange(2000.0), read, steps)
    assert np.flatnonzero(input_spikes(record)).tolist() == [200, 1250, 1800]


def test_an_input_without_a_measured_output_is_believed():
    made = world.hidden_record(None, 311, 4.0, 500.0)
    read, output = made["x"].copy(), made["z"].copy()
    read[[300, 900]] = 2 * read.max()
    output[[300, 900]] = np.nan
    record = pj.Record.from_arrays(made["t"], read, output)
    assert not input_spikes(record).any()


def test_a_comparison_leaves_spikes_out_and_tells_it():
    made = world.hidden_record(None, 312, 4.0, 500.0)
    model = pj.fit(record_of(made, made["z"]), levels=9).model
    output = made["z"].copy()
    output[[500, 1500]] += 5.0
    clean, bad = (compare(model, record_of(made, z)) for z in (made["z"], output))
    assert bad.record.spikes == {500: output[500], 1500: output[1500]}
    assert bad.rms == pytest.approx(clean.rms, rel=0.01)
    assert "2 outputs" in bad.notes[0]
    assert not any("outputs" in note for note in clean.notes)
    assert bad.to_json()["spikes_left_out"] == 2

"""Spikes and lost samples of the output change neither what is named nor the error much."""

from dataclasses import replace

import found as made_once
import numpy as np
import pytest
from found import LEVELS, LIKELIEST, UNITS, record_of
from scipy import signal

import preisach_jax as pj
from preisach_jax.diagnosis.comparison import compare
from preisach_jax.fit.stepwise import double_precision, plain_model
from preisach_jax.record.spikes import input_spikes, isolated_spikes

T = np.arange(4000) / 1000
EFFECTS = (None, "input_lag", "creep", "hum")


def changed(record, **columns):
    new = dict(zip(("time", "input", "output"), record.to_arrays(), strict=True)) | columns
    return pj.Record.from_arrays(**new, units=UNITS)


def spiked(record, seed, height=0.2):
    rng = np.random.default_rng(seed)
    rows = rng.choice(len(record), len(record) // 100, replace=False)
    output = record.output.copy()
    output[rows] += height * np.ptp(output) * rng.normal(size=len(rows))
    return output, rows


def misread(record, seed):
    rng = np.random.default_rng(seed)
    rows = rng.choice(np.arange(20, len(record) - 20), 25, replace=False)
    read = record.input.copy()
    read[rows] += np.ptp(read) * rng.choice([-0.4, 0.15, 0.3, 5.0], 25)
    return changed(record, input=read), rows


def freed(record):
    with double_precision():
        return plain_model(record, LEVELS)[0]


@pytest.mark.parametrize(
    ("effect", "seed"),
    [*((effect, 201) for effect in EFFECTS), ("input_lag", 202), (None, 212), (None, 232)],
)
def test_spikes_and_misread_inputs_are_found_whatever_is_hidden_and_others_believed(effect, seed):
    """Also beside short pulses of a staircase (202, 212), and where the drive turns (232)."""
    record = record_of(effect, seed)
    assert freed(record) is record
    assert not input_spikes(record).any()
    read, rows = misread(record, 3 if seed == 201 else seed)
    found = np.flatnonzero(input_spikes(read))
    assert len(set(rows) & set(found)) >= 0.95 * len(rows)
    assert len(set(found) - set(rows)) <= 2


@pytest.mark.parametrize("height", [0.1, 1e5])
def test_spikes_are_found_kept_and_told(height):
    record = record_of("creep")
    output, rows = spiked(record, 1, height)
    bad = freed(changed(record, output=output))
    found = set(bad.spikes)
    high = {row for row in rows if abs(output[row] - record.output[row]) > 1.0}
    assert len(found & high) >= 0.95 * len(high)
    assert not found - set(rows)
    assert all(bad.spikes[row] == output[row] for row in found)
    assert bad.sha256 == changed(record, output=output).sha256
    assert np.isnan(bad.output[list(found)]).all()
    assert f"{len(found)} outputs" in bad._repr_html_()


def test_ringing_steps_and_frequent_outliers_are_no_spikes_and_a_higher_one_is():
    rng = np.random.default_rng(2)
    since = T % 0.2
    ringing = np.exp(-since / 0.01) * np.sin(2 * np.pi * 120 * since)
    steps = np.repeat(rng.normal(size=20), 200)
    often = np.where(rng.random(4000) < 0.1, rng.normal(size=4000), 0.0)
    higher = ringing + 20.0 * (np.arange(4000) == 1350)
    for left, rows in ((ringing, []), (steps, []), (often, []), (higher, [1350])):
        record = pj.Record.from_arrays(T, np.sin(T), left + 1e-3 * rng.normal(size=4000))
        assert np.flatnonzero(isolated_spikes(record, np.zeros(4000))).tolist() == rows


@pytest.mark.parametrize("effect", [None, "input_lag"])
def test_spikes_and_lost_samples_change_neither_verdict_nor_error(effect):
    clean, record = made_once.found(effect), record_of(effect)
    output, _ = spiked(record, 4)
    output[np.random.default_rng(5).random(len(output)) < 0.1] = np.nan
    asked = (effect, *LIKELIEST[effect]) if effect else LIKELIEST[None]
    bad = pj.diagnose(changed(record, output=output), asked, levels=LEVELS)
    assert (bad.verdict, bad.effects) == (clean.verdict, clean.effects)
    assert bad.final.rms_validation == pytest.approx(clean.final.rms_validation, rel=0.1)
    assert any("stand out" in note for note in bad.notes)


def test_misread_inputs_do_not_move_the_memory_of_a_fit_or_of_a_comparison():
    record = replace(record_of(), initial_memory="low")
    read, rows = misread(record, 4)
    read = replace(read, initial_memory="low")
    clean, bad = (pj.fit(each, levels=LEVELS) for each in (record, read))
    assert len(set(rows) & set(bad.record.input_spikes)) >= 0.9 * len(rows)
    assert all(bad.record.input_spikes[row] == read.input[row] for row in bad.record.input_spikes)
    assert bad.rms_validation == pytest.approx(clean.rms_validation, rel=0.1)
    assert "inputs (0." in bad.summary()
    compared = compare(clean.model, read)
    assert compared.rms == pytest.approx(compare(clean.model, record).rms, rel=0.1)
    assert any("replaced by straight lines" in note for note in compared.notes)


@pytest.mark.parametrize("slowness", [0, 20])
def test_pulses_that_the_output_answers_are_no_spikes_of_the_input(slowness):
    drive = np.sin(5 * T) + 0.5 * (np.arange(4000) % 317 == 100)
    # The exact answer of a first-order stage to a staircase.
    share = np.exp(-1 / slowness) if slowness else 0.0
    output = signal.lfilter([1 - share], [1, -share], drive)
    output += 1e-3 * np.random.default_rng(6).normal(size=4000)
    assert not input_spikes(pj.Record.from_arrays(T, drive, output)).any()


def test_an_output_that_rests_does_not_answer_misread_inputs_and_one_unmeasured_tells_nothing():
    steps = np.repeat([0.0, 1.0, 3.0, 2.0], 500)
    read, output = steps.copy(), steps.copy()
    read[[200, 1250, 1800]] += 2.0
    output[1250] = np.nan
    record = pj.Record.from_arrays(np.arange(2000.0), read, output)
    assert np.flatnonzero(input_spikes(record)).tolist() == [200, 1800]


def test_a_comparison_leaves_spikes_out_and_tells_it():
    model, record = made_once.found().model, record_of()
    output = record.output.copy()
    output[[500, 1500]] += 5.0
    clean, bad = (compare(model, each) for each in (record, changed(record, output=output)))
    assert bad.record.spikes == {500: output[500], 1500: output[1500]}
    assert bad.rms == pytest.approx(clean.rms, rel=0.01)
    assert "2 outputs" in bad.notes[0]
    assert not any("outputs" in note for note in clean.notes)
    assert bad.to_json()["spikes_left_out"] == 2

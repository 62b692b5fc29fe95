"""A sensor that jumps and stays off is told, levelled and named as no effect; a stage that jumps is
left as it is."""

import numpy as np
import pytest
from oracles import play
from test_faults_of_sensors import relays

import preisach_jax as pj
from preisach_jax.record.joined import by_run, joined
from preisach_jax.record.jumps import jumps, wander_rms

RATE = 1000.0
TIME = np.arange(12_000) / RATE
PATH = 5 + (2.6 + 1.8 * np.sin(1.3 * TIME)) * np.sin(2 * np.pi * TIME * (0.5 + 0.02 * TIME))
NOISE = 0.002
ROWS = (1500, 3200, 5150, 7600, 9100, 10_300)
HEIGHTS = (0.05, -0.04, -0.06, 0.05, 0.03, -0.05)


def plays(path=PATH):
    """A stage of thirty plays of growing width, up to 0.6 of the stroke."""
    return np.mean([play(path, width) for width in np.linspace(0.0, 1.5, 30)], axis=0)


PLAYS = plays()


def noisy(output, seed=0):
    return output + np.random.default_rng(seed).normal(0, NOISE, len(output))


def jumped(output, rows=ROWS, heights=HEIGHTS):
    off = np.zeros(len(output))
    for row, height in zip(rows, heights, strict=True):
        off[row:] += height
    return output + off


def record_of(output, path=PATH, **columns):
    return pj.Record.from_arrays(
        TIME, path, output, name="slips.csv", units={"output": "um"}, aux=columns
    )


def heights_of(record, modelled):
    found = jumps(record, modelled)
    return {int(row): found[row, 0] for row in np.flatnonzero(found[:, 0])}


def test_jumps_are_found_at_their_samples_with_their_heights_and_errors():
    record = record_of(jumped(noisy(PLAYS)))
    found = jumps(record, PLAYS + 0.02 * (PATH - 5) ** 2)  # a poor model
    assert np.flatnonzero(found[:, 0]).tolist() == list(ROWS)
    off = found[list(ROWS), 0] - HEIGHTS
    assert np.all(np.abs(off) < 3 * NOISE)
    assert np.all(np.abs(off) < 3 * found[list(ROWS), 1])
    levelled = record.levelled(found)
    np.testing.assert_allclose(levelled.output, noisy(PLAYS), atol=6 * NOISE)
    assert levelled.sha256 == record.sha256
    assert sorted(levelled.jumps) == list(ROWS)


def test_heights_of_single_and_joined_records_are_corrected_by_a_better_model():
    record = record_of(jumped(noisy(PLAYS)))
    coarse = np.zeros((len(TIME), 2))
    coarse[list(ROWS)] = np.stack([np.array(HEIGHTS) + 0.01, np.full(6, 0.02)], axis=1)
    first = record.levelled(coarse)
    second = first.levelled(jumps(first, PLAYS))
    for row, height in zip(ROWS, HEIGHTS, strict=True):
        assert abs(second.jumps[row].height - height) < 1.5 * NOISE
        assert second.jumps[row].error < 0.01
    assert 0 == wander_rms(record) < wander_rms(second) < wander_rms(first)
    worse = second.levelled(jumps(second, PLAYS + 0.3 * (PATH - 5)))
    assert all(worse.jumps[row].error <= jump.error for row, jump in second.jumps.items())
    unsure = np.zeros((len(TIME), 2))
    unsure[len(TIME) // 2] = [1e-9, 0.02]  # a step of unsure height: 0.01 RMS around its mean
    assert wander_rms(record.levelled(unsure)) == pytest.approx(0.01, rel=1e-3)
    both = joined([record_of(noisy(PLAYS, 1)), record])
    both = both.levelled(np.concatenate([np.zeros_like(coarse), coarse]))
    both = both.levelled(by_run(both, jumps, np.concatenate([PLAYS, PLAYS])))
    assert both.jumps == {row + len(TIME): jump for row, jump in second.jumps.items()}


def relays_beside():
    return PLAYS + 0.05 * relays(PATH, 3.0, 7.0, 1.0)


def dry_friction():
    return PLAYS + 0.05 * np.sign(np.gradient(PATH))


def stick_slip():
    """An output that rests until its spring has given way by a step, and then slips."""
    at, output = PLAYS[0], []
    for z in PLAYS:
        at = z if abs(z - at) > 0.06 else at
        output.append(at)
    return np.array(output)


@pytest.mark.parametrize("output", [relays_beside, dry_friction, stick_slip])
def test_a_stage_that_jumps_by_itself_is_left_as_it_is(output):
    smooth = np.convolve(np.pad(output(), 40, mode="edge"), np.ones(81) / 81, mode="valid")
    for modelled in (PLAYS, smooth):
        assert heights_of(record_of(noisy(output())), modelled) == {}


def test_a_stage_that_answers_steps_of_its_input_late_does_not_slip():
    path = 5 + np.round((PATH - 5) / 0.5) * 0.5 + 0.1 * np.sin(40 * TIME)
    output = np.concatenate([np.full(60, path[0]), path[:-60]])
    assert heights_of(record_of(noisy(output), path), np.full(len(TIME), 5.0)) == {}


@pytest.mark.parametrize(("late", "noise"), [(0, 0.12), (15, 0.02)], ids=str)
def test_a_load_that_is_recorded_is_no_fault_of_the_sensor(late, noise):
    load = jumped(np.zeros(len(TIME)))
    read = 10 * np.concatenate([np.full(late, load[0]), load[: len(load) - late]])
    read = read + np.random.default_rng(3).normal(0, noise, len(read))
    assert heights_of(record_of(noisy(PLAYS) + load, load=read), PLAYS) == {}


def test_jumps_while_the_input_rests_are_found():
    path = np.where(np.sin(1.1 * TIME) > 0.3, 6.0, PATH)
    path = np.convolve(np.pad(path, 100, mode="edge"), np.ones(201) / 201, "valid")
    stage = plays(path)
    still = np.convolve(np.abs(np.diff(path, prepend=path[0])), np.ones(300), "same") < 1e-9
    rows = np.flatnonzero(still)[[200, 700]].tolist()
    record = record_of(jumped(noisy(stage), rows, (0.06, -0.05)), path)
    assert list(heights_of(record, stage)) == rows


def test_noise_and_gaps_have_no_jumps():
    assert heights_of(record_of(noisy(PLAYS)), PLAYS) == {}
    gone = noisy(PLAYS + 0.1 * (TIME > 6.0))
    gone[5980:6010] = np.nan
    assert heights_of(record_of(gone), PLAYS) == {}


@pytest.mark.parametrize("drift", [0.0, 0.25])
def test_nothing_is_named_for_jumps_and_a_true_drift_beside_them_is(drift):
    drifting = noisy(PLAYS) + drift * (1 - np.exp(-TIME / 4))
    found = pj.diagnose(record_of(jumped(drifting)).part(0, 6000), ["drift"], levels=9)
    assert found.effects == (("drift",) if drift else ())
    assert len(found.base.record.jumps) == 3
    (note,) = [note for note in found.notes if "jumps" in note]
    assert "3 times" in note
    assert "at sample 5,151" in note
    if not drift:
        sound = pj.fit(record_of(noisy(PLAYS)).part(0, 6000), levels=9)
        assert found.final.rms_validation < 1.3 * sound.rms_validation

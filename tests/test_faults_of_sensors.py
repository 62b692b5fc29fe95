"""Readings that are a sensor's and not the stage's are told, left out, and name no effect."""

import numpy as np
import pytest
from found import LEVELS, LIKELIEST, record_of
from oracles import play

import preisach_jax as pj
from preisach_jax.record.faults import faults

TIME = np.arange(6000) / 1000
PATH = 5 - 5 * np.cos(2 * np.pi * TIME * (0.5 + 0.1 * TIME))
NOISY = play(PATH, 1.0) + 0.2 * PATH + np.random.default_rng(0).normal(0, 0.005, len(PATH))


def faults_of(output):
    return faults(pj.Record.from_arrays(TIME, PATH, output, name="spoiled.csv"))


def stuck(output):
    third = len(output) // 3
    held = np.where(np.arange(len(output)) // third == 1, output[third], output)
    return held, slice(third + 1, 2 * third)


def clipped(output):
    high = float(np.quantile(output, 0.9))
    return np.minimum(output, high), output >= high


def clipped_on_both_sides(output):
    low, high = np.quantile(output, [0.07, 0.95])
    return np.clip(output, low, high), (output <= low) | (output >= high)


def wrapped(output):
    turn = 0.75 * np.ptp(output)
    above = output - output.min() > turn
    return output - turn * above, above


@pytest.mark.parametrize("spoil", [stuck, clipped, clipped_on_both_sides, wrapped])
def test_exactly_the_rows_that_were_spoiled_are_found(spoil):
    spoiled, spoiled_rows = spoil(NOISY)
    expected, rows = np.zeros((2, len(PATH)), bool)
    expected[spoiled_rows] = True
    for _, start, stop in faults_of(spoiled):
        rows[start:stop] = True
    np.testing.assert_array_equal(rows, expected)
    assert {fault.kind for fault in faults_of(spoiled)} == {spoil.__name__.split("_")[0]}


def relays(path, lowest=1.0, highest=8.0, apart=2.0):
    """Twelve relays without noise: the output rests, and jumps the way that it goes."""
    states, output = np.zeros(12), []
    downs = np.linspace(lowest, highest - apart, 12)
    for u in path:
        states = np.where(u >= downs + apart, 1.0, np.where(u <= downs, 0.0, states))
        output.append(states.sum())
    return np.array(output)


@pytest.mark.parametrize(
    "output",
    [
        pytest.param(np.round(NOISY / 0.05) * 0.05, id="a coarse converter"),
        pytest.param(relays(PATH), id="relays"),
        pytest.param((relays(PATH) > 5).astype(float), id="one relay: jumps of the whole range"),
        pytest.param(
            np.maximum.accumulate(PATH * (TIME < 2)) + 0.1 * PATH, id="keeps what it has reached"
        ),
        pytest.param(np.round(50 * np.tanh((NOISY - 6) / 1.5)) / 50, id="saturates in steps"),
        pytest.param(play(PATH, 2.0), id="backlash rests where it turns"),
    ],
)
def test_what_an_actuator_does_by_itself_is_no_fault(output):
    assert faults_of(output) == ()


@pytest.mark.parametrize("spoil", [stuck, clipped, wrapped])
def test_no_effect_is_named_for_a_fault_and_the_note_tells_its_rows(spoil):
    record = record_of(seed=203)  # no jump of the input carries it past the end of the counter
    spoiled, _ = spoil(record.output)
    changed = pj.Record.from_arrays(record.time, record.input, spoiled)
    told = pj.diagnose(changed, LIKELIEST[None], levels=LEVELS)
    assert (told.verdict, told.effects) == ("adequate", ())
    (note,) = [note for note in told.notes if "were left out: samples" in note]
    assert f"in {sum(fault.stop - fault.start for fault in faults(changed)):,} samples" in note


def test_a_record_that_is_clipped_almost_throughout_is_refused_in_one_line():
    low = np.minimum(NOISY, np.quantile(NOISY, 0.2))
    record = pj.Record.from_arrays(TIME, PATH, low, name="spoiled.csv")
    with pytest.raises(pj.InputError, match=r"spoiled.csv, column output: .* clipped in all but"):
        pj.fit(record, levels=5)


def test_a_sensor_that_never_comes_free_is_seen_if_the_input_moves_by_half_its_range():
    begin = len(PATH) - 60
    while np.ptp(PATH[begin:]) < 0.6 * np.ptp(PATH):
        begin -= 1
    (fault,) = faults_of(np.where(TIME[begin] > TIME, NOISY, NOISY[begin]))
    assert (fault.kind, fault.start, fault.stop) == ("stuck", begin + 1, len(PATH))


def test_an_output_that_follows_jumps_of_the_input_has_not_wrapped():
    """First-order reversal curves: from saturation straight to a reversal, and slowly back."""
    u = np.concatenate([np.linspace(turn, 1.0, 60) for turn in np.linspace(-0.6, -1.0, 12)])
    z = np.tanh(2 * u) * np.linspace(1.0, 0.9, len(u))
    z, rows = z + np.random.default_rng(0).normal(0, 1e-3, len(u)), np.arange(len(u))
    assert faults(pj.Record.from_arrays(rows / 10.0, u, z)) == ()
    smooth = pj.Record.from_arrays(rows / 10.0, np.sin(rows / 60.0), z)
    assert {fault.kind for fault in faults(smooth)} == {"wrapped"}

"""Readings that are a sensor's and not the stage's are told, left out, and name no effect."""

import numpy as np
import pytest
import world

import preisach_jax as pj
from preisach_jax.record.faults import faults

TIME = np.arange(6000) / 1000
PATH = 5 - 5 * np.cos(2 * np.pi * TIME * (0.5 + 0.1 * TIME))


def noisy(seed=0):
    """A loop of some width, read with noise."""
    output, play = np.empty(len(PATH)), PATH[0]
    for k, u in enumerate(PATH):
        play = min(max(play, u - 1), u + 1)
        output[k] = play + 0.2 * u
    return output + np.random.default_rng(seed).normal(0, 0.005, len(PATH))


def record_of(output):
    return pj.Record.from_arrays(TIME, PATH, output, name="spoiled.csv")


def left_out(record):
    rows = np.zeros(len(record), bool)
    for _, start, stop in faults(record):
        rows[start:stop] = True
    return rows


def kinds(record):
    return {fault.kind for fault in faults(record)}


def stuck(output):
    spoiled = output.copy()
    spoiled[2100:2400] = spoiled[2099]
    return spoiled, np.isin(np.arange(len(output)), np.arange(2100, 2400))


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
    spoiled, rows = spoil(noisy())
    record = record_of(spoiled)
    np.testing.assert_array_equal(left_out(record), rows)
    assert kinds(record) == {spoil.__name__.split("_")[0]}


def relays():
    """Twelve relays without noise: the output rests, and jumps the way that it goes."""
    states, output = np.zeros(12), []
    ups, downs = np.linspace(3, 8, 12), np.linspace(1, 6, 12)
    for u in PATH:
        states = np.where(u >= ups, 1.0, np.where(u <= downs, 0.0, states))
        output.append(states.sum())
    return np.array(output)


@pytest.mark.parametrize(
    "output",
    [
        noisy(),
        np.round(noisy() / 0.05) * 0.05,  # a coarse converter
        relays(),
        (relays() > 5).astype(float),  # one relay: jumps of the whole range
        np.maximum.accumulate(PATH * (TIME < 2)) + 0.1 * PATH,  # keeps what it has reached
        np.tanh((noisy() - 6) / 2),  # saturates
        np.round(50 * np.tanh((noisy() - 6) / 1.5)) / 50,  # and is read in steps
    ],
    ids=[
        "noise",
        "converter",
        "relays",
        "one relay",
        "maximum",
        "saturation",
        "saturation in steps",
    ],
)
def test_what_an_actuator_does_by_itself_is_no_fault(output):
    assert faults(record_of(output)) == ()


def backlash_without_noise():
    output, play = np.empty(len(PATH)), PATH[0]
    for k, u in enumerate(PATH):
        output[k] = play = min(max(play, u - 2), u + 2)
    return output


def test_backlash_rests_where_it_turns():
    record = record_of(backlash_without_noise())
    assert np.mean(np.diff(record.output) == 0) > 0.1
    assert faults(record) == ()


@pytest.mark.parametrize("spoil", [stuck, clipped, wrapped])
def test_no_effect_is_named_for_a_fault_and_the_note_tells_its_rows(spoil):
    made = world.hidden_record(None, 41, 12.0, 1000.0)
    record = pj.Record.from_arrays(made["t"], made["x"], made["z"])
    names = ["creep", "output_nonlinearity", "drift", "output_lag"]
    sound = pj.diagnose(record, names, levels=13)
    spoiled, rows = spoil(record.output)
    changed = pj.Record.from_arrays(record.time, record.input, spoiled)
    found = pj.diagnose(changed, names, levels=13)
    assert (found.verdict, found.effects) == (sound.verdict, sound.effects) == ("adequate", ())
    (note,) = [note for note in found.notes if "were left out: samples" in note]
    assert f"in {rows.sum():,} samples" in note


def test_a_record_that_is_clipped_almost_throughout_is_refused_in_one_line():
    record = record_of(np.minimum(noisy(), np.quantile(noisy(), 0.2)))
    with pytest.raises(pj.InputError, match=r"spoiled.csv, column output: .* clipped in all but"):
        pj.fit(record, levels=5)


def test_a_sensor_that_is_stuck_for_a_third_of_the_record_is_seen():
    output = noisy()
    third = len(output) // 3
    output[third : 2 * third] = output[third]
    (fault,) = faults(record_of(output))
    assert fault.kind == "stuck"
    assert (fault.start, fault.stop) == (third + 1, 2 * third)


def test_a_sensor_that_never_comes_free_is_seen_if_the_input_moves_by_half_its_range():
    output = noisy()
    begin = len(output) - 60
    while np.ptp(PATH[begin:]) < 0.6 * np.ptp(PATH):
        begin -= 1
    output[begin:] = output[begin]
    (fault,) = faults(record_of(output))
    assert (fault.kind, fault.start, fault.stop) == ("stuck", begin + 1, len(output))


def test_an_output_that_follows_jumps_of_the_input_has_not_wrapped():
    """First-order reversal curves: from saturation straight to a reversal, and slowly back."""
    turns = np.linspace(-0.6, -1.0, 12)
    u = np.concatenate([np.linspace(turn, 1.0, 60) for turn in turns])
    z = np.tanh(2 * u) * np.linspace(1.0, 0.9, len(u))
    z += np.random.default_rng(0).normal(0, 1e-3, len(u))
    assert faults(pj.Record.from_arrays(np.arange(len(u)) / 10.0, u, z)) == ()
    smooth = np.sin(np.arange(len(u)) / 60.0)
    assert kinds(pj.Record.from_arrays(np.arange(len(u)) / 10.0, smooth, z)) == {"wrapped"}

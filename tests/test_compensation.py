"""A drive that was found for a course gives it back, through every effect and in all limits."""

import re
from dataclasses import replace

import jax
import numpy as np
import pytest
from drivable import (
    EFFECTS,
    GOOD,
    PLANE,
    RATE,
    UNITS,
    course,
    model_of,
    played,
    reading_of,
    resting_output,
)
from oracles import slow_ramps
from scipy import signal

import preisach_jax as pj
from preisach_jax.compensation.drive import tracking
from preisach_jax.effects.auxiliary import Auxiliary
from preisach_jax.effects.input_quantisation import InputQuantisation
from preisach_jax.effects.output_quantisation import OutputQuantisation
from preisach_jax.effects.resonance import Resonance
from preisach_jax.quantity import quantity

REACHED = 1.96 * GOOD
TOGETHER = ("creep", "input_lag", "drift", "resonance", "output_nonlinearity")


@pytest.mark.parametrize(("sign", "memory"), [(1, 0.4), (-1, 0.0)])
def test_the_operator_is_inverted_to_rounding_along_any_course(sign, memory):
    model = model_of(sign=sign, memory=memory)
    rng = np.random.default_rng(5)
    t = np.arange(1000) / RATE
    low, high = sorted((1.5, 1.5 + 20 * sign))
    z = rng.uniform(low, high, len(t))  # a turning point in every row
    z[100:150] = z[100]
    found = pj.compensate(model, pj.Record.from_arrays(t, 0 * t, z))
    assert found.reachable.all()
    (note,) = found.notes
    assert "the drive jumps there in its first row" in note
    np.testing.assert_allclose(found.expected, z, atol=1e-11)
    assert np.ptp(found.drive[100:150]) < 1e-12
    if memory == 0.0:
        whole = np.concatenate([model.origin.history[1], found.drive[:30]])
        given = (slow_ramps(PLANE, whole) @ model.weights)[-30:]
        np.testing.assert_allclose(1.5 + given, z[:30], atol=1e-10)


def test_relays_come_as_near_as_their_steps_are():
    model = model_of(hysteron="relay")
    wanted = course(model, begin=1.5)
    found = pj.compensate(model, wanted)
    missed = np.abs(found.expected - wanted.output)
    rows = np.bincount(PLANE.alpha_index, model.weights)
    assert missed.max() < rows.max()
    assert np.median(missed) < rows.max() / 4


PAIRS = ["hum ageing_by_path drift_by_path", "operator_creep reptation"]
ALONE = [name for name in EFFECTS if name not in (*TOGETHER, *" ".join(PAIRS).split())]


@pytest.mark.parametrize("names", [*ALONE, *PAIRS])
def test_a_course_comes_back_through_every_effect(names):
    model = model_of(*(EFFECTS[name] for name in names.split()))
    wanted = course(model)
    found = pj.compensate(model, wanted)
    error = np.abs(found.expected - wanted.output)
    assert found.reachable.all(), found.notes
    assert error.max() < REACHED
    assert np.sqrt(np.mean(error**2)) < GOOD / 4
    # Without the effect in the inverse the same course is missed.
    if names != "slew_limit":  # which does nothing to a drive as slow as this one
        plain = pj.compensate(model_of(), wanted).drive
        assert np.abs(reading_of(model, plain) - wanted.output).max() > 5 * GOOD


def test_several_effects_are_inverted_together_beside_an_auxiliary_column():
    load = (Auxiliary(column="load_N", unit="N"), {"tau_s": 0.01}, (0.2,))
    record = played(load_N=2.0)
    model = model_of(*(EFFECTS[name] for name in TOGETHER), load, record=record)
    smooth = course(model, load_N=2.0)
    moves = 2 + np.sin(8 * smooth.time)
    wanted = replace(smooth, aux={"load_N": moves})
    found = pj.compensate(model, wanted)
    assert found.reachable.mean() > 0.99
    error = (found.expected - wanted.output)[found.reachable]
    assert np.sqrt(np.mean(error**2)) < GOOD / 3


def test_limits_and_slew_are_kept_and_rows_that_they_cost_are_told():
    model = model_of()
    wanted = course(model, height=6.0)
    found = pj.compensate(model, wanted, limits=(3.0, 7.0), slew=60.0)
    assert found.drive.min() >= 3.0
    assert found.drive.max() <= 7.0
    before = np.concatenate([[model.origin.history[1, -1]], found.drive[:-1]])
    assert np.abs(found.drive - before).max() <= 60.0 / RATE * (1 + 1e-9)
    off = np.abs(found.expected - wanted.output) > REACHED
    assert 0 < off.sum() < len(off)
    np.testing.assert_array_equal(~found.reachable, off)
    assert f"{off.sum():,} of {len(off):,} rows" in found.notes[0]


def test_a_course_beyond_the_stroke_is_told_with_the_range_that_can_be_reached():
    model = model_of()
    wanted = course(model, height=18.0)
    found = pj.compensate(model, wanted)
    above = wanted.output > 24.0
    assert above.any()
    assert not found.reachable[above].any()
    assert (found.drive[above] == 10.0).all()
    error = (found.expected - wanted.output)[found.reachable]
    assert np.abs(error).max() <= GOOD
    told, span = found.notes
    assert "cannot be reached" in told
    # Saturated either way, all hysterons are off or on.
    ends = sorted([model.offset, model.offset + model.weights.sum()])
    texts = [quantity(end, UNITS["output"]) for end in ends]
    assert f"a drive from 0 to 10 V moves the output from {texts[0]} to {texts[1]}" in span
    assert f"to {quantity(wanted.output.max(), UNITS['output'])}" in span.partition("asks for")[2]


RANGE, FAST = "keep it within that range", "faster than"
ADVICE = {"raise it", "widen the limits", RANGE, FAST, "begin the course where the stage is"}


def burst(t):
    return 6 * np.sin(2 * np.pi * 60 * t) * np.exp(-(((t - 0.6) / 0.08) ** 2))


@pytest.mark.parametrize(
    ("effects", "height", "moved", "options", "advice"),
    [
        ((), 6.0, np.zeros_like, {"slew": 5.0}, {"raise it"}),
        (("slew_limit",), 5.0, burst, {}, set()),
        ((), 6.0, np.zeros_like, {"limits": (3.0, 7.0)}, {RANGE, "widen the limits"}),
        (("resonance",), 5.0, lambda t: 4.0 * (t > 0.5), {}, {FAST}),
        ((), 5.0, lambda t: 3.0, {"slew": 500.0}, {"begin the course where the stage is"}),
    ],
)
def test_advice_fits_the_cause(effects, height, moved, options, advice):
    model = model_of(*(EFFECTS[name] for name in effects))
    plain = course(model, height=height)
    wanted = replace(plain, output=plain.output + moved(plain.time))
    found = pj.compensate(model, wanted, **options)
    assert not found.reachable.all()
    assert {words for words in ADVICE if any(words in note for note in found.notes)} == advice
    # Each row has one cause.
    told = [
        int(n.replace(",", "")) for n in re.findall(r"\(([\d,]+) rows?\)", str(found.notes[1:]))
    ]
    assert sum(told) == (~found.reachable).sum()


def test_from_elsewhere_a_drive_comes_to_its_course_without_ringing():
    f_hz, away, zeta = 20.0, -6.0, 0.03
    omega = 2 * np.pi * f_hz
    model = model_of((Resonance(), {"f_hz": f_hz, "zeta": zeta}, ()))
    wanted = course(model)
    moved = replace(wanted, output=wanted.output + away)
    found = pj.compensate(model, moved)
    told = next(note for note in found.notes if "begins" in note)
    assert f"the course begins {abs(away):g} µm ({5 * abs(away):g} % of the stroke) away" in told
    assert not found.reachable[0]
    # A third of a period and a few samples are enough, where the limits leave room.
    behind = round(0.6 * RATE / f_hz) + 10
    assert found.reachable[behind:].mean() > 0.99
    # The mode in SciPy, driven by the operator that follows the drive: no ring is left.
    whole = np.concatenate([played().input, found.drive])
    with jax.enable_x64(True):
        force = np.asarray(pj.simulate(PLANE, model.weights, whole, hysteron="ramp"))
    time = np.arange(len(whole)) / RATE
    system = signal.lti([omega**2], [1, 2 * zeta * omega, omega**2])
    output = 1.5 + signal.lsim(system, force, time)[1][-len(moved.output) :]
    missed = (output - moved.output)[behind:]
    assert np.abs(missed).max() < 4 * REACHED
    assert np.sqrt(np.mean(missed**2)) < REACHED


def test_the_memory_is_that_of_what_was_played_before():
    model = model_of()
    wanted = course(model, begin=13.0)
    t = np.arange(2000) / RATE
    other = pj.Record.from_arrays(t, np.where(t < 1.0, 10 * t, 10 - 4 * (t - 1.0)), 0 * t)
    by_default, after_other = (pj.compensate(model, wanted, after=a) for a in (None, other))
    assert np.abs(by_default.drive - after_other.drive)[:200].max() > 0.05
    for found, past in ((by_default, played()), (after_other, other)):
        drive = np.concatenate([past.input, found.drive])
        with jax.enable_x64(True):
            given = pj.simulate(PLANE, model.weights, drive, hysteron="ramp")
        # The other record has been to the upper end, so that nothing of its start is left.
        expected = 1.5 + np.asarray(given)[-len(found.drive) :]
        np.testing.assert_allclose(expected, wanted.output, atol=1e-9)


def test_the_clock_of_the_course_goes_on_where_it_can():
    model = model_of(EFFECTS["drift"], EFFECTS["hum"])
    wanted = course(model)
    shifted = replace(wanted, time=wanted.time + model.origin.stop_s + 1 / RATE)
    here, there = pj.compensate(model, wanted), pj.compensate(model, shifted)
    np.testing.assert_allclose(here.drive, there.drive, atol=1e-6)
    late = replace(wanted, time=wanted.time + 10.0)
    assert np.abs(pj.compensate(model, late).drive - here.drive).max() > 0.01
    prediction = model.predict(
        pj.Record.from_arrays(shifted.time, there.drive, there.drive, units=UNITS)
    )
    np.testing.assert_allclose(there.expected, prediction.output, atol=1e-9)
    np.testing.assert_allclose(there.low, prediction.low, atol=1e-9)


def test_a_course_at_another_rate_is_followed_and_told():
    model = model_of(EFFECTS["creep"])
    t = np.arange(1000) * 4.0 / RATE
    rest = resting_output(model)[0]
    wanted = pj.Record.from_arrays(t, 0 * t, rest + 3 * (1 - np.cos(2 * np.pi * t / t[-1])))
    found = pj.compensate(model, wanted)
    assert found.reachable.mean() > 0.98
    assert any("4 times" in note for note in found.notes)


def test_steps_of_converters_are_left_out_by_name_and_figure():
    quantised = (
        (InputQuantisation(), {"step": 0.05}, ()),
        (OutputQuantisation(0.02), {"step": 0.02}, ()),
    )
    model = model_of(*quantised)
    found = pj.compensate(model, course(model))
    assert found.reachable.all()
    (note,) = found.notes
    assert "input_quantisation and output_quantisation" in note
    assert "RMS error of" in note
    on_lattice = found.expected / 0.02
    np.testing.assert_allclose(on_lattice, np.round(on_lattice), atol=1e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"z": np.nan}, "wanted output is missing in row 8"),
        ({"t": 1.0}, "gap of 1.001 s behind row 7"),
        ({"unit": "mm"}, "its unit is mm, and the model was identified in µm"),
        ({"limits": (3.0, 2.0)}, "the lower one first"),
        ({"limits": (11.0, 12.0)}, "outside the range 0 to 10 V"),
        ({"slew": 0.0}, "slew is 0"),
    ],
)
def test_bad_courses_are_refused_in_one_line(change, message):
    model = model_of()
    t, u, z = np.arange(100) / RATE, np.zeros(100), np.full(100, 5.0)
    z[7:] = change.get("z", 5.0)
    t[7:] += change.get("t", 0.0)
    wanted = pj.Record.from_arrays(t, u, z, units=UNITS | {"output": change.get("unit", "um")})
    options = {name: value for name, value in change.items() if name in ("limits", "slew")}
    with pytest.raises(pj.InputError, match=message) as refusal:
        pj.compensate(model, wanted, **options)
    assert "\n" not in str(refusal.value)


def test_the_straight_line_beside_a_drive_is_the_best_one_played_through_the_model():
    model = model_of()
    wanted = course(model)
    found = pj.compensate(model, wanted)
    errors = tracking(model, wanted, found)
    slope, level = np.polyfit(found.wanted, found.drive, 1)
    line = np.clip(level + slope * found.wanted, model.plane.low, model.plane.high)
    missed = reading_of(model, line) - found.wanted
    own = model.rms_validation
    assert errors.straight == pytest.approx(np.hypot(np.sqrt(np.mean(missed**2)), own), rel=1e-6)
    assert errors.compensated == pytest.approx(own, rel=1e-3)
    assert errors.straight > 2 * errors.compensated


def test_work_on_a_drive_ends_when_its_progress_raises():
    def stop(text, done):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        pj.compensate(model_of(), course(model_of()), progress=stop)

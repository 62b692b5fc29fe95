"""The simulated stage obeys Preisach's laws, and each effect is what its truth says."""

import json
import subprocess
import sys
from itertools import combinations, pairwise
from typing import Any

import numpy as np
import pytest
from scipy import optimize, signal

from preisach_jax.errors import InputError
from preisach_jax.plant import EFFECTS, RANGE_V, Stage, make_stage, simulate_stage
from preisach_jax.plant import stage as stage_module
from preisach_jax.plant.effects import limit_rate, low_pass, resonate
from preisach_jax.signals import diagnostic_record

SHORT: dict[str, Any] = {"seconds": 6.0, "rate_hz": 1000.0}
QUIET: dict[str, Any] = {"noise_um": 0.0, "encoder_step_um": 0.0}
CLEAN = {**SHORT, **QUIET}


def path(*levels, points=200):
    """A path through levels, each ramp in `points` steps."""
    ramps = [np.linspace(a, b, points + 1)[1:] for a, b in pairwise(levels)]
    return np.concatenate([[levels[0]], *ramps])


def hidden(effect, seed=2, **changes):
    """Record with one effect, without noise; the parameters; and the record without the effect."""
    settings = {**CLEAN, **changes}
    rec = simulate_stage(seed, effects=(effect,), **settings)
    assert list(rec.truth["parameters"]) == rec.truth["effects"] == [effect]
    return rec, rec.truth["parameters"][effect], simulate_stage(seed, **settings)


def first_order(x, tau, t, gain=1.0):
    """Oracle of a first-order lag, settled at x[0]."""
    system = ([[-1 / tau]], [[1 / tau]], [[gain]], [[0.0]])
    return signal.lsim(system, x, t, X0=[x[0]])[1].ravel()


def finely(rec, parts=20):
    """Instants, drive and a selection of the record's: straight between the samples."""
    t = np.linspace(0.0, rec.time[-1], parts * (rec.time.size - 1) + 1)
    return t, np.interp(t, rec.time, rec.input), slice(None, None, parts)


def slow_plays(stage, u, widening):
    """Oracle of the hysteresis: all plays instant by instant."""
    v = np.minimum(RANGE_V - stage.slack_up, stage.slack_down)
    outputs = [v]
    for value, wider in zip(u, widening, strict=True):
        v = np.maximum(v, value - stage.slack_up - wider)
        v = np.minimum(v, value + stage.slack_down + wider)
        outputs.append(v)
    g = stage.softness * np.log1p(np.exp((np.array(outputs) - stage.dead_zone) / stage.softness))
    h = g @ stage.weights
    return h[1:] - h[0]


@pytest.fixture(scope="module", params=[0, 4])
def stage(request):
    return make_stage(request.param)


def test_plays_against_a_loop(stage):
    """Oracle: each play sample by sample, from the same loop before the record."""
    rng = np.random.default_rng(0)
    u = np.repeat(rng.uniform(0.0, RANGE_V, 300), 2)
    v = np.zeros_like(stage.slack_up)
    outputs = []
    for value in [RANGE_V, 0.0, *u]:
        v = np.clip(v, value - stage.slack_up, value + stage.slack_down)
        g = stage.softness * np.log1p(np.exp((v - stage.dead_zone) / stage.softness))
        outputs.append(float(stage.weights @ g))
    np.testing.assert_allclose(stage.hysteresis(u), np.array(outputs[2:]) - outputs[1], atol=1e-9)


def test_long_ramps_are_cut_without_a_trace(stage, monkeypatch):
    u = path(0.0, 70.0, 30.0, 60.0, points=500)
    whole = stage.hysteresis(u)
    monkeypatch.setattr(stage_module, "CHUNK", 37)
    np.testing.assert_allclose(stage.hysteresis(u), whole, rtol=0, atol=1e-12)


def test_wiping_out(stage):
    plain = stage.hysteresis(path(0.0, 60.0, 20.0, 70.0, 35.0))[-200:]
    nested = stage.hysteresis(path(0.0, 60.0, 20.0, 50.0, 30.0, 45.0, 38.0, 70.0, 35.0))[-200:]
    np.testing.assert_allclose(nested, plain, rtol=0, atol=1e-9)
    assert abs(stage.hysteresis(path(0.0, 35.0))[-1] - plain[-1]) > 0.5


def test_congruency(stage):
    first = stage.hysteresis(path(0.0, 75.0, 25.0, 50.0, 25.0))[-401:]
    second = stage.hysteresis(path(0.0, 52.0, 5.0, 51.0, 25.0, 50.0, 25.0))[-401:]
    np.testing.assert_allclose(first - first[0], second - second[0], rtol=0, atol=1e-9)
    assert abs(first[0] - second[0]) > 0.05


def test_refining_the_path_changes_nothing(stage):
    turns = np.random.default_rng(1).uniform(0.0, RANGE_V, 80)
    coarse = stage.hysteresis(path(0.0, *turns, points=1))
    fine = stage.hysteresis(np.repeat(path(0.0, *turns, points=37), 3))
    np.testing.assert_allclose(fine[:: 37 * 3], coarse, rtol=0, atol=1e-9)


def test_loops_are_like_a_piezos():
    for seed in range(12):
        up, down = np.split(make_stage(seed).hysteresis(path(0.0, RANGE_V, 0.0, points=250)[1:]), 2)
        up, down = np.concatenate([[0.0], up[:-1]]), np.concatenate([[up[-1]], down])[::-1][:-1]
        assert np.all(np.diff(up) > 0)
        assert np.all(np.diff(down) > 0)
        assert np.all(down >= up - 1e-9)
        assert 40.0 <= make_stage(seed).hysteresis(np.array([RANGE_V]))[0] <= 90.0
        assert 0.09 < np.max(down - up) / up[-1] < 0.19
        # The dead zone bends the rising branch upward.
        assert up[125] < 0.5 * up[-1]


def test_a_play_alone_is_a_parallelogram():
    """Closed form far above the dead zone, where g(v) = v - d: slack 5 V upward, 3 V downward."""
    play = Stage(np.array([5.0]), np.array([3.0]), np.array([2.0]), -500.0, 1.0)
    z = play.hysteresis(np.array([0.0, 8.0, 20.0, 12.0, 10.0, 16.0]))
    # At rest v = 3; rising v = u - 5; falling v = u + 3.
    np.testing.assert_allclose(z, 2.0 * (np.array([3, 3, 15, 15, 13, 13]) - 3.0), atol=1e-9)


ALL_BUT_SPRINGS = tuple(name for name in EFFECTS if name != "restoring_force")


@pytest.mark.parametrize("effects", [(), ("creep",), ALL_BUT_SPRINGS])
def test_a_seed_means_one_record(effects):
    first, again, other = (simulate_stage(s, effects=effects, **SHORT) for s in (5, 5, 6))
    np.testing.assert_array_equal(first.output, again.output)
    np.testing.assert_array_equal(first.input, again.input)
    assert first.truth == again.truth
    assert np.std(first.output - other.output) > 0.1
    assert json.loads(json.dumps(first.truth)) == first.truth
    assert first.truth["effects"] == list(effects)


def test_a_seed_means_the_same_stage_with_and_without_an_effect():
    alone, both = (simulate_stage(3, effects=e, **SHORT) for e in (("delay",), ("delay", "drift")))
    assert alone.truth["parameters"]["delay"] == both.truth["parameters"]["delay"]
    assert alone.truth["stroke_um"] == both.truth["stroke_um"]


def test_noise_and_encoder():
    clean, rec = simulate_stage(1, **CLEAN), simulate_stage(1, **SHORT)
    error = rec.output - clean.output
    assert np.std(error) == pytest.approx(np.hypot(0.006, 1.22e-3 / np.sqrt(12)), rel=0.05)
    np.testing.assert_allclose(rec.output / 1.22e-3, np.round(rec.output / 1.22e-3), atol=1e-6)
    assert not np.any(np.signbit(rec.output) & (rec.output == 0.0))


def test_without_effects_it_is_the_hysteresis_of_its_input():
    rec = simulate_stage(1, **CLEAN)
    np.testing.assert_allclose(rec.output, make_stage(1).hysteresis(rec.input), rtol=0, atol=1e-9)
    np.testing.assert_allclose(rec.time, np.arange(6000) / 1000.0)
    assert rec.aux == {}
    assert rec.truth["effects"] == []


def test_low_pass_against_lsim_and_second_order():
    t = np.arange(4000) * 1e-3
    x = 3.0 + np.sin(9.0 * t) + 0.3 * np.sin(70.0 * t + 1.0)
    np.testing.assert_allclose(low_pass(x, 0.05, 1e-3), first_order(x, 0.05, t), rtol=0, atol=2e-4)
    errors = []
    for step in (4e-3, 2e-3, 1e-3):
        t = np.arange(0.0, 2.0, step)
        exact = (np.sin(9 * t) / 0.2 - 9 * np.cos(9 * t) + 9 * np.exp(-t / 0.2)) / (
            0.2 * (1 / 0.04 + 81)
        )
        errors.append(np.max(np.abs(low_pass(np.sin(9 * t), 0.2, step) - exact)))
    order = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(order, 2.0, atol=0.1)


def test_creep_is_the_sum_of_its_elements():
    rec, truth, bare = hidden("creep")
    pairs = zip(truth["tau_s"], truth["gains"], strict=True)
    expected = sum(first_order(bare.output, tau, rec.time, gain) for tau, gain in pairs)
    np.testing.assert_allclose(rec.output - bare.output, expected, rtol=0, atol=2e-3)
    assert sum(truth["gains"]) == pytest.approx(3.0 * truth["gain_per_decade"])


def test_creep_after_a_step_grows_with_the_logarithm_of_time():
    drive = np.where(np.arange(12_000) < 100, 0.0, 60.0)
    rec, truth, bare = hidden("creep", drive=drive)
    since = rec.time[110:] - rec.time[100]
    part = (rec.output - bare.output)[110:] / bare.output[-1]
    times = np.array([0.03, 0.1, 0.3, 1.0, 3.0])
    grown = np.interp(times, since, part)
    slope = np.polyfit(np.log10(times), grown, 1)[0]
    assert slope == pytest.approx(truth["gain_per_decade"], rel=0.25)
    assert np.all(np.diff(grown) > 0)


def test_input_lag_is_that_of_the_drive():
    rec, truth, _ = hidden("input_lag")
    t, drive, rows = finely(rec)
    lagged = np.clip(first_order(drive, truth["tau_s"], t), 0.0, RANGE_V)
    expected = make_stage(2).hysteresis(lagged)[rows]
    np.testing.assert_allclose(rec.output, expected, rtol=0, atol=0.01)
    assert 1e-3 <= truth["tau_s"] <= 5e-3


def test_delay_is_that_of_the_reading():
    rec, truth, _ = hidden("delay")
    t, drive, _ = finely(rec, 50)
    expected = np.interp(rec.time - truth["delay_s"], t, make_stage(2).hysteresis(drive))
    np.testing.assert_allclose(rec.output, expected, rtol=0, atol=5e-3)
    assert 1e-3 <= truth["delay_s"] <= 4e-3


def test_drift_is_an_exponential_in_time_alone():
    rec, truth, bare = hidden("drift")
    slow = rec.output - bare.output

    def shape(t, amplitude, tau):
        return amplitude * (1 - np.exp(-t / tau)) / (1 - np.exp(-t[-1] / tau))

    found, _ = optimize.curve_fit(shape, rec.time, slow, p0=(slow[-1], 2.0))
    np.testing.assert_allclose(found, [truth["amplitude_um"], truth["tau_s"]], rtol=1e-6)
    assert 0.01 <= abs(truth["amplitude_um"]) / rec.truth["stroke_um"] <= 0.02


def test_ageing_shrinks_everything():
    rec, truth, bare = hidden("ageing")
    moved = bare.output > 0.1
    ratio = rec.output[moved] / bare.output[moved]
    assert np.all(np.diff(ratio) < 0)
    assert ratio[-1] == pytest.approx(1.0 - truth["loss"], abs=1e-3)
    assert ratio[0] == pytest.approx(1.0, abs=3e-3)


def test_load_acts_through_its_column():
    rec, truth, bare = hidden("aux:load_N")
    load = rec.aux["load_N"]
    moved = truth["gain_um_per_N"] * (load - load[0])
    np.testing.assert_allclose(rec.output - bare.output, moved, rtol=0, atol=1e-9)
    assert np.ptp(load) > 5.0
    short = simulate_stage(2, effects=("aux",), **CLEAN)
    np.testing.assert_array_equal(short.output, rec.output)


def test_output_lag_is_that_of_the_reading():
    rec, truth, _ = hidden("output_lag")
    t, drive, rows = finely(rec)
    expected = first_order(make_stage(2).hysteresis(drive), truth["tau_s"], t)[rows]
    np.testing.assert_allclose(rec.output, expected, rtol=0, atol=5e-3)
    assert 1e-3 <= truth["tau_s"] <= 5e-3


def test_slew_limit_on_ramps():
    """Closed form: two ramps that are too fast, with time to arrive, and one that is not."""
    t = np.arange(1200) / 1000.0
    drive = np.interp(t, [0.1, 0.2, 0.6, 0.7, 1.0, 1.2], [5.0, 65.0, 65.0, 15.0, 15.0, 30.0])
    rec, truth, _ = hidden("slew_limit", drive=drive)
    slew = truth["slew_V_per_s"]
    assert 0.3 * 600.0 <= slew <= 0.8 * 600.0
    late = np.interp(t, [0.1, 0.1 + 60 / slew, 0.6, 0.6 + 50 / slew], [5.0, 65.0, 65.0, 15.0])
    reached = np.where(t < 1.0, late, drive)
    expected = make_stage(2).hysteresis(reached)
    np.testing.assert_allclose(rec.output, expected, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(rec.input, drive)


def test_wider_plays_against_a_loop(stage):
    """Slacks that grow and shrink at random, and while the drive rests."""
    rng = np.random.default_rng(3)
    u = np.repeat(rng.uniform(0.0, RANGE_V, 200), 4)
    widening = rng.uniform(0.0, 6.0, u.size) * np.repeat(rng.integers(0, 2, 400), 2)
    expected = slow_plays(stage, u, widening)
    np.testing.assert_allclose(stage.hysteresis(u, widening), expected, rtol=0, atol=1e-9)
    assert np.std(expected - stage.hysteresis(u)) > 0.5


def test_rate_dependence_against_a_loop():
    drive = diagnostic_record(6.0, 1000.0, 0.0, RANGE_V)[1500:3500]
    rec, truth, bare = hidden("rate_dependence", drive=drive)
    _, u, rows = finely(rec, 10)
    rate = np.repeat(np.abs(np.diff(drive)) * 1000.0, 10)
    shift = truth["coefficient"] * np.concatenate([[0.0], rate]) ** truth["exponent"]
    expected = slow_plays(make_stage(2), u, shift)[rows]
    np.testing.assert_allclose(rec.output, expected, rtol=0, atol=1e-6)
    assert np.std(rec.output - bare.output) > 0.05
    assert 0.005 * RANGE_V <= np.max(shift) <= 0.03 * RANGE_V
    assert 0.5 <= truth["exponent"] <= 1.2


def test_rate_widens_the_loop_as_its_power():
    """A play alone, far above the dead zone: the branches stand 2 (slack + shift) apart."""
    play = Stage(np.array([4.0]), np.array([4.0]), np.array([1.0]), -500.0, 1.0)
    up = np.linspace(0.0, 60.0, 61)
    for rate in (10.0, 1000.0):
        shift = 0.02 * rate**0.7
        z = play.hysteresis(np.concatenate([up, up[-2::-1]]), np.full(121, shift))
        # At rest v = 4, and the slowest history had no shift.
        assert z[30] - z[90] == pytest.approx(30 - 4 - shift - (30 + 4 + shift))


def test_moving_against_a_root_at_each_sample(stage):
    u = np.random.default_rng(5).uniform(0.0, RANGE_V, 150)
    a = 0.12
    v = np.minimum(RANGE_V - stage.slack_up, stage.slack_down)
    rest = stage.weights @ stage.generate(v)

    def plays(value, h):
        return np.clip(v, value + a * h - stage.slack_up, value + a * h + stage.slack_down)

    def missing(h, value):
        return float(stage.weights @ stage.generate(plays(value, h))) - rest - h

    expected = []
    for value in u:
        h = optimize.brentq(missing, -50.0, 200.0, args=(value,), xtol=1e-12)
        v = plays(value, h)
        expected.append(h)
    np.testing.assert_allclose(stage.moving_hysteresis(u, a), expected, rtol=0, atol=1e-6)


def test_moving_drives_the_stage_by_its_own_output():
    rec, truth, bare = hidden("moving")
    inside = rec.input + truth["a_V_per_um"] * rec.output
    np.testing.assert_allclose(make_stage(2).hysteresis(inside), rec.output, rtol=0, atol=1e-6)
    assert 0.10 <= truth["a_V_per_um"] * bare.truth["stroke_um"] / RANGE_V <= 0.30
    once = simulate_stage(2, effects=("moving",), drive=np.array([0.0, RANGE_V, 10.0]), **QUIET)
    assert once.output[1] == pytest.approx(rec.truth["stroke_um"], abs=1e-6)
    assert np.std(rec.output - bare.output) > 0.1


def test_moving_ends_congruency(stage):
    """The loops of `test_congruency`, where they agree within 1e-9."""
    first = stage.moving_hysteresis(path(0.0, 75.0, 25.0, 50.0, 25.0), 0.1)[-401:]
    second = stage.moving_hysteresis(path(0.0, 52.0, 5.0, 51.0, 25.0, 50.0, 25.0), 0.1)[-401:]
    assert np.max(np.abs((first - first[0]) - (second - second[0]))) > 1e-3


def test_feedback_that_runs_away_is_refused(stage):
    with pytest.raises(ValueError, match="where it is stable"):
        stage.moving_hysteresis(np.array([0.0, 1.0]), 5.0)


@pytest.mark.parametrize(("f", "zeta"), [(60.0, 0.02), (300.0, 0.2)])
def test_resonance_on_a_ramp(f, zeta):
    """Closed form of the response to x = t, which the exact discretisation has to meet."""
    t = np.arange(3000) * 1e-4
    omega, ringing = 2 * np.pi * f, 2 * np.pi * f * np.sqrt(1 - zeta**2)
    transient = 2 * zeta / omega * np.cos(ringing * t)
    transient += (2 * zeta**2 - 1) / ringing * np.sin(ringing * t)
    expected = t - 2 * zeta / omega + np.exp(-zeta * omega * t) * transient
    np.testing.assert_allclose(7.0 + expected, resonate(7.0 + t, f, zeta, 1e-4), rtol=0, atol=1e-11)


def test_resonance_is_that_of_the_position():
    rec, truth, _ = hidden("resonance")
    t, drive, rows = finely(rec)
    h = make_stage(2).hysteresis(drive)
    omega, zeta = 2 * np.pi * truth["f_hz"], truth["zeta"]
    system = ([[0, 1], [-(omega**2), -2 * zeta * omega]], [[0], [omega**2]], [[1, 0]], [[0]])
    expected = signal.lsim(system, h, t, X0=[h[0], 0.0])[1].ravel()[rows]
    np.testing.assert_allclose(rec.output, expected, rtol=0, atol=5e-3)
    assert 60.0 <= truth["f_hz"] <= 300.0
    assert 0.02 <= zeta <= 0.2


def test_hum_is_lines_in_the_spectrum():
    drive = np.full(20_000, 20.0)
    rec, truth, bare = hidden("hum", drive=drive)
    extra = rec.output - bare.output
    columns = np.concatenate(
        [
            trig(2 * np.pi * n * truth["f_hz"] * rec.time)[:, None]
            for n in range(1, 1 + len(truth["amplitude_um"]))
            for trig in (np.sin, np.cos)
        ],
        axis=1,
    )
    parts, left, *_ = np.linalg.lstsq(columns, extra)
    assert left.item() < 1e-12
    np.testing.assert_allclose(np.hypot(parts[::2], parts[1::2]), truth["amplitude_um"], rtol=1e-6)
    np.testing.assert_allclose(np.arctan2(parts[1::2], parts[::2]), truth["phase_rad"], atol=1e-6)
    assert 0.02 <= truth["amplitude_um"][0] <= 0.2
    assert min(abs(truth["f_hz"] - 50.0), abs(truth["f_hz"] - 60.0)) <= 0.03


def test_output_nonlinearity_is_a_cubic_that_is_right_at_both_ends():
    rec, truth, bare = hidden("output_nonlinearity")
    stroke = rec.truth["stroke_um"]
    bent = np.polynomial.Polynomial.fit(bare.output, rec.output - bare.output, 3)
    np.testing.assert_allclose(bent(bare.output), rec.output - bare.output, rtol=0, atol=1e-9)
    np.testing.assert_allclose([bent(0.0), bent(stroke)], 0.0, atol=1e-9)
    steepest = 0.5 * stroke * (1.0 + np.array([-1.0, 1.0]) / np.sqrt(3.0))
    a2, a3 = truth["coefficients_um"]
    assert bent(stroke / 2) == pytest.approx(a2)
    assert np.diff(bent(steepest)).item() / 2 == pytest.approx(a3)
    assert 0.015 <= (abs(a2) + abs(a3)) / stroke <= 0.03
    assert np.all(1.0 + bent.deriv()(np.linspace(0.0, stroke, 200)) > 0.5)


def test_input_quantisation_is_not_in_the_recorded_drive():
    rec, truth, bare = hidden("input_quantisation")
    step = truth["step_V"]
    assert RANGE_V / step in (1024, 2048, 4096)
    np.testing.assert_array_equal(rec.input, bare.input)
    _, drive, rows = finely(rec, 10)
    expected = make_stage(2).hysteresis(np.rint(drive / step + 1e-9) * step)[rows]
    np.testing.assert_allclose(rec.output, expected, rtol=0, atol=1e-9)
    assert np.std(rec.output - bare.output) > 0.1 * step


def test_output_quantisation_is_the_last():
    rec, truth, _ = hidden("output_quantisation", noise_um=0.006)
    step = truth["step_um"]
    assert 0.05 <= step <= 0.3
    fine = simulate_stage(2, **{**CLEAN, "noise_um": 0.006})
    np.testing.assert_allclose(rec.output / step, np.rint(rec.output / step), atol=1e-6)
    assert np.max(np.abs(rec.output - fine.output)) <= step / 2 + 1e-9
    both = simulate_stage(2, effects=("hum", "output_quantisation"), **SHORT)
    np.testing.assert_allclose(both.output / step, np.rint(both.output / step), atol=1e-6)


def test_the_amplifier_limits_then_lags_and_the_converter_is_before_it():
    rec = simulate_stage(
        2, effects=("input_lag", "slew_limit", "input_quantisation", "rate_dependence"), **CLEAN
    )
    truth = rec.truth["parameters"]
    t, drive, rows = finely(rec, 10)
    slew, tau = truth["slew_limit"]["slew_V_per_s"], truth["input_lag"]["tau_s"]
    step = truth["input_quantisation"]["step_V"]
    rounded = np.rint(drive / step + 1e-9) * step
    smooth, stepped = (
        np.clip(first_order(limit_rate(u, slew, 1e-4), tau, t), 0.0, RANGE_V)
        for u in (drive, rounded)
    )
    # The rate is that of the drive without the converter's steps.
    rate = np.abs(np.diff(smooth, prepend=smooth[0])) * 1e4
    loss = truth["rate_dependence"]
    expected = slow_plays(make_stage(2), stepped, loss["coefficient"] * rate ** loss["exponent"])
    np.testing.assert_allclose(rec.output, expected[rows], rtol=0, atol=0.02)


def test_what_has_aged_creeps_less():
    rec = simulate_stage(2, effects=("creep", "ageing"), **CLEAN)
    aged, creep = hidden("ageing")[0].output, rec.truth["parameters"]["creep"]
    pairs = zip(creep["tau_s"], creep["gains"], strict=True)
    expected = aged + sum(first_order(aged, tau, rec.time, gain) for tau, gain in pairs)
    np.testing.assert_allclose(rec.output, expected, rtol=0, atol=2e-3)


def test_the_sensor_bends_all_that_moves():
    effects = ("output_nonlinearity", "drift", "hum", "aux")
    rec, moved = (simulate_stage(2, effects=e, **CLEAN) for e in (effects, effects[1:]))
    bent = np.polynomial.Polynomial.fit(moved.output, rec.output - moved.output, 3)
    np.testing.assert_allclose(bent(moved.output), rec.output - moved.output, rtol=0, atol=1e-9)


WITHOUT_PLAYS = ("rate_dependence", "log_rate", "moving")
PAIRS = [
    pair
    for pair in combinations(EFFECTS, 2)
    if not ("restoring_force" in pair and set(pair) & set(WITHOUT_PLAYS))
]


@pytest.mark.parametrize("name", WITHOUT_PLAYS)
def test_what_acts_on_plays_is_refused_where_there_are_none(name):
    with pytest.raises(InputError, match=f"the plays, on which {name} acts; leave one"):
        simulate_stage(2, effects=("restoring_force", name), **CLEAN)


@pytest.mark.parametrize("pair", PAIRS, ids="+".join)
def test_any_two_effects_are_simulated_together(pair):
    drive = path(0.0, 70.0, 20.0, 55.0, 55.0, 5.0, points=60)
    rec = simulate_stage(2, effects=pair, drive=drive, rate_hz=500.0)
    truth = rec.truth["parameters"]
    for name in pair:
        alone = simulate_stage(2, effects=(name,), drive=drive, rate_hz=500.0)
        assert truth[name] == alone.truth["parameters"][name]
        assert np.max(np.abs(rec.output - alone.output)) > 1e-3
    assert np.all(np.isfinite(rec.output))
    assert json.loads(json.dumps(rec.truth)) == rec.truth


def test_a_drive_at_rest_can_have_every_effect():
    every = [name for name in EFFECTS if name not in WITHOUT_PLAYS]
    for effects in (every, ALL_BUT_SPRINGS):
        rec = simulate_stage(2, effects=effects, drive=np.full(500, 30.0), rate_hz=500.0)
        assert np.all(np.isfinite(rec.output))
        assert json.loads(json.dumps(rec.truth, allow_nan=False)) == rec.truth


def test_saved_record_reads_back(tmp_path):
    rec = simulate_stage(1, effects=("aux",), **SHORT)
    rec.save(tmp_path / "stage.csv")
    lines = (tmp_path / "stage.csv").read_text(encoding="utf-8").splitlines()
    assert lines[0] == "t_s,u_V,z_um,load_N"
    values = np.array([line.split(",") for line in lines[1:]], float)
    for k, column in enumerate((rec.time, rec.input, rec.output, rec.aux["load_N"])):
        np.testing.assert_allclose(values[:, k], column, rtol=1e-9, atol=1e-12)


def test_a_record_is_made_without_starting_a_device():
    code = (
        "import preisach_jax.plant as p; p.simulate_stage(seconds=3.0);"
        "from jax._src import xla_bridge; assert not xla_bridge.backends_are_initialized()"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=120)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"effects": ("wear",)}, "no effect 'wear': choose from creep, input_lag"),
        ({"effects": "creep"}, "give a list"),
        ({"effects": ("aux", "aux:load_N")}, "only once"),
        ({"seed": -1}, "seed is -1"),
        ({"seed": 0.5}, "seed is 0.5"),
        ({"seconds": 0.0}, "seconds is 0.0"),
        ({"seconds": 1.0}, "too few"),
        ({"rate_hz": float("nan")}, "rate_hz is nan"),
        ({"noise_um": -1.0}, "noise_um is -1.0"),
        ({"drive": np.array([0.0, 80.0])}, "from 0.0 to 80.0"),
        ({"drive": np.zeros((2, 2))}, r"shape \(2, 2\)"),
    ],
)
def test_what_cannot_be_simulated_is_refused(changes, message):
    with pytest.raises(InputError, match=message):
        simulate_stage(**{"seed": 0, **changes})

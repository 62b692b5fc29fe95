"""The simulated stage obeys Preisach's laws, and each effect is what its truth says."""

import ast
import inspect
import json
import subprocess
import sys
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy import optimize, signal

from preisach_jax import plant, signals
from preisach_jax.errors import InputError
from preisach_jax.plant import EFFECTS, RANGE_V, Stage, make_stage, simulate_stage

SHORT: dict[str, Any] = {"seconds": 6.0, "rate_hz": 1000.0}
CLEAN = {**SHORT, "noise_um": 0.0, "encoder_step_um": 0.0}


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


@pytest.fixture(scope="module", params=[0, 4])
def stage(request):
    return make_stage(request.param)


def test_it_shares_nothing_with_the_models():
    for module, allowed in (
        (plant, {"preisach_jax.errors", "preisach_jax.signals"}),
        (signals, {"preisach_jax.errors"}),
    ):
        tree = ast.parse(inspect.getsource(module))
        names = {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
        names |= {a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names}
        assert {name for name in names if str(name).startswith("preisach_jax")} == allowed


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
    monkeypatch.setattr(plant, "CHUNK", 37)
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


@pytest.mark.parametrize("effects", [(), ("creep",), EFFECTS])
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
    np.testing.assert_allclose(
        plant.low_pass(x, 0.05, 1e-3), first_order(x, 0.05, t), rtol=0, atol=2e-4
    )
    errors = []
    for step in (4e-3, 2e-3, 1e-3):
        t = np.arange(0.0, 2.0, step)
        exact = (np.sin(9 * t) / 0.2 - 9 * np.cos(9 * t) + 9 * np.exp(-t / 0.2)) / (
            0.2 * (1 / 0.04 + 81)
        )
        errors.append(np.max(np.abs(plant.low_pass(np.sin(9 * t), 0.2, step) - exact)))
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
    fine = np.linspace(0.0, rec.time[-1], 20 * (rec.time.size - 1) + 1)
    drive = first_order(np.interp(fine, rec.time, rec.input), truth["tau_s"], fine)
    expected = make_stage(2).hysteresis(np.clip(drive, 0.0, RANGE_V))[::20]
    np.testing.assert_allclose(rec.output, expected, rtol=0, atol=0.01)
    assert 1e-3 <= truth["tau_s"] <= 5e-3


def test_delay_is_that_of_the_drive():
    rec, truth, _ = hidden("delay")
    fine = np.linspace(0.0, rec.time[-1], 50 * (rec.time.size - 1) + 1)
    drive = np.interp(fine - truth["delay_s"], rec.time, rec.input)
    expected = make_stage(2).hysteresis(drive)[::50]
    assert np.std(rec.output - expected) < 0.01
    assert np.max(np.abs(rec.output - expected)) < 0.2
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

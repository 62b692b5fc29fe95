"""The simulated actuator of the tests obeys Preisach's laws and hides what it says."""

import ast
import csv
import inspect
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import world
from scipy import integrate, signal
from world import EFFECTS, OUTSIDE, TOP, hidden_record, make_world

SHORT: dict[str, Any] = {"duration_s": 6.0, "rate_hz": 1000.0}


def path(*levels, points=200):
    """A path through levels, each ramp in `points` steps."""
    ramps = [np.linspace(a, b, points + 1)[1:] for a, b in pairwise(levels)]
    return np.concatenate([[levels[0]], *ramps])


@pytest.fixture(scope="module", params=[0, 5])
def actuator(request):
    return make_world(request.param)


def test_it_shares_nothing_with_the_package():
    tree = ast.parse(inspect.getsource(world))
    modules = [alias.name for n in ast.walk(tree) if isinstance(n, ast.Import) for alias in n.names]
    modules += [str(node.module) for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    assert {"numpy", "scipy"} <= {name.split(".")[0] for name in modules}
    assert not [name for name in modules if "preisach" in name or "jax" in name]


@pytest.mark.parametrize(("a", "b"), [(75.0, 0.0), (60.0, 31.0), (20.0, 18.0)])
def test_everett_function_is_the_integral_of_the_density(actuator, a, b):
    def density(beta, alpha):
        pairs = zip(actuator.up, actuator.down, strict=True)
        return actuator.gain * sum(p.derivative()(alpha) * q.derivative()(beta) for p, q in pairs)

    expected = integrate.dblquad(density, b, a, b, lambda alpha: alpha, epsabs=1e-6)[0]
    assert actuator.everett(a, b) == pytest.approx(expected, abs=1e-5)


def test_the_density_is_positive(actuator):
    x = np.linspace(0.0, TOP, 400)
    for function in (*actuator.up, *actuator.down):
        assert np.all(np.diff(function(x)) >= -1e-12)  # a tail may be nothing but rounding
    assert np.all(np.diff(actuator.reversible(x)) > 0.0)


def test_path_agrees_with_a_sum_of_relays(actuator):
    """Brute force: a grid of relays, each with the density's integral over its cell."""
    levels = 150
    edges = np.linspace(0.0, TOP, levels + 1)
    rng = np.random.default_rng(3)
    turns = edges[rng.integers(0, levels + 1, 60)]
    u = path(0.0, *turns, points=40)
    whole = actuator.everett(*np.meshgrid(edges, edges, indexing="ij"))
    cell = whole[1:, :-1] - whole[:-1, :-1] - whole[1:, 1:] + whole[:-1, 1:]
    i, j = np.tril_indices(levels, -1)
    diagonal = np.diagonal(whole[1:, :-1])
    state, z = np.zeros(len(i), bool), np.empty(len(u))
    for k, value in enumerate(u):
        reached = edges[1:] <= value + 1e-9
        # A relay is on from the upper edge of its cell and off again from the lower one.
        state = (state | reached[i]) & (edges[:-1][j] < value - 1e-9)
        z[k] = cell[i, j][state].sum() + diagonal[reached].sum()
    at_turns = slice(0, None, 40)
    smooth = actuator.hysteresis(u)[at_turns] - actuator.reversible(u[at_turns])
    np.testing.assert_allclose(z[at_turns], smooth, atol=1e-9 * actuator.stroke)


def test_wiping_out(actuator):
    """A larger swing erases what lies between its turning points."""
    plain = actuator.hysteresis(path(0.0, 60.0, 20.0, 70.0, 35.0))
    nested = actuator.hysteresis(path(0.0, 60.0, 20.0, 50.0, 30.0, 45.0, 38.0, 70.0, 35.0))
    np.testing.assert_allclose(nested[-200:], plain[-200:], rtol=0, atol=1e-9)
    assert abs(actuator.hysteresis(path(0.0, 35.0))[-1] - plain[-1]) > 0.5  # it does remember


def test_congruency(actuator):
    """Loops between the same two inputs have the same shape, whatever happened before."""
    first = actuator.hysteresis(path(0.0, 75.0, 25.0, 50.0, 25.0))[-401:]
    second = actuator.hysteresis(path(0.0, 52.0, 5.0, 51.0, 25.0, 50.0, 25.0))[-401:]
    np.testing.assert_allclose(first - first[0], second - second[0], rtol=0, atol=1e-9)
    assert abs(first[0] - second[0]) > 0.5


def test_refining_the_path_changes_nothing(actuator):
    rng = np.random.default_rng(1)
    turns = rng.uniform(0.0, TOP, 80)
    coarse = actuator.hysteresis(path(0.0, *turns, points=1))
    fine = actuator.hysteresis(np.repeat(path(0.0, *turns, points=37), 3))
    np.testing.assert_allclose(fine[:: 37 * 3], coarse, rtol=0, atol=1e-9)


def test_loops_are_like_a_piezos():
    strokes = []
    for seed in range(12):
        u = path(0.0, TOP, 0.0)
        up, down = make_world(seed).hysteresis(u)[:201], make_world(seed).hysteresis(u)[200:][::-1]
        assert np.all(np.diff(up) > 0)
        assert np.all(np.diff(down) > 0)
        assert np.all(down >= up - 1e-9)
        assert 0.08 < np.max(down - up) / up[-1] < 0.2
        assert np.max(down - up) / up[-1] == pytest.approx(make_world(seed).width, abs=0.002)
        assert up[-1] == pytest.approx(make_world(seed).stroke)
        strokes.append(up[-1])
    assert min(strokes) >= 40.0
    assert max(strokes) <= 90.0
    assert np.ptp(strokes) > 15.0


@pytest.mark.parametrize("kind", ["rich", "poor"])
def test_excitation_is_one_signal_at_every_rate(kind):
    slow, fast = (world.excitation(kind, 12.0, rate, seed=4) for rate in (1000.0, 4000.0))
    np.testing.assert_allclose(fast[::4], slow, atol=1e-9)
    assert slow[0] == 0.0
    assert slow.min() >= 0.0
    assert slow.max() <= TOP
    assert slow.max() > 0.9 * TOP


def test_rich_excitation_has_rates_holds_and_turning_points_everywhere():
    rate = 2000.0
    u = world.excitation("rich", 24.0, rate, seed=2)
    speed = np.abs(np.diff(u)) * rate
    for low, high in ((40.0, 100.0), (130.0, 180.0), (500.0, 900.0)):
        assert np.sum((speed > low) & (speed < high)) > 0.005 * len(u)
    assert np.sum(speed < 1e-6) > 0.1 * len(u)
    moving = u[np.flatnonzero(np.diff(u, prepend=-1.0))]
    corner = np.flatnonzero(np.diff(np.sign(np.diff(moving)))) + 1
    filled, _ = np.histogram(moving[corner], np.linspace(0.0, TOP, 16))
    assert np.all(filled > 0)
    starts = np.flatnonzero(np.diff((speed < 1e-6).astype(int)) == 1)
    before = u[starts] - u[starts - 40]
    assert np.sum(before > 1.0) >= 4
    assert np.sum(before < -1.0) >= 4


def test_poor_excitation_has_one_rate():
    speed = np.abs(np.diff(world.excitation("poor", 12.0, 1000.0, seed=2))) * 1000.0
    assert np.mean(np.abs(speed - 173.0) < 1.0) > 0.95


@pytest.mark.parametrize("effect", [None, *EFFECTS, *OUTSIDE])
def test_a_record_depends_on_its_seed_alone(effect):
    first, again, other = (hidden_record(effect, seed, **SHORT) for seed in (7, 7, 8))
    for name in ("t", "x", "z", "clean"):
        np.testing.assert_array_equal(first[name], again[name])
    assert first["truth"] == again["truth"]
    assert np.std(first["z"] - other["z"]) > 0.1
    assert len(first["t"]) == 6000
    assert bool(first["aux"]) == (effect == "aux")


def test_noise_and_encoder():
    rec = hidden_record(None, 1, **SHORT)
    error = rec["z"] - rec["clean"]
    assert np.std(error) == pytest.approx(rec["noise_um"], rel=0.05)
    assert rec["noise_um"] == pytest.approx(0.006, rel=0.01)
    steps = rec["z"] / world.ENCODER_STEP
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)
    assert abs(np.corrcoef(error[1:], error[:-1])[0, 1]) < 0.05
    coloured = hidden_record(None, 1, noise_colour=0.7, **SHORT)
    error = coloured["z"] - coloured["clean"]
    assert np.corrcoef(error[1:], error[:-1])[0, 1] == pytest.approx(0.69, abs=0.05)


def test_the_record_is_the_hysteresis_where_nothing_is_hidden():
    rec = hidden_record("none", 3, **SHORT)
    direct = make_world(3).hysteresis(rec["x"])
    # The chirp's crests lie between samples of the record, so that memory differs by a trifle.
    np.testing.assert_allclose(rec["clean"], direct, rtol=0, atol=3e-3)
    assert rec["truth"]["effect"] is None


@pytest.mark.parametrize("tau", [0.001, 0.004])
def test_runge_kutta_lag_against_lsim(tau):
    step = 1e-4
    t = np.arange(0, 5000) * step
    wave = lambda t: 30.0 + 20.0 * np.sin(2 * np.pi * 7.0 * t) + 40.0 * t  # noqa: E731
    got = world.runge_kutta_lag(wave(t[:-1]), wave(t[:-1] + step / 2), wave(t[1:]), tau, step, 3.0)
    fine = np.linspace(0, t[-1], 10 * (len(t) - 1) + 1)
    system = ([[-1 / tau]], [[1 / tau]], [[1.0]], [[0.0]])
    _, expected, _ = signal.lsim(system, wave(fine), fine, X0=[3.0])
    np.testing.assert_allclose(got, expected[::10], rtol=0, atol=3e-5)
    constant = np.full(len(t) - 1, 5.0)
    got = world.runge_kutta_lag(constant, constant, constant, tau, step, 0.0)
    np.testing.assert_allclose(got, 5.0 * -np.expm1(-t / tau), rtol=0, atol=1e-5)


@pytest.mark.parametrize("tau", [0.003, 0.4])
def test_ramp_lag_against_lsim(tau):
    rng = np.random.default_rng(0)
    t = np.arange(3000) * 1e-3
    h = 5.0 + np.cumsum(rng.normal(size=len(t)))
    system = ([[-1 / tau]], [[1 / tau]], [[1.0]], [[0.0]])
    _, expected, _ = signal.lsim(system, h, t, X0=[h[0]])
    np.testing.assert_allclose(world.ramp_lag(h, tau, 1e-3), expected, rtol=0, atol=1e-8)


def test_creep_is_the_sum_of_its_elements():
    rec, bare = (hidden_record(effect, 2, **SHORT) for effect in ("creep", None))
    h, truth = bare["clean"], rec["truth"]
    lags = []
    for tau, gain in zip(truth["tau_s"], truth["gains"], strict=True):
        system = ([[-1 / tau]], [[gain / tau]], [[1.0]], [[0.0]])
        lags.append(signal.lsim(system, h, rec["t"])[1].ravel())
    np.testing.assert_allclose(rec["clean"] - h, np.sum(lags, axis=0), rtol=0, atol=4e-3)
    assert 0.01 <= truth["gain_per_decade"] <= 0.03
    assert sum(truth["gains"]) == pytest.approx(3.0 * truth["gain_per_decade"])


def test_delay_is_the_hysteresis_of_the_late_excitation():
    rec = hidden_record("delay", 2, **SHORT)
    late = rec["truth"]["delay_s"]
    assert 1e-3 <= late <= 4e-3
    t = np.arange(300_000) * 2e-5
    drive = world.waveform("rich", 6.0, 2)(t - late)
    expected = make_world(2).hysteresis(drive)[::50]
    np.testing.assert_allclose(rec["clean"], expected, rtol=0, atol=0.15)
    assert np.std(rec["clean"] - expected) < 0.01


def test_input_lag_settles_on_holds_and_trails_on_ramps():
    rec, bare = (hidden_record(effect, 2, **SHORT) for effect in ("input_lag", None))
    assert 1e-3 <= rec["truth"]["tau_s"] <= 5e-3
    first_rise = (rec["t"] > 0.1) & (rec["t"] < 0.18)
    # On the virgin curve, once the start is forgotten, the output is that of tau earlier.
    late = np.interp(rec["t"] - rec["truth"]["tau_s"], rec["t"], bare["clean"])
    np.testing.assert_allclose(rec["clean"][first_rise], late[first_rise], rtol=0, atol=0.02)


@pytest.mark.parametrize("seed", range(6))
def test_drift_is_added_and_slow(seed):
    rec, bare = (hidden_record("drift", seed, **SHORT), hidden_record(None, seed, **SHORT))
    slow, truth = rec["clean"] - bare["clean"], rec["truth"]
    x = rec["t"] / 6.0
    if truth["kind"] == "exponential":
        expected = truth["amplitude_um"] * (1 - np.exp(-rec["t"] / truth["tau_s"]))
    elif truth["kind"] == "linear":
        expected = truth["amplitude_um"] * x
    else:
        a, b = truth["coefficients"]
        expected = truth["amplitude_um"] * (x + a * (x - x**2) + b * (x - 3 * x**2 + 2 * x**3))
    np.testing.assert_allclose(slow, expected, rtol=0, atol=1e-9)
    assert 0.01 <= abs(truth["amplitude_um"]) / truth["stroke_um"] <= 0.02


def test_ageing_shrinks_the_stroke():
    rec, bare = (hidden_record("ageing", 4, **SHORT), hidden_record(None, 4, **SHORT))
    moved = bare["clean"] > 1.0
    ratio = rec["clean"][moved] / bare["clean"][moved]
    assert np.all(np.diff(ratio) < 0.0)
    assert ratio[-1] == pytest.approx(1.0 - rec["truth"]["loss"], abs=2e-3)
    assert ratio[0] == pytest.approx(1.0, abs=3e-3)


@pytest.mark.parametrize("seed", range(4))
def test_aux_is_the_column_through_its_lag(seed):
    rec, bare = (hidden_record("aux", seed, **SHORT), hidden_record(None, seed, **SHORT))
    truth = rec["truth"]
    column = rec["aux"][truth["column"]]
    force = column - (20.0 if truth["column"] == "temp_C" else 15.0)
    if truth["tau_s"]:
        tau = truth["tau_s"]
        system = ([[-1 / tau]], [[1 / tau]], [[1.0]], [[0.0]])
        force = signal.lsim(system, force, rec["t"], X0=[force[0]])[1].ravel()
    moved = rec["clean"] - bare["clean"]
    np.testing.assert_allclose(moved, truth["gain_um_per_unit"] * force, rtol=0, atol=1e-3)
    assert abs(np.corrcoef(column, rec["x"])[0, 1]) < 0.5


def test_resonance_against_lsim():
    h = np.random.default_rng(5).normal(size=4000).cumsum()
    t, w, zeta = np.arange(4000) * 1e-4, 2 * np.pi * 200.0, 0.03
    _, expected, _ = signal.lsim(([w * w], [1.0, 2 * zeta * w, w * w]), h - h[0], t)
    got = world._mode(h, 200.0, zeta, 1e-4)
    np.testing.assert_allclose(got, expected + h[0], rtol=0, atol=1e-6)


def test_output_lag_against_lsim():
    rec, bare = (hidden_record(effect, 2, **SHORT) for effect in ("output_lag", None))
    tau = rec["truth"]["tau_s"]
    assert 1e-3 <= tau <= 5e-3
    system = ([[-1 / tau]], [[1 / tau]], [[1.0]], [[0.0]])
    expected = signal.lsim(system, bare["clean"], rec["t"])[1].ravel()
    # Between samples of the record the actuator is not straight.
    np.testing.assert_allclose(rec["clean"], expected, rtol=0, atol=0.15)
    assert np.std(rec["clean"] - expected) < 0.01


def test_a_slew_limit_holds_the_fast_ramps_back_and_nothing_else():
    rec, bare = (hidden_record("slew_limit", 2, **SHORT), hidden_record(None, 2, **SHORT))
    slew = rec["truth"]["slew_V_per_s"]
    gap = np.abs(rec["clean"] - bare["clean"])
    speed = np.abs(np.diff(rec["x"], prepend=0.0)) * SHORT["rate_hz"]
    assert speed.max() > 2 * slew
    assert gap[: np.flatnonzero(speed > slew)[0]].max() < 1e-9
    # It has caught up wherever the input has been slow for as long as the whole range takes.
    window = int(TOP / slew * SHORT["rate_hz"])
    slow = np.convolve(speed > slew / 2, np.ones(window))[: len(speed)] == 0
    assert np.median(gap[slow]) < 0.01
    limited = world._limited(rec["x"], slew / SHORT["rate_hz"])
    assert np.abs(np.diff(limited)).max() <= slew / SHORT["rate_hz"] + 1e-12


def test_dragging_is_a_sum_of_relays_with_moved_thresholds():
    rng = np.random.default_rng(1)
    u = np.clip(np.cumsum(2.0 * rng.normal(size=400)), 0.0, 12.0)
    slack = rng.uniform(0.0, 1.0, len(u))
    dragged = world._dragged(u, slack)
    for alpha, beta in ((5.0, 5.0), (6.3, 4.1), (9.0, 1.7)):
        moved, plain = False, False
        for value, shift, course in zip(u, slack, dragged, strict=True):
            moved = (moved or value - shift > alpha) and not value + shift < beta
            plain = (plain or course > alpha) and not course < beta
            assert moved == plain


def test_rate_dependence_vanishes_at_rest():
    rec, bare = (hidden_record("rate_dependence", 2, **SHORT), hidden_record(None, 2, **SHORT))
    gap = np.abs(rec["clean"] - bare["clean"])
    speed = np.abs(np.diff(rec["x"], prepend=0.0)) * SHORT["rate_hz"]
    assert gap[speed > 300.0].max() > 0.2
    # What remains at rest is what memory keeps of turning points that were not quite reached.
    assert np.median(gap[speed == 0.0]) < 0.1 * np.median(gap[speed > 300.0])


def test_feedback_agrees_with_itself_and_breaks_congruency():
    rec = hidden_record("moving", 2, **SHORT)
    actuator, a = make_world(2), rec["truth"]["a_V_per_um"]
    again = actuator.hysteresis(rec["x"] + a * rec["clean"])
    # The chirp's crests lie between samples of the record.
    np.testing.assert_allclose(again, rec["clean"], rtol=0, atol=5e-3)
    u = path(0.0, TOP, 25.0, 50.0, 25.0, 0.0, 25.0, 50.0, 25.0)
    fed = world._fed_back(actuator, u, a)
    heights = [np.ptp(fed[600:801]), np.ptp(fed[-400:-199])]
    assert abs(heights[0] - heights[1]) > 0.05


def test_a_bent_sensor_is_right_at_both_ends_and_the_same_on_both_branches():
    rec, bare = (hidden_record("output_nonlinearity", 2, **SHORT), hidden_record(None, 2, **SHORT))
    order = np.argsort(bare["clean"])
    assert np.all(np.diff(rec["clean"][order]) >= -1e-9)
    bend = rec["clean"] - bare["clean"]
    assert abs(bend[order[0]]) < 1e-6
    assert bend.max() > 0.5 * rec["truth"]["amplitude_um"]


def test_stick_slip_rests_and_keeps_near():
    rec, bare = (hidden_record("stick_slip", 4, **SHORT), hidden_record(None, 4, **SHORT))
    stuck = np.diff(rec["clean"])[np.diff(bare["clean"]) != 0.0] == 0.0
    assert 0.02 < np.mean(stuck) < 0.9
    assert np.max(np.abs(rec["clean"] - bare["clean"])) <= rec["truth"]["reach_um"]


def test_size_scales_the_effect():
    bare, small, large = (
        hidden_record(effect, 4, size=size, **SHORT)["clean"]
        for effect, size in ((None, 1.0), ("drift", 0.5), ("drift", 2.0))
    )
    np.testing.assert_allclose(large - bare, 4.0 * (small - bare), rtol=1e-9, atol=1e-9)


def test_unknown_start_hides_a_history():
    rec = hidden_record(None, 3, unknown_start=True, **SHORT)
    assert 0.3 * TOP < rec["x"][0] < 0.7 * TOP
    from_low = make_world(3).hysteresis(rec["x"])
    assert abs(rec["clean"][0] - from_low[0]) > 0.5
    # Both forget their past at the first return to 0 V.
    back = np.flatnonzero(rec["x"] < 1e-9)[0]
    assert np.max(np.abs((rec["clean"] - from_low)[back:])) < 5e-3


def test_decoy_column_does_nothing():
    plain, decoy = (
        hidden_record("creep", 2, **SHORT),
        hidden_record("creep", 2, decoy=True, **SHORT),
    )
    np.testing.assert_array_equal(plain["z"], decoy["z"])
    assert list(decoy["aux"]) == ["load_N"]
    assert np.std(decoy["aux"]["load_N"]) > 1.0


def test_written_record_reads_back(tmp_path):
    rec = hidden_record("creep", 2, decoy=True, duration_s=6.0, rate_hz=200.0)
    with world.write_csv(tmp_path / "stage.csv", rec).open(encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    assert header == ["t_s", "u_V", "z_um", "load_N"]
    values = np.array(rows, float)
    for k, expected in enumerate((rec["t"], rec["x"], rec["z"], rec["aux"]["load_N"])):
        np.testing.assert_allclose(values[:, k], expected, rtol=1e-8, atol=1e-12)


def test_unknown_names_are_refused():
    with pytest.raises(ValueError, match="no effect 'wear'"):
        hidden_record("wear", 0)
    with pytest.raises(ValueError, match="no excitation 'loud'"):
        world.excitation("loud", 1.0, 100.0, 0)
    with pytest.raises(ValueError, match="leaves"):
        make_world(0).hysteresis(np.array([0.0, -1.0]))

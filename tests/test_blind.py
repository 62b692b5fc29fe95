"""The blind benchmark: its world, its list of cases, its run and its tables."""

import ast
import dataclasses
import doctest
import importlib
import json
from functools import cache, partial
from pathlib import Path

import blind
import numpy as np
import pytest
from blind import foreign, forms, hidden, machines, rates, tables, world
from blind.cases import REPEATS, SEEDS, Case, Choice, make_cases
from blind.excitation import HISTORY_S, KINDS, make_drive
from blind.results import RIVALS, ResultsFile, read_results
from blind.run import run_cases
from blind.stage import make_stage
from scipy import signal
from scipy.integrate import solve_ivp

import preisach_jax as pj

FOLDER = Path(blind.__file__).parent
MODULES = sorted(path.stem for path in FOLDER.glob("*.py") if path.stem != "__init__")
JAX_FREE = ("world", "stage", "foreign", "hidden", "machines", "excitation")

SCENE = hidden.Scene(-10.0, 110.0, 50.0, 20.0, 100.0, 400.0, 6e3)


@cache
def bare(seed):
    return short({}, seed)


def short(effects, seed, excitation="rich", nothing="plain"):
    return world.make_measurement(effects, seed, excitation, 2.0, 1350.0, nothing)


def test_the_world_shares_no_code_with_the_package():
    for module in JAX_FREE:
        tree = ast.parse((FOLDER / f"{module}.py").read_text())
        names = set()
        for node in ast.walk(tree):
            if isinstance(node, ast.Import):
                names |= {alias.name for alias in node.names}
            if isinstance(node, ast.ImportFrom):
                names |= {f"{node.module}.{alias.name}" for alias in node.names}
        own = {name.split(".")[1] for name in names if name.startswith("blind.")}
        other = {name.split(".")[0] for name in names if not name.startswith("blind.")}
        assert own <= set(JAX_FREE)
        assert other <= {"__future__", "collections", "dataclasses", "typing", "zlib"} | {
            "numpy",
            "scipy",
        }


@pytest.mark.parametrize("module", MODULES)
def test_examples_in_docstrings(module):
    assert doctest.testmod(importlib.import_module(f"blind.{module}")).failed == 0


# The stage -----------------------------------------------------------------------------------


@pytest.mark.parametrize("density", ["smooth", "ridges", "relays"])
def test_a_stage_is_rate_independent_and_wipes_out(density):
    stage = make_stage(5, density)
    path = np.interp(np.arange(0, 6.01, 0.005), range(7), [0, 0.9, 0.2, 0.6, 0.3, 0.9, 0.1])
    z = stage.response(path)
    twice = stage.response(np.repeat(path, 2))
    np.testing.assert_array_equal(twice[::2], z)
    # The inner loop from 0.2 to 0.6 leaves no trace once 0.9 is reached again.
    without = np.interp(np.arange(0, 2.01, 0.005), range(3), [0, 0.9, 0.1])
    assert z[1000] == pytest.approx(stage.response(without)[200], abs=1e-9)


@pytest.mark.parametrize("seed", range(6))
def test_stroke_and_width_lie_in_their_ranges(seed):
    stage = make_stage(seed)
    assert 10 <= stage.stroke_um <= 120.1
    assert 0.04 <= stage.width <= 0.201
    up = np.linspace(0, 1, 501)
    closed = stage.response(np.concatenate([up, up[::-1]] * 2))[1002:]
    assert closed[0] == pytest.approx(0.0, abs=1e-3 * stage.stroke_um)
    assert np.all(np.diff(closed[:501]) >= 0)


def test_feedback_solves_its_equation():
    stage = make_stage(4)
    u = 0.5 - 0.5 * np.cos(np.linspace(0, 12, 400))  # from the lower end, where h is 0
    gain = 0.2 / stage.stroke_um
    h = stage.response_with_feedback(u, gain)
    np.testing.assert_allclose(stage.response(u + gain * h), h, atol=2e-5 * stage.stroke_um)
    assert np.ptp(h - stage.response(u)) > 0.05 * stage.stroke_um


# Excitations ---------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_drives_fill_their_time_and_stay_in_their_range(kind):
    drive = make_drive(kind, 20.0, 7)
    t = np.arange(-HISTORY_S, 20.0, 1e-3)
    level = drive(t)
    assert level.min() >= 0
    assert level.max() <= 1
    assert drive.corner_s[-1] >= 19.95
    ticks = drive.corner_s * 1350
    np.testing.assert_allclose(ticks, np.round(ticks), atol=1e-6)
    assert np.all(np.diff(drive.corner_s) > 0)
    np.testing.assert_array_equal(level, make_drive(kind, 20.0, 7)(t))


def corner_rates(kind):
    drive = make_drive(kind, 20.0, 7)
    rows = drive.corner_s[:-1] >= 0
    rate = np.abs(np.diff(drive.level) / np.diff(drive.corner_s))[rows]
    return drive, rate, np.diff(drive.corner_s)[rows]


def test_the_poor_drive_has_one_rate_and_the_rich_one_many():
    _, poor, _ = corner_rates("poor")
    assert np.ptp(poor) < 0.05 * poor[0]  # corners lie on sampling instants
    _, rich, lasted = corner_rates("rich")
    ramps = rich[(rich > 0) & (rich < 40)]
    assert np.log10(ramps.max() / ramps.min()) >= 1.5
    holds = lasted[(rich == 0) & (lasted < 2.2)]
    assert np.log10(holds.max() / holds.min()) >= 1.9


@pytest.mark.parametrize("seed", range(4))
def test_the_periodic_drive_repeats_itself(seed):
    drive = make_drive("periodic", 20.0, seed)
    begin = drive.corner_s[drive.corner_s > 0][0]  # the lower end
    ends = drive.corner_s[(drive.corner_s > 0) & (drive.level == drive(np.array([begin]))[0])]
    period = ends[1] - ends[0]
    t = begin + np.arange(0, 18.0 - begin - period, 1e-3)
    np.testing.assert_allclose(drive(t + period), drive(t), atol=1e-9)
    assert np.ptp(drive(t)) >= 0.6


def test_the_rich_drive_begins_with_three_equal_loops_and_ends_with_one():
    drive, _, _ = corner_rates("rich")
    inside = (drive.corner_s > 0) & (drive.corner_s < 20.0)
    zeros = drive.corner_s[inside & (drive.level == 0)]
    first = drive(zeros[0] + np.linspace(0, zeros[1] - zeros[0], 50))
    for begin in (zeros[1], zeros[2]):
        again = drive(begin + np.linspace(0, zeros[1] - zeros[0], 50))
        np.testing.assert_allclose(again, first, atol=1e-9)
    assert drive.level[-3:].tolist() == [0.0, 1.0, 0.0]


# What is hidden ------------------------------------------------------------------------------


QUICK = ("creep", "resonance", "backlash")
SIZED = [
    name if name in QUICK else pytest.param(name, marks=pytest.mark.campaign)
    for name in (*world.EFFECTS, *world.OUTSIDE)
]


@pytest.mark.parametrize("effect", SIZED)
def test_an_effect_of_size_zero_changes_nothing_and_a_nominal_one_does(effect):
    none, some = short({effect: 0.0}, 21), short({effect: 2.0}, 21)
    np.testing.assert_array_equal(none.output, bare(21).output)
    np.testing.assert_array_equal(none.input, bare(21).input)
    assert none.change == 0
    assert some.change > 1e-4
    np.testing.assert_array_equal(some.input, bare(21).input)


def test_the_same_seed_gives_the_same_record_and_another_seed_another():
    again = short({}, 21)
    np.testing.assert_array_equal(again.output, bare(21).output)
    assert again.circumstances == bare(21).circumstances
    assert not np.array_equal(short({}, 22).output, again.output)


@pytest.mark.parametrize("name", ["plain", "converters", "coloured", "ridges", "relays", "decoys"])
def test_what_hides_nothing_changes_nothing_but_its_circumstance(name):
    made = short({}, 12, nothing=name)
    assert made.truth == {}
    assert made.change == 0
    assert bool(made.aux) == (name == "decoys")
    assert made.circumstances["nothing"] == name


def test_unknown_names_are_refused():
    with pytest.raises(ValueError, match="magic"):
        world.make_measurement({"magic": 1.0}, 1)
    with pytest.raises(ValueError, match="fog"):
        world.make_measurement({}, 1, nothing="fog")
    with pytest.raises(ValueError, match="magic"):
        Choice(effects=["magic"])


def test_a_lag_follows_a_ramp_by_rate_times_tau():
    step, tau, rate = 1e-4, 3e-3, 40.0
    t = np.arange(0, 0.1, step)
    late = rate * t - hidden.lag(rate * t, tau, step)
    np.testing.assert_allclose(late[t > 15 * tau], rate * tau, rtol=1e-5)
    np.testing.assert_allclose(late, rate * tau * -np.expm1(-t / tau), atol=1e-12)


def test_a_delay_shifts_the_drive():
    setting = world._setting(3, "fair", 2.0, 1350.0, "smooth")
    late = world._driven(setting, {"delay": {"delay_s": 4 * setting.step_s}})
    prompt = world._driven(setting, {})
    np.testing.assert_allclose(late[4:], prompt[:-4], atol=1e-9)


def test_slew_is_limited_and_slow_signals_pass():
    step = 1e-3
    jump = np.concatenate([np.zeros(5), np.ones(50)])
    slow = hidden.limit_slew(jump, 100.0, step)
    np.testing.assert_allclose(slow[4:15], np.linspace(0, 1, 11), atol=1e-12)
    assert slow[-1] == 1
    np.testing.assert_array_equal(hidden.limit_slew(0.01 * jump, 100.0, step), 0.01 * jump)


def test_creep_after_a_step_goes_with_the_logarithm_of_time():
    step = 1e-3
    truth = {"gain_per_decade": 0.02, "onset_s": 0.01}
    h = np.concatenate([np.zeros(1), np.full(20_000, 50.0)])
    age = (np.arange(20_000) + 0.5) * step
    expected = 50.0 * (1 + 0.02 * np.log10(1 + age / 0.01))
    np.testing.assert_allclose(hidden.creep(h, truth, step)[1:], expected, rtol=1e-10)


def test_a_mode_rings_as_its_equation():
    truth, step = {"f_hz": 60.0, "zeta": 0.05}, 1e-4
    t = np.arange(0, 0.2, step)
    h = 3.0 + np.interp(t, [0, 0.02, 0.05, 0.2], [0, 0, 1, 0.5])
    w = 2 * np.pi * 60.0
    _, y, _ = signal.lsim(([w * w], [1, 2 * 0.05 * w, w * w]), h - 3.0, t)
    np.testing.assert_allclose(hidden.resonance(h, truth, step), 3.0 + y, atol=1e-7)


def test_readings_that_jitter_are_late_by_the_rate_times_the_jitter():
    t, rows = np.arange(0, 10, 1e-4), slice(0, None, 10)
    late = foreign.jitter(t, 30.0 * t, rows, {"rms_s": 1e-3, "walk_seed": 1}) - 30.0 * t[rows]
    assert np.std(late) == pytest.approx(30.0 * 1e-3, rel=0.03)
    assert abs(np.corrcoef(late[1:], late[:-1])[0, 1]) < 0.05


def test_a_line_that_wanders_keeps_its_height_and_mean_frequency():
    t = np.arange(0, 20, 1e-3)
    truth = {"f_hz": 40.0, "wander": 0.05, "amplitude_um": 0.2, "walk_seed": 4}
    line = foreign.wandering_hum(t, 20.0, truth)
    assert np.std(line) == pytest.approx(0.2 / np.sqrt(2), rel=0.01)
    up = t[1:][(line[1:] >= 0) & (line[:-1] < 0)]
    assert len(up) / 20.0 == pytest.approx(40.0, rel=0.01)
    assert np.std(1 / np.diff(up)) == pytest.approx(0.05 * 40.0, rel=0.15)


def test_one_way_creep_rises_slowly_and_falls_at_once():
    step, truth = 1e-3, {"gain": 0.02, "tau_s": 0.5, "back_s": 5e-3}
    h = np.concatenate([np.zeros(1), np.full(2000, 10.0), np.zeros(1000)])
    crept = foreign.one_way_creep(h, truth, step)
    age = np.arange(2001) * step
    np.testing.assert_allclose(crept[:2001], 0.2 * -np.expm1(-age / 0.5), atol=1e-9)
    assert abs(crept[2001 + 50]) < 1e-3 * crept[2000]


def test_a_sensor_jumps_as_often_as_it_says_and_shocks_ring():
    t = np.arange(0, 20, 1e-3)
    jumps = np.diff(foreign.resets(t, 20.0, {"jump_um": 0.3, "walk_seed": 2}))
    assert np.count_nonzero(jumps) == foreign.JUMPS
    assert np.all(np.abs(jumps[jumps != 0]) <= 0.45)
    truth = {"f_hz": 60.0, "zeta": 0.02, "amplitude_um": 0.5, "walk_seed": 3}
    power = np.abs(np.fft.rfft(foreign.shocks(t, 20.0, truth)))
    assert np.fft.rfftfreq(len(t), 1e-3)[np.argmax(power)] == pytest.approx(60.0, abs=1.0)


def test_a_spring_that_stiffens_rings_as_its_equation():
    truth, step = {"f_hz": 40.0, "zeta": 0.05, "stiffening": 2.0}, 5e-5
    t = np.arange(0, 0.2, step)
    h = 10.0 * np.interp(t, [0, 0.01, 0.05, 0.2], [0, 0, 1, 0.5])
    w = 2 * np.pi * 40.0

    def moves(now, state):
        stiff = w * w * (1 + 2.0 * np.clip(state[0] / 10.0, 0, 1))
        return state[1], stiff * (np.interp(now, t, h) - state[0]) - 0.1 * w * state[1]

    exact = solve_ivp(moves, (0, t[-1]), (0.0, 0.0), t_eval=t, max_step=1e-3, rtol=1e-8).y[0]
    np.testing.assert_allclose(foreign.stiffening(h, truth, 10.0, step), exact, atol=0.05)
    assert np.abs(exact - h).max() > 1.0


def test_drifts_reach_their_amplitude_and_ageing_its_loss():
    t = np.array([-1.0, 0.0, 20.0])
    for form in ({"form": "linear"}, {"form": "exponential", "tau_s": 4.0}):
        moved = hidden.drift(t, 20.0, {"amplitude": 2.0, **form})
        np.testing.assert_allclose(moved, [0, 0, 2], atol=1e-12)
    walk = hidden.slow_walk(np.linspace(0, 20, 2000), 20.0, seed=5)
    assert walk.mean() == pytest.approx(0, abs=1e-12)
    assert walk.std() == pytest.approx(1)
    left = hidden.remaining(t, 20.0, {"loss": 0.03, "tau_s": 7.0})
    np.testing.assert_allclose(left, [1, 1, 0.97])


def test_hum_has_the_lines_that_it_says():
    truth = hidden.draw("hum", 1.0, SCENE, seed=3)
    t = np.arange(0, 20, 1e-3)
    power = np.abs(np.fft.rfft(hidden.hum(t, truth) * np.hanning(len(t))))
    assert np.argmax(power) / 20 == pytest.approx(truth["f_hz"], abs=0.06)


def test_rate_dependence_widens_the_loop_by_its_law():
    # Far from the ends, every play lags behind a steady ramp by its radius and the shift.
    stage = make_stage(2)
    x = np.linspace(0, 1, 2001)
    shift = 0.01
    later = stage.response(x, np.full_like(x, shift))
    early = stage.response(x)
    rows = (x > 0.6) & (x < 0.9)
    memory = early - stage.reversible(x)
    shifted = np.interp(x - shift, x, memory) + stage.reversible(x)
    inertia = np.max(np.abs(later - shifted)[rows])
    assert inertia < 0.1 * np.max(np.abs(later - early)[rows])


def test_rate_dependence_has_its_coefficient_at_the_greatest_rate_and_its_power_law():
    law = hidden.draw("rate_dependence", 1.0, SCENE, seed=3)
    setting = world._setting(3, "fair", 2.0, 1350.0, "smooth")
    t = np.arange(2000) * setting.step_s
    ramp = 20.0 + 300.0 * t
    widening = law["widening_v"] * (300.0 / 6e3) ** law["exponent"]
    expected = setting.stage.response(
        setting.position(ramp), np.full_like(t, widening / setting.scene.span_v)
    )
    moved = world._moved(setting, {"rate_dependence": law}, ramp)
    np.testing.assert_allclose(moved, expected, atol=1e-9)


def test_quantisers_have_their_steps():
    setting = world._setting(3, "fair", 2.0, 1350.0, "smooth")
    made = short({"output_quantisation": 4.0}, 3, "fair")
    step = made.truth["output_quantisation"]["step"]
    assert setting.stage.stroke_um / 2**11 * 4 <= step <= setting.stage.stroke_um / 2**8 * 4
    np.testing.assert_allclose(made.output / step, np.round(made.output / step), atol=1e-6)


def test_a_load_acts_through_its_column_and_decoys_do_not():
    made = short({"aux": 4.0}, 21)
    truth = made.truth["aux:load_N"]
    caused = made.output - bare(21).output
    force = made.aux["load_N"] - 15
    if truth["tau_s"] == 0:
        np.testing.assert_allclose(caused, truth["gain"] * force, atol=0.01)
    assert abs(np.corrcoef(caused, force)[0, 1]) > 0.8
    assert set(made.aux) == {"load_N", "temp_C", "pressure_kPa"}


def test_backlash_is_a_dead_band_and_stick_slip_stays_within_its_reach():
    h = 10 * np.sin(np.linspace(0, 20, 3000))
    behind = hidden.backlash(h, {"reach_um": 2.0})
    assert np.max(np.abs(behind - h)) == pytest.approx(1.0)
    assert behind.max() == pytest.approx(9.0, abs=1e-4)
    stuck = hidden.stick_slip(h, {"reach_um": 2.0, "walk_seed": 1})
    assert np.max(np.abs(stuck - h)) <= 2.0
    assert np.mean(np.diff(stuck) == 0) > 0.8


def test_accommodation_takes_plays_to_the_middle_of_their_curves():
    stage = make_stage(2)
    x = 0.5 + 0.05 * np.sin(np.linspace(0, 400, 20_000))
    up = np.linspace(0, 0.5, 200)
    path = np.concatenate([up, x])
    fade = 0.5 * np.abs(np.diff(path, prepend=0))
    moved = stage.response(path, fade=fade)
    kept = stage.response(path)
    cycle = slice(-1000, None), slice(-5000, -4000)
    assert np.ptp(kept[-4000:] - kept[-4000:]) == 0
    assert abs(moved[cycle[0]].mean() - kept[cycle[0]].mean()) > 0.005 * stage.stroke_um


def test_a_telegraph_has_two_readings_and_friction_opposes_motion():
    said = hidden.telegraph(np.linspace(0, 20, 999), 20.0, {"jump_um": 0.3, "walk_seed": 2})
    assert set(said) == {0.0, 0.3}
    rate = np.repeat([0.0, 200.0, 10.0, -200.0], 2000)
    truth = {"offset_um": 0.2, "tau_s": 0.02, "threshold_v_s": 50.0}
    pushed = hidden.friction(rate, truth, 1e-3)
    np.testing.assert_allclose(pushed[[1999, 3999, 5999, 7999]], [0, -0.2, 0, 0.2], atol=1e-9)


def test_an_amplifier_that_leaks_forgets_a_step_since_its_reset():
    step = 1e-3
    t = np.arange(-1.0, 2.0, step)
    z = np.where(t < -0.5, 1.0, 3.0) + np.where(t >= 0.5, 2.0, 0.0)
    read = machines.leakage(t, z, {"tau_s": 0.4}, step)
    np.testing.assert_array_equal(read[t < 0], z[t < 0])  # before, it is not read
    np.testing.assert_allclose(read[(t > 0.01) & (t < 0.49)], 3.0)
    late = t > 0.51
    np.testing.assert_allclose(read[late], 3 + 2 * np.exp(-(t[late] - 0.5) / 0.4), atol=4e-3)
    assert machines.leakage(t, z, {"tau_s": np.inf}, step) is z


def test_a_force_of_velocity_goes_with_the_rate_or_saturates():
    rate = np.repeat([0.0, 50.0, 400.0, -400.0], 500)
    viscous = {"form": "viscous", "viscous": 1e-3, "tau_s": 0.0}
    dry = {"form": "dry", "saturating": 0.2, "speed": 10.0, "tau_s": 2e-3}
    np.testing.assert_allclose(machines.viscosity(rate, viscous, 1e-3), 1e-3 * rate)
    pushed = machines.viscosity(rate, dry, 1e-3)[[499, 999, 1499, 1999]]
    np.testing.assert_allclose(pushed, [0.0, 0.2, 0.2, -0.2], atol=1e-4)


def test_a_gain_scales_the_loop_with_its_column():
    made = short({"gain": 2.0}, 25)
    truth = made.truth["gain:load_N"]
    factor = 1 + truth["gain"] * (made.aux["load_N"] - 15)
    caused = made.output - bare(25).output
    expected = bare(25).output * (factor - 1)
    agreement = np.corrcoef(caused, expected)[0, 1]
    assert agreement > (0.99 if truth["tau_s"] == 0 else 0.5)


def test_another_axis_acts_through_its_column_with_its_gain_where_it_rests():
    t, step = np.arange(-1.0, 20.0, 1e-3), 1e-3
    truth = hidden.draw("cross", 1.0, SCENE, 3, machines.STRENGTHS)
    added = machines.cross(t, 20.0, truth, step)
    drive = machines.AXIS_V * machines.axis(t, 20.0, truth["column_seed"])
    w, zeta = 2 * np.pi * truth["f_hz"], truth["zeta"]
    _, y, _ = signal.lsim(([w * w], [1, 2 * zeta * w, w * w]), drive - drive[0], t + 1)
    np.testing.assert_allclose(added, truth["gain"] * (drive[0] + y), atol=1e-6)
    made = short({"cross": 1.0}, 21)
    assert set(made.aux) == {"y_V", "temp_C", "pressure_kPa"}


def test_two_modes_ring_at_both_frequencies_and_rest_where_they_are_driven():
    truth = {"f_hz": 40.0, "zeta": 0.02, "f_hz_2": 110.0, "zeta_2": 0.02, "share_2": 0.4}
    h = np.where(np.arange(20_000) < 1000, 0.0, 5.0)
    moved = machines.modes(h, truth, 1e-3)
    assert moved[-1] == pytest.approx(5.0, abs=1e-3)
    power = np.abs(np.fft.rfft(moved[1001:9001] - 5.0))
    peaks = signal.find_peaks(power, height=power.max() / 20)[0] / 8.0
    np.testing.assert_allclose(peaks, [40.0, 110.0], atol=0.3)


def test_thresholds_move_by_one_amount_a_decade_of_the_rate():
    truth = {"coefficient": 0.5, "slow_speed": 1.0}
    moved = machines.log_widening(np.array([0.0, -1e3, 1e4, 1e5]), truth)
    np.testing.assert_allclose(moved, [0.0, 1.5, 2.0, 2.5], atol=1e-3)


def test_noise_has_its_colour_and_strength():
    rng = np.random.default_rng(1)
    white, red, pink = (world._noise(rng, name, 40_000) for name in ("white", "ar1", "pink"))
    for noise in (white, red, pink):
        assert noise.std() == pytest.approx(1, rel=0.05)
    neighbours = [np.corrcoef(noise[1:], noise[:-1])[0, 1] for noise in (white, red)]
    np.testing.assert_allclose(neighbours, [0, 0.9], atol=0.02)
    power = np.abs(np.fft.rfft(pink)[1:]) ** 2
    assert power[100:200].mean() / power[1000:2000].mean() == pytest.approx(10, rel=0.3)


# Cases ---------------------------------------------------------------------------------------


def test_the_list_of_cases_holds_what_it_promises():
    cases = make_cases(Choice(seeds="reporting"))
    assert len({case.id for case in cases}) == len(cases)
    count = {suite: sum(case.suite == suite for case in cases) for suite in REPEATS}
    assert count["none"] == 800
    assert count["single"] == len(world.EFFECTS) * 6 * REPEATS["single"] * len(KINDS)
    several = {"pairs": 2, "beside": 2, "triples": 3}
    assert all(len(case.effects) == several.get(case.suite, len(case.effects)) for case in cases)
    assert all(len(case.effects) < 2 for case in cases if case.suite not in several)
    assert count["beside"] == 6 * 3 * 5 * len(KINDS)
    assert min(case.seed for case in cases) >= 3_000_000_000
    assert max(case.seed for case in make_cases(Choice())) <= 999


def test_a_choice_leaves_the_cases_as_they_are():
    everything = {case.id: case for case in make_cases(Choice())}
    some = make_cases(Choice(["single"], ["creep"], ["rich"], limit=12))
    assert len(some) == 12
    assert all(everything[case.id] == case for case in some)
    assert {case.effects["creep"] for case in some[:6]} == {0.1, 0.25, 0.5, 1, 2, 4}
    assert set(SEEDS) == {"development", "reporting"}


# The run -------------------------------------------------------------------------------------


def stub(case: Case):
    return made_up(case.id, excitation=case.excitation)


def interrupted(case: Case):
    if case.repeat >= 1:
        raise KeyboardInterrupt
    return stub(case)


def made_up(name, **changes):
    """A result as the benchmark writes it, of a single nominal creep that was found."""
    made = {
        "id": name,
        "suite": "single",
        "excitation": "rich",
        "size": 1.0,
        "change": 0.01,
        "stroke_um": 50.0,
        "hidden": ["creep"],
        "in_library": ["creep"],
        "truth": {"creep": {"gain_per_decade": 0.01}},
        "circumstances": {"nothing": "plain"},
        "library": ["aux:COL", "creep", "drift"],
        "error": None,
        "verdict": "explained",
        "effects": ["creep"],
        "families": [["creep"]],
        "parameters": {},
        "held_out": {"base": 1.0, "final": 0.2, "oracle": 0.1},
        "rivals": dict.fromkeys(RIVALS),
        "seconds": 10.0,
        "versions": {},
        "commit": "abc",
        "finished": "2026-11-28T12:00:00+00:00",
    } | changes
    evidence = {name: {"z": 99.0} for name in made["effects"]}
    return {"drawn": made["hidden"], "limits": [], "evidence": evidence} | made


@pytest.mark.parametrize("workers", [0, 2])
def test_a_run_goes_on_after_a_torn_line_and_repeats_nothing(tmp_path, workers):
    cases = make_cases(Choice(["none"], limit=5))
    assert run_cases(cases[:3], tmp_path, workers, stub) == 3
    path = tmp_path / "results.jsonl"
    whole = path.read_bytes()
    path.write_bytes(whole[:-25])  # killed while it wrote the third line
    assert run_cases(cases, tmp_path, workers, stub) == 3
    assert sorted(one["id"] for one in read_results(tmp_path)) == sorted(c.id for c in cases)
    assert run_cases(cases, tmp_path, workers, stub) == 0


def test_an_interruption_keeps_what_is_done(tmp_path):
    cases = make_cases(Choice(["none"], limit=5))
    with pytest.raises(KeyboardInterrupt):
        run_cases(cases, tmp_path, 0, interrupted)
    assert len(read_results(tmp_path)) == len(KINDS)


# Tables --------------------------------------------------------------------------------------


def test_rates_are_those_of_clopper_and_pearson():
    # With no hit of n, 1 - (alpha/2)^(1/n); with n of n, the mirror image.
    none = rates.rate([False] * 20)
    assert none["high"] == pytest.approx(1 - 0.025 ** (1 / 20))
    assert none["bound"] == pytest.approx(1 - 0.05 ** (1 / 20))
    assert rates.rate([True] * 20)["low"] == pytest.approx(0.025 ** (1 / 20))
    half = rates.rate([True, False] * 5)
    assert half["low"] == pytest.approx(1 - half["high"])


def test_detection_sizes_of_a_known_curve():
    # At sizes 1/2, 1, 2 found in 1, 2, 3 of 4: logit = ln 3 per ln 2, so 90 % lies at 2^2 = 4.
    size = np.repeat([0.5, 1.0, 2.0], 4)
    found = [True] + [False] * 3 + [True, False] * 2 + [True] * 3 + [False]
    sizes = rates.detection_sizes(list(size), found)
    assert sizes["size_50"] == pytest.approx(1.0, rel=1e-3)
    assert sizes["size_90"] == pytest.approx(4.0, rel=1e-2)
    assert rates.detection_sizes([1.0, 2.0], [False, False])["size_50"] == np.inf
    assert rates.detection_sizes([1.0, 2.0], [True, True])["size_90"] == 0


@pytest.mark.parametrize(
    ("limit", "holds"),
    [
        # Rounding the model's output changes a little less than rounding the stage's.
        ({"quantity": "step", "value": 0.25, "rms": 0.4}, True),
        ({"quantity": "step", "value": 0.2, "rms": 0.6}, False),
        # Two laws may call different amounts by one name: of all others the RMS decides.
        ({"quantity": "amplitude", "value": 0.2, "rms": 0.6}, True),
        ({"quantity": "amplitude", "value": 0.3, "rms": 0.4}, False),
    ],
)
def test_a_step_that_readings_show_is_compared_as_a_step_and_all_else_by_what_it_changes(
    limit, holds
):
    name = "output_quantisation" if limit["quantity"] == "step" else "drift"
    truth = {name: {limit["quantity"]: 0.25 * (1 + 1e-15)}}
    one = made_up("a", hidden=[name], truth=truth, effects=[], limits=[{"effect": name} | limit])
    assert rates.limit_holds(one) is holds


@pytest.mark.parametrize(
    ("said", "oracle", "right"),
    [
        (("creep", "drift"), 0.1, True),
        (("creep",), 0.199, True),  # the model with both leaves as much
        (("creep",), 0.19, False),
        ((), 0.199, True),
        (("creep", "hum"), 0.2, False),
        (("hum",), 0.2, False),
        (("creep", "drift", "hum"), 0.2, False),
    ],
)
def test_what_the_true_model_does_not_need_need_not_be_named_and_nothing_else_may(
    said, oracle, right
):
    held_out = {"base": 1.0, "final": 0.2, "oracle": oracle}
    one = made_up("a", hidden=["creep", "drift"], effects=list(said), held_out=held_out)
    assert rates.is_named_as_far_as_seen(one) is right


def synthetic():
    drift = {"value": 1.1, "low": 0.9, "high": 1.3, "unit": "um"}
    nothing = {"hidden": [], "in_library": [], "truth": {}, "suite": "none", "size": None}
    quiet = {"verdict": "adequate", "effects": [], "families": []}
    wrong = {"effects": ["drift"], "families": [["drift", "creep"]]}
    unknown = {"hidden": ["backlash"], "in_library": [], "suite": "outside", "truth": {}}
    one_drift = {
        "hidden": ["drift"],
        "in_library": ["drift"],
        "truth": {"drift": {"amplitude": 1.0}},
        "effects": ["drift"],
        "families": [["drift"]],
    }
    return [
        made_up("a"),
        made_up(
            "b",
            **wrong,
            seconds=20.0,
            evidence={"drift": {"z": 3.5}},
            limits=[{"effect": "creep", "rms": 0.3}],
        ),
        made_up("c", **quiet, size=0.25, limits=[{"effect": "creep", "rms": 0.6}]),
        made_up("d", **one_drift, parameters={"drift": {"amplitude": drift}}),
        made_up("e", **nothing, **quiet, rivals={**dict.fromkeys(RIVALS), "held_out": "drift"}),
        made_up("f", **(nothing | {"circumstances": {"nothing": "relays"}})),
        made_up("g", **unknown, effects=["creep"], kin=["creep"]),
        made_up("h", **unknown, **(quiet | {"verdict": "unexplained"})),
        made_up("i", suite="pairs", hidden=["creep", "drift"], in_library=["creep", "drift"]),
        made_up("j", excitation="poor", error="failed"),
    ]


@pytest.fixture
def written(tmp_path):
    with ResultsFile(tmp_path) as file:
        for result in synthetic():
            file.append(result)
    return tmp_path, tables.write_tables(tmp_path)


def counted(rate):
    return rate["count"], rate["of"]


def test_tables_hold_the_numbers_counted_by_hand(written):
    rich = written[1]["excitation"]["rich"]
    assert counted(rich["exact"]["single"]) == (2, 4)
    assert counted(rich["in_family"]["single"]) == (3, 4)
    assert counted(rich["exact"]["pairs"]) == (0, 1)
    assert counted(rich["false_alarms"]["diagnose"]) == (1, 2)
    assert counted(rich["false_alarms"]["held_out"]) == (1, 2)
    assert counted(rich["false_alarms"]["criterion"]) == (0, 2)
    assert counted(rich["false_alarms_by_circumstance"]["relays"]) == (1, 1)
    assert counted(rich["adequate"]) == (1, 2)
    assert counted(rich["adequate_by_circumstance"]["plain"]) == (1, 1)
    # It changed 0.5 um; a limit of 0.6 um at size 0.25 holds, one of 0.3 um at size 1 does not.
    assert counted(rich["limits_hold"]) == (1, 2)
    assert counted(rich["limits"]["creep"]) == (1, 2)
    assert rich["detection"]["creep"]["limit"] == pytest.approx((0.3 + 0.6) / 2)
    loose, strict = (rich["risk_and_coverage"][k] for k in (0, -1))
    # Said: creep; drift (wrong, z 3.5); drift; creep of nothing, of backlash, of a pair.
    assert counted(loose["wrong"]) == (3, 6)
    assert counted(strict["wrong"]) == (2, 5)
    # Hidden and visible: those of a, b, c, d, and both of i.
    assert counted(strict["found"]) == (3, 6)
    assert counted(rich["first_name_right"]["diagnose"]) == (2, 3)
    assert counted(rich["wrong_name_outside"]) == (1, 2)
    assert counted(rich["not_even_kin_outside"]) == (0, 2)
    assert rich["verdicts_outside"] == {"explained": 1, "unexplained": 1}
    assert rich["confusion"]["creep"] == {"creep": 1, "drift": 1}
    assert rich["confusion"]["nothing"] == {"adequate": 1, "creep": 1}
    assert rich["confusion"]["backlash (not in library)"] == {"creep": 1, "unexplained": 1}
    assert counted(rich["detection"]["creep"]["by_size"]["1"]) == (1, 2)
    assert counted(rich["detection"]["creep"]["by_size"]["0.25"]) == (0, 1)
    amplitude = rich["parameters"]["drift.amplitude"]
    assert amplitude["median_relative_error"] == pytest.approx(0.1)
    assert counted(amplitude["coverage"]) == (1, 1)
    # The truth lies half a side of the interval away, which one of 68 % just reaches.
    levels = {row["level"]: row["count"] for row in rich["reliability"]}
    assert levels == {50.0: 0, 68.0: 1, 80.0: 1, 90.0: 1, 95.0: 1, 99.0: 1}
    assert rich["over_oracle"]["median"] == pytest.approx(2.0)
    assert rich["seconds"]["median"] == 10.0
    assert (rich["cases"], rich["failed"]) == (9, 0)
    assert written[1]["excitation"]["poor"]["failed"] == 1


def test_intervals_are_counted_apart_from_those_before_they_were_made_longer():
    def one(finished, low):
        drift = {"value": 1.1, "low": low, "high": 1.3, "unit": "um"}
        return made_up(
            finished,
            hidden=["drift"],
            in_library=["drift"],
            truth={"drift": {"amplitude": 1.0}},
            effects=["drift"],
            parameters={"drift": {"amplitude": drift}},
            finished=finished,
        )

    rows = [one("2026-11-26T12:00:00+00:00", 1.05), one("2026-11-28T12:00:00+00:00", 0.9)]
    told = rates.summary_of(rows)
    assert (counted(told["coverage"]), counted(told["coverage_before"])) == ((1, 1), (0, 1))
    assert counted(told["parameters"]["drift.amplitude"]["coverage"]) == (1, 1)
    assert told["reliability"][-1]["of"] == 1


def test_tables_and_pictures_are_written(written):
    folder, content = written
    assert json.loads((folder / "summary.json").read_text()).keys() == content.keys()
    text = (folder / "tables.md").read_text()
    assert "| single: exactly right | 2/4 = 50 % [6.8, 93.2] | 2/4 = 50 % [6.8, 93.2] |" in text
    pictures = (
        "confusion_rich",
        "confusion_all",
        "detection",
        "false_alarms",
        "risk",
        "reliability",
    )
    for name in pictures:
        assert (folder / f"{name}.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_a_small_run_from_end_to_end(tmp_path, monkeypatch):
    from blind.judge import judge

    few = partial(pj.diagnose, effects=["drift", "creep", "input_lag"], levels=9)
    monkeypatch.setattr(pj, "diagnose", few)

    cases = [
        *make_cases(Choice(["single"], ["drift", "backlash"], ["fair"], limit=1)),
        *make_cases(Choice(["none"], excitations=["fair"], limit=1)),
    ]
    short = [dataclasses.replace(case, seconds=4.0, rate_hz=600.0) for case in cases]
    assert run_cases(short, tmp_path, 0, judge) == 2
    results = read_results(tmp_path)
    assert [one["error"] for one in results] == [None, None]
    assert {one["oracle_is"] for one in results} == {"fit with the true effects", "noise"}
    assert all(set(one["rivals"]) == set(RIVALS) for one in results)
    content = tables.write_tables(tmp_path)
    assert content["excitation"]["fair"]["cases"] == 2


# Forms ---------------------------------------------------------------------------------------


def test_records_of_forms_are_told_apart_and_counted():
    cases = [forms.Hiding("drag", 3), forms.Hiding(None, 3), forms.Hiding("drag", 3, ("drift",), 9)]
    assert [case.id for case in cases] == ["drag/3", "nothing/3", "drag/3/effects=drift/levels=9"]
    rows = [
        {"kind": "drag", "offered": True, "ratio": 1.2},
        {"kind": "drag", "offered": True, "ratio": 1.4},
        {"kind": "drag", "offered": False, "ratio": 1.0},
        {"kind": None, "offered": False, "by_search": True},
    ]
    summary = forms.summed(rows)
    assert counted(summary["as_good_as_the_law"]) == (1, 3)
    assert counted(summary["offered"]) == (2, 3)
    assert counted(summary["offered_of_nothing"]) == (0, 1)
    assert counted(summary["offered_of_nothing_by_search"]) == (1, 1)


@pytest.mark.parametrize("kind", forms.LAWS)
def test_a_law_is_hidden_in_the_size_that_it_says(kind):
    record, law = forms.made(kind, 4)
    bare, none = forms.made(None, 4)
    np.testing.assert_array_equal(none, 0.0)
    np.testing.assert_allclose(record.output - law, bare.output, atol=1e-9)
    stroke = np.ptp(bare.output)
    assert forms.SIZE[0] * 0.8 < law.std() / stroke < forms.SIZE[1] * 1.25


@pytest.mark.campaign
def test_steps_of_converters_under_one_loop_over_and_over_are_no_hum():
    # On the thinned rows a multiple of the drive's frequency looks like another line; on all of
    # them the line has fewer harmonics.
    made = world.make_measurement({}, 4019071403, "periodic", nothing="converters")
    found = pj.diagnose(pj.Record.from_arrays(made.time, made.input, made.output))
    assert found.effects == ()
    assert found.verdict == "adequate"

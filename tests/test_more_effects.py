"""Lags, modes, limits, lines and steps against SciPy's linear systems and closed forms."""

from dataclasses import replace
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from acting import applied, columns
from scipy import signal

import preisach_jax as pj
from preisach_jax.effects.base import Signals, Survey
from preisach_jax.effects.hum import Hum
from preisach_jax.effects.input_quantisation import InputQuantisation
from preisach_jax.effects.output_lag import OutputLag
from preisach_jax.effects.output_nonlinearity import OutputNonlinearity
from preisach_jax.effects.resonance import Resonance
from preisach_jax.effects.slew_limit import SlewLimit
from preisach_jax.effects.spectrum import strongest_lines

TICK = 1e-3
COUNT = 150


def course(seed, count=COUNT):
    """Uneven times that lie on a raster of `TICK`, and a wandering signal."""
    rng = np.random.default_rng(seed)
    ticks = np.concatenate([[0], np.cumsum(rng.integers(1, 10, count - 1))])
    return ticks, ticks * TICK, 3.0 + np.cumsum(rng.normal(size=count))


def filtered(ticks, values, numerator, denominator):
    """A system b(s)/a(s) of unit gain at rest, its input straight between samples, by SciPy."""
    raster = np.arange(ticks[-1] + 1)
    fine = np.interp(raster, ticks, values)
    system: Any = signal.tf2ss(numerator, denominator)
    discrete: Any = signal.cont2discrete(system, TICK, "foh")
    b, a = signal.ss2tf(*discrete[:4])
    return values[0] + signal.lfilter(b[0], a, fine - fine[0])[ticks]


# --- lag of the output ---


@pytest.mark.parametrize("tau", [0.0003, 0.013, 2.0])
def test_output_lag_is_a_linear_system(precision, tau):
    ticks, time, h = course(1)
    got = applied(OutputLag(), {"tau_s": tau}, time, h)
    assert got.dtype == precision
    atol = 2e-4 if precision == "float32" else 1e-9
    np.testing.assert_allclose(got, filtered(ticks, h, [1.0], [tau, 1.0]), rtol=0, atol=atol)


def test_output_lag_trails_a_ramp_by_its_time_constant(x64):
    time = np.linspace(0.0, 2.0, 50)
    got = applied(OutputLag(), {"tau_s": 0.1}, time, 7.0 * time)
    expected = 7.0 * (time - 0.1 * -np.expm1(-time / 0.1))
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-12)


def test_output_lag_has_the_bounds_of_the_record():
    (tau,) = OutputLag().bound_to(Survey(20.0, 1e-3)).parameters()
    assert (tau.low, tau.high) == pytest.approx((2.5e-4, 1.0))


# --- resonance ---


@pytest.mark.parametrize("f", [0.3, 21.0, 210.0])
@pytest.mark.parametrize("zeta", [0.001, 0.08, 0.7])
def test_resonance_is_a_linear_system(precision, f, zeta):
    ticks, time, h = course(2)
    got = applied(Resonance(), {"f_hz": f, "zeta": zeta}, time, h)
    assert got.dtype == precision
    w = 2 * np.pi * f
    expected = filtered(ticks, h, [w**2], [1.0, 2 * zeta * w, w**2])
    # In single precision the phase w dt is rounded, over some hundred samples.
    atol = 2e-2 if precision == "float32" else 1e-7
    np.testing.assert_allclose(got, expected, rtol=0, atol=atol)


def test_resonance_rings_after_a_step_as_its_closed_form(x64):
    time = np.concatenate([[0.0, 1e-9], np.linspace(1e-3, 1.0, 90) ** 2])
    w, zeta = 2 * np.pi * 13.0, 0.05
    got = applied(Resonance(), {"f_hz": 13.0, "zeta": zeta}, time, np.where(time > 0, 2.0, 0.0))
    damped = w * np.sqrt(1 - zeta**2)
    swing = np.cos(damped * time) + zeta * w / damped * np.sin(damped * time)
    expected = 2.0 * (1 - np.exp(-zeta * w * time) * swing)
    np.testing.assert_allclose(got[1:], expected[1:], rtol=0, atol=1e-6)


def test_resonance_far_above_the_motion_passes_it_with_a_delay(x64):
    time = np.sort(np.random.default_rng(3).uniform(0.0, 1.0, 4000))
    w, zeta = 2 * np.pi * 400.0, 0.3
    got = np.asarray(applied(Resonance(), {"f_hz": 400.0, "zeta": zeta}, time, np.sin(9.0 * time)))
    late = np.sin(9.0 * (time - 2 * zeta / w))
    np.testing.assert_allclose(got[50:], late[50:], rtol=0, atol=1e-3 * 2 * zeta * 9.0)


def test_resonance_follows_a_ramp_after_a_long_gap(x64):
    time = np.array([0.0, 1e6, 2e6])
    got = applied(Resonance(), {"f_hz": 5.0, "zeta": 0.1}, time, 3.0 * time)
    late = 2 * 0.1 / (2 * np.pi * 5.0)
    np.testing.assert_allclose(got[1:], 3.0 * (time[1:] - late), rtol=1e-12)


@pytest.mark.parametrize(("duration", "step"), [(24.0, 5e-4), (3600.0, 1.0), (0.05, 1e-3)])
def test_resonance_is_looked_for_up_to_the_sampling_limit(duration, step):
    f, zeta = Resonance().bound_to(Survey(duration, step)).parameters()
    assert (f.low, f.high) == pytest.approx((2 / duration, 0.45 / step))
    assert (zeta.low, zeta.high) == (0.001, 0.7)
    starts = np.array(f.start)
    assert starts[-1] > 0.9 * f.high
    assert starts[0] < 1.1 * max(f.low, f.high / 10**2.5)
    np.testing.assert_allclose(np.diff(np.log10(starts)), 0.1, atol=0.015)


# --- slew limit ---


def slow_slew_limit(time, values, slew, fine=4000):
    """u' runs towards u at no more than the slew, in many small steps between the samples."""
    driven, course = values[0], [values[0]]
    for k in range(1, len(values)):
        reach = slew * (time[k] - time[k - 1]) / fine
        for j in range(1, fine + 1):
            goal = values[k - 1] + (values[k] - values[k - 1]) * j / fine
            driven += min(max(goal - driven, -reach), reach)
        course.append(driven)
    return np.array(course)


@pytest.mark.parametrize("slew", [30.0, 200.0, 700.0])
def test_slew_limit_runs_after_the_input(precision, slew):
    _, time, u = course(4, 40)
    got = applied(SlewLimit(), {"slew": slew}, time, u)
    assert got.dtype == precision
    np.testing.assert_allclose(got, slow_slew_limit(time, u, slew), rtol=0, atol=3e-3)


def test_slew_limit_never_exceeds_its_rate_and_ends_on_the_input(x64):
    _, time, u = course(5)
    time, u = np.append(time, time[-1] + 1.0), np.append(u, u[-1])
    got = np.asarray(applied(SlewLimit(), {"slew": 120.0}, time, u))
    rate = np.abs(np.diff(got)) / np.diff(time)
    assert rate.max() == pytest.approx(120.0)
    assert rate.max() < 0.2 * np.max(np.abs(np.diff(u)) / np.diff(time))
    assert got[-1] == u[-1]


def test_slow_motion_passes_a_slew_limit_unchanged(precision):
    _, time, u = course(6)
    time, u = (np.asarray(jnp.asarray(values, float)) for values in (time, u))
    fastest = np.max(np.abs(np.diff(u)) / np.diff(time))
    got = applied(SlewLimit(), {"slew": 1.01 * fastest}, time, u)
    np.testing.assert_array_equal(got, u)


def test_slew_limit_is_looked_for_below_the_fastest_motion():
    time = np.array([0.0, 0.1, 0.3, 0.4])
    u = np.array([0.0, 1.0, -3.0, -3.0])
    (slew,) = SlewLimit().bound_to(Survey(0.4, 0.1, time, u)).parameters()
    assert slew.unit == "{u}/s"
    assert (slew.low, slew.high) == pytest.approx((0.4, 20.0))
    ratios = np.array([*slew.start, slew.high]) / np.array([slew.low, *slew.start])
    assert len(slew.start) == 8
    np.testing.assert_allclose(ratios, 50 ** (1 / 9))


@pytest.mark.parametrize("u", [[], [2.0], [2.0, 2.0]])
def test_slew_limit_without_motion_keeps_its_bounds(u):
    bound = SlewLimit().bound_to(Survey(1.0, 0.1, np.arange(len(u)) * 1.0, np.array(u)))
    assert bound == SlewLimit()


# --- lines in a spectrum ---


def slow_spectrum(position, values, frequencies):
    return np.array([abs(np.sum(values * np.exp(-2j * np.pi * f * position))) for f in frequencies])


@pytest.mark.parametrize("seed", range(4))
def test_the_strongest_line_is_the_peak_of_the_periodogram(seed):
    rng = np.random.default_rng(seed)
    x = np.sort(rng.uniform(0.0, 10.0, 400))
    f, phase = rng.uniform(1.0, 20.0), rng.uniform(0.0, 6.0)
    values = np.sin(2 * np.pi * f * x + phase) + rng.normal(size=400)
    (found,) = strongest_lines(x + 77.0, values, 0.5, 25.0, 0.01, count=1)
    assert found == pytest.approx(f, abs=0.03)
    near = found + np.linspace(-0.1, 0.1, 2001)
    peak = near[np.argmax(slow_spectrum(x, values - values.mean(), near))]
    assert found == pytest.approx(peak, abs=0.003)  # less what the slowest waves take away


def test_lines_are_separate_and_ordered_and_noise_has_none():
    rng = np.random.default_rng(5)
    x = np.sort(rng.permutation(20_000)[:4000]) * 1e-3
    noise = rng.normal(size=4000)
    assert strongest_lines(x, noise, 0.5, 450.0, 2.5e-4, count=3) == []
    values = noise + 3 * np.sin(2 * np.pi * 211.03 * x) + np.sin(2 * np.pi * 30.4 * x)
    found = strongest_lines(x, values, 0.5, 450.0, 2.5e-4, count=3)
    assert found == pytest.approx([211.03, 30.4], abs=2e-3)


def test_a_weak_line_is_seen_beside_slow_motion_of_uneven_samples():
    rng = np.random.default_rng(6)
    x = np.sort(rng.permutation(40_000)[:8000]) / 2000
    slow = 50 * np.cos(2 * np.pi * 0.11 * x) + 20 * x
    values = slow + 0.3 * np.sin(2 * np.pi * 50.02 * x) + rng.normal(size=8000)
    assert strongest_lines(x, values, 0.25, 900.0, 1.25e-4, 1) == pytest.approx([50.02], abs=5e-3)


def test_nothing_has_no_lines():
    assert strongest_lines(np.arange(50.0), np.zeros(50), 0.1, 0.45, 0.25, count=3) == []


# --- hum ---


def test_hum_is_a_sum_of_harmonics(precision, tolerance):
    time = np.array([0.0, 0.013, 0.04, 0.11])
    drives = Signals(jnp.asarray(time, float), jnp.zeros(4), {})
    got = columns(Hum(), {"f_hz": 7.0}, drives)
    assert got.dtype == precision
    waves = [np.exp(2j * np.pi * 7.0 * k * time) for k in (1, 2, 3)]
    expected = np.stack([part(wave) for wave in waves for part in (np.real, np.imag)], axis=1)
    np.testing.assert_allclose(got, expected, rtol=0, atol=tolerance)
    names = [coefficient.name for coefficient in Hum().coefficients()]
    assert names == ["cosine_1", "sine_1", "cosine_2", "sine_2", "cosine_3", "sine_3"]
    assert {coefficient.unit for coefficient in Hum().coefficients()} == {"{z}"}


def humming(f, amplitude=0.1, rate=2000.0, seconds=24.0, rows=8000, seed=7):
    """What a record with a hum shows of itself where it is thinned, and the residual red."""
    rng = np.random.default_rng(seed)
    count = round(seconds * rate)
    kept = np.sort(rng.permutation(count)[:rows])
    red = signal.lfilter([1.0], [1.0, -0.999], rng.normal(size=count))[kept]
    time = kept / rate
    residual = 0.003 * red + amplitude * np.sin(2 * np.pi * f * time + 1.0)
    return Survey(seconds, 1 / rate, time, time, time, residual)


@pytest.mark.parametrize("f", [12.34, 50.03, 59.98, 137.3])
def test_hum_starts_at_the_line_of_the_residual(f):
    effect = Hum().bound_to(humming(f))
    assert effect.harmonics == 3
    assert effect.starts_hz[0] == pytest.approx(f, abs=0.1 / 24.0)  # a tenth of a turn at the end
    for mains in (50.0, 60.0):
        assert min(abs(start / mains - 1) for start in effect.starts_hz) < 0.01
    (parameter,) = effect.parameters()
    assert parameter.low == pytest.approx(0.99 * min(effect.starts_hz))
    assert parameter.high == pytest.approx(1.01 * max(effect.starts_hz))


@pytest.mark.parametrize(("f", "rate", "harmonics"), [(55.0, 300.0, 2), (0.31, 1.0, 1)])
def test_harmonics_stay_below_half_the_sampling_rate(f, rate, harmonics):
    effect = Hum().bound_to(humming(f, 9.0, rate, seconds=3000 / rate, rows=2500))
    assert effect.starts_hz[0] == pytest.approx(f, rel=1e-3)
    assert effect.harmonics == harmonics
    assert harmonics * effect.parameters()[0].high < 0.5 * rate
    assert len(effect.coefficients()) == 2 * harmonics


def test_hum_without_a_line_starts_at_the_mains_or_where_it_does_no_harm():
    noise = np.random.default_rng(8).normal(size=500)
    time = np.arange(500.0)
    assert Hum().bound_to(Survey(0.499, 1e-3, time * 1e-3, noise, noise, noise)) == Hum()
    slow = Hum().bound_to(Survey(499.0, 1.0, time, noise, noise, noise))
    assert slow.starts_hz == (0.225,)
    assert slow.harmonics == 2


def test_slow_waves_are_no_hum():
    """They are a drift that wanders."""
    wave = humming(0.8)  # 19 periods
    assert Hum().bound_to(wave).starts_hz == (50.0, 60.0)
    assert Hum().bound_to(humming(1.6)).starts_hz[0] == pytest.approx(1.6, abs=0.1 / 24.0)


def with_more_lines(survey, frequencies, amplitude):
    """The same residual with further lines of equal height."""
    waves = np.cos(2 * np.pi * np.outer(survey.time, frequencies) + np.arange(len(frequencies)))
    return replace(survey, residual=survey.residual + amplitude * waves.sum(axis=1))


def test_a_tooth_of_a_comb_is_no_hum():
    """What repeats with the input leaves many lines of one height."""
    comb = with_more_lines(humming(17.3), 17.3 + 1.3 * np.arange(1, 6), 0.1)
    assert Hum().bound_to(comb).starts_hz == (50.0, 60.0)
    low_comb = with_more_lines(humming(17.3), 17.3 + 1.3 * np.arange(1, 6), 0.03)
    assert Hum().bound_to(low_comb).starts_hz[0] == pytest.approx(17.3, abs=0.1 / 24.0)


def test_multiples_and_two_strangers_are_no_crowd():
    many = with_more_lines(humming(50.02), [100.04, 150.06, 200.08, 23.4, 37.7], 0.08)
    assert Hum().bound_to(many).starts_hz[0] == pytest.approx(50.02, abs=0.1 / 24.0)


def test_a_record_of_any_length_is_searched_on_a_bounded_raster():
    time = np.sort(np.random.default_rng(9).uniform(0.0, 1e6, 3000))
    residual = np.sin(2 * np.pi * 0.02 * time)
    effect = Hum().bound_to(Survey(1e6, 1e-3, time, time, time, residual))
    assert effect.starts_hz[0] == pytest.approx(0.02, rel=1e-5)


# --- steps of the input's converter ---


def test_input_quantisation_is_the_nearest_step(precision):
    u = np.random.default_rng(10).uniform(-40.0, 75.0, 200)
    got = applied(InputQuantisation(), {"step": 0.625}, np.arange(200.0), u)
    assert got.dtype == precision
    lattice = 0.625 * np.arange(-70, 130)
    expected = lattice[np.argmin(np.abs(u[:, None] - lattice), axis=1)]
    np.testing.assert_array_equal(got, expected)


def stepping(step, seed, noise=0.1, lattice=None, holds=0):
    """Survey of a record whose drive has steps that the recorded input does not show."""
    rng = np.random.default_rng(seed)
    time = np.sort(rng.uniform(0.0, 20.0, 8000))
    u = 30.0 + 35.0 * np.sin(2.1 * time) * np.sin(0.37 * time + 0.5)
    for begin in rng.uniform(0.0, 19.0, holds):
        held = (time >= begin) & (time < begin + 0.7)
        u[held] = u[held][0]
    if lattice is not None:
        u = lattice * np.round(u / lattice)
    error = step * (np.round(u / step) - u / step) * (0.6 + 0.2 * np.sin(u / 20))
    residual = error + noise * step * rng.normal(size=8000) + step * np.sin(u / 9.0)
    return Survey(20.0, 2.5e-3, time, u, u, residual)


@pytest.mark.parametrize("step", [75 / 256.3, 75 / 1024, 75 / 4095.0])
@pytest.mark.parametrize(("seed", "holds"), [(11, 0), (12, 9)])
def test_steps_of_the_input_are_found_to_a_small_part_of_one_over_the_range(step, seed, holds):
    survey = stepping(step, seed, holds=holds)
    effect = InputQuantisation().bound_to(survey)
    best = min(effect.starts, key=lambda start: abs(start - step))
    steps = np.ptp(survey.input) / step
    assert abs(best / step - 1) * steps < 0.03
    assert best == effect.starts[0]
    assert len(effect.starts) <= 2
    (parameter,) = effect.parameters()
    assert parameter.unit == "{u}"
    assert parameter.low == pytest.approx(0.995 * min(effect.starts))
    assert parameter.high == pytest.approx(1.005 * max(effect.starts))


def test_a_record_that_lies_on_the_steps_already_is_left_as_it_is(x64):
    survey = stepping(0.1, 13, lattice=0.1)
    effect = InputQuantisation().bound_to(survey)
    for start in effect.starts:
        rounded = applied(effect, {"step": start}, survey.time, survey.input)
        np.testing.assert_allclose(rounded, survey.input, rtol=0, atol=1e-4)


def test_steps_are_looked_for_beside_a_finer_lattice_of_the_record():
    effect = InputQuantisation().bound_to(stepping(75 / 256.0, 14, lattice=0.01))
    assert min(abs(start * 256 / 75 - 1) for start in effect.starts) < 1e-4


@pytest.mark.parametrize("u", [[], [2.0], [2.0, 2.0, 2.0]])
def test_steps_without_motion_stay_harmless(u):
    values = np.array(u)
    survey = Survey(1.0, 0.1, np.arange(len(u)) * 1.0, values, values, values)
    assert InputQuantisation().bound_to(survey) == InputQuantisation()


@pytest.mark.parametrize("u", [[0.0, 1.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0, 1.0]])
def test_steps_are_not_found_where_the_input_only_jumps(u):
    values = np.array(u)
    residual = np.array([0.3, -0.1, 0.2, -0.4, 0.1])
    survey = Survey(0.4, 0.1, np.arange(5) * 0.1, values, values, residual)
    assert InputQuantisation().bound_to(survey).starts == (1e-6,)


def test_an_input_that_jumps_among_many_values_shows_its_steps():
    rng = np.random.default_rng(15)
    u = np.repeat(rng.uniform(0.0, 10.0, 400), 5)
    residual = 0.37 * np.round(u / 0.37) - u + 0.01 * rng.normal(size=2000)
    survey = Survey(20.0, 0.01, np.arange(2000) * 0.01, u, u, residual)
    assert InputQuantisation().bound_to(survey).starts[0] == pytest.approx(0.37, rel=1e-3)


@pytest.mark.parametrize(("moves_a_step", "is_seen"), [(1.0, False), (0.25, True), (1.37, True)])
def test_steps_as_long_as_a_move_are_not_told_from_a_shift_of_each_branch(moves_a_step, is_seen):
    # One loop over and over at one rate; each branch is shifted by what rounding makes of it.
    step, loops = 0.37, 8
    up = np.arange(0.0, 30.0, moves_a_step * step)
    loop = np.concatenate([up, up[::-1] + 0.16])
    u = np.tile(loop, loops)
    residual = step * np.round(u / step) - u + 1e-3 * np.random.default_rng(3).normal(size=len(u))
    time = np.arange(len(u)) * 1e-3
    starts = InputQuantisation().bound_to(Survey(time[-1], 1e-3, time, u, u, residual)).starts
    assert (min(abs(start / step - 1) for start in starts) < 1e-3) == is_seen


# --- a sensor with ripples ---


def test_ripples_of_a_sensor_join_the_cubic(precision, tolerance):
    reading = np.random.default_rng(13).uniform(2.0, 7.0, 50)
    effect = OutputNonlinearity(low_z=2.0, range_z=5.0, half_waves=6)
    got = columns(effect, {}, jnp.asarray(reading, float))
    assert got.dtype == precision
    x = (reading - 2.0) / 5.0
    legendre = [np.polynomial.legendre.legval(2 * x - 1, np.eye(4)[k]) for k in (2, 3)]
    ripples = [np.cos(2 * np.pi * x * waves) for waves in (1.0, 1.5, 2.0, 2.5, 3.0)]
    expected = np.stack([*legendre, *ripples], axis=1)
    np.testing.assert_allclose(got, expected, rtol=0, atol=30 * tolerance)
    assert len(effect.coefficients()) == 7
    assert effect.coefficients()[-1].meaning == "amplitude of the ripple of 3 waves"


def plays(u, radii):
    """Sum of play operators, sample by sample."""
    place, total = np.full(len(radii), u[0]), []
    for value in u:
        place = np.clip(place, value - radii, value + radii)
        total.append(place.sum())
    return np.array(total)


@pytest.mark.parametrize(("waves", "falls"), [(3.5, 3.0), (0.0, 1.3)])
def test_ripples_are_taken_only_where_a_cubic_does_not_follow(waves, falls):
    rng = np.random.default_rng(14)
    t = np.arange(4000) / 100
    u = 5 + 4.9 * np.sin(3 * t) * np.cos(0.37 * t)
    h = plays(u, np.linspace(0.0, 3.0, 60))
    x = (h - h.min()) / np.ptp(h) - 0.5
    bend = 0.03 * np.sin(2 * np.pi * waves * x) if waves else 0.8 * (x**3 - x / 4)
    z = h + np.ptp(h) * (bend + 1e-4 * rng.normal(size=len(h)))
    record = pj.Record.from_arrays(t, u, z)
    fit = pj.fit(record, ["output_nonlinearity"])
    (effect,) = fit.model.effects
    assert isinstance(effect, OutputNonlinearity)
    assert (effect.half_waves > 0) == (waves > 0)
    assert fit.rms_validation < pj.fit(record).rms_validation / falls

"""Lags, modes, limits, lines and steps against SciPy's linear systems and closed forms."""

from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from scipy import signal

from preisach_jax.effects.base import Survey
from preisach_jax.effects.output_lag import OutputLag
from preisach_jax.effects.resonance import Resonance
from preisach_jax.effects.slew_limit import SlewLimit

TICK = 1e-3
COUNT = 150


def course(seed, count=COUNT):
    """Uneven times that lie on a raster of `TICK`, and a wandering signal."""
    rng = np.random.default_rng(seed)
    ticks = np.concatenate([[0], np.cumsum(rng.integers(1, 10, count - 1))])
    return ticks, ticks * TICK, 3.0 + np.cumsum(rng.normal(size=count))


def applied(effect, values, time, course):
    arrays = {name: jnp.asarray(value, float) for name, value in values.items()}
    return effect.apply(arrays, jnp.asarray(course, float), jnp.asarray(time, float))


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

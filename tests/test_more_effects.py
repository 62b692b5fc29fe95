"""Lags, modes, limits, lines and steps against SciPy's linear systems and closed forms."""

from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from scipy import signal

from preisach_jax.effects.base import Survey
from preisach_jax.effects.output_lag import OutputLag

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

"""What lies between the samples: arcs in place of straight lines, and what they move."""

import acting
import numpy as np
from found import ROWS
from test_modes import RATE, lagging, plays, through

import preisach_jax as pj
from preisach_jax.identify.confidence import on_arcs

FINER = 16


def test_a_parabola_is_its_own_arc(x64):
    time = np.array([0.0, 0.1, 0.25, 0.3, 0.5, 0.6])
    made = on_arcs(acting.signals(time, 3 * time**2 - time, {"load": time}))
    middle = (time[1:] + time[:-1]) / 2
    np.testing.assert_array_equal(made.time[::2], time)
    np.testing.assert_allclose(made.time[1::2], middle)
    np.testing.assert_allclose(made.input[::2], 3 * time**2 - time)
    # Beyond the first and the last sample no curvature is known.
    inner = slice(1, -1)
    np.testing.assert_allclose(made.input[1::2][inner], (3 * middle**2 - middle)[inner])
    np.testing.assert_allclose(made.aux["load"][1::2], middle)


def test_corners_and_rests_stay_as_they_are_and_instants_have_nothing_between(x64):
    time = np.arange(12.0)
    x = np.interp(time, [0, 3, 5, 6, 8, 11], [0.0, 6.0, 6.0, 1.0, 1.0, 4.0])
    made = on_arcs(acting.signals(time, x))
    np.testing.assert_allclose(made.input, np.interp(made.time, time, x), atol=1e-12)
    made = on_arcs(acting.signals([0.0, 1.0, 1.0, 2.0], [0.0, 1.0, 1.5, 4.0]))
    assert np.isfinite(made.input).all()
    assert made.input[3] == 1.25


def test_intervals_hold_frequency_and_damping_of_a_mode_behind_a_lag():
    """Between its samples what a lag passes on bends, and a mode that it drives seems damped less.

    The stage lives on a raster that is sixteen times finer than the record.
    """
    tau_s, f_hz, zeta = 0.001, 160.0, 0.06
    rng = np.random.default_rng(5)
    corners = np.arange(0, ROWS * FINER + 1, 25 * FINER)
    fine = np.arange(ROWS * FINER)
    u = np.interp(fine, corners, rng.uniform(0.0, 10.0, len(corners)))
    late = lagging(u, tau_s, RATE * FINER)
    h = 0.1 * late + plays(late, (0.3, 0.7, 1.2))
    z = through(h, [(f_hz, zeta, 1.0)], rate_hz=RATE * FINER)[::FINER]
    z = z + rng.normal(0, 1e-3, ROWS)
    record = pj.Record.from_arrays(np.arange(ROWS) / RATE, u[::FINER], z)
    fit = pj.fit(record, effects=["input_lag", "resonance"], levels=20)
    mode = fit.model.parameters["resonance"]
    assert mode["zeta"].low <= zeta <= mode["zeta"].high
    own = mode["f_hz"]
    assert own.low <= f_hz <= own.high
    # As far up as it reaches down, where arcs take nothing off, it would not hold the truth.
    assert own.value + (own.value - own.low) < f_hz
    assert own.high < f_hz + (f_hz - own.low)

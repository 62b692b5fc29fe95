"""The simulated experiment obeys Preisach's laws and looks like the paper's."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.signal

from preisach_jax import InputError
from preisach_jax.piezo import (
    NOTCH_DENOMINATOR,
    NOTCH_NUMERATOR,
    RATE_HZ,
    encode,
    experiment,
    linear_filter,
    notch_filter,
    paper_stage,
    resonances,
)
from preisach_jax.plant import ENCODER_STEP_UM, RANGE_V
from preisach_jax.signals import bernoulli_ramp

signal: Any = scipy.signal  # whose results are typed as one of many
STAGE = paper_stage()
ONE = np.ones(1)
KEY = jax.random.key(0)
SAMPLES = 600  # one length for most paths, so that little has to be compiled
FILTERS = {
    "notch": (NOTCH_NUMERATOR, NOTCH_DENOMINATOR),
    "resonances": (STAGE.numerator, STAGE.denominator),
    "short numerator": (np.array([0.3]), np.array([2.0, -1.5, 0.4])),
    "moving average": (np.array([0.2, 0.5, 0.4]), np.array([1.0])),
}


def major_loop():
    """The rising and the falling branch on one ascending axis."""
    axis = np.linspace(0.0, RANGE_V, 151)
    path = np.concatenate([axis, axis[-2::-1], np.zeros(SAMPLES - 301)])
    z = np.asarray(STAGE.hysteresis(path))
    return axis, z[:151], z[150:301][::-1]


@pytest.mark.parametrize("name", FILTERS)
def test_linear_filter_against_scipy(name, precision, tolerance):
    b, a = FILTERS[name]
    x = 40.0 + np.cumsum(np.random.default_rng(0).normal(size=SAMPLES))
    x = x.astype(precision).astype(float)
    expected = signal.lfilter(b, a, x, zi=signal.lfilter_zi(b, a) * x[0])[0]
    got = linear_filter(b, a, jnp.asarray(x, precision))
    assert got.dtype == precision
    np.testing.assert_allclose(got, expected, rtol=0, atol=tolerance * np.max(np.abs(x)))


def test_resonances_lose_little_in_single_precision():
    """A lightly damped filter in direct form loses 2.7 nm here; an encoder step is 1.22 nm."""
    drive = np.asarray(notch_filter(bernoulli_ramp(jax.random.key(1), 3000, RATE_HZ)), float)
    b, a = FILTERS["resonances"]
    expected = signal.lfilter(b, a, 1.5 * drive)  # starts at zero
    got = linear_filter(b, a, 1.5 * drive)
    assert got.dtype == "float32"
    assert np.max(np.abs(got - expected)) < 0.2e-3


def test_zeros_of_the_notch_are_two_resonances():
    modes = resonances(NOTCH_NUMERATOR)
    np.testing.assert_allclose(modes.frequency_hz, [337.675, 586.977], atol=1e-3)
    np.testing.assert_allclose(modes.damping, [0.01234, 0.01534], atol=1e-5)
    assert resonances(NOTCH_DENOMINATOR).damping.size == 0


def test_the_stage_rings_with_its_modes_and_not_behind_the_notch():
    """Oracle: the two modes as differential equations, whose response is that of the stage."""
    step = np.append(0.0, np.ones(SAMPLES - 1))
    behind = signal.lfilter(NOTCH_NUMERATOR, NOTCH_DENOMINATOR, step)
    times = np.arange(SAMPLES) / RATE_HZ
    for drive, least, most in ((step, 0.3, 1.0), (behind, 0.0, 1e-5)):
        expected = np.zeros(SAMPLES)
        for share, f, damping in ((0.8, 337.67534, 0.01233856), (0.2, 586.97650, 0.01533898)):
            omega = 2 * np.pi * f
            mode = ([share * omega**2], [1.0, 2 * damping * omega, omega**2])
            expected += signal.lsim(mode, drive, times)[1]
        got = signal.lfilter(STAGE.numerator, STAGE.denominator, drive)
        np.testing.assert_allclose(got, expected, rtol=0, atol=1e-5)
        assert least < np.abs(got[100:] - 1.0).max() < most


def test_hysteresis_against_a_loop(precision, tolerance):
    """Oracle: each play sample by sample, branch by branch, from saturated low."""
    rng = np.random.default_rng(0)
    v = np.repeat(rng.uniform(0.0, RANGE_V, SAMPLES // 2), 2).astype(precision).astype(float)
    plays, outputs = STAGE.slack_down.copy(), []
    for value in [0.0, *v]:
        ahead, behind = value - STAGE.slack_up > plays, value + STAGE.slack_down < plays
        plays = np.where(ahead, value - STAGE.slack_up, plays)
        plays = np.where(behind, value + STAGE.slack_down, plays)
        outputs.append(np.sum(STAGE.slope * plays + STAGE.curvature * plays**2 / 2))
    expected = np.array(outputs[1:]) - outputs[0]
    got = STAGE.hysteresis(jnp.asarray(v, precision))
    assert got.dtype == precision
    np.testing.assert_allclose(got, expected, rtol=0, atol=0.05 * tolerance * 112.0)


def test_the_loop_is_like_the_papers(x64):
    axis, up, down = major_loop()
    rising, falling = np.diff(up) / 0.5, np.diff(down) / 0.5
    assert up[-1] == pytest.approx(112.0, abs=1.0)
    # (27): the greatest slope is at the vertices, where the branches begin and end.
    greatest = max(rising.max(), falling.max())
    assert greatest == pytest.approx(2.53, rel=0.02)
    assert greatest == rising[-1]
    assert falling.max() == falling[0] == pytest.approx(2.53, rel=0.04)
    assert np.all(np.diff(rising) > 0.0)  # convex
    assert np.all(np.diff(falling) < 1e-3)  # concave
    assert rising[-1] > 1.8 * rising[75]
    assert 0.10 < np.max(down - up) / up[-1] < 0.18
    assert np.max(np.abs(up + down[::-1] - up[-1])) > 200 * ENCODER_STEP_UM  # no symmetry
    assert axis[0] == up[0] == 0.0


def test_encoder_reads_whole_steps(precision):
    z = jnp.asarray(np.random.default_rng(0).uniform(0.0, 112.0, 500), precision)
    read = encode(z, ENCODER_STEP_UM)
    steps = np.asarray(read, float) / ENCODER_STEP_UM
    np.testing.assert_allclose(steps, np.round(steps), rtol=0, atol=2e-2)
    assert np.max(np.abs(read - z)) <= 0.51 * ENCODER_STEP_UM
    assert np.max(np.abs(read - z)) > 0.45 * ENCODER_STEP_UM
    np.testing.assert_array_equal(jax.grad(lambda z: jnp.sum(encode(z, 0.5)))(z), jnp.ones(500))
    np.testing.assert_array_equal(encode(z, 0.0), z)


def test_experiment_step_by_step(x64):
    key = jax.random.key(4)
    record = experiment(key, SAMPLES, encoder_step_um=0.0)
    kept = [int(2.5 * k) for k in range(SAMPLES)]
    command = bernoulli_ramp(jax.random.split(key)[0], kept[-1] + 1, RATE_HZ)
    drive = np.clip(signal.lfilter(NOTCH_NUMERATOR, NOTCH_DENOMINATOR, command), 0.0, RANGE_V)
    np.testing.assert_array_equal(record.time_s, np.array(kept) / RATE_HZ)
    np.testing.assert_allclose(record.command_v, np.asarray(command)[kept], atol=1e-12)
    np.testing.assert_allclose(record.input_v, drive[kept], rtol=0, atol=1e-9)
    stroke = np.asarray(STAGE.response(jnp.asarray(drive)))[kept]
    np.testing.assert_allclose(record.stroke_um, stroke, rtol=0, atol=1e-9)


def test_experiment_without_reduction_and_with_noise(x64):
    key = jax.random.key(0)
    quiet, noisy = (
        experiment(key, SAMPLES, rate_hz=RATE_HZ, noise_um=noise, encoder_step_um=0.0)
        for noise in (0.0, 0.02)
    )
    np.testing.assert_allclose(np.diff(quiet.time_s), 1.0 / RATE_HZ, rtol=1e-9)
    np.testing.assert_array_equal(noisy.input_v, quiet.input_v)
    noise = np.asarray(noisy.stroke_um - quiet.stroke_um)
    assert np.std(noise) == pytest.approx(0.02, rel=0.1)
    assert abs(np.mean(noise[1:] * noise[:-1])) < 0.15 * np.var(noise)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: linear_filter(ONE, np.array([0.0, 1.0]), ONE), "first coefficient and its sum"),
        (lambda: linear_filter(ONE[None], ONE, ONE), r"the numerator has the shape \(1, 1\)"),
        (lambda: notch_filter(ONE[:0]), r"the signal has the shape \(0,\)"),
        (lambda: STAGE.hysteresis(1.0), r"the drive has the shape \(\)"),
        (lambda: resonances(ONE, -1.0), "rate_hz is -1.0"),
        (lambda: paper_stage(1), "plays is 1"),
        (lambda: experiment(KEY, 0), "samples is 0"),
        (lambda: experiment(KEY, 9, rate_hz=6000.0), "rate_hz is 6000.0"),
        (lambda: experiment(KEY, 9, noise_um=-1.0), "noise_um is -1.0"),
    ],
)
def test_what_cannot_be_used_is_refused(call, message):
    with pytest.raises(InputError, match=message):
        call()

"""Excitations keep their range, their rates and their spectrum, in both precisions."""

import jax
import numpy as np
import pytest
from scipy import signal as oracle

from preisach_jax import signals
from preisach_jax.errors import InputError

RATE = 2000.0


def corners(u):
    """Rows of the turning points of u; a hold does not hide one."""
    moving = np.flatnonzero(np.diff(u, prepend=np.nan) != 0.0)
    sign = np.sign(np.diff(u[moving]))
    return moving[np.flatnonzero(sign[1:] != sign[:-1]) + 1]


# One length for most tests, so that little has to be compiled.
N = 4000
KEY = jax.random.key(1)
EVERY = {
    "triangle": lambda: signals.triangle(N, RATE, 1.7),
    "decaying_triangles": lambda: signals.decaying_triangles(N, RATE, 400.0),
    "staircase": lambda: signals.staircase(N, RATE, 0.05),
    "chirp": lambda: signals.chirp(N, RATE, 1.0, 40.0),
    "multisine": lambda: signals.multisine(KEY, N, range(1, 80)),
    "bernoulli_ramp": lambda: signals.bernoulli_ramp(KEY, N, RATE),
    "random_steps": lambda: signals.random_steps(KEY, N, RATE, 0.1),
}


@pytest.mark.parametrize("name", EVERY)
def test_every_signal_keeps_its_range_and_is_the_same_in_both_precisions(name):
    drawn = []
    for double in (False, True):
        with jax.enable_x64(double):
            u = EVERY[name]()
        assert u.dtype == ("float64" if double else "float32")
        drawn.append(np.asarray(u, float))
    single, double = drawn
    np.testing.assert_allclose(single, double, rtol=0, atol=5e-3)
    assert double.shape == (N,)
    assert np.all(np.isfinite(double))
    assert double.min() >= -1e-9
    assert double.max() <= 75.0 + 1e-9
    assert np.ptp(double) > 40.0


def test_triangle_against_its_corners():
    cycles = 3.0 * np.arange(N) / RATE % 1.0
    expected = np.interp(cycles, [0.0, 0.5, 1.0], [10.0, 30.0, 10.0])
    got = signals.triangle(N, RATE, 3.0, 10.0, 30.0)
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-4)


def test_decaying_triangles_shrink_at_constant_slope():
    u = np.asarray(signals.decaying_triangles(N, RATE, 300.0, 10, 0.0, 75.0, 30.0), float)
    turns = u[corners(u)]
    expected = [30.0 + (1 - j / 10) * (45.0 if j % 2 == 0 else -30.0) for j in range(10)]
    np.testing.assert_allclose(turns, expected, rtol=0, atol=0.16)  # one sample of the ramp
    assert u[-1] == pytest.approx(30.0, abs=1e-5)
    speed = np.abs(np.diff(u)) * RATE
    assert np.mean(np.isclose(speed, 300.0, rtol=0.02) | (speed < 0.02)) > 0.99


def test_staircase_against_a_loop():
    expected = np.repeat(15.0 * np.array([*range(5), *range(5, 0, -1)] * 4), 100)
    got = signals.staircase(N, RATE, 0.05, 5, 0.0, 75.0)
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-5)


def test_chirp_against_scipy(x64):
    t = np.arange(N) / RATE
    expected = 40.0 + 5.0 * oracle.chirp(t, 0.5, 2.0, 60.0, phi=-90)
    got = signals.chirp(N, RATE, 0.5, 60.0, 40.0, 5.0)
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-8)


def test_multisine_has_its_lines_and_no_others():
    lines = (3, 7, 20, 151)
    u = signals.multisine(jax.random.key(2), N, lines, 30.0, 12.0)
    spectrum = np.abs(np.fft.rfft(np.asarray(u, float) - 30.0))
    chosen = np.isin(np.arange(N // 2 + 1), lines)
    np.testing.assert_allclose(spectrum[chosen], spectrum[3], rtol=1e-4)
    assert spectrum[~chosen].max() < 1e-4 * spectrum[3]
    assert np.max(np.abs(np.asarray(u, float) - 30.0)) == pytest.approx(12.0, rel=1e-5)
    other = signals.multisine(jax.random.key(3), N, lines, 30.0, 12.0)
    assert np.std(np.asarray(u - other)) > 1.0


def test_bernoulli_ramp_against_a_loop(x64):
    """Oracle: walk sample by sample, turn round at the ends, obey the coin in between."""
    key, slope = jax.random.key(5), 333.3
    u = np.asarray(signals.bernoulli_ramp(key, N, RATE, 10.0, slope, 0.0, 75.0))
    coins = np.asarray(jax.random.uniform(key, (21,), "float32")) < 0.5
    place, mirrored, expected = 0.0, False, [0.0]
    for k in range(N - 1):
        step = slope / RATE if coins[k // 200] else -slope / RATE
        place += -step if mirrored else step
        if place < 0.0:
            place, mirrored = -place, not mirrored
        elif place > 75.0:
            place, mirrored = 150.0 - place, not mirrored
        expected.append(place)
    np.testing.assert_allclose(u, expected, rtol=0, atol=1e-8)


def test_random_steps_hold():
    u = np.asarray(signals.random_steps(jax.random.key(0), N, 1000.0, 0.11, 5.0, 9.0))
    blocks = u[: 36 * 110].reshape(36, 110)
    np.testing.assert_array_equal(blocks, np.broadcast_to(blocks[:, :1], blocks.shape))
    assert len(np.unique(u)) == 37
    assert 5.0 <= u.min() < u.max() <= 9.0


@pytest.fixture(scope="module")
def diagnostic():
    return signals.diagnostic_record(24.0, RATE, 0.0, 75.0)


def test_diagnostic_record_repeats_its_reference_loop(diagnostic):
    tops = np.flatnonzero(diagnostic > 75.0 - 1e-9)
    first, *loops = (diagnostic[top - 400 : top + 400] for top in (*tops[:3], tops[-1]))
    for loop in loops:
        np.testing.assert_allclose(loop, first, rtol=0, atol=1e-9)
    assert tops[-1] / len(diagnostic) > 0.95


def test_diagnostic_record_has_rates_holds_and_a_vibration(diagnostic):
    assert diagnostic.size == 48_000
    assert diagnostic[0] == 0.0
    assert diagnostic[-1] == pytest.approx(0.0, abs=1e-9)
    speed = np.abs(np.diff(diagnostic)) * RATE / 75.0
    for rate in (0.8, 4.0, 26.0):  # ranges a second: 1.5 decades
        assert np.sum(np.isclose(speed, rate, rtol=0.05)) > 50
    still = np.diff(np.concatenate([[0], speed < 1e-9, [0]]).astype(int))
    begins, ends = np.flatnonzero(still == 1), np.flatnonzero(still == -1)
    holds, moves = (ends - begins) / RATE, diagnostic[begins] - diagnostic[begins - 4]
    assert np.ptp(np.log10(holds[holds > 0.01])) >= 1.95
    assert np.sum((moves > 1.0) & (holds > 0.01)) >= 5
    assert np.sum((moves < -1.0) & (holds > 0.01)) >= 5
    # A vibration at rest: fast, small, about the middle.
    part = diagnostic[int(0.893 * 48_000) : int(0.955 * 48_000)]
    assert 3.0 < np.max(np.abs(part - 37.5)) < 10.0
    assert len(corners(part)) > 40


def test_diagnostic_record_fills_the_plane_and_has_equal_minor_loops_on_both_branches(diagnostic):
    turns = diagnostic[corners(diagnostic)]
    filled, _ = np.histogram(turns, np.linspace(0.0, 75.0, 13))
    assert np.all(filled >= 3)
    swing = np.diff(turns)
    for sign in (1.0, -1.0):
        starts = turns[:-1][np.isclose(swing, sign * 12.0, atol=0.2)]
        assert len(np.unique(np.round(starts / 5.0))) >= 5


def test_diagnostic_record_stretches_to_duration_and_range(diagnostic):
    short = signals.diagnostic_record(12.0, 2 * RATE, -1.0, 1.0)
    np.testing.assert_allclose((short + 1.0) * 37.5, diagnostic, rtol=0, atol=1e-9)
    assert diagnostic.min() == 0.0
    assert diagnostic.max() == 75.0


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: signals.triangle(0, 1.0, 0.5), "samples is 0"),
        (lambda: signals.triangle(9, 1.0, 0.6), "frequency_hz is 0.6"),
        (lambda: signals.multisine(KEY, 64, lines=(3.5,)), "whole numbers"),  # pyright: ignore
        (lambda: signals.multisine(KEY, 64, lines=(3, 3)), "only once"),
        (lambda: signals.bernoulli_ramp(0, 9, 1.0), "key is 0: make one"),  # pyright: ignore
        (lambda: signals.triangle(10, 1.0, 0.5, 5.0, 5.0), "low must be below high"),
        (lambda: signals.decaying_triangles(10, 1.0, 1.0, centre=80.0), "centre is 80.0"),
        (lambda: signals.chirp(10, 100.0, 1.0, 50.0), "high_hz is 50.0"),
        (lambda: signals.multisine(KEY, 10, (5,)), "lines are"),
        (lambda: signals.random_steps(KEY, 10, 1.0, 0.0), "hold_s is 0.0"),
        (lambda: signals.diagnostic_record(1.0, 1000.0), "too few"),
    ],
)
def test_what_cannot_be_played_is_refused(call, message):
    with pytest.raises(InputError, match=message):
        call()

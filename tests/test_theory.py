"""The convergence theory, eq. (13)-(25) and (27)-(31), against the filter, matrices and chance."""

import math
from fractions import Fraction

import jax
import numpy as np
import pytest
from oracles import slow_relays, wandering

from preisach_jax import AdaptiveFilter, InputError, Plane
from preisach_jax.theory import (
    auxiliary_norm,
    average_over_samples,
    check_bound,
    contraction_bound,
    error_after_period,
    error_recursion,
    every_triangle,
    expected_error,
    largest_slope,
    mean_output_error,
    measured_output,
    noise_coefficient,
    noise_gain_bound,
    noise_power,
    norm_factor,
    propagate_error,
    quantisation_noise_power,
    quantisation_step,
    residual_error_bound,
    residual_ratio_bound,
    switching_sum_bound,
)


def plane_of(levels):
    return Plane(levels=levels, low=0.0, high=float(levels))


def path(kind, levels, samples, seed=0):
    """Inputs whose steps pass no or one threshold (ramps), or several (jumps)."""
    rng = np.random.default_rng(seed)
    if kind == "jumps":
        return np.append(0.0, rng.uniform(0, levels, samples - 1))
    return wandering(plane_of(levels), samples, seed)


def switching(plane, x):
    """Samples at which relays switch, and their (events, cells) signs s."""
    s = np.diff(slow_relays(plane, x), axis=0, prepend=0)
    at = np.flatnonzero(s.any(axis=1))
    return at, s[at]


@jax.jit
def weights_and_errors(filt, x, z):
    def advance(state, sample):
        state, info = filt.step(state, *sample)
        return state, (state.weights, info.error)

    return jax.lax.scan(advance, filt.init(x[0], z[0]), (x, z))[1]


def noisy_run(plane, x, truth, noise, start):
    """Weight errors before the first and after each event, (1 + events, cells), s, and ν."""
    at, s = switching(plane, x)
    dtype = noise.dtype
    z = (slow_relays(plane, x) @ truth + noise).astype(dtype)
    filt = AdaptiveFilter(plane, initial_weight=start.astype(dtype))
    weights = np.asarray(weights_and_errors(filt, x.astype(dtype), z)[0])
    nu = np.diff(np.append(noise[0], noise[at]))
    return np.vstack([start, weights[at]]) - truth, s, nu


def squared(rows):
    return np.sum(np.square(rows), axis=-1)


# Noise, eq. (13)-(15)


def test_the_measured_output_is_the_weight_of_the_relays_that_are_on_and_noise(x64):
    plane, rng = plane_of(5), np.random.default_rng(0)
    x, weights, noise = path("jumps", 5, 60), rng.uniform(0, 1, 15), rng.normal(0, 1, 60)
    relays = slow_relays(plane, x)
    expected = [weights[on == 1].sum() + n for on, n in zip(relays, noise, strict=True)]
    np.testing.assert_allclose(measured_output(plane, weights, x, noise), expected, rtol=1e-13)
    np.testing.assert_allclose(noise_power(noise), np.vdot(noise, noise) / 60, rtol=1e-13)
    with pytest.raises(InputError, match=r"noise has the shape \(59,\) and x \(60,\)"):
        measured_output(plane, weights, x, noise[1:])


# Bounds, eq. (16)-(25)


@pytest.mark.parametrize("levels", [2, 4])
def test_every_triangle_is_created_and_all_relays_end_off(levels):
    plane = plane_of(levels)
    x = every_triangle(plane)
    states = slow_relays(plane, x)
    assert len(x) - 1 == 3 * plane.cells - levels
    assert not states[0].any()
    assert not states[-1].any()
    switched = {frozenset(np.flatnonzero(row)) for row in np.diff(states, axis=0)}
    for a, b in zip(plane.alpha_index, plane.beta_index, strict=True):
        triangle = (plane.alpha_index <= a) & (plane.beta_index >= b)
        assert frozenset(np.flatnonzero(triangle)) in switched


@pytest.mark.parametrize("sigma", [0.0, 3e-6, 1.0])
def test_a_period_with_every_triangle_is_within_its_bounds(sigma, x64):
    """Eq. (16), which says something in little noise only, and (17), for several draws."""
    levels = 4
    plane = plane_of(levels)
    x = every_triangle(plane)
    T = len(x) - 1
    for seed in range(2):
        rng = np.random.default_rng(seed)
        truth, start = rng.uniform(0, 1, (2, plane.cells))
        errors, s, nu = noisy_run(plane, x, truth, rng.normal(0, sigma, T + 1), start)
        assert len(nu) == T  # every step switches
        initial, largest = squared(errors[0]), np.max(np.sum(s * errors[:-1], axis=1) ** 2)
        lower = initial / (16 * levels * (levels * T + 2) ** 2) - T * levels**2 * squared(nu)
        np.testing.assert_allclose(switching_sum_bound(initial, nu, T, levels), lower, rtol=1e-10)
        assert (lower > 0) == (sigma < 1)
        assert largest >= lower
        upper = (1 - 1 / (16 * levels * (levels * T + 2) ** 2)) * initial
        upper += (T**2 * levels**2 + T) / T * squared(nu)
        np.testing.assert_allclose(error_after_period(initial, nu, T, levels), upper, rtol=1e-10)
        assert squared(errors[-1]) <= upper


def test_the_expected_error_is_within_its_bounds_after_every_period():
    """Eq. (19)-(21) against the exact moments."""
    levels, periods, W = 4, 12, 0.3
    plane = plane_of(levels)
    once = every_triangle(plane)
    T = len(once) - 1
    x = np.append(once[:1], np.tile(once[1:], periods))
    start = np.random.default_rng(0).uniform(-1, 1, plane.cells)
    moments = propagate_error(plane, x, start, W)
    exact = (moments.mean_squared + moments.variance)[T - 1 :: T]
    assert len(exact) == periods
    before = squared(start)
    for period, after in enumerate(exact, start=1):
        assert after <= expected_error(before, W, T, levels)  # (19)
        assert after <= expected_error(squared(start), W, T, levels, period)  # (20)
        before = after
    assert moments.variance[-1] <= residual_error_bound(W, T, levels)  # (21)
    assert np.all(np.diff(moments.mean_squared[T - 1 :: T]) < 0)


@pytest.mark.parametrize(("T", "N"), [(1, 2), (15, 3), (300, 37)])
def test_the_constants_are_those_of_the_paper(T, N):
    C, D = Fraction(1, 16 * N * (N * T + 2) ** 2), Fraction(T**2 * N**2)  # (24)
    q, B = 1 - C, D + T  # (18)
    np.testing.assert_allclose(contraction_bound(T, N), float(C), rtol=1e-14)
    np.testing.assert_allclose(noise_gain_bound(T, N), float(D), rtol=1e-14)
    np.testing.assert_allclose(error_recursion(T, N), [float(q), float(B)], rtol=1e-14)
    # (24), (18) and (21) give (25), as whole numbers exactly.
    ratio = 32 * N * T * (N * T + 2) ** 2 * (T * N**2 + 1)
    assert ratio == 2 * B / C
    np.testing.assert_allclose(residual_ratio_bound(T, N), ratio, rtol=1e-14)
    np.testing.assert_allclose(residual_error_bound(0.7, T, N), 0.7 * ratio, rtol=1e-13)
    one = float(q * 2 + 2 * B * Fraction(1, 2))
    np.testing.assert_allclose(expected_error(2.0, 0.5, T, N), one, rtol=1e-13)
    three = float(q**3 * 2 + 2 * B / C * Fraction(1, 2))
    np.testing.assert_allclose(expected_error(2.0, 0.5, T, N, periods=3), three, rtol=1e-9)


def test_random_periods_enter_by_their_means():
    """Eq. (22) and (23)."""
    T, N, W, start = np.array([7, 9, 20]), 2, 0.1, 3.0
    C = np.mean([1 / (16 * N * (N * t + 2) ** 2) for t in T])
    B = np.mean([t**2 * N**2 + t for t in T])
    long_run = 2 * B / C * W
    np.testing.assert_allclose(residual_error_bound(W, T, N), long_run, rtol=1e-12)
    expected = (1 - C) ** 5 * start + long_run
    np.testing.assert_allclose(expected_error(start, W, T, N, periods=5), expected, rtol=1e-10)


ONE, UP = np.array([1.0]), np.array([0.0, 2.0])


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: contraction_bound(0, 2), r"T is 0\.0: it must be at least 1"),
        (lambda: noise_gain_bound(2, 0.5), r"N is 0\.5: it must be at least 1"),
        (lambda: error_recursion(math.nan, 2), "T is nan"),
        (lambda: residual_error_bound(-1.0, 3, 2), r"noise_variance is -1\.0: give 0 or"),
        (lambda: propagate_error(plane_of(2), UP, 0.0, math.nan), "noise_variance is nan"),
        (lambda: propagate_error(plane_of(2), UP, ONE), r"shape \(1,\): give .* \(3,\)"),
        (lambda: average_over_samples(ONE, 3 * ONE, 2, 9), r"2 to 9.* first event, at sample 3\.0"),
        (lambda: average_over_samples(ONE, 3 * ONE, 5, 5), "5 to 5: it must not be empty"),
        (lambda: mean_output_error(ONE), "there are 1 errors: give at least 2"),
        (lambda: largest_slope(UP, ONE), r"shape \(2,\) and z \(1,\)"),
        (lambda: largest_slope(0 * UP, UP), "x crosses no two lines"),
        (lambda: check_bound(1), "levels is 1"),
        (lambda: check_bound(2, periods=0), "periods is 0"),
        (lambda: noise_coefficient(plane_of(2), UP[[0, 1, 1]], 1, 9), "last is 9: give at most 3"),
        (lambda: norm_factor(plane_of(2), UP[[0, 1, 1, 1]], 2, 4), "2 to 4: give one in which"),
        (lambda: average_over_samples(UP, np.array([3, 0]), 3, 5), "not in order"),
    ],
)
def test_what_cannot_be_used_is_refused(call, message):
    with pytest.raises(InputError, match=message):
        call()


# The example's numbers, eq. (27)-(31)


def test_the_largest_slope_of_known_curves():
    x = 40 + 35 * np.sin(np.linspace(0, 6 * np.pi, 20_001))
    for z, steepest in [(2.5 * x, 2.5), (-1.5 * x, -1.5), (10 * np.tanh((x - 40) / 10), 1.0)]:
        np.testing.assert_allclose(largest_slope(x, z), steepest, rtol=0.01)
    # Between lines 2 % apart, z = x² on [0, 1] is steepest from 0.98 to 1.
    ramp = np.linspace(0, 1, 10_001)
    np.testing.assert_allclose(largest_slope(ramp, ramp**2), 1.98, atol=0.001)
    np.testing.assert_allclose(largest_slope(ramp, ramp**2, span=0.1), 1.9, atol=0.001)


def test_quantisation_and_averages_are_their_closed_forms():
    delta_x = 75 / np.array([75, 37, 9])
    np.testing.assert_allclose(quantisation_step(2.53, delta_x), 2.53 * delta_x, rtol=1e-15)
    power = quantisation_noise_power(2.53, delta_x)
    np.testing.assert_allclose(power, 2.53**2 * delta_x**2 / 12, rtol=1e-14)
    e = np.random.default_rng(0).normal(0, 2, 50)
    np.testing.assert_allclose(mean_output_error(e), math.sqrt(sum(e * e) / 49), rtol=1e-14)
    L, mean = np.array([45.0, 703.0]), np.array([1.5, 0.3])
    expected = np.sqrt((mean / L) ** 2 * L)  # (31) as it stands
    np.testing.assert_allclose(auxiliary_norm(mean, L), expected, rtol=1e-14)


# Moments of the weight error


def dense_moments(plane, x, start, W):
    """Mean and covariance of (E, n) by full matrices; ‖⟨E⟩‖², tr Cov(E), Var e of each event."""
    _, signs = switching(plane, x)
    mean = np.append(start, 0.0)
    covariance = np.zeros((mean.size, mean.size))
    covariance[-1, -1] = W  # noise of the first sample
    rows = []
    for s in signs:
        A = np.abs(s).sum()
        step = np.zeros_like(covariance)
        step[:-1, :-1] = np.eye(plane.cells) - np.outer(s, s) / A
        step[:-1, -1] = -s / A
        gain = np.append(s / A, 1.0)
        error = np.append(s, 1.0)  # e = n - (s, 1)·(E, n')
        output_variance = error @ covariance @ error + W
        mean = step @ mean
        covariance = step @ covariance @ step.T + W * np.outer(gain, gain)
        rows.append((squared(mean[:-1]), np.trace(covariance[:-1, :-1]), output_variance))
    return np.array(rows).T, mean[:-1], covariance[:-1, :-1]


@pytest.mark.parametrize("kind", ["ramps", "jumps"])
def test_moments_are_those_of_the_dense_recursion(kind, x64):
    plane, W = plane_of(5), 0.3
    x = path(kind, 5, 250)
    start = np.random.default_rng(0).uniform(-1, 1, plane.cells)
    (mean_squared, variance, of_output), mean, covariance = dense_moments(plane, x, start, W)
    found = propagate_error(plane, x, start, W)
    np.testing.assert_array_equal(found.sample, switching(plane, x)[0])
    np.testing.assert_allclose(found.mean_squared, mean_squared, rtol=1e-10)
    np.testing.assert_allclose(found.variance, variance, rtol=1e-10)
    np.testing.assert_allclose(found.output_variance, of_output, rtol=1e-10)
    np.testing.assert_allclose(found.mean, mean, atol=1e-12)
    np.testing.assert_allclose(found.covariance, covariance, atol=1e-12)


def test_the_practical_coefficient_is_the_average_of_what_noise_adds(x64):
    plane, x = plane_of(4), path("ramps", 4, 200)
    (_, variance, of_output), _, _ = dense_moments(plane, x, np.zeros(plane.cells), 1.0)
    at = switching(plane, x)[0]
    course = np.repeat(variance, np.diff(np.append(at, 200)))
    expected = course[50 - at[0] :].mean()
    shown = []
    found = noise_coefficient(plane, x, 50, 200, progress=lambda *now: shown.append(now))
    np.testing.assert_allclose(found, expected, rtol=1e-10)
    assert shown[0] == (f"covariance of {plane.cells} weights", 0.0)
    factor = math.sqrt(expected / of_output[at >= 50].mean())
    assert norm_factor(plane, x, 50, 200) == pytest.approx(factor, rel=1e-10)


def test_the_bound_is_compared_on_the_input_that_it_asks_for():
    levels, periods = 4, 5
    plane = plane_of(levels)
    once = every_triangle(plane)
    x = np.append(once[:1], np.tile(once[1:], periods))
    (_, variance, _), _, _ = dense_moments(plane, x, np.zeros(plane.cells), 1.0)
    check = check_bound(levels, periods)
    T = len(once) - 1
    bound = 32 * levels * T * (levels * T + 2) ** 2 * (T * levels**2 + 1)
    assert (check.levels, check.steps, check.bound) == (levels, T, bound)
    np.testing.assert_allclose(check.ratio, variance[-1], rtol=1e-10)
    np.testing.assert_allclose(check.orders, math.log10(bound / variance[-1]), rtol=1e-10)
    assert check.ratio < check.bound

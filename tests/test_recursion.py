"""Recursive least squares against the batch problem that it claims to solve, and the comparison."""

from typing import Any, cast

import jax
import numpy as np
import pytest
from oracles import PLANE, SAMPLES, slow_states, wandering

from preisach_jax import (
    AdaptiveFilter,
    InputError,
    Plane,
    RecursiveLeastSquares,
    compare_recursions,
    simulate,
)
from preisach_jax.operator.inputs import HYSTERONS
from preisach_jax.plant import make_stage
from preisach_jax.signals import bernoulli_ramp

both_kinds = pytest.mark.parametrize("hysteron", HYSTERONS)
pytestmark = pytest.mark.usefixtures("x64")


def record(hysteron, seed=0, noise=0.1, samples=SAMPLES):
    """Input, states along it, true weights, and a noisy output with an offset and gaps."""
    rng = np.random.default_rng(seed)
    x = wandering(samples=samples, seed=seed + 1)
    states = slow_states(PLANE, x, hysteron)
    truth = rng.uniform(0.1, 1.0, PLANE.cells)
    z = 50.0 + states @ truth + rng.normal(0, noise, samples)
    z[5:][rng.random(samples - 5) < 0.2] = np.nan
    return x, z, states, truth


def events_of(states, z):
    """Samples of the first measured output and of all events after it."""
    found = [int(np.argmax(np.isfinite(z)))]
    for k in range(found[0] + 1, len(z)):
        if np.isfinite(z[k]) and np.sum((states[k] - states[found[-1]]) ** 2) >= 0.5:
            found.append(k)
    return found


def batch(states, z, events, forgetting, start, variance):
    """Information matrix and minimiser of the sum in the docstring, with the prior's strengths."""
    cells = len(start)
    information = np.zeros((cells + 1, cells + 1))
    right = np.zeros(cells + 1)
    ages = len(events) - 1 - np.arange(len(events))
    strengths = np.full(cells, forgetting ** float(ages[0]) / variance)
    restored = (1 - forgetting**cells) / variance
    for turn, (k, age) in enumerate(zip(events, ages, strict=True)):
        row = np.append(states[k], 1.0)
        information += forgetting ** float(age) * np.outer(row, row)
        right += forgetting ** float(age) * z[k] * row
        if turn:
            strengths[(turn - 1) % cells] += forgetting ** float(age) * restored
    information[np.arange(cells), np.arange(cells)] += strengths
    right[:cells] += strengths * start
    return information, np.linalg.solve(information, right), strengths


@pytest.mark.parametrize(
    ("hysteron", "forgetting"), [("relay", 0.995), ("ramp", 1.0), ("ramp", 0.9)]
)
def test_the_estimates_are_those_of_the_batch(hysteron, forgetting):
    x, z, states, _ = record(hysteron)
    start = np.random.default_rng(3).uniform(0, 1, PLANE.cells)
    result = RecursiveLeastSquares(PLANE, hysteron, forgetting, start, 30.0).run(x, z)
    events = events_of(states, z)
    assert len(events) > 50
    information, expected, strengths = batch(states, z, events, forgetting, start, 30.0)
    np.testing.assert_allclose(result.weights, expected[:-1], rtol=1e-9, atol=1e-10)
    assert float(result.offset) == pytest.approx(expected[-1], rel=1e-10)
    covariance = np.asarray(result.state.covariance)
    np.testing.assert_array_equal(covariance, covariance.T)
    np.testing.assert_allclose(covariance @ information, np.eye(len(expected)), atol=1e-8)
    least = forgetting**PLANE.cells / 30
    assert np.all((strengths >= least * (1 - 1e-12)) & (strengths <= 2 / 30))


@both_kinds
def test_the_rows_are_those_before_each_update(hysteron):
    x, z, states, _ = record(hysteron)
    z[:3] = np.nan
    result = RecursiveLeastSquares(PLANE, hysteron, 0.98, 0.2, 10.0).run(x, z)
    events = events_of(states, z)
    assert events[0] == 3
    np.testing.assert_array_equal(np.flatnonzero(result.switched), events[1:])
    moves = np.sum(np.diff(states[events], axis=0) ** 2, axis=1)
    np.testing.assert_allclose(np.asarray(result.switched)[events[1:]], moves, rtol=1e-12)
    assert np.isnan(np.asarray(result.output)[:4]).all()
    np.testing.assert_array_equal(np.isnan(result.error), np.isnan(z) | (np.arange(len(z)) < 4))
    for count in (1, 2, 30, 31, len(events) - 1):
        past = events[:count]
        before = batch(states, z, past, 0.98, np.full(PLANE.cells, 0.2), 10.0)[1]
        for k in range(past[-1] + 1, events[count] + 1):
            output = states[k] @ before[:-1] + before[-1]
            assert float(result.output[k]) == pytest.approx(output, abs=1e-8)
            if np.isfinite(z[k]):
                assert float(result.error[k]) == pytest.approx(z[k] - output, abs=1e-8)


def test_steps_and_runs_continue_each_other():
    x, z, _, _ = record("ramp")
    z[:7] = np.nan
    filt = RecursiveLeastSquares(PLANE, "ramp", 0.99)
    whole = filt.run(x, z)
    step = jax.jit(RecursiveLeastSquares.step)
    state, rows = filt.init(x[0], z[0]), []
    for k in range(150):
        state, info = step(filt, state, x[k], z[k])
        rows.append(info)
    for name in ("output", "error", "switched"):
        stepped = np.array([getattr(row, name) for row in rows])
        np.testing.assert_allclose(stepped, getattr(whole, name)[:150], atol=1e-9)
    rest = filt.run(x[150:], z[150:], state)
    np.testing.assert_allclose(rest.output, whole.output[150:], atol=1e-9)
    np.testing.assert_allclose(rest.weights, whole.weights, atol=1e-10)
    assert int(rest.state.turn) == int(whole.state.turn)


def test_forgetting_does_not_wind_up_cells_that_are_not_visited():
    """Bare forgetting would multiply their variance by λ⁻ⁿ, here above 10⁷."""
    x = wandering(high=3.0, seed=7, speed=1.3)
    states = slow_states(PLANE, x, "ramp")
    truth = np.random.default_rng(8).uniform(0.1, 1.0, PLANE.cells)
    forgetting, variance = 0.9, 50.0
    filt = RecursiveLeastSquares(PLANE, "ramp", forgetting, 0.3, variance)
    result = filt.run(x, states @ truth)
    assert forgetting ** -np.count_nonzero(result.switched) > 1e7
    covariance = np.asarray(result.state.covariance)
    visited = np.ptp(states, axis=0) > 0
    variances = np.diag(covariance)[:-1]
    assert variances.max() <= variance / forgetting**PLANE.cells
    assert np.linalg.eigvalsh(covariance).min() > 0
    # What was not seen stays as it was.
    np.testing.assert_allclose(result.weights[~visited], 0.3, atol=1e-12)
    assert variances[~visited].min() >= variance / 2


def test_single_precision_is_refused_and_raised_where_it_can_be():
    x, z, _, _ = record("ramp", samples=50)
    filt = RecursiveLeastSquares(PLANE, "ramp")
    result = filt.run(x.astype("float32"), z.astype("float32"))
    assert {leaf.dtype.name for leaf in jax.tree.leaves(result)} == {"float64", "int64"}
    with jax.enable_x64(False):
        for call in (lambda: filt.run(x, z), lambda: filt.init(0.0, 0.0)):
            with pytest.raises(InputError, match=r"float32.*needs float64.*jax_enable_x64"):
                call()


def test_mistakes_are_named_with_their_values():
    filt, reals, anything = RecursiveLeastSquares(PLANE), np.arange(7.0), cast(Any, 5)
    other = RecursiveLeastSquares(Plane(levels=3, low=0.0, high=1.0)).init(0.0, 0.0)

    def of(*arguments: Any):
        return lambda: RecursiveLeastSquares(PLANE, *arguments)

    for call, message in (
        (of("relay", 1.01), r"forgetting is 1\.01: with 15 cells give a number from 0"),
        (of("relay", np.ones(2)), r"forgetting has the shape \(2,\)"),
        (of("relay", 1.0, np.zeros(4)), r"initial_weight has the shape \(4,\): .*\(15,\)"),
        (of("relay", 1.0, 0.0, 0.0), r"initial_variance is 0\.0: give a number above 0"),
        (of("relay", 1.0, 0.0, None), "initial_variance is None: give one number"),
        (lambda: filt.run(reals, np.zeros(3)), r"\(7,\).*\(3,\)"),
        (lambda: filt.run(reals[:1], np.array([np.inf])), "z is inf: give NaN"),
        (lambda: filt.run(reals, reals, other), r"\(6,\).*\(15,\)"),
        (lambda: filt.run(reals, reals, anything), "the state is int: give a LeastSquaresState"),
        (lambda: RecursiveLeastSquares(anything), "the plane is 5: give a Plane"),
        (
            lambda: compare_recursions(anything, reals, reals, reals, reals),
            "the plane is 5: give a Plane",
        ),
    ):
        with pytest.raises(InputError, match=message):
            call()


def test_least_squares_replays_what_one_pass_of_the_filter_does_not():
    """On a smooth stage that is no grid, with noise; the rows are what the runs give by hand."""
    plane, stage = Plane(levels=9, low=0.0, high=75.0), make_stage(seed=2)
    x, new = (np.asarray(bernoulli_ramp(jax.random.key(k), 3000, 1000.0)) for k in (1, 2))
    z, new_z = stage.hysteresis(x), 3.0 + stage.hysteresis(new)
    z = z + np.random.default_rng(0).normal(0, 0.5, len(z))
    rows = compare_recursions(plane, x, z, new, new_z, "ramp", (1, 2), (0.5,), (1.0,))
    assert [row.name for row in rows] == [
        "adaptive filter, 1 pass",
        "adaptive filter, 2 passes",
        "adaptive filter, step size 0.5",
        "least squares, forgetting 1",
    ]
    one, two, half, best = rows
    assert best.replay < 0.01
    assert best.replay < 0.8 * half.replay
    assert best.replay < 0.2 * min(one.replay, two.replay)
    result = AdaptiveFilter(plane, "ramp", step_size=0.5).run(x, z)
    left = new_z - np.asarray(simulate(plane, result.weights, new))
    late = np.asarray(result.error)[1500:][np.asarray(result.switched)[1500:] > 0]
    assert half.replay == pytest.approx(np.std(left) / np.ptp(new_z))
    assert half.error == pytest.approx(np.sqrt(np.mean(late**2)) / np.ptp(new_z))

"""The model's output and the adaptive filter, eq. (5)-(12) and (15), against literal oracles."""

import dataclasses
import json
import warnings
from typing import Any

import hypothesis.strategies as st
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from oracles import slow_relays

from preisach_jax.errors import InputError, PrecisionWarning
from preisach_jax.filter import adaptive, checks
from preisach_jax.filter.adaptive import AdaptiveFilter
from preisach_jax.filter.least_squares import RecursiveLeastSquares
from preisach_jax.filter.online import OnlineFilter
from preisach_jax.operator import simulation
from preisach_jax.operator.checks import HYSTERONS
from preisach_jax.operator.hysteron import hysteron_step
from preisach_jax.operator.plane import Plane
from preisach_jax.operator.simulation import simulate
from preisach_jax.operator.states import hysteron_states

PLANE = Plane(levels=6, low=0.0, high=6.0)
SAMPLES = 300

both_kinds = pytest.mark.parametrize("hysteron", HYSTERONS)
both_samplings = pytest.mark.parametrize("sampling", ["event", "sample"])


def true_weights(plane, dtype="float64", seed=0):
    return np.random.default_rng(seed).uniform(0.1, 1.0, plane.cells).astype(dtype)


def wandering(samples=SAMPLES, plane=PLANE, seed=1, speed=0.37, dtype="float64"):
    """Ramps between random turning points: several samples to a level, so that many switch none."""
    rng = np.random.default_rng(seed)
    path, goal = [plane.low], plane.high
    while len(path) < samples:
        move = np.clip(goal - path[-1], -speed * plane.delta_x, speed * plane.delta_x)
        path.append(path[-1] + move)
        if path[-1] == goal:
            goal = rng.uniform(plane.low, plane.high)
    return np.array(path, dtype)


def slow_filter(plane, x, z, sampling, weight=1e-9):
    """The recursion with sets, eq. (6)-(8), (10)-(12); weights before each sample, e and A."""
    relays = slow_relays(plane, x).astype(bool)
    weights, reference = np.full(plane.cells, weight), z[0]
    before, errors, areas, outputs = [], [], [], []
    for k, now in enumerate(relays):
        last = relays[max(k - 1, 0)]
        switched_on, switched_off = now & ~last, last & ~now
        area = switched_on.sum() + switched_off.sum()
        error = z[k] - reference - weights[now].sum() + weights[last].sum()
        before.append(weights.copy())
        outputs.append(weights[now].sum())
        errors.append(error)
        areas.append(area)
        if area:
            weights[switched_on] += error / area
            weights[switched_off] -= error / area
        if area or sampling == "sample":
            reference = z[k]
    before.append(weights)
    return np.array(before), np.array(outputs), np.array(errors), np.array(areas)


@jax.jit
def scan_trajectory(filt, x, z):

    def advance(state, sample):
        state, info = filt.step(state, *sample)
        return state, (state.weights, info)

    return jax.lax.scan(advance, filt.init(x[0], z[0]), (x, z))[1]


def trajectory(filt, x, z):
    """Weights after each sample, (time, cells), and what `step` records, as NumPy arrays."""
    return jax.tree.map(np.asarray, scan_trajectory(filt, x, z))


def differences(function, point, step):
    """Central finite differences of `function` in each direction from `point`."""
    moves = step * np.eye(point.size)
    above, below = (jax.vmap(function)(point[np.newaxis] + side * moves) for side in (1, -1))
    return np.asarray(above - below) / (2 * step)


states_of = jax.jit(hysteron_states, static_argnames=("initial_states", "hysteron"))


def test_output_is_the_weight_of_the_relays_that_are_on(precision, tolerance):
    x, weights = wandering(dtype=precision), true_weights(PLANE, precision)
    relays = slow_relays(PLANE, x)
    z = np.asarray(simulate(PLANE, weights, x, "relay"))
    assert z.dtype == precision
    expected = [weights[row == 1].sum() for row in relays]  # (6)
    np.testing.assert_allclose(z, expected, rtol=tolerance, atol=tolerance)
    # (5) with states of ±1 is another quantity: twice as large, less a constant.
    signed = (2 * relays - 1) @ weights
    np.testing.assert_allclose(signed, 2 * z - weights.sum(), atol=weights.sum() * tolerance)


@both_kinds
def test_output_is_the_weighted_sum_of_the_states(hysteron, precision, tolerance):
    x, weights = wandering(dtype=precision), true_weights(PLANE, precision)
    states = states_of(PLANE, x, "demagnetised", hysteron)
    z = simulate(PLANE, weights, x, hysteron, "demagnetised")
    np.testing.assert_allclose(z, np.asarray(states) @ weights, rtol=tolerance, atol=tolerance)


@both_kinds
@pytest.mark.parametrize("samples", [1, 2, 97])
def test_simulating_a_part_gives_that_part(hysteron, samples, x64):
    x, weights = wandering(), true_weights(PLANE)
    whole = simulate(PLANE, weights, x, hysteron)
    part = simulate(PLANE, weights, x[:samples], hysteron)
    np.testing.assert_array_equal(part, whole[:samples])


@both_kinds
def test_output_does_not_depend_on_how_the_path_is_sampled(hysteron, precision):
    x, weights = wandering(dtype=precision), true_weights(PLANE, precision)
    fine = np.interp(np.arange(0, SAMPLES - 0.99, 0.01), np.arange(SAMPLES), x).astype(precision)
    fine[::100] = x
    # Rounding of the interpolation must not step over an end of its interval.
    ends = np.minimum(x[:-1], x[1:]).repeat(100), np.maximum(x[:-1], x[1:]).repeat(100)
    fine[:-1] = np.clip(fine[:-1], *ends)
    coarse = simulate(PLANE, weights, x, hysteron)
    np.testing.assert_array_equal(simulate(PLANE, weights, fine, hysteron)[::100], coarse)


def test_equal_minor_loops_are_congruent(x64):
    weights = true_weights(PLANE)
    loop = np.concatenate([np.linspace(4.3, 1.9, 20), np.linspace(1.9, 4.3, 20)])
    shapes = []
    for history in ([0.0, 4.3], [6.0, 1.9], [0.0, 5.2, 0.6]):
        z = np.asarray(simulate(PLANE, weights, np.concatenate([history, loop, loop])))[-40:]
        shapes.append(z - z[0])
    assert np.ptp(shapes[0]) > 0.5
    np.testing.assert_allclose(shapes[1], shapes[0], atol=1e-13)
    np.testing.assert_allclose(shapes[2], shapes[0], atol=1e-13)


@both_kinds
def test_gradient_of_the_simulation_matches_finite_differences(hysteron, x64):
    x, weights = wandering(30), true_weights(PLANE)

    def loss(weights, x):
        return (simulate(PLANE, weights, x, hysteron) ** 2).sum()

    by_weights, by_input = jax.jit(jax.grad(loss, (0, 1)))(weights, x)
    assert np.abs(by_weights).max() > 1
    numeric = differences(lambda weights: loss(weights, x), weights, 1e-6)
    np.testing.assert_allclose(by_weights, numeric, rtol=1e-6, atol=1e-5)
    # At both ends of the range the input lies on a corner of the outermost ramps.
    inside = (x > 0.05) & (x < 5.95)
    numeric = differences(lambda x: loss(weights, x), x, 1e-6)
    np.testing.assert_allclose(by_input[inside], numeric[inside], rtol=1e-6, atol=1e-5)
    assert (np.abs(by_input[inside]).max() > 1) == (hysteron == "ramp")


@both_samplings
def test_relay_filter_matches_the_recursion_with_sets(sampling, precision, tolerance):
    x = wandering(dtype=precision)
    z = (3 * np.sin(x) + x).astype(precision)
    before, outputs, errors, areas = slow_filter(PLANE, x, z, sampling)
    result = AdaptiveFilter(PLANE, "relay", sampling).run(x, z)
    assert {a.dtype.name for a in result[:4]} == {precision}
    np.testing.assert_array_equal(result.switched, areas)
    np.testing.assert_allclose(result.error, errors, atol=20 * tolerance)
    np.testing.assert_allclose(result.output, outputs, atol=20 * tolerance)
    np.testing.assert_allclose(result.weights, before[-1], atol=20 * tolerance)


def test_error_is_the_signed_sum_of_the_weight_errors(precision, tolerance):
    """Eq. (7), to rounding, at every sample of a noise-free truth on the grid."""
    x, truth = wandering(dtype=precision), true_weights(PLANE, precision)
    relays = slow_relays(PLANE, x)
    z = (relays @ truth).astype(precision)
    weights, info = trajectory(AdaptiveFilter(PLANE), x, z)
    before = np.vstack([np.full(PLANE.cells, 1e-9), weights[:-1]])
    s = np.diff(relays, axis=0, prepend=relays[:1])
    expected = np.sum(s * (truth - before), axis=1)
    assert np.abs(expected).max() > 1
    np.testing.assert_allclose(info.error, expected, atol=2 * tolerance)


def test_only_switching_weights_move_and_all_by_the_same(precision):
    """Eq. (8), (10)-(12)."""
    x, truth = wandering(dtype=precision), true_weights(PLANE, precision)
    relays = slow_relays(PLANE, x)
    z = (relays @ truth).astype(precision) + np.cos(np.arange(SAMPLES)).astype(precision)
    weights, info = trajectory(AdaptiveFilter(PLANE), x, z)
    moves = np.diff(np.asarray(weights), axis=0, prepend=np.full((1, PLANE.cells), 1e-9, precision))
    s = np.diff(relays, axis=0, prepend=relays[:1])
    eps = np.finfo(precision).eps
    assert np.all(moves[s == 0] == 0)
    assert 0 < np.count_nonzero(info.switched) < SAMPLES
    for move, sign, error, area in zip(moves, s, info.error, info.switched, strict=True):
        if area:
            rate = float(error) / float(area)
            np.testing.assert_allclose(move[sign != 0], rate * sign[sign != 0], atol=32 * eps)


@both_kinds
@both_samplings
def test_weight_error_never_grows_without_noise(hysteron, sampling, x64):
    """Eq. (9); with the truth on the grid, for the raw form as well."""
    x, truth = wandering(), true_weights(PLANE)
    states = np.asarray(states_of(PLANE, x, "low", hysteron))
    weights, _ = trajectory(AdaptiveFilter(PLANE, hysteron, sampling), x, states @ truth)
    norms = np.linalg.norm(np.asarray(weights) - truth, axis=1)
    assert np.all(np.diff(norms) <= 1e-12)
    assert norms[-1] < 0.7 * norms[0]


@both_kinds
def test_weight_error_falls_exponentially_without_noise(hysteron, x64):
    """Eq. (9): ‖E(k)‖ ≤ C exp(-λk), fitted over many orders of magnitude."""
    plane = Plane(levels=4, low=0.0, high=6.0)
    x = np.random.default_rng(5).uniform(0, 6, 6000)
    truth = true_weights(plane)
    z = np.asarray(simulate(plane, truth, x, hysteron))
    weights, _ = trajectory(AdaptiveFilter(plane, hysteron), x, z)
    norms = np.linalg.norm(np.asarray(weights) - truth, axis=1)
    above_rounding = norms > 1e-11
    k = np.arange(len(x))[above_rounding]
    logarithm = np.log(norms[above_rounding])
    slope, _ = np.polyfit(k, logarithm, 1)
    assert norms[-1] < 1e-6 * norms[0]
    assert slope < -1e-3
    assert np.corrcoef(k, logarithm)[0, 1] ** 2 > 0.98


@pytest.mark.parametrize("step_size", [1.0, 0.3, 1.7])
@both_samplings
@both_kinds
def test_error_identity_holds_at_every_step_with_noise(
    hysteron, sampling, step_size, precision, tolerance
):
    """Eq. (15), ‖E(k+1)‖² = ‖E(k)‖² - (ΣE)²/A + ν²/A, and its form for any step size.

    The truth is on the grid; for ramps A is sᵀs.
    """
    x, truth = wandering(dtype=precision), true_weights(PLANE, precision)
    states = np.asarray(states_of(PLANE, x, "low", hysteron), float)
    noise = np.random.default_rng(10).normal(0, 0.3, SAMPLES)
    z = (states @ truth + noise).astype(precision)
    filt = AdaptiveFilter(PLANE, hysteron, sampling, step_size=step_size)
    weights, info = trajectory(filt, x, z)
    after = np.asarray(weights, float) - truth
    before = np.vstack([1e-9 - truth.astype(float), after[:-1]])
    rate, reference = step_size, 0
    for k in range(SAMPLES):
        expected, allowed = np.sum(before[k] ** 2), 40 * tolerance
        if info.switched[k]:
            s = states[k] - states[reference]
            area, total, nu = s @ s, s @ before[k], noise[k] - noise[reference]
            assert float(info.switched[k]) == pytest.approx(area, abs=tolerance)
            expected += (
                rate**2 * nu**2 - rate * (2 - rate) * total**2 + 2 * rate * (1 - rate) * nu * total
            ) / area
            allowed /= min(area, 1.0)  # a small move multiplies the rounding of the states
        assert np.sum(after[k] ** 2) == pytest.approx(expected, rel=tolerance, abs=allowed)
        if info.switched[k] or sampling == "sample":
            reference = k
    assert np.count_nonzero(info.switched) > 30


def test_a_step_is_that_part_of_the_whole_one(precision):
    x = wandering(40, speed=1.2, dtype=precision)
    filt = AdaptiveFilter(PLANE)
    state = filt.run(x[:-1], np.sin(x[:-1])).state
    whole = filt.step(state, x[-1], 5.0)[0].weights - state.weights
    for step_size in (0.25, 1.5):
        part = AdaptiveFilter(PLANE, step_size=step_size).step(state, x[-1], 5.0)[0]
        rtol = 100 * np.finfo(precision).eps
        np.testing.assert_allclose(
            part.weights - state.weights, step_size * whole, rtol=rtol, atol=rtol
        )
    assert np.abs(whole).max() > 0.1


def test_a_sweep_of_step_sizes_is_a_loop_over_them(x64):
    x = wandering()
    z = np.sin(x) + x

    def weights(step_size):
        return AdaptiveFilter(PLANE, "ramp", step_size=step_size).run(x, z).weights

    step_sizes = np.array([0.05, 0.5, 1.0, 1.9])
    loop = np.array([weights(step_size) for step_size in step_sizes])
    np.testing.assert_allclose(jax.vmap(weights)(step_sizes), loop, atol=1e-12)
    assert np.abs(np.diff(loop, axis=0)).max(axis=1).min() > 1e-3


def test_a_smaller_step_averages_over_noise(x64):
    x, truth = wandering(6000, speed=1.0), true_weights(PLANE)
    noise = np.random.default_rng(18).normal(0, 1.0, len(x))
    z = np.asarray(simulate(PLANE, truth, x, "ramp")) + noise
    left = [
        np.linalg.norm(AdaptiveFilter(PLANE, "ramp", step_size=mu).run(x, z).weights - truth)
        for mu in (1.0, 0.3, 0.05)
    ]
    assert left[2] < 0.6 * left[1] < 0.4 * left[0]


@both_samplings
def test_ramp_filter_projects_on_the_states_moved(sampling, x64):
    """The normalised projection, and (15) with sᵀs for A, on differences from the reference."""
    x, truth = wandering(), true_weights(PLANE)
    states = np.asarray(states_of(PLANE, x, "low", "ramp"))
    noise = np.random.default_rng(11).normal(0, 0.1, SAMPLES)
    z = states @ truth + noise
    weights, info = trajectory(AdaptiveFilter(PLANE, "ramp", sampling), x, z)
    estimate, reference = np.full(PLANE.cells, 1e-9), 0
    for k in range(SAMPLES):
        s = states[k] - states[reference]
        error = z[k] - z[reference] - s @ estimate
        squared = s @ s
        assert float(info.error[k]) == pytest.approx(error, abs=1e-11)
        if squared >= (0.5 if sampling == "event" else 1e-15):
            assert float(info.switched[k]) == pytest.approx(squared, abs=1e-12)
            nu = noise[k] - noise[reference]
            expected = (
                np.sum((estimate - truth) ** 2) + (nu**2 - (s @ (estimate - truth)) ** 2) / squared
            )
            estimate = estimate + s * error / squared
            assert np.sum((np.asarray(weights[k]) - truth) ** 2) == pytest.approx(expected)
            reference = k
        else:
            assert info.switched[k] == 0
        if sampling == "sample":
            reference = k
        np.testing.assert_allclose(weights[k], estimate, atol=1e-11)


def test_events_keep_noise_from_small_moves_of_ramps(x64):
    """One-sample differences divide noise by moves that may be arbitrarily small."""
    x, truth = wandering(20_000, speed=0.05), true_weights(PLANE)
    z = np.asarray(simulate(PLANE, truth, x, "ramp"))
    z = z + np.random.default_rng(12).normal(0, 0.01, len(z))
    errors = {
        sampling: np.linalg.norm(AdaptiveFilter(PLANE, "ramp", sampling).run(x, z).weights - truth)
        for sampling in ("event", "sample")
    }
    assert errors["event"] < 0.2 * errors["sample"]


def smooth_stage(x):
    """A piezo-like stage that is no grid: a spring and forty plays (Prandtl-Ishlinskii)."""
    radii = np.linspace(1.0, 30.0, 40)
    gains = 0.01 + 0.015 * np.exp(-radii / 8)
    plays = np.zeros_like(radii)
    output = []
    for now in x:
        plays = np.clip(plays, now - radii, now + radii)
        output.append(0.9 * now + gains @ plays)
    return np.array(output)


def test_raw_differences_lose_the_movement_between_switches(x64):
    """Sampled once a level the weights sum to the stroke; sampled raw, to a small part of it."""
    coins = np.random.default_rng(13).choice([-1, 1], size=100).repeat(200)
    travel = np.cumsum(coins * 0.0941)  # about 22 samples a level, 800 the whole range
    x = 75 * (1 - np.abs(1 - np.mod(travel / 75, 2)))
    z = smooth_stage(x)
    plane = Plane(levels=37, low=0.0, high=75.0)
    total = {
        sampling: float(AdaptiveFilter(plane, "relay", sampling).run(x, z).weights.sum())
        for sampling in ("event", "sample")
    }
    # The missing tenth is what relays do not see: half a level at each end and turning point.
    assert total["event"] == pytest.approx(np.ptp(z), rel=0.12)
    assert total["sample"] < 0.1 * np.ptp(z)


@both_kinds
@both_samplings
def test_missing_outputs_do_not_poison_the_filter(hysteron, sampling, precision):
    x, truth = wandering(dtype=precision), true_weights(PLANE, precision)
    z = np.array(simulate(PLANE, truth, x, hysteron))
    z[np.random.default_rng(14).random(SAMPLES) < 0.4] = np.nan
    z[:3] = np.nan
    result = AdaptiveFilter(PLANE, hysteron, sampling).run(x, z)
    assert np.isfinite(result.weights).all()
    assert np.isfinite(result.output).all()
    assert np.isnan(np.asarray(result.error)[np.isnan(z)]).all()
    assert not np.any(np.asarray(result.switched)[np.isnan(z)])
    if sampling == "event":
        assert np.isfinite(np.asarray(result.error)[~np.isnan(z)][1:]).all()


def test_event_differences_span_missing_outputs(x64):
    """Eq. (7) on the hysterons switched since the last event: nothing is lost in a gap."""
    x, truth = wandering(), true_weights(PLANE)
    relays = slow_relays(PLANE, x)
    z = relays @ truth
    z[np.random.default_rng(15).random(SAMPLES) < 0.5] = np.nan
    weights, info = trajectory(AdaptiveFilter(PLANE), x, z)
    estimate, reference = np.full(PLANE.cells, 1e-9), int(np.argmax(~np.isnan(z)))
    gaps = 0
    for k in range(reference, SAMPLES):
        if np.isnan(z[k]):
            continue
        s = relays[k] - relays[reference]
        assert float(info.error[k]) == pytest.approx(s @ (truth - estimate), abs=1e-12)
        if s.any():
            gaps += k - reference > 1 and bool(np.isnan(z[k - 1]))
            estimate, reference = np.asarray(weights[k]), k
    assert gaps > 10
    assert np.linalg.norm(estimate - truth) < 0.7 * np.linalg.norm(truth)


def test_missing_outputs_where_nothing_switches_change_nothing(precision):
    x, truth = wandering(dtype=precision), true_weights(PLANE, precision)
    z = np.array(simulate(PLANE, truth, x, "relay"))
    full = AdaptiveFilter(PLANE).run(x, z)
    z[1:][np.asarray(full.switched)[1:] == 0] = np.nan
    np.testing.assert_array_equal(AdaptiveFilter(PLANE).run(x, z).weights, full.weights)


@both_kinds
@both_samplings
def test_resting_input_changes_nothing(hysteron, sampling):
    """No update where A = 0, however much the output wanders."""
    x, truth = wandering(dtype="float32"), true_weights(PLANE, "float32")
    filt = AdaptiveFilter(PLANE, hysteron, sampling)
    z = simulate(PLANE, truth, x, hysteron)
    moved = filt.run(x, z)
    noise = np.random.default_rng(16).normal(size=SAMPLES).astype("float32")
    rested = filt.run(np.full(SAMPLES, x[-1]), noise, moved.state)
    np.testing.assert_array_equal(rested.weights, moved.weights)
    assert not np.any(rested.switched)


@both_kinds
@both_samplings
@settings(max_examples=8)
@given(cut=st.integers(1, SAMPLES - 1))
def test_a_run_in_two_parts_is_one_run(hysteron, sampling, cut):
    x = wandering(dtype="float32")
    z = np.sin(x) + x
    filt = AdaptiveFilter(PLANE, hysteron, sampling)
    whole = filt.run(x, z, form="dense")
    # Both parts are filled up to one length, by rests: one compilation.
    part = np.append(x[:cut], np.full(SAMPLES - cut, x[cut - 1]))
    first = filt.run(part, filled(z[:cut]), form="dense")
    second = filt.run(np.append(x[cut:], np.full(cut, x[-1])), filled(z[cut:]), first.state)
    for name in ("output", "error", "switched"):
        parts = np.append(getattr(first, name)[:cut], getattr(second, name)[: SAMPLES - cut])
        np.testing.assert_array_equal(parts, getattr(whole, name))
    np.testing.assert_array_equal(second.weights, whole.weights)


def filled(z):
    return np.append(z, np.full(SAMPLES - len(z), z[-1]))


@both_kinds
def test_online_and_batch_pass_the_state_to_each_other(hysteron, x64, tmp_path):
    x = wandering()
    z = np.sin(x) + x
    z[40:43] = np.nan
    filt = AdaptiveFilter(PLANE, hysteron)
    whole = filt.run(x, z)

    online = OnlineFilter(filt)
    outputs = [online(*sample) for sample in zip(x[:100], z[:100], strict=True)]
    online.save(tmp_path / "state.npz")
    batch = filt.run(x[100:200], z[100:200], online.state)
    online = OnlineFilter(filt, batch.state)
    outputs += [
        *np.asarray(batch.output),
        *(online(*s) for s in zip(x[200:], z[200:], strict=True)),
    ]
    assert isinstance(outputs[0], float)
    np.testing.assert_allclose(outputs, whole.output, rtol=1e-12, atol=1e-12)
    assert online.state is not None
    np.testing.assert_allclose(online.state.weights, whole.weights, atol=1e-12)

    resumed = OnlineFilter.load(tmp_path / "state.npz")
    assert resumed.filter.plane == PLANE
    assert resumed.filter.hysteron == hysteron
    again = resumed.filter.run(x[100:200], z[100:200], resumed.state)
    np.testing.assert_array_equal(again.weights, batch.weights)
    assert [p.name for p in tmp_path.iterdir()] == ["state.npz"]


def test_a_saved_filter_without_state_starts_afresh(tmp_path):
    OnlineFilter(AdaptiveFilter(PLANE, "ramp", "sample", 0.25, 0.5)).save(tmp_path / "new")
    loaded = OnlineFilter.load(tmp_path / "new")
    assert float(np.asarray(loaded.filter.step_size)) == 0.5
    assert loaded.state is None
    assert loaded.filter.sampling == "sample"
    assert loaded(6.0, 1.0) == pytest.approx(0.25 * PLANE.cells)


def test_a_file_of_the_first_format_has_the_step_size_one(tmp_path):
    about = {"format": 1, "hysteron": "ramp", "sampling": "event"}
    about |= {"levels": PLANE.levels, "low": PLANE.low, "high": PLANE.high}
    path = tmp_path / "old.npz"
    np.savez(path, about=np.asarray(json.dumps(about)), initial_weight=np.asarray(0.25))
    assert OnlineFilter.load(path).filter == AdaptiveFilter(
        PLANE, "ramp", initial_weight=np.asarray(0.25)
    )
    np.savez(path, about=np.asarray(json.dumps(about | {"format": 2})), initial_weight=0.25)
    with pytest.raises(InputError, match=r"old\.npz cannot be read .*step_size"):
        OnlineFilter.load(path)


def test_a_file_that_is_no_saved_filter_is_refused(tmp_path):
    path = tmp_path / "broken.npz"
    with pytest.raises(ValueError, match="does not exist"):
        OnlineFilter.load(path)
    for content in (b"", b"no archive", b"PK\x03\x04 half"):
        path.write_bytes(content)
        with pytest.raises(ValueError, match=r"broken\.npz cannot be read"):
            OnlineFilter.load(path)
    np.savez(path, other=np.zeros(3))
    with pytest.raises(ValueError, match=r"broken\.npz cannot be read"):
        OnlineFilter.load(path)
    np.savez(path, about=np.asarray(json.dumps({"format": 99})))
    with pytest.raises(ValueError, match="format 99"):
        OnlineFilter.load(path)


def test_only_an_adaptive_filter_runs_online():
    with pytest.raises(ValueError, match="the filter is Plane: give an AdaptiveFilter"):
        OnlineFilter(PLANE)  # pyright: ignore[reportArgumentType]


def test_an_online_filter_goes_on_only_from_a_state_of_its_plane():
    filt = AdaptiveFilter(PLANE)
    other = AdaptiveFilter(Plane(levels=3, low=0.0, high=1.0)).init(0.0, 0.0)
    state: Any
    for state, message in (
        (5, "the state is int: give a FilterState"),
        (other, r"\(6,\).*\(21,\)"),
    ):
        with pytest.raises(InputError, match=message):
            OnlineFilter(filt, state)


def test_online_filter_is_unharmed_by_a_refused_sample():
    online = OnlineFilter(AdaptiveFilter(PLANE))
    online(1.0, 2.0)
    before = online.state
    x: Any
    for x, z, message in (
        (np.inf, 1.0, "x is inf"),
        (np.nan, np.inf, "z is inf"),
        (1.0, 1e39, "1e.39 is beyond what float32 holds"),
        (6.001, 1.0, r"x is 6\.001, and the plane reaches"),
        (1.0, -np.inf, "z is -inf"),
        ("high", 1.0, "x is 'high' and z is 1.0: give two numbers"),
        (None, 1.0, "x is None"),
    ):
        with pytest.raises(ValueError, match=message):
            online(x, z)
    assert online.state is before
    # Beyond the plane by rounding is no mistake, and a missing output leaves the weights.
    online(6.0 * (1.0 + 1e-7))
    assert online.info is not None
    assert online.info.switched == 0


@both_kinds
def test_a_batch_of_outputs_is_a_loop_over_them(hysteron, x64):
    x, truth = wandering(), true_weights(PLANE)
    noise = np.random.default_rng(17).normal(0, 0.1, (4, SAMPLES))
    z = np.asarray(simulate(PLANE, truth, x, hysteron))[np.newaxis] + noise
    filt = AdaptiveFilter(PLANE, hysteron)
    batch = jax.vmap(lambda z: filt.run(x, z).weights)(z)
    loop = np.array([filt.run(x, row).weights for row in z])
    np.testing.assert_allclose(batch, loop, atol=1e-12)


@both_kinds
def test_state_and_filter_are_pytrees(hysteron, x64):
    x = wandering()
    filt = AdaptiveFilter(PLANE, hysteron)
    result = filt.run(x, np.sin(x))
    for tree in (filt, result.state):
        leaves, structure = jax.tree.flatten(tree)
        rebuilt = jax.tree.unflatten(structure, [np.asarray(leaf) for leaf in leaves])
        assert jax.tree.structure(rebuilt) == structure
    again = filt.run(x, np.cos(x), rebuilt)
    np.testing.assert_array_equal(again.weights, filt.run(x, np.cos(x), result.state).weights)


@both_kinds
@both_samplings
def test_gradient_through_the_filter_is_finite_and_right(hysteron, sampling, x64):
    """Samples at which nothing switches, and missing ones, leave no NaN in the gradient."""
    x = np.repeat(wandering(25, speed=1.1), 2)
    x[30:] = np.minimum(x[30:], 4.7)
    z = np.sin(x) + x
    z[[0, 7, 20]] = np.nan
    start = true_weights(PLANE)

    def loss(z, initial_weight):
        result = AdaptiveFilter(PLANE, hysteron, sampling, initial_weight).run(x, z)
        return (result.weights**2).sum() + (result.output**2).sum()

    by_output, by_start = jax.jit(jax.grad(loss, (0, 1)))(z, start)
    assert np.all(np.asarray(by_output)[np.isnan(z)] == 0)
    assert np.abs(by_output).max() > 0.1
    # The loss is quadratic in both, so that central differences are exact.
    numeric = differences(lambda z: loss(z, start), z, 0.1)
    np.testing.assert_allclose(by_output, numeric, rtol=1e-9, atol=1e-9)
    numeric = differences(lambda start: loss(z, start), start, 0.1)
    np.testing.assert_allclose(by_start, numeric, rtol=1e-9, atol=1e-9)


class OfARecord:
    """What has the columns of a record, as `Record` and a simulated stage have."""

    time = input = output = np.linspace(0.0, 6.0, 20)


@pytest.mark.parametrize("run", [AdaptiveFilter(PLANE).run, RecursiveLeastSquares(PLANE).run])
def test_a_record_or_several_in_place_of_arrays_is_told(x64, run):
    with pytest.raises(InputError, match=r"the input x is a whole OfARecord: give .*record.input"):
        run(OfARecord())
    with pytest.raises(InputError, match=r"the output z is a whole OfARecord"):
        run(OfARecord.input, OfARecord())
    with pytest.raises(InputError, match=r"the shape \(20,\), and there is no output z: give both"):
        run(OfARecord.input)
    two = np.stack([OfARecord.input, OfARecord.input])
    with pytest.raises(InputError, match=r"\(2, 20\) and the output z \(2, 20\).*jax.vmap"):
        run(two, two)
    with pytest.raises(InputError, match="the input x is a whole OfARecord"):
        simulate(PLANE, np.ones(PLANE.cells), OfARecord())  # pyright: ignore[reportArgumentType]
    with pytest.raises(InputError, match="weights is a whole OfARecord"):
        simulate(PLANE, OfARecord(), OfARecord.input)  # pyright: ignore[reportArgumentType]
    with pytest.raises(InputError, match=r"\(2, 20\): give .*one by one with jax.vmap"):
        simulate(PLANE, np.ones(PLANE.cells), two)


def test_several_records_run_one_by_one_with_vmap():
    x = np.stack([wandering(seed=seed, dtype="float32") for seed in (1, 2)])
    filt = AdaptiveFilter(PLANE)
    several = jax.vmap(filt.run)(x, 2 * x)
    for row, weights in zip(x, several.weights, strict=True):
        alone = filt.run(row, 2 * row, form="dense").weights
        np.testing.assert_allclose(weights, alone, rtol=0, atol=1e-5)


def test_single_precision_is_said_where_it_takes_digits_that_matter():
    """In single precision numbers about 10,000 are 0.001 apart."""
    x = wandering()
    AdaptiveFilter(PLANE).run(x, 2 * x)  # 0.1 a step, rounded to 1e-7: nothing to say
    with pytest.warns(PrecisionWarning, match=r"the output z is rounded to float32.*enable_x64"):
        AdaptiveFilter(PLANE).run(x, 1e4 + 1e-3 * x)
    with pytest.warns(PrecisionWarning, match="the input x"):
        simulate(Plane(6, 1e4, 1e4 + 6e-3), np.ones(PLANE.cells), 1e4 + 1e-3 * x)
    with jax.enable_x64(True):
        AdaptiveFilter(PLANE).run(x, 1e4 + 1e-3 * x)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("default")
        for seed in (1, 2, 3):
            AdaptiveFilter(PLANE).run(x, 1e4 + 1e-3 * wandering(seed=seed))
    assert len(said) == 1


def test_the_same_shapes_compile_once(monkeypatch):
    """The step is traced when a function is compiled, and never when it runs."""
    calls = []
    genuine = hysteron_step

    def counted(*arguments):
        calls.append(arguments)
        return genuine(*arguments)

    for module in (adaptive, checks, simulation):
        monkeypatch.setattr(module, "hysteron_step", counted)
    plane = Plane(levels=6, low=0.0, high=6.125)
    x = wandering(123) / 2
    state = AdaptiveFilter(plane).init(x[0], 0.0)
    online = OnlineFilter(AdaptiveFilter(plane), state)
    for repeat in range(3):
        AdaptiveFilter(plane, initial_weight=0.1 * repeat).run(x + repeat, np.sin(x), state)
        simulate(plane, true_weights(plane, seed=repeat), x + repeat)
        online(repeat, repeat)
        if repeat == 0:
            assert calls
            calls.clear()
    assert not calls


@both_kinds
def test_each_pass_starts_from_the_first_memory_and_the_last_weights(hysteron, x64):
    x, truth = 3 + 0.9 * (wandering() - 3), true_weights(PLANE)
    x = np.append(x[60:], x[:60])
    z = np.asarray(simulate(PLANE, truth, x, hysteron, "demagnetised"))
    filt = AdaptiveFilter(PLANE, hysteron)
    start = filt.init(x[0], z[0], "demagnetised")
    expected = PLANE.initial_states("demagnetised", x[0], hysteron)
    np.testing.assert_array_equal(start.states, expected)
    state, left = start, []
    for passes in range(1, 6):
        single = filt.run(x, z, state)
        several = filt.run(x, z, start, passes)
        for got, wanted in zip(jax.tree.leaves(several), jax.tree.leaves(single), strict=True):
            np.testing.assert_allclose(got, wanted, atol=1e-13)
        left.append(np.linalg.norm(several.weights - truth))
        state = dataclasses.replace(start, weights=single.weights)
    assert np.all(np.diff(left) < 0)
    from_low = filt.run(x, z, passes=3, form="dense").weights
    np.testing.assert_array_equal(from_low, filt.run(x, z, filt.init(x[0], z[0]), 3).weights)
    by_states = filt.init(x[0], z[0], np.asarray(start.states))
    np.testing.assert_array_equal(by_states.states, start.states)


@both_kinds
def test_single_precision_follows_double_precision(hysteron):
    """Nothing accumulates: after 3000 samples the weights agree to 1e-4 of the largest."""
    weights = []
    for dtype in ("float32", "float64"):
        with jax.enable_x64(dtype == "float64"):
            # On a fine binary lattice, so that both precisions see one input.
            x = (np.round(wandering(3000) * 1024 + 0.5) / 1024).clip(0, 6).astype(dtype)
            z = (3 * np.sin(x.astype(float)) + x).astype(dtype)
            weights.append(np.asarray(AdaptiveFilter(PLANE, hysteron).run(x, z).weights))
    assert [w.dtype.name for w in weights] == ["float32", "float64"]
    largest = np.abs(weights[1]).max()
    np.testing.assert_allclose(weights[0], weights[1], rtol=0, atol=1e-4 * largest)


@both_kinds
@settings(max_examples=15)
@given(data=st.data())
def test_closed_loops_leave_the_model_as_it_was(hysteron, data):
    """Wiping-out, in the output and in the reference of the filter's differences."""
    bottom, top = sorted(data.draw(st.lists(st.floats(0, 6, width=32), min_size=2, max_size=2)))
    inside = data.draw(st.lists(st.floats(bottom, top, width=32), min_size=20, max_size=20))
    later = data.draw(st.lists(st.floats(0, 6, width=32), min_size=20, max_size=20))
    begin = [0.0, 6.0, bottom, top, bottom]
    rest = [bottom] * 21
    with jax.enable_x64(True):
        weights = true_weights(PLANE)
        looped, rested = (
            np.asarray(simulate(PLANE, weights, np.array([*begin, *way, *later]), hysteron))
            for way in ([*inside, bottom], rest)
        )
    np.testing.assert_array_equal(looped[25:], rested[25:])


@both_kinds
def test_jitter_inside_a_cell_does_not_drift(hysteron, precision):
    """An input that trembles inside one cell is no event, whatever the output does."""
    x = wandering(dtype=precision)
    filt = AdaptiveFilter(PLANE, hysteron)
    rng = np.random.default_rng(19)
    x = np.append(x, np.asarray([2.9, 3.0], precision))
    moved = filt.run(x, np.sin(x))
    jitter = (3.0 + rng.uniform(-0.05, 0.05, SAMPLES)).astype(precision)
    rested = filt.run(jitter, rng.normal(size=SAMPLES).astype(precision), moved.state)
    np.testing.assert_array_equal(rested.weights, moved.weights)
    assert not np.any(rested.switched)


def lagged(x, tau):
    """A first-order lag by its exact response to a stair of unit time steps, settled at x[0]."""
    part = -jnp.expm1(-1.0 / tau)

    def advance(y, value):
        y = y + part * (value - y)
        return y, y

    return jax.lax.scan(advance, x[0], x)[1]


def test_gradient_reaches_an_effect_upstream_of_the_filter(x64):
    """Through ramps and recursion, to the initial weights and to a lag's time constant."""
    x, start = jnp.asarray(wandering(240, speed=0.61)), true_weights(PLANE, seed=4)
    truth, new = true_weights(PLANE), jnp.asarray(wandering(120, seed=9, speed=0.43))
    z = np.asarray(simulate(PLANE, truth, lagged(x, 1.3), "ramp"))
    z_new = np.asarray(simulate(PLANE, truth, lagged(new, 1.3), "ramp"))

    @jax.jit
    def loss(start, tau):
        filt = AdaptiveFilter(PLANE, "ramp", initial_weight=start, step_size=0.7)
        result = filt.run(lagged(x, tau), z)
        replay = simulate(PLANE, result.weights, lagged(new, tau), "ramp")
        return jnp.mean((replay - z_new) ** 2) + jnp.mean(result.error**2)

    tau = 1.7
    by_start, by_tau = jax.jit(jax.grad(loss, (0, 1)))(start, tau)
    step = 1e-5
    numeric = (loss(start, tau + step) - loss(start, tau - step)) / (2 * step)
    assert abs(float(numeric)) > 1e-2
    assert float(by_tau) == pytest.approx(float(numeric), rel=1e-5)
    # Quadratic in the initial weights, so that long steps are exact.
    numeric = differences(lambda start: loss(start, tau), start, 0.1)
    np.testing.assert_allclose(by_start, numeric, rtol=1e-5, atol=1e-9 * np.abs(numeric).max())


@pytest.mark.parametrize(
    ("x", "z", "message"),
    [
        ([0.0, 1.0, 2.0], [0.0, 1.0], r"\(3,\).*\(2,\)"),
        ([[0.0, 1.0]], [[0.0, 1.0]], r"\(1, 2\)"),
        ([], [], r"\(0,\)"),
        ([0.0, np.nan, 1.0], [0.0, 1.0, 2.0], "x is nan at sample 1"),
        ([0.0, 1.0, np.inf], [0.0, 1.0, 2.0], "x is inf at sample 2"),
        ([0.0, 1.0], [-np.inf, 1.0], "z is -inf at sample 0"),
        ([0.0, 1.0j], [0.0, 1.0], "input x has the type complex"),
        ([0.0, 1.0], [0.0, 1.0j], "output z has the type complex"),
    ],
)
def test_a_mistake_in_a_record_is_named_with_its_value(x, z, message):
    with pytest.raises(ValueError, match=message):
        AdaptiveFilter(PLANE).run(x, z)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("preisach",), "'preisach'"),
        (("relay", "raw"), "'raw'"),
        (("relay", "event", np.nan), "initial_weight is nan"),
        (("relay", "event", np.zeros(4)), r"\(4,\).*\(21,\)"),
        (("relay", "event", 0.0, 0.0), r"step_size is 0\.0: give a number between 0 and 2"),
        (("relay", "event", 0.0, 2), "step_size is 2: "),
        (("relay", "event", 0.0, -0.1), r"step_size is -0\.1"),
        (("relay", "event", 0.0, np.nan), "step_size is nan"),
        (("relay", "event", 0.0, np.ones(3)), r"step_size has the shape \(3,\)"),
        (("relay", "event", 0.0, "x"), "step_size is 'x': give one number"),
        (("relay", "event", 0.0, None), "step_size is None: give one number"),
        (("relay", "event", 0.0, 0.5j), "step_size is 0.5j: give one number"),
        (("relay", "event", "x"), r"initial_weight is 'x': give one number or \(21,\)"),
        (("relay", "event", [None] * 21), "initial_weight is .None, None"),
    ],
)
def test_a_mistake_in_the_filter_is_named_with_its_value(arguments, message):
    with pytest.raises(ValueError, match=message):
        AdaptiveFilter(PLANE, *arguments)


def test_mistakes_elsewhere_are_named_with_their_values():
    filt = AdaptiveFilter(PLANE)
    other = AdaptiveFilter(Plane(levels=3, low=0.0, high=1.0)).init(0.0, 0.0)
    with pytest.raises(ValueError, match=r"\(6,\).*\(21,\)"):
        filt.run(np.arange(2.0), np.arange(2.0), other)
    with pytest.raises(ValueError, match="x is inf"):
        filt.init(np.inf, 0.0)
    passes: Any
    for passes in (0, 1.5, "two", None, np.nan, np.inf):
        with pytest.raises(InputError, match=f"passes is {passes!r}: give a whole number"):
            filt.run(np.arange(2.0), np.arange(2.0), passes=passes)
    with pytest.raises(ValueError, match=r"weights has the shape \(2,\).*\(21,\)"):
        simulate(PLANE, np.arange(2.0), np.arange(2.0))
    anything: Any = 5
    with pytest.raises(InputError, match="the state is int: give a FilterState"):
        filt.run(np.arange(2.0), np.arange(2.0), anything)
    for call in (
        lambda: AdaptiveFilter(anything),
        lambda: simulate(anything, np.arange(2.0), np.arange(2.0)),
    ):
        with pytest.raises(InputError, match=r"the plane is 5: give a Plane, as in Plane\(levels="):
            call()


def test_whole_numbers_of_python_are_taken_as_reals(precision):
    x: Any = [*range(7)]
    z: Any = [*range(0, 14, 2)]
    result = AdaptiveFilter(PLANE).run(x, z)
    assert result.weights.dtype == precision
    assert float(result.weights.sum()) == pytest.approx(12, rel=1e-5)


def test_arrays_of_integers_are_refused(x64):
    filt, counts, reals = AdaptiveFilter(PLANE), np.arange(7), np.arange(7.0)
    with pytest.raises(InputError, match=r"x has the type int64: .* x\.astype\(float\)"):
        filt.run(counts, reals)
    with pytest.raises(InputError, match=r"z has the type int64: .* z\.astype\(float\)"):
        filt.run(reals, counts)
    with pytest.raises(InputError, match=r"x0 has the type int64: .* x0\.astype\(float\)"):
        filt.init(counts[0], 0.0)
    with pytest.raises(InputError, match=r"as in weights\.astype\(float\)"):
        simulate(PLANE, np.ones(PLANE.cells, int), reals)


def test_an_input_that_leaves_the_plane_is_named(precision):
    filt, online = AdaptiveFilter(PLANE), OnlineFilter(AdaptiveFilter(PLANE))
    online(1.0, 2.0)
    before = online.state
    x = np.array([0.0, 3.0, 6.5], precision)
    message = r"x is 6\.5 at sample 2, and the plane reaches from 0\.0 to 6\.0"
    with pytest.raises(InputError, match=message):
        filt.run(x, x)
    with pytest.raises(InputError, match=message):
        simulate(PLANE, true_weights(PLANE, precision), x)
    for call in (filt.init, online):
        with pytest.raises(InputError, match=r"x is -0\.5, and the plane reaches"):
            call(-0.5, 1.0)
    assert online.state is before

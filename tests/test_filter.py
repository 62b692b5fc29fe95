"""The model's output and the adaptive filter, eq. (5)-(12) and (15), against literal oracles."""

import dataclasses
import json
import warnings
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import PLANE, SAMPLES, slow_relays, slow_states, wandering

from preisach_jax import (
    AdaptiveFilter,
    InputError,
    OnlineFilter,
    Plane,
    PrecisionWarning,
    RecursiveLeastSquares,
    simulate,
)
from preisach_jax.operator.inputs import HYSTERONS
from preisach_jax.theory import next_squared_error

both_kinds = pytest.mark.parametrize("hysteron", HYSTERONS)


def true_weights(plane=PLANE, dtype="float64", seed=0):
    return np.random.default_rng(seed).uniform(0.1, 1.0, plane.cells).astype(dtype)


def slow_filter(plane, x, z, sampling, weight=1e-9):
    """The recursion with sets, eq. (6)-(8), (10)-(12); weights before each sample, e and A."""
    relays = slow_relays(plane, x).astype(bool)
    weights, reference = np.full(plane.cells, weight), z[0]
    errors, areas, outputs = [], [], []
    for k, now in enumerate(relays):
        last = relays[max(k - 1, 0)]
        switched_on, switched_off = now & ~last, last & ~now
        area = switched_on.sum() + switched_off.sum()
        error = z[k] - reference - weights[now].sum() + weights[last].sum()
        outputs.append(weights[now].sum())
        errors.append(error)
        areas.append(area)
        if area:
            weights[switched_on] += error / area
            weights[switched_off] -= error / area
        if area or sampling == "sample":
            reference = z[k]
    return weights, np.array(outputs), np.array(errors), np.array(areas)


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
    return np.array([function(point + m) - function(point - m) for m in moves]) / (2 * step)


@pytest.mark.parametrize("sampling", ["event", "sample"])
def test_relay_filter_matches_the_recursion_with_sets(sampling, precision, tolerance):
    x = wandering().astype(precision)
    z = (3 * np.sin(x) + x).astype(precision)
    weights, outputs, errors, areas = slow_filter(PLANE, x, z, sampling)
    result = AdaptiveFilter(PLANE, "relay", sampling).run(x, z)
    assert {a.dtype.name for a in result[:4]} == {precision}
    np.testing.assert_array_equal(result.switched, areas)
    np.testing.assert_allclose(result.error, errors, atol=20 * tolerance)
    np.testing.assert_allclose(result.output, outputs, atol=20 * tolerance)
    np.testing.assert_allclose(result.weights, weights, atol=20 * tolerance)


@both_kinds
def test_weight_error_falls_exponentially_without_noise(hysteron, x64):
    """Eq. (9): it never grows, and ‖E(k)‖ ≤ C exp(-λk), over many orders of magnitude."""
    x = np.random.default_rng(5).uniform(PLANE.low, PLANE.high, 3000)
    truth = true_weights()
    z = np.asarray(simulate(PLANE, truth, x, hysteron))
    weights, _ = trajectory(AdaptiveFilter(PLANE, hysteron), x, z)
    norms = np.linalg.norm(weights - truth, axis=1)
    assert np.all(np.diff(norms) <= 1e-12)
    above_rounding = norms > 1e-11
    k, logarithm = np.flatnonzero(above_rounding), np.log(norms[above_rounding])
    slope, _ = np.polyfit(k, logarithm, 1)
    assert norms[-1] < 1e-2 * norms[0]
    assert slope < -1e-3
    assert np.corrcoef(k, logarithm)[0, 1] ** 2 > 0.97


@pytest.mark.parametrize(
    ("hysteron", "sampling", "step_size"),
    [("relay", "event", 1.0), ("ramp", "event", 0.3), ("ramp", "sample", 1.7)],
)
def test_error_identity_holds_at_every_step_with_noise(
    hysteron, sampling, step_size, precision, tolerance
):
    """Eq. (7), e = ΣE + ν; (15), ‖E(k+1)‖² = ‖E(k)‖² - (ΣE)²/A + ν²/A, and for any step size.

    The truth is on the grid; for ramps A is sᵀs.
    """
    x, truth = wandering().astype(precision), true_weights(dtype=precision)
    states = slow_states(PLANE, x, hysteron)
    noise = np.random.default_rng(10).normal(0, 0.3, SAMPLES)
    z = (states @ truth + noise).astype(precision)
    filt = AdaptiveFilter(PLANE, hysteron, sampling, step_size=step_size)
    weights, info = trajectory(filt, x, z)
    after = weights.astype(float) - truth
    before = np.vstack([1e-9 - truth.astype(float), after[:-1]])
    rate, reference = step_size, 0
    for k in range(SAMPLES):
        expected, allowed = np.sum(before[k] ** 2), 40 * tolerance
        if info.switched[k]:
            s = states[k] - states[reference]
            area, total, nu = s @ s, s @ before[k], noise[k] - noise[reference]
            assert float(info.switched[k]) == pytest.approx(area, abs=tolerance)
            assert float(info.error[k]) == pytest.approx(nu - total, abs=5 * tolerance)
            expected += (
                rate**2 * nu**2 - rate * (2 - rate) * total**2 + 2 * rate * (1 - rate) * nu * total
            ) / area
            if rate == 1.0:
                found = float(next_squared_error(np.sum(before[k] ** 2), total, area, nu))
                assert found == pytest.approx(expected, rel=tolerance)
            allowed /= min(area, 1.0)  # a small move multiplies the rounding of the states
        assert np.sum(after[k] ** 2) == pytest.approx(expected, rel=tolerance, abs=allowed)
        if info.switched[k] or sampling == "sample":
            reference = k
    assert np.count_nonzero(info.switched) > 30


def test_an_online_filter_without_state_is_saved_and_starts_afresh(tmp_path):
    OnlineFilter(AdaptiveFilter(PLANE, "ramp", "sample", 0.25, 0.5)).save(tmp_path / "new")
    loaded = OnlineFilter.load(tmp_path / "new")
    assert float(np.asarray(loaded.filter.step_size)) == 0.5
    assert loaded.state is None
    assert (loaded.filter.plane, loaded.filter.hysteron) == (PLANE, "ramp")
    assert loaded.filter.sampling == "sample"
    assert loaded(8.0, 1.0) == pytest.approx(0.25 * PLANE.cells)


def test_a_file_that_is_no_saved_filter_is_refused(tmp_path):
    path = tmp_path / "broken.npz"
    with pytest.raises(ValueError, match="does not exist"):
        OnlineFilter.load(path)
    np.savez(path, about=np.asarray(json.dumps({"format": 99})))
    with pytest.raises(ValueError, match="format 99"):
        OnlineFilter.load(path)
    np.savez(path, other=np.zeros(3))
    other = path.read_bytes()
    OnlineFilter(AdaptiveFilter(PLANE)).save(path)
    whole = path.read_bytes()
    cut = [whole[:size] for size in range(0, len(whole), 211)]
    for content in (other, b"no archive", *cut):
        path.write_bytes(content)
        with pytest.raises(ValueError, match=r"broken\.npz cannot be read"):
            OnlineFilter.load(path)


@pytest.mark.parametrize(
    ("hysteron", "sampling", "gaps"),
    [("relay", "event", [0, 7, 20]), ("relay", "event", []), ("ramp", "sample", [0, 7, 20])],
)
def test_gradient_through_the_filter_is_finite_and_right(hysteron, sampling, gaps, x64):
    """To outputs, initial weights, a lag upstream and the step size; missing ones leave no NaN."""
    x = np.repeat(wandering(samples=25, speed=1.1), 2)
    x[30:] = np.minimum(x[30:], 5.7)  # at samples at which nothing switches, A is zero
    z = np.sin(x) + x
    z[gaps] = np.nan
    start, tau = true_weights(), 0.4

    def lagged(tau):
        def advance(y, value):
            y = y - jnp.expm1(-1.0 / tau) * (value - y)
            return y, y

        return jax.lax.scan(advance, jnp.asarray(x[0]), x)[1]

    def loss_of(z, initial_weight, tau, step_size):
        filt = AdaptiveFilter(PLANE, hysteron, sampling, initial_weight, step_size)
        result = filt.run(lagged(tau), z, missing=bool(gaps))
        return (result.weights**2).sum() + (result.output**2).sum()

    both = jax.jit(jax.value_and_grad(loss_of, (0, 1, 2, 3)))  # one program for all values

    def loss(z, initial_weight, tau, step_size=0.7):
        return float(both(z, initial_weight, tau, step_size)[0])

    by_output, by_start, by_tau, by_step = both(z, start, tau, 0.7)[1]
    assert np.all(np.asarray(by_output)[np.isnan(z)] == 0)
    assert np.abs(by_output).max() > 0.1
    # The loss is quadratic in the first two, so that central differences are exact.
    numeric = differences(lambda z: loss(z, start, tau), z, 0.1)
    np.testing.assert_allclose(by_output, numeric, rtol=1e-9, atol=1e-9)
    numeric = differences(lambda start: loss(z, start, tau), start, 0.1)
    np.testing.assert_allclose(by_start, numeric, rtol=1e-9, atol=1e-9)
    numeric = (loss(z, start, tau + 1e-6) - loss(z, start, tau - 1e-6)) / 2e-6
    assert float(by_tau) == pytest.approx(numeric, rel=1e-5)
    assert (abs(float(by_tau)) > 1e-2) == (hysteron == "ramp")
    numeric = (loss(z, start, tau, 0.7 + 1e-6) - loss(z, start, tau, 0.7 - 1e-6)) / 2e-6
    assert float(by_step) == pytest.approx(numeric, rel=1e-5)


class OfARecord:
    """What has the columns of a record, as `Record` and a simulated stage have."""

    time = input = output = np.linspace(0.0, 6.0, 20)


@pytest.mark.parametrize("run", [AdaptiveFilter(PLANE).run, RecursiveLeastSquares(PLANE).run])
def test_a_record_or_several_in_place_of_arrays_is_told(x64, run):
    own, two, ones = OfARecord.input, np.stack([OfARecord.input] * 2), np.ones(PLANE.cells)
    for call, message in (
        (lambda: run(OfARecord()), "the input x is a whole OfARecord: give .*record.input"),
        (lambda: run(own, OfARecord()), "the output z is a whole OfARecord"),
        (lambda: run(own), r"shape \(20,\), and there is no output z: give both"),
        (lambda: run(two, two), r"\(2, 20\) and the output z \(2, 20\).*jax.vmap"),
        (lambda: simulate(PLANE, ones, OfARecord()), "input x is a whole OfARecord"),  # pyright: ignore
        (lambda: simulate(PLANE, OfARecord(), own), "weights is a whole OfARecord"),  # pyright: ignore
        (lambda: simulate(PLANE, ones, two), r"\(2, 20\): give .*one by one with jax.vmap"),
    ):
        with pytest.raises(InputError, match=message):
            call()


def test_single_precision_is_said_where_it_takes_digits_that_matter():
    """In single precision numbers about 10,000 are 0.001 apart."""
    x = wandering()
    AdaptiveFilter(PLANE).run(x, 2 * x)  # 0.1 a step, rounded to 1e-7: nothing to say
    with pytest.warns(PrecisionWarning, match=r"the output z is rounded to float32.*enable_x64"):
        AdaptiveFilter(PLANE).run(x, 1e4 + 1e-3 * x)
    with pytest.warns(PrecisionWarning, match="the input x"):
        simulate(Plane(5, 1e4 - 2e-3, 1e4 + 8e-3), np.ones(PLANE.cells), 1e4 + 1e-3 * x)
    with jax.enable_x64(True):
        AdaptiveFilter(PLANE).run(x, 1e4 + 1e-3 * x)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("default")
        for seed in (1, 2, 3):
            AdaptiveFilter(PLANE).run(x, 1e4 + 1e-3 * wandering(seed=seed))
    assert len(said) == 1


def test_each_pass_starts_from_the_first_memory_and_the_last_weights(x64):
    x = 3 + 0.9 * (wandering() - 3)
    z = np.asarray(simulate(PLANE, true_weights(), x, "ramp", "demagnetised"))
    filt = AdaptiveFilter(PLANE, "ramp")
    start = filt.init(x[0], z[0], "demagnetised")
    expected = PLANE.initial_states("demagnetised", x[0], "ramp")
    np.testing.assert_array_equal(start.states, expected)
    single = start
    for _ in range(3):
        single = dataclasses.replace(start, weights=filt.run(x, z, single).weights)
    several = filt.run(x, z, start, 3)
    np.testing.assert_allclose(several.weights, single.weights, atol=1e-13)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"hysteron": "preisach"}, "'preisach'"),
        ({"sampling": "raw"}, "'raw'"),
        ({"initial_weight": np.nan}, "initial_weight is nan"),
        ({"initial_weight": np.zeros(4)}, r"\(4,\).*\(15,\)"),
        ({"initial_weight": "x"}, r"initial_weight is 'x': give one number or \(15,\)"),
        ({"step_size": 0.0}, r"step_size is 0\.0: give a number between 0 and 2"),
        ({"step_size": np.ones(3)}, r"step_size has the shape \(3,\)"),
        ({"step_size": "x"}, "step_size is 'x': give one number"),
        ({"dead_zone": -0.1}, r"dead_zone is -0\.1: give a number of at least 0"),
        ({"error_limit": 0.0}, r"error_limit is 0\.0: give a number above 0"),
        ({"leakage": 1.0}, r"leakage is 1\.0: give a number from 0 to 1, 1 excluded"),
        ({"leakage": 0.5, "step_size": 1.5}, "make their sum less than 2"),
        ({"nonnegative": 1}, "nonnegative is 1: give True or False"),
        ({"nonnegative": True, "initial_weight": -0.5}, "initial_weight is -0.5 with nonnegative"),
    ],
)
def test_a_mistake_in_the_filter_is_named_with_its_value(options, message):
    with pytest.raises(InputError, match=message):
        AdaptiveFilter(PLANE, **options)


REALS = np.arange(7.0)
FILTER: Any = AdaptiveFilter(PLANE)
OTHER = Plane(levels=3, low=0.0, high=1.0)
ANYTHING: Any = 5


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: FILTER.run([0.0, 1.0, 2.0], [0.0, 1.0]), r"\(3,\).*\(2,\)"),
        (lambda: FILTER.run([], []), r"\(0,\)"),
        (lambda: FILTER.run([0.0, 1.0], [-np.inf, 1.0]), "z is -inf at sample 0"),
        (lambda: FILTER.run([0.0, 1.0j], [0.0, 1.0]), "input x has the type complex"),
        (lambda: FILTER.run(np.array(["a"]), REALS), "input x has the type <U1: give real numbers"),
        (lambda: FILTER.run(np.arange(7), REALS), r"x has the type int.*x\.astype\(float\)"),
        (lambda: FILTER.run(2 * REALS, REALS), "x is 10 at sample 5, and the plane reaches"),
        (lambda: FILTER.run(REALS, REALS, AdaptiveFilter(OTHER).init(0, 0)), r"\(6,\).*\(15,\)"),
        (lambda: FILTER.run(REALS, REALS, ANYTHING), "the state is int: give a FilterState"),
        (lambda: FILTER.run(REALS, REALS, passes=0), "passes is 0: give a whole number"),
        (lambda: FILTER.init(np.inf, 0.0), "x is inf"),
        (lambda: FILTER.init(-2.5, 0.0), r"x is -2\.5, and the plane reaches"),
        (lambda: AdaptiveFilter(ANYTHING), r"the plane is 5: give a Plane, as in Plane\(levels="),
        (lambda: simulate(ANYTHING, REALS, REALS), "the plane is 5: give a Plane"),
        (lambda: simulate(PLANE, REALS[:2], REALS), r"weights has the shape \(2,\).*\(15,\)"),
        (lambda: simulate(PLANE, np.ones(15, int), REALS), r"as in weights\.astype\(float\)"),
        (lambda: OnlineFilter(ANYTHING), "the filter is int: give an AdaptiveFilter"),
        (lambda: OnlineFilter(FILTER, ANYTHING), "the state is int: give a FilterState"),
    ],
)
def test_a_mistake_elsewhere_is_named_with_its_value(call, message):
    with pytest.raises(InputError, match=message):
        call()


def test_whole_numbers_of_python_are_taken_as_reals(precision):
    x: Any = [*range(-2, 9)]
    z: Any = [*range(0, 22, 2)]
    result = AdaptiveFilter(PLANE).run(x, z)
    assert result.weights.dtype == precision
    assert float(result.weights.sum()) == pytest.approx(18, rel=1e-5)

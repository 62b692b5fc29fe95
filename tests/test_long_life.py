"""The adaptive filter over long times: its options, what it keeps, and a sensor that fails."""

import math
from typing import Any

import hypothesis.strategies as st
import jax
import numpy as np
import pytest
from hypothesis import given, settings
from oracles import PLANE, SAMPLES, by_blocks, one_by_one, slow_states, wandering

from preisach_jax import AdaptiveFilter, InputError, OnlineFilter, Plane
from preisach_jax.operator.inputs import HYSTERONS

OPTIONS: dict[str, dict[str, Any]] = {
    "none": {},
    "leakage": {"leakage": 0.03},
    "three": {"dead_zone": 0.2, "error_limit": 0.5, "nonnegative": True, "step_size": 0.7},
}
OPTIONS["all"] = OPTIONS["three"] | OPTIONS["leakage"]

both_kinds = pytest.mark.parametrize("hysteron", HYSTERONS)


def literal_run(filt, x, z, adapt=True):
    """Weights after each sample, outputs, errors and sᵀs: the recursion with all options."""
    y = slow_states(filt.plane, x, filt.hysteron)
    prior = np.broadcast_to(np.asarray(filt.initial_weight, float), filt.plane.cells)
    weights, reference, rows = np.array(prior), 0, []
    has_reference = np.isfinite(z[0])
    for k in range(len(x)):
        s = y[k] - y[reference]
        error = z[k] - z[reference] - weights @ s if has_reference else np.nan
        output, squared, updated = weights @ y[k], s @ s, 0.0
        least = 0.5 if filt.sampling == "event" else 1e-7
        event = np.isfinite(error) and squared >= least
        if event and adapt and abs(error) > (-1 if filt.dead_zone is None else filt.dead_zone):
            used = (
                error
                if filt.error_limit is None
                else np.sign(error) * min(abs(error), filt.error_limit)
            )
            leakage = filt.leakage or 0.0
            weights = prior + (1 - leakage) * (weights - prior)
            weights = weights + filt.step_size * used * s / squared
            if filt.nonnegative:
                weights[s != 0] = weights[s != 0].clip(0)
            updated = squared
        rows.append((weights.copy(), output, error, updated))
        starting = np.isfinite(z[k]) and not has_reference
        if event or starting or filt.sampling == "sample":
            reference, has_reference = k, bool(np.isfinite(z[k]))
    weights, *others = (np.array(column) for column in zip(*rows, strict=True))
    return weights, *others


def measured(x, seed=1, gaps=False):
    rng = np.random.default_rng(seed)
    z = np.sin(2 * x) + 0.6 * x + rng.normal(0, 0.3, len(x))
    z[rng.random(len(x)) < (0.2 if gaps else 0.0)] = np.nan
    return z


# --- options, in all forms of the filter ---


@pytest.mark.parametrize(
    ("hysteron", "sampling", "chosen", "precision", "adapt"),
    [
        ("relay", "event", "none", "float32", True),
        ("ramp", "event", "three", "float32", True),
        ("ramp", "event", "all", "float64", True),
        ("relay", "sample", "all", "float32", True),
        ("relay", "event", "three", "float64", False),
    ],
    indirect=["precision"],
)
def test_each_form_is_the_literal_recursion(hysteron, sampling, chosen, precision, adapt):
    x = np.round(4 * wandering()) / 4  # so that sums are exact
    atol = 1e-12 if precision == "float64" else 1e-3
    filt = AdaptiveFilter(PLANE, hysteron, sampling, 0.1, **OPTIONS[chosen])
    for z in (measured(x, gaps=True), measured(x)):
        weights, *rows = literal_run(filt, x, z, adapt)
        assert 10 * adapt <= np.count_nonzero(rows[2]) < SAMPLES * adapt + 1
        x, z = x.astype(precision), z.astype(precision)
        single, blocks = OnlineFilter(filt), OnlineFilter(filt, filt.init(x[0], z[0]))
        found = {
            "single": one_by_one(single, x, z, adapt=adapt),
            "block": by_blocks(blocks, x, z, SAMPLES, adapt=adapt),
        }
        ends: dict[str, Any] = {"single": single.state, "block": blocks.state}
        results = {"dense": filt.run(x, z, form="dense", adapt=adapt)}
        if not (filt.leakage or sampling == "sample" or np.isnan(z).any()):
            results["event"] = filt.run(x, z, form="event", adapt=adapt)
        for form, result in results.items():
            found[form] = [np.asarray(rows) for rows in result[1:4]]
            ends[form] = result.state
        for form, infos in found.items():
            assert ends[form].weights.dtype == precision
            np.testing.assert_allclose(ends[form].weights, weights[-1], atol=atol, err_msg=form)
            for got, wanted in zip(infos, rows, strict=True):
                np.testing.assert_allclose(got, wanted, atol=atol, err_msg=form)


def test_many_records_and_settings_at_once_are_a_loop_over_them(x64):
    x = np.stack([wandering(seed=seed) for seed in range(3)])

    def weights(x, z, step, zone, limit, leakage):
        chosen = {"dead_zone": zone, "error_limit": limit, "leakage": leakage}
        filt = AdaptiveFilter(PLANE, "ramp", step_size=step, nonnegative=True, **chosen)
        return filt.run(x, z).weights

    chosen = np.array([[1.0, 0.1, 0.5, 0.0], [0.3, 0.5, 1.0, 0.1], [1.9, 0.0, 0.2, 0.01]])
    batch = jax.vmap(weights)(x, np.sin(x), *chosen.T)
    loop = np.array([weights(row, np.sin(row), *own) for row, own in zip(x, chosen, strict=True)])
    np.testing.assert_allclose(batch, loop, atol=1e-12)
    assert np.abs(np.diff(loop, axis=0)).max(axis=1).min() > 1e-3


def test_leakage_leaves_the_bias_of_its_closed_form(x64):
    """Of a relay that switches again and again λ/(λ+μ) of the prior's error remains."""
    x = np.tile([0.0, 1.0], 500)  # which moves the lowest relay alone
    for mu, leakage in ((0.05, 0.02), (1.0, 0.25), (0.05, 0.0)):
        plane = Plane(levels=2, low=0.0, high=2.0)
        filt = AdaptiveFilter(plane, initial_weight=1.0, step_size=mu, leakage=leakage)
        found = filt.run(x, 3.0 * x).weights[0]
        assert float(found) - 3.0 == pytest.approx(-2.0 * leakage / (leakage + mu), abs=1e-12)


# --- what is kept does not age ---


def test_blocks_of_any_length_share_what_is_compiled(compilations):
    filt = AdaptiveFilter(Plane(levels=3, low=-2.0, high=8.0), "ramp")
    x, z = wandering(samples=1100), measured(wandering(samples=1100))
    online = OnlineFilter(filt)
    online.block(x[:130], z[:130])
    online.block(x[130:260], z[130:260])

    def blocks():
        begin = 260
        for size in (129, 131, 140, 133, 144, 137):
            online.block(x[begin : begin + size], z[begin : begin + size])
            begin += size

    assert not compilations(blocks)


def test_a_record_that_indices_cannot_reach_is_refused():
    x = np.broadcast_to(np.float32(1.0), 2**31)
    with pytest.raises(InputError, match="2147483648 samples: give them in parts"):
        AdaptiveFilter(PLANE).run(x, x)


# --- bad samples ---

bad_inputs = st.one_of(
    st.floats(-2, 8, width=32), st.just(math.nan), st.floats(-50, 50, width=32), st.just(8.0)
)
bad_outputs = st.one_of(
    st.floats(-3, 3, width=32), st.just(math.nan), st.sampled_from([1e6, -1e6, 1e30, -1e30, 0.25])
)


@pytest.mark.parametrize(("hysteron", "chosen"), [("relay", "none"), ("ramp", "all")])
@settings(max_examples=4)
@given(samples=st.lists(st.tuples(bad_inputs, bad_outputs), min_size=30, max_size=30))
def test_bad_samples_leave_a_sound_state(hysteron, chosen, samples):
    x, z = (np.array(column, np.float32) for column in zip(*samples, strict=True))
    z[[0, 15]] = np.nan  # in each block an output is missing: one program serves all examples
    filt = AdaptiveFilter(PLANE, hysteron, **OPTIONS[chosen])
    single, blocks = OnlineFilter(filt, saturate=True), OnlineFilter(filt, saturate=True)
    infos = one_by_one(single, x, z)
    by_blocks(blocks, x, z, 15)
    there = np.flatnonzero(~np.isnan(x))
    assert single.missing == blocks.missing
    assert single.missing.inputs == len(x) - len(there)
    assert single.saturated == blocks.saturated == np.count_nonzero((x < -2) | (x > 8))
    if not len(there):
        assert single.state is None
        return
    assert np.isfinite(infos[0][there[0] :]).all()
    for online in (single, blocks):
        state: Any = online.state
        assert np.isfinite(state.weights).all()
        assert np.isfinite(online(float(state.input)))
        assert PLANE.low <= state.input <= PLANE.high
        for states in (np.asarray(state.states), np.asarray(state.reference_states)):
            assert np.isin(states, (0.0, 1.0)).all() or hysteron == "ramp"
            assert np.all((states >= 0) & (states <= 1))
        assert np.all(np.asarray(state.weights) >= 0) or not filt.nonnegative


@pytest.mark.parametrize(("hysteron", "sampling"), [("relay", "event"), ("ramp", "sample")])
def test_the_pure_step_skips_what_is_not_there(hysteron, sampling, x64):
    """A missing input changes nothing, an infinite output no weight, and both pass."""
    filt = AdaptiveFilter(PLANE, hysteron, sampling)
    step = jax.jit(AdaptiveFilter.step)
    state, _ = step(filt, filt.run(wandering(), measured(wandering())).state, 3.3, 1.0)
    for value in (1.0, np.nan, np.inf):
        skipped, nothing = step(filt, state, np.nan, value)
        for name, array in vars(state).items():
            np.testing.assert_array_equal(getattr(skipped, name), array)
        assert np.isnan(nothing.error)
        assert not nothing.switched
        assert float(nothing.output) == pytest.approx(float(state.weights @ state.states))
    for wrong in (np.inf, -np.inf, np.nan):
        broken, _ = step(filt, state, 5.2, wrong)
        np.testing.assert_array_equal(broken.weights, state.weights)
    beyond, _ = step(filt, state, np.inf, np.nan)
    np.testing.assert_array_equal(beyond.states, 1.0)


def test_inputs_beyond_the_plane_saturate_if_asked(x64, tmp_path):
    x = 1.6 * wandering() - 1
    z = measured(x)
    filt = AdaptiveFilter(PLANE, "ramp")
    with pytest.raises(InputError, match="make the plane wider, or clip the input"):
        OnlineFilter(filt).block(x, z)
    clipped = filt.run(np.clip(x, -2, 8), z)
    single, blocks = OnlineFilter(filt, saturate=True), OnlineFilter(filt, None, True)
    one_by_one(single, x[:120], z[:120])
    single.save(tmp_path / "state.npz")
    single = OnlineFilter.load(tmp_path / "state.npz")
    one_by_one(single, x[120:], z[120:])
    by_blocks(blocks, x, z)
    for online in (single, blocks):
        assert online.saturated == np.count_nonzero((x < -2) | (x > 8)) > 20
        assert online.state is not None
        np.testing.assert_allclose(online.state.weights, clipped.weights, atol=1e-12)
        with pytest.raises(InputError, match="x is -inf"):
            online(-np.inf, 1.0)
        with pytest.raises(InputError, match="x is inf"):
            online.block(np.array([1.0, np.inf]))


# --- keeping, and mistakes ---


def test_options_are_saved(x64, tmp_path):
    filt = AdaptiveFilter(PLANE, "ramp", initial_weight=0.1, **OPTIONS["all"])
    x, z = wandering(), measured(wandering())
    online = OnlineFilter(filt)
    one_by_one(online, x[:100], z[:100])
    online(math.nan, 1.0)
    online.save(tmp_path / "state.npz")
    loaded = OnlineFilter.load(tmp_path / "state.npz")
    assert loaded.missing == online.missing == (1, 0)
    assert loaded(math.nan) == online(math.nan)
    assert [path.name for path in tmp_path.iterdir()] == ["state.npz"]
    assert loaded.filter.options() == filt.options() == {
        "dead_zone": 0.2, "leakage": 0.03, "error_limit": 0.5, "nonnegative": True
    }  # fmt: skip
    wanted, again = one_by_one(online, x[100:], z[100:]), one_by_one(loaded, x[100:], z[100:])
    np.testing.assert_allclose(again, wanted, atol=1e-12)


def test_a_switch_that_is_none_is_named():
    filt = AdaptiveFilter(PLANE)
    online = OnlineFilter(filt)
    adapt: Any = "no"
    for call in (
        lambda: online(1.0, 2.0, adapt),
        lambda: online.block(np.ones(3), np.ones(3), adapt),
        lambda: filt.run(np.ones(3), np.ones(3), adapt=adapt),
    ):
        with pytest.raises(InputError, match="adapt is 'no': give True or False"):
            call()
    assert online.state is None
    with pytest.raises(InputError, match="saturate is 'no': give True or False"):
        OnlineFilter(filt, saturate=adapt)

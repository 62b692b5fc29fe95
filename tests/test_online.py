"""The online filter: samples in NumPy, blocks and batches compiled, and one state for all three."""

import math
from typing import Any

import hypothesis.strategies as st
import jax
import numpy as np
import pytest
from hypothesis import given, settings
from oracles import PLANE, SAMPLES, by_blocks, one_by_one

from preisach_jax import AdaptiveFilter, InputError, OnlineFilter
from preisach_jax.filter.state import FilterState

a_few = pytest.mark.parametrize(("hysteron", "sampling"), [("relay", "event"), ("ramp", "sample")])


def crawling(seed):
    """Several samples to a level, forth and back, and an output with gaps."""
    rng = np.random.default_rng(seed)
    x = 3 - 5 * np.cos(np.cumsum(rng.uniform(0, 0.15, SAMPLES)))
    z = 3 * np.sin(x) + x + rng.normal(0, 0.3, len(x))
    z[rng.random(len(x)) < 0.2] = np.nan
    z[:2] = np.nan if seed % 2 else 1.0
    return x, z


def assert_same_state(got: FilterState | None, wanted: FilterState, tolerance):
    assert got is not None
    for name, array in vars(wanted).items():
        assert getattr(got, name).dtype == array.dtype
        np.testing.assert_allclose(getattr(got, name), array, rtol=0, atol=tolerance, err_msg=name)


near = st.sampled_from([-2 * (1 + 1e-7), 0.8, 1.2, 7.9, 8 * (1 + 1e-7)])
inputs = st.one_of(
    st.integers(0, 10).map(lambda step: step - 2.0), st.floats(-2, 8, width=32), near, st.none()
)
outputs = st.one_of(st.floats(-10, 10, width=32), st.just(math.nan))


@pytest.mark.parametrize(
    ("hysteron", "sampling", "dtype"),
    [
        ("relay", "event", "float32"),
        ("relay", "sample", "float64"),
        ("ramp", "event", "float32"),
        ("ramp", "event", "float64"),
        ("ramp", "sample", "float64"),
    ],
)
@settings(max_examples=20)
@given(steps=st.lists(st.tuples(inputs, outputs), min_size=30, max_size=30))
def test_any_samples_give_what_the_jitted_step_gives(hysteron, sampling, dtype, steps):
    """On thresholds, beside them, and beyond the limits by rounding; no input stands for a rest."""
    x, last = [], -2.0
    for value, _ in steps:
        last = last if value is None else value
        x.append(last)
    x, z = np.array(x, dtype), np.array([output for _, output in steps], dtype)
    with jax.enable_x64(dtype == "float64"):
        filt = AdaptiveFilter(PLANE, hysteron, sampling, 0.1, 0.8)
        online, batch = OnlineFilter(filt), filt.run(x, z, form="dense")
        info = one_by_one(online, x, z)
        # One-sample differences divide by moves of ramps that may be small.
        scale = max(1.0, float(np.abs(batch.weights).max()))
        tolerance = 1e-9 if dtype == "float64" else 1e-3
        for got, wanted in zip(info, batch[1:4], strict=True):
            np.testing.assert_allclose(got, wanted, rtol=tolerance, atol=tolerance * scale)
        assert_same_state(online.state, batch.state, tolerance * scale)
        assert online.missing == (0, np.count_nonzero(np.isnan(z)))


@pytest.mark.parametrize("hysteron", ["relay", "ramp"])
def test_the_output_does_not_drift(hysteron, precision):
    """It is the sum (6) over all cells, to rounding, after any number of updates."""
    online = OnlineFilter(AdaptiveFilter(PLANE, hysteron, initial_weight=1.0))
    rng = np.random.default_rng(5)
    for k, x in enumerate(np.tile(crawling(5)[0], 8).tolist()):
        online(x, 100.0 * math.sin(x) + rng.normal())
        if k % 500 == 99:
            state = online.state
            assert state is not None
            exact = math.fsum(np.asarray(state.weights, float) * np.asarray(state.states, float))
            rounding = 8 * float(np.finfo(precision).eps)
            assert online(x) == pytest.approx(exact, rel=rounding, abs=1e-12)


@a_few
def test_samples_blocks_and_runs_follow_one_another(hysteron, sampling, x64):
    x, z = crawling(6)
    filt = AdaptiveFilter(PLANE, hysteron, sampling)
    whole = filt.run(x, z)
    online, rows = OnlineFilter(filt), []
    for begin in range(0, SAMPLES, 100):
        one, block, run = np.split(np.arange(begin, begin + 100), [60, 80])
        rows.append(one_by_one(online, x[one], z[one]))
        rows.append(by_blocks(online, x[block], z[block]))
        batch = filt.run(x[run], z[run], online.state)
        rows.append(batch[1:4])
        online.state = batch.state
    for got, wanted in zip(zip(*rows, strict=True), whole[1:4], strict=True):
        np.testing.assert_allclose(np.concatenate(got), wanted, atol=1e-11)
    assert_same_state(online.state, whole.state, 1e-11)
    weights = batch.state.weights
    online.block(x)  # without outputs it replays
    assert online.state is not None
    np.testing.assert_array_equal(online.state.weights, weights)


@a_few
def test_a_missing_input_is_skipped_and_counted(hysteron, sampling, x64):
    x, z = crawling(7)
    lost = np.random.default_rng(8).random(SAMPLES) < 0.3
    lost[:3] = lost[100:104] = lost[140:160] = lost[-2:] = True
    filt = AdaptiveFilter(PLANE, hysteron, sampling)
    kept = filt.run(x[~lost], z[~lost])
    gappy = np.where(lost, np.nan, x)
    for run in (one_by_one, by_blocks):
        online = OnlineFilter(filt)
        output, error, switched = run(online, gappy, z)
        assert np.isnan(output[:3]).all()
        np.testing.assert_array_equal(output[3:][lost[3:]], output[2:-1][lost[3:]])
        for got, wanted in zip((output, error, switched), kept[1:4], strict=True):
            np.testing.assert_allclose(got[~lost], wanted, atol=1e-12)
        assert np.isnan(error[lost]).all()
        assert not switched[lost].any()
        assert_same_state(online.state, kept.state, 1e-12)
        assert online.missing == (np.count_nonzero(lost), np.count_nonzero(np.isnan(z[~lost])))


def test_nothing_but_missing_samples_leaves_no_state():
    online = OnlineFilter(AdaptiveFilter(PLANE))
    assert math.isnan(online(math.nan, 1.0))
    assert np.isnan(online.block(np.full(4, np.nan), np.ones(4))).all()
    assert online.state is None
    assert online.missing == (5, 0)


def test_a_state_that_was_read_stays_as_it_was(x64):
    online = OnlineFilter(AdaptiveFilter(PLANE, "ramp"))
    x, z = crawling(0)
    one_by_one(online, x[:100], z[:100])
    state = online.state
    assert state is not None
    assert online.state is state
    copies = {name: np.array(array) for name, array in vars(state).items()}
    one_by_one(online, x[100:], z[100:])
    for name, array in vars(state).items():
        np.testing.assert_array_equal(array, copies[name])
    online.state = state
    assert online.state is state
    one_by_one(online, x[100:], z[100:])
    np.testing.assert_array_equal(state.weights, copies["weights"])


REFUSED: list[tuple[Any, Any, str]] = [
    (np.inf, 1.0, "x is inf"),
    (np.nan, np.inf, "z is inf"),
    (1.0, 1e39, "1e.39 is beyond what float32 holds"),
    (8.001, 1.0, r"x is 8\.001, and the plane reaches"),
    ("high", 1.0, "x is 'high' and z is 1.0: give two numbers"),
    (np.ones(3), np.ones(3), "give two numbers, and arrays to `block`"),
]
REFUSED_BLOCKS: list[tuple[Any, Any, str]] = [
    ([0.0, np.nan, np.inf], [0.0, 1.0, 2.0], "x is inf at sample 2"),
    ([np.nan, 0.0, 9.0], [0.0, 1.0, 2.0], "x is 9 at sample 2, and the plane reaches"),
    ([np.nan, 1.0], [0.0, -np.inf], "z is -inf at sample 1"),
    ([0.0, 1.0], [0.0], r"\(2,\).*\(1,\)"),
    ([], None, r"\(0,\)"),
    (1.0, None, r"shape \(\)"),
]


def test_refused_samples_and_blocks_leave_the_state():
    online = OnlineFilter(AdaptiveFilter(PLANE))
    online(1.0, 2.0)
    before = online.state
    for call, rows in ((online, REFUSED), (online.block, REFUSED_BLOCKS)):
        for x, z, message in rows:
            with pytest.raises(InputError, match=message):
                call(x, z)
    assert online.state is before
    assert online.missing == (0, 0)

"""The online filter: samples in NumPy, blocks and batches compiled, and one state for all three."""

import math
from typing import Any

import hypothesis.strategies as st
import jax
import numpy as np
import pytest
from hypothesis import given, settings
from oracles import PLANE, SAMPLES

from preisach_jax.errors import InputError
from preisach_jax.filter.adaptive import AdaptiveFilter
from preisach_jax.filter.online import OnlineFilter
from preisach_jax.filter.state import FilterState
from preisach_jax.operator.checks import HYSTERONS

both_kinds = pytest.mark.parametrize("hysteron", HYSTERONS)
both_samplings = pytest.mark.parametrize("sampling", ["event", "sample"])
a_few = pytest.mark.parametrize(("hysteron", "sampling"), [("relay", "event"), ("ramp", "sample")])


def crawling(rng):
    """Several samples to a level, forth and back."""
    return 3 - 5 * np.cos(np.cumsum(rng.uniform(0, 0.15, SAMPLES)))


def jumping(rng):
    """Over many levels at once, to both ends too."""
    return rng.uniform(-4, 10, SAMPLES).clip(-2, 8)


def on_thresholds(rng):
    """Rests on thresholds and half-way between, and steps from one to another."""
    return np.repeat(-2 + rng.integers(0, 11, SAMPLES // 2), 2)


def trembling(rng):
    """About a threshold, and at times somewhere else."""
    tremor = 1 + rng.uniform(-0.2, 0.2, SAMPLES)
    return np.where(rng.random(SAMPLES) < 0.05, jumping(rng), tremor)


PATHS = [crawling, jumping, on_thresholds, trembling]


def samples_of(path, dtype="float64", seed=0):
    """An input and an output with gaps, whose event differences are not small."""
    rng = np.random.default_rng(seed)
    x = path(rng)
    z = 3 * np.sin(x) + x + rng.normal(0, 0.3, len(x))
    z[rng.random(len(x)) < 0.2] = np.nan
    z[:2] = np.nan if seed % 2 else 1.0
    return x.astype(dtype), z.astype(dtype)


def one_by_one(online, x, z):
    """Outputs and infos of single samples."""
    outputs, infos = [], []
    for sample in zip(x.tolist(), z.tolist(), strict=True):
        outputs.append(online(*sample))
        infos.append(online.info)
    return np.array(outputs), [np.array(rows) for rows in zip(*infos, strict=True)]


def assert_same_state(got: FilterState | None, wanted: FilterState, tolerance):
    assert got is not None
    for name, array in vars(wanted).items():
        assert getattr(got, name).dtype == array.dtype
        np.testing.assert_allclose(getattr(got, name), array, rtol=0, atol=tolerance, err_msg=name)


@pytest.mark.parametrize(
    ("hysteron", "sampling"), [("relay", "event"), ("ramp", "event"), ("ramp", "sample")]
)
def test_single_samples_give_what_the_jitted_step_gives(hysteron, sampling, precision, tolerance):
    filt = AdaptiveFilter(PLANE, hysteron, sampling, 0.1, 0.8)
    for seed, path in enumerate(PATHS):
        x, z = samples_of(path, precision, seed)
        online, batch = OnlineFilter(filt), filt.run(x, z, form="dense")
        output, info = one_by_one(online, x, z)
        scale = max(1.0, np.abs(batch.weights).max())
        np.testing.assert_allclose(output, batch.output, atol=20 * scale * tolerance)
        for got, wanted in zip(info, batch[1:4], strict=True):
            np.testing.assert_allclose(got, wanted, atol=20 * scale * tolerance)
        assert_same_state(online.state, batch.state, 20 * scale * tolerance)
        if hysteron == "relay":
            np.testing.assert_array_equal(info[2], batch.switched)
            assert online.state is not None
            np.testing.assert_array_equal(online.state.states, batch.state.states)
        assert np.count_nonzero(batch.switched) > 5
        assert online.missing == (0, np.count_nonzero(np.isnan(z)))


inputs = st.one_of(
    st.integers(0, 10).map(lambda step: step - 2.0), st.floats(-2, 8, width=32), st.just(None)
)
outputs = st.one_of(st.floats(-10, 10, width=32), st.just(math.nan))


@both_kinds
@both_samplings
@settings(max_examples=10)
@given(steps=st.lists(st.tuples(inputs, outputs), min_size=12, max_size=12))
def test_any_samples_give_what_the_jitted_step_gives(hysteron, sampling, steps):
    """None for an input stands for a rest."""
    x, z, last = [], [], -2.0
    for value, output in steps:
        last = last if value is None else value
        x.append(last)
        z.append(output)
    with jax.enable_x64(True):
        filt = AdaptiveFilter(PLANE, hysteron, sampling)
        online, batch = OnlineFilter(filt), filt.run(np.array(x), np.array(z))
        output, info = one_by_one(online, np.array(x), np.array(z))
        # One-sample differences divide by moves of ramps that may be small.
        scale = max(1.0, float(np.abs(batch.weights).max()))
        np.testing.assert_allclose(output, batch.output, rtol=1e-9, atol=1e-9 * scale)
        np.testing.assert_allclose(info[2], batch.switched, rtol=1e-9)
        assert_same_state(online.state, batch.state, 1e-9 * scale)


@both_kinds
def test_the_output_does_not_drift(hysteron, precision):
    """It is the sum (6) over all cells, to rounding, after any number of updates."""
    online = OnlineFilter(AdaptiveFilter(PLANE, hysteron, initial_weight=1.0))
    rng = np.random.default_rng(5)
    for k, x in enumerate(np.tile(crawling(rng), 8).tolist()):
        online(x, 100.0 * math.sin(x) + rng.normal())
        if k % 500 == 99:
            state = online.state
            assert state is not None
            exact = math.fsum(np.asarray(state.weights, float) * np.asarray(state.states, float))
            assert online(x) == pytest.approx(exact, rel=8 * float(np.finfo(precision).eps))


@a_few
def test_samples_blocks_and_runs_follow_one_another(hysteron, sampling, x64):
    x, z = samples_of(crawling, seed=6)
    filt = AdaptiveFilter(PLANE, hysteron, sampling)
    whole = filt.run(x, z)
    online = OnlineFilter(filt)
    outputs, errors = [], []
    for begin in range(0, SAMPLES, 100):
        stop = begin + 60
        output, info = one_by_one(online, x[begin:stop], z[begin:stop])
        outputs.append(output)
        errors.append(info[1])
        outputs.append(online.block(x[stop : stop + 20], z[stop : stop + 20]))
        assert online.info is not None
        errors.append(online.info.error)
        batch = filt.run(x[stop + 20 : stop + 40], z[stop + 20 : stop + 40], online.state)
        outputs.append(batch.output)
        errors.append(batch.error)
        online.state = batch.state
    np.testing.assert_allclose(np.concatenate(outputs), whole.output, atol=1e-11)
    np.testing.assert_allclose(np.concatenate(errors), whole.error, atol=1e-11)
    assert_same_state(online.state, whole.state, 1e-11)


@a_few
def test_a_missing_input_is_skipped_and_counted(hysteron, sampling, x64):
    x, z = samples_of(crawling, seed=7)
    lost = np.random.default_rng(8).random(SAMPLES) < 0.3
    lost[:3] = lost[100:104] = lost[140:160] = lost[-2:] = True
    filt = AdaptiveFilter(PLANE, hysteron, sampling)
    kept = filt.run(x[~lost], z[~lost])
    gappy = np.where(lost, np.nan, x)
    counts = (np.count_nonzero(lost), np.count_nonzero(np.isnan(z[~lost])))

    single, blocks = OnlineFilter(filt), OnlineFilter(filt)
    output, info = one_by_one(single, gappy, z)
    in_blocks, rows = [], []
    for k in range(0, SAMPLES, 20):
        in_blocks.append(blocks.block(gappy[k : k + 20], z[k : k + 20]))
        rows.append(blocks.info)
    rows = [np.concatenate(parts) for parts in zip(*rows, strict=True)]
    for outputs, infos, online in (
        (output, info, single),
        (np.concatenate(in_blocks), rows, blocks),
    ):
        assert np.isnan(outputs[:3]).all()
        np.testing.assert_allclose(outputs[~lost], kept.output, atol=1e-12)
        np.testing.assert_array_equal(outputs[3:][lost[3:]], outputs[2:-1][lost[3:]])
        for got, wanted in zip(infos[1:], (kept.error, kept.switched), strict=True):
            np.testing.assert_allclose(got[~lost], wanted, atol=1e-12)
        assert np.isnan(infos[1][lost]).all()
        assert not infos[2][lost].any()
        assert_same_state(online.state, kept.state, 1e-12)
        assert online.missing == counts
    np.testing.assert_array_equal(rows[0], np.concatenate(in_blocks))


def test_nothing_but_missing_samples_leaves_no_state():
    online = OnlineFilter(AdaptiveFilter(PLANE))
    assert math.isnan(online(math.nan, 1.0))
    assert np.isnan(online.block(np.full(4, np.nan), np.ones(4))).all()
    assert online.state is None
    assert online.missing == (5, 0)


def test_a_state_that_was_read_stays_as_it_was(x64):
    online = OnlineFilter(AdaptiveFilter(PLANE, "ramp"))
    x, z = samples_of(crawling)
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


@pytest.mark.parametrize(
    ("x", "z", "message"),
    [
        ([0.0, np.nan, np.inf], [0.0, 1.0, 2.0], "x is inf at sample 2"),
        ([np.nan, 0.0, 9.0], [0.0, 1.0, 2.0], "x is 9 at sample 2, and the plane reaches"),
        ([np.nan, 1.0], [0.0, -np.inf], "z is -inf at sample 1"),
        ([0.0, 1.0], [0.0], r"\(2,\).*\(1,\)"),
        ([], None, r"\(0,\)"),
        (1.0, None, r"shape \(\)"),
        (np.arange(3), None, "x has the type int"),
    ],
)
def test_a_refused_block_leaves_the_state(x, z, message):
    online = OnlineFilter(AdaptiveFilter(PLANE))
    online(1.0, 2.0)
    before = online.state
    with pytest.raises(InputError, match=message):
        online.block(x, z)
    assert online.state is before
    assert online.missing == (0, 0)
    array: Any = np.ones(3)
    with pytest.raises(InputError, match="give two numbers, and arrays to `block`"):
        online(array, array)

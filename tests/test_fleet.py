"""A fleet of records gives what each of them gives alone."""

from typing import Any

import numpy as np
import pytest
from oracles import PLANE

from preisach_jax import AdaptiveFilter, InputError, run_fleet
from preisach_jax.operator.states import hysteron_states

OPTIONS = {"dead_zone": 0.2, "error_limit": 0.5, "leakage": 0.03}
LENGTHS = (400, 300, 120, 400)


def records(dtype=float):
    rng = np.random.default_rng(3)
    rows = []
    for length in LENGTHS:
        x = np.abs(np.cumsum(rng.normal(size=length)) % 20.0 - 10.0) - 2.0
        rows.append((x.astype(dtype), (2.0 * x + 0.1 * rng.normal(size=length)).astype(dtype)))
    return [x for x, _ in rows], [z for _, z in rows]


@pytest.mark.parametrize(
    ("precision", "options", "passes"),
    [
        ("float32", {"step_size": 0.3}, 3),
        ("float64", {"step_size": 0.3}, 3),
        ("float32", {"hysteron": "ramp"}, 2),
        ("float64", {"sampling": "sample"} | OPTIONS, 1),
    ],
    indirect=["precision"],
)
def test_each_record_gives_what_it_gives_alone(precision, tolerance, options, passes):
    inputs, outputs = records(precision)
    missing = slice(50, 70) if passes == 1 else slice(0)
    outputs[1][missing] = np.nan
    adaptive = AdaptiveFilter(PLANE, **options)
    found = run_fleet(adaptive, inputs, outputs, passes)
    for k, (x, z) in enumerate(zip(inputs, outputs, strict=True)):
        alone = adaptive.run(x, z, passes=passes, form="dense")
        np.testing.assert_allclose(found.weights[k], alone.weights, atol=50 * tolerance)
        updated = np.asarray(alone.switched) > 0
        assert found.updates[k] == updated.sum()
        rms = np.sqrt(np.mean(np.asarray(alone.error)[updated] ** 2))
        np.testing.assert_allclose(found.error[k], rms, rtol=50 * tolerance)
        states = np.asarray(hysteron_states(PLANE, x, "low", adaptive.hysteron))
        left = z - states @ np.asarray(alone.weights)
        expected = np.nanstd(left.astype(float))
        np.testing.assert_allclose(found.replay_error[k], expected, rtol=2000 * tolerance)
        np.testing.assert_allclose(found.offset[k], np.nanmean(left), atol=2000 * tolerance)


def test_a_second_fleet_of_the_shape_compiles_nothing(x64, compilations):
    inputs, outputs = records()
    run_fleet(AdaptiveFilter(PLANE), inputs, outputs, 3)
    assert compilations(lambda: run_fleet(AdaptiveFilter(PLANE), inputs, inputs, 3)) == []


def test_a_fleet_as_two_arrays_and_one_that_never_moves(x64):
    inputs, outputs = records()
    x, z = (np.stack([np.resize(row, 400) for row in side]) for side in (inputs, outputs))
    x[2] = 5.1
    found = run_fleet(AdaptiveFilter(PLANE), x, z, 3)
    assert found.weights.shape == (4, PLANE.cells)
    assert found.updates[2] == 0
    assert np.isnan(found.error[2])
    np.testing.assert_allclose(found.weights[2], 1e-9)


@pytest.mark.parametrize(
    ("inputs", "outputs", "passes", "message"),
    [
        ([[1.0, 2.0]], [], 1, "there are 1 inputs and 0 outputs"),
        ([], [], 1, "there are 0 inputs"),
        ([[1.0, 2.0], [1.0, 11.0]], [[0.0, 1.0], [0.0, 1.0]], 1, "record 1: .*11"),
        ([[1.0, 2.0], [1.0]], [[0.0, 1.0], [0.0, 1.0]], 1, "record 1: .*shape"),
        ([[1.0, 2.0]], [[0.0, np.inf]], 1, "record 0: .*inf"),
        ([[1.0, 2.0]], [[0.0, 1.0]], 0, "passes is 0"),
    ],
)
def test_unsound_records_are_told_by_their_number(inputs, outputs, passes, message):
    with pytest.raises(InputError, match=message):
        run_fleet(AdaptiveFilter(PLANE), inputs, outputs, passes)


def test_what_is_no_filter_is_told():
    other: Any = PLANE
    none: Any = None
    one: Any = [[1.0]]
    with pytest.raises(InputError, match="the filter is Plane"):
        run_fleet(other, one, one)
    with pytest.raises(InputError, match="the inputs are NoneType"):
        run_fleet(AdaptiveFilter(PLANE), none, one)

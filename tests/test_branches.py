"""Branches between turning points against the states of all hysterons."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from preisach_jax.operator.plane import Plane
from preisach_jax.operator.simulation import branch_starts, simulate, weight_between
from preisach_jax.operator.states import hysteron_states

SAMPLES = 100
INITIAL = ("low", "high", "demagnetised")
PLANES = [Plane(levels=levels, low=-1.0, high=5.0) for levels in (2, 5)]
PLANE = PLANES[1]


def paths(seed):
    """Inputs that jump, that rest exactly on thresholds and limits, that decay, and all of it."""
    rng = np.random.default_rng(seed)
    lattice = np.round(rng.uniform(-1, 5, SAMPLES) * 2) / 2
    walk = np.abs(np.mod(3 + np.cumsum(rng.normal(0, 0.2, SAMPLES)), 12) - 6) - 1
    k = np.arange(SAMPLES)
    return {
        "jumps": rng.uniform(-1, 5, SAMPLES),
        "lattice": lattice,
        "rests": np.repeat(lattice[: SAMPLES // 4], 4),
        "walk": walk,
        "decay": 2.1 + 2.9 * (-0.99) ** k,
        "growth": 2.1 + 2.9 * (-0.97) ** (SAMPLES - k),
        "mixed": np.where(rng.random(SAMPLES) < 0.1, lattice, walk),
    }


def slow_starts(path):
    """Turning points by the rule of Mayergoyz: larger oscillations wipe out smaller ones."""
    starts, nested, rising = [], [0], True
    for k, value in enumerate(path):
        if k and value != path[k - 1] and (value > path[k - 1]) != rising:
            rising = not rising
            nested.append(k - 1)
        while len(nested) > 2 and (
            value >= path[nested[-2]] if rising else value <= path[nested[-2]]
        ):
            nested = nested[:-2]
        starts.append(nested[-1])
    return starts


@settings(max_examples=8)
@given(st.lists(st.integers(0, 6), min_size=1, max_size=40))
def test_the_starts_of_any_path_are_those_of_the_rule(turns):
    path = [0.0, *map(float, turns), *[float(turns[-1])] * (40 - len(turns))]
    assert branch_starts(np.asarray(path)).tolist() == slow_starts(path)


def test_the_weight_between_two_positions_is_twice_the_everett_function(x64):
    plane, rng = PLANE, np.random.default_rng(1)
    weights = rng.uniform(0, 1, plane.cells)
    upper = np.concatenate([rng.uniform(0, plane.levels, 40), [plane.levels] * 3, [1.5, 1, 0]])
    lower = np.minimum(upper, np.append(rng.uniform(0, plane.levels, 40), [0, 1, 99, 1, 1, 0]))
    arrays = map(jnp.asarray, (weights, upper, lower))
    got = eqx.filter_jit(weight_between)(plane, *arrays)
    alpha, beta = (plane.low + plane.delta_x * position for position in (upper, lower))
    everett = jax.jit(plane.everett)(weights, alpha, beta)
    np.testing.assert_allclose(got, 2 * everett, atol=1e-13)


@pytest.mark.parametrize("hysteron", ["relay", "ramp"])
@pytest.mark.parametrize("plane", PLANES, ids=lambda plane: str(plane.levels))
@pytest.mark.parametrize("initial", INITIAL)
def test_turning_points_leave_the_named_memory_behind(plane, hysteron, initial, x64):
    turns = plane.low + plane.delta_x * plane.initial_turns(initial, hysteron)
    assert turns[0] == plane.low
    assert np.all(np.diff(turns) != 0)
    left = hysteron_states(plane, turns, "low", hysteron)[-1]
    np.testing.assert_allclose(left, plane.initial_states(initial, turns[-1], hysteron), atol=1e-14)


@pytest.mark.parametrize(
    ("initial", "hysteron", "precision"),
    [
        ("high", "relay", "float64"),
        ("demagnetised", "ramp", "float64"),
        ("low", "relay", "float32"),
        ("low", "ramp", "float32"),
    ],
    indirect=["precision"],
)
def test_the_output_along_branches_is_that_of_all_states(initial, hysteron, precision, tolerance):
    weights = np.random.default_rng(4).uniform(0, 1, PLANE.cells).astype(precision)
    for kind in ("rests", "decay", "mixed"):
        x = paths(1)[kind].astype(precision)
        states = np.asarray(hysteron_states(PLANE, x, initial, hysteron))
        dense = simulate(PLANE, weights, x, hysteron, initial, form="dense")
        event = simulate(PLANE, weights, x, hysteron, initial, form="event")
        assert event.dtype == precision
        np.testing.assert_allclose(dense, states @ weights, rtol=0, atol=20 * tolerance)
        np.testing.assert_allclose(event, dense, rtol=0, atol=20 * tolerance, err_msg=kind)


def test_a_start_on_a_threshold_leaves_the_states_there_as_they_were(x64):
    weights, hysteron = np.random.default_rng(4).uniform(0, 1, PLANE.cells), "relay"
    for initial in INITIAL[1:]:
        traced = jax.jit(
            lambda x, initial=initial: simulate(PLANE, weights, x, hysteron, initial, "event")
        )
        for threshold in PLANE.thresholds[::2]:
            for then in (-0.3, 0.3):
                x = np.array([threshold, threshold, threshold + then, threshold - 2 * then])
                dense = simulate(PLANE, weights, x, hysteron, initial, form="dense")
                event = simulate(PLANE, weights, x, hysteron, initial, form="event")
                np.testing.assert_allclose(event, dense, atol=1e-13)
                np.testing.assert_allclose(traced(x), dense, atol=1e-13)


def test_a_batch_of_inputs_without_values_has_the_outputs_of_each(x64):
    plane, hysteron = PLANE, "relay"
    batch = np.stack([*paths(0).values()])
    batch[1] = 3.5  # at rest on a threshold
    weights = np.random.default_rng(4).uniform(0, 1, (len(batch), plane.cells))
    together = jax.jit(jax.vmap(lambda w, x: simulate(plane, w, x, hysteron, form="event")))
    expected = [
        simulate(plane, w, x, hysteron, form="dense") for w, x in zip(weights, batch, strict=True)
    ]
    np.testing.assert_allclose(together(weights, batch), expected, rtol=0, atol=1e-11)


def test_derivatives_in_the_input_are_differences_of_outputs(x64):
    initial, plane, rng = "demagnetised", PLANE, np.random.default_rng(4)
    weights, direction = rng.uniform(0, 1, plane.cells), rng.normal(size=SAMPLES)
    x, step = paths(5)["jumps"], 1e-7

    def output(x):
        return simulate(plane, weights, jnp.asarray(x), "ramp", initial, form="event")

    differences = (
        simulate(plane, weights, x + step * direction, "ramp", initial, form="dense")
        - simulate(plane, weights, x - step * direction, "ramp", initial, form="dense")
    ) / (2 * step)
    _, forward = jax.jvp(output, (x,), (direction,))
    np.testing.assert_allclose(forward, differences, rtol=1e-5, atol=1e-5)
    cotangent = rng.normal(size=SAMPLES)
    backward = jax.vjp(output, x)[1](cotangent)[0]
    assert float(backward @ direction) == pytest.approx(float(cotangent @ forward), rel=1e-9)

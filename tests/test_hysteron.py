"""Laws of the relay and the ramp, eq. (1)-(4), against slow oracles written branch by branch."""

from functools import partial
from itertools import pairwise

import hypothesis.strategies as st
import jax
import numpy as np
import pytest
from hypothesis import given, settings

from preisach_jax import InputError, Plane
from preisach_jax.operator.inputs import HYSTERONS
from preisach_jax.operator.states import hysteron_states, state_bounds

LENGTH = 40
few = settings(max_examples=15)
PLANE = Plane(levels=4, low=0.0, high=4.0)  # thresholds 0.5, 1.5, 2.5, 3.5: exact in binary

both_kinds = pytest.mark.parametrize("hysteron", HYSTERONS)
# Quarters of a cell: the path often rests, and often ends exactly on a threshold.
lattice_paths = st.lists(st.integers(0, 16), min_size=LENGTH, max_size=LENGTH).map(
    lambda quarters: np.array(quarters) / 4
)
real_paths = st.lists(
    st.floats(-0.5, 4.5, allow_subnormal=False, width=32), min_size=LENGTH, max_size=LENGTH
).map(np.array)
bits = st.lists(st.integers(0, 1), min_size=PLANE.cells, max_size=PLANE.cells).map(np.array)
fractions = st.lists(
    st.floats(0, 1, allow_subnormal=False, width=32), min_size=PLANE.cells, max_size=PLANE.cells
).map(np.array)


@partial(jax.jit, static_argnames="hysteron")
def states_of(x, initial, hysteron):
    return hysteron_states(PLANE, x, initial, hysteron)


@partial(jax.jit, static_argnames="hysteron")
def bounds_of(x, hysteron):
    return state_bounds(PLANE, x, hysteron)


def follow(x, initial, hysteron, dtype="float64"):
    with jax.enable_x64(dtype == "float64"):
        return np.asarray(states_of(np.asarray(x, dtype), np.asarray(initial, dtype), hysteron))


def slow_relay(x, alpha, beta, on):
    """One relay, as the text around eq. (1)-(4) tells it."""
    states = [int(x[0] > alpha or (on and x[0] >= beta))]
    for before, now in pairwise(x):
        on = states[-1]
        if now > before:
            on = int(on or now >= alpha)
        elif now < before:
            on = int(on and now > beta)
        states.append(on)
    return np.array(states)


def slow_ramp(x, alpha, beta, width, state):
    """One ramp hysteron: on along the ramp at alpha, off along the one at beta."""
    states = []
    for now in x:
        up = np.interp(now, [alpha - width / 2, alpha + width / 2], [0.0, 1.0])
        down = np.interp(now, [beta - width / 2, beta + width / 2], [0.0, 1.0])
        if state < up:
            state = up
        elif state > down:
            state = down
        states.append(state)
    return np.array(states)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@given(path=lattice_paths, initial=bits)
def test_relays_match_the_branch_by_branch_oracle(dtype, path, initial):
    states = follow(path, initial, "relay", dtype)
    for cell, (alpha, beta) in enumerate(zip(PLANE.alpha, PLANE.beta, strict=True)):
        np.testing.assert_array_equal(states[:, cell], slow_relay(path, alpha, beta, initial[cell]))


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@few
@given(path=real_paths, initial=fractions)
def test_ramps_match_the_branch_by_branch_oracle(dtype, path, initial):
    states = follow(path, initial, "ramp", dtype)
    tolerance = 10 * np.finfo(dtype).eps
    for cell, (alpha, beta) in enumerate(zip(PLANE.alpha, PLANE.beta, strict=True)):
        expected = slow_ramp(path, alpha, beta, 1.0, initial[cell])
        np.testing.assert_allclose(states[:, cell], expected, rtol=0, atol=tolerance)


@both_kinds
@few
@given(path=real_paths, initial=fractions)
def test_state_from_any_initial_memory_lies_in_the_bounds(hysteron, path, initial):
    if hysteron == "relay":
        initial = np.round(initial)
    with jax.enable_x64(True):
        low, high = (np.asarray(bound) for bound in bounds_of(path, hysteron))
    np.testing.assert_array_equal(follow(path, initial, hysteron), np.clip(initial, low, high))
    assert np.all(np.diff(high - low, axis=0) <= 0)


def test_gradient_is_finite_on_resting_and_saturated_paths(x64):
    path = np.array([0.0, 0.0, 1.0, 1.0, 4.0, 5.0, 4.0, 2.5, 2.5, 2.5, -1.0])
    for hysteron in HYSTERONS:
        total = partial(lambda h, x: hysteron_states(PLANE, x, "low", h).sum(), hysteron)
        assert np.isfinite(jax.jit(jax.grad(total))(path)).all()


ONES = np.ones(2)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((ONES, "low", "play"), "'play'"),
        ((ONES, "warm"), "'warm'"),
        ((ONES, np.zeros(3)), r"\(3,\).*\(10,\)"),
        ((ONES, np.zeros(10, int)), r"as in initial_states\.astype\(float\)"),
        (([[0.0, 1.0]],), r"\(1, 2\)"),
        (([-0.5, 1.0],), r"x is -0\.5 at sample 0, and the plane reaches .* clip the input"),
        (([0.0, np.nan],), "x is nan at sample 1: give finite numbers"),
    ],
)
def test_a_mistake_is_named_with_its_value(arguments, message):
    with pytest.raises(InputError, match=message):
        hysteron_states(PLANE, *arguments)
    if len(arguments) == 1:
        with pytest.raises(InputError, match=message):
            state_bounds(PLANE, *arguments)


@both_kinds
def test_rounding_at_the_limits_is_no_way_off_the_plane(hysteron, precision):
    x = np.array([-3e-6, 4 + 3e-6], precision)
    states = hysteron_states(PLANE, x, "low", hysteron)
    np.testing.assert_array_equal(states.sum(axis=1), [0, PLANE.cells])
    small = Plane(37, *np.array([-1e-3, 7e-4], precision))
    there_and_back = np.array([small.low, small.high, small.low], precision)
    states = hysteron_states(small, there_and_back, "low", hysteron)
    np.testing.assert_array_equal(states.sum(axis=1), [0, small.cells, 0])
    # In single precision the limit itself is rounded by more than a millionth of this range.
    far = Plane(levels=4, low=1e3, high=1e3 + 0.3)
    high = np.array([far.low, far.high], precision)
    np.testing.assert_allclose(hysteron_states(far, high, "low", hysteron)[1], 1.0, rtol=1e-12)

"""Laws of the Preisach operator, on any plane, any weights and any history.

The states of single hysterons have theirs in `test_hysteron.py`; here it is the output that users
see, from `simulate`, dense and from event to event, and from the filters that learn.
"""

import equinox as eqx
import hypothesis.strategies as st
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from oracles import slow_ramps, slow_relays
from strategies import PLANES, SAMPLES, histories, hysterons, planes, weights

import preisach_jax as pj

FORMS = ("dense", "event")
few = settings(max_examples=10)


def output(plane, weights, x, hysteron="ramp", initial="low", form="auto"):
    with jax.enable_x64(True):
        return np.asarray(pj.simulate(plane, weights, x, hysteron, initial, form))


def filled(path):
    """A path of the usual length: at rest at its end."""
    path = np.asarray(path, dtype=float)
    assert len(path) <= SAMPLES
    return np.append(path, np.full(SAMPLES - len(path), path[-1]))


@pytest.mark.parametrize("form", FORMS)
@few
@given(data=st.data())
def test_the_output_is_that_of_hysterons_one_by_one(form, data):
    plane = data.draw(planes)
    x, w = data.draw(histories(plane)), data.draw(weights(plane))
    exact = output(plane, w, x, "relay", form=form)
    np.testing.assert_allclose(exact, slow_relays(plane, x) @ w, rtol=1e-12, atol=1e-9)
    ramps = output(plane, w, x, "ramp", form=form)
    np.testing.assert_allclose(ramps, slow_ramps(plane, x) @ w, rtol=1e-12, atol=1e-9)


@few
@given(data=st.data(), hysteron=hysterons)
def test_a_closed_minor_loop_leaves_no_trace(data, hysteron):
    """Return-point memory: what follows a loop is as if it had not been."""
    plane = data.draw(planes)
    w, before = data.draw(weights(plane)), data.draw(histories(plane, 6))
    after, turn = data.draw(histories(plane, 6)), data.draw(histories(plane, 1))[0]
    inside = data.draw(histories(plane, 8))
    # From `turn`, between the last two turning points, away and back.
    bottom, top = sorted([before[-1], turn])
    loop = np.clip(inside, bottom, top)
    without = output(plane, w, filled([*before, turn, *after]), hysteron)[7:13]
    back = [*before, turn, *loop, before[-1], turn, *after]
    there = output(plane, w, filled(back), hysteron)
    np.testing.assert_allclose(there[17:23], without, rtol=1e-12, atol=1e-9)


@few
@given(data=st.data(), hysteron=hysterons)
def test_minor_loops_between_equal_inputs_are_congruent(data, hysteron):
    plane = data.draw(planes)
    w = data.draw(weights(plane))
    bottom, top = np.sort(data.draw(histories(plane, 2)))
    steps = np.linspace(bottom, top, 6)
    loop = np.concatenate([steps, steps[::-1]])
    shapes = []
    for _ in range(2):
        path = [*data.draw(histories(plane, 9)), bottom, top, *loop]
        z = output(plane, w, filled(path), hysteron)[11 : 11 + len(loop)]
        shapes.append(z - z[0])
    np.testing.assert_allclose(shapes[0], shapes[1], rtol=1e-12, atol=1e-9)


@few
@given(data=st.data(), hysteron=hysterons)
def test_only_the_turning_points_count_and_not_the_rate(data, hysteron):
    plane = data.draw(planes)
    w, turns = data.draw(weights(plane)), data.draw(histories(plane, 10))
    stretched = np.repeat(turns, 4)
    between = np.interp(np.arange(0, 9.1, 0.25), np.arange(10), turns)
    z = output(plane, w, filled(turns), hysteron)[:10]
    np.testing.assert_allclose(output(plane, w, stretched, hysteron)[::4], z, rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose(
        output(plane, w, filled(between), hysteron)[:37:4], z, rtol=1e-12, atol=1e-9
    )


@few
@given(data=st.data(), hysteron=hysterons)
def test_weights_that_are_not_negative_turn_loops_counterclockwise(data, hysteron):
    """The work that a closed loop takes up, the area ∮ x dz, is never negative."""
    plane = data.draw(planes)
    w, cycle = data.draw(weights(plane)), data.draw(histories(plane, 13))
    # A cycle whose greatest value comes first closes after one round, wherever it began.
    cycle = np.roll(cycle, -int(np.argmax(cycle)))
    path = filled([*cycle, *cycle, cycle[0]])
    z = output(plane, w, path, hysteron)
    assert z[26] == pytest.approx(z[13], rel=1e-12, abs=1e-9)
    x = np.interp(np.arange(0, 26.001, 1 / 8), np.arange(27), path[:27])
    z = output(plane, w, x, hysteron)[13 * 8 :]
    # At the end of each step, where a rise is counted too high and a fall too low, if anything.
    area = x[13 * 8 + 1 :] @ np.diff(z)
    assert area >= -1e-9 * (1 + w.sum() * np.abs(x).max())
    wide = plane.delta_x * (plane.alpha_index - plane.beta_index - (hysteron == "ramp"))
    if cycle[0] == plane.high and cycle.min() == plane.low:  # the major loop is among it
        assert area >= (w @ wide) * (1 - 1e-9)


@few
@given(data=st.data(), hysteron=hysterons)
def test_the_unit_of_the_input_does_not_matter(data, hysteron):
    """The same in another unit, from another zero: powers of two, so to the last bit."""
    plane, scale, zero = PLANES[0], 2.0**-9, 3.0
    x, w = data.draw(histories(plane)), data.draw(weights(plane))
    other = pj.Plane(plane.levels, scale * plane.low + zero, scale * plane.high + zero)
    np.testing.assert_array_equal(
        output(other, w, scale * x + zero, hysteron), output(plane, w, x, hysteron)
    )


@few
@given(data=st.data())
def test_the_everett_function_gives_the_area_of_the_triangle_switched(data):
    plane = data.draw(planes)
    w = data.draw(weights(plane))
    beta, alpha = np.sort(data.draw(histories(plane, 2)))
    z = output(plane, w, filled([plane.low, alpha, beta]))
    with jax.enable_x64(True):
        everett = float(plane.everett(w, alpha, beta))
    assert everett == pytest.approx((z[1] - z[2]) / 2, rel=1e-12, abs=1e-9)
    # By hand: what has been switched of each cell, a pyramid over the triangle.
    before, after = slow_ramps(plane, np.array([plane.low, alpha, beta]))[1:]
    assert everett == pytest.approx(w @ (before - after) / 2, rel=1e-12, abs=1e-9)


@few
@given(data=st.data(), hysteron=hysterons, sampling=st.sampled_from(["event", "sample"]))
def test_a_filter_that_knows_the_weights_keeps_them(data, hysteron, sampling):
    """Without noise the true weights are a fixed point of the recursion, whatever the history."""
    plane = data.draw(planes)
    x, w = data.draw(histories(plane)), data.draw(weights(plane))
    z = output(plane, w, x, hysteron)
    with jax.enable_x64(True):
        filt = pj.AdaptiveFilter(plane, hysteron=hysteron, sampling=sampling)
        knowing = eqx.tree_at(lambda state: state.weights, filt.init(x[0], z[0]), jnp.asarray(w))
        found = filt.run(x[1:], z[1:], state=knowing)
    np.testing.assert_allclose(found.weights, w, atol=1e-8)
    np.testing.assert_allclose(np.diff(found.output), np.diff(z[1:]), atol=1e-8)

"""The output of the Preisach operator, on any plane, any weights and any history.

What follows from it (return points, congruent loops, no rate) needs no test of its own: the slow
hysterons obey it.
"""

import hypothesis.strategies as st
import jax
import numpy as np
import pytest
from hypothesis import given, settings
from oracles import slow_ramps, slow_relays
from strategies import SAMPLES, histories, planes, weights

import preisach_jax as pj

few = settings(max_examples=20)


def output(plane, weights, x, hysteron="ramp", form="auto"):
    with jax.enable_x64(True):
        return np.asarray(pj.simulate(plane, weights, x, hysteron, "low", form))


@pytest.mark.parametrize("form", ["dense", "event"])
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
@given(data=st.data())
def test_the_everett_function_gives_the_area_of_the_triangle_switched(data):
    plane = data.draw(planes)
    w = data.draw(weights(plane))
    beta, alpha = np.sort(data.draw(histories(plane, 2)))
    path = np.full(SAMPLES, beta)
    path[:2] = plane.low, alpha
    z = output(plane, w, path)
    with jax.enable_x64(True):
        everett = float(plane.everett(w, alpha, beta))
    assert everett == pytest.approx((z[1] - z[2]) / 2, rel=1e-12, abs=1e-9)
    # By hand: what has been switched of each cell, a pyramid over the triangle.
    before, after = slow_ramps(plane, path[:3])[1:]
    assert everett == pytest.approx(w @ (before - after) / 2, rel=1e-12, abs=1e-9)

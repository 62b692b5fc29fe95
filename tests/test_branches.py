"""Branches between turning points against the states of all hysterons."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import PLANE, SAMPLES
from test_events import paths

from preisach_jax import Plane, simulate
from preisach_jax.operator.states import hysteron_states


@pytest.mark.parametrize(
    ("initial", "hysteron", "levels", "precision"),
    [
        ("high", "relay", 5, "float64"),
        ("demagnetised", "relay", 4, "float64"),
        ("demagnetised", "ramp", 4, "float64"),
        ("low", "relay", 5, "float32"),
        ("low", "ramp", 5, "float32"),
    ],
    indirect=["precision"],
)
def test_the_output_along_branches_is_that_of_all_states(
    initial, hysteron, levels, precision, tolerance
):
    plane = Plane(levels, PLANE.low, PLANE.high)
    weights = np.random.default_rng(4).uniform(0, 1, plane.cells).astype(precision)
    for kind in ("rests", "decay", "mixed"):
        x = paths(1)[kind].astype(precision)
        states = np.asarray(hysteron_states(plane, x, initial, hysteron))
        dense = simulate(plane, weights, x, hysteron, initial, form="dense")
        event = simulate(plane, weights, x, hysteron, initial, form="event")
        assert event.dtype == precision
        np.testing.assert_allclose(dense, states @ weights, rtol=0, atol=20 * tolerance)
        np.testing.assert_allclose(event, dense, rtol=0, atol=20 * tolerance, err_msg=kind)


def test_a_start_on_a_threshold_leaves_the_states_there_as_they_were(x64):
    weights, hysteron = np.random.default_rng(4).uniform(0, 1, PLANE.cells), "relay"
    for initial in ("high", "demagnetised"):
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
    batch[1] = 3.0  # at rest on a threshold
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

"""The plane's grid, quantiser, Everett function and initial memory."""

import hypothesis.strategies as st
import jax
import numpy as np
import pytest
from hypothesis import given

from preisach_jax.operator.plane import Plane
from preisach_jax.operator.states import hysteron_states

quantise = jax.jit(Plane.quantise)
everett_of = jax.jit(Plane.everett)


def test_cells_are_ordered_by_row_with_the_diagonal_and_thresholds_lie_in_their_middles():
    plane = Plane(levels=6, low=-1.0, high=11.0)
    assert plane.delta_x == 2.0
    assert plane.cells == len(plane.alpha) == len(plane.beta) == 21
    np.testing.assert_array_equal(plane.thresholds, [0, 2, 4, 6, 8, 10])
    order = [(i, j) for i in range(6) for j in range(i + 1)]
    np.testing.assert_array_equal(np.stack([plane.alpha_index, plane.beta_index], 1), order)
    np.testing.assert_array_equal(np.stack([plane.alpha, plane.beta], 1), 2 * np.array(order))


def slow_quantiser(x, thresholds):
    levels, rising = [], True
    for k, now in enumerate(x):
        if k and now != x[k - 1]:
            rising = now > x[k - 1]
        levels.append(sum(t <= now if rising else t < now for t in thresholds))
    return levels


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@given(quarters=st.lists(st.integers(-2, 18), min_size=30, max_size=30))
def test_quantiser_counts_thresholds_by_direction(dtype, quarters):
    plane = Plane(levels=4, low=0.0, high=4.0)
    path = np.array(quarters, dtype) / 4
    with jax.enable_x64(dtype == "float64"):
        levels = np.asarray(quantise(plane, path))
    assert levels.tolist() == slow_quantiser(path, plane.thresholds)


def test_matrix_shows_each_cell_at_its_indices():
    plane = Plane(levels=7, low=0.0, high=1.0)
    values = np.random.default_rng(0).normal(size=plane.cells)
    matrix = plane.matrix(values)
    np.testing.assert_array_equal(matrix[plane.alpha_index, plane.beta_index], values)
    np.testing.assert_array_equal(np.isnan(matrix), np.triu(np.ones((7, 7), bool), 1))


def test_everett_function_is_half_the_weight_of_the_triangle(precision, tolerance):
    plane = Plane(levels=5, low=0.0, high=5.0)
    weights = np.random.default_rng(4).uniform(size=plane.cells).astype(precision)
    limits = np.arange(6.0).astype(precision)
    everett = everett_of(plane, weights, limits[:, np.newaxis], limits[np.newaxis, :])
    assert everett.shape == (6, 6)
    assert everett.dtype == precision
    for row, alpha in enumerate(limits):
        for column, beta in enumerate(limits):
            triangle = (plane.alpha < alpha) & (plane.beta > beta)
            expected = weights[triangle].sum() / 2
            np.testing.assert_allclose(everett[row, column], expected, rtol=tolerance)


@pytest.mark.parametrize(("levels", "hysteron"), [(5, "relay"), (6, "relay"), (5, "ramp")])
def test_demagnetised_memory_is_what_a_decaying_input_leaves(levels, hysteron, x64):
    plane = Plane(levels=levels, low=-1.0, high=3.0)
    cycles = 1500
    amplitude = np.linspace(2.0, 0.0, 2 * cycles)
    path = 1.0 + amplitude * np.where(np.arange(2 * cycles) % 2 == 0, 1.0, -1.0)
    left = np.asarray(hysteron_states(plane, path, "low", hysteron))[-1]
    named = np.asarray(plane.initial_states("demagnetised", 1.0, hysteron))
    on_the_line = plane.alpha_index + plane.beta_index + 1 == levels
    # A relay on the line goes with the last extreme; a ramp settles half on.
    decided = ~on_the_line if hysteron == "relay" else np.ones(plane.cells, bool)
    np.testing.assert_allclose(named[decided], left[decided], atol=4e-3)
    assert np.all(named[on_the_line] == (0.5 if hysteron == "ramp" else 0.0))


@pytest.mark.parametrize("kind", ["low", "high", "demagnetised"])
def test_initial_memory_agrees_with_the_first_input(kind, precision):
    plane = Plane(levels=8, low=0.0, high=8.0)
    x0 = np.asarray(4.75, precision)
    states = plane.initial_states(kind, x0, "ramp")
    assert states.dtype == precision
    np.testing.assert_array_equal(hysteron_states(plane, x0[None], states, "ramp")[0], states)
    states = np.asarray(states)
    assert np.all(states[plane.alpha_index < 4] == 1)
    assert np.all(states[plane.beta_index > 4] == 0)
    free = (plane.alpha_index > 4) & (plane.beta_index < 4)
    if kind != "demagnetised":
        assert np.all(states[free] == (kind == "high"))
    else:
        assert 0 < float(states[free].sum()) < free.sum()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((1, 0.0, 1.0), "levels is 1: give a whole number of at least 2"),
        ((5, "low", 1.0), "a limit of the plane is 'low': give a number"),
        ((5, 1.0, 1.0), r"low is 1\.0 and high is 1\.0"),
        ((5, float("nan"), 1.0), "low is nan"),
    ],
)
def test_a_bad_plane_is_named_with_its_value(arguments, message):
    with pytest.raises(ValueError, match=message):
        Plane(*arguments)


def test_wrong_shapes_and_names_are_named():
    plane = Plane(levels=3, low=0.0, high=1.0)
    for call, message in (
        (lambda: plane.matrix(np.zeros(4)), r"values has the shape \(4,\).*\(6,\)"),
        (lambda: plane.everett(np.zeros(5), 1.0, 0.0), r"weights has the shape \(5,\).*\(6,\)"),
        (lambda: plane.initial_states("free", 0.0), "'free'"),  # pyright: ignore
        (lambda: plane.initial_states("low", 0.0, "soft"), "'soft'"),  # pyright: ignore
        (lambda: plane.quantise(np.zeros((1, 2))), r"\(1, 2\)"),
    ):
        with pytest.raises(ValueError, match=message):
            call()

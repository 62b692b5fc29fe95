"""The reduced basis of a record: what it holds, and that less than all of it is enough."""

import jax.numpy as jnp
import numpy as np
import pytest

from preisach_jax import Plane, Record
from preisach_jax.chain.coefficients import Coefficients, coarsened
from preisach_jax.chain.description import Chain
from preisach_jax.chain.driven import drive
from preisach_jax.chain.hysteresis import hysteresis_columns as columns_along
from preisach_jax.chain.signals import Drive
from preisach_jax.effects.input_lag import InputLag
from preisach_jax.identify import problem as identified
from preisach_jax.identify import regression
from preisach_jax.identify.problem import Problem, evaluate
from preisach_jax.operator.states import state_bounds

COUNT = 3000
PLANE = Plane(5, 0.0, 10.0)


def measured():
    """Plays along an input of many amplitudes that starts in the middle of its range."""
    rng = np.random.default_rng(0)
    time = np.arange(COUNT) / 100
    corners = np.concatenate([[4.0, 10.0, 0.0], rng.uniform(0, 10, 37)])
    drive_v = np.interp(time, np.linspace(0, time[-1], len(corners)), corners)
    output, plays = np.zeros(COUNT), np.full(5, drive_v[0])
    reach = np.array([0.3, 0.9, 1.7, 2.4, 3.6])
    for k, value in enumerate(drive_v):
        plays = np.clip(plays, value - reach, value + reach)
        output[k] = 0.4 * value + plays.sum() / 10
    output += 0.01 * rng.normal(size=COUNT)
    return Record.from_arrays(time, drive_v, output)


@pytest.fixture(autouse=True)
def small_planes_too(monkeypatch):
    monkeypatch.setattr(identified, "WHOLE_CELLS", 0)


@pytest.fixture
def all_vectors(monkeypatch):
    monkeypatch.setattr(regression, "SIZES", (10_000,))


def test_all_vectors_together_are_least_squares_without_signs(x64, all_vectors):
    problem = Problem.of(measured())
    full = evaluate(problem, Chain(PLANE), {}, 1e-4)
    small = evaluate(problem.reduced(), Chain(PLANE), {}, 1e-4)
    assert small.columns.vectors is not None
    assert small.columns.vectors.shape == (full.columns.offset,) * 2
    gram, moment = full.equations.system(full.folds, 1e-4)
    plain = np.linalg.solve(gram, moment)
    expected = full.target - full.matrix @ plain
    np.testing.assert_allclose(small.residual, expected, atol=2e-6)
    weights = small.coefficients().weights
    np.testing.assert_allclose(weights, problem.unit * plain[: PLANE.cells], atol=1e-4)


def test_few_vectors_predict_held_out_rows_as_all_do(x64):
    problem = Problem.of(measured())
    chain = Chain(Plane(20, 0.0, 10.0))
    full = evaluate(problem, chain, {}, 1e-4)
    small = evaluate(problem.reduced(), chain, {}, 1e-4)
    assert small.columns.vectors is not None
    assert 2 * small.columns.vectors.shape[1] < full.columns.offset + 50
    assert small.validation_mean_square < 1.1 * full.validation_mean_square


def test_a_basis_serves_for_other_paths(x64, all_vectors):
    """Another start leaves other hysterons open; each vector is the same density all the same."""
    problem = Problem.of(measured())
    basis = problem.reduced().basis(Chain(PLANE))
    path = jnp.asarray(np.concatenate([[9.0], problem.record.input[500:900]]))
    columns = columns_along(Chain(PLANE), Drive(path), "free")
    got = basis.applied_to(columns).states
    expected = combined(basis, path)
    # What never moves adds to the offset alone.
    np.testing.assert_allclose(got - got[-1], expected - expected[-1], atol=1e-9)


def combined(basis, path):
    """The vectors of a basis along a path, from the states of all hysterons."""
    low, high = state_bounds(PLANE, path)
    expected = np.asarray(low) @ basis.cells + np.asarray(high - low) @ basis.memory
    index = np.arange(PLANE.levels)
    position = np.asarray(path)[:, None] / PLANE.delta_x - index
    greatest = np.clip(np.maximum.accumulate(position), 0, 1) - 1
    least = np.clip(np.minimum.accumulate(position), 0, 1)
    for course, shares in zip((greatest, least), np.split(basis.first_run, 2), strict=True):
        expected += course @ shares
    return expected


def test_what_moves_the_input_gets_its_own_columns(x64):
    problem = Problem.of(measured())
    small = problem.reduced()
    chain = Chain(PLANE, (InputLag(),))
    values = {"input_lag": {"tau_s": 0.3}}
    point = evaluate(small, chain, values, 1e-4)
    expected = combined(small.basis(chain), drive(chain, values, problem.signals).rising)
    got = point.matrix[:, : point.columns.offset]
    np.testing.assert_allclose(got, expected[problem.rows], atol=1e-12)


# --- a density on a coarser plane ---


def test_a_coarser_plane_of_whole_cells_adds_weights_up(x64):
    fine, coarse = Plane(6, 0.0, 1.0), Plane(3, 0.0, 1.0)
    weights = np.arange(1.0, fine.cells + 1)
    found = coarsened(
        fine, Coefficients(weights, 0.5 * weights, 2.0, np.ones(1), np.arange(12.0)), 3
    )
    expected = np.zeros(coarse.cells)
    for weight, row, column in zip(weights, fine.alpha_index, fine.beta_index, strict=True):
        inside = (coarse.alpha_index == row // 2) & (coarse.beta_index == column // 2)
        expected[inside] += weight
    np.testing.assert_allclose(found.weights, expected)
    np.testing.assert_allclose(found.memory, expected / 2)
    np.testing.assert_allclose(found.first_run, [1, 5, 9, 13, 17, 21])
    assert found.offset == 2.0

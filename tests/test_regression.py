"""The linear part of the identification against SciPy's solvers and slow loops."""

from dataclasses import replace

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given
from scipy import optimize

from preisach_jax.identify.regression import (
    MEMORY_STRENGTH,
    RIDGE,
    choose_strength,
    normal_equations,
    penalties,
    smoothness,
    solve_nonnegative,
)


def problem(seed, rows=60, columns=12, mixing=0.0):
    """A random regression; `mixing` near one makes the columns nearly collinear."""
    rng = np.random.default_rng(seed)
    matrix = rng.normal(size=(rows, columns))
    matrix = (1 - mixing) * matrix + mixing * matrix[:, :1]
    target = matrix @ rng.normal(0.3, 1.0, size=columns) + rng.normal(size=rows)
    return matrix, target


# --- non-negative least squares ---


@pytest.mark.parametrize("mixing", [0.0, 0.999])
def test_solution_is_that_of_nnls(mixing):
    matrix, target = problem(1, mixing=mixing)
    got = solve_nonnegative(matrix.T @ matrix, matrix.T @ target, np.ones(12, dtype=bool))
    expected = optimize.nnls(matrix, target)[0]
    assert 0 < np.sum(expected == 0) < 12  # some bounds are active, so the test says something
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-7 / (1 - mixing))


def test_free_coefficients_may_be_negative():
    matrix, target = problem(2)
    nonnegative = np.arange(12) % 3 != 0
    got = solve_nonnegative(matrix.T @ matrix, matrix.T @ target, nonnegative)
    bounds = (np.where(nonnegative, 0.0, -np.inf), np.full(12, np.inf))
    expected = optimize.lsq_linear(matrix, target, bounds, tol=1e-14).x
    assert got[~nonnegative].min() < 0
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-5)


@given(
    seed=st.integers(0, 10_000),
    guess=st.integers(0, 2**12 - 1),
    mixing=st.sampled_from([0.0, 0.5, 0.99, 0.99999]),
    bounded=st.lists(st.booleans(), min_size=12, max_size=12).map(np.array),
    scale=st.sampled_from([1e-6, 1.0, 1e6]),
)
def test_the_solution_obeys_karush_kuhn_tucker_from_any_guess(seed, guess, mixing, bounded, scale):
    matrix, target = problem(seed, mixing=mixing)
    gram, moment = matrix.T @ matrix, matrix.T @ target * scale
    w = solve_nonnegative(gram, moment, bounded, (guess >> np.arange(12)) % 2 == 1)
    gradient = gram @ w - moment
    small = 1e-9 * np.abs(moment).max()
    assert np.all(w[bounded] >= 0)
    assert np.all(gradient[bounded] >= -small)
    assert np.all(np.abs(gradient[~bounded]) <= small)
    assert np.all(np.abs(gradient[w > 0]) <= small)


def test_a_matrix_that_is_not_positive_definite_is_refused():
    with pytest.raises(np.linalg.LinAlgError):
        solve_nonnegative(-np.eye(2), np.ones(2), np.zeros(2, dtype=bool))


# --- smoothness of the density ---


def slow_energy(levels, weights):
    """Thin-plate energy by loops over the cells of the plane, the diagonal along itself only."""
    plane = {}
    for k, (i, j) in enumerate(zip(*np.tril_indices(levels), strict=True)):
        plane[int(i), int(j)] = weights[k]
    inside = {cell: w for cell, w in plane.items() if cell[0] > cell[1]}
    energy = 0.0
    for (i, j), here in inside.items():
        if {(i - 1, j), (i + 1, j)} <= inside.keys():
            energy += (inside[i - 1, j] - 2 * here + inside[i + 1, j]) ** 2
        if {(i, j - 1), (i, j + 1)} <= inside.keys():
            energy += (inside[i, j - 1] - 2 * here + inside[i, j + 1]) ** 2
        if {(i + 1, j), (i, j + 1), (i + 1, j + 1)} <= inside.keys():
            twist = here - inside[i + 1, j] - inside[i, j + 1] + inside[i + 1, j + 1]
            energy += 2 * twist**2
    for i in range(1, levels - 1):
        energy += (plane[i - 1, i - 1] - 2 * plane[i, i] + plane[i + 1, i + 1]) ** 2
    return energy


@pytest.mark.parametrize("levels", [1, 2, 5])
def test_smoothness_is_the_thin_plate_energy(levels):
    rng = np.random.default_rng(levels)
    form = smoothness(levels)
    w = rng.normal(size=levels * (levels + 1) // 2)
    assert w @ form @ w == pytest.approx(slow_energy(levels, w), abs=1e-12)


# --- normal equations ---


def regression(seed, levels=4, rows=80, extra=2):
    """A regression with columns for cells, two memory groups, an offset and added effects."""
    rng = np.random.default_rng(seed)
    cells = levels * (levels + 1) // 2
    groups = (np.array([0, 3]), np.array([5]))
    columns = cells + len(groups) + 1 + extra
    matrix = rng.uniform(size=(rows, columns))
    matrix[:, -1] *= 1e4
    target = rng.normal(size=rows)
    fold = np.sort(rng.integers(0, 4, rows))
    nonnegative = np.arange(columns) < cells + len(groups)
    return matrix, target, fold, nonnegative, penalties(levels, groups)


def test_the_system_is_the_minimum_of_error_and_penalty():
    given = regression(5)
    given[0][:, -1] = 0.0  # a column of zeros does no harm
    equations = normal_equations(*given)
    folds, strength = np.array([0, 2]), 1e-2
    gram, moment = equations.system(folds, strength)
    solution = solve_nonnegative(gram, moment, equations.nonnegative)

    assert np.isfinite(solution / equations.scale).all()
    assert solution[-1] == 0.0

    def objective(w):
        ridge = RIDGE * np.diag(gram).max() / equations.count[folds].sum()
        return equations.mean_square(w, folds) + equations.penalty(w, strength) + ridge * (w @ w)

    rng = np.random.default_rng(6)
    for _ in range(50):
        other = solution + 0.01 * rng.normal(size=len(solution))
        other = np.where(equations.nonnegative, np.maximum(other, 0.0), other)
        assert objective(solution) <= objective(other)


def test_the_penalty_is_smoothness_and_half_of_the_possible_memory():
    equations = normal_equations(*regression(7))
    w = np.random.default_rng(8).uniform(size=equations.gram.shape[1])
    memory = (w[10] - (w[0] + w[3]) / 2) ** 2 + (w[11] - w[5] / 2) ** 2
    expected = 0.3 * slow_energy(4, w[:10]) + MEMORY_STRENGTH * memory
    assert equations.penalty(w, 0.3) == pytest.approx(expected)


def test_appended_columns_are_columns_of_a_larger_regression():
    given = regression(9)
    matrix, target, fold, nonnegative, asked = given
    more = np.random.default_rng(10).normal(size=(len(target), 2))
    unit = np.sqrt(np.mean(more**2, axis=0))
    folds = [fold == k for k in range(4)]
    small = normal_equations(*given)
    scaled = matrix / small.scale
    extended = small.extended(
        np.stack([scaled[k].T @ more[k] for k in folds]),
        np.stack([more[k].T @ more[k] for k in folds]),
        np.stack([more[k].T @ target[k] for k in folds]),
    )
    whole = normal_equations(
        np.hstack([matrix, more]), target, fold, np.append(nonnegative, [False] * 2), asked
    )
    shrink = np.append(np.ones(matrix.shape[1]), unit)
    np.testing.assert_allclose(extended.gram, whole.gram * np.outer(shrink, shrink), atol=1e-9)
    np.testing.assert_allclose(extended.moment, whole.moment * shrink, atol=1e-9)
    np.testing.assert_array_equal(extended.nonnegative, whole.nonnegative)
    np.testing.assert_array_equal(extended.prior, whole.prior)
    np.testing.assert_array_equal(extended.memory, whole.memory)


# --- strength of the prior ---


def density_regression(noise, seed=0, levels=8, rows=600):
    """Cells of a plane seen through random mixtures; a density that is smooth but not a plane."""
    rng = np.random.default_rng(seed)
    i, j = np.tril_indices(levels)
    density = 1 + np.cos(np.pi * i / levels) * np.sin(np.pi * j / levels)
    matrix = np.hstack([rng.uniform(size=(rows, len(i))), np.ones((rows, 1))])
    target = matrix[:, :-1] @ density + noise * rng.normal(size=rows)
    fold = np.arange(rows) * 4 // rows
    nonnegative = np.arange(len(i) + 1) < len(i)
    return normal_equations(matrix, target, fold, nonnegative, penalties(levels, ())), density


def test_noise_asks_for_a_strong_prior_and_clean_data_for_a_weak_one():
    noises = (1e-5, 0.3, 10.0)
    chosen = [choose_strength(density_regression(n)[0], np.arange(4), 1.0) for n in noises]
    assert chosen == sorted(chosen)
    assert chosen[0] <= 1e-6
    assert chosen[-1] >= 1e-2


def test_a_fold_that_no_other_tells_of_does_not_choose():
    """As the first stretch of a record that begins with an unknown memory."""
    equations, _ = density_regression(0.3)
    power = equations.power.copy()
    power[0] += 1e8 * power[0]
    drowned = replace(equations, power=power)
    expected = choose_strength(equations, np.arange(1, 4), 1e-4)
    chosen = choose_strength(drowned, np.arange(4), 1e-4)
    assert abs(np.log10(chosen / expected)) < 1.5

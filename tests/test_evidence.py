"""The score and the error budget: what they let pass, and what their numbers are."""

import re
from dataclasses import replace

import numpy as np
import pytest
import world
from scipy import signal, stats
from threadpoolctl import threadpool_limits

import preisach_jax as pj
from preisach_jax.chain.output import response
from preisach_jax.chain.signals import signals_of
from preisach_jax.diagnosis.budget import (
    MOST_LEVELS,
    Floor,
    by_another_plane,
    discretisation_rms,
    error_budget,
    input_quantisation_rms,
    memory_rms,
    refined_levels,
    within_cells_rms,
)
from preisach_jax.diagnosis.evidence import (
    LEAST_SCORE,
    OF_THE_LAW,
    STRETCHES,
    Evidence,
    compare,
    simple_ratio,
)
from preisach_jax.diagnosis.noise import innovation_variance, noise_rms
from preisach_jax.effects.drift import Drift
from preisach_jax.fit.fitted import finished
from preisach_jax.fit.stepwise import at_levels, base_point, on_a_coarser_plane, with_effect
from preisach_jax.identify.problem import FOLDS, Problem, with_all_rows
from preisach_jax.identify.regression import solve_nonnegative
from preisach_jax.operator.plane import Plane
from preisach_jax.record.core import Record

LEVELS = 9


@pytest.fixture(autouse=True)
def one_thread():
    with threadpool_limits(1):
        yield


def problem_of(effect, seed=3, rate_hz=500.0, **options):
    rec = world.hidden_record(effect, seed, duration_s=6.0, rate_hz=rate_hz, **options)
    return Problem.of(Record.from_arrays(rec["t"], rec["x"], rec["z"], initial_memory="low"))


@pytest.mark.parametrize(
    ("evidence", "says"),
    [
        (Evidence(-0.1, 99.0, 24), "does not fall"),
        (Evidence(0.5, LEAST_SCORE - 0.1, 24), "score over 24 stretches is 2.9, below 3"),
        (Evidence(np.nan, 9.0, 24), "does not fall"),
        (Evidence(0.5, np.nan, 24), "score over 24 stretches is nan"),
        (Evidence(0.5, LEAST_SCORE, 24), "^$"),
    ],
)
def test_the_evidence_says_why_it_is_too_little(evidence, says):
    assert re.search(says, evidence.against)


def test_the_score_is_a_students_t_with_what_laws_leave():
    rng = np.random.default_rng(2)
    simple = np.exp(rng.normal(0.4, 0.3, STRETCHES))
    rich = np.exp(rng.normal(-0.6, 0.3, STRETCHES))
    r = np.log(simple / rich) / 2
    own = stats.ttest_1samp(r, 0.0)
    error = float(np.mean(r)) / float(getattr(own, "statistic"))  # noqa: B009
    expected = float(np.mean(r)) / np.hypot(error, OF_THE_LAW)
    assert Evidence.of(simple, rich, 0.5).score == pytest.approx(expected)
    # A floor far above both says nothing; nothing lost is nothing gained.
    assert abs(Evidence.of(simple, rich, 0.5, 1e6).score) < 1e-3
    assert Evidence.of(simple, simple, 0.0).score == 0.0
    # A model without any error in some stretches is no reason for infinity.
    assert np.isfinite(Evidence.of(simple, np.where(rich > 0.5, 0.0, rich), 0.5).score)
    assert simple_ratio(1.0, 4.0) == 0.25
    assert simple_ratio(0.0, 0.0) == 1.0


@pytest.mark.parametrize("coefficients", [[], [0.9], [1.4, -0.6]])
def test_innovations_are_what_an_autoregression_cannot_foretell(coefficients):
    rng = np.random.default_rng(0)
    white = 0.3 * rng.normal(size=20_000)
    residual = np.asarray(signal.lfilter([1.0], [1.0, *[-c for c in coefficients]], white))
    assert innovation_variance(residual) == pytest.approx(0.09, rel=0.03)
    # Few rows take few lags.
    assert 0.2 < innovation_variance(residual[:60]) / 0.09 < 2.0
    assert innovation_variance(np.zeros(100)) > 0.0


def test_evidence_for_the_right_effect(x64):
    problem = problem_of("drift")
    base = base_point(problem, LEVELS)
    drift = with_effect(problem, base, Drift())
    evidence = compare(problem, base, drift)
    assert evidence.against == ""
    assert evidence.gain > 0.9
    assert evidence.blocks == STRETCHES
    assert compare(problem, drift, base).score == pytest.approx(-evidence.score)
    assert compare(problem, base, drift, floor=100 * base.validation_mean_square).against


def test_noise_is_measured_beside_the_error_of_the_grid(x64):
    problem = problem_of(None, rate_hz=1500.0)
    expected = np.hypot(0.006, world.ENCODER_STEP / np.sqrt(12))
    assert noise_rms(problem, base_point(problem, LEVELS)) == pytest.approx(expected, rel=0.15)


def test_steps_of_the_input_do_what_rounding_it_does(x64):
    """Against the change of a smooth input's output when it is rounded."""
    problem = problem_of(None, noise_um=0.5)
    point = base_point(problem, LEVELS)
    assert input_quantisation_rms(problem, point) == 0.0
    smooth = problem.record.input
    step = np.ptp(smooth) / 300
    recorded = np.round(smooth / step) * step
    stepped = Problem.of(replace(problem.record, input=recorded))
    drives = [signals_of(replace(problem.record, input=path)) for path in (smooth, recorded)]
    outputs = [response(point.chain, {}, drive, point.coefficients()) for drive in drives]
    expected = np.sqrt(np.mean((outputs[1] - outputs[0]) ** 2))
    got = input_quantisation_rms(stepped, base_point(stepped, 9))
    assert got == pytest.approx(expected, rel=0.3)
    # Steps of the drive itself are no rounding, and those of a coarse output are noise.
    stairs = replace(
        problem.record, input=np.round(smooth / np.ptp(smooth) * 4) * np.ptp(smooth) / 4
    )
    assert input_quantisation_rms(Problem.of(stairs), point) == 0.0
    output = np.round(problem.record.output / 3) * 3
    assert noise_rms(Problem.of(replace(problem.record, output=output)), point) >= 3 / np.sqrt(12)


def test_a_grid_error_beyond_the_whole_leaves_nothing_unexplained(x64):
    problem = problem_of("drift", noise_um=0.02)
    fit = finished(problem, base_point(problem, LEVELS), problem.record)
    budget = error_budget(problem, fit, Floor.of(problem, fit), (99.0, 99.0))
    shares = (budget.noise, budget.discretisation, budget.memory, budget.unexplained)
    assert np.linalg.norm(shares) == pytest.approx(fit.rms_validation)
    assert budget.is_met


def test_planes_are_refined_by_half_as_long_as_it_is_cheap():
    assert refined_levels(10_000, 24) == 36
    assert refined_levels(10_000, 40) == MOST_LEVELS
    assert refined_levels(10_000_000, 24) is None
    # Nor to more cells than there are rows: 38 levels have 741.
    assert (refined_levels(740, 25), refined_levels(741, 25)) == (None, 38)


def test_discretisation_is_what_a_finer_plane_takes_away(x64):
    """Nothing hidden and no noise: the whole error of a coarse plane is its grid."""
    problem = problem_of(None, noise_um=0.0)
    coarse = base_point(problem, 5)
    fine = at_levels(problem, coarse, 17)
    error = np.sqrt(coarse.validation_mean_square) * problem.unit
    assert by_another_plane(problem, coarse, fine) == pytest.approx(error, rel=0.15)


def test_memory_is_what_the_rows_held_out_would_have_told(x64):
    problem = problem_of(None, noise_um=0.02)
    point = base_point(problem, LEVELS)
    held_out = problem.fold == FOLDS - 1
    gram, moment = point.equations.system(np.arange(FOLDS), point.strength)
    solution = solve_nonnegative(gram, moment, point.equations.nonnegative)
    errors = [
        np.mean((point.target - point.matrix @ each)[held_out] ** 2)
        for each in (point.solution, solution)
    ]
    expected = np.sqrt(errors[0] - errors[1]) * problem.unit
    assert expected > 0.001
    assert memory_rms(problem, point) == pytest.approx(expected, rel=1e-4)
    assert memory_rms(problem, with_all_rows(point)) == pytest.approx(0.0, abs=1e-6)


def test_without_a_finer_plane_a_coarser_one_tells(x64):
    problem = problem_of(None, noise_um=0.0)
    point = base_point(problem, LEVELS)
    error = np.sqrt(point.validation_mean_square) * problem.unit
    coarser = on_a_coarser_plane(problem, point)
    assert coarser.chain.plane.levels == 6
    assert 0.2 * error < by_another_plane(problem, point, coarser) <= error
    # Of an error that is no grid error, little is held to be one.
    noisy = problem_of(None, noise_um=0.5)
    point = base_point(noisy, 9)
    coarser = on_a_coarser_plane(noisy, point)
    assert by_another_plane(noisy, point, coarser) < 0.3 * 0.5


def wandering(count=6000, seconds=24.0):
    """Straight strokes between random turning points, 0 to 1."""
    rng = np.random.default_rng(3)
    time = np.arange(count) / count * seconds
    corners = np.cumsum(10 ** rng.uniform(-1.0, -0.3, 80))
    turns = np.where(np.arange(80) % 2, 1.0, 0.0) + rng.uniform(-0.4, 0.4, 80)
    return time, np.clip(np.interp(time, corners / corners[-1] * seconds, turns), 0, 1)


def of_relays(values, count=60):
    """What relays of many thresholds and jumps make of a course."""
    rng = np.random.default_rng(5)
    middle, half = rng.uniform(0.1, 0.9, count), rng.exponential(0.07, count)
    jump, state, output = rng.uniform(0.3, 1.7, count) / count, np.zeros(count), []
    for x in values:
        state = np.where(x >= middle + half, 1.0, np.where(x <= middle - half, 0.0, state))
        output.append(state @ jump)
    return np.array(output)


def test_what_comes_back_within_cells_is_the_grid_of_relays(x64):
    """The error of a plane fitted to some dozens of jumps is its grid; no other plane is asked."""
    time, values = wandering(12_000)
    record = Record.from_arrays(time, values, of_relays(values))
    fit = pj.fit(record, levels=20)
    within = within_cells_rms(record, fit.residual, fit.model.plane)
    assert within is not None
    assert 0.4 * fit.rms_validation < within[0] <= 1.1 * fit.rms_validation
    # Noise of that size, in the place of the jumps, shares nothing from pass to pass.
    noise = np.std(fit.residual) * np.random.default_rng(6).normal(size=len(time))
    by_chance = within_cells_rms(record, noise, fit.model.plane)
    assert by_chance is not None
    assert by_chance[0] < by_chance[1] < 0.25 * within[0]


def test_physics_that_a_finer_plane_fits_is_not_the_grid(x64):
    """A sensor that slips now and then: planes fit it, the finer the better; no cell makes it."""
    time, values = wandering()
    # Over some dozens of samples: what a sensor jumps within one is taken back before the fit.
    slips = 0.025 * (1 + np.tanh(5 * (np.sin(3 * time) + np.sin(1.7 * time) - 0.3)))
    record = Record.from_arrays(time, values, values**1.2 + slips)
    problem = Problem.of(record, len(time))
    point = base_point(problem, 12)
    coarser = on_a_coarser_plane(problem, point)
    fit = pj.fit(record, levels=12)
    within = within_cells_rms(record, fit.residual, fit.model.plane)
    assert within is not None
    grid = discretisation_rms(problem, point, coarser, within)
    assert grid <= 6 * within[1] < 0.5 * fit.rms_validation
    assert discretisation_rms(problem, point, coarser, None) == by_another_plane(
        problem, point, coarser
    )


def test_few_passes_or_those_of_other_parts_of_a_cell_do_not_tell():
    time = np.arange(40.0)
    record = Record.from_arrays(time, np.abs(time - 20), time)
    assert within_cells_rms(record, time, Plane(10, 0.0, 20.0)) is None
    # Two strokes, one through the lower half of each cell and one through the upper one.
    below = np.concatenate([k + np.linspace(0.02, 0.45, 6) for k in range(4)])
    values = np.concatenate([below, below + 0.5])
    time = np.arange(len(values), dtype=float)
    record = Record.from_arrays(time, values, values)
    assert within_cells_rms(record, np.cos(time), Plane(4, 0.02, 3.95)) is None

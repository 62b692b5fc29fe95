"""Identification recovers what was put in, from rows that were measured and not held out."""

from dataclasses import replace
from itertools import product

import hypothesis.strategies as st
import jax
import numpy as np
import pytest
import world
from hypothesis import given, settings
from threadpoolctl import threadpool_limits

import preisach_jax as pj
from preisach_jax.chain.coefficients import Coefficients
from preisach_jax.chain.description import Chain
from preisach_jax.chain.output import response
from preisach_jax.chain.signals import signals_of
from preisach_jax.effects.base import Survey
from preisach_jax.effects.creep import Creep
from preisach_jax.effects.drift import Drift
from preisach_jax.effects.input_lag import InputLag
from preisach_jax.fit.stepwise import best_start
from preisach_jax.identify.gauss_newton import refine, starts_of, stepped
from preisach_jax.identify.problem import (
    IDENTIFICATION,
    VALIDATION,
    Problem,
    evaluate,
    thinned_rows,
    with_all_rows,
    with_strength,
)
from preisach_jax.operator.plane import Plane
from preisach_jax.record.core import Record


@pytest.fixture(autouse=True)
def one_thread():
    """As in `fit`: for matrices of these sizes, threads that wait for a processor cost more."""
    with threadpool_limits(1):
        yield


LEVELS = 5


def wander(count=3000, seconds=6.0):
    """Time (s) and an input (V) with ramps at several rates, holds and a chirp, from rest."""
    rate = count / seconds
    return np.arange(count) / rate, world.excitation("rich", seconds, rate, 1)


def simulated(effects, values, added=(), noise=1e-3, count=3000):
    """A record of the model itself, with random smooth weights; and its chain."""
    time, drive = wander(count)
    rng = np.random.default_rng(2)
    load = np.cumsum(rng.normal(size=count)) * 0.1
    chain = Chain(Plane(LEVELS, float(drive.min()), float(drive.max())), tuple(effects))
    i, j = np.tril_indices(LEVELS)
    weights = 0.5 + 0.2 * i + 0.1 * j + (i == j)  # not drawn to another value
    rest = np.zeros(len(chain.coefficients) - len(added))  # at rest before the record
    coefficients = Coefficients(weights, np.zeros(len(i)), 2.0, np.append(added, rest))
    units = {"input": "V", "output": "um", "load_N": "N"}
    blank = Record.from_arrays(
        time, drive, 0 * time, aux={"load_N": load}, units=units, initial_memory="low"
    )
    output = np.asarray(response(chain, values, signals_of(blank), coefficients))
    return replace(blank, output=output + noise * rng.normal(size=count)), chain


# --- a record cut into blocks ---


@settings(max_examples=10)
@given(count=st.sampled_from([80, 400]), holes=st.integers(0, 30), seed=st.integers(0, 100))
def test_blocks_hold_every_measured_row_once(count, holes, seed):
    rng = np.random.default_rng(seed)
    output = rng.normal(size=count)
    output[rng.choice(count, holes, replace=False)] = np.nan
    problem = Problem.of(Record.from_arrays(np.arange(count), rng.normal(size=count), output))
    measured = np.flatnonzero(np.isfinite(output))
    np.testing.assert_array_equal(np.sort(problem.rows), measured)
    np.testing.assert_array_equal(problem.rows[problem.in_time], measured)
    np.testing.assert_array_equal(problem.target, output[problem.rows])
    assert np.all(np.diff(problem.fold) >= 0)  # a fold is one slice
    block = problem.block[problem.in_time]
    fold = problem.fold[problem.in_time]
    assert np.all(np.diff(block) >= 0)  # a block is one stretch of time
    for one in np.unique(block):
        assert len(set(fold[block == one])) == 1
    assert set(fold) == set(range(4))
    assert abs(np.mean(fold == VALIDATION[0]) - 0.25) < 0.05
    # The ends of the record are never predicted beyond what was seen.
    assert fold[0] in IDENTIFICATION
    assert fold[-1] in IDENTIFICATION
    for k in range(4):
        inside = problem.rows[problem.fold == k]
        assert np.all(np.diff(inside) > 0)


def test_no_period_falls_in_step_with_a_fold():
    count = 96 * 50
    problem = Problem.of(Record.from_arrays(*(np.arange(count),) * 3))
    for fold, blocks_a_period in product(range(4), [2, 4, 8, 12, 16, 24]):
        phase = problem.rows[problem.fold == fold] / (50 * blocks_a_period) % 1
        shares = np.histogram(phase, [0, 0.25, 0.5, 0.75, 1])[0] / len(phase)
        assert shares.min() > 1 / 16, (fold, blocks_a_period)


def test_what_was_not_measured_is_not_used(x64):
    record, chain = simulated((), {})
    output = np.array(record.output)
    output[300:400] = np.nan
    holed = replace(record, output=output)
    problem = Problem.of(holed)
    point = with_all_rows(evaluate(problem, chain, {}, 1e-6))
    whole = Problem.of(record)
    full = with_all_rows(evaluate(whole, chain, {}, 1e-6))
    # The input there was seen: the memory goes on through the gap.
    seen = full.matrix[whole.in_time] @ point.solution * problem.unit + problem.level
    error = holed.output - seen
    assert np.nanmax(np.abs(error)) < 0.02


def test_held_out_rows_do_not_identify(x64):
    record, chain = simulated((), {})
    problem = Problem.of(record)
    held_out = problem.rows[problem.fold == VALIDATION[0]]
    output = np.array(record.output)
    output[held_out] = output[held_out][::-1]
    other = Problem.of(replace(record, output=output))
    assert other.unit == problem.unit
    points = [with_strength(p, evaluate(p, chain, {}, 1e-4)) for p in (problem, other)]
    np.testing.assert_array_equal(points[0].solution, points[1].solution)
    assert points[0].strength == points[1].strength
    assert points[1].validation_mean_square > 100 * points[0].validation_mean_square
    moved = [with_all_rows(point).solution for point in points]
    assert np.abs(moved[0] - moved[1]).max() > 1e-3


# --- thinning ---


def test_thinning_keeps_reversals_with_flat_tops():
    """A converter repeats the value at a turning point."""
    ramp = np.arange(200.0)
    values = np.tile(np.concatenate([ramp, ramp[::-1]]), 30)
    kept = thinned_rows(values, 600)
    assert len(kept) < 1500
    np.testing.assert_array_equal(_turns(values[kept]), _turns(values))
    assert 50 <= len(thinned_rows(np.full(1000, 3.0), 100)) <= 200


def _turns(values):
    """The extremes of a course in their order."""
    moved = values[np.append(True, np.diff(values) != 0)]
    turned = np.diff(np.sign(np.diff(moved))) != 0
    return moved[np.concatenate([[True], turned, [True]])]


def test_thinning_spends_its_samples_where_the_input_bends():
    time, drive = wander(48_000, 24.0)
    kept = thinned_rows(drive, 6000)
    even = np.linspace(0, len(time) - 1, len(kept)).astype(int)
    errors = [
        np.sqrt(np.mean((np.interp(time, time[rows], drive[rows]) - drive) ** 2))
        for rows in (kept, even)
    ]
    assert errors[0] < 0.5 * errors[1]
    # A thinned record keeps its time scales.
    record = Record.from_arrays(time, drive, drive, aux={"load_N": drive})
    problem = Problem.of(record, 1000)
    assert len(problem.record) < 3000
    assert problem.survey == Survey(record.duration_s, record.step_s)
    rows = np.searchsorted(time, problem.record.time)
    np.testing.assert_array_equal(problem.record.input, drive[rows])
    np.testing.assert_array_equal(problem.record.aux["load_N"], drive[rows])


# --- linear part ---


def test_the_weights_of_the_model_are_found(x64):
    record, chain = simulated((), {}, noise=1e-6)
    problem = Problem.of(record)
    point = evaluate(problem, chain, {}, 1e-8)
    i, j = np.tril_indices(LEVELS)
    got = point.coefficients()
    np.testing.assert_allclose(got.weights, 0.5 + 0.2 * i + 0.1 * j + (i == j), atol=0.01)
    assert got.offset == pytest.approx(2.0, abs=0.01)
    assert np.sqrt(point.validation_mean_square) * problem.unit < 1e-3


def test_columns_of_the_operator_follow_the_input_effects(x64):
    """They are kept from one evaluation to the next, and must not be when the path has changed."""
    record, chain = simulated((), {})
    chain = chain.with_effects((InputLag(),))
    problem = Problem.of(record)
    for tau in (0.02, 0.3, 0.02):
        values = {"input_lag": {"tau_s": tau}}
        kept = evaluate(problem, chain, values, 1e-4)
        fresh = evaluate(Problem.of(record), chain, values, 1e-4)
        np.testing.assert_array_equal(kept.matrix, fresh.matrix)


# --- nonlinear parameters ---


SURVEY = Survey(6.0, 1 / 500)
OWN = [
    (InputLag(), {"tau_s": 0.031}, ()),
    (Drift(), {"tau_s": 2.1}, (0.8,)),
    (Creep(), {"c_2": 0.01, "c_4": 0.03}, ()),
]


@pytest.mark.parametrize(("kind", "truth", "added"), OWN, ids=[case[0].name for case in OWN])
def test_parameters_of_the_models_own_records_are_found(x64, kind, truth, added):
    effect = kind.bound_to(SURVEY)
    every = {parameter.name: 0.0 for parameter in effect.parameters()} | truth
    record, chain = simulated((effect,), {effect.name: every}, added)
    problem = Problem.of(record)
    base = with_strength(problem, evaluate(problem, chain.with_effects(()), {}, 1e-4))
    start = best_start(problem, base, chain, effect.name, starts_of(effect), 1)
    found = refine(problem, start, iterations=20, tolerance=1e-7)
    assert found.objective <= start.objective
    for name, value in every.items():
        expected = pytest.approx(value, rel=0.01, abs=1e-3)
        assert found.values[effect.name][name] == expected, name
    coefficients = found.coefficients()
    np.testing.assert_allclose(coefficients.added[: len(added)], added, rtol=0.01)
    np.testing.assert_allclose(coefficients.added[len(added) :], 0.0, atol=7e-3)  # it was at rest
    assert np.sqrt(found.validation_mean_square) * problem.unit < 1.3e-3  # the noise is 1e-3
    assert found.validation_mean_square < 0.05 * base.validation_mean_square


def test_a_step_without_new_regressors_lands_where_refining_does(x64):
    record, chain = simulated((InputLag(),), {"input_lag": {"tau_s": 0.05}}, noise=0.02)
    problem = Problem.of(record)
    near = evaluate(problem, chain, {"input_lag": {"tau_s": 0.0495}}, 1e-4)
    after = stepped(problem, near)
    kept = refine(problem, near, iterations=10, tolerance=1e-9)
    assert kept.objective < near.objective
    moved = kept.values["input_lag"]["tau_s"] - 0.0495
    assert abs(moved) > 1e-5
    assert after.values["input_lag"]["tau_s"] - 0.0495 == pytest.approx(moved, rel=0.05)
    size = np.abs(kept.solution).max()
    np.testing.assert_allclose(after.solution, kept.solution, atol=0.01 * size)
    # It stays inside the bounds.
    narrow = Chain(chain.plane, (InputLag(tau_low_s=0.001, tau_high_s=0.02),))
    end = refine(problem, evaluate(problem, narrow, {"input_lag": {"tau_s": 0.004}}, 1e-4))
    assert end.values["input_lag"]["tau_s"] == pytest.approx(0.02)


# --- records of another make ---


ACTUATOR = {"delay_s": 1.5e-3, "tau_s": 0.05, "gain": 0.025}  # relative error


@pytest.mark.parametrize("effect", ["delay", "aux"])
def test_parameters_of_the_simulated_actuator_are_found(effect):
    rec = world.hidden_record(effect, 3, duration_s=6.0, rate_hz=1000.0)
    name = "aux:load_N" if effect == "aux" else effect
    record = Record.from_arrays(
        rec["t"], rec["x"], rec["z"], aux=rec["aux"], units={"output": "um"}, initial_memory="low"
    )
    before = jax.config.read("jax_enable_x64")
    found = pj.fit(record, [name], levels=13)
    assert jax.config.read("jax_enable_x64") == before  # the precision is the caller's
    for parameter, estimate in found.model.parameters[name].items():
        truth = pytest.approx(rec["truth"][parameter], rel=ACTUATOR[parameter])
        assert estimate.value == truth, parameter
    assert found.rms_validation < 0.04

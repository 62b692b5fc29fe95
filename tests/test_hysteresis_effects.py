"""Effects inside the hysteresis and in the sensor, against loops, root finding and differences."""

from itertools import pairwise
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
import world
from scipy import signal
from scipy.optimize import brentq

import preisach_jax as pj
from preisach_jax.chain import (
    Chain,
    Coefficients,
    Drive,
    behind_hysteresis,
    drive,
    hysteresis_columns,
    hysteresis_output,
    regressors,
    response,
    signals_of,
    tangents,
)
from preisach_jax.effects import resolve
from preisach_jax.effects.base import Survey
from preisach_jax.effects.creep import Creep
from preisach_jax.effects.input_lag import InputLag
from preisach_jax.effects.moving import Moving
from preisach_jax.effects.output_nonlinearity import OutputNonlinearity
from preisach_jax.effects.output_quantisation import OutputQuantisation, lattice_step
from preisach_jax.effects.rate_dependence import RateDependence
from preisach_jax.fit import base_point, double_precision, finished, plane_of, with_effect
from preisach_jax.identify import Problem, evaluate, refine, with_all_rows
from preisach_jax.identify.confidence import estimates
from preisach_jax.model import Model
from preisach_jax.operator.plane import Plane
from preisach_jax.operator.states import hysteron_states, weighted_states
from preisach_jax.plant import simulate_stage
from preisach_jax.record import Record

PLANE = Plane(levels=6, low=0.0, high=12.0)
WEIGHTS = np.random.default_rng(1).uniform(0.2, 1.0, PLANE.cells)
TOTAL = float(WEIGHTS.sum())
kinds = pytest.mark.parametrize("hysteron", ["ramp", "relay"])


def wandering(count=150, seed=0, start=0.0, jump=1.5):
    """Uneven times with a gap, and an input that wanders over the plane and rests at times."""
    rng = np.random.default_rng(seed)
    step = rng.uniform(0.005, 0.02, count)
    step[count // 3] = 0.9
    moves = jump * rng.normal(size=count) * (rng.uniform(size=count) < 0.8)
    moves[0] = 0.0
    reflected = np.abs((start + np.cumsum(moves) + 12.0) % 24.0 - 12.0)
    return np.cumsum(step), reflected


def slow_states(x, delta, start, hysteron, with_reversible=True):
    """(time, cell) states whose thresholds have moved to alpha + delta and beta - delta."""
    rows = []
    half = (PLANE.high - PLANE.low) / PLANE.levels / 2
    states = np.array(start, float)
    for value, shift in zip(x, delta, strict=True):
        for cell, (alpha, beta) in enumerate(zip(PLANE.alpha, PLANE.beta, strict=True)):
            own = shift if with_reversible or alpha > beta else 0.0
            up, down = alpha + own, beta - own
            if hysteron == "relay":
                if value > up:
                    states[cell] = 1.0
                elif value < down:
                    states[cell] = 0.0
                continue
            forced_on = min(max((value - (up - half)) / (2 * half), 0.0), 1.0)
            left_on = min(max((value - (down - half)) / (2 * half), 0.0), 1.0)
            states[cell] = min(max(states[cell], forced_on), left_on)
        rows.append(states.copy())
    return np.array(rows)


# --- thresholds that move outward ---


@kinds
@pytest.mark.parametrize("with_reversible", [True, False])
@pytest.mark.parametrize("initial", ["low", "high", "mixed"])
def test_states_follow_thresholds_that_have_moved_outward(
    precision, hysteron, initial, with_reversible
):
    _, x = wandering(start=6.0)
    delta = np.random.default_rng(2).uniform(0.0, 1.5, len(x))
    delta[::7] = 0.0
    x = np.clip(x, 1.5, 10.5)
    x, delta = (np.asarray(jnp.asarray(values, precision), float) for values in (x, delta))
    start: Any = {"low": np.zeros(PLANE.cells), "high": np.ones(PLANE.cells)}.get(
        initial, np.random.default_rng(3).integers(0, 2, PLANE.cells).astype(float)
    )
    rising, falling = jnp.asarray(x - delta, precision), jnp.asarray(x + delta, precision)
    reversible = None if with_reversible else jnp.asarray(x, precision)
    start = jnp.asarray(start, precision)
    got = hysteron_states(PLANE, rising, start, hysteron, falling, reversible)
    assert got.dtype == precision
    expected = slow_states(x, delta, start, hysteron, with_reversible)
    np.testing.assert_allclose(got, expected, rtol=0, atol=20 * np.finfo(precision).eps)
    # The thresholds have moved: without that the states are others.
    plain = slow_states(x, 0 * delta, start, hysteron)
    assert np.mean(np.any(np.abs(plain - expected) > 0.01, axis=1)) > 0.03


@kinds
@pytest.mark.parametrize("with_reversible", [True, False])
def test_weighted_states_are_the_weighed_sum_of_a_loop(precision, hysteron, with_reversible):
    _, x = wandering(start=6.0)
    x = np.clip(x, 1.5, 10.5)
    delta = np.random.default_rng(4).uniform(0.0, 1.5, len(x))
    memory = np.random.default_rng(5).uniform(0.0, 1.0, PLANE.cells) * WEIGHTS
    low = slow_states(x, delta, np.zeros(PLANE.cells), hysteron, with_reversible)
    high = slow_states(x, delta, np.ones(PLANE.cells), hysteron, with_reversible)
    assert (high - low)[0].any()
    expected = [WEIGHTS @ a + memory @ (b - a) for a, b in zip(low, high, strict=True)]
    weights, memory, rising, falling = (
        jnp.asarray(values, precision) for values in (WEIGHTS, memory, x - delta, x + delta)
    )
    reversible = None if with_reversible else jnp.asarray(x, precision)
    got = weighted_states(PLANE, weights, memory, rising, hysteron, falling, reversible)
    assert got.dtype == precision
    np.testing.assert_allclose(got, expected, rtol=0, atol=500 * np.finfo(precision).eps)


@kinds
def test_thresholds_that_have_not_moved_change_nothing(precision, hysteron):
    # Whole and half cells: relays often have the input on their thresholds.
    x = jnp.asarray(np.random.default_rng(6).integers(0, 13, 300), precision)
    plain = hysteron_states(PLANE, x, "low", hysteron)
    np.testing.assert_array_equal(hysteron_states(PLANE, x, "low", hysteron, falling=x), plain)
    weights, nothing = jnp.asarray(WEIGHTS, precision), jnp.zeros(PLANE.cells, precision)
    alone = weighted_states(PLANE, weights, nothing, x, hysteron)
    both = weighted_states(PLANE, weights, nothing, x, hysteron, falling=x)
    np.testing.assert_array_equal(alone, both)
    np.testing.assert_allclose(alone, plain @ weights, rtol=50 * np.finfo(precision).eps)


# --- rate dependence ---


RATE = RateDependence(150.0, 12.0, with_reversible=True, with_corners=True)
SMOOTH = RateDependence(reference_per_s=150.0, range_u=12.0)
RATE_VALUES = {"coefficient": 0.7, "exponent": 0.6}


def slow_widening(time, path, coefficient, exponent, reference):
    """Sample by sample; what creeps along at a millionth of the reference counts as rest."""
    rates = [abs(b - a) / (t - s) for (s, t), (a, b) in zip(pairwise(time), pairwise(path))]  # noqa: B905
    rates = [rates[0], *rates]
    return [
        coefficient * (r / reference) ** exponent if r > 1e-6 * reference else 0.0 for r in rates
    ]


def test_widening_is_a_power_of_the_actual_rate(precision, tolerance):
    time, path = wandering(seed=7, start=6.0)
    got = RATE.at(RATE_VALUES).widening(jnp.asarray(path), jnp.asarray(time))
    assert got.dtype == precision
    expected = slow_widening(time, path, 0.7, 0.6, 150.0)
    resting = np.concatenate([[False], np.diff(path) == 0])
    assert 5 < resting.sum() < len(path) / 2
    assert not np.any(np.asarray(got)[resting])
    # In single precision a small step between two times is a rounded one.
    np.testing.assert_allclose(got, expected, rtol=0, atol=20 * tolerance)


def test_an_input_that_turns_smoothly_rests_at_its_turns(precision, tolerance):
    time, path = wandering(seed=7, start=6.0)
    got = SMOOTH.at(RATE_VALUES).widening(jnp.asarray(path), jnp.asarray(time))
    assert got.dtype == precision
    inner = [
        abs(after - before) / (end - begin)
        for (begin, end), (before, after) in zip(
            zip(time, time[2:], strict=False), zip(path, path[2:], strict=False), strict=True
        )
    ]
    expected = [0.7 * (rate / 150.0) ** 0.6 for rate in (inner[0], *inner, inner[-1])]
    np.testing.assert_allclose(got, expected, rtol=0, atol=20 * tolerance)
    corner = SMOOTH.at(RATE_VALUES).widening(jnp.array([0.0, 1.0, 0.0]), jnp.arange(3.0))
    assert corner[1] == 0


def test_the_reversible_part_has_no_thresholds_to_move(x64):
    time, path = wandering(seed=11, start=6.0)
    record = Record.from_arrays(time, path, path, initial_memory="low")
    diagonal = PLANE.alpha_index == PLANE.beta_index
    still = hysteresis_columns(Chain(PLANE), Drive(jnp.asarray(path)), "low").states
    for effect, moves in ((SMOOTH, False), (RATE, True)):
        chain = Chain(PLANE, (effect,))
        course = drive(chain, {"rate_dependence": RATE_VALUES}, signals_of(record))
        states = hysteresis_columns(chain, course, "low").states
        assert np.array_equal(states[:, diagonal], still[:, diagonal]) != moves
        assert not np.allclose(states[:, ~diagonal], still[:, ~diagonal], atol=1e-3)


@pytest.mark.parametrize("with_reversible", [True, False])
@pytest.mark.parametrize("with_corners", [True, False])
def test_the_form_of_rate_dependence_is_found(x64, with_reversible, with_corners):
    """A stage of plays, one of them without a width, pushed through the form that is hidden."""
    time = np.arange(6000) / 500
    rates = np.repeat([0.5, 4.0, 1.0, 8.0, 2.0, 16.0], 1000)
    phase = np.cumsum(rates) / 250
    if with_corners:
        path = 6 - 6 * np.asarray(signal.sawtooth(phase, 0.5))  # pyright: ignore
        slope = np.diff(path) * 500
        speed = np.abs(np.concatenate([slope[:1], slope]))
    else:
        path, speed = 6 - 6 * np.cos(phase), np.abs(12 * rates * np.sin(phase))
    delta, total = 0.4 * (speed / 150.0) ** 0.6, 0.0
    for radius in (0.0, 0.5, 1.0, 1.5, 2.0):
        own = radius + delta * (with_reversible or radius > 0)
        play = [6.0]
        for value, reach in zip(path, own, strict=True):
            play.append(max(value - reach, min(value + reach, play[-1])))
        total = total + np.array(play[1:])
    record = Record.from_arrays(time, path, total)
    with double_precision():
        problem = Problem.of(record)
        point = base_point(problem, 12)
        (effect,) = resolve(["rate_dependence"], {})
        found = with_effect(problem, point, effect)
    kept = found.chain.effects[0]
    assert isinstance(kept, RateDependence)
    assert (kept.with_reversible, kept.with_corners) == (with_reversible, with_corners)
    assert found.validation_mean_square < 0.05 * point.validation_mean_square


def test_widening_of_a_thinned_record_is_that_of_all_samples(x64):
    time = np.arange(4000) / 500
    path = 6 - 6 * np.cos(2 * np.pi * (0.4 * time + 0.1 * time**2))
    record = Record.from_arrays(time, path, path, initial_memory="low")
    thinned = Problem.of(record, 400)
    kept = np.searchsorted(time, thinned.record.time)
    assert len(kept) < 1000
    chain = Chain(PLANE, (RATE,))
    values = {"rate_dependence": RATE_VALUES}
    whole, some = (
        np.stack([np.asarray(side) for side in drive(chain, values, signals)[:2]])
        for signals in (signals_of(record), thinned.signals)
    )
    np.testing.assert_allclose(some, whole[:, kept], rtol=0, atol=1e-12)
    for one, side in zip(whole, (-1, 1), strict=True):
        expected = path + side * np.array(slow_widening(time, path, 0.7, 0.6, 150.0))
        np.testing.assert_allclose(one, expected, rtol=0, atol=1e-9)


def test_thresholds_move_with_the_speed_behind_the_drive(x64):
    """A lag slows the input down before its speed widens anything."""
    time, path = wandering(seed=8, start=6.0)
    record = Record.from_arrays(time, path, path, initial_memory="low")
    values = {"rate_dependence": RATE_VALUES, "input_lag": {"tau_s": 0.05}}
    course = drive(Chain(PLANE, (RATE, InputLag())), values, signals_of(record))
    lagged = np.asarray(drive(Chain(PLANE, (InputLag(),)), values, signals_of(record)).rising)
    expected = slow_widening(time, lagged, 0.7, 0.6, 150.0)
    np.testing.assert_allclose(course.falling - lagged, expected, rtol=0, atol=1e-9)
    np.testing.assert_allclose(lagged - course.rising, expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize("step", [0.0, 1.0])
def test_rate_dependence_takes_its_scales_from_the_record(step):
    time = np.arange(1001) * 1e-2
    path = np.where(np.arange(1001) < 500, step * time, step * 5.0)
    bound = RateDependence().bound_to(Survey(10.0, 1e-2, time, path, path, path))
    assert bound.reference_per_s == pytest.approx(1.0 if step else 0.0)
    assert bound.range_u == pytest.approx(5.0 * step)


# --- the moving model ---


def slow_feedback(path, scaled, delta):
    """h(k) that agrees with itself, one sample after the other, by root finding.

    `scaled(u, h)` is what the hysterons see of an input and of their own output.
    """
    states, course = np.zeros(PLANE.cells), []
    width = (PLANE.high - PLANE.low) / PLANE.levels
    position = [(edges - width / 2) for edges in (PLANE.alpha, PLANE.beta)]

    def stepped(states, x, shift):
        on = np.clip((x - shift - position[0]) / width, 0.0, 1.0)
        left = np.clip((x + shift - position[1]) / width, 0.0, 1.0)
        return np.minimum(left, np.maximum(states, on))

    for value, shift in zip(path, delta, strict=True):

        def excess(h, value=value, shift=shift, states=states):
            return WEIGHTS @ stepped(states, scaled(value, h), shift) - h

        output = float(np.asarray(brentq(excess, -1e-9, TOTAL + 1e-9, xtol=1e-13)))
        states = stepped(states, scaled(value, output), shift)
        course.append(output)
    return np.array(course)


def moving_setting(ratio, *others):
    """A fed-back chain, its values and what drives it; `ratio` is a in ranges of both signals."""
    time, path = wandering(seed=9)
    record = Record.from_arrays(time, path, np.zeros(len(path)), initial_memory="low")
    chain = Chain(PLANE, (Moving(0.0, 12.0, TOTAL), *(effect for effect, _ in others)))
    values = {"moving": {"a": ratio * 12.0 / TOTAL}}
    values |= {effect.name: numbers for effect, numbers in others}
    return chain, values, signals_of(record), path


@pytest.mark.parametrize("ratio", [-0.4, -0.15, 0.0, 0.2, 0.4])
@pytest.mark.parametrize("rate", [False, True])
def test_feedback_is_the_fixed_point_of_every_sample(x64, ratio, rate):
    others = [(RATE, RATE_VALUES)] if rate else []
    chain, values, signals, path = moving_setting(ratio, *others)
    a, delta = values["moving"]["a"], np.zeros(len(path))
    if rate:
        delta = np.array(slow_widening(np.asarray(signals.time), path, 0.7, 0.6, 150.0))

    def scaled(u, h):
        return (u + a * h) / (1 + a * TOTAL / 12.0)

    expected = 3.0 + slow_feedback(path, scaled, delta)
    nothing = np.zeros(PLANE.cells)
    got = response(chain, values, signals, Coefficients(WEIGHTS, nothing, 3.0, np.zeros(0)))
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-9)
    plain = slow_feedback(path, lambda u, h: u, delta)
    assert (np.abs(plain + 3.0 - expected).max() > 0.1) == (ratio != 0.0)


@pytest.mark.parametrize("ratio", [-0.4, 0.2, 0.4])
def test_regressors_at_the_fed_back_output_make_the_response(x64, ratio):
    chain, values, signals, _ = moving_setting(ratio)
    nothing = np.zeros(PLANE.cells)
    coefficients = Coefficients(WEIGHTS, nothing, 3.0, np.zeros(0))
    output = hysteresis_output(chain, values, signals, coefficients)
    hysteresis = hysteresis_columns(chain, drive(chain, values, signals, output), "low")
    columns = regressors(chain, values, signals, hysteresis)
    got = columns.matrix @ np.concatenate([WEIGHTS, np.zeros(len(columns.groups)), [3.0]])
    np.testing.assert_allclose(got, response(chain, values, signals, coefficients), atol=1e-9)
    # Without the output, the operator has nothing to follow but the input.
    bare = hysteresis_columns(chain, drive(chain, values, signals), "low")
    assert np.abs(bare.states @ WEIGHTS + 3.0 - got).max() > 0.1


def test_feedback_keeps_the_ends_of_the_loop(x64):
    moving = Moving(low_u=-3.0, range_u=6.0, range_z=40.0)
    for a in (-0.05, 0.0, 0.1):
        path, output = jnp.array([-3.0, 3.0]), jnp.array([0.0, 40.0])
        ends = moving.at({"a": a}).fed_back(path, output, jnp.array([0.0, 1.0]))
        np.testing.assert_allclose(ends, [-3.0, 3.0], rtol=0, atol=1e-12)


# --- the sensor ---


BENT = OutputNonlinearity(low_z=2.0, range_z=TOTAL)
BEND = np.array([0.05 * TOTAL, -0.03 * TOTAL])


def sensor_setting(*effects, values=None, added=()):
    time, path = wandering(seed=10)
    record = Record.from_arrays(time, path, np.zeros(len(path)), initial_memory="low")
    chain = Chain(PLANE, effects)
    every: dict[str, dict[str, float]] = {effect.name: {} for effect in effects}
    every |= values or {}
    # Coefficients of the sensor are the last ones; the past of creep is at rest.
    every_added = np.zeros(len(chain.coefficients))
    every_added[len(every_added) - len(added) :] = added
    coefficients = Coefficients(WEIGHTS, np.zeros(PLANE.cells), 2.0, every_added)
    return chain, every, signals_of(record), coefficients


def test_a_bent_reading_solves_the_map(x64):
    chain, values, signals, coefficients = sensor_setting(BENT, added=BEND)
    straight = response(*sensor_setting()[:3], coefficients)

    def legendre(z):
        x = 2 * (z - 2.0) / TOTAL - 1
        end = min(max(x, -1.0), 1.0)  # beyond the range it goes straight on
        bent = np.polynomial.Legendre([0.0, 0.0, *BEND])
        return bent(end) + bent.deriv()(end) * (x - end)

    def excess(z, y):
        return z - legendre(z) - y

    expected = np.array(
        [brentq(excess, y - 5.0, y + 5.0, (y,), xtol=1e-13) for y in np.asarray(straight)]
    )
    got = response(chain, values, signals, coefficients)
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-9)
    assert np.abs(got - straight).max() > 0.3


def test_the_columns_of_a_bent_reading_give_back_what_was_measured(x64):
    """With the measured reading in the columns, the map is linear: z = h + columns(z) c."""
    chain, values, signals, coefficients = sensor_setting(BENT, added=BEND)
    reading = np.asarray(response(chain, values, signals, coefficients))
    hysteresis = hysteresis_columns(chain, Drive(signals.input), "low")
    rows = np.random.default_rng(0).permutation(len(reading))[:100]
    columns = regressors(chain, values, signals, hysteresis, rows, reading[rows])
    assert columns.added == ("output_nonlinearity",) * 2
    solution = np.concatenate([WEIGHTS, np.zeros(len(columns.groups)), [2.0], BEND])
    np.testing.assert_allclose(columns.matrix @ solution, reading[rows], rtol=0, atol=1e-9)


@pytest.mark.parametrize("step", [0.3, 2.0])
def test_a_converter_rounds_the_reading(x64, step):
    effect = OutputQuantisation(step_z=step)
    chain, values, signals, coefficients = sensor_setting(
        BENT, effect, values={effect.name: {"step": step}}, added=BEND
    )
    bent = np.asarray(response(*sensor_setting(BENT, added=BEND)))
    expected = [step * np.floor(value / step + 0.5) for value in bent]
    got = response(chain, values, signals, coefficients)
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize("step", [0.01, 0.3])
def test_the_step_of_a_lattice_is_read_off(step):
    rng = np.random.default_rng(0)
    values = np.round((40 * step * np.sin(np.arange(4000) / 100) + 3.7 * step) / step) * step
    assert lattice_step(values) == pytest.approx(step, rel=1e-9)
    assert lattice_step(values + 1e-3 * step * rng.normal(size=4000)) == 0.0
    (parameter,) = (
        OutputQuantisation()
        .bound_to(Survey(40.0, 0.01, np.arange(4000.0), values, values, values))
        .parameters()
    )
    assert parameter.low < step < parameter.high
    assert parameter.start == (pytest.approx(step, rel=1e-9),)


@pytest.fixture(scope="module")
def coarse():
    """A record read in steps greater than its noise, and its models without and with them."""
    with double_precision():
        rec = world.hidden_record(None, 3, duration_s=6.0, rate_hz=500.0)
        output = np.round(rec["z"] / 0.8) * 0.8
        record = Record.from_arrays(rec["t"], rec["x"], output, initial_memory="low")
        problem = Problem.of(record)
        base = base_point(problem, 9)
        return problem, base, with_effect(problem, base, OutputQuantisation(), always=True)


def test_residual_and_held_out_error_are_those_of_the_steps(coarse):
    problem, base, stepped = coarse
    assert stepped.values["output_quantisation"]["step"] == pytest.approx(0.8, rel=1e-6)
    smooth = stepped.matrix @ stepped.solution * problem.unit + stepped.level
    expected = problem.target - 0.8 * np.round(smooth / 0.8)
    np.testing.assert_allclose(stepped.residual * problem.unit, expected, rtol=0, atol=1e-4)
    held_out = problem.fold == 3
    mean_square = np.mean(expected[held_out] ** 2) / problem.unit**2
    assert stepped.validation_mean_square == pytest.approx(mean_square, rel=1e-3)
    assert base.validation_mean_square == pytest.approx(np.mean(base.residual[held_out] ** 2))


# --- derivatives ---


CREEP = Creep(tau_s=(0.1, 1.0))
DERIVED: dict[str, tuple[tuple, dict[str, dict[str, float]], tuple[float, ...]]] = {
    "rate_dependence": ((RATE,), {"rate_dependence": RATE_VALUES}, ()),
    "moving": ((Moving(0.0, 12.0, TOTAL),), {"moving": {"a": 0.3 * 12.0 / TOTAL}}, ()),
    "opposing": ((Moving(0.0, 12.0, TOTAL),), {"moving": {"a": -0.4 * 12.0 / TOTAL}}, ()),
    "together": (
        (InputLag(), RATE, Moving(0.0, 12.0, TOTAL), CREEP, BENT),
        {
            "input_lag": {"tau_s": 0.03},
            "rate_dependence": RATE_VALUES,
            "moving": {"a": 0.2 * 12.0 / TOTAL},
            "creep": {"c_1": 0.05, "c_2": 0.03},
            "output_nonlinearity": {},
        },
        tuple(BEND),
    ),
}


@pytest.mark.parametrize("case", DERIVED)
def test_tangents_against_finite_differences(x64, case):
    """What is fed back is held, in the tangents and in the differences."""
    effects, values, added = DERIVED[case]
    chain, every, signals, coefficients = sensor_setting(*effects, values=values, added=added)
    names = [(name, key) for name in values for key in values[name]]
    got = tangents(chain, every, signals, coefficients, names)
    held = hysteresis_output(chain, every, signals, coefficients) if chain.feeds_back else None
    for column, (name, key) in zip(got.T, names, strict=True):
        step = 1e-6 * abs(values[name][key])

        def at(value, name=name, key=key):
            moved = {**every, name: {**every[name], key: value}}
            states = hysteresis_columns(chain, drive(chain, moved, signals, held), "low").states
            hysteresis = jnp.asarray(states @ WEIGHTS)
            return np.asarray(behind_hysteresis(chain, moved, signals, hysteresis, coefficients))

        middle = values[name][key]
        expected = (at(middle + step) - at(middle - step)) / (2 * step)
        scale = np.abs(expected).max()
        assert scale > 1e-2
        # The operator has corners: a sample on the edge of a cell has two one-sided slopes.
        assert np.mean(np.abs(column - expected) > 1e-5 * scale) < 0.02


def test_a_converter_does_not_hide_what_the_others_do(x64):
    """Steps have no slope; what is fitted are the readings before they are rounded."""
    effect = OutputQuantisation(step_z=0.3)
    creep = {"creep": {"c_1": 0.05, "c_2": 0.03}}
    names = [("creep", "c_1"), ("creep", "c_2")]
    smooth = tangents(*sensor_setting(CREEP, values=creep), names)
    stepped = {**creep, "output_quantisation": {"step": 0.3}}
    got = tangents(*sensor_setting(CREEP, effect, values=stepped), names)
    np.testing.assert_allclose(got, smooth, rtol=0, atol=1e-12)
    assert np.abs(smooth).max() > 0.1


# --- the whole way: fitted, saved, read and predicted ---


FITTED = {
    "rate_dependence": {"coefficient": 0.4, "exponent": 0.7},
    "moving": {"a": 0.15},
    "output_nonlinearity": {},
    "output_quantisation": {},
}


@pytest.fixture(scope="module", params=FITTED)
def fitted(request):
    """A model with one of the effects, at given values, on a record of the simulated actuator."""
    name = request.param
    made = world.hidden_record(None, 3, duration_s=6.0, rate_hz=500.0)
    output = np.round(made["z"] / 0.5) * 0.5 if name == "output_quantisation" else made["z"]
    units = {"input": "V", "output": "um"}
    whole = Record.from_arrays(made["t"], made["x"], output, units=units, initial_memory="low")
    record = whole.part(0, 2000)
    with double_precision():
        problem = Problem.of(record)
        (effect,) = resolve([name], {})
        effect = effect.bound_to(problem.survey_of(base_point(problem, 5)))
        values = FITTED[name] or {p.name: p.start[0] for p in effect.parameters()}
        chain = Chain(plane_of(problem, 8), (effect,))
        point = None
        for _ in range(6):  # what is fed back comes from the point before
            point = evaluate(problem, chain, {name: values}, 1e-4, point)
        assert point is not None
        return whole, record, finished(problem, point, record)


def test_the_fit_predicts_what_it_was_identified_on(fitted):
    _, record, fit = fitted
    assert fit.fit_percent > 97
    # What is predicted is the response, and what was minimised the regression.
    rows = Problem.of(record).rows
    point = fit.point
    regression = (point.target - point.residual) * point.unit + point.level
    apart = regression - fit.prediction[rows]
    assert np.sqrt(np.mean(apart**2)) < 0.2 * fit.rms_identification


def test_a_model_reads_back_to_the_last_bit_and_predicts_alike(tmp_path, fitted):
    whole, record, fit = fitted
    fit.model.save(tmp_path / "model.json")
    again = Model.load(tmp_path / "model.json")
    assert again.to_json() == fit.model.to_json()
    assert again.values == fit.model.values
    assert again.effects == fit.model.effects
    expected = fit.model.predict(record).output
    np.testing.assert_array_equal(again.predict(record).output, expected)
    rms = np.sqrt(np.mean((expected - record.output) ** 2))
    assert rms < 1.5 * fit.rms_validation
    # What follows is predicted from a model that knows only the history.
    after = whole.part(2000, len(whole))
    np.testing.assert_allclose(
        again.predict(after).output, fit.model.predict(whole).output[2000:], atol=0.05
    )


@pytest.mark.parametrize("fitted", ["output_quantisation"], indirect=True)
def test_a_prediction_keeps_the_steps_of_the_sensor(fitted):
    whole, record, fit = fitted
    for blank in (record, whole.part(2000, len(whole))):
        steps = fit.model.predict(blank).output / 0.5
        np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)


# --- the parameters are found ---


@pytest.mark.parametrize(
    ("name", "truth"),
    [("rate_dependence", {"coefficient": 1.5, "exponent": 0.7}), ("moving", {"a": 0.4})],
)
def test_parameters_of_the_models_own_record_lie_in_their_intervals(name, truth):
    made = world.hidden_record(None, 3, duration_s=6.0, rate_hz=500.0)
    plain = Record.from_arrays(made["t"], made["x"], made["z"], initial_memory="low")
    with double_precision():
        problem = Problem.of(plain)
        base = base_point(problem, 9)
        (effect,) = resolve([name], {})
        effect = effect.bound_to(problem.survey_of(base))
        chain = Chain(base.chain.plane, (effect,))
        coefficients = base.coefficients()
        clean = np.asarray(response(chain, {name: truth}, problem.signals, coefficients))
        noise = 0.02 * np.random.default_rng(1).normal(size=len(clean))
        record = Record.from_arrays(made["t"], made["x"], clean + noise, initial_memory="low")
        problem = Problem.of(record)
        away = {name: {key: 0.6 * value for key, value in truth.items()}}
        start = evaluate(problem, chain, away, 1e-4)
        fitted = refine(problem, with_all_rows(refine(problem, start, 15, 1e-7)), 15, 1e-7)
        found = estimates(problem, fitted)[name]
    for key, value in truth.items():
        assert found[key].low <= value <= found[key].high, (key, found[key])
        assert found[key].value == pytest.approx(value, rel=0.05)
    rms = np.sqrt(np.mean(fitted.residual**2)) * problem.unit
    assert rms == pytest.approx(0.02, rel=0.05)


def stage_record(*arguments):
    """A record of the simulated stage, which is none of the model's own make."""
    made = simulate_stage(*arguments)
    units = {"input": "V", "output": "um"}
    record = Record.from_arrays(
        made.time, made.input, made.output, units=units, initial_memory="low"
    )
    return record, made.truth["parameters"]


@pytest.mark.campaign
def test_rate_dependence_of_a_stage_is_found():
    record, truth = stage_record(3, 12.0, ["rate_dependence"], 2000.0)
    base = pj.fit(record, levels=20)
    fit = pj.fit(record, ["rate_dependence"], levels=20)
    found, loss = fit.model.parameters["rate_dependence"], truth["rate_dependence"]
    (effect,) = fit.model.effects
    assert isinstance(effect, RateDependence)
    expected = loss["coefficient"] * effect.reference_per_s ** loss["exponent"]
    # The grid of the plane pulls the exponent down by a per cent or two.
    assert found["coefficient"].value == pytest.approx(expected, rel=0.02)
    assert found["exponent"].value == pytest.approx(loss["exponent"], rel=0.03)
    assert fit.rms_validation < 0.2 * base.rms_validation
    assert fit.rms_validation < 0.012  # noise of 0.006, and the grid

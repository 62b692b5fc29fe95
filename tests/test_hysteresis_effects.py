"""Effects inside the hysteresis and in the sensor, against loops, root finding and differences."""

from itertools import pairwise
from typing import Any

import acting
import jax.numpy as jnp
import numpy as np
import pytest
import world
from oracles import slow_ramps
from scipy import signal
from scipy.optimize import brentq

import preisach_jax as pj
from preisach_jax.chain.coefficients import Coefficients
from preisach_jax.chain.description import Chain
from preisach_jax.chain.driven import drive
from preisach_jax.chain.hysteresis import hysteresis_columns, hysteresis_output
from preisach_jax.chain.matrix import regressors
from preisach_jax.chain.output import behind_hysteresis, response, tangents
from preisach_jax.chain.signals import Drive, signals_of
from preisach_jax.effects.base import Survey
from preisach_jax.effects.creep import Creep
from preisach_jax.effects.eddy_currents import EddyCurrents
from preisach_jax.effects.input_lag import InputLag
from preisach_jax.effects.moving import Moving
from preisach_jax.effects.operator_creep import SHARES, OperatorCreep
from preisach_jax.effects.output_nonlinearity import OutputNonlinearity
from preisach_jax.effects.output_quantisation import OutputQuantisation
from preisach_jax.effects.rate_dependence import RateDependence
from preisach_jax.effects.reptation import SHARES as REACHES
from preisach_jax.effects.reptation import Reptation
from preisach_jax.identify.problem import Problem
from preisach_jax.model import Model
from preisach_jax.operator.plane import Plane
from preisach_jax.operator.states import hysteron_states, weighted_states
from preisach_jax.record.core import Record
from preisach_jax.record.course import lattice_step

PLANE = Plane(levels=5, low=0.0, high=12.0)
WEIGHTS = np.random.default_rng(1).uniform(0.2, 1.0, PLANE.cells)
TOTAL = float(WEIGHTS.sum())
NOTHING = np.zeros(PLANE.cells)


def wandering(seed=0, start=0.0, count=150):
    """Uneven times with a gap, and an input that wanders over the plane and rests at times."""
    rng = np.random.default_rng(seed)
    step = rng.uniform(0.005, 0.02, count)
    step[count // 3] = 0.9
    moves = 1.5 * rng.normal(size=count) * (rng.uniform(size=count) < 0.8)
    moves[0] = 0.0
    reflected = np.abs((start + np.cumsum(moves) + 12.0) % 24.0 - 12.0)
    return np.cumsum(step), reflected


# --- thresholds that move outward ---


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


@pytest.mark.parametrize(("hysteron", "with_reversible"), [("ramp", True), ("relay", False)])
def test_states_follow_thresholds_that_have_moved_outward(precision, hysteron, with_reversible):
    rng = np.random.default_rng(2)
    x = np.clip(wandering(start=6.0)[1], 1.5, 10.5)
    delta = rng.uniform(0.0, 1.5, len(x)) * (np.arange(len(x)) % 7 > 0)
    x, delta = (np.asarray(jnp.asarray(values, precision), float) for values in (x, delta))
    start = rng.integers(0, 2, PLANE.cells).astype(float)
    memory = rng.uniform(0.0, 1.0, PLANE.cells) * WEIGHTS
    rising, falling = jnp.asarray(x - delta, precision), jnp.asarray(x + delta, precision)
    reversible = None if with_reversible else jnp.asarray(x, precision)
    mixed = jnp.asarray(start, precision)
    got = hysteron_states(PLANE, rising, mixed, hysteron, falling, reversible)
    assert got.dtype == precision
    expected, low, high = (
        slow_states(x, delta, first, hysteron, with_reversible)
        for first in (start, 0 * start, 1 + 0 * start)
    )
    np.testing.assert_allclose(got, expected, rtol=0, atol=20 * np.finfo(precision).eps)
    # The thresholds have moved: without that the states are others.
    plain = slow_states(x, 0 * delta, start, hysteron)
    assert np.mean(np.any(np.abs(plain - expected) > 0.01, axis=1)) > 0.03
    # Their weighed sum, with weights by which they were on before.
    weighed = low @ WEIGHTS + (high - low) @ memory
    own = (jnp.asarray(WEIGHTS, precision), jnp.asarray(memory, precision))
    got = weighted_states(PLANE, *own, rising, hysteron, falling, reversible)
    assert got.dtype == precision
    np.testing.assert_allclose(got, weighed, rtol=0, atol=500 * np.finfo(precision).eps)


# --- widening by speed ---

RATE = RateDependence(150.0, 12.0, with_reversible=True, with_corners=True)
RATE_VALUES = {"coefficient": 0.7, "exponent": 0.6}


def slow_widening(time, path):
    """Sample by sample; what creeps along at a millionth of the reference counts as rest."""
    rates = [abs(b - a) / (t - s) for (s, t), (a, b) in zip(pairwise(time), pairwise(path))]  # noqa: B905
    return [0.7 * (r / 150.0) ** 0.6 if r > 1.5e-4 else 0.0 for r in [rates[0], *rates]]


@pytest.mark.parametrize("whole", [True, False])
def test_the_form_of_rate_dependence_is_found(x64, whole):
    """A stage of plays, one of them without a width, pushed through the form that is hidden."""
    time = np.arange(3000) / 250
    rates = np.repeat([0.5, 4.0, 1.0, 8.0, 2.0, 16.0], 500)
    phase = np.cumsum(rates) / 125
    if whole:
        path = 6 - 6 * np.asarray(signal.sawtooth(phase, 0.5))  # pyright: ignore
        slope = np.diff(path) * 250
        speed = np.abs(np.concatenate([slope[:1], slope]))
    else:
        path, speed = 6 - 6 * np.cos(phase), np.abs(12 * rates * np.sin(phase))
    delta, total = 0.4 * (speed / 150.0) ** 0.6, 0.0
    for radius in (0.0, 0.5, 1.0, 1.5, 2.0):
        own = radius + delta * (whole or radius > 0)
        play = [6.0]
        for value, reach in zip(path, own, strict=True):
            play.append(max(value - reach, min(value + reach, play[-1])))
        total = total + np.array(play[1:])
    record = Record.from_arrays(time, path, total)
    plain, found = (pj.fit(record, names, levels=9) for names in ((), ["rate_dependence"]))
    kept: Any = found.model.effects[0]
    assert (kept.with_reversible, kept.with_corners) == (whole, whole)
    assert found.rms_validation < 0.3 * plain.rms_validation


def test_widening_of_a_thinned_record_is_that_of_all_samples(x64):
    time = np.arange(3000) / 500
    path = 6 - 6 * np.cos(2 * np.pi * (0.4 * time + 0.1 * time**2))
    record = Record.from_arrays(time, path, path, initial_memory="low")
    thinned = Problem.of(record, 400)
    kept = np.searchsorted(time, thinned.record.time)
    assert len(kept) < 1000
    whole, some = (
        np.array(drive(Chain(PLANE, (RATE,)), {"rate_dependence": RATE_VALUES}, signals)[:2], float)
        for signals in (signals_of(record), thinned.signals)
    )
    np.testing.assert_allclose(some, whole[:, kept], rtol=0, atol=1e-12)
    for one, side in zip(whole, (-1, 1), strict=True):
        expected = path + side * np.array(slow_widening(time, path))
        np.testing.assert_allclose(one, expected, rtol=0, atol=1e-9)


def test_thresholds_move_with_the_speed_behind_the_drive(x64):
    """A lag slows the input down before its speed widens anything."""
    time, path = wandering(seed=8, start=6.0)
    signals = signals_of(Record.from_arrays(time, path, path, initial_memory="low"))
    values = {"rate_dependence": RATE_VALUES, "input_lag": {"tau_s": 0.05}}
    course = drive(Chain(PLANE, (RATE, InputLag())), values, signals)
    lagged = np.asarray(drive(Chain(PLANE, (InputLag(),)), values, signals).rising)
    expected = slow_widening(time, lagged)
    np.testing.assert_allclose(course.falling - lagged, expected, rtol=0, atol=1e-9)
    np.testing.assert_allclose(lagged - course.rising, expected, rtol=0, atol=1e-9)


# --- what feeds back: the moving model and eddy currents ---


def slow_feedback(time, path, delta, a=0.0, k=0.0):
    """h(k) that agrees with itself, one sample after the other, by root finding."""
    states, before, course = NOTHING, 0.0, []
    width = (PLANE.high - PLANE.low) / PLANE.levels
    ups, downs = PLANE.alpha - width / 2, PLANE.beta - width / 2
    for n, (value, shift) in enumerate(zip(path, delta, strict=True)):

        def stepped(h, n=n, value=value, shift=shift, states=states, before=before):
            field = value - (k * (h - before) / (time[n] - time[n - 1]) if n else 0.0)
            x = (field + a * h) / (1 + a * TOTAL / 12.0)
            on = np.clip((x - shift - ups) / width, 0.0, 1.0)
            left = np.clip((x + shift - downs) / width, 0.0, 1.0)
            return np.minimum(left, np.maximum(states, on))

        def excess(h, stepped=stepped):
            return WEIGHTS @ stepped(h) - h

        before: Any = brentq(excess, -1e-9, TOTAL + 1e-9, xtol=1e-13)
        states = stepped(before)
        course.append(before)
    return np.array(course)


OWN = Coefficients(WEIGHTS, NOTHING, 3.0, np.zeros(0))
MOVING = Moving(0.0, 12.0, TOTAL)


def fed_back(a=0.0, k=0.0, rate=False):
    """A fed-back chain, its values and what drives it; `a` is in ranges of both signals."""
    time, path = wandering(seed=9)
    effects, values = (), {}
    if k:
        effects, values = (EddyCurrents(12.0, 1.0),), {"eddy_currents": {"k": k}}
    if a:
        effects, values["moving"] = (*effects, MOVING), {"a": a * 12.0 / TOTAL}
    if rate:
        effects, values["rate_dependence"] = (*effects, RATE), RATE_VALUES
    record = Record.from_arrays(time, path, np.zeros(len(path)), initial_memory="low")
    return Chain(PLANE, effects), values, signals_of(record), time, path


@pytest.mark.parametrize(("a", "k", "rate"), [(-0.4, 0, False), (0.2, 0.05, True)])
def test_the_output_agrees_with_itself_at_every_sample(x64, a, k, rate):
    chain, values, signals, time, path = fed_back(a, k, rate)
    delta = np.array(slow_widening(time, path)) if rate else 0 * path
    expected = slow_feedback(time, path, delta, a * 12.0 / TOTAL, k)
    got = response(chain, values, signals, OWN)
    np.testing.assert_allclose(got, 3.0 + expected, rtol=0, atol=1e-8)
    assert np.abs(slow_feedback(time, path, delta) - expected).max() > 0.05


def test_regressors_at_the_fed_back_output_make_the_response(x64):
    chain, values, signals, *_ = fed_back(0.4)
    output = hysteresis_output(chain, values, signals, OWN)
    hysteresis = hysteresis_columns(chain, drive(chain, values, signals, output), "low")
    columns = regressors(chain, values, signals, hysteresis)
    got = columns.matrix @ np.concatenate([WEIGHTS, np.zeros(len(columns.groups)), [3.0]])
    np.testing.assert_allclose(got, response(chain, values, signals, OWN), atol=1e-9)


# --- what has a memory of its own: creep operators, and reptation ---

TAU_S = (0.05, 0.4, 3.0)


def slow_creep(time, path, thresholds, parts=400):
    """(time, column) elements in small explicit steps at the middle of each."""
    place = np.full((len(thresholds), len(TAU_S)), path[0])
    reach, course = np.asarray(thresholds)[:, None], [place]
    for n in range(1, len(path)):
        step = (time[n] - time[n - 1]) / parts
        for share in (np.arange(parts) + 0.5) / parts:
            away = path[n - 1] + share * (path[n] - path[n - 1]) - place
            pull = np.maximum(away - reach, np.minimum(away + reach, 0.0))
            place = place + pull * -np.expm1(-step / np.asarray(TAU_S))
        course.append(place)
    spectrum = np.array([[1.0, -1.0, 1.0], [1.0, 0.0, -0.5], [1.0, 1.0, 1.0]])
    spectrum *= np.log10(TAU_S[-1] / TAU_S[0]) / 2
    return (np.array(course) @ spectrum).reshape(len(time), -1)


def slow_reptation(path, reach, travel, parts=400):
    """Two plays at a time, one of which goes towards the input with each small move."""
    course = []
    for own in reach:
        tight = leaky = before = path[0]
        lost = []
        for goal in path:
            for share in np.arange(1, parts + 1) / parts:
                now = before + share * (goal - before)
                leaky += abs(goal - before) / parts / travel * (now - leaky)
                leaky = min(max(leaky, now - own), now + own)
                tight = min(max(tight, now - own), now + own)
            before = goal
            lost.append(leaky - tight)
        course.append(lost)
    return np.array(course).T


def test_columns_of_a_memory_are_small_steps_and_exact(x64):
    """One long step is as good as many short ones, also where it turns an element around."""
    time, path = wandering(1, count=40)
    path = 0.2 * path
    creep, swing = OperatorCreep(TAU_S, float(np.ptp(path))), np.ptp(path)
    cases = (
        (creep, {}, slow_creep(time, path, swing * np.array(SHARES))),
        (Reptation(2.0), {"path": 1.0}, slow_reptation(path, 2.0 * np.array(REACHES), 1.0)),
    )
    finely = np.arange(0, 39.01, 0.125)
    fine_time = np.interp(finely, np.arange(40), time)
    for effect, values, expected in cases:
        got = acting.columns(effect, values, acting.signals(time, path))
        assert got.shape == expected.shape
        assert (np.ptp(expected, axis=0) > 0.02).all()
        np.testing.assert_allclose(got, expected, rtol=0, atol=5e-3)
        finely_driven = acting.signals(fine_time, np.interp(fine_time, time, path))
        fine = acting.columns(effect, values, finely_driven)
        np.testing.assert_allclose(fine[::8], got, rtol=0, atol=1e-10)


FED_BACK = {"eddy_currents": {"k": 4e-3}, "moving": {"a": 0.2 * 12.0 / TOTAL}}


def hiding(name):
    """A stage of five levels, and beside it or within it what small steps and roots make."""
    time, path = np.arange(3000) / 500, world.excitation("rich", 6.0, 500.0, 5) * 12 / world.TOP
    if name in FED_BACK:
        z = slow_feedback(time, path, 0 * path, **FED_BACK[name])
    else:
        z = slow_ramps(PLANE, path) @ WEIGHTS
    if name == "operator_creep":
        moved = slow_creep(time, path, 12.0 * np.array(SHARES), parts=4)[:, :2]
    elif name == "reptation":
        moved = slow_reptation(path, 12.0 * np.array(REACHES), 8.0, parts=4)
    else:
        moved = np.zeros((3000, 1))
    z = z + 0.05 * TOTAL * moved.sum(axis=1) / (np.ptp(moved.sum(axis=1)) or 1.0)
    noise = 1e-4 * TOTAL * np.random.default_rng(5).normal(size=3000)
    return Record.from_arrays(time, path, z + noise, initial_memory="low")


@pytest.mark.parametrize(
    ("name", "rivals"),
    [
        ("operator_creep", ["creep"]),
        ("reptation", ["creep"]),
        ("eddy_currents", ["creep"]),
        ("moving", ["creep"]),
        ("", ["operator_creep", "reptation", "eddy_currents"]),
    ],
)
def test_it_is_found_where_it_is_hidden_and_nowhere_else(name, rivals):
    found = pj.diagnose(hiding(name), [*rivals, *[name] * bool(name)], levels=5)
    assert found.effects[:1] == ((name,) if name else ())
    if name:
        assert found.final.rms_validation < 0.5 * found.base.rms_validation
    for parameter, value in FED_BACK.get(name, {}).items():
        estimate = found.findings[0].parameters[parameter]
        assert estimate.value == pytest.approx(value, rel=0.01)


# --- the sensor ---

BENT = OutputNonlinearity(low_z=2.0, range_z=TOTAL)
BEND = np.array([0.05 * TOTAL, -0.03 * TOTAL])


def sensor_setting(*effects, values=None, added=()):
    time, path = wandering(seed=10)
    record = Record.from_arrays(time, path, np.zeros(len(path)), initial_memory="low")
    chain = Chain(PLANE, effects)
    every: dict[str, dict[str, float]] = {effect.name: {} for effect in effects}
    # Coefficients of the sensor are the last ones; the past of creep is at rest.
    every_added = np.zeros(len(chain.coefficients))
    every_added[len(every_added) - len(added) :] = added
    coefficients = Coefficients(WEIGHTS, NOTHING, 2.0, every_added)
    return chain, every | (values or {}), signals_of(record), coefficients


def test_a_bent_reading_solves_the_map_and_its_columns_give_it_back(x64):
    chain, values, signals, coefficients = sensor_setting(BENT, added=BEND)
    straight = np.asarray(response(*sensor_setting()[:3], coefficients))

    def legendre(z):
        x = 2 * (z - 2.0) / TOTAL - 1
        end = min(max(x, -1.0), 1.0)  # beyond the range it goes straight on
        bent = np.polynomial.Legendre([0.0, 0.0, *BEND])
        return bent(end) + bent.deriv()(end) * (x - end)

    def excess(z, y):
        return z - legendre(z) - y

    expected: Any = [brentq(excess, y - 5.0, y + 5.0, (y,), xtol=1e-13) for y in straight]
    reading = np.asarray(response(chain, values, signals, coefficients))
    np.testing.assert_allclose(reading, expected, rtol=0, atol=1e-9)
    assert np.abs(reading - straight).max() > 0.3
    # With the measured reading in the columns, the map is linear: z = h + columns(z) c.
    hysteresis = hysteresis_columns(chain, Drive(signals.input), "low")
    rows = np.random.default_rng(0).permutation(len(reading))[:100]
    columns = regressors(chain, values, signals, hysteresis, rows, reading[rows])
    solution = np.concatenate([WEIGHTS, np.zeros(len(columns.groups)), [2.0], BEND])
    np.testing.assert_allclose(columns.matrix @ solution, reading[rows], rtol=0, atol=1e-9)
    # A converter rounds what is read.
    rounds = OutputQuantisation(step_z=0.3)
    known = {rounds.name: {"step": 0.3}}
    got = response(*sensor_setting(BENT, rounds, values=known, added=BEND))
    np.testing.assert_allclose(got, 0.3 * np.floor(reading / 0.3 + 0.5), rtol=0, atol=1e-9)


def test_the_step_of_a_lattice_is_read_off():
    step, rng = 0.3, np.random.default_rng(0)
    values = np.round((40 * step * np.sin(np.arange(4000) / 100) + 3.7 * step) / step) * step
    assert lattice_step(values) == pytest.approx(step, rel=1e-9)
    assert lattice_step(values + 1e-3 * step * rng.normal(size=4000)) == 0.0
    survey = Survey(40.0, 0.01, np.arange(4000.0), values, values, values)
    (parameter,) = OutputQuantisation().bound_to(survey).parameters()
    assert parameter.low < step < parameter.high
    assert parameter.start == (pytest.approx(step, rel=1e-9),)


# --- derivatives ---

CREEP = Creep(tau_s=(0.1, 1.0))


@pytest.mark.parametrize(
    ("effects", "values", "added"),
    [
        (
            (InputLag(), RATE, MOVING, CREEP, BENT),
            {
                "input_lag": {"tau_s": 0.03},
                "rate_dependence": RATE_VALUES,
                "moving": {"a": 0.2 * 12.0 / TOTAL},
                "creep": {"c_1": 0.05, "c_2": 0.03},
            },
            BEND,
        ),
        (
            (OperatorCreep(TAU_S, 12.0), Reptation(12.0)),
            {"reptation": {"path": 1.3}},
            np.linspace(-0.1, 0.1, 3 * len(SHARES) + len(REACHES)),
        ),
    ],
    ids=["together", "memories"],
)
def test_tangents_against_finite_differences(x64, effects, values, added):
    """What is fed back is held, in the tangents and in the differences."""
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
    creep = {"creep": {"c_1": 0.05, "c_2": 0.03}}
    names = [("creep", "c_1"), ("creep", "c_2")]
    smooth = tangents(*sensor_setting(CREEP, values=creep), names)
    stepped = {**creep, "output_quantisation": {"step": 0.3}}
    got = tangents(*sensor_setting(CREEP, OutputQuantisation(step_z=0.3), values=stepped), names)
    np.testing.assert_allclose(got, smooth, rtol=0, atol=1e-12)
    assert np.abs(smooth).max() > 0.1


# --- the whole way: fitted, saved, read and predicted ---


def test_a_model_of_a_coarse_sensor_is_fitted_to_its_steps_and_reads_back(tmp_path):
    made = world.hidden_record(None, 3, duration_s=8.0, rate_hz=500.0)
    output = np.round(made["z"] / 0.5) * 0.5
    whole = Record.from_arrays(made["t"], made["x"], output, initial_memory="low")
    record = whole.part(0, 3000)
    fit = pj.fit(record, ["output_quantisation"], levels=5)
    step = fit.model.parameters["output_quantisation"]["step"].value
    assert step == pytest.approx(0.5, rel=1e-6)
    # Residual and held-out error are those of the steps.
    np.testing.assert_allclose(fit.prediction / step, np.round(fit.prediction / step), atol=1e-6)
    held_out = np.sqrt(np.mean(fit.residual[fit.validation] ** 2))
    assert fit.rms_validation == pytest.approx(held_out, rel=1e-3)
    fit.model.save(tmp_path / "model.json")
    again = Model.load(tmp_path / "model.json")
    predicted = again.predict(record).output
    assert np.sqrt(np.mean((predicted - record.output) ** 2)) < 1.5 * fit.rms_validation
    # What follows is predicted from a model that knows only the history, in steps.
    after = again.predict(whole.part(3000, len(whole))).output
    np.testing.assert_allclose(after, fit.model.predict(whole).output[3000:], atol=0.51)
    np.testing.assert_allclose(after / 0.5, np.round(after / 0.5), atol=1e-6)

"""The search: terms and effects that help only together, rivals, columns by chance, failures."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from found import LEVELS, ROWS
from scipy import signal
from scipy.interpolate import CubicSpline
from test_modes import RATE, drive, lagging, plays, through

import preisach_jax as pj
from preisach_jax.diagnosis.evidence import by_chance
from preisach_jax.diagnosis.plausible import implausible
from preisach_jax.diagnosis.search import Search, Whole
from preisach_jax.effects import resolve
from preisach_jax.effects.auxiliary import Auxiliary
from preisach_jax.effects.drift import Drift
from preisach_jax.effects.resonance import Resonance
from preisach_jax.fit.stepwise import (
    double_precision,
    in_reduced_basis,
    plain_model,
    refit,
    with_effect,
)
from preisach_jax.identify.problem import evaluate

INPUT_LAG, CREEP, DRIFT = resolve(["input_lag", "creep", "drift"], {})

LAG_S, SETTLING_S, SETTLED = 0.04, 4.0, 3.0

SLOW_HZ = 187.5


@pytest.fixture(scope="module", autouse=True)
def in_double_precision():
    with double_precision():
        yield


def searched(time, u, z, effects, **options):
    """What a search among some effects finds in a record."""
    _, whole, point = plain_model(pj.Record.from_arrays(time, u, z, **options), LEVELS)
    problem, point = in_reduced_basis(whole, point)
    search = Search.of(problem, effects)
    return search, search.run(Whole.of(problem, point))


@pytest.fixture(scope="module")
def two_modes_behind_a_lag():
    """One mode alone is damped until it is about as late as two of them behind a lag."""
    u = drive(9, ROWS)
    z = through(plays(lagging(u, 0.0024)), ((45.0, 0.07, 0.6), (115.0, 0.04, 0.4)))
    z = z + np.random.default_rng([9, 1]).normal(0, 0.01, ROWS)
    with jax.enable_x64(True):
        return searched(np.arange(ROWS) / RATE, u, z, resolve(("input_lag", "resonance"), {}))


def test_a_lag_and_a_mode_more_are_found_where_neither_helps_alone(two_modes_behind_a_lag):
    _, found = two_modes_behind_a_lag
    assert set(found.names) == {"resonance", "input_lag"}
    values = found.now.values
    assert values["input_lag"]["tau_s"] == pytest.approx(0.0024, rel=0.03)
    modes = sorted([(values["resonance"][f], f) for f in ("f_hz", "f_2_hz")])
    assert [f for f, _ in modes] == pytest.approx([45.0, 115.0], rel=0.01)
    assert found.now.validation_mean_square < 0.05 * found.path[1].validation_mean_square
    accepted = [(row.effect, row.step) for row in found.candidates if row.accepted]
    assert accepted == [(name, step) for step, name in enumerate(found.names)]


def test_a_needless_mode_is_left_out(two_modes_behind_a_lag):
    search, _ = two_modes_behind_a_lag
    point = search.filled(search.met[()])
    two = replace(Resonance().bound_to(search.problem.survey), modes=2)
    one = with_effect(search.problem, point, Resonance())
    values = {**one.values["resonance"], "f_2_hz": 300.0, "zeta_2": 0.4, "gain_2": 1e-3}
    chain = point.chain.with_effects((two,))
    rich = evaluate(search.problem, chain, {"resonance": values}, one.strength, one)
    assert not search._stands(Whole.of(search.problem, refit(search.problem, rich)))


@pytest.fixture(scope="module")
def late_and_settling():
    """A stage with a lag of its input and a drift that settles."""
    rng, count = np.random.default_rng(8), 3000
    time = np.arange(count) / SLOW_HZ
    u = np.interp(np.arange(count), np.arange(0, count, 40), rng.uniform(0.0, 10.0, count // 40))
    late = u[0] + signal.lsim(([1.0], [LAG_S, 1.0]), u - u[0], time)[1]
    z = plays(late) + SETTLED * (1 - np.exp(-time / SETTLING_S)) + rng.normal(0, 0.01, count)
    return searched(time, u, z, (INPUT_LAG, CREEP, DRIFT))


def test_two_effects_are_told_from_all_that_look_like_them(late_and_settling):
    search, found = late_and_settling
    assert set(found.names) == {"input_lag", "drift"}
    errors = [point.validation_mean_square for point in found.path]
    assert errors[1] > 0.5 * errors[0]  # either is small beside what the other leaves
    assert errors[2] < 0.01 * errors[1]
    assert found.now.values["drift"]["tau_s"] == pytest.approx(SETTLING_S, rel=0.05)
    assert found.now.values["input_lag"]["tau_s"] == pytest.approx(LAG_S, rel=0.01)
    # Every effect that is named has all others tried beside the model without it.
    for step, before in zip(found.steps, found.path, strict=True):
        present = {effect.name for effect in before.chain.effects}
        assert {t.effect for t in step} >= {e.name for e in search.tried} - present
    assert implausible(search.problem, found.now, "drift") == ""


def test_a_model_without_one_of_its_effects_is_refitted(late_and_settling):
    _, found = late_and_settling
    less = found.without(0, "a reason")
    assert less.names == found.names[1:]
    assert next(r.why_not for r in less.candidates if r.effect == found.names[0]) == "a reason"
    assert less.now.validation_mean_square > found.now.validation_mean_square


def test_a_creep_may_have_a_past_but_not_stand_for_a_drift(late_and_settling):
    """A stage that creeps by 3 % with each of two time constants, and its state from a past."""
    rng = np.random.default_rng(11)
    before, count = 3760, 6760
    u = np.interp(np.arange(count), np.arange(0, count, 40), rng.uniform(0.0, 10.0, count // 40))
    u[:before] = u[before] + 10.0 * (u[before] < 5.0)  # it comes from a rest far away
    time, h = np.arange(count) / SLOW_HZ, plays(u)
    z = h + sum(0.03 * signal.lsim(([1.0], [tau, 1.0]), h, time)[1] for tau in (0.5, 5.0))
    z = (z + rng.normal(0, 0.01, count))[before:]
    problem, point = plain_model(pj.Record.from_arrays(time[: len(z)], u[before:], z), 9)[1:]
    assert implausible(problem, with_effect(problem, point, CREEP), "creep") == ""

    search, _ = late_and_settling
    lag = with_effect(search.problem, search.filled(search.met[()]), INPUT_LAG)
    told = implausible(search.problem, with_effect(search.problem, lag, CREEP), "creep")
    assert "is put down to the time before the record" in told
    assert told.endswith("it stands for a drift")


WANDER_HZ = 150.0


def wandering(turn_s):
    """A stage whose zero wanders in ten waves, and how many a search finds."""
    rng = np.random.default_rng(3)
    time, every = np.arange(ROWS) / WANDER_HZ, round(turn_s * WANDER_HZ)
    turns = np.arange(0, ROWS + every, every)
    u = np.interp(np.arange(ROWS), turns, 10.0 * (np.arange(len(turns)) % 2))
    u = u * (0.7 + 0.3 * np.cos(0.4 * time))
    phases = 2 * np.pi * rng.uniform(size=10)
    slow = (0.1 * np.cos(np.pi * k * time / time[-1] + p) for k, p in enumerate(phases, start=1))
    z = plays(u) + sum(slow) + rng.normal(0, 0.01, ROWS)
    _, found = searched(time, u, z, (DRIFT,))
    return [e.waves for e in found.now.chain.effects if isinstance(e, Drift)]


def test_a_wander_gets_as_many_waves_as_it_has_and_none_as_fast_as_the_drive():
    assert wandering(0.24) in ([12], [24])
    # Twelve waves in 20 s have periods down to 3.3 s; the drive comes back more seldom.
    assert wandering(2.5) in ([], [6])


TIME = np.arange(3000) / WANDER_HZ


def walk(seed, knots=40):
    """A smooth random walk over the record."""
    rng = np.random.default_rng(seed)
    return CubicSpline(np.linspace(0, TIME[-1], knots), rng.normal(size=knots).cumsum())(TIME)


def beside_a_wander(column, acts, seed=0):
    """What speaks against a column, which acts or not, beside a stage whose zero wanders."""
    rng = np.random.default_rng([seed, 1])
    corners = np.arange(0, len(TIME) + 40, 40)
    u = np.interp(np.arange(len(TIME)), corners, rng.uniform(0, 10, len(corners)))
    z = 0.5 * u + plays(u, (0.8,), 1.0) + 0.3 * walk([seed, 2]) + acts * column
    z = z + rng.normal(0, 0.01, len(u))
    _, problem, point = plain_model(pj.Record.from_arrays(TIME, u, z, aux={"temp_C": column}), 9)
    problem, point = in_reduced_basis(problem, point)
    effect = Auxiliary(column="temp_C", unit="1").bound_to(problem.survey)
    drift = Drift(horizon_s=float(TIME[-1]), waves=12)
    values = {"drift": {}, effect.name: {"tau_s": 0.01}}
    chain = point.chain.with_effects((drift, effect))
    rich = evaluate(problem, chain, values, point.strength)
    alone = evaluate(problem, point.chain.with_effects((effect,)), values, point.strength)
    assert by_chance(problem, alone, effect.name) == ""  # beside laws nothing is shifted
    assert by_chance(problem, rich, "drift") == ""
    return by_chance(problem, rich, effect.name)


def test_a_column_that_wanders_is_not_named_for_what_chance_makes_of_it():
    forces = np.random.default_rng(3).normal(size=150)
    column = CubicSpline(np.linspace(0, TIME[-1], 150), forces)(TIME)
    assert beside_a_wander(column, 0.3) == ""
    cases = [beside_a_wander(walk(seed), 0.0) for seed in range(10, 14)]
    assert sum("temp_C shifted in time" in case for case in cases) >= 3

"""A column that wanders beside a zero that wanders is not named for what chance makes of both."""

from types import SimpleNamespace
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline
from test_modes import plays

import preisach_jax as pj
from preisach_jax.diagnosis.chance import by_chance
from preisach_jax.effects.auxiliary import Auxiliary
from preisach_jax.effects.drift import Drift
from preisach_jax.fit import begun, in_reduced_basis
from preisach_jax.identify import evaluate

TIME = np.arange(3000) / 150


def walk(seed, knots=40):
    """A smooth random walk over the record."""
    rng = np.random.default_rng(seed)
    return CubicSpline(np.linspace(0, TIME[-1], knots), rng.normal(size=knots).cumsum())(TIME)


def behind(tau_s) -> Any:
    """What a model with the column has for its lag."""
    return SimpleNamespace(values={"aux:temp_C": {"tau_s": tau_s}})


SOON = behind(0.1)


def beside_a_wander(column, acts, seed=0):
    """A stage whose zero wanders, with a column that acts or not, and a model with a drift."""
    rng = np.random.default_rng([seed, 1])
    corners = np.arange(0, len(TIME) + 40, 40)
    u = np.interp(np.arange(len(TIME)), corners, rng.uniform(0, 10, len(corners)))
    z = (
        0.5 * u
        + plays(u, (0.8,), 1.0)
        + 0.3 * walk([seed, 2])
        + acts * column
        + rng.normal(0, 0.01, len(u))
    )
    record = pj.Record.from_arrays(TIME, u, z, aux={"temp_C": column})
    _, problem, point = begun(record, 9)
    problem, point = in_reduced_basis(problem, point)
    drift = Drift(horizon_s=float(TIME[-1]), waves=12)
    chain = point.chain.with_effects((drift,))
    return problem, evaluate(problem, chain, {"drift": {}}, point.strength)


def asked(problem, now, lag=SOON):
    effect = Auxiliary(column="temp_C", unit="1").bound_to(problem.survey)
    return by_chance(problem, now, effect, lag)


def test_a_column_that_acts_does_more_than_it_would_at_another_time(x64):
    forces = np.random.default_rng(3).normal(size=150)
    column = CubicSpline(np.linspace(0, TIME[-1], 150), forces)(TIME)
    assert asked(*beside_a_wander(column, 0.3)) == ""


def test_most_columns_that_do_nothing_do_no_more_than_at_another_time(x64):
    cases = [beside_a_wander(walk(seed), 0.0) for seed in range(10, 14)]
    assert sum("temp_C shifted in time" in asked(*case) for case in cases) >= 3
    problem, now = cases[0]
    slowest = Auxiliary(column="temp_C", unit="1").bound_to(problem.survey).tau_high_s
    against = asked(problem, now, behind(0.999 * slowest))
    assert "the longest that is looked for, temp_C is a course more of what wanders" in against
    # Beside effects with a law nothing is shifted.
    plain = evaluate(problem, now.chain.with_effects(()), {}, now.strength)
    assert asked(problem, plain) == asked(problem, plain, behind(slowest)) == ""
    assert by_chance(problem, now, Drift(), SOON) == ""

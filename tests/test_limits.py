"""Limits of what was not found: closed forms, coverage on records of known content, and texts."""

from dataclasses import replace
from typing import Any
from unittest.mock import Mock

import jax.numpy as jnp
import numpy as np
import pytest
from exported import KINDS

from preisach_jax.chain.coefficients import Coefficients
from preisach_jax.chain.description import Chain
from preisach_jax.chain.output import response
from preisach_jax.chain.signals import signals_of
from preisach_jax.diagnosis.limits import limits
from preisach_jax.effects.base import AddedEffect
from preisach_jax.effects.drift import Drift
from preisach_jax.effects.parameter import Parameter
from preisach_jax.identify.problem import ALL, Point, Problem, evaluate, with_all_rows
from preisach_jax.identify.regression import normal_equations, penalties
from preisach_jax.identify.signature import Projection
from preisach_jax.operator.plane import Plane
from preisach_jax.record.core import Record

LEVELS, COUNT, STEP = 9, 3000, 0.005
UNITS = {"input": "V", "output": "um"}


def excitation():
    """Ramps at two speeds between random levels, with a rest after every fourth."""
    rng = np.random.default_rng(11)
    turns, corners = [0.0], [0.0]
    while corners[-1] < COUNT * STEP:
        level = 10.0 * rng.uniform() if len(turns) > 3 else (10.0, 0.0, 10.0)[len(turns) - 1]
        speed = (15.0, 60.0)[len(turns) % 2]
        corners.append(corners[-1] + max(abs(level - turns[-1]) / speed, STEP))
        turns.append(level)
        if len(turns) % 4 == 0:
            corners.append(corners[-1] + 0.5)
            turns.append(level)
    time = np.arange(COUNT) * STEP
    return time, np.interp(time, corners, turns)


TIME, INPUT = excitation()
PLANE = Plane(LEVELS, float(INPUT.min()), float(INPUT.max()))


def hidden(effects=(), values=None, added=(), noise=0.01, seed=0, driven=INPUT):
    """A record of a model with the plane of the fit, so that all else is noise.

    What drives it may be another course than the recorded one.
    """
    chain = Chain(PLANE, tuple(effects))
    i, j = np.tril_indices(LEVELS)
    weights = 0.5 + 0.2 * i + 0.1 * j + np.where(i == j, 1.0, 0.0)
    every = np.zeros(len(chain.coefficients))
    every[: len(added)] = added
    blank = Record.from_arrays(TIME, driven, np.zeros(COUNT), initial_memory="low")
    coefficients = Coefficients(weights, np.zeros(len(i)), 2.0, every)
    output = np.asarray(response(chain, values or {}, signals_of(blank), coefficients))
    output = output + noise * np.random.default_rng(seed).normal(size=COUNT)
    return Record.from_arrays(TIME, INPUT, output, units=UNITS, initial_memory="low")


def plain_point(record, strength=1e-8):
    problem = Problem.of(record)
    return problem, evaluate(problem, Chain(PLANE), {}, strength)


def test_size_and_deviation_are_those_of_a_regression(x64):
    """On a random matrix, the size is the last coefficient of an ordinary least squares fit."""
    rng = np.random.default_rng(1)
    problem, real = plain_point(hidden())
    cells, nonnegative = 6, np.arange(7) < 6
    matrix = rng.normal(size=(COUNT, cells + 1))
    matrix[:, cells] = 1.0
    target = matrix @ np.array([1.0, 2.0, 0.5, -3.0, 1.5, 1.0, 0.3]) + 0.1 * rng.normal(size=COUNT)
    equations = normal_equations(matrix, target, problem.fold, nonnegative, penalties(3, ()))
    zeros, none = np.zeros(cells), np.zeros(6, dtype=bool)
    columns = replace(
        real.columns, matrix=matrix, cells=cells, groups=(), start=zeros, first_run=none
    )
    chain = Chain(Plane(3, 0.0, 10.0))
    point = with_all_rows(
        Point(chain, {}, 1e-14, ALL, 1.0, 0.0, target, matrix, columns, equations, np.empty(0), 0.0)
    )
    assert (point.solution[:cells] > 0).tolist() == [True, True, True, False, True, True]
    free = matrix[:, np.append(point.solution[:cells] > 0, True)]
    signature = matrix[:, 0] + 0.3 * rng.normal(size=COUNT)
    seen = Projection(problem, point).see(signature, {"tau_s": 1.0})

    whole = np.concatenate([free, signature[:, None]], axis=1)
    size = np.linalg.lstsq(whole, target, rcond=None)[0][-1]
    assert seen.size == pytest.approx(size, rel=1e-6)
    left = signature - free @ np.linalg.lstsq(free, signature, rcond=None)[0]
    residual = target - free @ np.linalg.lstsq(free, target, rcond=None)[0]
    scores = [
        np.sum((left * residual)[problem.block == block]) for block in np.unique(problem.block)
    ]
    count = len(scores)
    deviation = np.sqrt(np.sum(np.square(scores)) * count / (count - 1)) / (left @ left)
    assert seen.deviation == pytest.approx(deviation, rel=1e-6)
    # White noise: what ordinary least squares says of its coefficient.
    assert seen.deviation == pytest.approx(residual.std() / np.linalg.norm(left), rel=0.35)
    assert seen.absorbed == pytest.approx(1 - left @ left / (signature @ signature), abs=1e-9)
    assert seen.rms == pytest.approx(np.sqrt(np.mean(signature**2)))
    assert seen.values == {"tau_s": 1.0}


def limit_of(record, effect) -> Any:
    problem, point = plain_point(record)
    (found,) = limits(problem, point, [effect])
    return found


SIZED: dict[str, tuple] = {
    "drift": (Drift(), Drift(horizon_s=15.0), {"drift": {"tau_s": 8.0}}, ("amplitude", "um")),
    "output_lag": (KINDS["output_lag"](), KINDS["output_lag"](), {}, ("tau_s", "s")),
}


def with_small(name, size, seed):
    """A record that hides an effect of a given size, in the unit of its limit."""
    _, effect, values, _ = SIZED[name]
    values = values or {name: {"tau_s": size}}
    return hidden((effect,), values, (size,) if effect.coefficients() else (), seed=seed)


def detectable(name):
    """What white noise lets be seen: 1.96 deviations of ordinary least squares, all else free."""
    problem, point = plain_point(hidden())
    moved = with_small(name, 1e-3, 0).output - hidden().output
    left = moved - point.matrix @ np.linalg.lstsq(point.matrix, moved[problem.rows], rcond=None)[0]
    return 1.96 * 0.01 / np.linalg.norm(left / 1e-3)


@pytest.mark.parametrize("name", SIZED)
def test_the_limit_lies_above_what_is_hidden_and_near_what_can_be_seen(x64, name):
    size, (effect, _, _, quantity) = detectable(name), SIZED[name]
    found = [limit_of(with_small(name, size, seed), effect) for seed in range(10)]
    assert {(each.effect, each.quantity, each.unit) for each in found} == {(name, *quantity)}
    assert sum(each.value >= size for each in found) >= 8
    assert 0 < limit_of(hidden(), effect).value < 10 * size


def added(name, column):
    """An effect that adds one column that is made of the record."""
    gain = (Parameter("gain", "{z}/{u}", -jnp.inf, jnp.inf),)
    own = {"coefficients": lambda self: gain, "columns": lambda self, s: column(s)[:, None]}
    return type(name, (AddedEffect,), {"name": name} | own)()


LINEAR = added("linear", lambda signals: signals.input)  # as the cells on the diagonal
CHANCE = added("chance", lambda _: jnp.asarray(np.random.default_rng(5).normal(size=COUNT)))


def test_what_the_density_takes_up_has_no_limit_and_the_noise_limits_the_rest(x64):
    taken, rest = limit_of(hidden(), LINEAR), limit_of(hidden(), CHANCE)
    assert (taken.value, taken.rms, taken.unit) == (None, None, "um/V")
    assert taken.absorbed == pytest.approx(1.0, abs=1e-6)
    # Two-sided: one deviation of the estimate is 0.01 / sqrt(rows), and it lies within a few.
    assert 1.5 < rest.value / (0.01 / np.sqrt(COUNT)) < 6
    assert rest.rms == pytest.approx(rest.value, rel=0.1)
    assert rest.absorbed < 0.05


def test_a_built_in_effect_that_fails_is_not_passed_over(x64, monkeypatch):
    """Those of a user's own are: test_own_effect.py."""
    monkeypatch.setattr(Drift, "bound_to", Mock(side_effect=KeyError("its table")))
    with pytest.raises(KeyError, match="its table"):
        limit_of(hidden(), Drift())


def test_the_limit_of_a_slew_is_a_speed_and_that_of_a_lag_a_time(x64):
    slew, lag = limit_of(hidden(), KINDS["slew_limit"]()), limit_of(hidden(), KINDS["input_lag"]())
    assert (slew.above, slew.unit) == (True, "V/s")
    # The fastest ramps have 60 V/s: a slower drive would be seen at once.
    assert 30.0 < slew.value <= 60.0
    assert slew.text("um").startswith("slew above ")
    assert (lag.above, lag.quantity) == (False, "tau_s")
    assert 0.0 < lag.value < STEP


@pytest.mark.parametrize("quantum", [0.0, 0.05])
def test_the_limit_of_a_drives_steps_is_what_would_make_the_whole_residual(x64, quantum):
    driven = np.round(INPUT / quantum) * quantum if quantum else INPUT
    record = hidden(driven=driven)
    found = limit_of(record, KINDS["input_quantisation"]())
    whole = float(np.std(plain_point(record)[1].residual)) * np.ptp(record.output)
    assert quantum < found.value < max(1.5 * quantum, 0.02)
    # What the density takes up of it does not show in the residual.
    assert whole < found.rms * np.sqrt(1 - found.absorbed) < 1.15 * whole
    assert found.text("um").startswith("step below ")


def test_the_limit_of_steps_that_the_readings_show_is_their_step(x64):
    smooth, effect = hidden(), KINDS["output_quantisation"]()
    none = limit_of(smooth, effect)
    assert none.value is None or none.value < 1e-4
    found = limit_of(replace(smooth, output=np.round(smooth.output / 0.25) * 0.25), effect)
    assert found.value == pytest.approx(0.25)
    assert found.rms == pytest.approx(0.25 / np.sqrt(12), rel=0.3)
    assert found.text("um").startswith("step of 250 nm, as the record itself shows (")

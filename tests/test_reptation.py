"""Reptation: against small steps, laws of a forgetting by path, and a stage that has it."""

import acting
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import world

import preisach_jax as pj
from preisach_jax.effects.base import Signals
from preisach_jax.effects.reptation import SHARES, Reptation


def wandering(seed, count=60):
    rng = np.random.default_rng(seed)
    moves = 0.2 * rng.normal(size=count) * (rng.uniform(size=count) < 0.8)
    return np.cumsum(rng.uniform(0.01, 0.3, count)), np.cumsum(moves)


def columns(effect, path, values, time=None):
    time = np.arange(len(path)) if time is None else time
    return np.asarray(acting.columns(effect, values, acting.signals(time, path)))


def slow_columns(path, reach, travel, parts=2000):
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


@pytest.mark.parametrize("travel", [0.1, 2.0])
def test_columns_are_small_steps_of_two_plays(precision, travel):
    _, path = wandering(1)
    got = columns(Reptation(2.0), path, {"path": travel})
    assert got.dtype == precision
    expected = slow_columns(path, 2.0 * np.array(SHARES), travel)
    assert (np.ptp(expected, axis=0) > 0.02).all()
    np.testing.assert_allclose(got, expected, rtol=0, atol=2e-3)


def test_the_step_is_exact(x64):
    _, path = wandering(2)
    fine = np.interp(np.arange(0, 59.01, 0.125), np.arange(60), path)
    values = {"path": 0.7}
    whole = columns(Reptation(1.0), path, values)
    np.testing.assert_allclose(columns(Reptation(1.0), fine, values)[::8], whole, atol=1e-12)


def test_neither_time_nor_rate_matters(x64):
    time, path = wandering(3)
    slow = columns(Reptation(1.0), path, {"path": 1.0}, 50 * time)
    np.testing.assert_array_equal(slow, columns(Reptation(1.0), path, {"path": 1.0}, time))


def test_a_repeated_minor_loop_moves_less_and_less(x64):
    path = np.concatenate([[0.0, 1.0], np.tile([0.4, 0.5], 200)])
    (column,) = columns(Reptation(1.0), path, {"path": 2.0}).T[2:]
    ends = column[3::2]
    shifts = np.diff(ends)
    assert (shifts < 0).all()
    assert abs(shifts[-1]) < 1e-3 * abs(shifts[0])
    # From the edge of the play it has gone to the middle of the minor loop.
    assert 0.65 + ends[-1] == pytest.approx(0.45, abs=0.01)


def test_derivatives_against_finite_differences(x64):
    _, path = wandering(4)

    def at(value):
        return columns(Reptation(1.0), path, {"path": value})

    signals = Signals(jnp.arange(60.0), jnp.asarray(path), {})

    def traced(value):
        return Reptation(1.0).at({"path": value}).columns(signals)

    got = jax.jvp(traced, (1.3,), (1.0,))[1]
    expected = (at(1.3 + 1e-5) - at(1.3 - 1e-5)) / 2e-5
    assert np.abs(expected).max() > 1e-2
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-6)


def forgetful(seed, fade):
    """A stage of relays whose states, where the input does not hold them, fade to the middle."""
    rng = np.random.default_rng([seed, 79])
    path = world.excitation("rich", 10.0, 500.0, seed) / world.TOP
    middle, half = np.meshgrid(np.linspace(0.0, 1.0, 75), np.linspace(0.002, 0.35, 24))
    inside = (middle + half < 1.0) & (middle - half > 0.0)
    up, down = (middle + half)[inside], (middle - half)[inside]
    weight = np.exp(-half / 0.12)[inside]
    width = 0.02  # each relay stands for some that switch one after the other
    state, travel = np.zeros_like(up), np.abs(np.diff(path, prepend=path[0]))
    z = np.empty_like(path)
    for n, value in enumerate(path):
        state = 0.5 + (state - 0.5) * np.exp(-fade * travel[n])
        on = np.clip((value - up) / width + 0.5, 0.0, 1.0)
        held = np.clip((value - down) / width + 0.5, 0.0, 1.0)
        state = np.minimum(held, np.maximum(on, state))
        z[n] = weight @ state
    z = 0.3 * 60.0 * z / np.ptp(z) + 0.7 * 60.0 * path**1.1
    time, noise = np.arange(len(z)) / 500.0, 0.006 * rng.normal(size=len(z))
    return pj.Record.from_arrays(time, world.TOP * path, z + noise)


NEIGHBOURS = ["creep", "drift", "reptation"]


@pytest.mark.slow
def test_it_is_found_where_it_is_hidden():
    found = pj.diagnose(forgetful(221, 0.8), NEIGHBOURS, levels=13)
    assert found.effects[0] == "reptation"
    first, last = found.ladder[0].rms_validation, found.ladder[-1].rms_validation
    assert last < 0.8 * first


@pytest.mark.parametrize("effect", [None, "creep", "drift"])
def test_it_does_not_take_the_place_of_another(effect):
    made = world.hidden_record(effect, 222, 10.0, 500.0)
    record = pj.Record.from_arrays(made["t"], made["x"], made["z"])
    found = pj.diagnose(record, NEIGHBOURS, levels=13)
    assert found.effects == (() if effect is None else (effect,))

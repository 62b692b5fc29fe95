"""Creep with thresholds: against small steps, laws of the operator, and a stage that has it."""

import acting
import jax.numpy as jnp
import numpy as np
import pytest
import world

import preisach_jax as pj
from preisach_jax.effects.operator_creep import SHARES, OperatorCreep, creep_step

TAU_S = (0.05, 0.4, 3.0)


def wandering(seed, count=40):
    """Uneven times with a gap, and an input that moves and rests."""
    rng = np.random.default_rng(seed)
    steps = rng.uniform(0.01, 0.3, count)
    steps[count // 2] = 5.0
    return np.cumsum(steps), np.cumsum(rng.normal(size=count) * (rng.uniform(size=count) < 0.8))


def columns(effect, time, path):
    return np.asarray(acting.columns(effect, {}, acting.signals(time, path)))


def slow_elements(time, path, thresholds, tau_s, parts=4000):
    """(time, threshold, tau) elements in small explicit steps at the middle of each."""
    place = np.full((len(thresholds), len(tau_s)), path[0])
    reach, course = np.asarray(thresholds)[:, None], [place]
    for n in range(1, len(path)):
        step = (time[n] - time[n - 1]) / parts
        for share in (np.arange(parts) + 0.5) / parts:
            away = path[n - 1] + share * (path[n] - path[n - 1]) - place
            pull = np.maximum(away - reach, np.minimum(away + reach, 0.0))
            place = place + pull * -np.expm1(-step / np.asarray(tau_s))
        course.append(place)
    return np.array(course)


def test_columns_are_small_steps_of_the_differential_equation(precision):
    time, path = wandering(1)
    effect = OperatorCreep(TAU_S, float(np.ptp(path)))
    got = columns(effect, time, path)
    assert got.dtype == precision
    assert got.shape == (len(time), 3 * len(SHARES))
    elements = slow_elements(time, path, np.ptp(path) * np.array(SHARES), TAU_S)
    spectrum = np.array([[1.0, -1.0, 1.0], [1.0, 0.0, -0.5], [1.0, 1.0, 1.0]])
    spectrum *= np.log10(TAU_S[-1] / TAU_S[0]) / 2
    expected = (elements @ spectrum).reshape(len(time), -1)
    assert np.ptp(expected[:, 0]) > 3
    np.testing.assert_allclose(got, expected, rtol=0, atol=5e-3)


def test_the_step_is_exact(x64):
    """One long step is as good as many short ones, also where it turns an element around."""
    time, path = wandering(2)
    fine_time = np.interp(np.arange(0, 39.01, 0.125), np.arange(40), time)
    fine_path = np.interp(fine_time, time, path)
    effect = OperatorCreep(TAU_S, float(np.ptp(path)))
    coarse, fine = columns(effect, time, path), columns(effect, fine_time, fine_path)
    np.testing.assert_allclose(fine[::8], coarse, rtol=0, atol=1e-10)


@pytest.mark.parametrize("threshold", [0.0, 0.7])
def test_after_a_jump_an_element_approaches_its_threshold(x64, threshold):
    place = creep_step(1.0, 3.0, 3.0, jnp.asarray(0.6), threshold, jnp.asarray(0.5))
    assert float(place) == pytest.approx(3.0 - threshold - (2.0 - threshold) * np.exp(-1.2))


def test_within_the_threshold_nothing_creeps(x64):
    time = np.arange(50.0)
    effect = OperatorCreep(TAU_S, 1.0)
    got = columns(effect, time, SHARES[0] * np.sin(time))
    np.testing.assert_allclose(got, np.broadcast_to(got[0], got.shape), rtol=0, atol=1e-12)


def hidden(seed, size):
    """A stage with creep operators of many thresholds, in small steps; and with linear creep."""
    made = world.hidden_record(None, seed, 16.0, 500.0)
    rng = np.random.default_rng([seed, 77])
    fine = np.arange(32_000) / 2000
    path = world.waveform("rich", 16.0, seed)(fine)
    reach = np.sort(rng.uniform(0.05, 0.45, 8))[:, None] * world.TOP
    weight = np.exp(-reach / world.TOP / rng.uniform(0.2, 0.5))
    keep = np.expm1(-1 / 2000 / 10 ** np.linspace(-1.6, 0.9, 6))
    place, crept = np.full((8, 6), path[0]), np.empty_like(path)
    for n, value in enumerate(path):
        away = value - place
        place = place - keep * (away - np.minimum(np.maximum(away, -reach), reach))
        crept[n] = (weight * place).sum()
    crept *= size * 0.05 * made["truth"]["stroke_um"] / np.ptp(crept)
    return pj.Record.from_arrays(made["t"], made["x"], made["z"] + crept[::4])


NEIGHBOURS = ["creep", "operator_creep", "drift"]


@pytest.mark.slow
def test_it_is_found_where_it_is_hidden():
    found = pj.diagnose(hidden(211, 1.0), NEIGHBOURS, levels=13)
    assert found.effects[0] == "operator_creep"
    first, last = found.ladder[0].rms_validation, found.ladder[-1].rms_validation
    assert last < 0.2 * first


@pytest.mark.parametrize("effect", [None, "creep"])
def test_it_does_not_take_the_place_of_another(effect):
    made = world.hidden_record(effect, 212, 16.0, 500.0)
    record = pj.Record.from_arrays(made["t"], made["x"], made["z"])
    found = pj.diagnose(record, NEIGHBOURS, levels=13)
    assert found.effects == (() if effect is None else (effect,))

"""The noise of a record is measured whatever its colour, with rests of the input and without."""

from itertools import pairwise

import numpy as np
import pytest
from scipy import signal
from threadpoolctl import threadpool_limits

import preisach_jax as pj
from preisach_jax.chain.coefficients import Coefficients
from preisach_jax.chain.description import Chain
from preisach_jax.chain.output import response
from preisach_jax.chain.signals import signals_of
from preisach_jax.diagnosis.noise import noise_rms
from preisach_jax.effects.creep import Creep
from preisach_jax.fit.stepwise import base_point
from preisach_jax.identify.problem import Problem
from preisach_jax.operator.plane import Plane
from preisach_jax.record.core import Record

LEVELS, RATE = 9, 500.0
NOISE = 0.02


@pytest.fixture(autouse=True)
def one_thread():
    with threadpool_limits(1):
        yield


def excitation(holds):
    """Ramps between levels all over the range, each followed by a rest of a second or by none."""
    rng = np.random.default_rng(4)
    corners, turns = [0.0], [0.0]
    for level in [10.0, 0.0, *(10 * rng.uniform(size=24)), 10.0, 0.0]:
        corners.append(corners[-1] + max(abs(level - turns[-1]) / 40.0, 0.01))
        turns.append(level)
        if holds:
            corners.append(corners[-1] + 1.0)
            turns.append(level)
    time = np.arange(round(corners[-1] * RATE)) / RATE
    return time, np.interp(time, corners, turns)


def measured(holds, colour=0.0, seed=0, effects=(), values=None):
    """A record whose output is that of a plane of the fit, with noise of a given colour."""
    time, path = excitation(holds)
    plane = Plane(LEVELS, float(path.min()), float(path.max()))
    chain = Chain(plane, tuple(effects))
    i, j = np.tril_indices(LEVELS)
    weights = 0.5 + 0.2 * i + 0.1 * j + np.where(i == j, 1.0, 0.0)
    blank = Record.from_arrays(time, path, np.zeros(len(time)), initial_memory="low")
    nothing = np.zeros(len(chain.coefficients))
    coefficients = Coefficients(weights, np.zeros(len(i)), 0.0, nothing)
    clean = np.asarray(response(chain, values or {}, signals_of(blank), coefficients))
    white = np.random.default_rng(seed).normal(size=len(time) + 1000)
    noise = np.asarray(signal.lfilter([np.sqrt(1 - colour**2)], [1.0, -colour], white))[1000:]
    record = Record.from_arrays(time, path, clean + NOISE * noise, initial_memory="low")
    problem = Problem.of(record)
    return problem, base_point(problem, LEVELS)


@pytest.mark.parametrize(("holds", "colour"), [(True, 0.0), (False, 0.0), (True, 0.9)])
def test_noise_is_measured(x64, holds, colour):
    """One of a long memory only where the input rests."""
    expected = pytest.approx(NOISE, rel=0.25 if colour else 0.1)
    assert noise_rms(*measured(holds, colour)) == expected


def test_creep_in_the_rests_is_no_noise(x64):
    creep = Creep(tau_s=(0.03, 0.1, 0.3, 1.0, 3.0))
    values = {"creep": {f"c_{i}": 0.01 for i in range(1, 6)}}
    problem, point = measured(True, effects=(creep,), values=values)
    # The creep that a plain model leaves is several times the noise.
    assert np.sqrt(np.mean(point.residual**2)) * problem.unit > 3 * NOISE
    assert noise_rms(problem, point) == pytest.approx(NOISE, rel=0.1)


def turning(periods, colour=0.9, seed=3, added=None, wave=0.3):
    """A record of a drive that repeats itself, behind a way there, with noise of a colour."""
    rng = np.random.default_rng(seed)
    way = np.linspace(5.0, 0.0, 60)
    corners = [0.0, 9.0, 4.0, 6.0, 1.0, 10.0, 0.0]
    loop = np.concatenate([np.linspace(a, b, 300, endpoint=False) for a, b in pairwise(corners)])
    path = np.concatenate([way, np.tile(loop, periods)])
    white = rng.normal(size=len(path) + 500)
    noise = np.asarray(signal.lfilter([np.sqrt(1 - colour**2)], [1.0, -colour], white))[500:]
    time = np.arange(len(path)) / RATE
    output = path + wave * np.sin(40 * path) + NOISE * noise
    if added is not None:
        output = output + added(time)
    record = Record.from_arrays(time, path, output, initial_memory="low")
    problem = Problem.of(record)
    return problem, base_point(problem, LEVELS)


@pytest.mark.parametrize(("colour", "periods"), [(0.0, 3), (0.9, 8)])
def test_noise_is_what_differs_from_period_to_period(x64, colour, periods):
    """What is the same in each period is none, though it is fast and the model misses it."""
    problem, point = turning(periods, colour)
    assert np.sqrt(np.mean(point.residual**2)) * problem.unit > 5 * NOISE
    # Lines over 100 samples take a fifth of the power of noise that remembers ten.
    assert noise_rms(problem, point) == pytest.approx(NOISE, rel=0.3 if colour else 0.15)


@pytest.mark.parametrize(
    "added",
    [
        lambda t: 2.0 * np.sin(2 * np.pi * t / 17.3),  # wanders over some periods
        lambda t: np.where((t > 8.0) & (t < 18.0), 1.0, 0.0),  # jumps twice
    ],
)
def test_what_wanders_or_jumps_now_and_then_is_no_noise_of_a_period(x64, added):
    assert noise_rms(*turning(8, added=added)) == pytest.approx(NOISE, rel=0.35)


@pytest.mark.parametrize("colour", [0.0, 0.9])
def test_slow_noise_is_noise_in_the_budget_without_rests_or_periods(colour):
    problem, _ = measured(holds=False, colour=colour, seed=3)
    found = pj.diagnose(problem.record, ["drift"], levels=LEVELS)
    assert found.verdict == "adequate"
    assert found.budget.noise == pytest.approx(NOISE, rel=0.1)
    assert found.budget.whole == pytest.approx(found.final.rms_validation)

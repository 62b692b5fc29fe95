"""Field separation: against root finding sample by sample, and a core that has it."""

import jax.numpy as jnp
import numpy as np
import pytest
import world
from scipy.optimize import brentq

import preisach_jax as pj
from preisach_jax.chain import Chain, Coefficients, drive, hysteresis_output, signals_of
from preisach_jax.effects.base import Survey
from preisach_jax.effects.eddy_currents import EddyCurrents
from preisach_jax.effects.moving import Moving
from preisach_jax.operator.plane import Plane
from preisach_jax.record import Record

PLANE = Plane(levels=5, low=-1.0, high=9.0)
WEIGHTS = np.random.default_rng(1).uniform(0.2, 1.0, PLANE.cells)
TOTAL = float(WEIGHTS.sum())


def wandering(seed, count=120):
    """Uneven times with a gap, and an input that jumps, wanders and rests."""
    rng = np.random.default_rng(seed)
    steps = rng.uniform(0.005, 0.02, count)
    steps[count // 3] = 0.9
    moves = 1.5 * rng.normal(size=count) * (rng.uniform(size=count) < 0.8)
    return np.cumsum(steps), np.abs((np.cumsum(moves) + 10.0) % 20.0 - 10.0) - 1.0


def slow_output(time, path, k, a=0.0):
    """Ramps one by one; at every sample the root of what the output must agree with."""
    width = (PLANE.high - PLANE.low) / PLANE.levels
    states, before, course = np.zeros(PLANE.cells), 0.0, []

    def moved(seen):
        on = np.clip((seen - PLANE.alpha) / width + 0.5, 0.0, 1.0)
        held = np.clip((seen - PLANE.beta) / width + 0.5, 0.0, 1.0)
        return np.minimum(held, np.maximum(states, on))

    for n, value in enumerate(path):

        def seen(h, n=n, value=value, before=before):
            field = value - (k * (h - before) / (time[n] - time[n - 1]) if n else 0.0)
            return PLANE.low + (field - PLANE.low + a * h) / (1 + a * TOTAL / 10.0)

        def excess(h, seen=seen):
            return WEIGHTS @ moved(seen(h)) - h

        output = float(np.asarray(brentq(excess, -1e-9, TOTAL + 1e-9, xtol=1e-13)))
        states, before = moved(seen(output)), output
        course.append(output)
    return np.array(course)


def setting(k, a=None, seed=1):
    time, path = wandering(seed)
    record = Record.from_arrays(time, path, np.zeros(len(path)), initial_memory="low")
    effects, values = (EddyCurrents(10.0, 1.0),), {"eddy_currents": {"k": k}}
    if a is not None:
        effects = (*effects, Moving(PLANE.low, 10.0, TOTAL))
        values["moving"] = {"a": a}
    return Chain(PLANE, effects), values, signals_of(record), time, path


COEFFICIENTS = Coefficients(WEIGHTS, np.zeros(PLANE.cells), 0.0, np.zeros(0))


@pytest.mark.parametrize("k", [0.0, 1e-3, 0.05, 3.0])
@pytest.mark.parametrize("a", [None, 0.2 * 10.0 / TOTAL])
def test_the_output_agrees_with_itself_at_every_sample(x64, k, a):
    chain, values, signals, time, path = setting(k, a)
    got = np.asarray(hysteresis_output(chain, values, signals, COEFFICIENTS))
    expected = slow_output(time, path, k, a or 0.0)
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-8)
    if k:
        plain = slow_output(time, path, 0.0, a or 0.0)
        assert np.abs(plain - expected).max() > 0.05


def test_in_single_precision_as_well():
    chain, values, signals, time, path = setting(0.05)
    got = hysteresis_output(chain, values, signals, COEFFICIENTS)
    assert got.dtype == "float32"
    np.testing.assert_allclose(got, slow_output(time, path, 0.05), rtol=0, atol=1e-3 * TOTAL)


def test_relays_stop_where_they_would_take_back_their_own_jump(x64):
    chain, values, signals, _, _ = setting(0.02)
    chain = Chain(PLANE, chain.effects, "relay")
    got = np.asarray(hysteresis_output(chain, values, signals, COEFFICIENTS))
    assert np.isfinite(got).all()
    assert (got >= 0).all()
    assert (got <= TOTAL * (1 + 1e-9)).all()


def test_a_steady_move_lags_by_k_times_its_speed(x64):
    time = np.linspace(0.0, 2.0, 41)
    output = 3.0 * time
    seen = EddyCurrents(k=0.2).fed_back(
        jnp.asarray(5 * time), jnp.asarray(output), jnp.asarray(time)
    )
    np.testing.assert_allclose(seen[1:], 5 * time[1:] - 0.6, rtol=1e-12)


def test_what_drives_the_hysterons_is_that_of_the_output_found(x64):
    chain, values, signals, _, path = setting(0.05)
    output = hysteresis_output(chain, values, signals, COEFFICIENTS)
    seen = np.asarray(drive(chain, values, signals, output).rising)
    # A lag never leaves the range of what it follows.
    assert seen.min() >= path.min() - 1e-9
    assert seen.max() <= path.max() + 1e-9
    assert np.abs(seen - path).max() > 0.5


def test_the_bound_comes_from_the_record():
    time = np.arange(1001) * 1e-2
    path = 5.0 * np.sin(time)
    bound = EddyCurrents().bound_to(Survey(10.0, 1e-2, time, path, 3 * path, path))
    (k,) = bound.parameters()
    assert k.high == pytest.approx(10.0 / 15.0, rel=0.02)
    assert EddyCurrents().bound_to(Survey(10.0, 1e-2)).parameters() == EddyCurrents().parameters()


def core(seed, k, fine=4, seconds=6.0, rate_hz=1000.0):
    """A core of bent plays, of which the field inside is found on a finer raster by bisection."""
    rng = np.random.default_rng([seed, 78])
    step = 1 / (rate_hz * fine)
    count = round(seconds * rate_hz)
    path = world.waveform("rich", seconds, seed)(np.arange((count - 1) * fine + 1) * step)
    path = path / world.TOP
    radius = np.sort(rng.uniform(0.0, 0.3, 30))
    weight = np.exp(-radius / 0.1) * rng.uniform(0.5, 1.5, 30)
    weight /= weight.sum()
    centre, width = rng.uniform(0.3, 0.7, 30), rng.uniform(0.15, 0.3, 30)

    def flux(place):
        return weight @ (0.2 * place + width * np.tanh((place - centre) / width))

    place, field = np.zeros(30), path[0]
    before, course = flux(place), []
    for goal in path:
        low, high = min(field, goal), max(field, goal)
        for _ in range(26):
            field = 0.5 * (low + high)
            h = flux(np.clip(place, field - radius, field + radius))
            if field + k / step * (h - before) > goal:
                high = field
            else:
                low = field
        place = np.clip(place, field - radius, field + radius)
        before = flux(place)
        course.append(before)
    z = 60.0 * np.array(course)[::fine]
    time = np.arange(count) / rate_hz
    return Record.from_arrays(time, world.TOP * path[::fine], z + 0.006 * rng.normal(size=count))


NEIGHBOURS = ["input_lag", "rate_dependence", "eddy_currents"]


@pytest.mark.slow
def test_it_is_found_where_it_is_hidden():
    found = pj.diagnose(core(231, 2e-3), NEIGHBOURS, levels=9)
    assert found.effects[0] == "eddy_currents"
    k = found.findings[0].parameters["k"].value
    # A derivative over one step of the record is a few per cent too slow.
    assert k == pytest.approx(2e-3 * world.TOP / 60.0, rel=0.15)


@pytest.mark.parametrize("effect", [None, pytest.param("input_lag", marks=pytest.mark.campaign)])
def test_it_does_not_take_the_place_of_another(effect):
    made = world.hidden_record(effect, 232, 6.0, 1000.0)
    record = Record.from_arrays(made["t"], made["x"], made["z"])
    found = pj.diagnose(record, NEIGHBOURS, levels=9)
    assert found.effects == (() if effect is None else (effect,))

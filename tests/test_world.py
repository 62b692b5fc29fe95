"""The simulated actuator of the tests obeys Preisach's laws and hides what it says."""

import ast
import inspect
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import world
from scipy import signal
from world import EFFECTS, OUTSIDE, TOP, hidden_record, make_world

SHORT: dict[str, Any] = {"duration_s": 6.0, "rate_hz": 1000.0}


def path(*levels, points=200):
    """A path through levels, each ramp in `points` steps."""
    ramps = [np.linspace(a, b, points + 1)[1:] for a, b in pairwise(levels)]
    return np.concatenate([[levels[0]], *ramps])


@pytest.fixture(scope="module", params=[0, 5])
def actuator(request):
    return make_world(request.param)


def test_it_shares_nothing_with_the_package():
    tree = ast.parse(inspect.getsource(world))
    modules = [alias.name for n in ast.walk(tree) if isinstance(n, ast.Import) for alias in n.names]
    modules += [str(node.module) for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    assert {"numpy", "scipy"} <= {name.split(".")[0] for name in modules}
    assert not [name for name in modules if "preisach" in name or "jax" in name]


def test_path_agrees_with_a_sum_of_relays(actuator):
    """Brute force: a grid of relays, each with the density's integral over its cell."""
    levels = 150
    edges = np.linspace(0.0, TOP, levels + 1)
    rng = np.random.default_rng(3)
    turns = edges[rng.integers(0, levels + 1, 60)]
    u = path(0.0, *turns, points=40)
    whole = actuator.everett(*np.meshgrid(edges, edges, indexing="ij"))
    cell = whole[1:, :-1] - whole[:-1, :-1] - whole[1:, 1:] + whole[:-1, 1:]
    i, j = np.tril_indices(levels, -1)
    diagonal = np.diagonal(whole[1:, :-1])
    state, z = np.zeros(len(i), bool), np.empty(len(u))
    for k, value in enumerate(u):
        reached = edges[1:] <= value + 1e-9
        # A relay is on from the upper edge of its cell and off again from the lower one.
        state = (state | reached[i]) & (edges[:-1][j] < value - 1e-9)
        z[k] = cell[i, j][state].sum() + diagonal[reached].sum()
    at_turns = slice(0, None, 40)
    smooth = actuator.hysteresis(u)[at_turns] - actuator.reversible(u[at_turns])
    np.testing.assert_allclose(z[at_turns], smooth, atol=1e-9 * actuator.stroke)


@pytest.mark.parametrize("effect", [None, *EFFECTS, *OUTSIDE])
def test_a_record_depends_on_its_seed_alone(effect):
    first, again, other = (hidden_record(effect, seed, **SHORT) for seed in (7, 7, 8))
    for name in ("t", "x", "z", "clean"):
        np.testing.assert_array_equal(first[name], again[name])
    assert first["truth"] == again["truth"]
    assert np.std(first["z"] - other["z"]) > 0.1
    assert len(first["t"]) == 6000
    assert bool(first["aux"]) == (effect == "aux")


def test_the_record_is_the_hysteresis_where_nothing_is_hidden():
    rec = hidden_record("none", 3, **SHORT)
    direct = make_world(3).hysteresis(rec["x"])
    # The chirp's crests lie between samples of the record, so that memory differs by a trifle.
    np.testing.assert_allclose(rec["clean"], direct, rtol=0, atol=3e-3)
    assert rec["truth"]["effect"] is None


@pytest.mark.parametrize("tau", [0.001, 0.004])
def test_runge_kutta_lag_against_lsim(tau):
    step = 1e-4
    t = np.arange(0, 5000) * step
    wave = lambda t: 30.0 + 20.0 * np.sin(2 * np.pi * 7.0 * t) + 40.0 * t  # noqa: E731
    got = world.runge_kutta_lag(wave(t[:-1]), wave(t[:-1] + step / 2), wave(t[1:]), tau, step, 3.0)
    fine = np.linspace(0, t[-1], 10 * (len(t) - 1) + 1)
    system = ([[-1 / tau]], [[1 / tau]], [[1.0]], [[0.0]])
    _, expected, _ = signal.lsim(system, wave(fine), fine, X0=[3.0])
    np.testing.assert_allclose(got, expected[::10], rtol=0, atol=3e-5)
    constant = np.full(len(t) - 1, 5.0)
    got = world.runge_kutta_lag(constant, constant, constant, tau, step, 0.0)
    np.testing.assert_allclose(got, 5.0 * -np.expm1(-t / tau), rtol=0, atol=1e-5)


def test_resonance_against_lsim():
    h = np.random.default_rng(5).normal(size=4000).cumsum()
    t, w, zeta = np.arange(4000) * 1e-4, 2 * np.pi * 200.0, 0.03
    _, expected, _ = signal.lsim(([w * w], [1.0, 2 * zeta * w, w * w]), h - h[0], t)
    got = world._mode(h, 200.0, zeta, 1e-4)
    np.testing.assert_allclose(got, expected + h[0], rtol=0, atol=1e-6)


def test_feedback_agrees_with_itself_and_breaks_congruency():
    rec = hidden_record("moving", 2, **SHORT)
    actuator, a = make_world(2), rec["truth"]["a_V_per_um"]
    again = actuator.hysteresis(rec["x"] + a * rec["clean"])
    # The chirp's crests lie between samples of the record.
    np.testing.assert_allclose(again, rec["clean"], rtol=0, atol=5e-3)
    u = path(0.0, TOP, 25.0, 50.0, 25.0, 0.0, 25.0, 50.0, 25.0)
    fed = world._fed_back(actuator, u, a)
    heights = [np.ptp(fed[600:801]), np.ptp(fed[-400:-199])]
    assert abs(heights[0] - heights[1]) > 0.05


def test_size_scales_the_effect():
    bare, small, large = (
        hidden_record(effect, 4, size=size, **SHORT)["clean"]
        for effect, size in ((None, 1.0), ("drift", 0.5), ("drift", 2.0))
    )
    np.testing.assert_allclose(large - bare, 4.0 * (small - bare), rtol=1e-9, atol=1e-9)

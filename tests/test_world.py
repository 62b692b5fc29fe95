"""The simulated actuator of the tests obeys Preisach's laws and hides what it says."""

import ast
import inspect
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import world
from scipy import signal
from world import TOP, hidden_record, make_world

SHORT: dict[str, Any] = {"duration_s": 6.0, "rate_hz": 1000.0}


def path(*levels, points=200):
    """A path through levels, each ramp in `points` steps."""
    ramps = [np.linspace(a, b, points + 1)[1:] for a, b in pairwise(levels)]
    return np.concatenate([[levels[0]], *ramps])


@pytest.fixture(scope="module")
def actuator():
    return make_world(5)


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


@pytest.mark.parametrize("effect", [None, "creep", "aux", "stick_slip"])
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
    small, large = (hidden_record("drift", 3, size=size, **SHORT)["clean"] for size in (0.5, 2.0))
    np.testing.assert_allclose(large - rec["clean"], 4 * (small - rec["clean"]), atol=1e-9)


def test_runge_kutta_lag_against_lsim():
    step, tau = 1e-4, 0.004
    t = np.arange(0, 5000) * step
    wave = lambda t: 30.0 + 20.0 * np.sin(2 * np.pi * 7.0 * t) + 40.0 * t  # noqa: E731
    got = world.runge_kutta_lag(wave(t[:-1]), wave(t[:-1] + step / 2), wave(t[1:]), tau, step, 3.0)
    fine = np.linspace(0, t[-1], 10 * (len(t) - 1) + 1)
    system = ([[-1 / tau]], [[1 / tau]], [[1.0]], [[0.0]])
    _, expected, _ = signal.lsim(system, wave(fine), fine, X0=[3.0])
    np.testing.assert_allclose(got, expected[::10], rtol=0, atol=3e-5)

"""The simulated actuator of the tests obeys Preisach's laws and hides what it says."""

import ast
from pathlib import Path
from typing import Any

import blind
import numpy as np
import pytest
import world
from blind import hidden
from blind.stage import Plays, Stage
from blind.world import EFFECTS, KNOWN_AS
from scipy.integrate import solve_ivp
from world import TOP, hidden_record, make_world

import preisach_jax as pj

SHORT: dict[str, Any] = {"duration_s": 6.0, "rate_hz": 1000.0}


def test_neither_world_shares_code_with_the_package():
    files = [Path(world.__file__), *Path(blind.__file__).parent.glob("[ehsw]*.py")]
    assert {"hidden.py", "stage.py", "excitation.py"} <= {file.name for file in files}
    for file in files:
        nodes = list(ast.walk(ast.parse(file.read_text(encoding="utf-8"))))
        names = [
            alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names
        ]
        names += [str(node.module) for node in nodes if isinstance(node, ast.ImportFrom)]
        assert not [name for name in names if "preisach" in name or "jax" in name], file


def test_path_agrees_with_a_sum_of_relays():
    """Brute force: a grid of relays, each with the density's integral over its cell."""
    actuator = make_world(5)
    levels = 150
    edges = np.linspace(0.0, TOP, levels + 1)
    rng = np.random.default_rng(3)
    turns = np.append(0.0, edges[rng.integers(0, levels + 1, 60)])
    u = np.interp(np.arange(60 * 40 + 1) / 40, np.arange(61), turns)
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


def test_the_record_is_the_hysteresis_where_nothing_is_hidden():
    rec = hidden_record(None, 3, **SHORT)
    direct = make_world(3).hysteresis(rec["x"])
    # The multisine's crests lie between samples of the record: memory differs by a trifle.
    np.testing.assert_allclose(rec["clean"], direct, rtol=0, atol=3e-3)
    assert rec["truth"] == {}
    small, large = (hidden_record("drift", 3, size=size, **SHORT)["clean"] for size in (0.5, 2.0))
    np.testing.assert_allclose(large - rec["clean"], 4 * (small - rec["clean"]), atol=1e-9)


def test_eddy_currents_of_a_straight_stage_are_a_lag():
    """h = s v and v = u - k dh/dt make a lag of k s, here against SciPy's integration."""
    step, slope, k = 1e-4, 20.0, 1e-4
    t = np.arange(3000) * step
    x = 0.5 + 0.4 * np.sin(2 * np.pi * 8 * t)
    without_memory = Plays(*np.array([[0.1], [0.0], [0.0], [1.0], [0.0], [0.0]]))
    stage = Stage(without_memory, np.zeros(1), slope, 0)
    found = stage.response_behind_currents(x, k / step)
    exact = solve_ivp(
        lambda at, h: (np.interp(at, t, x) - h / slope) / k, (0, t[-1]), [slope * x[0]],
        t_eval=t, rtol=1e-9, max_step=step,
    ).y[0]  # fmt: skip
    assert np.abs(found - exact).max() < 0.02 * np.ptp(exact)
    assert np.abs(slope * x - exact).max() > 0.04 * np.ptp(exact)


def test_a_mass_on_a_spring_that_does_not_yield_is_a_resonance():
    step, x = 1e-4, np.repeat([0.2, 0.8], [100, 4000])
    truth = {"f_hz": 20.0, "zeta": 0.1, "share": 0.0, "yields": 0.1}
    found = hidden.restoring_force(x, truth, 50.0, step)
    w, t = 2 * np.pi * 20.0, np.arange(4000) * step
    damped = w * np.sqrt(1 - 0.1**2)
    rung = np.exp(-0.1 * w * t) * (np.cos(damped * t) + 0.1 * w / damped * np.sin(damped * t))
    np.testing.assert_allclose(found[100:], 50 * (0.8 - 0.6 * rung), atol=0.7)
    yielding = hidden.restoring_force(x, truth | {"share": 0.5}, 50.0, step)
    assert np.abs(yielding - found).max() > 5.0


def test_operator_creep_starts_beyond_a_threshold():
    truth = {"gain": 1.0, "lowest": 0.1, "slowest_s": 1.0}
    small, large = (
        hidden.operator_creep(np.repeat([0.0, height], [10, 5000]), truth, 1.0, 1e-3)
        for height in (0.09, 1.0)
    )
    assert np.ptp(small) == 0
    # Each of 6 dashpots reaches what its threshold leaves of the step.
    assert large[-1] == pytest.approx(6 * np.mean(1 - np.geomspace(0.1, 0.8, 8)), rel=0.01)


def test_every_effect_of_the_library_is_hidden_in_the_blind_benchmark():
    names = {kind.partition(":")[0] for kind in pj.effects()}
    assert {KNOWN_AS.get(name, name).partition(":")[0] for name in EFFECTS} == names

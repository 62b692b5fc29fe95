"""The simulated actuator of the tests obeys Preisach's laws and hides what it says."""

import ast
from itertools import pairwise
from pathlib import Path
from typing import Any

import blind
import numpy as np
import pytest
import world
from world import TOP, hidden_record, make_world

SHORT: dict[str, Any] = {"duration_s": 6.0, "rate_hz": 1000.0}


def path(*levels, points=200):
    """A path through levels, each ramp in `points` steps."""
    ramps = [np.linspace(a, b, points + 1)[1:] for a, b in pairwise(levels)]
    return np.concatenate([[levels[0]], *ramps])


@pytest.fixture(scope="module")
def actuator():
    return make_world(5)


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


def test_the_record_is_the_hysteresis_where_nothing_is_hidden():
    rec = hidden_record("none", 3, **SHORT)
    direct = make_world(3).hysteresis(rec["x"])
    # The chirp's crests lie between samples of the record, so that memory differs by a trifle.
    np.testing.assert_allclose(rec["clean"], direct, rtol=0, atol=3e-3)
    assert rec["truth"]["effect"] is None
    small, large = (hidden_record("drift", 3, size=size, **SHORT)["clean"] for size in (0.5, 2.0))
    np.testing.assert_allclose(large - rec["clean"], 4 * (small - rec["clean"]), atol=1e-9)

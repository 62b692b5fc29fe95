"""The recursion of ramps line by line against the scan of all ramps."""

import jax
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from preisach_jax.filter.adaptive import LEVELS_FOR_MOVES, AdaptiveFilter
from preisach_jax.operator.moves import ramp_moves
from preisach_jax.operator.plane import Plane

SAMPLES = 150
PLANE = Plane(levels=6, low=-2.0, high=4.0)


def paths(seed):
    """Inputs that jump over cells, that turn and rest on their edges, that creep and that rest."""
    rng = np.random.default_rng(seed)
    edges = np.round(rng.uniform(-2, 4, SAMPLES))
    walk = np.abs(np.mod(3 + np.cumsum(rng.normal(0, 0.2, SAMPLES)), 12) - 6) - 2
    return {
        "jumps": rng.uniform(-2, 4, SAMPLES),
        "edges": edges,
        "rests": np.repeat(edges[: SAMPLES // 5] + 0.3 * (rng.random(SAMPLES // 5) < 0.3), 5),
        "walk": walk,
        "small": 1.0 + 0.9 * np.sin(np.arange(SAMPLES)),
        "mixed": np.where(rng.random(SAMPLES) < 0.1, edges, walk),
    }


@pytest.mark.parametrize("kind", sorted(paths(0)))
@pytest.mark.parametrize("step_size", [1.0, 0.3])
@pytest.mark.parametrize("passes", [1, 3])
def test_a_run_over_moves_is_the_scan_of_steps(kind, step_size, passes, precision, tolerance):
    x = np.clip(paths(6)[kind], -2, 4).astype(precision)
    rng = np.random.default_rng(7)
    z = (np.sin(x) + x + rng.normal(0, 0.1, SAMPLES)).astype(precision)
    start = rng.uniform(0, 1, PLANE.cells).astype(precision)
    filt = AdaptiveFilter(PLANE, "ramp", initial_weight=start, step_size=step_size)
    dense = filt.run(x, z, passes=passes, form="dense")
    event = filt.run(x, z, passes=passes, form="event")
    for one, other in zip(jax.tree.leaves(event), jax.tree.leaves(dense), strict=True):
        assert one.dtype == other.dtype
        np.testing.assert_allclose(one, other, rtol=0, atol=400 * tolerance)
    assert np.count_nonzero(event.switched) > 10
    # A run goes on from the state of either.
    more = [filt.run(x[:40], z[:40], each.state) for each in (dense, event)]
    np.testing.assert_allclose(more[1].output, more[0].output, rtol=0, atol=400 * tolerance)


@given(st.lists(st.floats(-2, 4), min_size=1, max_size=30))
def test_moves_lead_from_sample_to_sample_through_neighbouring_cells(turns):
    x = np.asarray(turns)
    moves = ramp_moves(PLANE, x)
    line, rising, part = (np.asarray(each) for each in (moves.line, moves.rising, moves.part))
    ends = np.asarray(moves.ends)
    assert len(ends) == len(x)
    assert ends[-1] < len(line)
    assert np.all(part[ends[-1] + 1 :] == 1)
    assert not np.any(rising[ends[-1] + 1 :])
    assert np.all((line >= 0) & (line < PLANE.levels))
    assert np.all((part >= 0) & (part <= 1))
    position = (x - PLANE.low) / PLANE.delta_x
    for k in range(1, len(x)):
        own = slice(ends[k - 1] + 1, ends[k] + 1)
        if position[k] == position[k - 1]:
            continue
        assert np.all(rising[own] == (position[k] > position[k - 1]))
        assert np.all(np.diff(line[own]) == (1 if position[k] > position[k - 1] else -1))
        assert line[own][-1] + part[own][-1] == pytest.approx(position[k], abs=1e-5)
        first = line[own][0]
        assert first - 1e-5 <= position[k - 1] <= first + 1 + 1e-5


def test_the_form_of_ramps_is_chosen_by_the_levels():
    x = np.clip(paths(1)["walk"], -2, 4)
    for levels, same in ((LEVELS_FOR_MOVES, "event"), (LEVELS_FOR_MOVES - 1, "dense")):
        filt = AdaptiveFilter(Plane(levels, -2.0, 4.0), "ramp")
        chosen, expected = filt.run(x, x**2), filt.run(x, x**2, form=same)
        np.testing.assert_array_equal(chosen.weights, expected.weights)

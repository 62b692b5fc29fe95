"""Switching events and moves of ramps against all hysterons, and the recursions over them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles import PLANE, SAMPLES

from preisach_jax.errors import InputError
from preisach_jax.filter.adaptive import AdaptiveFilter
from preisach_jax.operator.checks import HYSTERONS
from preisach_jax.operator.events import (
    EVENTS_TO_REFRESH,
    events_and_states,
    relays_between,
    room_for_events,
    switching_events,
)
from preisach_jax.operator.moves import ramp_moves
from preisach_jax.operator.simulation import simulate
from preisach_jax.operator.states import hysteron_states

LEVELS = PLANE.levels


def paths(seed):
    """Inputs that jump, that rest on thresholds and edges of cells, that creep, and all of it."""
    rng = np.random.default_rng(seed)
    lattice = np.round(rng.uniform(-2, 8, SAMPLES))
    walk = np.abs(np.mod(3 + np.cumsum(rng.normal(0, 0.3, SAMPLES)), 20) - 10) - 2
    return {
        "jumps": rng.uniform(-2, 8, SAMPLES),
        "lattice": lattice,
        "rests": np.repeat(lattice[: SAMPLES // 4], 4),
        "small": 2.0 + 1.8 * np.sin(np.arange(SAMPLES)),
        "walk": walk,
        "mixed": np.where(rng.random(SAMPLES) < 0.1, lattice, walk),
    }


relays = jax.jit(lambda plane, x: hysteron_states(plane, x, "low", "relay"))


@jax.jit
def listed(plane, found):
    return found.sample, found.sign, found.area, found.cells(plane)


def check_events(plane, x, found):
    """The events switch what the relays' states say, no more, no less, and in order."""
    states = np.asarray(relays(plane, x)).astype(int)
    moves = np.diff(states, axis=0, prepend=states[:1])
    at = np.flatnonzero(moves.any(axis=1))
    sample, sign, area, cells = map(np.asarray, listed(plane, found))
    real = area > 0
    np.testing.assert_array_equal(sample[real], at)
    assert np.all(sample[~real] == len(x))
    rows = zip(at, cells[real], sign[real], area[real], strict=True)
    for k, row, direction, count in rows:
        switched = row[row < plane.cells]
        assert len(switched) == len(set(switched.tolist())) == count
        np.testing.assert_array_equal(np.sort(switched), np.flatnonzero(moves[k]))
        assert np.all(moves[k][switched] == direction)
    assert np.all(cells[~real] == plane.cells)


def test_events_switch_what_the_relays_switch_and_there_is_room_for_all(precision):
    for x in paths(1).values():
        x = x.astype(precision)
        found = switching_events(PLANE, x, SAMPLES, LEVELS)
        check_events(PLANE, x, found)
        events, width = room_for_events(PLANE, x)
        area, crossed = np.asarray(found.area), np.asarray(found.last > found.first).sum(axis=1)
        assert np.sum(area > 0) <= events <= SAMPLES
        assert crossed.max() <= width <= crossed.max() + 1
        # The state at the end is that of the relays.
        expected = relays(PLANE, x)[-1]
        np.testing.assert_array_equal(events_and_states(PLANE, jnp.asarray(x))[1], expected)


@settings(max_examples=10)
@given(st.lists(st.integers(0, 20), min_size=60, max_size=60))
def test_events_switch_what_the_relays_switch_on_any_path(halves):
    x = np.array(halves) / 2 - 2
    check_events(PLANE, x, switching_events(PLANE, x, 60, LEVELS))


def test_a_resting_input_has_no_event():
    found = switching_events(PLANE, np.full(10, 2.5))
    assert found.area.tolist() == [0]
    assert found.sample.tolist() == [10]
    result = AdaptiveFilter(PLANE).run(np.full(9, 2.2), np.arange(9.0), form="event")
    np.testing.assert_array_equal(result.error, np.arange(9.0))
    assert not np.any(result.switched)


# --- the forms of the filter ---


@pytest.mark.parametrize("hysteron", HYSTERONS)
def test_a_run_over_events_is_the_scan_of_steps(hysteron, precision, tolerance):
    rng = np.random.default_rng(7)
    start = rng.uniform(0, 1, PLANE.cells).astype(precision)
    filt = AdaptiveFilter(PLANE, hysteron, initial_weight=start, step_size=0.3)
    for kind in ("rests", "small", "mixed"):
        x = paths(6)[kind].astype(precision)
        z = (np.sin(x) + x + rng.normal(0, 0.1, SAMPLES)).astype(precision)
        dense, event = (filt.run(x, z, passes=3, form=form) for form in ("dense", "event"))
        for one, other in zip(jax.tree.leaves(event), jax.tree.leaves(dense), strict=True):
            assert one.dtype == other.dtype
            np.testing.assert_allclose(one, other, rtol=0, atol=400 * tolerance, err_msg=kind)
        assert np.count_nonzero(event.switched) > 10
    # A run goes on from the state of either.
    more = [filt.run(x[:40], z[:40], each.state) for each in (dense, event)]
    np.testing.assert_allclose(more[1].output, more[0].output, rtol=0, atol=400 * tolerance)


@settings(max_examples=20)
@given(st.lists(st.floats(-2, 8), min_size=30, max_size=30))
def test_moves_of_ramps_lead_from_sample_to_sample_through_neighbouring_cells(turns):
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


def test_sums_of_many_events_begin_afresh_from_the_relays_that_are_on(x64):
    rng = np.random.default_rng(8)
    x = rng.uniform(-2.0, 8.0, 3000)  # each sample is an event, or nearly
    z = x + np.sin(3 * x) + rng.normal(0, 0.1, len(x))
    found = events_and_states(PLANE, jnp.asarray(x))[0]
    assert np.count_nonzero(found.area) > 2 * EVENTS_TO_REFRESH
    first, lowest = relays_between(PLANE, jnp.asarray(x), found)
    assert len(first) >= 2
    states = np.asarray(relays(PLANE, x)).astype(bool)
    for event, row in zip(first, lowest, strict=True):
        before = states[int(found.sample[event]) - 1]
        np.testing.assert_array_equal(PLANE.beta_index < row[PLANE.alpha_index], before)
    filt = AdaptiveFilter(PLANE, initial_weight=rng.uniform(0, 1, PLANE.cells))
    event, dense = (filt.run(x, z, form=form) for form in ("event", "dense"))
    np.testing.assert_allclose(event.output, dense.output, rtol=0, atol=1e-8)
    np.testing.assert_allclose(event.weights, dense.weights, rtol=0, atol=1e-8)


def test_where_there_is_no_event_form_it_says_why():
    x = paths(0)["walk"]
    missing = np.where(np.arange(SAMPLES) == 7, np.nan, x)
    weights = np.ones(PLANE.cells)
    plain = AdaptiveFilter(PLANE)
    start = plain.init(x[0], 0.0)
    cases = [
        (lambda form: simulate(PLANE, weights, x, "relay", weights, form), "states of one's own"),
        (lambda form: plain.run(x, missing, form=form), "outputs are missing"),
        (lambda form: plain.run(x, x, start, form=form), "from a state"),
        (lambda form: AdaptiveFilter(PLANE, leakage=0.1).run(x, x, form=form), "with leakage"),
        (
            lambda form: AdaptiveFilter(PLANE, sampling="sample").run(x, x, form=form),
            "sampling='sample'",
        ),
        (lambda form: jax.jit(lambda x: plain.run(x, x, form=form).weights)(x), "without values"),
    ]
    for call, reason in cases:
        call("auto")
        with pytest.raises(InputError, match="there is no event form") as raised:
            call("event")
        assert reason in str(raised.value)
    with pytest.raises(InputError, match="form is 'fast'"):
        simulate(PLANE, weights, x, form="fast")


def test_inputs_of_one_length_share_what_is_compiled(compilations):
    filt, rng = AdaptiveFilter(PLANE), np.random.default_rng(0)
    x = np.abs(np.mod(np.cumsum(rng.normal(0, 0.2, 801)), 20) - 10) - 2  # a length of its own

    def everything(x):
        simulate(PLANE, np.ones(PLANE.cells), x, "relay")
        filt.run(x, x)

    assert compilations(lambda: everything(x))
    assert not compilations(lambda: everything(6 - x))

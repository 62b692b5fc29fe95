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


def of_relays(rng, gaps=0.0, rows=SAMPLES):
    """A record of relays with noise, and with outputs missing."""
    x = np.clip(3 + np.cumsum(rng.normal(0, 0.8, rows)), PLANE.low, PLANE.high)
    z = np.asarray(simulate(PLANE, rng.uniform(0, 1, PLANE.cells), x, "relay"))
    return x, np.where(rng.random(rows) < gaps, np.nan, z + rng.normal(0, 0.1, rows))


@pytest.mark.parametrize(
    "options", [{}, {"dead_zone": 0.2}, {"error_limit": 0.3, "nonnegative": True}]
)
@pytest.mark.parametrize("sampling", ["event", "sample"])
@pytest.mark.parametrize("gaps", [0.0, 0.3, 1.0])
def test_a_run_over_passages_is_the_scan_of_steps(x64, options, sampling, gaps):
    x, z = of_relays(np.random.default_rng(11), gaps)
    filt = AdaptiveFilter(PLANE, sampling=sampling, step_size=0.7, **options)
    begun = filt.run(x[:50], z[:50], form="dense").state
    for rows, state, passes in ((slice(0, None), None, 2), (slice(50, None), begun, 1)):
        dense, event = (
            filt.run(x[rows], z[rows], state, passes, form) for form in ("dense", "event")
        )
        for one, other in zip(jax.tree.leaves(event), jax.tree.leaves(dense), strict=True):
            np.testing.assert_allclose(one, other, rtol=0, atol=1e-11)


def test_a_run_is_the_same_under_jit_and_vmap_over_whatever(x64):
    rng = np.random.default_rng(12)
    x, z = of_relays(rng)
    zs = np.stack([z, of_relays(rng, 0.3)[1], z + rng.normal(0, 0.1, len(z))])
    xs, steps = np.clip(x + rng.normal(0, 0.5, (3, 1)), -2, 8), np.array([0.5, 1.0, 1.5])

    def run(x, z, step=1.0, start=0.0):
        return AdaptiveFilter(PLANE, step_size=step, initial_weight=start).run(x, z)[:4]

    starts = rng.uniform(0, 1, (3, PLANE.cells))
    cases = [
        (lambda z: run(x, z), (zs,)),
        (run, (xs, zs)),
        (lambda step, start: run(x, z, step, start), (steps, starts)),
    ]
    for one, lanes in cases:
        several = jax.jit(jax.vmap(one))(*lanes)
        each = [one(*lane) for lane in zip(*lanes, strict=True)]
        for found, expected in zip(several, zip(*each, strict=True), strict=True):
            np.testing.assert_allclose(found, np.stack(expected), rtol=0, atol=1e-12)


@pytest.mark.parametrize("gaps", [0.0, 0.3])
def test_gradients_of_a_run_are_those_of_differences(x64, gaps):
    x, z = of_relays(np.random.default_rng(13), gaps)

    def loss(z, start, step):
        filt = AdaptiveFilter(PLANE, initial_weight=start, step_size=step)
        return jnp.sum(filt.run(x, z).weights ** 2)

    point = (jnp.asarray(z), jnp.full(PLANE.cells, 0.3), jnp.asarray(0.8))
    found = jax.grad(loss, (0, 1, 2))(*point)
    for place, slope in enumerate(found):
        change = 1e-5 * np.random.default_rng(place).normal(size=slope.shape)
        ends = [
            float(loss(*(at + side * change if k == place else at for k, at in enumerate(point))))
            for side in (1, -1)
        ]
        assert float(jnp.sum(slope * change)) == pytest.approx((ends[0] - ends[1]) / 2, rel=1e-4)


def test_what_there_is_no_room_for_is_not_a_number(x64):
    x, z = of_relays(np.random.default_rng(14))
    filt = AdaptiveFilter(PLANE)
    whole, few = filt.run(x, z), jax.jit(lambda x, z: filt.run(x, z, room=20))(x, z)
    known = np.isfinite(few.output)
    first = int(np.argmin(known))
    assert 0 < first < len(x)
    assert not known[first:].any()
    np.testing.assert_allclose(few.output[:first], whole.output[:first], rtol=0, atol=1e-12)
    assert np.isnan(few.weights).all()


def test_where_there_is_no_event_form_it_says_why():
    x = paths(0)["walk"]
    missing = np.where(np.arange(SAMPLES) == 7, np.nan, x)
    weights = np.ones(PLANE.cells)
    ramps = AdaptiveFilter(PLANE, "ramp")
    cases = [
        (lambda form: simulate(PLANE, weights, x, "relay", weights, form), "states of one's own"),
        (lambda form: ramps.run(x, missing, form=form), "outputs are missing"),
        (lambda form: ramps.run(x, x, ramps.init(x[0], 0.0), form=form), "from a state"),
        (lambda form: AdaptiveFilter(PLANE, leakage=0.1).run(x, x, form=form), "with leakage"),
        (lambda form: jax.jit(lambda x: ramps.run(x, x, form=form).weights)(x), "without values"),
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

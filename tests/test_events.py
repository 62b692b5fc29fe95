"""Switching events against the relays themselves, and the recursion over them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from preisach_jax.errors import InputError
from preisach_jax.filter.adaptive import AdaptiveFilter
from preisach_jax.operator.cells import flat_index
from preisach_jax.operator.events import (
    EVENTS_TO_REFRESH,
    events_and_states,
    relays_between,
    room_for_events,
    switching_events,
)
from preisach_jax.operator.learning import adapt_over_events
from preisach_jax.operator.plane import Plane
from preisach_jax.operator.simulation import simulate
from preisach_jax.operator.states import hysteron_states

SAMPLES = 120
PLANE = Plane(levels=6, low=0.0, high=6.0)


def paths(seed):
    """Inputs that jump, that rest exactly on thresholds, that creep, and that do all of it."""
    rng = np.random.default_rng(seed)
    lattice = np.round(rng.uniform(0, 6, SAMPLES) * 2) / 2
    walk = np.abs(np.mod(3 + np.cumsum(rng.normal(0, 0.2, SAMPLES)), 12) - 6)
    return {
        "jumps": rng.uniform(0, 6, SAMPLES),
        "lattice": lattice,
        "rests": np.repeat(lattice[: SAMPLES // 4], 4),
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


@pytest.mark.parametrize("kind", paths(0))
@pytest.mark.parametrize("levels", [2, 6])
def test_events_switch_what_the_relays_switch(kind, levels, precision):
    plane = Plane(levels=levels, low=0.0, high=6.0)
    for seed in range(3):
        x = paths(seed)[kind].astype(precision)
        check_events(plane, x, switching_events(plane, x, SAMPLES, levels))


def test_events_take_the_room_that_they_need():
    x = paths(0)["mixed"]
    found = switching_events(PLANE, x)
    check_events(PLANE, x, found)
    assert np.all(np.asarray(found.area) > 0)


@given(st.lists(st.integers(0, 24), min_size=SAMPLES, max_size=SAMPLES))
def test_events_switch_what_the_relays_switch_on_any_path(quarters):
    x = np.array(quarters) / 4
    check_events(PLANE, x, switching_events(PLANE, x, SAMPLES, 6))


def test_a_resting_input_has_no_event():
    found = switching_events(PLANE, np.full(10, 2.5))
    assert found.area.tolist() == [0]
    assert found.sample.tolist() == [10]


@pytest.mark.parametrize("kind", paths(0))
def test_there_is_room_for_all_events(kind):
    x = paths(1)[kind]
    events, width = room_for_events(PLANE, x)
    found = switching_events(PLANE, x, SAMPLES, 6)
    area, crossed = np.asarray(found.area), np.asarray(found.last > found.first).sum(axis=1)
    assert np.sum(area > 0) <= events < SAMPLES
    assert crossed.max() <= width <= 6
    assert width <= crossed.max() + 1


def test_the_room_for_a_slow_input_is_hardly_more_than_it_needs():
    x = 3 + 2.9 * np.cos(np.linspace(0, 20, 4000))
    events = int(np.count_nonzero(switching_events(PLANE, x).area))
    assert events > 30
    assert events <= room_for_events(PLANE, x)[0] <= events + 2 * 7  # seven turning points


def test_the_room_is_what_the_busiest_input_needs():
    x = np.stack([paths(1)["walk"], paths(1)["jumps"]])
    rooms = [room_for_events(PLANE, row) for row in x]
    assert room_for_events(PLANE, x) == tuple(max(both) for both in zip(*rooms, strict=True))


def test_flat_index_is_the_planes_order():
    np.testing.assert_array_equal(
        flat_index(PLANE.alpha_index, PLANE.beta_index), np.arange(PLANE.cells)
    )


@pytest.mark.parametrize("kind", ["walk", "mixed"])
def test_the_recursion_over_events_is_the_filter(kind, precision, tolerance):
    rng = np.random.default_rng(3)
    x = paths(4)[kind].astype(precision)
    z = np.asarray(x + np.sin(x))[:, None] + rng.normal(0, 0.1, (SAMPLES, 3))
    z = z.astype(precision)
    start = rng.uniform(0, 1, (PLANE.cells, 3)).astype(precision)
    # Room for more than there is: fillings change nothing.
    found = switching_events(PLANE, x, SAMPLES, 6)
    values = jnp.concatenate([z[:1], jnp.asarray(z).at[found.sample].get(mode="clip")])
    weights, errors = adapt_over_events(PLANE, found, jnp.diff(values, axis=0), start)
    assert weights.dtype == errors.dtype == precision
    real = np.asarray(found.area) > 0
    assert not np.any(np.asarray(errors)[~real])
    for lane in range(3):
        run = AdaptiveFilter(PLANE, initial_weight=start[:, lane]).run(x, z[:, lane])
        np.testing.assert_allclose(weights[:, lane], run.weights, atol=4 * tolerance)
        at = np.asarray(found.sample)[real]
        np.testing.assert_allclose(
            np.asarray(errors)[real, lane], np.asarray(run.error)[at], atol=4 * tolerance
        )


def test_the_recursion_over_events_can_be_batched_over_inputs(x64):
    x = np.stack([paths(seed)["mixed"] for seed in range(3)])
    z = np.cos(x)[..., None]
    start = np.zeros((PLANE.cells, 1))

    def identify(x, z):
        found = switching_events(PLANE, x, SAMPLES, 6)
        values = jnp.concatenate([z[:1], z.at[found.sample].get(mode="clip")])
        return adapt_over_events(PLANE, found, jnp.diff(values, axis=0), start)[0]

    batch = jax.vmap(identify)(x, jnp.asarray(z))
    for row, one_x, one_z in zip(batch, x, z, strict=True):
        np.testing.assert_allclose(row, identify(one_x, jnp.asarray(one_z)), atol=1e-13)


def test_gradient_through_the_recursion_matches_finite_differences(x64):
    x = paths(5)["walk"]
    found = switching_events(PLANE, x, SAMPLES, 6)
    rises = np.random.default_rng(6).normal(size=(SAMPLES, 1))

    @jax.jit
    def loss(start, rises):
        weights, errors = adapt_over_events(PLANE, found, rises, start)
        return jnp.sum(weights**2) + jnp.sum(errors**2)

    start = np.random.default_rng(7).normal(size=(PLANE.cells, 1))
    by_start, by_rises = jax.jit(jax.grad(loss, (0, 1)))(start, rises)
    # Quadratic in both, so that central differences are exact.
    for array, gradient, cells in ((0, by_start, range(0, 21, 4)), (1, by_rises, range(0, 60, 13))):
        for cell in cells:
            move = np.zeros_like((start, rises)[array])
            move[cell] = 0.1
            above = [start, rises]
            below = [start, rises]
            above[array], below[array] = above[array] + move, below[array] - move
            numeric = float(loss(*above) - loss(*below)) / 0.2
            assert float(gradient[cell, 0]) == pytest.approx(numeric, rel=1e-9, abs=1e-9)


# --- the forms of the filter ---


@pytest.mark.parametrize(
    ("kind", "step_size", "passes"),
    [
        *((kind, step_size, 3) for kind in sorted(paths(0)) for step_size in (1.0, 0.3)),
        ("mixed", 1.0, 1),  # of each number of passes the last one is compiled in the same way
    ],
)
def test_a_run_over_events_is_the_scan_of_steps(kind, step_size, passes, precision, tolerance):
    x = paths(6)[kind].astype(precision)
    rng = np.random.default_rng(7)
    z = (np.sin(x) + x + rng.normal(0, 0.1, SAMPLES)).astype(precision)
    start = rng.uniform(0, 1, PLANE.cells).astype(precision)
    filt = AdaptiveFilter(PLANE, initial_weight=start, step_size=step_size)
    dense = filt.run(x, z, passes=passes, form="dense")
    event = filt.run(x, z, passes=passes, form="event")
    for one, other in zip(jax.tree.leaves(event), jax.tree.leaves(dense), strict=True):
        assert one.dtype == other.dtype
        np.testing.assert_allclose(one, other, rtol=0, atol=200 * tolerance)
    assert np.count_nonzero(event.switched) > 10
    automatic = filt.run(x, z, passes=passes)
    np.testing.assert_array_equal(automatic.weights, event.weights)
    # A run goes on from the state of either.
    more = [filt.run(x[:40], z[:40], each.state) for each in (dense, event)]
    np.testing.assert_allclose(more[1].output, more[0].output, rtol=0, atol=200 * tolerance)


def test_a_run_over_a_resting_input_learns_nothing():
    result = AdaptiveFilter(PLANE).run(np.full(9, 2.2), np.arange(9.0), form="event")
    np.testing.assert_array_equal(result.error, np.arange(9.0))
    assert not np.any(result.switched)


@pytest.mark.parametrize(("levels", "count"), [(60, 400), (4, 2500)])
def test_outputs_of_many_events_are_those_of_the_scan(levels, count, x64):
    """Beyond `EVENTS_TO_REFRESH` they begin afresh, from the relays that are on there."""
    rng = np.random.default_rng(8)
    plane = Plane(levels=levels, low=0.0, high=6.0)
    turns = rng.uniform(0.0, 6.0, count)
    x = np.interp(np.arange(10 * count) / 10, np.arange(count), turns)
    z = x + np.sin(3 * x) + rng.normal(0, 0.1, len(x))
    start = rng.uniform(0, 1, plane.cells)
    filt = AdaptiveFilter(plane, initial_weight=start)
    found = events_and_states(plane, jnp.asarray(x))[0]
    assert np.count_nonzero(found.area) > 3 * EVENTS_TO_REFRESH
    event, dense = (filt.run(x, z, form=form) for form in ("event", "dense"))
    np.testing.assert_allclose(event.output, dense.output, rtol=0, atol=1e-8)
    np.testing.assert_allclose(event.weights, dense.weights, rtol=0, atol=1e-8)


@pytest.mark.parametrize("levels", [3, 6, 25])
def test_sums_begin_afresh_from_the_relays_that_are_on(levels, x64):
    rng = np.random.default_rng(levels)
    plane = Plane(levels=levels, low=0.0, high=6.0)
    x = rng.uniform(0.0, 6.0, 4000)  # each sample is an event, or nearly
    found = events_and_states(plane, jnp.asarray(x))[0]
    first, lowest = relays_between(plane, jnp.asarray(x), found)
    assert len(first) >= 2
    states = np.asarray(relays(plane, x)).astype(bool)
    for event, row in zip(first, lowest, strict=True):
        sample = int(found.sample[event])
        before = states[sample - 1]
        np.testing.assert_array_equal(plane.beta_index < row[plane.alpha_index], before)


@pytest.mark.parametrize("seed", range(3))
def test_the_last_states_are_those_of_the_relays(seed, x64):
    for x in paths(seed).values():
        expected = relays(PLANE, x)[-1]
        np.testing.assert_array_equal(events_and_states(PLANE, jnp.asarray(x))[1], expected)


def test_where_there_is_no_event_form_it_says_why():
    x = paths(0)["walk"]
    missing = np.where(np.arange(SAMPLES) == 7, np.nan, x)
    weights = np.ones(PLANE.cells)
    start = AdaptiveFilter(PLANE).init(x[0], 0.0)
    cases = [
        (lambda form: simulate(PLANE, weights, x, "relay", weights, form), "states of one's own"),
        (lambda form: AdaptiveFilter(PLANE).run(x, missing, form=form), "outputs are missing"),
        (lambda form: AdaptiveFilter(PLANE).run(x, x, start, form=form), "from a state"),
        (
            lambda form: AdaptiveFilter(PLANE, sampling="sample").run(x, x, form=form),
            "sampling='sample'",
        ),
        (
            lambda form: jax.jit(lambda x: AdaptiveFilter(PLANE).run(x, x, form=form).weights)(x),
            "without values",
        ),
        (
            lambda form: jax.grad(
                lambda start: jnp.sum(
                    AdaptiveFilter(PLANE, "ramp", "event", start).run(x, x, form=form).weights
                )
            )(weights),
            "without values",
        ),
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
    x = np.abs(np.mod(np.cumsum(rng.normal(0, 0.2, 801)), 12) - 6)  # a length of its own

    def everything(x):
        simulate(PLANE, np.ones(PLANE.cells), x, "relay")
        filt.run(x, x)

    assert compilations(lambda: everything(x))
    assert not compilations(lambda: everything(6 - x))


def test_mistakes_are_named():
    with pytest.raises(ValueError, match=r"\(2, 2\)"):
        switching_events(PLANE, np.zeros((2, 2)))

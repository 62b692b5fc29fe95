"""Switching events and moves of ramps against all hysterons, and the recursions over them."""

from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import PLANE, SAMPLES

from preisach_jax import AdaptiveFilter, InputError, OnlineFilter, Plane, simulate
from preisach_jax.operator.events import switching
from preisach_jax.operator.inputs import HYSTERONS
from preisach_jax.operator.states import hysteron_states

UNEQUAL = Plane(PLANE.levels, PLANE.low, PLANE.high, [-1.5, 0.0, 0.5, 3.0, 7.5])


def paths(seed):
    """Inputs that jump, that rest on thresholds and edges of cells, that creep, and all of it."""
    rng = np.random.default_rng(seed)
    lattice = np.round(rng.uniform(-2, 8, SAMPLES))
    walk = np.abs(np.mod(3 + np.cumsum(rng.normal(0, 0.3, SAMPLES)), 20) - 10) - 2
    return {
        "jumps": rng.uniform(-2, 8, SAMPLES),
        "lattice": lattice,
        "rests": np.repeat(lattice[: SAMPLES // 4], 4),
        "decay": 3.0 + 5.0 * (-0.99) ** np.arange(SAMPLES),
        "small": 2.0 + 1.8 * np.sin(np.arange(SAMPLES)),
        "walk": walk,
        "mixed": np.where(rng.random(SAMPLES) < 0.1, lattice, walk),
    }


relays = jax.jit(lambda plane, x: hysteron_states(plane, x, "low", "relay"))


@pytest.mark.parametrize("plane", [PLANE, UNEQUAL], ids=["equal", "unequal"])
def test_events_switch_what_the_relays_switch(precision, plane):
    """No more, no less, and in order."""
    for x in paths(1).values():
        states = np.asarray(relays(plane, x.astype(precision))).astype(int)
        moves = np.diff(states, axis=0, prepend=states[:1])
        found = switching(plane, x.astype(precision))
        np.testing.assert_array_equal([e.sample for e in found], np.flatnonzero(moves.any(axis=1)))
        for event in found:
            switched = np.flatnonzero(moves[event.sample])
            np.testing.assert_array_equal(np.sort(event.cells), switched)
            assert np.all(moves[event.sample][event.cells] == event.sign)


def test_a_resting_input_has_no_event():
    assert switching(PLANE, np.full(10, 2.5)) == []
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


def of_relays(rng, gaps=0.0, rows=SAMPLES):
    """A record of relays with noise, and with outputs missing."""
    x = np.clip(3 + np.cumsum(rng.normal(0, 0.8, rows)), PLANE.low, PLANE.high)
    z = np.asarray(simulate(PLANE, rng.uniform(0, 1, PLANE.cells), x, "relay"))
    return x, np.where(rng.random(rows) < gaps, np.nan, z + rng.normal(0, 0.1, rows))


@pytest.mark.parametrize(
    ("options", "sampling", "gaps"),
    [
        ({}, "event", 0.3),
        ({}, "sample", 0.3),
        ({}, "event", 1.0),
        ({"dead_zone": 0.2, "error_limit": 0.3, "nonnegative": True}, "event", 0.3),
        ({"leakage": 0.05}, "event", 0.0),
        ({"leakage": 0.05}, "sample", 0.3),
    ],
)
def test_a_run_over_passages_is_the_scan_of_steps(x64, options, sampling, gaps):
    """From a state in the middle of a record, and twice; the run above begins at its start."""
    x, z = of_relays(np.random.default_rng(11), gaps)
    filt = AdaptiveFilter(PLANE, sampling=sampling, step_size=0.7, **options)
    state = AdaptiveFilter(PLANE, step_size=0.7).run(x[:50], z[:50], form="dense").state
    dense, event = (filt.run(x, z, state, 2, form) for form in ("dense", "event"))
    for one, other in zip(jax.tree.leaves(event), jax.tree.leaves(dense), strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-11)


def test_a_run_is_the_same_under_jit_and_vmap_over_whatever(x64):
    rng = np.random.default_rng(12)
    x, z = of_relays(rng)
    zs = np.stack([z, of_relays(rng, 0.3)[1], z + rng.normal(0, 0.1, len(z))])
    xs, steps = np.clip(x + rng.normal(0, 0.5, (3, 1)), -2, 8), np.array([0.5, 1.0, 1.5])
    starts = rng.uniform(0, 1, (3, PLANE.cells))

    def run(x, z, step=1.0, start=0.0):
        return AdaptiveFilter(PLANE, step_size=step, initial_weight=start).run(x, z)[:4]

    def gappy(x, z):
        return AdaptiveFilter(PLANE, initial_weight=0.0).run(x, z, missing=True)[:4]

    known = (lambda z, step, start: run(x, z, step, start), (zs, steps, starts))
    for one, lanes in (known, (gappy, (xs, zs))):
        several = jax.jit(jax.vmap(one))(*lanes)
        each = [one(*lane) for lane in zip(*lanes, strict=True)]
        for found, expected in zip(several, zip(*each, strict=True), strict=True):
            np.testing.assert_allclose(found, np.stack(expected), rtol=0, atol=1e-12)


def test_a_run_has_the_room_that_the_filter_asks_for_and_without_it_says_not_a_number(x64):
    rng = np.random.default_rng(15)
    plane = PLANE.padded(20)  # lines of more cells than a block has
    x, z = of_relays(rng, rows=50)
    xs = np.stack([x, rng.permutation(x)])
    filt = AdaptiveFilter(Plane(20, PLANE.low, PLANE.high))
    room = filt.room(xs)
    batch = jax.jit(jax.vmap(lambda x: filt.run(x, z, room=room, missing=False)))(xs)
    for one, x in zip(batch.weights, xs, strict=True):
        np.testing.assert_allclose(one, filt.run(x, z, form="dense").weights, rtol=0, atol=1e-12)
    for less in (20, room._replace(visits=room.visits // 2)):
        few = jax.jit(lambda x, less=less: filt.run(x, z, room=less, missing=False))(xs[1])
        assert np.isnan(few.weights).all()
        known = np.isfinite(few.output)
        first = int(np.argmin(known))
        assert not known[first:].any()
        np.testing.assert_allclose(few.output[:first], batch.output[1][:first], rtol=0, atol=1e-12)
    assert AdaptiveFilter(plane).room(xs).visits < room.visits


def test_outputs_that_are_missing_against_what_was_said_are_not_lost_silently(x64):
    x, z = of_relays(np.random.default_rng(17))
    outputs = np.stack([z, 2.0 * z])
    outputs[1, len(z) // 2 :] = np.nan
    filt = AdaptiveFilter(PLANE)
    found = jax.jit(jax.vmap(lambda z: filt.run(x, z, missing=False)))(outputs)
    whole = filt.run(x, z)
    np.testing.assert_allclose(found.weights[0], whole.weights, rtol=0, atol=1e-12)
    assert np.isnan(found.weights[1]).all()
    assert np.isnan(found.output[1, len(z) // 2 :]).all()
    assert np.isfinite(found.output[1, : len(z) // 2]).all()


# --- planes ---


@pytest.mark.parametrize("hysteron", HYSTERONS)
def test_planes_of_several_sizes_are_one_batch(x64, hysteron):
    x, z = of_relays(np.random.default_rng(16))
    planes = [PLANE, Plane(3, -2.0, 8.0), UNEQUAL]
    batch = jax.tree.map(lambda *each: jnp.stack(each), *(one.padded(5) for one in planes))
    outputs = jnp.stack([z, z + 0.1 * np.sin(np.arange(len(z)))])

    def weights(plane, z):
        return AdaptiveFilter(plane, hysteron).run(x, z, missing=False).weights

    found = jax.jit(jax.vmap(jax.vmap(weights, (None, 0)), (0, None)))(batch, outputs)
    for several, plane in zip(found, planes, strict=True):
        for one, z in zip(several, outputs, strict=True):
            dense = AdaptiveFilter(plane, hysteron).run(x, z, form="dense").weights
            np.testing.assert_allclose(one[: plane.cells], dense, rtol=0, atol=1e-12)
            np.testing.assert_allclose(one[plane.cells :], 1e-9)


@pytest.mark.parametrize("hysteron", HYSTERONS)
def test_unequal_thresholds_are_equal_ones_behind_a_map_of_the_input(x64, hysteron):
    x, z = of_relays(np.random.default_rng(17))
    knots = np.concatenate([[-2.0], UNEQUAL.thresholds, [8.0]])
    mapped = np.interp(x, knots, [-2.0, -1.0, 1.0, 3.0, 5.0, 7.0, 8.0])
    for form in ("dense", "event"):
        found = AdaptiveFilter(UNEQUAL, hysteron).run(x, z, form=form)
        wanted = AdaptiveFilter(PLANE, hysteron).run(mapped, z, form="dense")
        for one, other in zip(found[:4], wanted[:4], strict=True):
            np.testing.assert_allclose(one, other, rtol=0, atol=1e-11)
    online = OnlineFilter(AdaptiveFilter(UNEQUAL, hysteron))
    online.block(x[:100], z[:100])
    for sample in zip(x[100:], z[100:], strict=True):
        online(*sample)
    assert online.state is not None
    np.testing.assert_allclose(online.state.weights, wanted.weights, rtol=0, atol=1e-11)


def test_thresholds_that_are_none_are_refused_by_their_number():
    good = [-1.5, 0.0, 0.5, 3.0]
    cases = {
        "shape (4,)": good,
        r"thresholds[2] is -1.0": [-1.5, 0.0, -1.0, 3.0, 7.0],
        "thresholds[4] is 8.5": [*good, 8.5],
        "infinity only after the last": [-1.5, np.inf, 0.5, 3.0, 7.0],
        "thresholds holds": [*good, "x"],
    }
    for message, thresholds in cases.items():
        with pytest.raises(InputError) as raised:
            Plane(5, -2.0, 8.0, thresholds)
        assert message in str(raised.value)
    with pytest.raises(InputError, match="levels is 3: give at least 5"):
        UNEQUAL.padded(3)
    with pytest.raises(InputError, match=r"goes from 1\.0 to 1\.0"):
        Plane.of(SimpleNamespace(input=np.ones(5), output=np.arange(5.0)), 3)


def test_where_there_is_no_event_form_it_says_why():
    x = paths(0)["walk"]
    missing = np.where(np.arange(SAMPLES) == 7, np.nan, x)
    weights = np.ones(PLANE.cells)
    ramps = AdaptiveFilter(PLANE, "ramp")
    cases = [
        (lambda form: simulate(PLANE, weights, x, "relay", weights, form), "states of one's own"),
        (lambda form: ramps.run(x, missing, form=form), "outputs are missing"),
        (lambda form: ramps.run(x, x, ramps.init(x[0], 0.0), form=form), "from a state"),
        (lambda form: AdaptiveFilter(PLANE, "ramp", leakage=0.1).run(x, x, form=form), "leakage"),
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

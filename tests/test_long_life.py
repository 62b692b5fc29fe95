"""The adaptive filter over long times: what it keeps, its options, and a sensor that fails."""

import dataclasses
import json
import math
import tracemalloc
from typing import Any

import hypothesis.strategies as st
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from oracles import slow_relays
from scipy.special import erf, erfc

import preisach_jax as pj
from preisach_jax.errors import InputError
from preisach_jax.filter.adaptive import AdaptiveFilter
from preisach_jax.filter.online import OnlineFilter
from preisach_jax.filter.state import FilterState
from preisach_jax.operator.checks import HYSTERONS
from preisach_jax.operator.plane import Plane

# Thresholds, and positions of ramps, are exact in both precisions.
PLANE = Plane(levels=6, low=-2.0, high=4.0)
SAMPLES = 240

OPTIONS: dict[str, dict[str, Any]] = {
    "dead zone": {"dead_zone": 0.4},
    "error limit": {"error_limit": 0.5},
    "nonnegative": {"nonnegative": True},
    "leakage": {"leakage": 0.03},
    "three": {"dead_zone": 0.2, "error_limit": 0.5, "nonnegative": True, "step_size": 0.7},
}
OPTIONS["all"] = OPTIONS["three"] | OPTIONS["leakage"]

both_kinds = pytest.mark.parametrize("hysteron", HYSTERONS)


def wandering(samples=SAMPLES, seed=0, plane=PLANE):
    """Between random turning points, with rests; in quarters of a level, so that sums are exact."""
    rng = np.random.default_rng(seed)
    turns = rng.integers(0, 4 * plane.levels + 1, samples)
    turns[:3] = 0, 4 * plane.levels, 4 * plane.levels
    place = np.interp(
        np.arange(samples), np.append(0, np.cumsum(np.abs(np.diff(turns)) / 2)), turns
    )
    return plane.low + np.round(place) / 4 * plane.delta_x


def literal_states(plane, x, hysteron):
    """(time, cells) states from saturated low, word for word."""
    if hysteron == "relay":
        return slow_relays(plane, x).astype(float)
    states, rows = np.zeros(plane.cells), []
    for value in x:
        place = (value - plane.low) / plane.delta_x
        on_alpha = np.clip(place - plane.alpha_index, 0, 1)
        on_beta = np.clip(place - plane.beta_index, 0, 1)
        states = np.minimum(on_beta, np.maximum(states, on_alpha))
        rows.append(states)
    return np.array(rows)


def literal_run(filt, x, z, adapt=True):
    """Weights after each sample, outputs, errors and sᵀs: the recursion with all options."""
    y = literal_states(filt.plane, x, filt.hysteron)
    prior = np.broadcast_to(np.asarray(filt.initial_weight, float), filt.plane.cells)
    weights, reference, rows = np.array(prior), 0, []
    has_reference = np.isfinite(z[0])
    for k in range(len(x)):
        s = y[k] - y[reference]
        error = z[k] - z[reference] - weights @ s if has_reference else np.nan
        output, squared, updated = weights @ y[k], s @ s, 0.0
        least = 0.5 if filt.sampling == "event" else 1e-7
        event = np.isfinite(error) and squared >= least
        if event and adapt and abs(error) > (-1 if filt.dead_zone is None else filt.dead_zone):
            used = (
                error
                if filt.error_limit is None
                else np.sign(error) * min(abs(error), filt.error_limit)
            )
            leakage = filt.leakage or 0.0
            weights = prior + (1 - leakage) * (weights - prior)
            weights = weights + filt.step_size * used * s / squared
            if filt.nonnegative:
                weights[s != 0] = weights[s != 0].clip(0)
            updated = squared
        rows.append((weights.copy(), output, error, updated))
        starting = np.isfinite(z[k]) and not has_reference
        if event or starting or filt.sampling == "sample":
            reference, has_reference = k, bool(np.isfinite(z[k]))
    weights, *others = (np.array(column) for column in zip(*rows, strict=True))
    return weights, *others


def measured(x, seed=1, gaps=False):
    rng = np.random.default_rng(seed)
    z = np.sin(2 * x) + 0.6 * x + rng.normal(0, 0.3, len(x))
    z[rng.random(len(x)) < (0.2 if gaps else 0.0)] = np.nan
    return z


def one_by_one(online, x, z, **keywords):
    """Outputs and infos of single samples."""
    rows = []
    for sample in zip(x.tolist(), z.tolist(), strict=True):
        online(*sample, **keywords)
        rows.append(online.info)
    return [np.array(column) for column in zip(*rows, strict=True)]


def by_blocks(online, x, z, size=60, **keywords):
    rows = []
    for begin in range(0, len(x), size):
        online.block(x[begin : begin + size], z[begin : begin + size], **keywords)
        rows.append(online.info)
    return [np.concatenate(column) for column in zip(*rows, strict=True)]


def fresh_output(state: FilterState | None) -> float:
    assert state is not None
    return math.fsum(np.asarray(state.weights, float) * np.asarray(state.states, float))


# --- options, in all forms of the filter ---


@pytest.mark.parametrize(
    ("hysteron", "chosen"),
    [*(("relay", name) for name in OPTIONS), ("ramp", "three"), ("ramp", "all")],
)
def test_each_option_is_the_literal_recursion_in_every_form(hysteron, chosen, x64):
    x = wandering()
    filt = AdaptiveFilter(PLANE, hysteron, initial_weight=0.1, **OPTIONS[chosen])
    for z in (measured(x, gaps=True), measured(x)):
        weights, *rows = literal_run(filt, x, z)
        assert 10 < np.count_nonzero(rows[2]) < SAMPLES
        start = filt.init(x[0], z[0])
        single, blocks = OnlineFilter(filt), OnlineFilter(filt, start)
        found = {"single": one_by_one(single, x, z), "block": by_blocks(blocks, x, z, SAMPLES)}
        assert single.state is not None
        assert blocks.state is not None
        ends = {"single": single.state.weights, "block": blocks.state.weights}
        results = {"dense": filt.run(x, z, start)}
        if not filt.leakage and not np.isnan(z).any():
            results["event"] = filt.run(x, z, form="event")
        for form, result in results.items():
            found[form] = [np.asarray(rows) for rows in result[1:4]]
            ends[form] = result.weights
        for form, infos in found.items():
            np.testing.assert_allclose(ends[form], weights[-1], atol=1e-12, err_msg=form)
            for got, wanted in zip(infos, rows, strict=True):
                np.testing.assert_allclose(got, wanted, atol=1e-12, err_msg=form)
    # The option matters here.
    plain, *_ = literal_run(AdaptiveFilter(PLANE, hysteron, initial_weight=0.1), x, z)
    assert np.abs(plain[-1] - weights[-1]).max() > 0.05


@both_kinds
@pytest.mark.parametrize(("chosen", "sampling"), [("three", "event"), ("all", "sample")])
def test_options_work_in_single_precision_and_sample_form(hysteron, chosen, sampling):
    x = wandering().astype("float32")
    z = measured(x).astype("float32")
    filt = AdaptiveFilter(PLANE, hysteron, sampling, 0.1, **OPTIONS[chosen])
    weights, *rows = literal_run(filt, x.astype(float), z.astype(float))
    results = [filt.run(x, z, form="dense")]
    if sampling == "event":
        results.append(filt.run(x, z, form="event"))
    online = OnlineFilter(filt)
    infos = one_by_one(online, x, z)
    assert online.state is not None
    assert online.state.weights.dtype == "float32"
    found = [(r.weights, r.output, r.error, r.switched) for r in results]
    for one in (*found, (online.state.weights, *infos)):
        for got, wanted in zip(one, (weights[-1], *rows), strict=True):
            np.testing.assert_allclose(got, wanted, atol=1e-3)


def test_leakage_has_no_event_form_and_says_so(x64):
    x = wandering()
    filt = AdaptiveFilter(PLANE, leakage=0.01)
    with pytest.raises(InputError, match="no event form with leakage: use form='auto'"):
        filt.run(x, x, form="event")
    assert filt.run(x, x).weights.shape == (PLANE.cells,)


@both_kinds
def test_many_settings_at_once_are_a_loop_over_them(hysteron, x64):
    x = wandering()
    z = measured(x)

    def weights(zone, limit, leakage):
        filt = AdaptiveFilter(
            PLANE, hysteron, dead_zone=zone, error_limit=limit, leakage=leakage, nonnegative=True
        )
        return filt.run(x, z).weights

    settings = np.array([[0.1, 0.5, 0.0], [0.5, 1.0, 0.1], [0.0, 0.2, 0.01]]).T
    batch = jax.vmap(weights)(*settings)
    loop = np.array([weights(*row) for row in settings.T])
    np.testing.assert_allclose(batch, loop, atol=1e-12)
    assert np.abs(np.diff(loop, axis=0)).max(axis=1).min() > 1e-3


@pytest.mark.parametrize("chosen", ["three", "all"])
def test_a_fleet_takes_the_options(chosen, x64, tmp_path):
    xs = [wandering(seed=k) for k in range(2)]
    zs = [measured(x) for x in xs]
    filt = AdaptiveFilter(PLANE, **OPTIONS[chosen])
    found = pj.run_fleet(filt, xs, zs)
    for x, z, weights, updates in zip(xs, zs, found.weights, found.updates, strict=True):
        one = filt.run(x, z)
        np.testing.assert_allclose(weights, one.weights, atol=1e-12)
        assert updates == np.count_nonzero(one.switched)


@both_kinds
def test_without_adapting_all_goes_on_but_the_weights(hysteron, x64):
    x = wandering()
    z = measured(x)
    start = np.random.default_rng(2).uniform(0.1, 1, PLANE.cells)
    filt = AdaptiveFilter(PLANE, hysteron, initial_weight=start, dead_zone=0.1, leakage=None)
    _, *rows = literal_run(filt, x, z, adapt=False)
    assert not rows[2].any()
    single, blocks = OnlineFilter(filt), OnlineFilter(filt)
    found = [one_by_one(single, x, z, adapt=False), by_blocks(blocks, x, z, adapt=False)]
    results = [filt.run(x, z, form=form, adapt=False) for form in ("dense", "event")]
    for infos in (*found, *(result[1:4] for result in results)):
        for got, wanted in zip(infos, rows, strict=True):
            np.testing.assert_allclose(got, wanted, atol=1e-12)
    for state in (single.state, blocks.state, *(result.state for result in results)):
        assert state is not None
        np.testing.assert_array_equal(state.weights, start)
    np.testing.assert_allclose(rows[0], literal_states(PLANE, x, hysteron) @ start, atol=1e-12)
    # It learns again from there on, in each form.
    more = [OnlineFilter(filt, state).block(x, z) for state in (single.state, results[1].state)]
    np.testing.assert_allclose(more[0], more[1], atol=1e-12)
    one_by_one(single, x, z)
    assert single.state is not None
    assert np.abs(single.state.weights - start).max() > 0.1


# --- what the options do to (15) and (21) ---


@both_kinds
@pytest.mark.parametrize("chosen", OPTIONS)
def test_the_error_identity_holds_with_every_option(hysteron, chosen, x64):
    """‖E⁺‖² = ‖F‖² + (2μ ê sᵀF + μ² ê²)/A at every step of the filter, with noise."""
    x = wandering()
    y = literal_states(PLANE, x, hysteron)
    rng = np.random.default_rng(3)
    truth = rng.uniform(0.1, 1.0, PLANE.cells)
    noise = rng.normal(0, 0.3, SAMPLES)
    z = y @ truth + noise
    filt = AdaptiveFilter(PLANE, hysteron, initial_weight=0.3, **OPTIONS[chosen])
    mu = OPTIONS[chosen].get("step_size", 1.0)
    leakage = OPTIONS[chosen].get("leakage", 0.0)

    online, weights, infos = OnlineFilter(filt), [], []
    for sample in zip(x.tolist(), z.tolist(), strict=True):
        online(*sample)
        assert online.state is not None
        weights.append(np.asarray(online.state.weights))
        infos.append(online.info)
    _, errors, switched = np.array(infos).T
    E, reference, updates, strict = 0.3 - truth, 0, 0, 0
    for k in range(SAMPLES):
        s = y[k] - y[reference]
        if s @ s >= 0.5:
            e = noise[k] - noise[reference] - s @ E
            assert errors[k] == pytest.approx(e, abs=1e-12)
            reference = k
            new = weights[k] - truth
            if switched[k]:
                limit = OPTIONS[chosen].get("error_limit", np.inf)
                used = np.clip(e, -limit, limit)
                F = (1 - leakage) * E + leakage * (0.3 - truth)
                expected = F @ F + (2 * mu * used * (s @ F) + mu**2 * used**2) / (s @ s)
                if filt.nonnegative:
                    assert new @ new <= expected + 1e-12
                    strict += new @ new < expected - 1e-6
                else:
                    assert new @ new == pytest.approx(expected, rel=1e-12)
                updates += 1
            else:
                np.testing.assert_array_equal(new, E)
            E = new
    assert updates > 20
    assert strict or not filt.nonnegative


@both_kinds
def test_noise_inside_the_dead_zone_never_touches_the_weights(hysteron, precision):
    """All |ν| ≤ d at the truth: no update in 10⁵ samples, while without a zone there are many."""
    x = np.resize(wandering(1000), 100_000).astype(precision)
    truth = np.random.default_rng(4).integers(1, 9, PLANE.cells).astype(precision) / 8
    rng = np.random.default_rng(5)
    exact = np.asarray(pj.simulate(PLANE, truth, x, hysteron))
    z = (exact + rng.uniform(-0.05, 0.05, len(x))).astype(precision)
    online = OnlineFilter(AdaptiveFilter(PLANE, hysteron, initial_weight=truth, dead_zone=0.101))
    for part in np.split(np.arange(len(x)), 10):
        online.block(x[part], z[part])
        assert online.state is not None
        np.testing.assert_array_equal(online.state.weights, truth)
    without = AdaptiveFilter(PLANE, hysteron, initial_weight=truth).run(x[:5000], z[:5000])
    assert np.abs(without.weights - truth).max() > 0.01


@given(
    mu=st.sampled_from([0.2, 1.0, 1.8]),
    seed=st.integers(0, 1000),
    share=st.floats(0.0, 1.0),
)
def test_the_error_never_grows_while_noise_is_within_its_share_of_the_dead_zone(mu, seed, share):
    rng = np.random.default_rng(seed)
    zone = 0.4
    x = wandering(120, seed)
    truth = rng.uniform(0.1, 1.0, PLANE.cells)
    most = share * (1 - mu / 2) * zone / 2  # of one sample; a difference has two
    z = literal_states(PLANE, x, "relay") @ truth + rng.uniform(-most, most, len(x))
    filt = AdaptiveFilter(PLANE, initial_weight=0.5, step_size=mu, dead_zone=zone)
    online, norms = OnlineFilter(filt), []
    for sample in zip(x.tolist(), z.tolist(), strict=True):
        online(*sample)
        assert online.state is not None
        norms.append(np.linalg.norm(np.asarray(online.state.weights, float) - truth))
    assert np.all(np.diff(norms) <= 1e-6)


def test_noise_that_enters_an_update_has_the_power_of_its_closed_form(x64):
    """From the truth an update adds μ²⟨ê²⟩/A: of Gaussian ν outside a zone, and cut off."""
    sigma, mu, draws = 0.3, 0.7, 200_000
    nu = sigma * np.sqrt(2) * np.random.default_rng(6).standard_normal(draws)
    deviation = sigma * np.sqrt(2)
    truth = np.linspace(0.1, 1.0, PLANE.cells)

    def gained(filt):
        state = filt.init(-2.0, 0.0)
        exact = filt.step(state, 1.1, np.nan)[1].output
        step = jax.jit(jax.vmap(lambda n: filt.step(state, 1.1, exact + n)))
        following, info = step(nu)
        area = np.max(np.asarray(info.switched))
        return np.sum((np.asarray(following.weights) - truth) ** 2, axis=1) * area / mu**2

    filt = AdaptiveFilter(PLANE, initial_weight=truth, step_size=mu)
    t = 0.5 / (deviation * np.sqrt(2))
    tail = erfc(t) + 2 * t * np.exp(-(t**2)) / np.sqrt(np.pi)
    inside = erf(t) - 2 * t * np.exp(-(t**2)) / np.sqrt(np.pi)
    expected = {
        (None, None): deviation**2,
        (0.5, None): deviation**2 * tail,
        (None, 0.5): deviation**2 * inside + 0.25 * erfc(t),
    }
    for (zone, limit), power in expected.items():
        found = gained(dataclasses.replace(filt, dead_zone=zone, error_limit=limit))
        margin = 5 * found.std() / np.sqrt(draws)
        assert found.mean() == pytest.approx(power, abs=margin)
        assert margin < 0.02 * deviation**2


@both_kinds
@given(
    spikes=st.lists(st.tuples(st.integers(1, 99), st.sampled_from([-1e6, 1e6, 30.0])), max_size=8)
)
def test_no_update_moves_the_weights_farther_than_the_error_limit_allows(hysteron, spikes):
    x = wandering(100, 7)
    z = measured(x)
    for k, height in spikes:
        z[k] += height
    limit, mu = 0.3, 0.8
    online = OnlineFilter(AdaptiveFilter(PLANE, hysteron, error_limit=limit, step_size=mu))
    before, moved = None, 0.0
    for sample in zip(x.tolist(), z.tolist(), strict=True):
        online(*sample)
        assert online.state is not None
        assert online.info is not None
        weights = np.asarray(online.state.weights, float)
        if before is not None and online.info.switched:
            moved = np.linalg.norm(weights - before)
            assert moved <= mu * limit / np.sqrt(float(online.info.switched)) * (1 + 1e-5)
        before = weights
    assert moved > 0


def test_leakage_leaves_the_bias_and_the_variance_of_its_closed_forms(x64):
    """One relay: the bias is λ/(λ+μ) of the prior's error, the variance 2μ²σ²/(λ+μ)."""
    plane = Plane(levels=2, low=0.0, high=2.0)  # of which the input moves the lowest relay alone
    samples, truth, prior = 100_000, 3.0, 1.0
    x = np.tile([0.0, 1.0], samples // 2)
    noise = np.random.default_rng(8).normal(0, 0.1, samples)
    for mu, leakage in ((0.05, 0.02), (1.0, 0.25), (0.05, 0.0)):
        filt = AdaptiveFilter(plane, initial_weight=prior, step_size=mu, leakage=leakage)

        def advance(state, sample, filt=filt):
            state, _ = filt.step(state, *sample)
            return state, state.weights[0] - truth

        def errors(z, filt=filt, advance=advance):
            return jax.lax.scan(advance, filt.init(x[0], z[0]), (x, z))[1]

        exact = np.asarray(jax.jit(errors)(truth * x))
        bias = leakage / (leakage + mu) * (prior - truth)
        assert exact[-1] == pytest.approx(bias, abs=1e-12)
        noisy = np.asarray(jax.jit(errors)(truth * x + noise))[2000:]
        # With the correlation length 1/(λ+μ), so many of the samples are independent.
        margin = 5 * np.sqrt(2 / (len(noisy) * (leakage + mu) / 2))
        variance = 2 * mu**2 * 0.1**2 / (leakage + mu)
        assert noisy.var() == pytest.approx(variance, rel=margin)
        assert margin < 0.25


@given(seed=st.integers(0, 1000), leakage=st.sampled_from([0.02, 0.2]), size=st.floats(0, 1e4))
def test_leakage_bounds_the_weights_whatever_is_measured(seed, leakage, size):
    rng = np.random.default_rng(seed)
    x, z = wandering(150, seed), rng.uniform(-size, size, 150)
    filt = AdaptiveFilter(PLANE, "ramp", initial_weight=0.2, leakage=leakage)
    online = OnlineFilter(filt)
    # ‖R̂ - R₀‖ ≤ μ |Δz - R₀ᵀs|/(λ√A) with A ≥ 1/2, |Δz| ≤ 2 size, |R₀ᵀs| ≤ ‖R₀‖ √A.
    bound = (2 * size / np.sqrt(0.5) + 0.2 * np.sqrt(PLANE.cells)) / leakage
    for sample in zip(x.tolist(), z.tolist(), strict=True):
        online(*sample)
        assert online.state is not None
        moved = np.asarray(online.state.weights, float) - 0.2
        assert np.linalg.norm(moved) <= bound * (1 + 1e-5)


def test_leakage_forgets_where_the_input_never_returns(x64):
    """An unvisited cell returns to its initial weight as (1-λ)ⁿ with n updates elsewhere."""
    filt = AdaptiveFilter(PLANE, initial_weight=0.5, leakage=0.01)
    online = OnlineFilter(filt)
    for x in np.array([-2.0, 4.0, -2.0]):
        online(x, 50.0 * x)
    assert online.state is not None
    before = np.asarray(online.state.weights)
    for x in np.tile([0.6, -1.9], 300):
        online(x, x)
    unvisited = PLANE.alpha > 1.0
    after = np.asarray(online.state.weights)[unvisited] - 0.5
    np.testing.assert_allclose(after, 0.99**600 * (before[unvisited] - 0.5), rtol=1e-9)
    assert np.abs(before[unvisited] - 0.5).min() > 1.0


# --- what is kept does not age ---


@both_kinds
def test_the_output_of_a_long_run_does_not_drift(hysteron, precision):
    """The row of the last sample, at rest, against the sum over the plane."""
    bound = {"float64": 2e-14, "float32": 1e-5}[precision]
    x = np.resize(wandering(1000), 100_001).astype(precision)
    x[-40:] = x[-40]
    z = measured(x).astype(precision)
    filt = AdaptiveFilter(PLANE, hysteron, step_size=0.3)
    result = filt.run(x, z, form="event")
    assert np.count_nonzero(result.switched) > 0.2 * len(x)
    assert np.ptp(np.asarray(result.output)) > 1
    assert abs(float(result.output[-1]) - fresh_output(result.state)) < bound


def test_events_are_counted_beyond_what_floating_numbers_hold():
    """Half precision counts to 2048, single to 2²⁴."""
    plane = Plane(levels=4, low=0.0, high=4.0)
    x = np.random.default_rng(0).choice(np.linspace(0, 4, 9), 6000)
    x[0], x[-1] = 0.0, x[-2]
    z = x + 0.3 * np.sin(3 * x)
    filt = AdaptiveFilter(plane, step_size=0.3)
    result = filt.run(x.astype("float16"), z.astype("float16"), form="event")
    assert np.count_nonzero(result.switched) > 4500
    kept = np.asarray(result.output, float)
    exact = np.asarray(filt.run(x.astype("float32"), z.astype("float32"), form="event").output)
    assert np.abs(kept - exact)[-500:].max() < 0.1
    assert np.ptp(exact) > 3
    ramps = AdaptiveFilter(plane, "ramp", step_size=0.3)
    half = ramps.run(x[:500].astype("float16"), z[:500].astype("float16"), form="event")
    assert half.output.dtype == "float16"


@both_kinds
def test_trembling_below_an_event_does_not_pile_up(hysteron):
    """2·10⁴ samples without an event, and then one: its error is that of the two ends."""
    plane = Plane(levels=6, low=0.0, high=6.0)
    tremor = 2.3 + 0.1 * np.sin(np.arange(20_000))
    x = np.concatenate([[0.0, 2.3], tremor, [2.3, 4.9, 4.9]]).astype("float32")
    start = np.linspace(0.1, 2.0, plane.cells).astype("float32")
    filt = AdaptiveFilter(plane, hysteron, initial_weight=start)
    result = filt.run(x, 2 * x, form="event")
    few = filt.run(x[[0, 1, -2, -1]], 2 * x[[0, 1, -2, -1]], form="dense")
    bound = 50 * float(np.finfo("float32").eps)
    np.testing.assert_allclose(result.weights, few.weights, atol=bound, rtol=bound)
    assert float(result.error[-2]) == pytest.approx(float(few.error[-2]), abs=20 * bound)


@both_kinds
def test_a_long_life_of_single_samples_keeps_the_sum_and_the_memory(hysteron, precision):
    plane = Plane(levels=5, low=0.0, high=5.0)
    online = OnlineFilter(AdaptiveFilter(plane, hysteron, step_size=0.3))
    x = wandering(2500, plane=plane)
    z = measured(x)
    one_by_one(online, x, z)
    tracemalloc.start()
    before = tracemalloc.get_traced_memory()[0]
    for _ in range(4):
        for sample in zip(x.tolist(), z.tolist(), strict=True):
            online(*sample)
        kept = online(float(x[-1]))
        fresh = fresh_output(online.state)
        assert kept == pytest.approx(fresh, rel=8 * float(np.finfo(precision).eps), abs=1e-12)
    grown = tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    assert grown < 100_000


def test_blocks_of_any_length_share_what_is_compiled(compilations):
    filt = AdaptiveFilter(Plane(levels=3, low=-2.0, high=4.0), "ramp")
    x, z = wandering(4000), measured(wandering(4000))
    online, single = OnlineFilter(filt), OnlineFilter(filt)
    online.block(x[:130], z[:130])
    online.block(x[130:260], z[130:260])

    def blocks():
        begin = 260
        for size in (129, 131, 140, 133, 144, 137):
            online.block(x[begin : begin + size], z[begin : begin + size])
            begin += size
        return begin

    assert not compilations(blocks)
    one_by_one(single, x[: 260 + 814], z[: 260 + 814])
    assert online.state is not None
    assert single.state is not None
    for name, wanted in vars(single.state).items():
        np.testing.assert_allclose(getattr(online.state, name), wanted, atol=1e-4, err_msg=name)


def test_counts_go_past_two_to_the_31st(tmp_path):
    online = OnlineFilter(AdaptiveFilter(PLANE), saturate=True)
    online(1.0, 2.0)
    most = 2**31 - 1
    online._inputs_missing = online._outputs_missing = online._saturated = most
    online(math.nan, 1.0)
    online(5.0, math.nan)
    online.block(np.array([math.nan, 1.0, -9.0]), np.array([1.0, math.nan, 2.0]))
    assert online.missing == (most + 2, most + 2)
    assert online.saturated == most + 2
    online.save(tmp_path / "old.npz")
    loaded = OnlineFilter.load(tmp_path / "old.npz")
    assert loaded.missing == (most + 2, most + 2)
    assert loaded.saturated == most + 2


def test_a_record_that_indices_cannot_reach_is_refused():
    x = np.broadcast_to(np.float32(1.0), 2**31)
    with pytest.raises(InputError, match="2147483648 samples: give them in parts"):
        AdaptiveFilter(PLANE).run(x, x)


# --- bad samples ---

bad_inputs = st.one_of(
    st.floats(-2, 4, width=32), st.just(math.nan), st.floats(-50, 50, width=32), st.just(4.0)
)
bad_outputs = st.one_of(
    st.floats(-3, 3, width=32),
    st.just(math.nan),
    st.sampled_from([1e6, -1e6, 1e30, -1e30]),
    st.just(0.25),
)


@both_kinds
@pytest.mark.parametrize("chosen", ["none", "all"])
@given(samples=st.lists(st.tuples(bad_inputs, bad_outputs), min_size=30, max_size=30))
def test_bad_samples_leave_a_sound_state(hysteron, chosen, samples):
    x, z = (np.array(column, np.float32) for column in zip(*samples, strict=True))
    filt = AdaptiveFilter(PLANE, hysteron, **OPTIONS.get(chosen, {}))
    single, blocks = OnlineFilter(filt, saturate=True), OnlineFilter(filt, saturate=True)
    infos = one_by_one(single, x, z)
    by_blocks(blocks, x, z, 15)
    there = np.flatnonzero(~np.isnan(x))
    assert single.missing == blocks.missing
    assert single.missing.inputs == len(x) - len(there)
    assert single.saturated == blocks.saturated == np.count_nonzero((x < -2) | (x > 4))
    if not len(there):
        assert single.state is None
        return
    assert np.isfinite(infos[0][there[0] :]).all()
    for online in (single, blocks):
        state = online.state
        assert state is not None
        assert np.isfinite(state.weights).all()
        assert np.isfinite(online(float(state.input)))
        assert PLANE.low <= state.input <= PLANE.high
        allowed = (0.0, 1.0) if hysteron == "relay" else None
        for states in (np.asarray(state.states), np.asarray(state.reference_states)):
            assert np.isin(states, allowed).all() if allowed else True
            assert np.all((states >= 0) & (states <= 1))
        if filt.nonnegative:
            assert np.all(np.asarray(state.weights) >= 0)


@both_kinds
@pytest.mark.parametrize("sampling", ["event", "sample"])
def test_the_pure_step_skips_what_is_not_there(hysteron, sampling, x64):
    """A missing input changes nothing, an infinite output no weight, and both pass."""
    x, z = wandering(), measured(wandering())
    filt = AdaptiveFilter(PLANE, hysteron, sampling)
    step = jax.jit(AdaptiveFilter.step)
    state = filt.init(x[0], z[0])
    for k in range(1, SAMPLES):
        following, _ = step(filt, state, x[k], z[k])
        if k % 7 == 3:
            for value in (z[k], np.nan, np.inf):
                skipped, nothing = step(filt, following, np.nan, value)
                for name, array in vars(following).items():
                    np.testing.assert_array_equal(getattr(skipped, name), array)
                assert np.isnan(nothing.error)
                assert not nothing.switched
                assert float(nothing.output) == pytest.approx(fresh_output(following), abs=1e-12)
            for wrong in (np.inf, -np.inf, np.nan):
                broken, _ = step(filt, state, x[k], wrong)
                np.testing.assert_array_equal(broken.weights, state.weights)
            beyond, _ = step(filt, state, np.inf, np.nan)
            np.testing.assert_array_equal(beyond.states, 1.0)
        state = following
    assert np.isfinite(state.weights).all()


def test_inputs_beyond_the_plane_saturate_if_asked(x64, tmp_path):
    x = 1.6 * wandering()
    z = measured(x)
    filt = AdaptiveFilter(PLANE, "ramp")
    with pytest.raises(InputError, match="make the plane wider, or clip the input"):
        OnlineFilter(filt).block(x, z)
    clipped = filt.run(np.clip(x, -2, 4), z)
    single, blocks = OnlineFilter(filt, saturate=True), OnlineFilter(filt, None, True)
    one_by_one(single, x[:120], z[:120])
    single.save(tmp_path / "state.npz")
    single = OnlineFilter.load(tmp_path / "state.npz")
    one_by_one(single, x[120:], z[120:])
    by_blocks(blocks, x, z)
    for online in (single, blocks):
        assert online.saturated == np.count_nonzero((x < -2) | (x > 4)) > 20
        assert online.state is not None
        np.testing.assert_allclose(online.state.weights, clipped.weights, atol=1e-12)
        for wrong in (np.inf, -np.inf):
            with pytest.raises(InputError, match=r"x is -?inf"):
                online(wrong, 1.0)
            with pytest.raises(InputError, match=r"x is -?inf"):
                online.block(np.array([1.0, wrong]))


FAULTS = {
    "lost": lambda z, rng: np.full_like(z, np.nan),
    "spikes": lambda z, rng: z + 1e6 * 0.02 * (rng.random(len(z)) < 0.05),
    "stuck": lambda z, rng: np.full_like(z, z[0]),
    "reversed": lambda z, rng: -z,
}
TOLD = 3_000


@both_kinds
@pytest.mark.parametrize("fault", FAULTS)
def test_the_filter_recovers_from_a_faulty_sensor(hysteron, fault, precision):
    """Noise-free but for the fault of 500 samples: forgotten in 3,000 samples."""
    plane = Plane(levels=4, low=-2.0, high=4.0)
    x = np.resize(wandering(2000, plane=plane), 10_000).astype(precision)
    truth = np.random.default_rng(9).uniform(0.1, 1.0, plane.cells).astype(precision)
    z = np.array(pj.simulate(plane, truth, x, hysteron))
    z[4000:4500] = FAULTS[fault](z[4000:4500], np.random.default_rng(10))
    online = OnlineFilter(AdaptiveFilter(plane, hysteron))
    output, _, _ = by_blocks(online, x[:4500], z[:4500], 500)
    assert np.isfinite(output).all()
    assert online.state is not None
    moved = np.linalg.norm(np.asarray(online.state.weights) - truth)
    assert (moved > 0.2) == (fault != "lost")
    output, _, _ = by_blocks(online, x[4500:], z[4500:], 500)
    left = (output - z[4500:])[TOLD:]
    assert np.std(left) < 0.02 * np.ptp(z[:4000])


# --- keeping, and mistakes ---


def test_options_are_saved_and_older_files_have_none(x64, tmp_path):
    filt = AdaptiveFilter(PLANE, "ramp", initial_weight=0.1, **OPTIONS["all"])
    x, z = wandering(), measured(wandering())
    online = OnlineFilter(filt)
    one_by_one(online, x[:100], z[:100])
    path = tmp_path / "state.npz"
    online.save(path)
    loaded = OnlineFilter.load(path)
    assert loaded.filter.options() == filt.options() == {
        "dead_zone": 0.2, "leakage": 0.03, "error_limit": 0.5, "nonnegative": True
    }  # fmt: skip
    wanted, again = one_by_one(online, x[100:], z[100:]), one_by_one(loaded, x[100:], z[100:])
    np.testing.assert_allclose(again, wanted, atol=1e-12)

    with np.load(path) as stored:
        arrays: dict[str, Any] = {name: stored[name] for name in stored.files}
    about = json.loads(str(arrays.pop("about")))
    without = {name: about[name] for name in about if name not in ("options", "saturate")}
    assert about["format"] == 4
    arrays.pop("saturated")
    np.savez(path, about=np.asarray(json.dumps(without | {"format": 3})), **arrays)
    older = OnlineFilter.load(path)
    assert older.filter.options() == {}
    assert older.saturated == 0
    with pytest.raises(InputError, match=r"x is 9, and the plane reaches"):
        older(9.0, 1.0)
    np.savez(path, about=np.asarray(json.dumps(without | {"format": 4})), **arrays)
    with pytest.raises(InputError, match=r"state\.npz cannot be read .*options"):
        OnlineFilter.load(path)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"dead_zone": -0.1}, r"dead_zone is -0\.1: give a number of at least 0"),
        ({"dead_zone": math.inf}, "dead_zone is inf"),
        ({"dead_zone": math.nan}, "dead_zone is nan"),
        ({"dead_zone": "x"}, "dead_zone is 'x': give one number"),
        ({"dead_zone": np.ones(2)}, r"dead_zone has the shape \(2,\)"),
        ({"error_limit": 0.0}, r"error_limit is 0\.0: give a number above 0"),
        ({"error_limit": 1j}, "error_limit is 1j: give one number"),
        ({"leakage": 1.0}, r"leakage is 1\.0: give a number from 0 to 1, 1 excluded"),
        ({"leakage": -1e-3}, "leakage is -0.001"),
        ({"leakage": 0.5, "step_size": 1.5}, "make their sum less than 2"),
        ({"nonnegative": 1}, "nonnegative is 1: give True or False"),
        ({"nonnegative": True, "initial_weight": -0.5}, "initial_weight is -0.5 with nonnegative"),
        ({"step_size": None}, "step_size is None: give one number"),
    ],
)
def test_settings_that_cannot_be_are_named(options, message):
    with pytest.raises(InputError, match=message):
        AdaptiveFilter(PLANE, **options)


def test_a_switch_that_is_none_is_named():
    filt = AdaptiveFilter(PLANE)
    online = OnlineFilter(filt)
    adapt: Any = "no"
    for call in (
        lambda: online(1.0, 2.0, adapt),
        lambda: online.block(np.ones(3), np.ones(3), adapt),
        lambda: filt.run(np.ones(3), np.ones(3), adapt=adapt),
    ):
        with pytest.raises(InputError, match="adapt is 'no': give True or False"):
            call()
    assert online.state is None
    with pytest.raises(InputError, match="saturate is 'no': give True or False"):
        OnlineFilter(filt, saturate=adapt)


def test_options_that_change_nothing_leave_every_bit(precision):
    """The paper's filter and one whose limit is never reached."""
    x = wandering().astype(precision)
    z = measured(x).astype(precision)
    plain, limited = (
        AdaptiveFilter(PLANE, error_limit=limit).run(x, z, form="dense") for limit in (None, 1e9)
    )
    for one, other in zip(jax.tree.leaves(plain), jax.tree.leaves(limited), strict=True):
        np.testing.assert_array_equal(one, other)
    assert jnp.count_nonzero(plain.switched) > 10

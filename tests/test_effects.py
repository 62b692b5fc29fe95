"""Each effect against an oracle of other make: SciPy's linear systems, closed forms, limits."""

import importlib
import importlib.metadata
from typing import Any

import hypothesis.strategies as st
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from acting import applied, columns, factor, signals
from hypothesis import given
from scipy import signal

from preisach_jax.chain import PLACES
from preisach_jax.effects import BUILT_IN, library, resolve
from preisach_jax.effects.ageing import Ageing
from preisach_jax.effects.auxiliary import Auxiliary
from preisach_jax.effects.base import (
    AddedEffect,
    InputEffect,
    OutputEffect,
    SensorEffect,
    Survey,
    WeightEffect,
)
from preisach_jax.effects.creep import Creep
from preisach_jax.effects.delay import Delay
from preisach_jax.effects.drift import Drift
from preisach_jax.effects.hum import Hum
from preisach_jax.effects.input_lag import InputLag
from preisach_jax.effects.input_quantisation import InputQuantisation
from preisach_jax.effects.output_lag import OutputLag
from preisach_jax.effects.parameter import Parameter, log_grid
from preisach_jax.effects.resonance import Resonance
from preisach_jax.effects.slew_limit import SlewLimit
from preisach_jax.errors import EffectError, InputError

TICK = 1e-3
COUNT = 120
CREEP = Creep(tau_s=(0.004, 0.05, 0.9))
CREEP_VALUES = {"c_1": 0.2, "c_2": 0.05, "c_3": 0.3}

# Every effect at values from the middle of its range, on a record of about 0.6 s.
CASES: dict[str, tuple[Any, dict[str, float]]] = {
    "creep": (CREEP, CREEP_VALUES),
    "input_lag": (InputLag(), {"tau_s": 0.011}),
    "slew_limit": (SlewLimit(), {"slew": 170.0}),
    "input_quantisation": (InputQuantisation(), {"step": 0.3}),
    "output_lag": (OutputLag(), {"tau_s": 0.013}),
    "delay": (Delay(), {"delay_s": 0.00725}),
    "resonance": (Resonance(), {"f_hz": 21.0, "zeta": 0.08}),
    "drift": (Drift(horizon_s=0.6), {"tau_s": 0.2}),
    "hum": (Hum(), {"f_hz": 7.3}),
    "ageing": (Ageing(horizon_s=0.6), {"loss": 0.1, "tau_s": 0.4}),
    "aux:load_N": (Auxiliary(column="load_N", unit="N"), {"tau_s": 0.02}),
}
STEPPED = [name for name, (effect, _) in CASES.items() if hasattr(effect, "apply")]
# What is limited or rounded does not add up.
LINEAR = [name for name in STEPPED if name not in ("slew_limit", "input_quantisation")]


def course(seed, count=COUNT):
    """Uneven times that lie on a raster of `TICK`, and a wandering signal."""
    rng = np.random.default_rng(seed)
    ticks = np.concatenate([[0], np.cumsum(rng.integers(1, 10, count - 1))])
    return ticks, ticks * TICK, 3.0 + np.cumsum(rng.normal(size=count))


def polyline(seed):
    """Uneven times on the raster, and a signal with corners at every fourth sample."""
    ticks, time, knots = course(seed)
    return ticks, time, np.interp(time, time[::4], knots[::4])


def lsim_lag(ticks, values, tau):
    """tau y' = v - y at rest before the start, v straight between samples, by SciPy."""
    raster = np.arange(ticks[-1] + 1)
    system = ([[-1 / tau]], [[1 / tau]], [[1.0]], [[0.0]])
    fine = np.interp(raster, ticks, values)
    return signal.lsim(system, fine, raster * TICK, X0=[values[0]])[1].ravel()[ticks]


def output_of(name, values, time, course):
    """What an effect does to a record, as one column."""
    effect = CASES[name][0]
    drives = signals(time, course, {"load_N": course})
    if isinstance(effect, WeightEffect):
        return effect.at(values).factor(drives)
    if isinstance(effect, AddedEffect):
        return effect.at(values).columns(drives)[:, 0]
    return effect.at(values).apply(drives.input, drives.time)


# --- each against its oracle ---


@pytest.mark.parametrize("tau", [0.0002, 0.011, 3.0])
def test_input_lag_is_a_linear_system(precision, tau):
    ticks, time, u = polyline(1)
    got = applied(InputLag(), {"tau_s": tau}, time, u)
    assert got.dtype == precision
    atol = 2e-4 if precision == "float32" else 1e-9
    np.testing.assert_allclose(got, lsim_lag(ticks, u, tau), rtol=0, atol=atol)


@pytest.mark.parametrize("kind", [InputLag, OutputLag])
@pytest.mark.parametrize("tau", [0.0004, 0.011, 3.0])
def test_a_filter_of_samples_is_that_of_scipy(precision, kind, tau):
    values = course(7)[2]
    share = -np.expm1(-TICK / tau)
    start = signal.lfilter_zi([share], [1.0, share - 1.0]) * values[0]
    expected = signal.lfilter([share], [1.0, share - 1.0], values, zi=start)[0]
    time = TICK * np.arange(len(values))
    got = applied(kind(of_samples=True), {"tau_s": tau}, time, values)
    assert got.dtype == precision
    atol = 2e-3 if precision == "float32" else 1e-12  # steps of time are rounded to float32
    np.testing.assert_allclose(got, expected, rtol=0, atol=atol)


def test_creep_is_a_sum_of_linear_systems(precision):
    ticks, time, h = course(2)
    lags = [
        c * lsim_lag(ticks, h, tau)
        for c, tau in zip(CREEP_VALUES.values(), CREEP.tau_s, strict=True)
    ]
    got = applied(CREEP, CREEP_VALUES, time, h)
    assert got.dtype == precision
    atol = 2e-4 if precision == "float32" else 1e-9
    np.testing.assert_allclose(got, h + np.sum(lags, axis=0), rtol=0, atol=atol)


def test_creep_after_a_step_is_the_sum_of_exponentials(x64):
    time = np.concatenate([[0.0, 1e-9], np.linspace(0.01, 2.0, 60)])
    got = applied(CREEP, CREEP_VALUES, time, np.where(time > 0, 5.0, 0.0))
    elements = zip(CREEP_VALUES.values(), CREEP.tau_s, strict=True)
    rise = np.sum([c * -np.expm1(-time / tau) for c, tau in elements], axis=0)
    np.testing.assert_allclose(got[1:], 5.0 * (1 + rise[1:]), atol=1e-5)


@pytest.mark.parametrize("delay", [0.0004, 0.00725, 0.3])
def test_delay_reads_the_signal_earlier(precision, delay):
    _, time, h = polyline(3)
    got = applied(Delay(), {"delay_s": delay}, time, h)
    assert got.dtype == precision
    expected = np.interp(time - delay, time, h, left=h[0])
    atol = 2e-4 if precision == "float32" else 1e-10  # times are rounded to float32
    np.testing.assert_allclose(got, expected, rtol=0, atol=atol)


@pytest.mark.parametrize("samples", [1000, 2000])
def test_a_lag_follows_what_bends_and_a_delay_cuts_it_by_a_chord(x64, samples):
    time = np.linspace(0.0, 1.0, samples + 1)
    w, settled = 2 * np.pi * 15, time > 0.2
    chord = (w / samples) ** 2 / 8  # by which straight lines between the samples miss a sinusoid
    u = np.sin(w * time)
    delayed = applied(Delay(), {"delay_s": 0.01237}, time, u)
    np.testing.assert_allclose(
        delayed[settled], np.sin(w * (time - 0.01237))[settled], rtol=0, atol=chord
    )
    lagged = applied(InputLag(), {"tau_s": 0.0026}, time, u)
    exact = np.imag(np.exp(1j * w * time) / (1 + 1j * w * 0.0026))
    np.testing.assert_allclose(lagged[settled], exact[settled], rtol=0, atol=0.15 * chord)


def test_drift_approaches_its_end_exponentially(precision, tolerance):
    time = np.array([0.0, 0.1, 0.33, 0.6, 0.9])
    got = columns(Drift(horizon_s=0.6), {"tau_s": 0.2}, signals(time, time))
    expected = (1 - np.exp(-time / 0.2)) / (1 - np.exp(-0.6 / 0.2))
    assert got.shape == (5, 1)
    assert got.dtype == precision
    np.testing.assert_allclose(got[:, 0], expected, rtol=tolerance, atol=tolerance)


@pytest.mark.parametrize("tau", [1e3, 1e6])
def test_slow_drift_is_a_straight_line(precision, tau):
    time = np.linspace(0.0, 2.0, 9)
    got = columns(Drift(horizon_s=2.0), {"tau_s": tau}, signals(time, time))
    np.testing.assert_allclose(got[:, 0], time / 2.0, rtol=0, atol=3 / tau + 1e-6)


def test_fast_drift_is_a_step(x64):
    time = np.array([0.0, 0.1, 1.0])
    got = columns(Drift(horizon_s=1.0), {"tau_s": 1e-3}, signals(time, time))
    np.testing.assert_allclose(got[:, 0], [0.0, 1.0, 1.0], atol=1e-12)


@pytest.mark.parametrize("loss", [-0.3, 0.0, 0.7])
def test_ageing_ends_at_the_loss(precision, tolerance, loss):
    time = np.linspace(0.0, 4.0, 30)
    values = {"loss": loss, "tau_s": 1.3}
    got = np.asarray(factor(Ageing(horizon_s=4.0), values, signals(time, time)))
    assert got.dtype == precision
    expected = 1 - loss * (1 - np.exp(-time / 1.3)) / (1 - np.exp(-4.0 / 1.3))
    np.testing.assert_allclose(got, expected, rtol=tolerance)
    assert got[0] == 1.0
    assert got[-1] == pytest.approx(1 - loss, rel=tolerance)


def test_auxiliary_acts_at_once_at_the_lower_bound(precision):
    _, time, load = course(4)
    effect = Auxiliary(column="load_N", unit="N", tau_low_s=TICK / 100)
    got = columns(effect, {"tau_s": TICK / 100}, signals(time, time, {"load_N": load}))
    assert got.shape == (COUNT, 1)
    assert got.dtype == precision
    np.testing.assert_allclose(got[:, 0], load, rtol=0, atol=0.02 * np.abs(np.diff(load)).max())


@pytest.mark.parametrize("tau", [0.02, 0.4])
def test_auxiliary_trails_by_its_lag(precision, tau):
    ticks, time, load = course(5)
    effect = Auxiliary(column="load_N", unit="N")
    got = columns(effect, {"tau_s": tau}, signals(time, time, {"load_N": load}))
    atol = 2e-4 if precision == "float32" else 1e-9
    np.testing.assert_allclose(got[:, 0], lsim_lag(ticks, load, tau), rtol=0, atol=atol)


# --- laws of all ---


@pytest.mark.parametrize("name", STEPPED)
def test_a_signal_at_rest_stays_at_rest(precision, tolerance, name):
    effect, values = CASES[name]
    _, time, _ = course(6)
    got = np.asarray(applied(effect, values, time, np.full(COUNT, 7.5)))
    gain = 1 + sum(CREEP_VALUES.values()) if name == "creep" else 1.0
    np.testing.assert_allclose(got, 7.5 * gain, rtol=tolerance)


@pytest.mark.parametrize("name", LINEAR)
def test_effects_on_a_signal_are_linear(x64, name):
    effect, values = CASES[name]
    _, time, first = polyline(7)  # what bends is limited, which is not linear
    second = np.interp(time, time[::4], course(8)[2][::4])
    both = applied(effect, values, time, 2.0 * first - second)
    parts = 2.0 * applied(effect, values, time, first) - applied(effect, values, time, second)
    np.testing.assert_allclose(both, parts, rtol=0, atol=1e-10)


@pytest.mark.parametrize("name", STEPPED)
def test_effects_on_a_signal_are_causal(x64, name):
    effect, values = CASES[name]
    _, time, first = polyline(7)
    second = np.interp(time, time[::4], course(8)[2][::4])
    changed = np.where(np.arange(COUNT) < 72, first, second)
    before, after = (applied(effect, values, time, s) for s in (first, changed))
    np.testing.assert_allclose(before[:72], after[:72], rtol=0, atol=1e-10)
    assert np.abs(np.asarray(before - after)[72:]).max() > 0.1


@pytest.mark.parametrize("name", STEPPED)
@pytest.mark.parametrize("start", [-40.0, 1e5])
def test_only_differences_of_time_count(x64, name, start):
    effect, values = CASES[name]
    _, time, h = course(9)
    here, there = (applied(effect, values, t, h) for t in (time, time + start))
    np.testing.assert_allclose(here, there, rtol=0, atol=1e-6)


@pytest.mark.parametrize("name", STEPPED)
def test_samples_on_straight_lines_change_nothing(x64, name):
    effect, values = CASES[name]
    _, time, h = polyline(10)
    more = np.sort(np.concatenate([time, (time[1:] + 3 * time[:-1]) / 4]))
    fine = applied(effect, values, more, np.interp(more, time, h))
    coarse = applied(effect, values, time, h)
    np.testing.assert_allclose(fine[::2], coarse, rtol=0, atol=1e-10)


@pytest.mark.parametrize("name", [name for name in STEPPED if name != "delay"])
def test_one_sample_at_a_time_is_the_whole_course(x64, name):
    effect, values = CASES[name]
    _, time, h = (part[:25] for part in polyline(11))
    state, got = effect.at(values).init(jnp.asarray(h[0])), []
    step = jax.jit(lambda *arguments: effect.at(values).step(*arguments))
    for dt, value in zip(np.diff(time, prepend=0.0), h, strict=True):
        state, out = step(state, jnp.asarray(value), jnp.asarray(dt))
        got.append(float(out))
    np.testing.assert_allclose(got, applied(effect, values, time, h), rtol=1e-9)


@pytest.mark.parametrize(
    ("name", "parameter"), [(name, key) for name, (_, values) in CASES.items() for key in values]
)
def test_derivatives_against_finite_differences(x64, name, parameter):
    values = CASES[name][1]
    _, time, h = course(12)

    @jax.jit
    def at(value):
        return output_of(name, values | {parameter: value}, time, h)

    here = values[parameter]
    got = jax.jvp(at, (here,), (1.0,))[1]
    step = 1e-5 * here
    expected = (at(here + step) - at(here - step)) / (2 * step)
    scale = np.abs(expected).max()
    assert scale > 0
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-6 * scale)


@pytest.mark.parametrize("name", CASES)
def test_derivatives_are_finite_at_rest_and_at_the_first_sample(name):
    """A first sample has no step before it, and a rest has no slope: 0/0 must not come through."""
    values = CASES[name][1]
    time, h = np.arange(COUNT) * 0.05, np.full(COUNT, 2.0)
    moves = tuple(values.values())
    out = jax.jvp(
        jax.jit(lambda *v: output_of(name, dict(zip(values, v, strict=True)), time, h)),
        moves,
        (1.0,) * len(moves),
    )
    assert np.isfinite(out[0]).all()
    assert np.isfinite(out[1]).all()


# --- the library's texts, bounds and names ---


@pytest.mark.parametrize("kind", BUILT_IN)
def test_every_effect_explains_itself(kind):
    effect = kind()
    for text in (effect.physics, effect.source, effect.signature, effect.experiment):
        assert len(text) > 20
    assert isinstance(effect, PLACES)
    assert effect.place in ("input", "hysteresis", "weights", "output", "added")
    assert effect.confused_with
    assert effect.name not in effect.confused_with
    parameters = list(effect.parameters())
    if isinstance(effect, AddedEffect | SensorEffect):
        parameters += effect.coefficients()
    assert parameters
    for parameter in parameters:
        assert parameter.unit
        assert parameter.meaning
        assert parameter.name.endswith("_s") == (parameter.unit == "s")


def test_what_is_confused_is_confused_both_ways():
    effects = library()
    for name, effect in effects.items():
        for other in effect.confused_with:
            if other in effects and name != "aux:COL":
                assert name in effects[other].confused_with, (
                    f"add {name!r} to confused_with of {other!r}"
                )


@pytest.mark.parametrize("kind", BUILT_IN)
@given(
    steps=st.integers(50, 1_000_000),
    step_s=st.floats(1e-7, 100.0, allow_nan=False),
)
def test_bounds_follow_the_time_scales_of_a_record(kind, steps, step_s):
    duration = steps * step_s
    effect = kind().bound_to(Survey(duration_s=duration, step_s=step_s))
    assert effect.name == kind().name
    for parameter in effect.parameters():
        assert parameter.low < parameter.high
        assert parameter.start
        for start in parameter.start:
            assert parameter.low <= start <= parameter.high
        if parameter.unit == "s":
            assert parameter.low >= step_s / 10
            assert parameter.high <= 30 * duration
    if isinstance(effect, Creep):
        tau = np.array(effect.tau_s)
        assert len(tau) >= 2
        assert tau[0] >= step_s
        assert tau[-1] == pytest.approx(duration)
        np.testing.assert_allclose(np.diff(np.log(tau)), np.log(tau[1] / tau[0]), rtol=1e-6)


@pytest.mark.parametrize("kind", BUILT_IN)
def test_settings_make_the_same_effect_again(kind):
    effect = kind().bound_to(Survey(24.0, 5e-4))
    again = kind(**effect.settings())
    assert again.parameters() == effect.parameters()
    assert again.settings() == effect.settings()


@given(st.floats(-50, 50), st.floats(0.01, 100), st.floats(-200, 200))
def test_search_coordinates_go_back_and_stay_inside(low, width, value):
    plain = Parameter("gain", "1", low, low + width)
    assert plain.from_search(plain.to_search(value)) == min(max(value, low), low + width)
    times = Parameter("tau_s", "s", 0.1, 0.1 + width, log=True)
    assert 0.1 <= times.from_search(value) <= 0.1 + width
    inside = min(0.1 + abs(value) / 10, 0.1 + width)
    assert times.from_search(times.to_search(inside)) == pytest.approx(inside)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"low": 1.0, "high": 1.0}, "below the upper"),
        ({"low": float("nan"), "high": 1.0}, "below the upper"),
        ({"low": 0.0, "high": 1.0, "log": True}, "positive bound"),
    ],
)
def test_a_parameter_needs_bounds(options, says):
    with pytest.raises(ValueError, match=says):
        Parameter("tau_s", "s", **options)


@given(st.floats(1e-6, 1.0), st.floats(1.5, 1e6), st.floats(0.5, 4))
def test_log_grid_is_even_from_end_to_end(low, ratio, per_decade):
    grid = np.array(log_grid(low, low * ratio, per_decade))
    assert grid[0] == pytest.approx(low)
    assert grid[-1] == pytest.approx(low * ratio)
    np.testing.assert_allclose(np.diff(np.log(grid)), np.log(ratio) / (len(grid) - 1), rtol=1e-6)
    asked = per_decade * np.log10(ratio)
    assert len(grid) - 1 == max(1, round(asked))


def test_effects_are_found_by_name():
    chosen = resolve(["creep", Delay(), "aux:load_N"], {"load_N": "N", "temp_C": "C"})
    assert [effect.name for effect in chosen] == ["creep", "delay", "aux:load_N"]
    assert isinstance(chosen[2], Auxiliary)
    assert chosen[2].coefficients()[0].unit == "{z}/N"
    assert Auxiliary(column="x", unit="").coefficients()[0].unit == "{z}/1"


class Own(Delay):
    name = "own"


@pytest.mark.parametrize(
    ("asked", "says"),
    [
        (["crep"], "no effect 'crep'; did you mean 'creep'.*give one of .*drift"),
        (["quantum"], "no effect 'quantum'; give one of "),
        (["creep", "creep"], "'creep' is asked for twice"),
        ([Delay(), "delay"], "'delay' is asked for twice"),
        (["aux:load_N"], "needs the auxiliary column 'load_N'.*loaded: temp_C.*--aux load_N"),
        (["aux:COL"], "needs the auxiliary column 'COL'"),
        (["own"], "no effect 'own'"),
    ],
)
def test_what_cannot_be_had_is_named(asked, says):
    with pytest.raises(InputError, match=says):
        resolve(asked, {"temp_C": "C"})


def test_effects_of_ones_own_are_found_by_name_when_known():
    assert isinstance(resolve(["own"], {}, known=[Own()])[0], Own)


def test_an_installed_package_adds_its_effects(monkeypatch):
    library_module = importlib.import_module("preisach_jax.effects")
    point = importlib.metadata.EntryPoint("own", f"{__name__}:Own", library_module.ENTRY_POINTS)

    def points(group):
        return [point] if group == library_module.ENTRY_POINTS else []

    monkeypatch.setattr(library_module, "entry_points", points)
    assert set(library()) == {kind().name for kind in BUILT_IN} | {"own"}
    assert type(library()["own"]).__name__ == "Own"


@pytest.mark.parametrize(
    ("base", "method", "arguments"),
    [
        (InputEffect, "init", 1),
        (OutputEffect, "step", 3),
        (WeightEffect, "factor", 1),
        (AddedEffect, "columns", 1),
        (AddedEffect, "coefficients", 0),
    ],
)
def test_what_an_effect_must_have_is_said(base, method, arguments):
    class Unfinished(base):
        name = "unfinished"

    with pytest.raises(
        EffectError, match=rf"the class of the effect 'unfinished', .*write {method}"
    ):
        getattr(Unfinished(), method)(*[None] * arguments)

"""Each effect against an oracle of other make: SciPy's linear systems, closed forms, limits."""

import importlib
import importlib.metadata

import acting
import hypothesis.strategies as st
import jax
import numpy as np
import pytest
from acting import applied
from effects_table import (
    ALIKE,
    CASES,
    COUNT,
    ELSEWHERE,
    ROUNDED,
    STEPPED,
    TICK,
    course,
)  # fmt: skip
from hypothesis import given, settings
from scipy import signal
from test_modes import TWO, plays, through

import preisach_jax as pj
from preisach_jax import (
    AddedEffect,
    HysteresisEffect,
    InputError,
    Parameter,
    SensorEffect,
    Survey,
    WeightEffect,
)
from preisach_jax.chain.description import PLACES
from preisach_jax.effects import BUILT_IN, column_of, library, placeholder, resolve
from preisach_jax.effects.auxiliary import Auxiliary
from preisach_jax.effects.creep import Creep
from preisach_jax.effects.delay import Delay
from preisach_jax.effects.gain import Gain
from preisach_jax.effects.hum import Hum
from preisach_jax.effects.input_lag import InputLag
from preisach_jax.effects.input_quantisation import InputQuantisation
from preisach_jax.effects.modal import MOST_MODES
from preisach_jax.effects.output_lag import OutputLag
from preisach_jax.effects.output_nonlinearity import OutputNonlinearity
from preisach_jax.effects.resonance import Resonance
from preisach_jax.effects.slew_limit import SlewLimit


def output_of(effect, values, time, course):
    """What an effect does to a record, whose course is that of its auxiliary column as well."""
    drives = acting.signals(time, course, {"c": course})
    if isinstance(effect, WeightEffect):
        return acting.factor(effect, values, drives)
    if isinstance(effect, HysteresisEffect):
        return acting.inside(effect, values, drives)
    if isinstance(effect, AddedEffect | SensorEffect):
        sensor = isinstance(effect, SensorEffect)
        if sensor and effect.converts:
            return effect.at(values).converted(drives.input)
        return acting.columns(effect, values, drives.input if sensor else drives)
    return applied(effect, values, time, course)


@pytest.mark.parametrize(
    ("name", "precision"),
    [*((n, "float64") for n in CASES), *((n, "float32") for n in ROUNDED)],
    indirect=["precision"],
)
def test_an_effect_is_its_closed_form(precision, name):
    effect, values, oracle = CASES[name]
    ticks, time, v = course(1)
    expected = oracle(ticks, time, v, values)
    expected = np.stack(expected, axis=1) if isinstance(expected, list) else expected
    got = np.asarray(output_of(effect, values, time, v))
    assert got.dtype == precision
    assert got.size == expected.size
    # In single precision steps of time are rounded, and with them the phase of a mode.
    share = 1e-7 if precision == "float64" else 3e-2 if "resonance" in name else 1e-3
    share = 1e-3 if name == "slew_limit" else share  # the oracle takes steps
    away = np.abs(got.reshape(expected.shape) - expected).max(axis=0)
    assert (away <= share * np.maximum(np.ptp(expected, axis=0), 1e-3)).all(), away


def test_each_effect_has_a_row():
    assert {kind for kind in BUILT_IN if kind not in ELSEWHERE} == {
        type(case[0]) for case in CASES.values()
    }


@pytest.mark.parametrize("kind", [InputLag, OutputLag])
@pytest.mark.parametrize("tau", [0.0004, 0.011])
def test_a_filter_of_samples_is_that_of_scipy(x64, kind, tau):
    values = course(7, 1)[2]
    share = -np.expm1(-TICK / tau)
    start = signal.lfilter_zi([share], [1.0, share - 1.0]) * values[0]
    expected = signal.lfilter([share], [1.0, share - 1.0], values, zi=start)[0]
    got = applied(kind(of_samples=True), {"tau_s": tau}, TICK * np.arange(COUNT), values)
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-12)


def test_resonance_follows_a_ramp_after_a_long_gap(x64):
    time = np.array([0.0, 1e6, 2e6])
    got = applied(Resonance(), {"f_hz": 5.0, "zeta": 0.1}, time, 3.0 * time)
    np.testing.assert_allclose(got[1:], 3.0 * (time[1:] - 0.2 / (2 * np.pi * 5.0)), rtol=1e-12)


# --- laws of all ---


@pytest.mark.parametrize("name", STEPPED)
def test_only_differences_of_time_and_corners_of_the_course_count(x64, name):
    effect, values, _ = CASES[name]
    _, time, h = course(10)
    more = np.sort(np.concatenate([time, (time[1:] + 3 * time[:-1]) / 4]))[:COUNT]
    coarse = applied(effect, values, time, h)
    fine = applied(effect, values, more + 1e5, np.interp(more, time, h))
    np.testing.assert_allclose(fine[::2], coarse[: COUNT // 2], rtol=0, atol=1e-6)


@pytest.mark.parametrize("name", [name for name in STEPPED if name != "delay"])
def test_one_sample_at_a_time_is_the_whole_course(x64, name):
    effect, values, _ = CASES[name]
    _, time, h = course(11)
    state, got = jax.jit(effect.at(values).init)(h[0]), []
    step = jax.jit(effect.at(values).step)
    for dt, value in zip(np.diff(time, prepend=0.0)[:25], h[:25], strict=True):
        state, out = step(state, value, dt)
        got.append(float(out))
    np.testing.assert_allclose(got, applied(effect, values, time, h)[:25], rtol=1e-9)


@pytest.mark.parametrize("name", [n for n, case in CASES.items() if case[1] and n not in ALIKE])
def test_derivatives_are_those_of_finite_differences_and_finite_at_rest(x64, name):
    """A first sample has no step before it, and a rest has no slope: 0/0 must not come through."""
    effect, values, _ = CASES[name]
    _, time, h = course(12, 1)

    @jax.jit
    def moved(values, moves, course):
        return jax.jvp(lambda own: output_of(effect, own, time, course), (values,), (moves,))

    for parameter, here in values.items():
        moves = acting.arrays(dict.fromkeys(values, 0.0) | {parameter: 1.0})
        step = 1e-5 * here
        ends = [
            np.asarray(moved(acting.arrays(values | {parameter: here + side}), moves, h)[0])
            for side in (step, -step)
        ]
        expected = (ends[0] - ends[1]) / (2 * step)
        got = np.asarray(moved(acting.arrays(values), moves, h)[1])
        scale = np.abs(expected).max()
        assert scale > 0
        np.testing.assert_allclose(got, expected, rtol=0, atol=1e-6 * scale)
        for part in moved(acting.arrays(values), moves, np.full(COUNT, 2.0)):
            assert np.isfinite(np.asarray(part)).all()


# --- the library's texts, bounds and names ---


@pytest.mark.parametrize("kind", BUILT_IN)
def test_every_effect_explains_itself(kind):
    effect = kind()
    for text in (effect.physics, effect.source, effect.signature, effect.experiment):
        assert len(text) > 20
    assert isinstance(effect, PLACES)
    parameters = list(effect.parameters())
    if isinstance(effect, AddedEffect | SensorEffect):
        parameters += effect.coefficients()
    assert parameters
    for parameter in parameters:
        assert parameter.unit
        assert parameter.meaning
        assert parameter.name.endswith("_s") == (parameter.unit == "s")
    effects = library()
    assert effect.confused_with
    for other in effect.confused_with:
        if other in effects and effect.name != "aux:COL":
            assert effect.name in effects[other].confused_with


@pytest.mark.parametrize("kind", BUILT_IN)
@settings(max_examples=10)
@given(steps=st.integers(50, 1_000_000), step_s=st.floats(1e-7, 100.0, allow_nan=False))
def test_bounds_follow_the_time_scales_of_a_record(kind, steps, step_s):
    duration = steps * step_s
    survey = Survey(duration_s=duration, step_s=step_s)
    effect = kind().bound_to(survey)
    for each in (effect, *kind().variants(survey)):
        assert type(each)(**each.settings()) == each
        names = [parameter.name for parameter in each.parameters()]
        assert len(set(names)) == len(names)
        for parameter in each.parameters():
            assert parameter.low < parameter.high
            assert parameter.start
            for start in parameter.start:
                assert parameter.low <= start <= parameter.high
            if parameter.unit == "s" and each is effect:
                assert parameter.low >= step_s / 10
                assert parameter.high <= 30 * duration
    if isinstance(effect, Creep):
        tau = np.array(effect.tau_s)
        assert len(tau) >= 2
        assert tau[0] >= step_s
        assert tau[-1] == pytest.approx(duration)
        np.testing.assert_allclose(np.diff(np.log(tau)), np.log(tau[1] / tau[0]), rtol=1e-6)


def test_bounds_and_starts_come_from_the_record():
    f, _ = Resonance().bound_to(Survey(24.0, 5e-4)).parameters()
    assert (f.low, f.high) == pytest.approx((2 / 24.0, 0.45 / 5e-4))
    bound = Gain("T", "K").bound_to(Survey(10.0, 0.01, aux={"T": np.array([20.0, 26.0, 24.0])}))
    gain, *_ = bound.parameters()
    assert (bound.middle, bound.span, gain.low, gain.high) == pytest.approx((23, 6, -1 / 3, 1 / 3))
    time, u = np.array([0.0, 0.1, 0.3, 0.4]), np.array([0.0, 1.0, -3.0, -3.0])
    (slew,) = SlewLimit().bound_to(Survey(0.4, 0.1, time, u)).parameters()
    assert (slew.unit, slew.low, slew.high) == ("{u}/s", *map(pytest.approx, (0.4, 20.0)))
    for u in ([], [2.0], [2.0, 2.0]):  # no motion
        values = np.array(u)
        still = Survey(1.0, 0.1, np.arange(len(u)) * 1.0, values, values, values)
        assert SlewLimit().bound_to(still) == SlewLimit()
        assert InputQuantisation().bound_to(still) == InputQuantisation()


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
        ({"low": float("nan"), "high": 1.0}, "below the upper"),
        ({"low": 2.0, "high": 1.0}, "'tau_s' has bounds 2.0 and 1.0.*below the upper"),
        ({"low": 0.0, "high": 1.0, "log": True}, "positive bound"),
    ],
)
def test_a_parameter_needs_bounds(options, says):
    with pytest.raises(InputError, match=says):
        Parameter("tau_s", "s", **options)


class Own(Delay):
    name = "own"


def test_effects_are_found_by_name(monkeypatch):
    chosen = resolve(["creep", Delay(), "aux:load_N"], {"load_N": "N", "temp_C": "C"})
    assert [effect.name for effect in chosen] == ["creep", "delay", "aux:load_N"]
    assert isinstance(chosen[2], Auxiliary)
    assert chosen[2].coefficients()[0].unit == "{z}/N"
    assert Auxiliary(column="x", unit="").coefficients()[0].unit == "{z}/1"
    assert resolve(["gain:T"], {"T": "K"})[0].parameters()[0].unit == "1/K"
    assert (placeholder("gain:a:b"), placeholder("own:x")) == ("gain:COL", "own:x")
    assert (column_of("cross:y_V"), column_of("viscosity")) == ("y_V", "")
    assert isinstance(resolve(["own"], {}, known=[Own()])[0], Own)
    # An installed package adds its own.
    library_module = importlib.import_module("preisach_jax.effects")
    point = importlib.metadata.EntryPoint("own", f"{__name__}:Own", library_module.ENTRY_POINTS)
    monkeypatch.setattr(library_module, "entry_points", lambda group: [point])
    assert set(library()) == {kind().name for kind in BUILT_IN} | {"own"}


@pytest.mark.parametrize(
    ("asked", "says"),
    [
        (["crep"], "no effect 'crep'; did you mean 'creep'.*give one of .*drift"),
        (["quantum"], "no effect 'quantum'; give one of "),
        ([Delay(), "delay"], "'delay' is asked for twice"),
        (["aux:load_N"], "needs the auxiliary column 'load_N'.*loaded: temp_C.*--aux load_N"),
        (["gain:T"], "'gain:T' needs the auxiliary column 'T'"),
    ],
)
def test_what_cannot_be_had_is_named(asked, says):
    with pytest.raises(InputError, match=says):
        resolve(asked, {"temp_C": "C"})


# --- lines in a spectrum, and hum ---


def humming(f, amplitude=0.1, rate=1000.0, seconds=12.0, rows=4000, more=(), height=0.0):
    """What a record with a hum shows of itself where it is thinned, and the residual red."""
    rng = np.random.default_rng(7)
    count = round(seconds * rate)
    kept = np.sort(rng.permutation(count)[:rows])
    red = signal.lfilter([1.0], [1.0, -0.999], rng.normal(size=count))[kept]
    time = kept / rate
    residual = 0.003 * red + amplitude * np.sin(2 * np.pi * f * time + 1.0)
    others = np.cos(2 * np.pi * np.outer(time, more) + np.arange(len(more)))
    return Survey(seconds, 1 / rate, time, time, time, residual + height * others.sum(axis=1))


TEETH = 17.3 + 1.3 * np.arange(1, 6)


@pytest.mark.parametrize(
    ("f", "more", "height", "seen"),
    [
        (0.8, (), 0.0, False),  # slow waves are a drift that wanders
        (17.3, TEETH, 0.1, False),  # what repeats with the input leaves many lines of one height
        (17.3, TEETH, 0.03, True),
        (50.02, (100.04, 150.06, 200.08, 23.4, 37.7), 0.08, True),  # multiples and two strangers
    ],
)
def test_hum_starts_at_the_line_of_the_residual(f, more, height, seen):
    effect = Hum().bound_to(humming(f, more=more, height=height))
    if not seen:
        assert effect.starts_hz == (50.0, 60.0)
        return
    assert effect.starts_hz[0] == pytest.approx(f, abs=0.1 / 12.0)  # a tenth of a turn at the end
    for mains in (50.0, 60.0):
        assert min(abs(start / mains - 1) for start in effect.starts_hz) < 0.01
    (parameter,) = effect.parameters()
    assert parameter.low == pytest.approx(0.99 * min(effect.starts_hz))
    assert parameter.high == pytest.approx(1.01 * max(effect.starts_hz))


def test_hum_and_its_harmonics_stay_below_half_the_sampling_rate():
    effect = Hum().bound_to(humming(55.0, 9.0, 300.0, seconds=10.0, rows=2500))
    assert effect.starts_hz[0] == pytest.approx(55.0, rel=1e-3)
    assert (effect.harmonics, len(effect.coefficients())) == (2, 4)
    noise, time = np.random.default_rng(8).normal(size=500), np.arange(500.0)
    slow = Hum().bound_to(Survey(499.0, 1.0, time, noise, noise, noise))
    assert (slow.starts_hz, slow.harmonics) == ((0.225,), 2)
    # A record of any length is searched on a raster that is bounded.
    time = np.sort(np.random.default_rng(9).uniform(0.0, 1e6, 3000))
    long = Survey(1e6, 1e-3, time, time, time, np.sin(2 * np.pi * 0.02 * time))
    assert Hum().bound_to(long).starts_hz[0] == pytest.approx(0.02, rel=1e-5)


# --- modes ---


def test_no_effect_has_more_than_the_most_modes():
    rng = np.random.default_rng(3)
    time, u = np.arange(2000) / 1000, rng.normal(size=2000)
    survey = Survey(2.0, 1e-3, time, u, u, through(u, TWO) - 1.6 * u)
    effect, values = Resonance().bound_to(survey), {"f_hz": 35.0, "zeta": 0.03}
    assert [p.name for p in effect.parameters()] == ["f_hz", "zeta"]
    for modes in range(2, MOST_MODES + 1):
        found = effect.enlarged(survey, values)
        assert found is not None
        effect, values = found[0], found[1][0]
        assert effect.modes == modes
        assert all(set(start) == {p.name for p in effect.parameters()} for start in found[1])
    assert effect.enlarged(survey, values) is None


# --- steps of the input's converter ---


def stepping(step, seed, lattice=None, holds=0):
    """Survey of a record whose drive has steps that the recorded input does not show."""
    rng = np.random.default_rng(seed)
    time = np.sort(rng.uniform(0.0, 20.0, 8000))
    u = 30.0 + 35.0 * np.sin(2.1 * time) * np.sin(0.37 * time + 0.5)
    for begin in rng.uniform(0.0, 19.0, holds):
        held = (time >= begin) & (time < begin + 0.7)
        u[held] = u[held][0]
    if lattice is not None:
        u = lattice * np.round(u / lattice)
    error = step * (np.round(u / step) - u / step) * (0.6 + 0.2 * np.sin(u / 20))
    residual = error + 0.1 * step * rng.normal(size=8000) + step * np.sin(u / 9.0)
    return Survey(20.0, 2.5e-3, time, u, u, residual)


@pytest.mark.parametrize(
    ("step", "seed", "options"),
    [
        (75 / 256.3, 12, {"holds": 9}),
        (75 / 4095.0, 11, {}),
        (75 / 256.0, 14, {"lattice": 0.01}),  # beside a finer lattice of the record
    ],
)
def test_steps_of_the_input_are_found_to_a_small_part_of_one_over_the_range(step, seed, options):
    survey = stepping(step, seed, **options)
    effect = InputQuantisation().bound_to(survey)
    best = min(effect.starts, key=lambda start: abs(start - step))
    assert abs(best / step - 1) * np.ptp(survey.input) / step < 0.03
    assert len(effect.starts) <= 2
    (parameter,) = effect.parameters()
    assert parameter.low == pytest.approx(0.995 * min(effect.starts))
    assert parameter.high == pytest.approx(1.005 * max(effect.starts))


# --- a sensor with ripples ---


@pytest.mark.parametrize(("waves", "falls"), [(3.0, 3.0), (0.0, 1.2)])
def test_ripples_are_taken_only_where_a_cubic_does_not_follow(waves, falls):
    rng = np.random.default_rng(14)
    t = np.arange(3000) / 100
    u = 5 + 4.9 * np.sin(3 * t) * np.cos(0.37 * t)
    h = plays(u, np.linspace(0.0, 3.0, 60), 1.0) - 0.5 * u
    x = (h - h.min()) / np.ptp(h) - 0.5
    bend = 0.03 * np.sin(2 * np.pi * waves * x) if waves else 0.8 * (x**3 - x / 4)
    z = h + np.ptp(h) * (bend + 1e-4 * rng.normal(size=len(h)))
    record = pj.Record.from_arrays(t, u, z)
    plain, fit = (pj.fit(record, names, levels=9) for names in ((), ["output_nonlinearity"]))
    (effect,) = fit.model.effects
    assert isinstance(effect, OutputNonlinearity)
    assert (effect.half_waves > 0) == (waves > 0)
    assert fit.rms_validation < plain.rms_validation / falls

"""Effects of machines: velocity, scaled loops, other axes, leakage, and logarithmic widening."""

from dataclasses import replace
from typing import Any

import acting
import jax.numpy as jnp
import machines
import numpy as np
import pytest
import world
from acting import signals
from scipy import signal

import preisach_jax as pj
from preisach_jax.chain import Chain, Coefficients, response, tangents
from preisach_jax.chain.output import columns_beside
from preisach_jax.effects import column_of, library, placeholder, resolve
from preisach_jax.effects.base import Survey
from preisach_jax.effects.cross import Cross
from preisach_jax.effects.gain import Gain
from preisach_jax.effects.input_lag import InputLag
from preisach_jax.effects.input_quantisation import InputQuantisation
from preisach_jax.effects.leakage import Leakage
from preisach_jax.effects.log_rate import LogRate
from preisach_jax.effects.speed_widening import SpeedWidening
from preisach_jax.effects.viscosity import Viscosity
from preisach_jax.errors import InputError
from preisach_jax.export.description import describe
from preisach_jax.operator.plane import Plane
from preisach_jax.plant import simulate_stage

TICK = 1e-3


def course(seed, count=150):
    """Uneven times on a raster of `TICK`, and a wandering signal."""
    rng = np.random.default_rng(seed)
    ticks = np.concatenate([[0], np.cumsum(rng.integers(1, 10, count - 1))])
    return ticks, ticks * TICK, 3.0 + np.cumsum(rng.normal(size=count))


def linear(ticks, values, numerator, denominator):
    """b(s)/a(s) of a course that is straight between samples, at rest before it, by SciPy."""
    raster = np.arange(ticks[-1] + 1)
    fine = np.interp(raster, ticks, values)
    system: Any = signal.TransferFunction(numerator, denominator)
    return signal.lsim(system, fine - fine[0], raster * TICK)[1][ticks]


# --- each against its oracle ---


def zigzag(seed, straight=5):
    """The same times, and a signal that goes straight over so many intervals."""
    ticks, time, u = course(seed)
    return ticks, time, np.interp(time, time[::straight], u[::straight])


@pytest.mark.parametrize("tau", [0.0005, 0.02, 1.0])
def test_the_speed_is_a_filtered_derivative(x64, tau):
    ticks, time, u = zigzag(1)
    got = acting.columns(Viscosity(), {"tau_s": tau}, signals(time, u))[:, 0]
    expected = linear(ticks, u, [1.0, 0.0], [tau, 1.0])
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-8 * np.abs(expected).max())


def test_the_speed_of_a_smooth_course_is_not_late(x64):
    rng = np.random.default_rng(8)
    time = np.cumsum(rng.uniform(0.8e-3, 1.2e-3, 2000))
    got = acting.columns(Viscosity(), {"tau_s": 1e-6}, signals(time, np.sin(40 * time)))[:, 0]
    wrong = got - 40 * np.cos(40 * time)
    late = np.diff(np.sin(40 * time)) / np.diff(time) - 40 * np.cos(40 * time[1:])
    assert np.sqrt(np.mean(wrong[3:] ** 2)) < 0.1 * np.sqrt(np.mean(late**2))


def test_viscosity_has_a_viscous_a_dry_and_a_rising_part(x64):
    ticks, time, u = zigzag(2)
    values = {"tau_s": 0.01, "speed": 120.0, "stribeck_speed": 300.0}
    effect = Viscosity(fastest=1000.0, saturates=True, stribeck=True)
    got = acting.columns(effect, values, signals(time, u))
    w = linear(ticks, u, [1.0, 0.0], [0.01, 1.0])
    dry = np.tanh(w / 120.0)
    expected = np.stack([w, dry, dry * np.exp(-np.abs(w) / 300.0)], axis=1)
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-6)
    assert [c.name for c in effect.coefficients()] == ["viscous", "saturating", "stribeck"]


def test_speeds_are_looked_for_in_shares_of_the_fastest():
    effect = Viscosity(fastest=1000.0, saturates=True, stribeck=True)
    _, scale, decay = effect.parameters()
    assert (scale.low, scale.high, *scale.start) == pytest.approx((1, 3000, 30, 120, 500))
    assert (decay.low, decay.high, *decay.start) == pytest.approx((10, 1000, 100, 400))


def test_gain_is_one_in_the_middle_and_monotone_over_the_range(x64):
    column = np.linspace(-2.0, 6.0, 81)
    effect = Gain("T", "K", 1e-9, 1.0, middle=2.0, span=8.0)
    time = np.arange(81.0)
    for bend in (-1.0, 0.0, 0.4, 1.0):
        values = {"gain": 0.1, "curvature": bend, "tau_s": 1e-9}
        factor = np.asarray(acting.factor(effect, values, signals(time, column, {"T": column})))
        x = (column - 2.0) / 8.0
        np.testing.assert_allclose(factor, 1 + 0.8 * (x + bend * (x**2 - 0.25)), atol=1e-7)
        assert (np.diff(factor) >= -1e-12).all()
        np.testing.assert_allclose(factor[[0, -1]], [0.6, 1.4], atol=1e-7)


def test_gain_follows_its_column_late(x64):
    ticks, time, column = course(3)
    effect = Gain("T", "K", 1e-9, 1.0, middle=0.0, span=1.0)
    values = {"gain": 0.01, "curvature": 0.0, "tau_s": 0.05}
    got = acting.factor(effect, values, signals(time, column, {"T": column}))
    late = column[0] + linear(ticks, column, [1.0], [0.05, 1.0])
    np.testing.assert_allclose(got, 1 + 0.01 * late, rtol=0, atol=1e-9)


def test_gain_is_bound_to_the_range_of_its_column():
    survey = Survey(10.0, 0.01, aux={"T": np.array([20.0, 26.0, 24.0])})
    bound = Gain("T", "K").bound_to(survey)
    assert (bound.middle, bound.span) == (23.0, 6.0)
    gain, *_ = bound.parameters()
    assert (gain.low, gain.high) == pytest.approx((-1 / 3, 1 / 3))


@pytest.mark.parametrize("tau", [0.02, 5.0])
def test_leakage_is_a_high_pass(x64, tau):
    ticks, time, h = course(4)
    got = acting.applied(Leakage(), {"tau_s": tau}, time, h)
    np.testing.assert_allclose(got, linear(ticks, h, [tau, 0.0], [tau, 1.0]), rtol=0, atol=1e-9)


@pytest.mark.parametrize(("f", "zeta"), [(3.0, 0.05), (60.0, 0.5)])
def test_cross_is_a_mode_of_another_axis(x64, f, zeta):
    ticks, time, axis = course(5)
    drives = signals(time, 0 * time, {"y": axis})
    got = acting.columns(Cross("y", "V"), {"f_hz": f, "zeta": zeta}, drives)
    w = 2 * np.pi * f
    expected = axis[0] + linear(ticks, axis, [w * w], [1.0, 2 * zeta * w, w * w])
    np.testing.assert_allclose(got[:, 0], expected, rtol=0, atol=1e-6)


def test_log_rate_widens_by_a_constant_for_a_decade(x64):
    time = np.arange(5.0)
    effect = LogRate(reference_per_s=7.0, range_u=10.0, with_corners=True)
    values = {"coefficient": 0.3, "slow_speed": 1e-3}
    widths = [
        float(effect.at(values).widening(jnp.asarray(rate * time), jnp.asarray(time))[2])
        for rate in (1.0, 10.0, 100.0, 0.0)
    ]
    np.testing.assert_allclose(np.diff(widths[:3]), 0.3, rtol=2e-3)
    assert widths[3] == 0.0
    forms = LogRate().variants(Survey(4.0, 1.0, time, time, time))
    assert {type(form) for form in forms} == {LogRate}
    assert isinstance(forms[0], SpeedWidening)


# --- in a chain ---


@pytest.fixture
def damper(x64):
    """A chain in which a column scales a loop and a viscosity behind a lag of the input, and an
    auxiliary signal stays."""
    _, time, u = course(6, 400)
    column = 1 + np.sin(time)
    plane = Plane(5, float(u.min()), float(u.max()))
    gain = Gain("c", "A", 1e-9, 1.0, middle=1.0, span=2.0)
    chain = Chain(plane, (InputLag(), gain, Viscosity(), Cross("y", "V")))
    values = {
        "input_lag": {"tau_s": 0.015},
        "gain:c": {"gain": 0.6, "curvature": 0.3, "tau_s": 0.03},
        "viscosity": {"tau_s": 0.02},
        "cross:y": {"f_hz": 9.0, "zeta": 0.3},
    }
    rng = np.random.default_rng(0)
    own = Coefficients(
        rng.uniform(size=plane.cells), np.zeros(plane.cells), 0.7, np.array([0.3, 0.2, 5.0])
    )
    return chain, values, signals(time, u, {"c": column, "y": np.cos(3 * time)}), own


def test_what_scales_the_loop_scales_the_viscosity_and_nothing_else(damper):
    chain, values, drives, own = damper
    names = [(effect, each.name) for effect, each in chain.coefficients]
    assert names == [("viscosity", "viscous"), ("cross:y", "gain"), ("gain:c", "shift")]
    lag, gain, viscosity, cross = chain.effects
    unloaded = chain.with_effects((lag,))
    bare = np.asarray(response(unloaded, values, drives, replace(own, added=np.zeros(0))))
    factor = np.asarray(acting.factor(gain, values["gain:c"], drives))
    path = acting.applied(lag, values["input_lag"], drives.time, drives.input)
    moving = signals(drives.time, path)
    speed = np.asarray(acting.columns(viscosity, values["viscosity"], moving))[:, 0]
    axis = np.asarray(acting.columns(cross, values["cross:y"], drives))[:, 0]
    shift = (factor - 1) / values["gain:c"]["gain"]
    expected = factor * (bare - 0.7 + 0.3 * speed) + 0.7 + 0.2 * axis + 5.0 * shift
    np.testing.assert_allclose(response(chain, values, drives, own), expected, rtol=1e-9)


def test_steps_of_a_converter_have_no_speed(damper):
    chain, values, drives, _ = damper
    coarse = chain.with_effects((*chain.effects, InputQuantisation(quantum=0.5)))
    known = values | {"input_quantisation": {"step": 0.5}}
    smooth, stepped = (
        columns_beside(each, known, drives, {})["viscosity"] for each in (chain, coarse)
    )
    np.testing.assert_array_equal(smooth, stepped)


MOVED = (
    ("input_lag", "tau_s"),
    ("gain:c", "gain"),
    ("gain:c", "tau_s"),
    ("viscosity", "tau_s"),
    ("cross:y", "f_hz"),
)


@pytest.mark.parametrize(("effect", "name"), MOVED)
def test_tangents_are_those_of_finite_differences(damper, effect, name):
    chain, values, drives, own = damper
    got = tangents(chain, values, drives, own, [(effect, name)])[:, 0]
    here = values[effect][name]

    def at(value):
        return response(chain, values | {effect: values[effect] | {name: value}}, drives, own)

    expected = (at(here * (1 + 1e-5)) - at(here * (1 - 1e-5))) / (2e-5 * here)
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-5 * np.abs(expected).max())


# --- names ---


def test_names_of_columns():
    assert placeholder("gain:a:b") == "gain:COL"
    assert placeholder("own:x") == "own:x"
    assert column_of("cross:y_V") == "y_V"
    assert column_of("viscosity") == ""
    assert {"gain:COL", "cross:COL", "viscosity", "leakage", "log_rate"} <= set(library())
    (effect,) = resolve(["gain:T"], {"T": "K"})
    assert effect.parameters()[0].unit == "1/K"
    with pytest.raises(InputError, match="'gain:T' needs the auxiliary column 'T'"):
        resolve(["gain:T"], {})


def test_a_constant_column_scales_nothing():
    time = np.arange(300) / 50
    u = np.sin(time * (1 + time / 9))
    record = pj.Record.from_arrays(time, u, u, aux={"T": np.full(300, 20.0)})
    with pytest.raises(InputError, match="column T: the auxiliary column is constant"):
        pj.fit(record, ["gain:T"], levels=5)


# --- hidden, and not hidden ---

RIVALS = [
    "creep", "input_lag", "output_lag", "delay", "drift", "ageing", "rate_dependence",
    "aux:COL", "viscosity", "gain:COL", "cross:COL", "leakage", "log_rate",
]  # fmt: skip


def diagnosed(made, rivals=RIVALS, levels=25):
    record = pj.Record.from_arrays(
        made["t"], made["x"], made["z"], aux=made["aux"], units={"input": "V", "output": "um"}
    )
    return pj.diagnose(record, rivals, levels=levels)


SEARCHES = [
    ("leakage", ["creep", "drift", "leakage"], 13),
    *(pytest.param(name, RIVALS, 25, marks=pytest.mark.campaign) for name in machines.EFFECTS),
]


@pytest.mark.parametrize(("effect", "rivals", "levels"), SEARCHES)
def test_what_is_hidden_is_found(effect, rivals, levels):
    found = diagnosed(machines.machine_record(effect, 1, 8.0, 1000.0), rivals, levels)
    assert found.effects == (effect,)
    assert found.ladder[-1].rms_validation < 0.3 * found.ladder[0].rms_validation


@pytest.mark.parametrize(
    "effect",
    [
        "none",
        pytest.param("output_lag", marks=pytest.mark.campaign),
        pytest.param("input_lag", marks=pytest.mark.campaign),
        pytest.param("creep", marks=pytest.mark.campaign),
    ],
)
def test_what_is_not_hidden_is_not_named(effect):
    made = world.hidden_record(effect, 4, 8.0, 1000.0)
    beside = machines.machine_record(None, 4, 8.0, 1000.0)
    found = diagnosed(made | {"aux": beside["aux"]})
    assert found.effects == (() if effect == "none" else (effect,))


@pytest.mark.parametrize(
    "name",
    [
        "mrdamper_mts_5mm3Hz",
        pytest.param("mrdamper_mts_25mm0x5Hz", marks=pytest.mark.campaign),
    ],
)
def test_a_damper_has_a_viscosity_that_its_coil_scales(name, shared_data):
    record = pj.Record.load(
        shared_data / f"{name}.csv", time="t", input="x", output="z", aux=["current_A"]
    )
    found = pj.fit(record, ["gain:current_A", "viscosity"])
    assert found.rms_validation < 0.03 * np.ptp(record.output)
    assert found.model.parameters["gain:current_A"]["gain"].low > 1.0
    assert found.model.parameters["viscosity"]["saturating"].low > 0


# --- what is made of a model ---


@pytest.fixture(scope="module")
def machine():
    made = machines.machine_record("viscosity", 2, 5.0, 500.0)
    record = pj.Record.from_arrays(made["t"], made["x"], made["z"], aux=made["aux"])
    return record, pj.fit(record, ["viscosity", "gain:temp_C"], levels=9).model


def test_a_model_is_saved_with_its_columns(machine, tmp_path):
    record, model = machine
    model.save(tmp_path / "model.json")
    again = pj.Model.load(tmp_path / "model.json")
    assert [effect.name for effect in again.effects] == ["viscosity", "gain:temp_C"]
    np.testing.assert_allclose(again.simulate(record), model.simulate(record), rtol=1e-12)
    bare = pj.Record.from_arrays(record.time, record.input, record.output)
    with pytest.raises(InputError, match="needs the auxiliary column 'temp_C'"):
        again.predict(bare)


def test_c_code_of_a_viscosity_is_refused_by_its_name(machine):
    _, model = machine
    with pytest.raises(InputError, match=r"no C code is known for the effect .*--without "):
        describe(model)


def test_a_scaled_loop_is_compensated_beforehand_and_not_from_sample_to_sample(machine):
    record, model = machine
    rows = slice(1000, 1400)
    wanted = pj.Record.from_arrays(
        record.time[rows], record.input[rows],
        30 + 5 * np.sin(record.time[rows]), aux={"temp_C": record.aux["temp_C"][rows]},
    )  # fmt: skip
    found = pj.compensate(model, wanted)
    assert found.reachable.mean() > 0.9
    off = (found.expected - wanted.output)[found.reachable]
    assert np.sqrt(np.mean(off**2)) < 2 * model.rms_validation
    with pytest.raises(InputError, match=r"gain:temp_C.*sample to sample"):
        pj.OnlineInverse(model, 500.0)


# --- the simulated stage ---


def both(effect, **more):
    settings: dict[str, Any] = {
        "seconds": 6.0,
        "rate_hz": 1000.0,
        "noise_um": 0.0,
        "encoder_step_um": 0.0,
    } | more
    hidden, bare = (simulate_stage(3, effects=e, **settings) for e in ((effect,), ()))
    (law,) = hidden.truth["parameters"].values()
    return hidden, bare.output, law


def test_the_stage_leaks():
    made, h, law = both("leakage")
    tau = law["tau_s"]
    expected = signal.lsim(([tau, 0.0], [tau, 1.0]), h - h[0], made.time)[1] + h[0]
    np.testing.assert_allclose(made.output, expected, rtol=0, atol=2e-3 * np.ptp(h))


def test_the_stage_warms():
    made, h, law = both("gain")
    factor = 1 + law["gain_per_C"] * (made.aux["temp_C"] - 20.0)
    np.testing.assert_allclose(made.output, h * factor, rtol=0, atol=1e-9)
    assert np.ptp(made.aux["temp_C"]) > 5.0


def test_another_axis_leaks_into_the_stage():
    made, h, law = both("cross")
    w, y = 2 * np.pi * law["f_hz"], made.aux["y_V"]
    mode = ([w * w], [1.0, 2 * law["zeta"] * w, w * w])
    expected = law["gain_um_per_V"] * signal.lsim(mode, y - y[0], made.time)[1]
    np.testing.assert_allclose(made.output - h, expected, rtol=0, atol=0.02 * np.ptp(expected))


def test_the_stage_resists_motion():
    drive = np.concatenate([np.linspace(0, 60, 2000), np.full(500, 60.0), np.linspace(60, 0, 500)])
    made, h, law = both("viscosity", drive=drive)
    added = made.output - h
    for row, rate in ((1900, 60 / 1.999), (2450, 0.0), (2990, -60 / 0.499)):
        expected = law["viscous_um_s_per_V"] * rate
        expected += law["saturating_um"] * np.tanh(rate / law["speed_V_per_s"])
        assert added[row] == pytest.approx(expected, rel=1e-3, abs=1e-9)


def test_the_stage_widens_by_the_logarithm_of_the_rate():
    ramp = np.linspace(0.0, 60.0, 3000)
    made, _, law = both("log_rate", drive=ramp)
    rate = 60.0 / 2.999
    shift = law["coefficient_V"] * np.log10(1 + rate / law["slow_V_per_s"])
    late = simulate_stage(
        3, drive=np.maximum(ramp - shift, 0.0), rate_hz=1000.0, noise_um=0.0, encoder_step_um=0.0
    ).output
    np.testing.assert_allclose(made.output[500:], late[500:], rtol=0, atol=0.02)

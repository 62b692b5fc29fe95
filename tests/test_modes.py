"""Several modes of a resonance and of an axis that leaks in, against SciPy's linear systems."""

from typing import Any

import acting
import numpy as np
import pytest
from scipy import signal

import preisach_jax as pj
from preisach_jax.diagnosis.noise import noise_rms
from preisach_jax.effects.base import Survey
from preisach_jax.effects.cross import Cross
from preisach_jax.effects.modal import MOST_MODES
from preisach_jax.effects.modes import modes_in
from preisach_jax.effects.resonance import Resonance
from preisach_jax.export import export_c
from preisach_jax.fit import base_point
from preisach_jax.identify import Problem

RATE = 1000.0
TWO = ((35.0, 0.03, 1.0), (110.0, 0.02, 0.6))
ONE = TWO[:1]


def through(h, modes, rates=False, rate_hz=RATE):
    """Modes (Hz, damping ratio, gain) in parallel, their input straight between samples."""
    total = np.zeros(len(h))
    for f, zeta, gain in modes:
        w = 2 * np.pi * f
        numerator = [w, 0.0] if rates else [w * w]
        system = (numerator, [1.0, 2 * zeta * w, w * w])
        discrete: Any = signal.cont2discrete(system, 1 / rate_hz, "foh")
        b, a, _ = discrete
        moved: Any = signal.lfilter(np.ravel(b), a, h - h[0])
        total += gain * (moved + (0.0 if rates else h[0]))
    return total


def lagging(x, tau_s, rate_hz=RATE):
    """A lag at rest at the first sample, its input straight between samples."""
    lag: Any = signal.cont2discrete(([1.0], [tau_s, 1.0]), 1 / rate_hz, "foh")
    return signal.lfilter(np.ravel(lag[0]), lag[1], x - x[0]) + x[0]


def drive(seed, count):
    """Steps of random height, smoothed a little, which hold long enough to ring."""
    rng = np.random.default_rng(seed)
    steps = np.repeat(rng.uniform(0.0, 10.0, count // 40 + 1), 40)[:count]
    return signal.lfilter([0.3], [1.0, -0.7], steps)


def plays(u, thresholds=(0.4, 0.9, 1.6, 2.5), weight=0.2):
    """A stack of play operators of equal weights, at rest at the first sample."""
    total = 0.5 * u
    for threshold in thresholds:
        state, track = u[0], np.empty(len(u))
        for k, value in enumerate(u):
            state = max(value - threshold, min(value + threshold, state))
            track[k] = state
        total = total + weight * track
    return total


def record(modes, seed=0, count=4000):
    """A stage of plays, then modes, then noise; no code of the package."""
    u = drive(seed, count)
    h = plays(u)
    z = through(h, modes) + np.random.default_rng([seed, 1]).normal(0, 0.02, count)
    return pj.Record.from_arrays(np.arange(count) / RATE, u, z)


def test_modes_of_a_resonance_act_side_by_side(x64):
    modes = ((20.0, 0.05, 1.0), (70.0, 0.01, -0.5), (180.0, 0.3, 2.0))
    time, h = np.arange(400) / RATE, 3.0 + np.random.default_rng(0).normal(size=400).cumsum()
    values = {"f_hz": 20.0, "zeta": 0.05}
    for k, (f, zeta, gain) in enumerate(modes[1:], start=2):
        values |= {f"f_{k}_hz": f, f"zeta_{k}": zeta, f"gain_{k}": gain}
    got = acting.applied(Resonance(modes=3), values, time, h)
    np.testing.assert_allclose(got, through(h, modes), rtol=0, atol=1e-8)


def test_turned_modes_of_an_axis_add_their_rates(x64):
    time, axis = np.arange(400) / RATE, np.random.default_rng(1).normal(size=400)
    effect = Cross("y", "V", modes=2, turned=True)
    values = {"f_hz": 20.0, "zeta": 0.05, "f_2_hz": 70.0, "zeta_2": 0.3}
    got = acting.columns(effect, values, acting.signals(time, 0 * time, {"y": axis}))
    for k, mode in enumerate(((20.0, 0.05, 1.0), (70.0, 0.3, 1.0))):
        np.testing.assert_allclose(got[:, 2 * k], through(axis, [mode]), rtol=0, atol=1e-8)
        rate = through(axis, [mode], rates=True)
        np.testing.assert_allclose(got[:, 2 * k + 1], rate, rtol=0, atol=1e-8)
    names = [each.name for each in effect.coefficients()]
    assert names == ["gain", "quadrature", "gain_2", "quadrature_2"]


def test_names_of_one_mode_are_those_of_old():
    assert [p.name for p in Resonance().parameters()] == ["f_hz", "zeta"]
    assert [c.name for c in Cross("y").coefficients()] == ["gain"]
    two = [p.name for p in Resonance(modes=2).parameters()]
    assert two == ["f_hz", "zeta", "f_2_hz", "zeta_2", "gain_2"]


@pytest.mark.parametrize("settled", [False, True])
def test_a_frequency_response_shows_modes_one_after_the_other(settled):
    rng = np.random.default_rng(2)
    u, time = rng.normal(size=16_000), np.arange(16_000) / RATE
    z = through(u, TWO) - (1.6 * u if settled else 0.0) + rng.normal(0, 0.2, len(u))
    found = modes_in(time, u, z, 5.0, 400.0, 2, settled=settled)
    assert sorted(m.f_hz for m in found) == pytest.approx([35.0, 110.0], abs=1.5)
    gains = {round(m.f_hz, -1): m.gain for m in found}
    assert all(gain > 0 for gain in gains.values())
    assert all(abs(m.quadrature) < 0.5 * m.gain for m in found)


def test_no_effect_has_more_than_the_most_modes():
    rng = np.random.default_rng(3)
    time, u = np.arange(2000) / RATE, rng.normal(size=2000)
    survey = Survey(2.0, 1 / RATE, time, u, u, through(u, TWO) - 1.6 * u)
    effect, values = Resonance().bound_to(survey), {"f_hz": 35.0, "zeta": 0.03}
    for modes in range(2, MOST_MODES + 1):
        found = effect.enlarged(survey, values)
        assert found is not None
        effect, values = found[0], found[1][0]
        assert effect.modes == modes
        assert all(set(start) == {p.name for p in effect.parameters()} for start in found[1])
    assert effect.enlarged(survey, values) is None


@pytest.mark.parametrize("modes", [ONE, TWO])
def test_the_number_of_modes_is_found(modes):
    found = pj.diagnose(record(modes, count=2500), ["resonance"], levels=7)
    assert found.effects == ("resonance",)
    (effect,) = found.model.chain.effects
    assert isinstance(effect, Resonance)
    assert effect.modes == len(modes)
    values = found.model.values["resonance"]
    f = sorted(v for name, v in values.items() if name.startswith("f_"))
    assert f == pytest.approx([mode[0] for mode in modes], rel=0.03)


@pytest.mark.parametrize(
    "tau_s",
    [
        pytest.param(0.0, id="modes alone"),
        # `test_growth` finds two modes behind a lag in a tenth of the time.
        pytest.param(0.003, id="behind a lag", marks=pytest.mark.campaign),
    ],
)
def test_a_weak_fast_mode_is_found_in_its_size_beside_a_strong_one(tau_s):
    """Alone, the strong one would be damped until it is about as late as the lag."""
    modes = ((40.0, 0.08, 1.0), (150.0, 0.04, 0.3))
    u = drive(7, 4000)
    late: Any = lagging(u, tau_s) if tau_s else u
    z = through(plays(late), modes) + np.random.default_rng([7, 1]).normal(0, 0.01, len(u))
    measured = pj.Record.from_arrays(np.arange(len(u)) / RATE, u, z)
    found = pj.diagnose(measured, ["input_lag", "output_lag", "delay", "resonance"], levels=13)
    names = {"input_lag", "resonance"} if tau_s else {"resonance"}
    assert set(found.effects) == names
    values = found.model.values["resonance"]
    assert [values["f_hz"], values["f_2_hz"]] == pytest.approx([40.0, 150.0], rel=0.02)
    assert values["gain_2"] == pytest.approx(0.3, rel=0.15)
    if tau_s:
        assert found.model.values["input_lag"]["tau_s"] == pytest.approx(tau_s, rel=0.1)


def test_a_lag_and_a_mode_are_named_where_a_delay_does_better_than_either(x64):
    """To second order in frequency, both together are a delay; the mode rings on at corners."""
    count, rng = 5000, np.random.default_rng(2)
    time, corners = np.arange(count) / RATE, np.arange(count // 100 + 2)
    tones = [
        rng.uniform(0.3, 0.8) * np.sin(2 * np.pi * f * time + rng.uniform(0, 2 * np.pi))
        for f in rng.uniform(0.5, 25, 8)
    ]
    u = 5 + np.sum(tones, axis=0)
    u += np.interp(np.arange(count), 100 * corners, rng.uniform(0, 5, len(corners)))
    stack = plays(lagging(u, 0.002), np.linspace(0.2, 4.0, 20), 0.04)
    z = through(stack, ((110.0, 0.04, 1.0),)) + rng.normal(0, 0.005, count)
    measured = pj.Record.from_arrays(time, u, z)
    found = pj.diagnose(measured, ["input_lag", "output_lag", "delay", "resonance"], levels=13)
    first = [c for c in found.candidates if c.step == 0 and np.isfinite(c.rms_validation)]
    assert min(first, key=lambda c: c.rms_validation).effect == "delay"
    assert found.effects == ("input_lag", "resonance")
    assert found.model.values["input_lag"]["tau_s"] == pytest.approx(0.002, rel=0.02)
    assert found.model.values["resonance"]["f_hz"] == pytest.approx(110.0, rel=0.01)
    assert found.model.values["resonance"]["zeta"] == pytest.approx(0.04, rel=0.15)


def test_a_model_of_two_modes_is_saved_and_not_exported_to_c(tmp_path):
    measured = record(TWO, seed=1, count=1500)
    fitted = pj.fit(measured, effects=(Resonance(modes=2),), levels=5)
    assert set(fitted.model.values["resonance"]) == {
        p.name for p in Resonance(modes=2).parameters()
    }
    fitted.save(tmp_path / "model.json")
    again = pj.Model.load(tmp_path / "model.json")
    assert again.values == fitted.model.values
    np.testing.assert_allclose(
        np.asarray(again.predict(measured).output), np.asarray(fitted.predict(measured).output)
    )
    with pytest.raises(pj.InputError, match=r"2 modes.*--without resonance"):
        export_c(again, tmp_path / "c")


def test_an_input_that_turns_at_each_sample_is_not_thinned():
    rng = np.random.default_rng(4)
    count = 3000
    time, u = np.arange(count) / RATE, rng.normal(size=count)
    restless = pj.Record.from_arrays(time, u, u)
    assert len(Problem.of(restless, 2000).record) == count
    smooth = pj.Record.from_arrays(time, np.sin(time), time)
    assert len(Problem.of(smooth, 2000).record) < count


def test_what_rings_fast_is_no_noise(x64):
    rng = np.random.default_rng(5)
    count = 4000
    time, u = np.arange(count) / RATE, rng.uniform(size=count).cumsum() % 5
    noise = rng.normal(0, 0.1, count)
    ringing = through(np.where(np.arange(count) % 400 == 1, 1.0, 0.0), [(380.0, 0.001, 0.15)])
    assert np.std(np.diff(ringing, n=2)) / np.sqrt(6) > 2 * 0.1
    sizes = []
    for z in (u + noise, u + noise + ringing):
        problem = Problem.of(pj.Record.from_arrays(time, u, z))
        sizes.append(noise_rms(problem, base_point(problem, 5)))
    assert sizes == pytest.approx([0.1, 0.1], rel=0.5)

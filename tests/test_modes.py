"""Several modes of a resonance and of an axis that leaks in, against SciPy's linear systems."""

from typing import Any

import numpy as np
import pytest
from oracles import play
from scipy import signal

import preisach_jax as pj
from preisach_jax.diagnosis import inside
from preisach_jax.diagnosis.noise import noise_rms
from preisach_jax.effects.resonance import Resonance
from preisach_jax.export import export_c
from preisach_jax.fit.stepwise import base_point
from preisach_jax.identify.problem import Problem

RATE = 1000.0
TWO = ((35.0, 0.03, 1.0), (110.0, 0.02, 0.6))


def through(h, modes, rate_hz=RATE):
    """Modes (Hz, damping ratio, gain) in parallel, their input straight between samples."""
    total = np.zeros(len(h))
    for f, zeta, gain in modes:
        w = 2 * np.pi * f
        system = ([w * w], [1.0, 2 * zeta * w, w * w])
        discrete: Any = signal.cont2discrete(system, 1 / rate_hz, "foh")
        b, a, _ = discrete
        total += gain * (signal.lfilter(np.ravel(b), a, h - h[0]) + h[0])
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
    return 0.5 * u + weight * sum(play(u, threshold) for threshold in thresholds)


def test_the_number_of_modes_is_found_saved_and_exported_to_c(tmp_path, monkeypatch):
    def never(*_, **__):
        raise AssertionError("tried beside a resonance that explains the record")

    monkeypatch.setattr(inside, "fit_inside", never)
    u = drive(0, 3000)
    z = through(plays(u), TWO) + np.random.default_rng(1).normal(0, 0.02, len(u))
    measured = pj.Record.from_arrays(np.arange(len(u)) / RATE, u, z)
    found = pj.diagnose(measured, ["resonance", "restoring_force"], levels=9)
    assert found.effects == ("resonance",)
    values = found.model.values["resonance"]
    f = sorted(v for name, v in values.items() if name.startswith("f_"))
    assert f == pytest.approx([mode[0] for mode in TWO], rel=0.03)
    assert set(values) == {p.name for p in Resonance(modes=2).parameters()}
    found.model.save(tmp_path / "model.json")
    again = pj.Model.load(tmp_path / "model.json")
    assert again.values == found.model.values
    expected = found.model.predict(measured).output
    np.testing.assert_array_equal(again.predict(measured).output, expected)
    export_c(again, tmp_path / "c")
    readme = (tmp_path / "c" / "README.md").read_text()
    assert "passed in both precisions" in readme
    assert "takes the resonance as settled" in readme


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
    count = 3000
    time, u = np.arange(count) / RATE, rng.uniform(size=count).cumsum() % 5
    noise = rng.normal(0, 0.1, count)
    ringing = through(np.where(np.arange(count) % 400 == 1, 1.0, 0.0), [(380.0, 0.001, 0.15)])
    assert np.std(np.diff(ringing, n=2)) / np.sqrt(6) > 2 * 0.1
    sizes = []
    for z in (u + noise, u + noise + ringing):
        problem = Problem.of(pj.Record.from_arrays(time, u, z))
        sizes.append(noise_rms(problem, base_point(problem, 5)))
    assert sizes == pytest.approx([0.1, 0.1], rel=0.5)

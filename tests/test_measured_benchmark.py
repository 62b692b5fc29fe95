"""The scoreboard of measured records: its rules, and baselines that find what is theirs."""

import sys
from pathlib import Path

import numpy as np
import pytest
from scipy import signal

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "benchmarks"))

from measured.baselines import arx, narx, prandtl_ishlinskii, velocity
from measured.run import expectations

import preisach_jax as pj

SAMPLES = 3000


@pytest.fixture
def inputs():
    white = np.random.default_rng(1).normal(size=(SAMPLES, 2))
    return signal.lfilter([0.1], [1, -0.9], white, axis=0)


@pytest.fixture
def rows():
    kept = np.ones(SAMPLES, dtype=bool)
    kept[1000:1400] = kept[2300:2700] = False
    return kept


def held_out_error(simulated, output, rows):
    """RMS over that of the output, of the rows that were held out."""
    rest = (simulated - output)[~rows]
    return np.sqrt(np.mean(rest**2)) / output[~rows].std()


def test_the_linear_model_simulates_a_linear_system_of_two_inputs(inputs, rows):
    output = 3.0 + np.asarray(signal.lfilter([0.0, 0.5, 0.2], [1, -1.5, 0.8], inputs[:, 0]))
    output += signal.lfilter([0.0, 0.3], [1, -1.5, 0.8], inputs[:, 1])
    hidden = np.where(rows, output, 1e3)  # what is held out is not looked at
    assert held_out_error(arx(np.arange(SAMPLES), inputs, hidden, rows), output, rows) < 1e-4


def test_the_polynomial_model_simulates_a_bilinear_system(inputs, rows):
    pytest.importorskip("sysidentpy")
    u = inputs[:, :1] / np.abs(inputs[:, 0]).max()
    output = np.zeros(SAMPLES)
    for k in range(1, SAMPLES):
        output[k] = 0.6 * output[k - 1] + u[k - 1, 0] + 0.3 * u[k - 1, 0] * output[k - 1]
    assert held_out_error(narx(np.arange(SAMPLES), u, output, rows), output, rows) < 0.02


def test_plays_follow_a_backlash(inputs, rows):
    x = inputs[:, 0]
    play, now = np.empty(SAMPLES), x[0]
    for k, level in enumerate(x):
        now = min(max(now, level - 0.1), level + 0.1)
        play[k] = now
    found = prandtl_ishlinskii(np.arange(SAMPLES), inputs[:, :1], 1 + 2 * play, rows)
    assert held_out_error(found, 1 + 2 * play, rows) < 0.05


def test_velocity_follows_a_damper_whose_column_scales_it(inputs, rows):
    time = np.arange(SAMPLES) / 100
    x = np.sin(time) + 0.3 * np.sin(3.3 * time)
    speed = np.cos(time) + 0.99 * np.cos(3.3 * time)
    output = 2 + x + (1 + inputs[:, 1]) * speed
    found = velocity(time, np.column_stack([x, inputs[:, 1]]), output, rows)
    assert held_out_error(found, output, rows) < 0.02


def test_every_expectation_is_judged_by_its_names_and_verdict():
    damper = expectations()[0]
    assert damper.outcome("explained", ["gain:current_A", "viscosity"]) == "right"
    assert damper.outcome("unexplained", ["gain:current_A", "viscosity"]) == "missed"
    assert damper.outcome("explained", ["viscosity"]) == "missed"
    assert damper.outcome("explained", ["gain:current_A", "viscosity", "hum"]) == "wrong"


def test_an_expectation_of_an_unknown_name_is_refused(tmp_path):
    path = tmp_path / "expectations.toml"
    path.write_text(
        '[[record]]\nfile = "a.csv"\nsource = ""\nunits = {}\naux = []\nphysics = ""\n'
        'required = [["crep"]]\nallowed = []\nverdicts = ["explained"]\n'
    )
    with pytest.raises(pj.InputError, match=r"a\.csv: there is no effect 'crep'.*'creep'"):
        expectations(path)
    path.write_text(path.read_text().replace("crep", "creep").replace("explained", "fine"))
    with pytest.raises(pj.InputError, match=r"no verdict 'fine' \(known: adequate"):
        expectations(path)

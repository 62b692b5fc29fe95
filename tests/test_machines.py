"""Effects of machines in a chain: velocity, scaled loops, other axes, leakage; and what is made."""

from dataclasses import replace

import acting
import numpy as np
import pytest
import world
from acting import signals

import preisach_jax as pj
from preisach_jax.chain.coefficients import Coefficients
from preisach_jax.chain.description import Chain
from preisach_jax.chain.output import columns_beside, response
from preisach_jax.effects.cross import Cross
from preisach_jax.effects.gain import Gain
from preisach_jax.effects.input_lag import InputLag
from preisach_jax.effects.input_quantisation import InputQuantisation
from preisach_jax.effects.viscosity import Viscosity
from preisach_jax.errors import InputError
from preisach_jax.export.description import describe
from preisach_jax.operator.plane import Plane


@pytest.fixture
def damper(x64):
    """A chain in which a column scales a loop and a viscosity behind a lag of the input, and an
    auxiliary signal stays."""
    rng = np.random.default_rng(6)
    time, u = np.cumsum(rng.uniform(1e-3, 1e-2, 400)), 3.0 + np.cumsum(rng.normal(size=400))
    plane = Plane(5, float(u.min()), float(u.max()))
    gain = Gain("c", "A", 1e-9, 1.0, middle=1.0, span=2.0)
    chain = Chain(plane, (InputLag(), gain, Viscosity(), Cross("y", "V")))
    values = {
        "input_lag": {"tau_s": 0.015},
        "gain:c": {"gain": 0.6, "curvature": 0.3, "tau_s": 0.03},
        "viscosity": {"tau_s": 0.02},
        "cross:y": {"f_hz": 9.0, "zeta": 0.3},
    }
    own = Coefficients(
        rng.uniform(size=plane.cells), np.zeros(plane.cells), 0.7, np.array([0.3, 0.2, 5.0])
    )
    drives = signals(time, u, {"c": 1 + np.sin(time), "y": np.cos(3 * time)})
    return chain, values, drives, own


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
    # Steps of a converter have no speed.
    coarse = chain.with_effects((*chain.effects, InputQuantisation(quantum=0.5)))
    known = values | {"input_quantisation": {"step": 0.5}}
    smooth, stepped = (
        columns_beside(each, known, drives, {})["viscosity"] for each in (chain, coarse)
    )
    np.testing.assert_array_equal(smooth, stepped)


# --- hidden, and not hidden ---


def stage(*effects, seed=2):
    drive = world.excitation("rich", 6.0, 500.0, seed)
    made = pj.simulate_stage(seed, effects=effects, drive=drive, rate_hz=500.0)
    record = pj.Record.from_arrays(made.time, made.input, made.output, aux=made.aux)
    return record, made.truth["parameters"]


@pytest.mark.parametrize(
    ("hidden", "rivals"),
    [
        ("leakage", ["drift", "leakage"]),
        ("log_rate", ["rate_dependence", "log_rate"]),
        ("", ["leakage", "log_rate"]),
    ],
)
def test_what_is_hidden_is_found_and_nothing_else(hidden, rivals):
    found = pj.diagnose(stage(*[hidden] * bool(hidden), seed=4)[0], rivals, levels=9)
    assert found.effects == ((hidden,) if hidden else ())
    if hidden:
        assert found.ladder[-1].rms_validation < 0.5 * found.ladder[0].rms_validation


# --- what is made of a model ---


@pytest.fixture(scope="module")
def machine():
    hidden = ("viscosity", "gain:temp_C", "cross:y_V")
    record, truth = stage(*hidden)
    return record, truth, pj.fit(record, hidden, levels=9).model


def test_hidden_together_they_are_found_in_their_sizes(machine):
    _, truth, model = machine
    found = model.parameters
    assert found["cross:y_V"]["f_hz"].value == pytest.approx(truth["cross:y_V"]["f_hz"], rel=0.05)
    gain = found["cross:y_V"]["gain"].value
    assert gain == pytest.approx(truth["cross:y_V"]["gain_um_per_V"], rel=0.1)
    warms = found["gain:temp_C"]["gain"].value
    assert warms == pytest.approx(truth["gain:temp_C"]["gain_per_C"], rel=0.2)


def test_a_model_is_saved_with_its_columns_and_has_no_c_code(machine, tmp_path):
    record, _, model = machine
    model.save(tmp_path / "model.json")
    again = pj.Model.load(tmp_path / "model.json")
    assert [effect.name for effect in again.effects] == [effect.name for effect in model.effects]
    np.testing.assert_allclose(again.simulate(record), model.simulate(record), rtol=1e-12)
    with pytest.raises(InputError, match=r"no C code is known for the effect .*--without "):
        describe(model)


def test_a_scaled_loop_is_compensated_beforehand_and_not_from_sample_to_sample(machine):
    record, _, model = machine
    part = record.part(1000, 1400)
    asked = 30 + 5 * np.sin(part.time)
    wanted = pj.Record.from_arrays(part.time, part.input, asked, aux=part.aux)
    found = pj.compensate(model, wanted)
    assert found.reachable.mean() > 0.9
    off = (found.expected - wanted.output)[found.reachable]
    assert np.sqrt(np.mean(off**2)) < 2 * model.rms_validation
    with pytest.raises(InputError, match=r"gain:temp_C.*sample to sample"):
        pj.OnlineInverse(model, 500.0)

"""Laws of models with effects of every place, at any values of their parameters."""

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import Phase, given, settings
from strategies import columns, models

import preisach_jax as pj
from preisach_jax.chain.description import PLACES
from preisach_jax.effects.auxiliary import Auxiliary
from preisach_jax.effects.base import SensorEffect, Survey
from preisach_jax.effects.cross import Cross
from preisach_jax.effects.gain import Gain

ARRAYS = columns()
RECORD = pj.Record.from_arrays(
    ARRAYS["t_s"],
    ARRAYS["u_V"],
    ARRAYS["z_um"],
    aux={"load_N": ARRAYS["load_N"]},
    units={"input": "V", "output": "um", "load_N": "N"},
)
SURVEY = Survey(
    RECORD.duration_s, RECORD.step_s, RECORD.time, RECORD.input, RECORD.output, RECORD.output
)


def bound(*names):
    """Effects of the library, bound to the record."""
    of_columns = [kind(column="load_N", unit="N") for kind in (Auxiliary, Gain, Cross)]
    library = pj.effects() | {effect.name: effect for effect in of_columns}
    return tuple(library[name].bound_to(SURVEY) for name in names)


CHAINS = {
    "input": bound("input_lag", "slew_limit", "rate_dependence", "ageing", "output_lag", "drift"),
    "output": bound("creep", "delay", "resonance", "hum", "aux:load_N", "reptation",
                    "excess_loss"),
    "steps": bound("input_quantisation", "operator_creep", "output_nonlinearity",
                   "output_quantisation"),
    "feedback": bound("moving"),
    "machine": bound("log_rate", "gain:load_N", "viscosity", "leakage", "cross:load_N"),
}  # fmt: skip
# A smaller example would be looked for over minutes, and this small chain is none to look through.
few = settings(max_examples=2, phases=(Phase.generate,))
every_chain = pytest.mark.parametrize("chain", CHAINS)


def test_every_effect_but_two_is_in_a_chain():
    """`eddy_currents` takes long and feeds back as `moving`; `restoring_force` stands alone."""
    tried = {effect.name for effects in CHAINS.values() for effect in effects}
    named = {name.replace(":COL", ":load_N") for name in pj.effects()}
    assert tried | {"eddy_currents", "restoring_force"} == named, (
        "add the effect to a chain of CHAINS"
    )
    for place in PLACES:
        assert any(isinstance(effect, place) for chain in CHAINS.values() for effect in chain)


@every_chain
@few
@given(data=st.data())
def test_a_saved_model_predicts_the_same_to_the_last_bit(chain, data, tmp_path_factory):
    model = data.draw(models(CHAINS[chain]))
    folder = tmp_path_factory.mktemp("models")
    model.save(folder / "a.json")
    again = pj.Model.load(folder / "a.json")
    again.save(folder / "b.json")
    assert (folder / "a.json").read_bytes() == (folder / "b.json").read_bytes()
    before, after = model.predict(RECORD), again.predict(RECORD)
    for name in ("time", "output", "low", "high"):
        np.testing.assert_array_equal(getattr(after, name), getattr(before, name))
    assert np.all(before.low <= before.output)
    assert np.all(before.output <= before.high)


@pytest.mark.parametrize("chain", ["input", "output", "steps"])
@few
@given(data=st.data())
def test_what_comes_later_changes_nothing_before(chain, data):
    """Causality: the output up to a sample is that of the record which ends there."""
    model = data.draw(models(CHAINS[chain]))
    whole = model.simulate(RECORD)
    count = 40
    late = np.random.default_rng(data.draw(st.integers(0, 99))).uniform(0, 10, len(RECORD) - count)
    other = pj.Record.from_arrays(
        RECORD.time, np.append(RECORD.input[:count], late), RECORD.output, aux=dict(RECORD.aux)
    )
    scale = np.abs(whole).max() + 1.0
    # How an input bends within an interval is told by the samples on both sides of it, and each of
    # two effects in a row looks one sample further.
    sure = slice(0, count - 3)
    np.testing.assert_allclose(model.simulate(other)[sure], whole[sure], rtol=0, atol=1e-9 * scale)


@pytest.mark.parametrize("chain", ["output", "machine"])
@few
@given(data=st.data())
def test_twice_the_coefficients_are_twice_the_output(chain, data):
    """Without feedback and sensor a model is linear in all that is found by least squares."""
    effects = CHAINS[chain]
    assert not any(isinstance(effect, SensorEffect) for effect in effects)
    model = data.draw(models(effects))
    content = model.to_json()
    content["offset"] *= 2
    for name in ("weights", "memory", "first_run"):
        content[name] = [2 * value for value in content[name]]
    for entry in content["effects"]:
        searched = {p.name for e in effects if e.name == entry["name"] for p in e.parameters()}
        for name, estimate in entry["parameters"].items():
            estimate["value"] *= 1 if name in searched else 2
    doubled, once = pj.Model.from_json(content).simulate(RECORD), model.simulate(RECORD)
    np.testing.assert_allclose(doubled, 2 * once, rtol=1e-9, atol=1e-9 * (1 + np.abs(once).max()))

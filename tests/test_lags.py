"""A lag that is a filter of the samples, as controllers and scripts have it, is named a lag."""

import numpy as np
import pytest
import world
from blind import hidden
from scipy import signal

import preisach_jax as pj

RATE, TAU = 1000.0, 0.004
UNITS = {"input": "V", "output": "um"}


def one_pole(values):
    """y_k = y_{k-1} + a (x_k - y_{k-1}), at rest before the first sample."""
    share = -np.expm1(-1 / (RATE * TAU))
    start = np.array([(1 - share) * values[0]])
    return signal.lfilter([share], [1.0, share - 1.0], values, zi=start)[0]


def straight(values):
    return hidden.lag(values, TAU, 1 / RATE)


def stage(before=np.array, behind=np.array, seed=4, seconds=3.0):
    """A record of a smooth Preisach operator with something before it and behind it."""
    rec = world.hidden_record(None, seed, duration_s=seconds, rate_hz=RATE)
    h = world.make_world(seed).hysteresis(before(rec["x"]))
    z = behind(h) + 0.01 * np.random.default_rng(seed).normal(size=len(h))
    return pj.Record.from_arrays(rec["t"], rec["x"], z, units=UNITS, initial_memory="low")


@pytest.mark.parametrize(("name", "law"), [("input_lag", straight), ("output_lag", one_pole)])
def test_a_fit_takes_the_form_of_the_lag_that_the_record_has(name, law):
    place = "before" if name == "input_lag" else "behind"
    found = pj.fit(stage(**{place: law}), effects=[name], levels=9).model
    assert getattr(found.effects[0], "of_samples") == (law is one_pole)  # noqa: B009
    assert found.parameters[name]["tau_s"].value == pytest.approx(TAU, rel=0.02)


def test_a_filter_of_samples_is_a_lag_and_no_viscosity():
    tried = ["input_lag", "viscosity"]
    found = pj.diagnose(stage(before=one_pole), tried, levels=9)
    assert found.effects == ("input_lag",)
    assert found.verdict == "explained"
    assert found.findings[0].parameters["tau_s"].value == pytest.approx(TAU, rel=0.02)

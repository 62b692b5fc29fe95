"""The band of a prediction counts what creep owes to a past that nobody recorded."""

from dataclasses import replace

import numpy as np
import pytest
import world

import preisach_jax as pj
from preisach_jax.chain import signals_of
from preisach_jax.effects.base import Survey
from preisach_jax.effects.creep import Creep
from preisach_jax.model.past import past_sentence

UNITS = {"input": "V", "output": "um"}


def parts(effect, seed):
    """A fit to the first half of a record, and a later stretch of it on another clock."""
    made = world.hidden_record(effect, seed, 24.0, 500.0)
    half, later = 6000, 7500
    first = (made[key][:half] for key in "txz")
    fit = pj.fit(pj.Record.from_arrays(*first, units=UNITS), [effect] if effect else [], levels=13)
    inside = np.clip(made["x"][later:], fit.model.plane.low, fit.model.plane.high)
    clock = made["t"][later:] + 1000.0
    return fit, pj.Record.from_arrays(clock, inside, made["z"][later:], units=UNITS)


@pytest.mark.parametrize("seed", [411, 412, 413])
def test_the_band_holds_a_creeping_stage_that_starts_elsewhere(seed):
    fit, record = parts("creep", seed)
    predicted = fit.predict(record)
    held = (record.output >= predicted.low) & (record.output <= predicted.high)
    assert held.mean() > 0.95
    width = predicted.high - predicted.low
    assert width[0] > width[-1]  # what is quick to be forgotten is
    assert width[-1] < 0.1 * np.ptp(record.output)


def test_without_creep_it_is_as_narrow_as_before():
    fit, record = parts(None, 411)
    predicted = fit.predict(record)
    width = predicted.high - predicted.low
    assert width[-1] == pytest.approx(2 * fit.model.half_width(record)[-1], rel=1e-6)


def test_a_wide_band_says_why_for_how_long_and_what_narrows_it():
    fit, record = parts(None, 411)
    predicted = fit.predict(record)
    said = past_sentence(fit.model, record, predicted)
    ratio = (predicted.high - predicted.low) / (2 * fit.model.half_width(record))
    row = len(ratio) - int(np.argmax(ratio[::-1] > 1.5))  # the first of those that stay narrow
    assert ratio[row - 1] > 1.5
    assert (ratio[row:] <= 1.5).all()
    assert f"until row {row + 1:,}, " in said
    assert "--initial-memory low, high or demagnetised" in said


def test_where_the_past_is_known_nothing_is_said():
    fit, record = parts(None, 411)
    own = fit.record
    assert past_sentence(fit.model, own, fit.predict(own)) == ""
    stated = replace(record, initial_memory="low")
    assert past_sentence(fit.model, stated, fit.predict(stated)) == ""


def test_the_bound_is_that_of_elements_that_stood_elsewhere():
    effect = Creep().bound_to(Survey(10.0, 0.01))
    values = {f"c_{i + 1}": 0.01 * (i + 1) for i in range(len(effect.tau_s))}
    t = np.linspace(0.0, 8.0, 400)
    signals = signals_of(pj.Record.from_arrays(t, t, t))
    got = np.asarray(effect.at(values).past_bound(signals, 30.0))
    longer = 30.0 * sum(values.values()) / (2 * 2)  # half a decade of them, two elements each
    # An element at 30 beside a signal that stays at 0 falls back to it.
    slow = sum(
        value * 30.0 * np.exp(-t / tau)
        for value, tau in zip(values.values(), effect.tau_s, strict=True)
    )
    np.testing.assert_allclose(got, slow + longer, rtol=0.05)

"""The band of a prediction counts what creep owes to a past that nobody recorded."""

from dataclasses import replace

import found as made_once
import numpy as np
import pytest
from found import LEVELS, ROWS, UNITS
from test_modes import plays

import preisach_jax as pj
from preisach_jax.chain.signals import signals_of
from preisach_jax.diagnosis.comparison import compare
from preisach_jax.effects.base import Survey
from preisach_jax.effects.creep import Creep
from preisach_jax.errors import InputError
from preisach_jax.model import past_sentence


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def held(record, predicted, rows=None):
    inside = (record.output >= predicted.low) & (record.output <= predicted.high)
    return float(inside[:rows].mean())


def test_the_band_holds_a_creeping_stage_that_starts_elsewhere():
    model, part = made_once.found("creep").model, made_once.record_of("creep").part(ROWS // 2, ROWS)
    record = pj.Record.from_arrays(part.time + 1000.0, part.input, part.output, units=UNITS)
    predicted = model.predict(record)
    assert held(record, predicted) > 0.95
    width = predicted.high - predicted.low
    assert width[0] > width[-1]  # what is quick to be forgotten is


def test_the_bound_is_that_of_elements_that_stood_elsewhere():
    effect = Creep().bound_to(Survey(10.0, 0.01))
    values = {f"c_{i + 1}": 0.01 * (i + 1) for i in range(len(effect.tau_s))}
    t = np.linspace(0.0, 8.0, 400)
    signals = signals_of(pj.Record.from_arrays(t, t, t))
    got = np.asarray(effect.at(values).past_bound(signals, 30.0))
    longer = 30.0 * sum(values.values()) / (2 * 2)  # half a decade of them, two elements each
    # An element at 30 beside a signal that stays at 0 falls back to it.
    pairs = zip(values.values(), effect.tau_s, strict=True)
    slow = sum(value * 30.0 * np.exp(-t / tau) for value, tau in pairs)
    np.testing.assert_allclose(got, slow + longer, rtol=0.05)


def relaxed(seed, start_s=0.0, initial_memory="free"):
    """Plays that begin relaxed at the lowest input: their first rise is not as later ones."""
    rng, u = np.random.default_rng(seed), [20.0]
    while len(u) < ROWS:
        to = rng.uniform(20, 60) if len(u) > 400 else (60.0 if u[-1] < 40 else 20.0)
        u += list(np.linspace(u[-1], to, rng.integers(60, 200))[1:])
    u = np.array(u[:ROWS])
    h = 0.3 * u + 0.04 * sum(plays(u, (r,)) for r in (1, 2, 3, 4.5, 6, 8, 10, 13, 16))
    time = start_s + np.arange(ROWS) / 1000
    z = h + rng.normal(0, 0.005, ROWS)
    return pj.Record.from_arrays(time, u, z, units=UNITS, initial_memory=initial_memory)


@pytest.fixture(scope="module")
def of_relaxed():
    return pj.diagnose(relaxed(1), ["drift"], levels=LEVELS)


def test_a_wide_band_says_why_for_how_long_and_what_narrows_it(of_relaxed):
    model, record = of_relaxed.model, relaxed(2, 100.0).part(800, ROWS)
    predicted = model.predict(record)
    said = past_sentence(model, record, predicted)
    ratio = (predicted.high - predicted.low) / (2 * model.half_width(record))
    assert ratio[-1] == pytest.approx(1.0, rel=0.01)  # without creep, it is narrow again
    row = len(ratio) - int(np.argmax(ratio[::-1] > 1.5))  # the first of those that stay narrow
    assert f"until row {row + 1:,}, " in said
    assert "--initial-memory low, high, demagnetised or as-fitted" in said
    stated = replace(record, initial_memory="low")
    assert past_sentence(model, stated, model.predict(stated)) == ""


def test_the_band_holds_a_record_that_begins_where_the_fitted_one_began(of_relaxed):
    """Whether the stage begins relaxed again, as nobody says, or comes down from above."""
    again = relaxed(2, 100.0)
    predicted = of_relaxed.model.predict(again)
    assert held(again, predicted, 40) > 0.9
    width = predicted.high - predicted.low
    assert np.ptp(width[600:]) < 0.5 * width[0]
    later = again.part(int(np.flatnonzero(again.input == 20.0)[2]), len(again))
    assert held(later, of_relaxed.model.predict(later), 40) > 0.9


def test_an_initial_memory_as_fitted_begins_as_the_fitted_record_began(of_relaxed):
    model, record = of_relaxed.model, relaxed(2, 100.0, "as-fitted")
    predicted, unknown = model.predict(record), model.predict(relaxed(2, 100.0))
    assert rms((predicted.output - record.output)[:100]) < 0.02
    assert rms((unknown.output - record.output)[:100]) > 0.2
    assert held(record, predicted, 40) >= 0.9
    columns = (each[300:] for each in (record.time, record.input, record.output))
    with pytest.raises(InputError, match="memory as-fitted needs the same"):
        model.predict(pj.Record.from_arrays(*columns, initial_memory="as-fitted"))
    with pytest.raises(InputError, match="for a fit give low, high, demagnetised or free"):
        pj.fit(record, levels=LEVELS)


def test_diagnosis_and_comparison_say_that_the_first_rise_differs(of_relaxed):
    assert "first passage differs" in " ".join(of_relaxed.notes)
    assert "first passage differs" not in " ".join(made_once.found().notes)
    told = " ".join(compare(of_relaxed.model, relaxed(2, 100.0)).notes)
    assert "before the input has covered its range" in told
    assert "as-fitted" in told
    right = " ".join(compare(of_relaxed.model, relaxed(2, 100.0, "as-fitted")).notes)
    assert "before the input has covered" not in right
    assert "Where the error sits" in right

"""The band of a prediction counts what creep owes to a past that nobody recorded."""

from dataclasses import replace

import numpy as np
import pytest
import world
from test_modes import plays

import preisach_jax as pj
from preisach_jax.chain import signals_of
from preisach_jax.diagnosis.comparison import compare
from preisach_jax.effects.base import Survey
from preisach_jax.effects.creep import Creep
from preisach_jax.errors import InputError
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
    assert "--initial-memory low, high, demagnetised or as-fitted" in said


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


def relaxed(seed, start_s=0.0, initial_memory="free", rows=3000):
    """Plays that begin relaxed at the lowest input: their first rise is not as later ones."""
    rng, u = np.random.default_rng(seed), [20.0]
    while len(u) < rows:
        to = rng.uniform(20, 60) if len(u) > 400 else (60.0 if u[-1] < 40 else 20.0)
        u += list(np.linspace(u[-1], to, rng.integers(60, 200))[1:])
    u = np.array(u[:rows])
    h = 0.3 * u + 0.04 * sum(plays(u, (r,)) for r in (1, 2, 3, 4.5, 6, 8, 10, 13, 16))
    z = h + rng.normal(0, 0.005, rows)
    time = start_s + np.arange(rows) / 1000
    return pj.Record.from_arrays(time, u, z, units=UNITS, initial_memory=initial_memory)


@pytest.fixture(scope="module")
def of_relaxed():
    return pj.fit(relaxed(1), levels=13).model


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def held(record, predicted, rows):
    inside = (record.output >= predicted.low) & (record.output <= predicted.high)
    return float(inside[:rows].mean())


def test_the_band_holds_a_record_that_begins_where_the_fitted_one_began(of_relaxed):
    """Whether the stage begins relaxed again, as nobody says, or comes down from above."""
    again = relaxed(2, 100.0)
    predicted = of_relaxed.predict(again)
    assert held(again, predicted, 40) > 0.9
    assert np.ptp(predicted.high[600:] - predicted.low[600:]) < 0.5 * (
        predicted.high[0] - predicted.low[0]
    )
    later = again.part(int(np.flatnonzero(again.input == 20.0)[2]), len(again))
    assert held(later, of_relaxed.predict(later), 40) > 0.9


def test_an_initial_memory_as_fitted_begins_as_the_fitted_record_began(of_relaxed):
    record = relaxed(2, 100.0, "as-fitted")
    predicted = of_relaxed.predict(record)
    unknown = of_relaxed.predict(relaxed(2, 100.0))
    assert rms((predicted.output - record.output)[:100]) < 0.02
    assert rms((unknown.output - record.output)[:100]) > 0.2
    assert held(record, predicted, 40) > 0.9
    columns = (each[300:] for each in (record.time, record.input, record.output))
    elsewhere = pj.Record.from_arrays(*columns, initial_memory="as-fitted")
    with pytest.raises(InputError, match="memory as-fitted needs the same"):
        of_relaxed.predict(elsewhere)


def test_a_comparison_says_where_the_error_sits(of_relaxed):
    told = " ".join(compare(of_relaxed, relaxed(2, 100.0)).notes)
    assert "before the input has covered its range" in told
    assert "as-fitted" in told
    right = " ".join(compare(of_relaxed, relaxed(2, 100.0, "as-fitted")).notes)
    assert "before the input has covered" not in right
    assert "Where the error sits" in right


def test_a_diagnosis_says_that_the_first_rise_differs():
    found = pj.diagnose(relaxed(1), ["drift"], levels=13)
    assert "first passage differs" in " ".join(found.notes)
    covered = relaxed(1).part(600, 3000)
    assert "first passage differs" not in " ".join(pj.diagnose(covered, ["drift"], levels=13).notes)


def test_no_fit_begins_as_fitted():
    with pytest.raises(InputError, match="for a fit give low, high, demagnetised or free"):
        pj.fit(relaxed(1, 0.0, "as-fitted"), levels=9)

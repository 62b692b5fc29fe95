"""The diagnosis by hand: the same evidence, the same numbers, and a way back."""

import numpy as np
import pytest

import preisach_jax as pj

TRIED = ["drift", "hum", "delay"]


@pytest.fixture(scope="module")
def record():
    """Loops with a straight drift of 2 % of the stroke and a little noise."""
    t = np.arange(3000) / 100
    u = 5 - 5 * np.cos(t * (1 + t / 40))
    z = u**1.1 + 0.01 * t + 0.005 * np.random.default_rng(5).normal(size=t.size)
    return pj.Record.from_arrays(t, u, z, units={"input": "V", "output": "um"})


@pytest.fixture(scope="module")
def plain(record):
    return pj.explore(record, TRIED, levels=9)


@pytest.fixture(scope="module")
def drifted(plain):
    return plain.add("drift")


def test_an_added_effect_lowers_the_error_and_the_way_back_is_whole(record, plain, drifted):
    assert drifted.effects == ("drift",)
    assert (plain.effects, plain.before, drifted.before) == ((), None, plain)
    np.testing.assert_array_equal(plain.fit.prediction, pj.fit(record, levels=9).prediction)
    assert [rung.effects for rung in drifted.ladder] == [(), ("drift",)]
    before, after = (rung.rms_validation for rung in drifted.ladder)
    fit = drifted.fit
    direct = np.sqrt(np.mean((record.output - fit.prediction)[fit.validation] ** 2))
    assert after == pytest.approx(direct)
    assert after < before / 3
    assert after < 0.01  # of noise of 0.005
    assert [effect.name for effect in drifted.left] == ["hum", "delay"]
    budget = drifted.budget()
    squares = budget.noise**2 + budget.discretisation**2 + budget.memory**2 + budget.unexplained**2
    assert np.sqrt(squares) == pytest.approx(after)
    assert budget.noise == pytest.approx(0.005, rel=0.15)


def test_the_diagnosis_judges_the_same_candidates_and_is_gone_on_from(record, drifted):
    told, seen = [], []
    looked = pj.explore(record, TRIED, levels=9)
    ranked = looked.candidates(lambda text, done: told.append(done))
    assert told == sorted(told)
    assert {candidate.effect for candidate in ranked} == set(TRIED)
    assert [candidate.effect for candidate in ranked if not candidate.why_not] == ["drift"]
    # The same clicks give the same numbers, whether it was ranked before or not.
    again = looked.add("drift").fit.prediction
    np.testing.assert_array_equal(again, drifted.fit.prediction)
    found = pj.diagnose(record, TRIED, levels=9, watch=lambda fit, tried: seen.append(fit.effects))
    assert {c.effect: c.gain for c in ranked} == {
        c.effect: c.gain for c in found.candidates if c.step == 0
    }
    assert seen == [(), ("drift",)]
    last = pj.Exploration.of(found, TRIED)
    assert last.effects == found.effects == ("drift",)
    assert last.fit is found.final
    assert last.before is not None
    assert last.before.fit is found.base


def test_mistakes_are_named(drifted):
    with pytest.raises(pj.InputError, match=r"'crep'.*creep"):
        drifted.add("crep")
    with pytest.raises(pj.InputError, match="has the effect 'drift' already"):
        drifted.add("drift")
    # One that was not compared can be added all the same.
    assert drifted.add("ageing").effects == ("drift", "ageing")

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


def test_the_first_step_is_the_plain_fit(record, plain):
    fit = pj.fit(record, levels=9)
    assert plain.effects == ()
    assert plain.before is None
    np.testing.assert_array_equal(plain.fit.prediction, fit.prediction)


def test_an_added_effect_lowers_the_error_and_the_way_back_is_whole(record, plain):
    step = plain.add("drift")
    assert step.effects == ("drift",)
    assert step.before is plain
    assert [rung.effects for rung in step.ladder] == [(), ("drift",)]
    errors = [rung.rms_validation for rung in step.ladder]
    direct = np.sqrt(np.mean((record.output - step.fit.prediction)[step.fit.validation] ** 2))
    assert errors[1] == pytest.approx(direct)
    assert errors[1] < errors[0] / 3
    assert errors[1] < 0.01  # of noise of 0.005
    assert [effect.name for effect in step.left] == ["hum", "delay"]
    budget = step.budget()
    squares = budget.noise**2 + budget.discretisation**2 + budget.memory**2 + budget.unexplained**2
    assert np.sqrt(squares) == pytest.approx(step.fit.rms_validation)
    assert budget.noise == pytest.approx(0.005, rel=0.15)


def test_the_same_clicks_give_the_same_numbers_whether_ranked_or_not(record):
    looked = pj.explore(record, TRIED, levels=9)
    looked.candidates()
    unlooked = pj.explore(record, TRIED, levels=9)
    np.testing.assert_array_equal(
        looked.add("drift").fit.prediction, unlooked.add("drift").fit.prediction
    )


def test_candidates_are_ranked_as_the_diagnosis_judges_them(record, plain):
    told = []
    ranked = pj.explore(record, TRIED, levels=9).candidates(lambda text, done: told.append(done))
    assert {candidate.effect for candidate in ranked} == set(TRIED)
    assert ranked[0].effect == "drift"
    assert ranked[0].why_not == ""
    assert all(candidate.why_not for candidate in ranked[1:])
    assert told == sorted(told)
    found = pj.diagnose(record, TRIED, levels=9)
    of_first_step = {c.effect: c.gain for c in found.candidates if c.step == 0}
    assert {c.effect: c.gain for c in ranked} == of_first_step
    assert found.effects[0] == ranked[0].effect


def test_a_diagnosis_is_gone_on_from(record):
    seen = []
    found = pj.diagnose(record, TRIED, levels=9, watch=lambda fit, tried: seen.append(fit.effects))
    assert seen == [(), ("drift",)]
    last = pj.Exploration.of(found, TRIED)
    assert last.effects == found.effects
    assert last.fit is found.final
    assert last.before is not None
    assert last.before.fit is found.base
    assert last.add("hum").effects == ("drift", "hum")


def test_mistakes_are_named(plain):
    with pytest.raises(pj.InputError, match=r"'crep'.*creep"):
        plain.add("crep")
    with pytest.raises(pj.InputError, match="has the effect 'drift' already"):
        plain.add("drift").add("drift")
    assert plain.add("output_lag").effects == ("output_lag",)  # though it was not compared

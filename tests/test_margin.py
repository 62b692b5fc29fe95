"""How close a verdict is, at numbers that a quarter more or less data turns, or not."""

from types import SimpleNamespace
from typing import Any

import pytest
from stand_ins import make_diagnosis, make_record

from preisach_jax.diagnosis.margin import close_calls
from preisach_jax.diagnosis.result import Budget, Candidate, Finding
from preisach_jax.diagnosis.wording import sentence
from preisach_jax.report.language import verdict_sentence

FITS: Any = (SimpleNamespace(record=make_record(), rms_validation=0.5),)


def evidence(gain=0.5, z=9.0, delta_bic=900.0):
    return {"gain": gain, "z": z, "blocks": 24, "delta_bic": delta_bic}


def budget(unexplained=0.0):
    return Budget(0.3, 0.0, 0.0, 0.4, 0.0, unexplained, "um")


def named(**numbers):
    return Finding("creep", ("creep",), {}, 2.0, 1.0, evidence(**numbers))


def refused(step=0, **numbers):
    return Candidate("delay", step, 0.1, 1.0, evidence(**numbers), False, "a test is not passed")


@pytest.mark.parametrize(
    ("numbers", "close"),
    [
        ({}, False),
        ({"gain": 0.0558}, True),
        ({"gain": 0.0562}, False),
        # From a gain of a quarter on, a z of 2 passes the first test, below it one of 3.
        ({"z": 2.23}, True),
        ({"z": 2.24}, False),
        ({"gain": 0.2, "z": 3.35}, True),
        ({"gain": 0.2, "z": 3.36}, False),
        ({"delta_bic": 12.4}, True),
        ({"delta_bic": 12.6}, False),
    ],
)
def test_a_name_is_close_if_a_quarter_less_data_would_close_a_lock(numbers, close):
    said = close_calls([named(**numbers)], [], budget(), met=True)
    assert said == (("creep passes the tests by a small margin",) if close else ())


@pytest.mark.parametrize(
    ("numbers", "close"),
    [
        ({"z": 1.8}, True),
        ({"z": 1.78}, False),
        ({"delta_bic": 8.1}, True),
        ({"delta_bic": 7.9}, False),
        ({"gain": 0.046}, True),
        ({"gain": 0.044}, False),
        ({"gain": 0.2, "z": 2.7}, True),
        ({"gain": 0.2, "z": 2.6}, False),
        # Both tests are passed: what refused it is no matter of data.
        ({}, False),
    ],
)
def test_a_refusal_is_close_if_a_quarter_more_data_would_open_both_locks(numbers, close):
    said = close_calls([], [refused(**numbers)], budget(), met=True)
    assert said == (("delay fails them by a small margin",) if close else ())


def test_what_was_refused_on_the_way_is_not_told():
    assert close_calls([named()], [refused(step=0, z=1.9)], budget(), met=True) == ()


@pytest.mark.parametrize(
    ("unexplained", "said"),
    [
        (0.44, ()),
        (0.45, ("what is not explained is just within noise and discretisation",)),
        (0.5, ("what is not explained is just within noise and discretisation",)),
        (0.51, ("what is not explained is just beyond noise and discretisation",)),
        (0.55, ("what is not explained is just beyond noise and discretisation",)),
        (0.57, ()),
    ],
)
def test_a_budget_is_close_to_what_it_allows(unexplained, said):
    here = budget(unexplained)
    assert close_calls([], [], here, here.is_met) == said
    # A tolerance that decides is no close call of the budget.
    assert close_calls([], [], here, not here.is_met) == ()


def test_sentences_say_that_a_verdict_is_close():
    found = make_diagnosis("adequate", close=("delay fails them by a small margin",))
    said = sentence("adequate", (), found.budget, FITS, close=found.close)
    assert said.endswith(" The verdict is close: delay fails them by a small margin.")
    assert verdict_sentence(found, "de").endswith(" Das Urteil ist knapp.")
    assert "knapp" not in verdict_sentence(make_diagnosis("adequate"), "de")
    assert found.to_json()["close"] == ["delay fails them by a small margin"]

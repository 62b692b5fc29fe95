"""The rows of the table of candidates."""

from typing import Any, cast

from preisach_jax.diagnosis.evidence import Evidence
from preisach_jax.diagnosis.trial import (
    NotFitted,
    Row,
    Trial,
    accepted_rows,
    failures,
    given_up_rows,
    with_rival,
)
from preisach_jax.effects.creep import Creep
from preisach_jax.effects.drift import Drift
from preisach_jax.effects.hum import Hum
from preisach_jax.effects.input_lag import InputLag
from preisach_jax.identify.confidence import Certainty


class Point:
    validation_mean_square = 4.0


def trial(effect, step, gain=0.5):
    return Trial(
        effect,
        step,
        cast(Any, Point()),
        Evidence(gain, 9.0, 24, 99.0),
        Certainty(alone=True, together=True),
    )


def told(rows: list[Row]):
    return {
        (each.effect.name, each.step): (candidate.accepted, candidate.gain, candidate.why_not)
        for each, accepted, better in rows
        for candidate in [each.candidate(3.0, accepted, better)]
    }


def test_a_rival_takes_the_place_in_the_table():
    drift, creep, lag = trial(Drift(), 0), trial(Creep(), 0), trial(InputLag(), 0)
    later = trial(Creep(), 1, 0.1)
    rows: list[Row] = [
        (drift, True, ""),
        (creep, False, "drift"),
        (lag, False, "drift"),
        (later, False, "hum"),
    ]
    assert told(rows)["creep", 0] == (False, 0.5, "drift does more")
    after = with_rival(rows, drift, trial(Creep(), 0, 0.9))
    assert told(after) == {
        ("drift", 0): (False, 0.5, "creep does more"),
        ("creep", 0): (True, 0.9, ""),
        ("input_lag", 0): (False, 0.5, "creep does more"),
        ("creep", 1): (False, 0.1, "hum does more"),
    }


def test_effects_that_pass_beside_each_other_are_both_added():
    weak = Evidence(0.5, 1.5, 24, 99.0)
    first = Trial(Drift(), 0, cast(Any, Point()), weak, Certainty(alone=True, together=True))
    rows: list[Row] = [(first, False, ""), (trial(Creep(), 0), False, "")]
    after = accepted_rows(rows, ["drift"], 0)
    assert told(after) == {
        ("drift", 0): (True, 0.5, ""),
        ("creep", 0): (False, 0.5, "drift does more"),
    }


def test_what_is_passed_over_says_what_it_promised():
    def reason(gain):
        return NotFitted.passed_over(Drift(), 0, gain, 0.025).candidate(1.0, False, "").why_not

    assert reason(-0.3) == "not fitted: it does not promise to lower the held-out error"
    assert reason(0.011).endswith(
        "lower the held-out mean square by 1.1 %, less than the 2.5 % asked for"
    )
    assert reason(0.3).endswith("mean square by 30.0 %, others promise more, or more reliably")


def test_what_is_given_up_says_why():
    drift, creep = trial(Drift(), 0), trial(Creep(), 0)
    rows: list[Row] = [(drift, True, ""), (creep, False, "drift")]
    after = given_up_rows(rows, [drift], "it is too little")
    assert told(after) == {
        ("drift", 0): (False, 0.5, "it is too little"),
        ("creep", 0): (False, 0.5, "it is no better than an effect that was removed again"),
    }


def test_own_effects_that_failed_are_told_once():
    rows: list[Row] = [
        (NotFitted(Hum(), step, "failed: RuntimeError: no table", failed=True), False, "")
        for step in (0, 1)
    ]
    rows.append((NotFitted(Drift(), 0, "could not be fitted: all is NaN"), False, ""))
    assert failures(rows) == ("The effect 'hum' was not tried: it failed: RuntimeError: no table.",)


def test_rows_say_why_an_effect_was_not_fitted():
    rows: list[Row] = [
        (NotFitted.passed_over(Hum(), 0, 0.0042, 0.05), False, "creep"),
        (NotFitted(Drift(), 1, "could not be fitted: all is NaN"), False, "creep"),
    ]
    reasons = [reason for _, _, reason in told(rows).values()]
    assert reasons == [
        "not fitted: it promises to lower the held-out mean square by 0.4 %, less than the 5 % "
        "asked for",
        "could not be fitted: all is NaN",
    ]
    row = rows[0][0].candidate(3.0, False, "creep")
    assert row.evidence == {"promise": 0.0042}

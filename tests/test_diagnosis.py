"""The diagnosis on simulated stages with a hidden effect, made by code that it does not share."""

import json

import numpy as np
import pytest
import world

import preisach_jax as pj
from preisach_jax.diagnosis.result import VERDICTS

SEEDS = (201, 202, 203)  # thresholds were chosen on others
SECONDS, IDENTIFIED, RATE_HZ = 16.0, 24_000, 2000.0
EFFECTS = (None, "creep", "input_lag", "delay", "drift", "ageing", "aux")


def hidden(effect, seed, **options):
    made = world.hidden_record(effect, seed, SECONDS, RATE_HZ, **options)
    units = {"input": "V", "output": "um"}
    whole = pj.Record.from_arrays(
        made["t"], made["x"], made["z"], aux=made["aux"], units=units, name="hidden"
    )
    return made, whole


def names_of(made):
    effect = made["truth"]["effect"]
    if effect is None:
        return ()
    return (f"aux:{made['truth']['column']}",) if effect == "aux" else (effect,)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("effect", EFFECTS)
def test_names_what_is_hidden_removes_its_error_and_predicts_what_follows(effect, seed):
    made, whole = hidden(effect, seed)
    found = pj.diagnose(whole.part(0, IDENTIFIED))
    assert found.effects == names_of(made)
    assert found.verdict == ("explained" if effect else "adequate")
    noise = made["noise_um"]
    base, final = found.ladder[0].rms_validation, found.ladder[-1].rms_validation
    if effect:
        assert base - final >= 0.85 * (base - noise)
    assert found.budget.noise == pytest.approx(noise, rel=0.15)

    if made["truth"].get("kind") == "polynomial":
        return  # a drift is continued as an exponential or a straight line, whatever it will do
    after = slice(IDENTIFIED, None)
    blind = pj.Record.from_arrays(
        whole.time, whole.input, np.full(len(whole), np.nan), aux=whole.aux
    )
    predicted = found.model.predict(blind)
    rms = np.sqrt(np.mean((whole.output[after] - predicted.output[after]) ** 2))
    assert rms <= 2 * noise + found.budget.discretisation


@pytest.mark.parametrize(
    "options", [{"noise_colour": 0.9}, {"unknown_start": True}, {"decoy": True}]
)
def test_names_nothing_where_nothing_is_hidden(options):
    _, whole = hidden(None, 204, **options)
    found = pj.diagnose(whole.part(0, IDENTIFIED))
    assert found.effects == ()
    assert [candidate.accepted for candidate in found.candidates].count(True) == 0
    if "decoy" in options:
        assert any(candidate.effect.startswith("aux:") for candidate in found.candidates)


def test_an_effect_outside_the_library_is_not_called_adequate():
    _, whole = hidden("resonance", 205)
    found = pj.diagnose(whole.part(0, IDENTIFIED))
    assert found.verdict in ("unexplained", "partly_explained")
    assert "%" in found.located
    assert found.next_experiment is not None


@pytest.fixture(scope="module")
def drifting():
    made, whole = hidden("drift", 207)
    return made, pj.diagnose(whole.part(0, 16_000), ["drift", "creep"], levels=15)


def test_json_holds_what_the_contract_names(drifting):
    _, found = drifting
    content = json.loads(json.dumps(found.to_json()))
    assert content["verdict"] in VERDICTS
    assert content["effects"] == ["drift"]
    assert set(content["budget"]) == {"noise", "discretisation", "unexplained", "unit"}
    (finding,) = content["findings"]
    assert finding["family"][0] == "drift"
    assert finding["rms_after"] < finding["rms_before"]
    assert set(finding["parameters"]["amplitude"]) == {"value", "low", "high", "unit"}
    assert finding["parameters"]["amplitude"]["unit"] == "um"
    assert [rung["effects"] for rung in content["ladder"]] == [[], ["drift"]]
    assert {"rms_identification", "rms_validation", "max_abs_validation", "fit_percent"} <= set(
        content["ladder"][0]
    )
    for candidate in content["candidates"]:
        assert {"effect", "gain", "evidence", "accepted", "why_not"} <= set(candidate)
        assert candidate["accepted"] or candidate["why_not"]


def test_the_interval_of_the_amplitude_holds_the_truth(drifting):
    made, found = drifting
    truth = made["truth"]
    assert truth["kind"] == "linear"
    estimate = found.findings[0].parameters["amplitude"]
    assert estimate.low <= truth["amplitude_um"] * 16_000 / (SECONDS * RATE_HZ) <= estimate.high


def test_same_record_same_outcome(drifting):
    made, found = drifting
    _, whole = hidden("drift", 207)
    again = pj.diagnose(whole.part(0, 16_000), ["drift", "creep"], levels=15)
    assert again.to_json() == found.to_json()
    assert made["truth"]["effect"] == "drift"


def test_progress_goes_forward_and_ends_below_one():
    _, whole = hidden(None, 207)
    seen = []
    pj.diagnose(whole.part(0, 8000), ["drift"], levels=9, progress=lambda *step: seen.append(step))
    shares = [share for _, share in seen]
    assert shares == sorted(shares)
    assert shares[0] >= 0
    assert shares[-1] <= 1
    assert any("drift" in text for text, _ in seen)


def test_the_residual_of_the_last_step_is_told_apart_from_that_of_the_first(drifting):
    _, found = drifting
    first, last = found.steps[0], found.steps[-1]
    assert first.effects == ()
    assert last.effects == ("drift",)
    assert not np.any(first.identification & first.validation)
    np.testing.assert_array_equal(first.identification | first.validation, first.record.measured)
    assert last.rms_validation == pytest.approx(
        np.sqrt(np.mean(last.residual[last.validation] ** 2))
    )

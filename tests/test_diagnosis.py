"""The diagnosis on simulated stages with a hidden effect, made by code that it does not share."""

import json
from importlib import resources

import jax.numpy as jnp
import numpy as np
import pytest
import world
from scipy import signal

import preisach_jax as pj
from preisach_jax.chain import Chain
from preisach_jax.diagnosis.result import VERDICTS
from preisach_jax.fit import base_point, moved_to, plane_of
from preisach_jax.identify import Problem, evaluate, refine
from preisach_jax.model import Model
from preisach_jax.report import write_report

pytestmark = pytest.mark.slow

SEEDS = (201, 202)  # thresholds were chosen on others
SECONDS, RATE_HZ = 16.0, 1000.0
FINE_HZ = 2000.0  # where the default plane and all of these rows are needed to tell
HALF = 8_000
LEVELS = 13  # those of the search for starts, so that most is compiled once
EFFECTS = (None, "creep", "input_lag", "delay", "drift", "ageing", "aux")
QUICK = ("output_lag", "drift", "hum", "aux")  # one of each place; the others are a campaign's
SLOW = ("input_lag", "delay", "ageing", "slew_limit", "resonance")
MORE_CASES = [(effect, SEEDS[0], None, RATE_HZ) for effect in (None, "creep")]
MORE_CASES += [("rate_dependence", SEEDS[0], None, FINE_HZ), ("creep", SEEDS[1], None, FINE_HZ)]
MORE_CASES += [(effect, SEEDS[1], LEVELS, RATE_HZ) for effect in EFFECTS[2:]]
MORE_CASES += [(effect, SEEDS[0], LEVELS, RATE_HZ) for effect in SLOW]
CASES = [(effect, SEEDS[0], LEVELS, RATE_HZ) for effect in QUICK]
CASES += [(None, SEEDS[1], LEVELS, RATE_HZ)]
CASES += [pytest.param(*case, marks=pytest.mark.campaign) for case in MORE_CASES]


def hidden(effect, seed, rate_hz=RATE_HZ, **options):
    made = world.hidden_record(effect, seed, SECONDS, rate_hz, **options)
    units = {"input": "V", "output": "um"}
    whole = pj.Record.from_arrays(
        made["t"], made["x"], made["z"], aux=made["aux"], units=units, name="hidden"
    )
    return made, whole


def identified(whole):
    """The rows that are diagnosed; what follows is to be predicted."""
    return 3 * len(whole) // 4


def names_of(made):
    effect = made["truth"]["effect"]
    if effect is None:
        return ()
    return (f"aux:{made['truth']['column']}",) if effect == "aux" else (effect,)


@pytest.mark.parametrize(("effect", "seed", "levels", "rate_hz"), CASES)
def test_names_what_is_hidden_removes_its_error_and_predicts_what_follows(
    effect, seed, levels, rate_hz
):
    made, whole = hidden(effect, seed, rate_hz)
    found = pj.diagnose(whole.part(0, identified(whole)), levels=levels)
    assert found.effects == names_of(made)
    assert found.verdict == ("explained" if effect else "adequate")
    noise = made["noise_um"]
    base, final = found.ladder[0].rms_validation, found.ladder[-1].rms_validation
    if effect:
        assert base - final >= 0.85 * (base - noise)
    assert found.budget.noise == pytest.approx(noise, rel=0.15)

    if made["truth"].get("kind") == "polynomial":
        return  # a drift is continued as an exponential or a straight line, whatever it will do
    after = slice(identified(whole), None)
    blind = pj.Record.from_arrays(
        whole.time, whole.input, np.full(len(whole), np.nan), aux=whole.aux
    )
    predicted = found.model.predict(blind)
    rms = np.sqrt(np.mean((whole.output[after] - predicted.output[after]) ** 2))
    # What was left over where the model was judged, the stretch that follows may show as well.
    budget = found.budget
    rest = np.hypot(np.hypot(budget.discretisation, budget.memory), budget.unexplained)
    assert rms <= 2 * noise + rest


@pytest.mark.parametrize(
    "options", [{"noise_colour": 0.9}, {"unknown_start": True}, {"decoy": True}]
)
def test_names_nothing_where_nothing_is_hidden(options):
    _, whole = hidden(None, 204, **options)
    found = pj.diagnose(whole.part(0, identified(whole)), levels=LEVELS)
    assert found.effects == ()
    assert [candidate.accepted for candidate in found.candidates].count(True) == 0
    if "decoy" in options:
        assert any(candidate.effect.startswith("aux:") for candidate in found.candidates)


@pytest.mark.parametrize(
    ("effects", "levels", "rate_hz"),
    [
        (("input_lag", "slew_limit", "drift", "resonance"), 19, RATE_HZ),
        pytest.param(None, 19, RATE_HZ, marks=pytest.mark.campaign),
        pytest.param(None, None, FINE_HZ, marks=pytest.mark.campaign),
    ],
)
def test_an_effect_outside_the_library_is_not_called_adequate(effects, levels, rate_hz):
    _, whole = hidden("stick_slip", 205, rate_hz)
    found = pj.diagnose(whole.part(0, identified(whole)), effects, levels=levels)
    assert found.verdict in ("unexplained", "partly_explained")
    assert "%" in found.located
    assert found.next_experiment is not None


@pytest.fixture(scope="module")
def drifting():
    made, whole = hidden("drift", 207)
    return made, pj.diagnose(whole.part(0, HALF), ["drift", "creep"], levels=LEVELS)


@pytest.mark.parametrize("seed", [1, pytest.param(3, marks=pytest.mark.campaign)])
def test_a_resonance_and_a_drift_of_like_size_are_both_named(seed):
    """Either is small beside what the other leaves."""
    stage = pj.simulate_stage(
        seed=seed, seconds=6.0, rate_hz=1000.0, effects=("resonance", "drift")
    )
    record = pj.Record.from_arrays(stage.time, stage.input, stage.output)
    found = pj.diagnose(record, ["resonance", "drift", "creep", "output_lag"], levels=LEVELS)
    assert set(found.effects) == {"resonance", "drift"}
    assert found.verdict == "explained"
    errors = [rung.rms_validation for rung in found.ladder]
    assert errors[1] > 0.3 * errors[0]  # the first of them leaves much of the whole
    assert errors[2] < 0.2 * errors[1]
    by_name = {finding.effect: finding.parameters for finding in found.findings}
    truth = stage.truth["parameters"]["resonance"]["f_hz"]
    assert by_name["resonance"]["f_hz"].value == pytest.approx(truth, rel=0.02)


def test_json_holds_what_the_contract_names(drifting):
    _, found = drifting
    content = json.loads(json.dumps(found.to_json()))
    assert content["verdict"] in VERDICTS
    assert content["effects"] == ["drift"]
    assert set(content["budget"]) == {
        "noise", "input_quantisation", "output_quantisation", "discretisation", "memory",
        "unexplained", "unit",
    }  # fmt: skip
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
    assert estimate.low <= truth["amplitude_um"] * HALF / (SECONDS * RATE_HZ) <= estimate.high


@pytest.mark.parametrize("threads", ["1", "2"])
def test_same_record_same_outcome_on_any_number_of_threads(drifting, monkeypatch, threads):
    monkeypatch.setenv("OMP_NUM_THREADS", threads)
    made, found = drifting
    _, whole = hidden("drift", 207)
    again = pj.diagnose(whole.part(0, HALF), ["drift", "creep"], levels=LEVELS)
    assert again.to_json() == found.to_json()
    assert made["truth"]["effect"] == "drift"


def test_progress_goes_forward_and_ends_below_one():
    _, whole = hidden(None, 207)
    seen = []
    pj.diagnose(whole.part(0, 4000), ["drift"], levels=9, progress=lambda *step: seen.append(step))
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


# --- effects that a record cannot tell apart ---


class Warming(pj.AddedEffect):
    """A straight line in time: what a drift is, too, if it is slow."""

    name = "warming"

    def coefficients(self):
        return (pj.Parameter("per_s", "{z}/s", -jnp.inf, jnp.inf),)

    def columns(self, signals):
        return signals.time[:, None]


def jumping(time, rng):
    """A zero that jumps between two levels, at random times some two seconds apart."""
    switched = np.cumsum(rng.random(len(time)) < np.diff(time, prepend=0.0) / 2.0)
    return 0.1 * (switched % 2)


def slipping(time, rng):
    """The same, each time within some forty samples: too slow for a sensor that jumps."""
    return np.convolve(np.pad(jumping(time, rng), 20, mode="edge"), np.ones(41) / 41, "valid")


def wandering(time, rng):
    """A zero that wanders smoothly, by waves whose periods are no multiples of the record."""
    periods, phases = (23.0, 9.1, 5.3), rng.uniform(0, 2 * np.pi, 3)
    waves = [np.cos(2 * np.pi * time / p + f) for p, f in zip(periods, phases, strict=True)]
    return 0.1 * np.sum(waves, axis=0)


@pytest.mark.parametrize(
    ("moves", "seed", "effects", "verdict"),
    [
        (jumping, 5, (), "adequate"),  # the jumps are taken back
        (slipping, 5, (), "unexplained"),
        pytest.param(wandering, 6, ("drift",), "explained", marks=pytest.mark.campaign),
    ],
)
def test_slow_waves_are_no_name_for_a_zero_that_jumps(moves, seed, effects, verdict):
    _, still = hidden(None, seed, FINE_HZ)
    moved = still.output + moves(still.time, np.random.default_rng(seed))
    record = pj.Record.from_arrays(still.time, still.input, moved)
    found = pj.diagnose(record.part(0, identified(still)), ["drift", "creep"], levels=25)
    assert (found.effects, found.verdict) == (effects, verdict)


@pytest.mark.parametrize(
    ("levels", "names"),
    [
        # Which of them leads, the cells decide.
        pytest.param(30, {"ageing", "drift"}, marks=pytest.mark.campaign),
        pytest.param(None, {"ageing"}, marks=pytest.mark.campaign),
    ],
)
def test_the_bundled_curves_age_or_drift_and_do_not_hum(levels, names):
    """The grid's error repeats with each curve and makes a comb of lines; none of them is a hum."""
    path = resources.files("preisach_jax") / "bundled" / "conventional_example.forc"
    with resources.as_file(path) as file:
        record = pj.Record.load(file)
    found = pj.diagnose(record, ("drift", "hum", "ageing"), levels=levels)
    (name,) = found.effects
    assert name in names
    assert set(found.findings[0].family) == {"ageing", "drift"}
    assert found.verdict == "explained"


def test_no_name_where_hysteresis_is_not_what_makes_the_output():
    """The force of a damper goes with the speed, which looks like a lag."""
    rng = np.random.default_rng(5)
    t = np.arange(6000) / 250
    rate_hz = np.where(np.floor(t / 2) % 4 < 1, 4.6, 3.0)
    u = 5.0 * np.sin(2 * np.pi * np.cumsum(rate_hz) / 250)
    force = np.gradient(u, t) * (1 + 2 * (np.floor(t / 3) % 2)) + rng.normal(size=len(t))
    found = pj.diagnose(pj.Record.from_arrays(t, u, force), ["output_lag"], levels=13)
    assert found.verdict == "unexplained"
    assert found.effects == ()
    (candidate,) = found.candidates
    assert candidate.gain > 0.3
    assert not candidate.accepted
    assert "misses most of the output" in candidate.why_not
    assert len(found.ladder) == 1


@pytest.fixture(scope="module")
def alike():
    """A record with a straight drift, and two effects that both are one."""
    made, whole = hidden("drift", 207)
    assert made["truth"]["kind"] == "linear"
    record = whole.part(0, HALF)
    return record, pj.diagnose(record, ["drift", "delay", Warming()], levels=11)


def test_each_other_member_of_a_family_is_fitted_as_an_alternative(alike):
    record, found = alike
    (finding,) = found.findings
    assert sorted(finding.family) == ["drift", "warming"]
    (rival,) = finding.family[1:]
    assert list(found.alternatives) == [rival]
    model = found.alternatives[rival]
    assert [effect.name for effect in model.effects] == [rival]
    assert model.rms_validation == pytest.approx(found.model.rms_validation, rel=0.05)
    assert model.rms_validation < 0.25 * found.base.rms_validation
    there, here = model.predict(record).output, found.model.predict(record).output
    assert np.sqrt(np.mean((there - here) ** 2)) < found.model.rms_validation


def test_the_report_writes_the_alternatives(alike, tmp_path):
    record, found = alike
    (rival,) = found.alternatives
    files = write_report(found, tmp_path)
    path = tmp_path / "alternatives" / f"{rival}.json"
    assert path in files
    again = Model.load(path, effects=[Warming()])
    expected = found.alternatives[rival].predict(record).output
    np.testing.assert_array_equal(again.predict(record).output, expected)


# --- candidates that cannot work ---


class TooShort(pj.InputEffect):
    """A lag whose bounds keep it far below that of the record."""

    name = "too_short"

    tau_s: float = pj.parameter("s", 1e-6, 1e-5, start=(3e-6,), log=True)

    def apply(self, signal, time):
        rate = jnp.diff(signal, prepend=signal[:1]) / jnp.maximum(
            jnp.diff(time, prepend=time[:1] - 1.0), 1e-9
        )
        return signal - self.tau_s * rate


def test_a_useless_column_or_bound_is_told_of_that_candidate_alone():
    made, whole = hidden("input_lag", 206)
    columns = {"copy": whole.input, "still": np.full(len(whole), 23.5)}
    record = pj.Record.from_arrays(whole.time, whole.input, whole.output, aux=columns)
    record = record.part(0, HALF)
    found = pj.diagnose(
        record, [TooShort(), "input_lag", "aux:copy", "aux:still", "drift"], levels=11
    )
    assert found.effects == ("input_lag",)
    estimate = found.findings[0].parameters["tau_s"]
    assert estimate.value == pytest.approx(made["truth"]["tau_s"], rel=0.02)
    tried = {candidate.effect: candidate for candidate in found.candidates}
    for name in ("too_short", "aux:copy", "aux:still", "drift"):
        assert not tried[name].accepted
        assert tried[name].why_not
    assert tried["aux:still"].why_not == "the column is constant (23.5): nothing can be seen"
    with pytest.raises(pj.InputError, match=r"column still: .*constant \(23.5\)"):
        pj.fit(record, ["aux:still"], levels=11)


# --- a stage just switched on, whose loops grow ---


def growing_loops(creep_share, seed, count=4000, rate_hz=250.0):
    """Plays driven from rest by ever greater cycles; a share of the stroke comes late."""
    time = np.arange(count) / rate_hz
    amplitude = 0.15 + 0.85 * time / time[-1]
    drive = 50 * amplitude * (1 - np.cos(2 * np.pi * (0.6 * time + 0.05 * time**2)))
    radii = np.geomspace(1, 40, 30)
    play, stroke = np.zeros(30), np.empty(count)
    for k, u in enumerate(drive):
        play = np.clip(play, u - radii, u + radii)
        stroke[k] = 0.5 * u + 0.02 * play.sum()
    output = stroke + 0.008 * np.random.default_rng(seed).normal(size=count)
    for tau in (0.3, 3.0):
        share = 1 - np.exp(-1 / rate_hz / tau)
        output += creep_share / 2 * (signal.lfilter([share], [1, share - 1], stroke) - stroke)
    return pj.Record.from_arrays(time, drive, output)


@pytest.mark.parametrize(
    ("creep_share", "effects", "levels"),
    [
        pytest.param(0.03, ("creep",), 25, marks=pytest.mark.campaign),
        (0.0, (), None),
        pytest.param(0.03, ("creep",), None, marks=pytest.mark.campaign),
    ],
)
def test_a_creep_in_growing_loops_is_not_taken_for_a_lag(creep_share, effects, levels):
    found = pj.diagnose(growing_loops(creep_share, 203), ["creep", "input_lag"], levels=levels)
    assert found.effects == effects
    assert [finding.family for finding in found.findings] == [(name,) for name in effects]


def test_a_hum_that_the_search_took_for_another_is_found_on_all_rows(x64):
    time = np.arange(6000) / 300.0
    drive = 40 - 40 * np.cos(2 * np.pi * time * (0.3 + 0.01 * time))
    noise = 0.001 * np.random.default_rng(3).normal(size=len(time))
    output = 0.1 * drive + 0.05 * np.sin(2 * np.pi * 50.05 * time + 0.4) + noise
    record = pj.Record.from_arrays(time, drive, output)
    problem, thinned = Problem.of(record), Problem.of(record, 3000)
    hum = pj.effects()["hum"].bound_to(problem.survey_of(base_point(problem, 7)))
    chain = Chain(plane_of(problem, 7), (hum,))
    astray = refine(thinned, evaluate(thinned, chain, {"hum": {"f_hz": 49.98}}, 1e-3))
    assert abs(astray.values["hum"]["f_hz"] - 50.05) > 0.01  # a side lobe holds it
    moved = moved_to(problem, astray)
    assert moved.values["hum"]["f_hz"] == pytest.approx(50.05, abs=1e-3)
    assert moved.validation_mean_square * problem.unit**2 < 1.5 * 0.001**2

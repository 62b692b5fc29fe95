"""The diagnosis on simulated stages with a hidden effect, made by code that it does not share."""

import found as made_once
import jax.numpy as jnp
import numpy as np
import pytest
from found import LEVELS, LIKELIEST, ROWS, UNITS, record_of
from oracles import play
from scipy import signal

import preisach_jax as pj
from preisach_jax.chain.description import Chain
from preisach_jax.fit.stepwise import base_point, moved_to, plane_of
from preisach_jax.identify.gauss_newton import refine
from preisach_jax.identify.problem import Problem, evaluate
from preisach_jax.model import Model
from preisach_jax.report import write_report

pytestmark = pytest.mark.slow

HIDDEN = [effect for effect in LIKELIEST if effect not in (None, "stick_slip")]


@pytest.mark.parametrize("effect", HIDDEN)
def test_names_what_is_hidden_and_removes_its_error(effect):
    found = made_once.found(effect)
    made, name = made_once.made(effect)
    assert found.effects == (name,)
    assert found.verdict == "explained"
    assert found.budget.is_met  # the verdict agrees with its budget
    base, final = found.base.rms_validation, found.final.rms_validation
    assert base - final >= 0.85 * (base - made_once.found().final.rms_validation)
    assert found.budget.noise == pytest.approx(made["noise_um"], rel=0.15)


@pytest.mark.parametrize("effect", ["output_lag", "aux"])
def test_predicts_what_follows(effect):
    whole, found = made_once.whole(effect), made_once.found(effect)
    blind = pj.Record.from_arrays(
        whole.time, whole.input, np.full(len(whole), np.nan), aux=whole.aux
    )
    missed = (whole.output - found.model.predict(blind).output)[ROWS:]
    # What was left over where the model was judged, the stretch that follows may show as well.
    budget, noise = found.budget, made_once.made(effect)[0]["noise_um"]
    rest = np.linalg.norm([budget.discretisation, budget.memory, budget.unexplained])
    assert np.sqrt(np.mean(missed**2)) <= 2 * noise + rest


@pytest.mark.parametrize("effect", [None, pytest.param("output_lag", marks=pytest.mark.campaign)])
def test_the_whole_library_holds_no_better_name(effect):
    """Neither for an effect, nor for coloured noise, an unknown past and a column without use."""
    spoiled = {} if effect else {"noise_colour": 0.9, "unknown_start": True, "decoy": True}
    found = made_once.found(effect, 204, True, **spoiled)
    assert found.effects == ((effect,) if effect else ())
    accepted = [candidate.effect for candidate in found.candidates if candidate.accepted]
    assert accepted == list(found.effects)
    tried = {candidate.effect.split(":")[0] for candidate in found.candidates}
    assert tried >= {"creep", "drift", "resonance", *(() if effect else ("aux",))}


def test_nothing_hidden_is_adequate_and_its_budget_is_met():
    found = made_once.found()
    assert (found.verdict, found.effects, len(found.ladder)) == ("adequate", (), 1)
    assert found.budget.is_met
    assert not [candidate for candidate in found.candidates if candidate.accepted]


def test_an_effect_outside_the_library_is_not_called_adequate():
    found = made_once.found("stick_slip", noise_um=0.02, size=4.0)
    assert found.verdict in ("unexplained", "partly_explained")
    assert not found.budget.is_met
    assert "%" in found.located
    assert found.next_experiment is not None


def test_progress_goes_forward_and_two_threads_find_the_same_as_one(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    seen = []
    again = pj.diagnose(
        record_of("hum"),
        ("hum", *LIKELIEST["hum"]),
        levels=LEVELS,
        progress=lambda *step: seen.append(step),
    )
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    assert again.to_json() == made_once.found("hum").to_json()
    shares = [share for _, share in seen]
    assert shares == sorted(shares)
    assert 0 <= shares[0] <= shares[-1] <= 1
    assert any("hum" in text for text, _ in seen)


class Warming(pj.AddedEffect):
    """A straight line in time: what a drift is, too, if it is slow."""

    name = "warming"

    def coefficients(self):
        return (pj.Parameter("per_s", "{z}/s", -jnp.inf, jnp.inf),)

    def columns(self, signals):
        return signals.time[:, None]


class TooShort(pj.InputEffect):
    """A lag whose bounds keep it far below that of the record."""

    name = "too_short"

    tau_s: float = pj.parameter("s", 1e-6, 1e-5, start=(3e-6,), log=True)

    def apply(self, signal, time):
        steps = jnp.maximum(jnp.diff(time, prepend=time[:1] - 1.0), 1e-9)
        return signal - self.tau_s * jnp.diff(signal, prepend=signal[:1]) / steps


def test_the_other_member_of_a_family_is_fitted_told_and_written(tmp_path):
    record = record_of("drift")
    found = pj.diagnose(record, ["drift", Warming()], levels=LEVELS)
    (finding,) = found.findings
    assert sorted(finding.family) == ["drift", "warming"]
    (rival,) = finding.family[1:]
    assert list(found.alternatives) == [rival]
    model = found.alternatives[rival]
    assert [effect.name for effect in model.effects] == [rival]
    assert model.rms_validation == pytest.approx(found.model.rms_validation, rel=0.05)
    there, here = model.predict(record).output, found.model.predict(record).output
    assert np.sqrt(np.mean((there - here) ** 2)) < found.model.rms_validation
    path = tmp_path / "alternatives" / f"{rival}.json"
    assert path in write_report(found, tmp_path)
    np.testing.assert_array_equal(
        Model.load(path, effects=[Warming()]).predict(record).output, there
    )


def test_a_useless_column_or_bound_is_told_of_that_candidate_alone():
    plain = record_of("input_lag")
    columns = {"copy": plain.input, "still": np.full(ROWS, 23.5)}
    record = pj.Record.from_arrays(plain.time, plain.input, plain.output, aux=columns, units=UNITS)
    useless = ("too_short", "aux:copy", "aux:still")
    found = pj.diagnose(record, [TooShort(), "input_lag", *useless[1:]], levels=LEVELS)
    assert found.effects == ("input_lag",)
    truth = made_once.made("input_lag")[0]["truth"]["tau_s"]
    assert found.findings[0].parameters["tau_s"].value == pytest.approx(truth, rel=0.05)
    tried = {candidate.effect: candidate for candidate in found.candidates}
    assert all(tried[name].why_not and not tried[name].accepted for name in useless)
    assert tried["aux:still"].why_not == "the column is constant (23.5): nothing can be seen"
    with pytest.raises(pj.InputError, match=r"column still: .*constant \(23.5\)"):
        pj.fit(record, ["aux:still"], levels=LEVELS)


def test_slow_waves_are_no_name_for_a_zero_that_slips():
    """Jumps between two levels, within some forty samples: too slow for a sensor that jumps."""
    still, rng = record_of(), np.random.default_rng(5)
    away = 1.0 * (np.cumsum(rng.random(ROWS) < 1 / 400) % 2)
    slow = np.convolve(np.pad(away, 20, mode="edge"), np.ones(41) / 41, "valid")
    record = pj.Record.from_arrays(still.time, still.input, still.output + slow)
    found = pj.diagnose(record, ["drift", "creep"], levels=LEVELS)
    assert (found.effects, found.verdict) == ((), "unexplained")


def test_no_name_where_hysteresis_is_not_what_makes_the_output():
    """The force of a damper goes with the speed, which looks like a lag."""
    rng = np.random.default_rng(5)
    t = np.arange(ROWS) / 125
    rate_hz = np.where(np.floor(t / 2) % 4 < 1, 4.6, 3.0)
    u = 5.0 * np.sin(2 * np.pi * np.cumsum(rate_hz) / 125)
    force = np.gradient(u, t) * (1 + 2 * (np.floor(t / 3) % 2)) + rng.normal(size=len(t))
    found = pj.diagnose(pj.Record.from_arrays(t, u, force), ["output_lag"], levels=LEVELS)
    assert (found.verdict, found.effects) == ("unexplained", ())
    (candidate,) = found.candidates
    assert candidate.gain > 0.3
    assert "misses most of the output" in candidate.why_not


@pytest.mark.parametrize("share", [0.0, pytest.param(0.03, marks=pytest.mark.campaign)])
def test_a_creep_in_growing_loops_is_not_taken_for_a_lag(share):
    """A stage just switched on: plays driven from rest by ever greater cycles."""
    time = np.arange(ROWS) / 187.5
    amplitude = 0.15 + 0.85 * time / time[-1]
    drive = 50 * amplitude * (1 - np.cos(2 * np.pi * (0.6 * time + 0.05 * time**2)))
    stroke = 0.5 * drive + 0.02 * sum(play(drive, r, 0.0) for r in np.geomspace(1, 40, 30))
    output = stroke + 0.008 * np.random.default_rng(203).normal(size=ROWS)
    for tau in (0.3, 3.0):
        keep = np.exp(-1 / 187.5 / tau)
        output += share / 2 * (signal.lfilter([1 - keep], [1, -keep], stroke) - stroke)
    record = pj.Record.from_arrays(time, drive, output)
    # Where nothing creeps, the grid of 13 levels is taken for a creep.
    found = pj.diagnose(record, ["creep"], levels=25)
    assert [finding.family for finding in found.findings] == ([("creep",)] if share else [])


def test_a_hum_that_the_search_took_for_another_is_found_on_all_rows(x64):
    time = np.arange(ROWS) / 150.0
    drive = 40 - 40 * np.cos(2 * np.pi * time * (0.3 + 0.01 * time))
    noise = 0.001 * np.random.default_rng(3).normal(size=len(time))
    output = 0.1 * drive + 0.05 * np.sin(2 * np.pi * 50.05 * time + 0.4) + noise
    record = pj.Record.from_arrays(time, drive, output)
    problem, thinned = Problem.of(record), Problem.of(record, ROWS // 2)
    hum = pj.effects()["hum"].bound_to(problem.survey_of(base_point(problem, LEVELS)))
    chain = Chain(plane_of(problem, LEVELS), (hum,))
    astray = refine(thinned, evaluate(thinned, chain, {"hum": {"f_hz": 49.98}}, 1e-3))
    assert abs(astray.values["hum"]["f_hz"] - 50.05) > 0.01  # a side lobe holds it
    moved = moved_to(problem, astray)
    assert moved.values["hum"]["f_hz"] == pytest.approx(50.05, abs=1e-3)
    assert moved.validation_mean_square * problem.unit**2 < 1.5 * 0.001**2

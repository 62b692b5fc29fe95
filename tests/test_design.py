"""What to measure next: excitations that keep their promises, and rivals that they separate."""

import importlib
import json
import re

import numpy as np
import pytest
import world
from blind import hidden

import preisach_jax as pj
from preisach_jax.cli import main
from preisach_jax.diagnosis.design import SUFFICIENT
from preisach_jax.diagnosis.excitation import Bounds, candidates, greatest_rate
from preisach_jax.errors import InputError
from preisach_jax.files import is_ours

RATE_HZ = 500.0
UNITS = {"input": "V", "output": "um"}
NOISE = 0.006

BOUNDS = [Bounds(0.0, 75.0, 174.0, 500.0, 8621, "V"), Bounds(-2.3, 3.1, 0.02, 0.5, 6000, "A")]


def in_seconds(text):
    """Times such as `53.3 ms` in a text, in s."""
    return [
        float(value) * (1e-3 if prefix else 1.0)
        for value, prefix in re.findall(r"([\d.]+(?:e[-+]\d+)?) (m?)s\b", text)
    ]


# Excitations


@pytest.mark.parametrize("bounds", BOUNDS)
def test_excitations_keep_to_range_and_rate(bounds):
    names = [each.name for each in candidates(bounds)]
    assert names == [
        "triangles", "holds", "minor_loops", "multisine", "reference_loops", "combination",
    ]  # fmt: skip
    for each in candidates(bounds):
        u = each.input
        assert u.shape == (bounds.samples,)
        assert (u.min(), u.max()) == (bounds.low, bounds.high), each.name
        assert (u[0], u[-1]) == (bounds.low, bounds.low), each.name
        assert np.abs(np.diff(u)).max() * bounds.rate_hz <= bounds.fastest * (1 + 1e-6), each.name


@pytest.mark.parametrize("bounds", BOUNDS)
def test_holds_span_two_decades_in_both_directions(bounds):
    (found,) = [each for each in candidates(bounds) if each.name == "holds"]
    u, still = found.input, np.diff(found.input, prepend=np.nan, append=np.nan) == 0
    first, last = np.flatnonzero(np.diff(still)).reshape(-1, 2)[:-1].T  # the end is none
    lengths, rising = (last - first) / bounds.rate_hz, u[first - 1] < u[first]
    assert rising.tolist() == [True] * 5 + [False] * 5
    said = in_seconds(found.text)
    for direction in (rising, ~rising):
        np.testing.assert_allclose(lengths[direction], said, rtol=0.006, atol=1 / bounds.rate_hz)
    assert max(said) / min(said) == pytest.approx(100, rel=0.02)
    assert sum(lengths) > 0.6 * bounds.seconds


def test_the_greatest_rate_is_that_of_moves_and_not_of_noise():
    time = np.arange(2000) / 100
    ramp = 4.0 * np.abs((time % 10) - 5)
    noisy = ramp + np.random.default_rng(0).normal(size=len(ramp)) * 0.02
    assert np.abs(np.diff(noisy)).max() * 100 > 8  # what neighbours would say
    assert greatest_rate(np.stack([time, noisy])) == pytest.approx(4.0, rel=0.15)
    assert greatest_rate(np.stack([time, ramp])) == pytest.approx(4.0)


# Rivals


def answer(u):
    """What an actuator of an independent make that creeps answers to an input."""
    fine = round(world.INNER_RATE / RATE_HZ)
    step = 1 / (RATE_HZ * fine)
    t, time = np.arange((len(u) - 1) * fine + 1) * step, np.arange(len(u)) / RATE_HZ
    h = world.make_world(5).hysteresis(np.interp(t, time, u))
    h = h + sum(0.02 * hidden.lag(h, tau, step) for tau in (0.05, 0.4, 3.0))
    z = h[::fine] + NOISE * np.random.default_rng(1).normal(size=len(u))
    return pj.Record.from_arrays(time, u, z, units=UNITS, initial_memory="low")


@pytest.fixture(scope="module")
def poor():
    """Six seconds at one rate of an actuator that creeps."""
    return answer(world.excitation("poor", 6.0, RATE_HZ, 1))


@pytest.fixture(scope="module")
def rivals(poor):
    return [pj.fit(poor, (name,), levels=5).model for name in ("creep", "drift")]


@pytest.fixture(scope="module")
def plan(rivals):
    return pj.design(rivals, 0.01)


def test_the_candidate_with_the_greatest_least_separation_is_chosen(plan):
    least = {name: min(pairs.values()) for name, pairs in plan.separations.items()}
    assert plan.excitation == max(least, key=lambda name: least[name])
    assert set(plan.separations[plan.excitation]) == {"creep not drift", "drift not creep"}
    assert plan.sufficient
    assert "500 Hz" in plan.text
    assert f"{least[plan.excitation]:.3g} times" in plan.why


def test_the_plan_separates_what_it_promises_on_an_actuator_that_creeps(plan):
    record = answer(plan.input)
    right, wrong = (pj.fit(record, (name,), levels=9).rms_validation for name in ("creep", "drift"))
    assert wrong / right > SUFFICIENT


def test_without_rivals_the_record_shows_everything(rivals):
    plan = pj.design(rivals[:1], 0.01, seconds=40.0, rate_limit=90.0)
    assert len(plan.time) == 40 * RATE_HZ
    assert np.abs(np.diff(plan.input)).max() * RATE_HZ == pytest.approx(90.0, rel=0.02)
    assert (plan.excitation, plan.separations, plan.sufficient) == ("combination", {}, True)
    assert "preisach compare" in plan.text
    unexplained = rivals[1].with_budget(0.006, 0.002)
    assert unexplained.rms_validation > 0.02
    plan = pj.design([unexplained], 0.006)
    assert "three times" in plan.text
    assert "repeats" in plan.why


def test_equal_models_are_separated_nowhere_and_their_columns_are_kept_or_varied(poor, rivals):
    aux = {"load_N": np.sin(poor.time)}
    record = pj.Record.from_arrays(
        poor.time, poor.input, poor.output + aux["load_N"], aux=aux, units=UNITS
    )
    loaded = pj.fit(record, ("aux:load_N",), levels=5).model
    same = pj.design([loaded, loaded], 0.5)
    ratios = [ratio for pairs in same.separations.values() for ratio in pairs.values()]
    np.testing.assert_allclose(ratios, 1.0)
    assert not same.sufficient
    assert "no candidate" in same.why
    assert "Keep load_N constant" in same.text
    plan = pj.design([rivals[0], loaded], 0.01)
    assert not plan.sufficient
    assert "steps of load_N while the input rests" in plan.text


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"noise": 0.0}, "noise is 0"),
        ({"seconds": float("inf")}, "finite"),
        ({"seconds": 3.0}, r"at least [\d.]+ s; give more"),
        ({"rate_limit": 0.0}, "rate_limit is 0"),
    ],
)
def test_numbers_that_cannot_be_used_are_refused(rivals, options, said):
    with pytest.raises(InputError, match=said):
        pj.design(rivals, **({"noise": 0.01} | options))
    with pytest.raises(InputError, match="at least one"):
        pj.design([], 0.01)


# The command


def write_report(folder, rivals):
    """What the command reads of a report."""
    (folder / "alternatives").mkdir(parents=True)
    names = [model.effects[-1].name for model in rivals]
    content = {
        "verdict": "explained",
        "findings": [{"effect": names[0], "family": names}],
        "budget": {"noise": 0.008, "discretisation": 0.006, "unexplained": 0.0, "unit": "um"},
    }
    (folder / "diagnosis.json").write_text(json.dumps(content))
    rivals[0].save(folder / "model.json")
    for name, model in zip(names[1:], rivals[1:], strict=True):
        model.save(folder / "alternatives" / f"{name}.json")
    return folder


def test_the_command_writes_what_design_chooses(rivals, plan, tmp_path, capsys, monkeypatch):
    asked = []
    module = importlib.import_module("preisach_jax.diagnosis.design")
    monkeypatch.setattr(module, "design", lambda *a, **k: asked.append((a, k)) or plan)
    report, out = write_report(tmp_path / "report", rivals), tmp_path / "next.csv"
    assert main(["design", str(report), "--out", str(out)]) == 0
    shown = capsys.readouterr().out
    [((models, noise), _)] = asked
    assert [[effect.name for effect in model.effects] for model in models] == [["creep"], ["drift"]]
    assert noise == pytest.approx(0.01)  # the budget adds up
    assert plan.text in shown
    for row in plan.rows():
        assert " ".join(row) in re.sub(" +", " ", shown)
    assert f"{len(plan.time):,} rows" in shown
    assert is_ours(out)  # so that it may be written again
    written = np.loadtxt(out, delimiter=",", skiprows=1)
    np.testing.assert_array_equal(written, np.stack([plan.time, plan.input], axis=1))
    assert out.read_text().startswith("t_s,u_V\n0e0,")


def complaint(capsys, *words):
    """Exit code 2, nothing on stdout, and one line on stderr: the message."""
    assert main(["design", *map(str, words)]) == 2
    shown = capsys.readouterr()
    assert shown.out == ""
    assert shown.err.count("\n") == 1
    return shown.err


def test_mistakes_get_one_clear_line(rivals, tmp_path, capsys):
    report, out = write_report(tmp_path / "report", rivals), tmp_path / "next.csv"
    told = ("--out", out)
    assert "no diagnosis.json" in complaint(capsys, tmp_path, *told)
    assert "--seconds is 0" in complaint(capsys, report, *told, "--seconds", "0")
    assert "at least" in complaint(capsys, report, *told, "--seconds", "2")
    for read in ("model.json", "diagnosis.json", "alternatives/drift.json"):
        assert "would be lost" in complaint(capsys, report, "--out", report / read)
    rivals[0].save(report / "alternatives" / "drift.json")
    assert "lacks drift" in complaint(capsys, report, *told)
    (report / "alternatives" / "drift.json").unlink()
    assert "drift is missing" in complaint(capsys, report, *told)
    for text in ("{", '{"findings": [], "budget": {"noise": "much"}}'):
        (report / "diagnosis.json").write_text(text)
        assert "damaged" in complaint(capsys, report, *told)
    assert not out.exists()

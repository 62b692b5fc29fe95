"""A sparse form where no name fits: found when hidden, silent where nothing is, never a cause."""

import json
import re
from functools import cache

import numpy as np
import pytest
import scipy
from found import LEVELS
from found import ROWS as SAMPLES
from oracles import play
from stand_ins import make_diagnosis

import preisach_jax as pj
from preisach_jax.cli import main
from preisach_jax.diagnosis.form import LABEL, SparseForm
from preisach_jax.diagnosis.freed import FreedTerms
from preisach_jax.diagnosis.pursuit import sought
from preisach_jax.diagnosis.terms import library_of
from preisach_jax.fit.fitted import FINAL_ROWS, with_regressors
from preisach_jax.fit.stepwise import double_precision
from preisach_jax.identify.problem import Problem
from preisach_jax.plot.diagnosis import dependence
from preisach_jax.report import write_report

NOISE, RATE_HZ = 0.01, 250
UNITS = {"input": "V", "output": "um"}


def late(values, time, tau):
    """What follows values with a time constant, from the first of them on."""
    keep = np.exp(-(time[1] - time[0]) / tau)
    return scipy.signal.lfilter([1 - keep], [1, -keep], values, zi=[keep * values[0]])[0]


LAWS = {
    None: lambda t, u, v: 0 * t,
    "cube of the rate": lambda t, u, v: v**3,
    "warming": lambda t, u, v: late(v**2, t, 0.21),
    "power of the rate": lambda t, u, v: np.sign(v) * np.abs(v) ** 1.4,
}


def hidden_record(kind, seed):
    """Moves of many heights and speeds through plays, with a law hidden, and what that gives."""
    rng = np.random.default_rng(seed)
    time = np.arange(SAMPLES) / RATE_HZ
    turns = np.where(np.arange(100) % 2, 1, -1) * rng.uniform(1, 5, 100)
    corners = np.cumsum(10 ** rng.uniform(-1.3, -0.3, 100))
    u = 5 + np.interp(time, (corners - corners[0]) * time[-1] / np.ptp(corners), turns)
    output = np.zeros(SAMPLES)
    for radius in np.linspace(0.05, 3, 30):
        output += play(u, radius) * np.exp(-radius) / 12
    rate = np.gradient(u, time)
    law = LAWS[kind](time, u, rate / np.quantile(np.abs(rate), 0.98))
    law = 0.2 * law / (law.std() or 1.0)
    noise = NOISE * np.random.default_rng(seed + 50).normal(size=SAMPLES)
    return pj.Record.from_arrays(time, u, output + law + noise, units=UNITS), law


@cache
def diagnosed(kind):
    """The diagnosis of a record with that law, what the law gives, and the form that is found."""
    record, law = hidden_record(kind, 901)
    found = pj.diagnose(record, ["drift"], levels=LEVELS)
    return found, law, pj.find_form(found, draws=3)


@pytest.mark.parametrize(
    ("kind", "formula", "number"),
    [
        ("cube of the rate", "u'³", None),
        ("warming", r"low-pass of u'² over ([\d.]+) s", 0.21),  # between those of the library
        ("power of the rate", r"sgn\(u'\) \|u'\|\^([\d.]+)", 1.4),
    ],
)
def test_a_hidden_law_is_found_and_its_error_taken_away(kind, formula, number):
    found, law, form = diagnosed(kind)
    assert found.verdict == "unexplained"
    assert form.offered, form.why_not
    record = found.base.record
    without = pj.Record.from_arrays(record.time, record.input, record.output - law)
    assert form.rms_after < 1.3 * pj.fit(without, levels=LEVELS).rms_validation
    assert form.rms_before == pytest.approx(found.final.rms_validation, rel=0.05)
    assert form.terms[0].physics == form.physics[0]
    assert form.evidence["gain"] > form.chance
    assert found.effects == ()  # a form is no effect
    told = re.search(formula, form.formula)
    assert told, form.formula
    if number:
        assert float(told[1]) == pytest.approx(number, rel=0.15)
        return
    term = form.terms[0]
    (state,) = term.states
    value = (np.gradient(record.input, record.time) - state.centre) / state.scale
    assert term.coefficient == pytest.approx(np.polyfit(value**3, law, 1)[0], rel=0.02)
    assert (term.formula, state.symbol, state.unit) == ("u'³", "u'", "V/s")


def test_no_form_is_offered_where_nothing_is_hidden():
    found, _, form = diagnosed(None)
    assert not form.offered
    with double_precision():  # whatever the verdict
        alone = sought(found.final, found.budget.discretisation, 0, 3)
    assert not alone.offered
    assert alone.why_not
    assert alone.to_json() is None


def test_chance_is_the_same_for_the_same_seed_and_another_for_another():
    found, _, _ = diagnosed("cube of the rate")
    form, again, other = (pj.find_form(found, seed=seed, draws=2) for seed in (0, 0, 1))
    assert again.to_json() == form.to_json()
    assert again.chance == form.chance != other.chance
    assert other.terms == form.terms
    assert form.draws == 2


def test_the_pursuit_takes_what_least_squares_takes():
    found, _, _ = diagnosed("cube of the rate")
    record = found.base.record
    problem = Problem.of(record, FINAL_ROWS)
    with double_precision():
        point = with_regressors(problem, found.final)
        library = library_of(record, found.final.prediction, np.arange(len(record)))
        terms = FreedTerms.of(problem, point, library)
    rows = terms.projection.rows
    goal = np.random.default_rng(1).normal(size=len(terms.remainder)) + 30 * (
        terms.left[:, 20] - terms.left[:, 40]
    )
    powers = [
        np.linalg.lstsq(terms.left[rows][:, [k]], goal[rows], rcond=None)[1][0]
        for k in range(len(terms.listed))
    ]
    pursued = [chosen for _, chosen in terms.pursued(goal, sharpened=False)]
    (first,), pair = pursued[:2]
    assert powers[first] <= 1.02 * min(powers)
    left = terms.after(goal, pair)[rows]
    direct = np.linalg.lstsq(terms.left[rows][:, pair], goal[rows], rcond=None)[1][0]
    assert left @ left == pytest.approx(direct)


def test_memories_are_first_order_low_passes():
    record, _ = hidden_record(None, 7)
    library = library_of(record, record.output, np.arange(SAMPLES))
    found = [t for t in library.terms if t.formula.startswith("low-pass of u over")]
    assert len(found) == 6
    state = found[2].states[0]
    plain = (record.input - state.centre) / state.scale
    expected = late(plain, record.time, float(found[2].formula.split()[-2]))
    # The time constant of the label is rounded.
    np.testing.assert_allclose(found[2].values, expected, atol=0.03)


def test_nothing_is_sought_where_nothing_is_left_and_mistakes_are_named():
    form = pj.find_form(make_diagnosis("explained"))
    assert not form.offered
    assert "explained" in form.why_not
    assert "No sparse form is offered" in form.sentence
    with pytest.raises(pj.InputError, match="draws is 0; give"):
        pj.find_form(make_diagnosis("unexplained"), draws=0)
    with pytest.raises(pj.InputError, match="no terms to draw"):
        dependence(SparseForm.none(0.1, "um", "it is a test"))


def test_the_picture_has_what_the_form_holds():
    _, _, form = diagnosed("cube of the rate")
    (axes,) = dependence(form).axes
    assert axes.get_xlabel() == "rate of the input (V/s)"
    assert axes.get_ylabel() == "mean remainder (nm)"
    assert LABEL in axes.get_title(loc="left")
    points, line = (np.asarray(each.get_ydata(), dtype=float) for each in axes.lines[1:3])
    assert form.dependence is not None
    np.testing.assert_allclose(points, 1e3 * form.dependence.remainder)
    np.testing.assert_allclose(line, 1e3 * form.dependence.form)


def test_json_report_and_texts_say_that_it_is_no_cause(tmp_path):
    plain, form = make_diagnosis("unexplained"), diagnosed("cube of the rate")[2]
    found = make_diagnosis("unexplained", form=form)
    assert found.to_json() | {"form": None} == plain.to_json()  # nothing else changes
    content = json.loads(json.dumps(found.to_json()["form"], allow_nan=False))
    assert set(content) == {
        "label", "formula", "terms", "rms_before", "rms_after", "unit", "evidence", "chance",
        "draws", "where_to_look", "notes",
    }  # fmt: skip
    assert content["label"] == LABEL == "form, not cause"
    assert set(content["terms"][0]) == {"formula", "coefficient", "rms", "physics", "states"}
    assert tmp_path / "form.svg" in write_report(found, tmp_path)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    for text in ("A form of what remains", "This is a form, not a cause", form.physics[0],
                 "u&#39;³", "nm RMS"):  # fmt: skip
        assert text in page, text
    assert LABEL in found.summary()
    assert LABEL in found._repr_html_()


@pytest.mark.parametrize("interrupted", [False, True])
def test_the_command_looks_for_a_form_where_it_is_asked(tmp_path, capsys, monkeypatch, interrupted):
    """The report without a form stays where the search for one is interrupted."""
    found, _, form = diagnosed("cube of the rate")

    def searched(found, progress):
        progress("making terms", 0.0)
        if interrupted:
            raise KeyboardInterrupt
        return form

    monkeypatch.setattr("preisach_jax.diagnosis.diagnose", lambda *_, **__: found)
    monkeypatch.setattr("preisach_jax.diagnosis.find_form", searched)
    record, report = found.base.record, tmp_path / "report"
    rows = np.stack([record.time, record.input, record.output], axis=1)
    np.savetxt(tmp_path / "stage.csv", rows, delimiter=",", header="t_s,u_V,z_um", comments="")
    words = ["diagnose", str(tmp_path / "stage.csv"), "--explore", "--report", str(report)]
    assert main(words) == (130 if interrupted else 0)
    content = json.loads((report / "diagnosis.json").read_text(encoding="utf-8"))
    assert (content["verdict"], content["effects"]) == (found.verdict, [])
    if interrupted:
        assert content["form"] is None
    else:
        assert content["form"]["terms"][0]["formula"] == "u'³"
        assert f"A sparse form ({LABEL}) would lower" in capsys.readouterr().out

"""A sparse form where no name fits: found when hidden, silent where nothing is, never a cause."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
import scipy
from stand_ins import make_diagnosis

import preisach_jax as pj
from preisach_jax.cli import main
from preisach_jax.diagnosis.form import Dependence, SparseForm, Term
from preisach_jax.diagnosis.freed import FreedTerms
from preisach_jax.diagnosis.learning import learned
from preisach_jax.diagnosis.pursuit import sought
from preisach_jax.diagnosis.state import LABEL, State
from preisach_jax.diagnosis.terms import library_of
from preisach_jax.fit import FINAL_ROWS, double_precision, with_regressors
from preisach_jax.identify import Problem
from preisach_jax.plot.form import curves, dependence
from preisach_jax.report import write_report

LEVELS, NOISE, SAMPLES = 9, 0.01, 2500
UNITS = {"input": "V", "output": "um", "load": "N"}


def late(values, time, tau):
    """What follows values with a time constant, one sample after the other."""
    out, now = [values[0]], values[0]
    for dt, value in zip(np.diff(time), values[1:], strict=True):
        now += (value - now) * (1 - np.exp(-dt / tau))
        out.append(now)
    return np.array(out)


LAWS = {
    "position times rate": lambda t, u, v, load: (u - 5) * v / 5,
    "cube of the rate": lambda t, u, v, load: v**3,
    "column times rate": lambda t, u, v, load: load * v,
    "warming": lambda t, u, v, load: late(v**2, t, 0.4),
}
LEADS = {
    "position times rate": "u · u'",
    "cube of the rate": "u'³",
    "column times rate": "u' · load",
    "warming": "",  # of any time constants that add up to it
}


def played(seed):
    """Moves of many heights and speeds through plays: time, input, output, load."""
    rng = np.random.default_rng(seed)
    time = np.arange(SAMPLES) / 250
    turns = np.where(np.arange(100) % 2, 1, -1) * rng.uniform(1, 5, 100)
    corners = np.cumsum(10 ** rng.uniform(-1.3, -0.3, 100))
    u = 5 + np.interp(time, (corners - corners[0]) * time[-1] / np.ptp(corners), turns)
    output = np.zeros(SAMPLES)
    for radius in np.linspace(0.05, 3, 30):
        place = u[0]
        for k, value in enumerate(u.tolist()):
            place = max(value - radius, min(value + radius, place))
            output[k] += place * np.exp(-radius) / 12
    load = np.interp(time, np.linspace(0, time[-1], 21), rng.uniform(-1, 1, 21))
    return time, u, output, load


def hidden_record(kind, seed):
    """A record with a law hidden, and (time,) what the law gives."""
    time, u, output, load = played(seed)
    rate = np.gradient(u, time)
    law = np.zeros(SAMPLES)
    if kind is not None:
        law = LAWS[kind](time, u, rate / np.abs(rate).max(), load)
        law = 0.2 * law / law.std()
    noise = NOISE * np.random.default_rng(seed + 50).normal(size=SAMPLES)
    aux = {"load": load} if kind == "column times rate" else None
    return pj.Record.from_arrays(time, u, output + law + noise, aux=aux, units=UNITS if aux else {
        name: unit for name, unit in UNITS.items() if name != "load"}), law  # fmt: skip


def diagnosed(record):
    return pj.diagnose(record, ["drift"], levels=LEVELS)


@pytest.fixture(scope="module")
def cubed():
    """A diagnosis of a record that hides the cube of a rate, and its form."""
    found = diagnosed(hidden_record("cube of the rate", 902)[0])
    return found, pj.find_form(found)


@pytest.mark.parametrize("kind", LAWS)
def test_a_hidden_law_is_found_and_its_error_taken_away(kind):
    record, law = hidden_record(kind, 901)
    found = diagnosed(record)
    assert found.verdict == "unexplained"
    form = pj.find_form(found)
    assert form.offered, form.why_not
    without = pj.Record.from_arrays(record.time, record.input, record.output - law)
    assert form.rms_after < 1.3 * pj.fit(without, levels=LEVELS).rms_validation
    assert form.rms_before == pytest.approx(found.final.rms_validation, rel=0.05)
    assert LEADS[kind] in form.formula
    assert form.terms[0].physics == form.physics[0]
    assert form.evidence["gain"] > form.chance
    assert found.effects == ()  # a form is no effect


def test_coefficients_are_those_that_were_hidden(cubed):
    found, form = cubed
    law = hidden_record("cube of the rate", 902)[1]
    record = found.base.record
    (state,) = form.terms[0].states
    value = (np.gradient(record.input, record.time) - state.centre) / state.scale
    slope = np.polyfit(value**3, law, 1)[0]
    assert form.terms[0].formula == "u'³"
    assert form.terms[0].coefficient == pytest.approx(slope, rel=0.02)
    assert (state.symbol, state.unit) == ("u'", "V/s")


@pytest.mark.parametrize("seed", [903, 904, 905])
def test_no_form_is_offered_where_nothing_is_hidden(seed):
    found = diagnosed(hidden_record(None, seed)[0])
    assert not pj.find_form(found).offered
    with double_precision():  # whatever the verdict
        alone = sought(found.final, found.budget.discretisation, 0, 20)
    assert not alone.offered
    assert alone.why_not


def test_json_has_one_key_more_and_nothing_else_changes(cubed):
    found, form = cubed
    plain, asked = found.to_json(), replace(found, form=form).to_json()
    assert plain["form"] is None
    assert {key: asked[key] for key in asked if key != "form"} == {
        key: plain[key] for key in plain if key != "form"
    }
    content = json.loads(json.dumps(asked["form"], allow_nan=False))
    assert set(content) == {
        "label", "formula", "terms", "rms_before", "rms_after", "unit", "evidence", "chance",
        "draws", "where_to_look", "notes", "learned",
    }  # fmt: skip
    assert content["label"] == LABEL == "form, not cause"
    assert content["learned"] is None
    assert set(content["terms"][0]) == {"formula", "coefficient", "rms", "physics", "states"}
    assert set(content["evidence"]) == {"gain", "z", "blocks", "delta_bic"}
    none = replace(found, form=SparseForm.none(0.1, "um", "it is a test"))
    assert none.to_json()["form"] is None


def test_chance_is_the_same_for_the_same_seed_and_another_for_another(cubed):
    found, form = cubed
    again, other = pj.find_form(found), pj.find_form(found, seed=1)
    assert again.chance == form.chance != other.chance
    assert again.to_json() == form.to_json()
    assert other.terms == form.terms
    assert pj.find_form(found, draws=3).draws == 3


def test_the_pursuit_takes_what_least_squares_takes(cubed):
    found, _ = cubed
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


@pytest.mark.parametrize(
    ("law", "formula", "truth"),
    [
        (lambda t, u, v: late(v**2, t, 0.21), r"low-pass of u'² over ([\d.]+) s", 0.21),
        (lambda t, u, v: np.sign(v) * np.abs(v) ** 1.4, r"sgn\(u'\) \|u'\|\^([\d.]+)", 1.4),
        (lambda t, u, v: (u - 5) * np.tanh(v / 0.18), r"u · tanh\(u'/([\d.]+)\)", 0.18),
    ],
)
def test_numbers_inside_terms_are_found_between_those_of_the_library(law, formula, truth):
    time, u, output, _ = played(904)
    rate = np.gradient(u, time)
    hidden = law(time, u, rate / np.quantile(np.abs(rate), 0.98))
    noise = NOISE * np.random.default_rng(5).normal(size=SAMPLES)
    record = pj.Record.from_arrays(time, u, output + 0.2 * hidden / hidden.std() + noise)
    form = pj.find_form(diagnosed(record))
    found = re.fullmatch(formula, form.terms[0].formula)
    assert found, form.formula
    assert float(found[1]) == pytest.approx(truth, rel=0.1)


def test_memories_are_first_order_low_passes():
    time, u, output, _ = played(7)
    record = pj.Record.from_arrays(time, u, output)
    library = library_of(record, output, np.arange(SAMPLES))
    found = [t for t in library.terms if t.formula.startswith("low-pass of u over")]
    assert len(found) == 6
    tau = float(found[2].formula.split()[-2])
    keep = np.exp(-1 / (250 * tau))
    state = found[2].states[0]
    plain = (u - state.centre) / state.scale
    expected = scipy.signal.lfilter([1 - keep], [1, -keep], plain, zi=[keep * plain[0]])[0]
    # The time constant of the label is rounded.
    np.testing.assert_allclose(found[2].values, expected, atol=0.03)


def test_a_column_that_does_not_change_is_told_and_the_rest_goes_on():
    record, _ = hidden_record("cube of the rate", 902)
    still = pj.Record.from_arrays(
        record.time, record.input, record.output, aux={"load": np.full(SAMPLES, 3.0)}, units=UNITS
    )
    form = pj.find_form(diagnosed(still))
    assert form.offered
    assert form.notes == (
        "The column load is constant (3): no terms are made of it; record it while it changes.",
    )


def test_nothing_is_sought_where_nothing_is_left():
    form = pj.find_form(make_diagnosis("explained"))
    assert not form.offered
    assert "explained" in form.why_not
    assert "No sparse form is offered" in form.sentence


def test_mistakes_are_named(cubed):
    with pytest.raises(pj.InputError, match="draws is 0; give"):
        pj.find_form(cubed[0], draws=0)
    with pytest.raises(pj.InputError, match="no terms to draw"):
        dependence(SparseForm.none(0.1, "um", "it is a test"))


def made_form():
    rate = State("rate of the input", "u'", "V/s", 0.0, 12.0)
    term = Term("u'³", 0.3, 0.1, "viscous friction", (rate,))
    position = np.linspace(-12, 12, 24)
    drawn = Dependence("rate of the input", "V/s", position, position**3 / 1e4, position**3 / 1e4)
    evidence = {"gain": 0.8, "z": 5.0, "blocks": 24, "delta_bic": 400.0}
    return SparseForm((term,), 0.2, 0.09, "um", evidence, 0.04, 40, "", (), drawn)


def test_the_picture_has_what_the_form_holds():
    form = made_form()
    (axes,) = dependence(form).axes
    assert axes.get_xlabel() == "rate of the input (V/s)"
    assert axes.get_ylabel() == "mean remainder (nm)"
    assert LABEL in axes.get_title(loc="left")
    assert form.dependence is not None
    points, line = (np.asarray(each.get_ydata(), dtype=float) for each in axes.lines[1:3])
    np.testing.assert_allclose(points, 1e3 * form.dependence.remainder)
    np.testing.assert_allclose(line, 1e3 * form.dependence.form)


def test_report_and_texts_say_that_it_is_no_cause(tmp_path):
    found = make_diagnosis("unexplained", form=made_form())
    files = write_report(found, tmp_path / "report")
    assert tmp_path / "report" / "form.png" in files
    page = (tmp_path / "report" / "report.html").read_text(encoding="utf-8")
    for text in ("A form of what remains", "This is a form, not a cause", "viscous friction",
                 "u&#39;³", "from 200 nm to 90 nm RMS"):  # fmt: skip
        assert text in page, text
    assert LABEL in found.summary()
    assert LABEL in found._repr_html_()
    none = make_diagnosis("unexplained", form=SparseForm.none(0.2, "um", "it is a test"))
    assert tmp_path / "none" / "form.png" not in write_report(none, tmp_path / "none")
    page = (tmp_path / "none" / "report.html").read_text(encoding="utf-8")
    assert "No sparse form is offered: it is a test." in page


def test_the_command_looks_for_a_form_where_it_is_asked(tmp_path, capsys, cubed):
    record = cubed[0].base.record
    rows = np.stack([record.time, record.input, record.output], axis=1)
    np.savetxt(
        tmp_path / "stage.csv", rows, "%.9g", ",", header="t_s,u_V,z_um", comments="", newline="\n"
    )
    words = ["diagnose", str(tmp_path / "stage.csv"), "--effects", "drift", "--levels", str(LEVELS)]
    assert main([*words, "--explore", "--report", str(tmp_path / "report")]) == 0
    told = capsys.readouterr().out
    assert f"A sparse form ({LABEL}) would lower" in told
    assert "where to look: " in told
    content = json.loads((tmp_path / "report" / "diagnosis.json").read_text(encoding="utf-8"))
    assert content["form"]["terms"][0]["formula"] == "u'³"
    assert content["effects"] == []


def test_the_report_without_a_form_stays_where_the_search_for_one_is_interrupted(
    tmp_path, monkeypatch, cubed
):
    def interrupted(found, progress):
        progress("making terms", 0.0)
        raise KeyboardInterrupt

    monkeypatch.setattr("preisach_jax.diagnosis.diagnose", lambda *_, **__: cubed[0])
    monkeypatch.setattr("preisach_jax.diagnosis.find_form", interrupted)
    record = cubed[0].base.record
    rows = np.stack([record.time, record.input, record.output], axis=1)
    np.savetxt(tmp_path / "stage.csv", rows, "%.9g", ",", header="t_s,u_V,z_um", comments="")
    words = ["diagnose", str(tmp_path / "stage.csv"), "--explore"]
    assert main([*words, "--report", str(tmp_path / "report")]) == 130
    content = json.loads((tmp_path / "report" / "diagnosis.json").read_text(encoding="utf-8"))
    assert content["verdict"] == cubed[0].verdict
    assert content["form"] is None


# --- a learned term, where no sparse form is offered ---


def waved(seed):
    """A record whose hidden law no few terms make, a wave of the place times the rate."""
    time, u, output, _ = played(seed)
    rate = np.gradient(u, time)
    law = np.sin(6 * (u - 5) / 5) * rate / np.abs(rate).max()
    noise = NOISE * np.random.default_rng(seed + 50).normal(size=SAMPLES)
    units = {"input": "V", "output": "um"}
    law = 0.2 * law / law.std()
    return pj.Record.from_arrays(time, u, output + law + noise, units=units), law


@pytest.fixture(scope="module")
def unsparse():
    """A diagnosis of such a record, and its form."""
    found = diagnosed(waved(901)[0])
    return found, pj.find_form(found)


def test_a_law_of_no_few_terms_is_learned_and_its_error_taken_away(unsparse):
    found, form = unsparse
    record, law = waved(901)
    assert found.verdict == "unexplained"
    assert not form.offered
    term = form.learned
    assert term is not None
    assert term.offered, term.why_not
    without = pj.Record.from_arrays(record.time, record.input, record.output - law)
    assert term.rms_after < 2 * pj.fit(without, levels=LEVELS).rms_validation
    assert term.rms_before == pytest.approx(found.final.rms_validation, rel=0.05)
    assert term.evidence["gain"] > 0.9
    assert term.chance < 0.1
    assert term.draws == 8
    assert {curve.state.symbol for curve in term.curves[:2]} == {"u", "u'"}
    assert "changes with the position" in term.where_to_look[0]
    assert {state.symbol for state in term.states} == {"u", "h", "u'", "s", "a"}  # and not time
    assert found.effects == ()
    assert LABEL in term.sentence


def test_the_curves_have_the_course_of_the_law(unsparse):
    (curve,) = [each for each in unsparse[1].learned.curves if each.state.symbol == "u"]
    assert curve.beside.symbol == "u'"
    assert curve.beside_low < 0 < curve.beside_high
    record, law = waved(901)
    rate = np.gradient(record.input, record.time)
    scale = np.linalg.lstsq((np.sin(6 * (record.input - 5) / 5) * rate)[:, None], law, rcond=None)[
        0
    ][0]
    wave = scale * np.sin(6 * (curve.position - 5) / 5)
    expected = wave * (curve.beside_high - curve.beside_low)
    between = curve.high - curve.low
    assert np.corrcoef(between, expected)[0, 1] > 0.9
    assert np.polyfit(expected, between, 1)[0] == pytest.approx(1, abs=0.3)
    assert np.ptp(curve.mean) < 0.5 * np.ptp(curve.high)  # the mean over both directions is flat


def test_a_learned_term_is_told_in_json_report_and_texts(unsparse, tmp_path):
    found, form = unsparse
    asked = replace(found, form=form)
    plain, content = found.to_json(), asked.to_json()
    assert {k: v for k, v in content.items() if k != "form"} == {
        k: v for k, v in plain.items() if k != "form"
    }
    told = json.loads(json.dumps(content["form"], allow_nan=False))
    assert (told["label"], told["terms"], told["formula"]) == (LABEL, [], "")
    assert told["rms_after"] == form.learned.rms_after
    assert set(told["learned"]) == {"numbers", "states", "curves"}
    assert set(told["learned"]["curves"][0]) == {
        "state", "share", "position", "mean", "beside", "beside_low", "beside_high", "low", "high",
        "physics",
    }  # fmt: skip
    assert len(told["learned"]["curves"][0]["mean"]) == 25
    assert form.learned.sentence in asked.summary()
    assert "where to look: " in asked.summary()
    files = write_report(asked, tmp_path / "report")
    assert tmp_path / "report" / "form.png" in files
    page = (tmp_path / "report" / "report.html").read_text(encoding="utf-8")
    for text in ("This is a form, not a cause", "A learned term (form, not cause)"):
        assert text in page, text


def test_the_picture_of_a_learned_term_has_its_curves(unsparse):
    term = unsparse[1].learned
    panels = curves(term).axes
    assert len(panels) == len(term.curves)
    assert panels[0].get_ylabel() == "learned term (nm)"
    for axes, curve in zip(panels, term.curves, strict=True):
        drawn = [np.asarray(line.get_ydata(), dtype=float) for line in axes.lines[1:]]
        np.testing.assert_allclose(drawn, 1e3 * np.stack([curve.mean, curve.low, curve.high]))
    with pytest.raises(pj.InputError, match="has no curves to draw"):
        curves(replace(term, curves=(), why_not="it is a test"))


def test_a_learned_term_is_the_same_for_the_same_seed(unsparse):
    found, form = unsparse
    with double_precision():
        again = learned(found.final, found.budget.discretisation, 0, 1)
    assert again.rms_after == form.learned.rms_after
    assert (again.draws, form.learned.draws) == (1, 8)


@pytest.mark.parametrize("seed", [903, 904])
def test_no_learned_term_is_offered_where_nothing_is_hidden(seed):
    found = diagnosed(hidden_record(None, seed)[0])
    with double_precision():  # whatever the verdict
        term = learned(found.final, found.budget.discretisation, 0, 2)
    assert not term.offered
    assert term.sentence.startswith("No learned term is offered either: ")
    none = replace(SparseForm.none(0.1, "um", "it is a test"), learned=term)
    assert none.to_json() is None

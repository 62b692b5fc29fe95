"""What notebooks show of results: numbers of the object, with units, and nothing that runs."""

import re
from html import unescape

import numpy as np
import pytest
from stand_ins import make_diagnosis, make_record

import preisach_jax as pj
from preisach_jax.quantity import interval, quantity

EVIL = "<script>alert('µ')</script>"


def made(effects=(), **options):
    """A small record and its fit."""
    rng = np.random.default_rng(0)
    time = np.arange(3000) * 0.001
    drive = 5 - 5 * np.cos(time * (6 + 3 * time))
    output = drive**1.1 + 0.2 * np.tanh(drive - 5) + 1e-3 * rng.normal(size=time.size)
    settings = {"units": {"input": "V", "output": "um"}, "name": "stage.csv"} | options
    record = pj.Record.from_arrays(time, drive, output, **settings)
    return record, pj.fit(record, effects, levels=9)


@pytest.fixture(scope="module")
def fitted():
    return made(("input_lag", "creep"))


def shown(result) -> str:
    """The text of what a notebook shows, one space between cells."""
    page = result._repr_html_()
    tags = set(re.findall(r"</?([A-Za-z]+)", page))
    assert tags <= {"div", "p", "table", "thead", "tbody", "tr", "th", "td"}
    assert not re.search(r"\b(src|href|class|on\w+)=", page)  # inline styles alone, no network
    for tag in tags:
        assert len(re.findall(f"<{tag}[ >]", page)) == page.count(f"</{tag}>")
    return " ".join(unescape(re.sub("<[^>]*>", " ", page)).split())


def test_a_record_shows_columns_units_and_what_is_missing():
    time = np.append(np.arange(100), np.arange(150, 250)) * 0.01
    output = np.where(np.arange(200) < 20, np.nan, np.arange(200.0))
    record = pj.Record.from_arrays(
        time, np.sin(time), output, aux={"load_N": time}, units={"output": "um", "load_N": "N"}
    )
    text = shown(record)
    assert repr(record) == "<Record record: 200 rows, 2.49 s>"
    assert "output output µm 20 199" in text
    assert "200, 180 of them with a measured output" in text
    assert "a gap of 510 ms before sample 101" in text
    assert "20 samples without a measured output" in text


def test_a_fit_shows_its_own_numbers(fitted):
    _, fit = fitted
    text = shown(fit)
    assert quantity(fit.rms_validation, "um", 3) in text
    assert f"{fit.fit_percent:.2f}" in text
    assert "9 levels, 45 cells, input from" in text
    creep = fit.model.parameters["creep"]
    for name in (*list(creep)[:4], "tau_s"):
        e = creep.get(name, fit.model.parameters["input_lag"].get("tau_s"))
        assert f"{name} {interval(e.value, e.low, e.high, e.unit)}" in text
    assert f"and {len(creep) - 4} more in Model.parameters" in text
    assert repr(fit).startswith("<Fit of stage.csv: Preisach model + input_lag + creep, 9 levels, ")


def test_a_diagnosis_shows_verdict_ladder_findings_and_what_to_record():
    found = make_diagnosis()
    text = shown(found)
    assert "An effect was found, but part of the error remains (partly_explained)" in text
    assert found.sentence in text
    assert "Preisach model + creep + drift 31" in text
    assert "creep drift c_1 0.0213 (95 %: 0.0201 to 0.0225)" in text
    assert "tau_s 54.2 ms (95 %: 53.8 to ∞)" in text
    assert "drift nothing amplitude -400 nm (95 %: -500 to -300)" in text
    assert repr(found).startswith("<Diagnosis of stage.csv: partly_explained by creep, drift; ")


def test_names_and_units_of_a_file_are_escaped():
    record, fit = made(name=EVIL, units={"input": EVIL, "output": EVIL})
    found = make_diagnosis(record=make_record(name=EVIL), sentence=EVIL, notes=(EVIL,))
    for result in (record, fit, fit.model, found):
        assert EVIL in shown(result)
        assert "\n" not in repr(result)

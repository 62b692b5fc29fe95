"""Reports stand by themselves, say what was found, and are written whole or not at all."""

import errno
import json
import re
from html.parser import HTMLParser
from importlib.resources import files as package_files
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from stand_ins import make_diagnosis, make_record

from preisach_jax.diagnosis.comparison import compare
from preisach_jax.errors import InputError
from preisach_jax.files import check_file, check_folder, write_files
from preisach_jax.model import Prediction
from preisach_jax.report import write_report
from preisach_jax.report.content import comparison_sentence


class Page(HTMLParser):
    """Texts and scripts of a page; fails on tags that are not closed in order."""

    VOID = frozenset({"meta", "img", "br", "link", "hr", "input"})

    def __init__(self, source: str):
        super().__init__()
        self.open, self.texts, self.scripts = [], [], []
        self.feed(source)
        assert not self.open
        self.text = " ".join(" ".join(self.texts).split())

    def handle_starttag(self, tag, attrs):
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        (self.scripts if "script" in self.open else self.texts).append(data.strip())


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A report; its folder, its diagnosis, the source of its page."""
    folder, found = tmp_path_factory.mktemp("out") / "deep" / "report", make_diagnosis()
    files = write_report(found, folder, command="preisach diagnose 'a & b.csv'")
    assert sorted(files) == sorted(folder.iterdir())
    return folder, found, (folder / "report.html").read_text(encoding="utf-8")


@pytest.mark.usefixtures("figures_are_drawn")
def test_the_page_needs_nothing_from_elsewhere(written, tmp_path):
    folder, found, source = written
    names = {path.name for path in folder.iterdir()}
    pictures = {name for name in names if name.endswith(".svg")}
    assert len(pictures) == 8
    assert names - pictures == {"report.html", "diagnosis.json", "base.json", "model.json"}
    own = (package_files("preisach_jax.report") / "zoom.js").read_text(encoding="utf-8")
    assert Page(source).scripts == [own.strip()]
    addresses = re.findall(r'(?:src|href)="([^"]*)"', source)
    assert len(addresses) == source.count("<img") == 8
    assert all(address.startswith("data:image/svg+xml;base64,") for address in addresses)
    assert not re.search(r"<link|@import|url\(", source)
    write_report(found, tmp_path, as_png=True)
    assert 1e5 < (tmp_path / "report.html").stat().st_size < 6e6
    pictures = {name: (tmp_path / name).read_bytes() for name in pictures}
    assert len({*pictures.values()}) == 8
    assert len([*tmp_path.glob("*.png")]) == 8


def test_the_page_says_what_was_found(written):
    """That names from a file become no markup, test_security.py tries."""
    _, found, source = written
    for text in (
        found.sentence,
        "The held-out error falls from 600 nm to 210 nm RMS with it.",
        "This record cannot tell it from drift.",
        "0.0213 (95 %: 0.0201 to 0.0225)",
        "hold for a minute",
        "preisach design . --out next.csv",
        found.base.record.sha256,
        "preisach diagnose 'a & b.csv'",
    ):
        assert text in Page(source).text, text


def test_diagnosis_json_is_the_contract_and_strict(written):
    folder, _, _ = written
    content, model = (
        json.loads((folder / name).read_text(encoding="utf-8"), parse_constant=pytest.fail)
        for name in ("diagnosis.json", "model.json")
    )
    assert (content["verdict"], content["effects"]) == ("partly_explained", ["creep", "drift"])
    assert [rung["effects"] for rung in content["ladder"]] == [[], ["creep"], ["creep", "drift"]]
    assert {"rms_identification", "rms_validation", "max_abs_validation", "fit_percent"} <= set(
        content["ladder"][0]
    )
    for candidate in content["candidates"]:
        assert {"effect", "gain", "evidence", "accepted", "why_not"} <= set(candidate)
    tau = content["findings"][0]["parameters"]["tau_s"]
    assert tau == {"value": 0.0542, "low": 0.0538, "high": None, "unit": "s"}
    assert content["findings"][0]["family"] == ["creep", "drift"]
    assert content["budget"] == {
        "noise": 0.012, "input_quantisation": 0.003, "output_quantisation": 0.004,
        "discretisation": 0.016, "memory": 0.009, "unexplained": 0.024, "unit": "um",
    }  # fmt: skip
    assert model["noise"] is None


def test_places_are_checked_before_the_work(tmp_path, monkeypatch):
    def full(**_):
        raise OSError(errno.EROFS, "read-only file system")

    file = tmp_path / "file"
    file.write_text("")
    (tmp_path / "model.json").mkdir()
    check_folder(tmp_path / "new" / "report")
    check_file(tmp_path / "new.json")
    refused = [
        (check_folder, file, "this is a file"),
        (check_folder, file / "report", "is a file, not a folder"),
        (check_file, tmp_path, "this is a folder"),
        (check_file, tmp_path / "none" / "model.json", "there is no folder"),
        (write_files, {file: b"", tmp_path / "model.json": b""}, r"model\.json is a folder"),
    ]
    for check, place, said in refused:
        with pytest.raises(InputError, match=said):
            check(place)
    assert {path.name for path in tmp_path.iterdir()} == {"file", "model.json"}
    monkeypatch.setattr("tempfile.TemporaryFile", full)
    for check in (check_folder, check_file):
        with pytest.raises(InputError, match="cannot be written to"):
            check(tmp_path / "new")


def line(offset, sha256="that of another record") -> Any:
    """A model that predicts a fixed line, with a band of one unit."""

    def predict(record):
        output = 0.6 * record.input + offset
        return Prediction(record.time, output, output - 1, output + 1)

    origin = SimpleNamespace(sha256=sha256)
    return SimpleNamespace(rms_validation=0.5, effects=(), origin=origin, predict=predict)


def test_a_comparison_measures_what_the_model_leaves():
    rng = np.random.default_rng(0)
    time = np.arange(4000) * 0.01
    drive = 50 + 40 * np.sin(time)
    noise = rng.normal(0, 0.5, time.size)
    output = 0.6 * drive + noise
    output[100:200] = np.nan
    record = make_record().from_arrays(time, drive, output, units={"output": "um"})
    noise = noise[record.measured]
    fair = compare(line(0.0), record)
    assert fair.rms == pytest.approx(np.sqrt(np.mean(noise**2)))
    assert fair.max_abs == pytest.approx(np.max(np.abs(noise)))
    stroke = 0.6 * drive[record.measured] + noise
    assert fair.fit_percent == pytest.approx(
        100 * (1 - np.linalg.norm(noise) / np.linalg.norm(stroke - stroke.mean()))
    )
    assert fair.tests.inside_band == pytest.approx(np.mean(np.abs(noise) <= 1))
    assert fair.tests.autocorrelation_outside < 0.05
    assert fair.tests.periodogram_deviation < fair.tests.periodogram_band
    assert "as well as the record" in comparison_sentence(fair)
    biased = compare(line(3.0), record)
    assert biased.tests.bias == pytest.approx(fair.tests.bias - 3.0)
    assert biased.tests.inside_band < 0.05
    assert "6.1 times" in comparison_sentence(biased)
    known = compare(line(0.0, record.sha256), record)
    assert "no independent test" in comparison_sentence(known)

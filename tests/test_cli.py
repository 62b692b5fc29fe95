"""The command line: what it writes and shows, and one clear line for every mistake."""

import csv
import hashlib
import importlib
import json
import os
import re
import subprocess
import sys
from dataclasses import replace
from unittest.mock import Mock

import jax
import numpy as np
import pytest
from stand_ins import make_diagnosis

from preisach_jax.cli import demonstration, main
from preisach_jax.diagnosis.comparison import compare
from preisach_jax.errors import InputError
from preisach_jax.model import Model
from preisach_jax.record.core import Record

ROWS = 700

# As an attribute of the package, `effects` is the function of that name.
EFFECTS = importlib.import_module("preisach_jax.effects")


def write_csv(path, columns):
    lines = [",".join(columns)]
    lines += [
        ",".join(f"{value:.9g}" for value in row) for row in zip(*columns.values(), strict=True)
    ]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def stage_columns():
    """A small stage: loops of falling swing, time in ms, a load that bends it."""
    time = np.arange(ROWS) * 10.0
    drive = 50 + 48 * np.exp(-time / 9000) * np.sin(2 * np.pi * time / 700)
    load = 5 + np.sin(time / 900)
    rng = np.random.default_rng(0)
    lagged = np.convolve(np.pad(drive, (8, 0), "edge"), np.ones(9) / 9, "valid")
    output = 0.5 * lagged + 0.3 * drive + 0.4 * load + rng.normal(0, 0.02, ROWS)
    return {"t_ms": time, "u_V": drive, "z_um": output, "load_N": load}


@pytest.fixture(scope="module")
def work(tmp_path_factory):
    """A folder with a record and a model fitted to it by the command line."""
    folder = tmp_path_factory.mktemp("work")
    text = write_csv(folder / "stage.csv", stage_columns()).read_text()
    (folder / "flawed.csv").write_text(re.sub(r"\n30,.*", "\n30,1.5,oops,5", text))
    time, drive, output, load = stage_columns().items()
    write_csv(folder / "beyond.csv", dict([time, ("u_V", drive[1] + 30.0), output, load]))
    write_csv(folder / "small.csv", dict([time, ("u_mV", drive[1]), output, load]))
    write_csv(folder / "bare.csv", dict([time, drive, output]))
    words = ["fit", str(folder / "stage.csv"), "--effects", "aux:load_N", "--levels", "5"]
    assert main([*words, "--out", str(folder / "model.json")]) == 0
    return folder


def complaint(capsys, *words):
    """Exit code 2, nothing on stdout, and one line on stderr: the message."""
    assert main([str(word) for word in words]) == 2
    shown = capsys.readouterr()
    assert shown.out == ""
    assert shown.err.startswith("preisach: ")
    assert shown.err.count("\n") == 1
    assert shown.err.endswith("\n")
    assert "Traceback" not in shown.err
    return shown.err


# What it does


def test_diagnose_writes_a_report_and_says_what_it_found(work, tmp_path, capsys):
    report = tmp_path / "deep" / "report"
    words = ["diagnose", str(work / "stage.csv"), "--effects", "drift", "--aux", "load_N"]
    assert main([*words, "--levels", "5", "--report", str(report)]) == 0
    shown = capsys.readouterr().out
    content = json.loads((report / "diagnosis.json").read_text(encoding="utf-8"))
    assert content["verdict"] in shown
    assert content["sentence"] in shown
    assert "guessed from names and units: time t_ms, input u_V, output z_um" in shown
    assert "held-out RMS" in shown
    assert "which only the held-out rows cover" in shown
    assert str(report / "report.html") in shown
    told = "preisach diagnose stage.csv --effects drift --aux load_N --levels 5 --report report"
    assert told in (report / "report.html").read_text(encoding="utf-8")
    assert {each["effect"] for each in content["candidates"]} == {"drift", "aux:load_N"}
    assert Model.load(report / "base.json").effects == ()
    assert Model.load(report / "model.json").plane.levels == 5


def test_predict_has_a_row_for_each_row_in_the_unit_of_the_record(work, tmp_path):
    columns = stage_columns()
    del columns["z_um"]
    data, out = write_csv(tmp_path / "inputs.csv", columns), tmp_path / "pred.csv"
    assert main(["predict", str(work / "model.json"), str(data), "--out", str(out)]) == 0
    lines = out.read_text(encoding="utf-8").splitlines()
    assert lines[0] == "t,z_pred,z_low,z_high"
    rows = np.array([[float(cell) for cell in row] for row in csv.reader(lines[1:])])
    np.testing.assert_array_equal(rows[:, 0], columns["t_ms"])
    measured = stage_columns()["z_um"]
    assert np.sqrt(np.mean((rows[:, 1] - measured) ** 2)) < 0.05 * np.ptp(measured)
    assert np.all(rows[:, 2] < rows[:, 1])
    assert np.all(rows[:, 1] < rows[:, 3])


def test_units_that_were_told_are_remembered(tmp_path):
    old = stage_columns()
    columns = {"clock": old["t_ms"], "u": old["u_V"], "z": old["z_um"]}
    data, model = write_csv(tmp_path / "plain.csv", columns), tmp_path / "model.json"
    told = ["--time", "clock", "--input", "u", "--output", "z", "--unit", "clock=ms"]
    assert main(["fit", str(data), *told, "--levels", "5", "--out", str(model)]) == 0
    out = tmp_path / "pred.csv"
    assert main(["predict", str(model), str(data), "--out", str(out)]) == 0
    assert float(out.read_text(encoding="utf-8").splitlines()[2].split(",")[0]) == 10.0
    # Columns of other names, and in seconds.
    other = write_csv(tmp_path / "other.csv", {"seconds": old["t_ms"] / 1e3, "v": old["u_V"]})
    words = ["predict", str(model), str(other), "--out", str(out)]
    assert main([*words, "--time", "seconds", "--input", "v"]) == 0
    assert float(out.read_text(encoding="utf-8").splitlines()[2].split(",")[0]) == 0.01


@pytest.mark.usefixtures("x64")
def test_several_models_and_several_records_are_those_of_single_comparisons(work, tmp_path, capsys):
    own, plain, data = work / "model.json", tmp_path / "plain.json", work / "stage.csv"
    columns = stage_columns()
    other = write_csv(tmp_path / "other.csv", {**columns, "z_um": 1.02 * columns["z_um"]})
    assert main(["fit", str(data), "--levels", "5", "--out", str(plain)]) == 0
    shown = capsys.readouterr().out
    assert "700 rows" in shown
    assert "held-out error" in shown
    for words in ((plain, own, data), (plain, data, other)):
        report = ["--report", str(tmp_path / "report"), "--json"]
        assert main(["compare", *map(str, words), *report]) == 0
        told = [each["rms"] for each in json.loads(capsys.readouterr().out)["comparisons"]]
        models = [Model.load(path) for path in words if path.suffix == ".json"]
        records = [Record.load(path, aux=("load_N",)) for path in words if path.suffix == ".csv"]
        assert told == pytest.approx([compare(m, r).rms for m in models for r in records])
        assert (tmp_path / "report" / "report.html").exists()


def test_simulate_writes_the_record_and_what_is_hidden(tmp_path, capsys):
    data, truth = tmp_path / "data.csv", tmp_path / "truth.json"
    words = ["simulate", "--effects", "aux", "--seconds", "3", "--seed", "3"]
    assert main([*words, "--out", str(data), "--truth", str(truth)]) == 0
    lines = data.read_text(encoding="utf-8").splitlines()
    assert lines[0] == "t_s,u_V,z_um,load_N"
    assert len(lines) == 6001
    assert json.loads(truth.read_text(encoding="utf-8"))["effects"] == ["aux:load_N"]
    assert main([*words, "--out", str(tmp_path / "again.csv")]) == 0
    assert (tmp_path / "again.csv").read_bytes() == data.read_bytes()
    assert "hidden" in capsys.readouterr().out


def test_effects_lists_the_library_and_shows_cards(capsys):
    assert main(["effects"]) == 0
    shown = capsys.readouterr().out
    assert all(name in shown for name in EFFECTS.library())
    assert main(["effects", "input_lag"]) == 0
    shown = capsys.readouterr().out
    for text in ("before the hysteresis", "tau_s", "Confused with: delay", "Source: "):
        assert text in shown
    assert main(["effects", "aux:temperature"]) == 0
    assert "{z}/{aux}" in capsys.readouterr().out


def test_commands_compute_in_double_precision(monkeypatch):
    seen = []
    monkeypatch.setattr(EFFECTS, "library", lambda: seen.append(jax.numpy.ones(1).dtype) or {})
    assert main(["effects"]) == 0
    assert seen == [np.float64]


def test_the_package_runs_as_a_module_on_a_terminal_without_greek_letters():
    done = subprocess.run(
        [sys.executable, "-m", "preisach_jax", "effects", "creep"],
        env=os.environ | {"PYTHONIOENCODING": "ascii"}, capture_output=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0
    assert b"Kelvin-Voigt" in done.stdout
    assert done.stderr == b""


# The demonstration


def test_the_demo_opens_the_truth_last_and_judges(monkeypatch, tmp_path, capsys):
    truth, seen = tmp_path / "simulated-stage" / "truth.json", []

    def diagnose(record, effects, *_, **__):
        assert effects == demonstration.TRIED
        seen.append((record.name, truth.exists(), sorted(record.aux)))
        return make_diagnosis("explained" if record.name == "beam.csv" else "adequate")

    monkeypatch.setattr("preisach_jax.diagnosis.diagnose", diagnose)
    monkeypatch.setattr("preisach_jax.report.write_report", lambda *_, **__: [])
    monkeypatch.setattr(demonstration, "_fit_rock", lambda folder: {})
    assert main(["demo", "--out", str(tmp_path), "--seed", "5"]) == 0
    assert seen == [("beam.csv", False, []), ("data.csv", True, [])]
    shown = capsys.readouterr().out
    assert "\u28ff" in shown  # the loop
    assert "The same loop with the force 54 ms later" in shown
    seal = hashlib.sha256(truth.read_bytes()).hexdigest()
    assert f"SHA-256 {seal[:16]}" in shown
    (hidden,) = json.loads(truth.read_text())["effects"]
    assert hidden in demonstration.TRIED
    assert f"hidden effect was {hidden}. The verdict was wrong: it names nothing." in shown
    first = make_diagnosis().findings[0]
    for family, said in (
        ((hidden,), "was right."),
        (("other", hidden), f"names other, which it cannot tell from {hidden}"),
        (("other",), "wrong: it names other first"),
    ):
        found = make_diagnosis(findings=(replace(first, effect=family[0], family=family),))
        assert said in demonstration._judge(found, truth, seal)
    truth.write_text("{}")
    assert "was changed since it was written" in demonstration._judge(found, truth, seal)


def test_the_rock_is_fitted_better_where_its_output_moves(tmp_path, capsys):
    shares = demonstration._fit_rock(tmp_path)
    assert shares["where_the_output_moves"] < 0.5 * shares["equally_spaced"]
    assert "<svg" in (tmp_path / "forc.svg").read_text()
    assert "15 thresholds" in capsys.readouterr().out


# Mistakes, failures and interruptions


STAGE, PREDICT = "stage.csv", ["predict", "model.json", "--out", "p.csv"]


@pytest.mark.parametrize(
    ("words", "fragments"),
    [
        (["diagnose"], ["Missing argument 'DATA...'", "preisach diagnose --help"]),
        (["diagnose", "stag.csv"], ["stag.csv", "there is no such file", "stage.csv"]),
        (["diagnose", "flawed.csv"], ["flawed.csv", "column z_um", "row 5", "oops"]),
        (["diagnose", STAGE, "-q", "--tolerance", "0.1"], ["'0.1' has no unit"]),
        (["diagnose", STAGE, "--input", "u_v"], ["'u_v'", "u_V", "--input"]),
        (["diagnose", STAGE, "--effects", "crep"], ["'crep'", "did you mean 'creep'"]),
        (["diagnose", STAGE, "--levels", "1"], ["levels is 1"]),
        (["diagnose", STAGE, "--unit", "V"], ["--unit is 'V'", "u=V"]),
        (["diagnose", STAGE, "--rate", "5", "--time", "t_ms"], ["not both"]),
        (["diagnose", STAGE, "--report", STAGE], ["stage.csv", "this is a file"]),
        (["diagnoze", STAGE], ["diagnoze", "preisach --help"]),
        (["fit", STAGE, "--out", "none/model.json"], ["there is no folder none"]),
        (["fit", STAGE, "--out", "m.json", "--effects", "drift,drift"], ["drift", "twice"]),
        (["predict", STAGE, STAGE, "--out", "p.csv"], ["stage.csv", "no model file"]),
        ([*PREDICT, "beyond.csv"], ["beyond.csv", "outside the range"]),
        ([*PREDICT, "small.csv", "--input", "u_mV"], ["small.csv", "mV", "u_mV"]),
        ([*PREDICT, "bare.csv"], ["bare.csv", "load_N"]),
        (["compare", "model.json", "model.json"], ["there is no record among them"]),
        (["compare", "model.json", STAGE, STAGE], ["is given 2 times"]),
        (["simulate", "--out", "d.csv", "--truth", "./d.csv"], ["both --out and --truth"]),
    ],
)  # fmt: skip
def test_mistakes_are_one_line_and_leave_nothing_behind(
    words, fragments, work, capsys, monkeypatch
):
    monkeypatch.chdir(work)
    before = sorted(path.name for path in work.iterdir())
    message = complaint(capsys, *words)
    for fragment in fragments:
        assert fragment in message
    assert sorted(path.name for path in work.iterdir()) == before


@pytest.mark.parametrize(
    ("error", "code", "fragment"),
    [
        (InputError("one\nline"), 2, "one line"),
        (RuntimeError("two\nlines"), 1, "RuntimeError: two lines"),
        (KeyboardInterrupt(), 130, "interrupted"),
        (MemoryError(), 1, "not enough memory"),
        (PermissionError(13, "Permission denied", "there.csv"), 2, "there.csv: Permission denied"),
        (OSError("broken disk"), 1, "broken disk"),
    ],
)
def test_how_things_end(error, code, fragment, monkeypatch, capsys):
    monkeypatch.setattr(EFFECTS, "library", Mock(side_effect=error))
    assert main(["effects"]) == code
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert fragment in lines[0]
    if isinstance(error, RuntimeError):
        assert "PREISACH_TRACEBACK=1" in lines[0]
        monkeypatch.setenv("PREISACH_TRACEBACK", "1")
        assert main(["effects"]) == 1
        assert "Traceback (most recent call last)" in capsys.readouterr().err

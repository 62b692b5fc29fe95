"""The command line: what it writes and shows, and one clear line for every mistake."""

import csv
import hashlib
import importlib
import json
import os
import subprocess
import sys

import jax
import numpy as np
import pytest
from stand_ins import make_diagnosis

from preisach_jax.cli import demonstration, main
from preisach_jax.cli.screen import progress
from preisach_jax.errors import InputError
from preisach_jax.model import Model

ROWS = 700

# As an attribute of the package, `effects` is the function of that name.
EFFECTS = importlib.import_module("preisach_jax.effects")


def write_csv(path, columns, rows=None):
    """Write columns; `rows` replaces single rows by the texts given."""
    lines = [",".join(columns)]
    lines += [
        ",".join(f"{value:.9g}" for value in row) for row in zip(*columns.values(), strict=True)
    ]
    for number, text in (rows or {}).items():
        lines[number - 1] = text
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
    write_csv(folder / "stage.csv", stage_columns())
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
    words = ["diagnose", str(work / "stage.csv"), "--effects", "aux:load_N", "--levels", "5"]
    assert main([*words, "--report", str(report)]) == 0
    shown = capsys.readouterr().out
    content = json.loads((report / "diagnosis.json").read_text(encoding="utf-8"))
    assert content["verdict"] in shown
    assert content["sentence"] in shown
    assert "guessed from names and units: time t_ms, input u_V, output z_um" in shown
    assert "held-out RMS" in shown
    assert "which only the held-out rows cover" in shown
    assert str(report / "report.html") in shown
    told = "preisach diagnose stage.csv --effects aux:load_N --levels 5 --report report"
    assert told in (report / "report.html").read_text(encoding="utf-8")
    assert Model.load(report / "base.json").effects == ()
    assert Model.load(report / "model.json").plane.levels == 5


def test_a_column_is_tried_beside_the_effects_asked_for(work, tmp_path):
    words = ["diagnose", str(work / "stage.csv"), "--effects", "drift", "--aux", "load_N"]
    assert main([*words, "--levels", "5", "--report", str(tmp_path / "r")]) == 0
    content = json.loads((tmp_path / "r" / "diagnosis.json").read_text(encoding="utf-8"))
    assert {each["effect"] for each in content["candidates"]} == {"drift", "aux:load_N"}


def test_a_record_that_shows_little_says_so(tmp_path, capsys):
    time = np.arange(80) / 100
    data = write_csv(tmp_path / "short.csv", {"t_s": time, "u_V": time, "z_um": time**1.1})
    # The default plane, asked for: it is not refined.
    words = ["diagnose", str(data), "--effects", "drift", "--levels", "25"]
    assert main([*words, "--report", str(tmp_path / "r")]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "80 measured rows for 325 cells" in shown
    assert "The input reverses only 0 times" in shown
    content = json.loads((tmp_path / "r" / "diagnosis.json").read_text(encoding="utf-8"))
    assert len(content["notes"]) == 4
    assert "drift cannot be told from the density of hysterons" in content["notes"][2]
    assert content["notes"][0] in (tmp_path / "r" / "report.html").read_text(encoding="utf-8")


def test_fit_shows_its_guess_and_its_errors(tmp_path, work, capsys):
    out = tmp_path / "plain.json"
    assert main(["fit", str(work / "stage.csv"), "--levels", "4", "--out", str(out)]) == 0
    shown = capsys.readouterr().out
    assert "700 rows" in shown
    assert "held-out error" in shown
    assert Model.load(out).plane.levels == 4
    assert [path.name for path in tmp_path.iterdir()] == ["plain.json"]


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


def test_predict_takes_columns_of_other_names(work, tmp_path):
    old = stage_columns()
    columns = {"seconds": old["t_ms"] / 1e3, "drive": old["u_V"], "load_N": old["load_N"]}
    data, out = write_csv(tmp_path / "other.csv", columns), tmp_path / "pred.csv"
    words = ["predict", str(work / "model.json"), str(data), "--out", str(out)]
    assert main([*words, "--time", "seconds", "--input", "drive"]) == 0
    first = out.read_text(encoding="utf-8").splitlines()[2].split(",")[0]
    assert float(first) == 0.01


def test_units_that_were_told_are_remembered(tmp_path, capsys):
    old = stage_columns()
    columns = {"clock": old["t_ms"], "u": old["u_V"], "z": old["z_um"]}
    data, model = write_csv(tmp_path / "plain.csv", columns), tmp_path / "model.json"
    told = ["--time", "clock", "--input", "u", "--output", "z", "--unit", "clock=ms"]
    assert main(["fit", str(data), *told, "--levels", "4", "--out", str(model)]) == 0
    out = tmp_path / "pred.csv"
    assert main(["predict", str(model), str(data), "--out", str(out)]) == 0
    assert float(out.read_text(encoding="utf-8").splitlines()[2].split(",")[0]) == 10.0
    capsys.readouterr()
    assert main(["compare", str(model), str(data), "--report", str(tmp_path / "report")]) == 0
    assert "700 rows, 6.99 s" in capsys.readouterr().out


def test_compare_reports_errors_and_tests(work, tmp_path, capsys):
    report = tmp_path / "report"
    words = ["compare", str(work / "model.json"), str(work / "stage.csv")]
    assert main([*words, "--report", str(report)]) == 0
    shown = capsys.readouterr().out
    assert "RMS error" in shown
    assert "inside the model's 95 % band" in shown
    assert {"report.html", "comparison.json", "residuals.png"} <= {p.name for p in report.iterdir()}


def rms_in(folder, *words):
    """What each comparison leaves, by its name."""
    assert main(["compare", *words, "--report", str(folder), "-q"]) == 0
    content = json.loads((folder / "comparison.json").read_text(encoding="utf-8"))
    assert (folder / "overlay.png").read_bytes().startswith(b"\x89PNG")
    return {each["name"]: each["rms"] for each in content["comparisons"]}


def test_several_models_and_several_records_are_those_of_single_comparisons(work, tmp_path, capsys):
    plain, other = tmp_path / "plain.json", tmp_path / "other.csv"
    columns = stage_columns()
    write_csv(other, {**columns, "z_um": 1.02 * columns["z_um"]})
    data = work / "stage.csv"
    assert main(["fit", str(data), "--levels", "4", "--out", str(plain)]) == 0
    single = {}
    for model, record in ((plain, data), (work / "model.json", data), (plain, other)):
        capsys.readouterr()
        words = ["compare", str(model), str(record), "--report", str(tmp_path / "one"), "--json"]
        assert main(words) == 0
        single[model.name, record.name] = json.loads(capsys.readouterr().out)["rms"]
    models = rms_in(tmp_path / "models", str(plain), str(work / "model.json"), str(data))
    assert models == {
        "plain.json": single["plain.json", "stage.csv"],
        "model.json": single["model.json", "stage.csv"],
    }
    records = rms_in(tmp_path / "records", str(plain), str(data), str(other))
    assert records == {
        "stage.csv": single["plain.json", "stage.csv"],
        "other.csv": single["plain.json", "other.csv"],
    }
    page = (tmp_path / "records" / "report.html").read_text(encoding="utf-8")
    assert "One model against records" in page
    assert "stage.csv has the smallest error" in capsys.readouterr().out


def test_models_and_records_in_numbers_that_do_not_go_together(work, tmp_path, capsys):
    model, data = str(work / "model.json"), str(work / "stage.csv")
    for words, expected in (
        ([model, model], "there is no record among them"),
        ([model, model, data, data], "2 models and 2 records"),
        ([model, data, data], "is given 2 times"),
    ):
        assert main(["compare", *words, "--report", str(tmp_path / "report")]) == 2
        assert expected in capsys.readouterr().err
    assert not (tmp_path / "report").exists()


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
    for name in EFFECTS.library():
        assert name in shown
    assert main(["effects", "input_lag"]) == 0
    shown = capsys.readouterr().out
    for text in ("before the hysteresis", "tau_s", "Confused with: delay", "Source: "):
        assert text in shown
    assert main(["effects", "aux:temperature"]) == 0
    assert "{z}/{aux}" in capsys.readouterr().out


def test_help_and_version(capsys):
    assert main([]) == 0
    assert "diagnose" in capsys.readouterr().out
    assert main(["--version"]) == 0
    assert capsys.readouterr().out.startswith("preisach 0.")
    assert main(["predict", "--help"]) == 0
    assert "--initial-memory" in capsys.readouterr().out


def test_commands_compute_in_double_precision(monkeypatch):
    seen = []
    monkeypatch.setattr(EFFECTS, "library", lambda: seen.append(jax.numpy.ones(1).dtype) or {})
    assert main(["effects"]) == 0
    assert seen == [np.float64]


@pytest.mark.parametrize("words", [["effects"], ["effects", "no_such"], ["--version"]])
@pytest.mark.usefixtures("precision")
def test_a_command_leaves_the_precision_of_its_caller(words, capsys):
    before = jax.numpy.ones(1).dtype
    main(words)
    capsys.readouterr()
    assert jax.numpy.ones(1).dtype == before


def test_a_terminal_without_greek_letters_is_no_failure():
    done = subprocess.run(
        [sys.executable, "-m", "preisach_jax.cli", "effects", "creep"],
        env=os.environ | {"PYTHONIOENCODING": "ascii"},
        capture_output=True,
        check=False,
    )
    assert done.returncode == 0
    assert done.stderr == b""


# The demonstration


@pytest.fixture
def demo(monkeypatch, tmp_path):
    """Run the demo with a diagnosis that names given effects and looks at what is on the disk."""

    def run(*named, tamper=False):
        seen = []

        def diagnose(record, progress):
            truth = tmp_path / "out" / "simulated-stage" / "truth.json"
            seen.append((record.name, truth.exists(), sorted(record.aux)))
            if tamper and truth.exists():
                truth.write_text("{}")
            progress("looking", 0.5)
            found = make_diagnosis("explained" if named else "adequate")
            if not named:
                return found
            change = {"effect": named[0], "family": named}
            return make_diagnosis("explained", findings=(replace_fields(found, change),))

        monkeypatch.setattr("preisach_jax.diagnosis.diagnose", diagnose)
        monkeypatch.setattr("preisach_jax.report.write_report", lambda *_, **__: [])
        monkeypatch.setattr(demonstration, "SECONDS", 6.0)
        assert main(["demo", "--out", str(tmp_path / "out"), "--seed", "5"]) == 0
        return seen, json.loads((tmp_path / "out/simulated-stage/truth.json").read_text())

    return run


def replace_fields(found, change):
    return type(found.findings[0])(**(vars(found.findings[0]) | change))


def test_the_demo_shows_two_records_and_opens_the_truth_last(demo, tmp_path, capsys):
    seen, truth = demo("nothing of the sort")
    assert seen == [("conventional_example.forc", False, []), ("data.csv", True, [])]
    shown = capsys.readouterr().out
    (hidden,) = truth["effects"]
    assert hidden in demonstration.HIDDEN
    assert (
        f"hidden effect was {hidden}. The verdict was wrong: it names nothing of the sort" in shown
    )
    content = (tmp_path / "out" / "simulated-stage" / "truth.json").read_bytes()
    assert f"SHA-256 {hashlib.sha256(content).hexdigest()[:16]}" in shown
    ends = [str(tmp_path / "out" / name) for name in ("reversal-curves", "simulated-stage")]
    assert [line.strip() for line in shown.splitlines()[-2:]] == [
        os.path.join(folder, "report.html") for folder in ends
    ]


def test_the_demo_judges_the_verdict(demo, capsys):
    _, truth = demo()
    (hidden,) = truth["effects"]
    assert "wrong: it names nothing." in capsys.readouterr().out
    demo(hidden)
    assert f"hidden effect was {hidden}. The verdict was right." in capsys.readouterr().out
    demo("other", hidden)
    assert f"names other, which it cannot tell from {hidden}" in capsys.readouterr().out


def test_a_truth_that_was_changed_is_told(demo, capsys):
    demo("creep", tamper=True)
    assert "was changed since it was written" in capsys.readouterr().out


# Mistakes


FLAWED = {
    "text in a number": ({5: "30,1.5,oops,5"}, ["z_um", "row 5", "oops"]),
    "time runs backward": ({9: "-3,1,1,5"}, ["t_ms", "row 9"]),
    "time repeats": ({9: "60,1,1,5"}, ["t_ms", "row 9"]),
    "NaN in the input": ({7: "50,nan,1,5"}, ["u_V", "row 7"]),
}


@pytest.mark.parametrize("flaw", FLAWED)
def test_a_flawed_cell_is_named_with_its_place(flaw, tmp_path, capsys):
    rows, fragments = FLAWED[flaw]
    data = write_csv(tmp_path / "flawed.csv", stage_columns(), rows)
    message = complaint(capsys, "diagnose", data, "--report", tmp_path / "report")
    for fragment in ("flawed.csv", *fragments):
        assert fragment in message
    assert [path.name for path in tmp_path.iterdir()] == ["flawed.csv"]


@pytest.mark.parametrize(
    ("column", "value", "fragment"),
    [("u_V", 3.0, "constant"), ("z_um", np.nan, "empty"), ("z_um", 1.0, "constant")],
)
def test_a_column_that_says_nothing(column, value, fragment, tmp_path, capsys):
    columns = stage_columns()
    columns[column] = np.full(ROWS, value)
    data = write_csv(tmp_path / "dull.csv", columns)
    told = ["--time", "t_ms", "--input", "u_V", "--output", "z_um"]
    message = complaint(capsys, "diagnose", data, *told, "--report", tmp_path / "report")
    assert fragment in message
    assert column in message
    assert not (tmp_path / "report").exists()


def test_too_few_samples(tmp_path, capsys):
    columns = {name: values[:20] for name, values in stage_columns().items()}
    data = write_csv(tmp_path / "short.csv", columns)
    assert "too few" in complaint(capsys, "fit", data, "--out", tmp_path / "model.json")
    assert not (tmp_path / "model.json").exists()


STAGE = "stage.csv"


@pytest.mark.parametrize(
    ("words", "fragments"),
    [
        (["diagnose"], ["Missing argument 'DATA...'", "preisach diagnose --help"]),
        (["diagnose", "stag.csv"], ["stag.csv", "there is no such file", "stage.csv"]),
        (["diagnose", "."], ["this is a folder"]),
        (["diagnose", STAGE, "--input", "u_v"], ["'u_v'", "u_V", "--input"]),
        (["diagnose", STAGE, "--effects", "crep"], ["'crep'", "did you mean 'creep'"]),
        (["diagnose", STAGE, "--effects", "creep,,drift"], ["creep,,drift", "by commas"]),
        (["diagnose", STAGE, "--effects", "aux:weight"], ["'weight'", "load_N"]),
        (["diagnose", STAGE, "--levels", "1"], ["levels is 1"]),
        (["diagnose", STAGE, "--levels", "many"], ["--levels"]),
        (["diagnose", STAGE, "--unit", "V"], ["--unit is 'V'", "u=V"]),
        (["diagnose", STAGE, "--rate", "-5", "--input", "u_V"], ["-5"]),
        (["diagnose", STAGE, "--rate", "5", "--time", "t_ms"], ["not both"]),
        (["diagnose", STAGE, "--initial-memory", "warm"], ["'warm'", "demagnetised"]),
        (["diagnose", STAGE, "--report", STAGE], ["stage.csv", "this is a file"]),
        (["diagnose", STAGE, "--report", STAGE + "/x"], ["stage.csv is a file"]),
        (["diagnose", STAGE, "--color", "red"], ["--color"]),
        (["diagnoze", STAGE], ["diagnoze", "preisach --help"]),
        (["fit", STAGE], ["--out"]),
        (["fit", STAGE, "--out", "none/model.json"], ["there is no folder none"]),
        (["fit", STAGE, "--out", "."], ["this is a folder"]),
        (["fit", STAGE, "--out", "m.json", "--effects", "drift,drift"], ["drift", "twice"]),
        (["predict", "none.json", STAGE, "--out", "p.csv"], ["none.json", "cannot be read"]),
        (["predict", STAGE, STAGE, "--out", "p.csv"], ["stage.csv", "no model file"]),
        (["compare", "model.json", "none.csv"], ["none.csv", "there is no such file"]),
        (["simulate", "--effects", "crep", "--out", "d.csv"], ["'crep'", "creep"]),
        (["simulate", "--seed", "-1", "--out", "d.csv"], ["seed is -1"]),
        (["simulate", "--seconds", "0", "--out", "d.csv"], ["seconds"]),
        (["simulate", "--out", "d.csv", "--truth", "./d.csv"], ["both --out and --truth"]),
        (["effects", "crep"], ["did you mean 'creep'"]),
        (["demo", "--out", STAGE], ["this is a file"]),
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


def test_a_model_that_is_broken_or_newer(work, tmp_path, capsys):
    content = json.loads((work / "model.json").read_text(encoding="utf-8"))
    out = tmp_path / "pred.csv"
    broken = {
        "newer.json": (content | {"format_version": 99}, "99"),
        "short.json": (content | {"weights": [1.0]}, "weights"),
        "other.json": ({"a": 1}, "no model"),
        "less.json": ({k: v for k, v in content.items() if k != "levels"}, "levels"),
    }
    for name, (changed, fragment) in broken.items():
        (tmp_path / name).write_text(json.dumps(changed), encoding="utf-8")
        message = complaint(capsys, "predict", tmp_path / name, work / "stage.csv", "--out", out)
        assert name in message
        assert fragment in message
    assert not out.exists()


def test_an_input_outside_the_range_of_the_model(work, tmp_path, capsys):
    columns = stage_columns()
    columns["u_V"] = columns["u_V"] + 30.0
    data = write_csv(tmp_path / "beyond.csv", columns)
    out = tmp_path / "pred.csv"
    message = complaint(capsys, "predict", work / "model.json", data, "--out", out)
    assert "outside the range" in message
    assert "beyond.csv" in message
    assert not out.exists()


def test_a_prediction_without_the_auxiliary_column(work, tmp_path, capsys):
    columns = stage_columns()
    del columns["load_N"]
    data = write_csv(tmp_path / "less.csv", columns)
    message = complaint(
        capsys, "predict", work / "model.json", data, "--out", tmp_path / "pred.csv"
    )
    assert "load_N" in message


# Failures and interruptions


def fails_with(error):
    def effects_library():
        raise error

    return effects_library


def test_a_failure_of_ours_is_one_line_with_code_1(monkeypatch, capsys):
    monkeypatch.setattr(EFFECTS, "library", fails_with(RuntimeError("two\nlines")))
    assert main(["effects"]) == 1
    message = capsys.readouterr().err
    assert message.count("\n") == 1
    assert "RuntimeError: two lines" in message
    assert "PREISACH_TRACEBACK=1" in message
    monkeypatch.setenv("PREISACH_TRACEBACK", "1")
    assert main(["effects"]) == 1
    assert "Traceback (most recent call last)" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("error", "code", "fragment"),
    [
        (InputError("one\nline"), 2, "one line"),
        (KeyboardInterrupt(), 130, "interrupted"),
        (MemoryError(), 1, "not enough memory"),
        (PermissionError(13, "Permission denied", "there.csv"), 2, "there.csv: Permission denied"),
        (OSError("broken disk"), 1, "broken disk"),
    ],
)
def test_how_things_end(error, code, fragment, monkeypatch, capsys):
    monkeypatch.setattr(EFFECTS, "library", fails_with(error))
    assert main(["effects"]) == code
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert fragment in lines[0]


def test_progress_is_sparse_lines_where_nobody_watches(capsys, monkeypatch):
    clock = iter([0.0, 0.5, 3.0, 3.5, 6.0])
    monkeypatch.setattr("time.monotonic", lambda: next(clock))
    with progress() as show:
        for text in ("a", "b", "c", "d"):
            show(text, 0.5)
    assert capsys.readouterr().err.splitlines() == ["[   3 s] b", "[   6 s] d"]


def test_progress_is_a_bar_on_a_terminal(capsys, monkeypatch):
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    with progress() as show:
        show("trying [creep]", 0.5)
    assert "trying [creep]" in capsys.readouterr().err


def test_nothing_that_is_read_is_written_over(work, capsys):
    data, model = work / "stage.csv", work / "model.json"
    before = data.read_bytes(), model.read_bytes()
    columns = ["--time", "t_ms", "--input", "u_V", "--output", "z_um"]
    assert str(data) in complaint(capsys, "fit", data, *columns, "--out", data)
    assert str(data) in complaint(capsys, "predict", model, data, "--out", data)
    assert str(model) in complaint(capsys, "predict", model, data, "--out", model)
    assert (data.read_bytes(), model.read_bytes()) == before


def test_a_column_in_another_unit_than_the_model_s_is_refused(work, tmp_path, capsys):
    columns = stage_columns()
    columns["u_mV"] = columns.pop("u_V")
    data, out = write_csv(tmp_path / "milli.csv", columns), tmp_path / "out.csv"
    words = ["predict", work / "model.json", data, "--input", "u_mV", "--out", out]
    message = complaint(capsys, *words)
    assert "mV" in message
    assert "u_mV" in message
    assert not out.exists()


def test_another_sampling_rate_than_the_model_s_is_told(work, tmp_path, capsys):
    columns = {name: values[::3] for name, values in stage_columns().items()}
    data, out = write_csv(tmp_path / "sparse.csv", columns), tmp_path / "out.csv"
    assert main(["predict", str(work / "model.json"), str(data), "--out", str(out)]) == 0
    assert "3 times" in capsys.readouterr().out


def test_gaps_and_unmeasured_samples_are_told(tmp_path, capsys):
    columns = stage_columns()
    columns["t_ms"][400:] += 500
    rows = {
        k: ",".join(f"{columns[c][k - 2]:.9g}" for c in ("t_ms", "u_V")) + ",,5" for k in (9, 10)
    }
    data = write_csv(tmp_path / "holes.csv", columns, rows)
    words = ["fit", str(data), "--levels", "4", "--out", str(tmp_path / "model.json")]
    assert main([*words, "--time", "t_ms", "--input", "u_V", "--output", "z_um"]) == 0
    shown = capsys.readouterr().out
    assert "gap of 510 ms before sample 401" in shown
    assert "2 samples without a measured output" in shown

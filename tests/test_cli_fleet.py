"""`preisach fleet`: many records on workers of Dask, what it writes, keeps and refuses."""

import json
import os
import signal
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from stand_ins import client_in_this_process
from test_cli import write_csv

import preisach_jax as pj
from preisach_jax.cli import fleet, main

pytest.importorskip("distributed")
pytest.importorskip("pyarrow")


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Three stages that follow their input with different gains; the second one loses samples."""
    folder = tmp_path_factory.mktemp("fleet")
    rng, t = np.random.default_rng(2), np.arange(700) / 100
    u, paths = 5 + 5 * np.sin(2 * t) * np.cos(0.37 * t), []
    for k in range(3):
        z = (2 + k) * u + 0.01 * rng.normal(size=len(t))
        z[100:110] = np.nan if k == 1 else z[100:110]
        paths.append(write_csv(folder / f"stage{k}.csv", {"t_s": t, "u_V": u, "z_um": z}))
    return paths


def run(*words):
    return main(["fleet", *map(str, words)])


@pytest.fixture
def in_this_process(monkeypatch):
    monkeypatch.setattr(fleet, "_client", client_in_this_process)


def folder_of(out, path):
    (found,) = out.glob(f"{path.stem}-*")
    return found


def written(out):
    """When the row of each record was written."""
    return {path.parent.name: path.stat().st_mtime_ns for path in out.glob("*/fleet.json")}


def changed(out, before):
    return {name.partition("-")[0] for name, time in written(out).items() if time != before[name]}


@pytest.mark.usefixtures("in_this_process")
def test_each_record_has_its_folder_and_row_and_is_done_once(files, tmp_path, capsys):
    torn, out = tmp_path / "torn.csv", tmp_path / "out"
    torn.write_text("a,b\n")
    words = (*files, torn, "--fit", "--levels", 5, "--out", out)
    assert run(*words) == 2  # what cannot be read is told, and the others are done
    said = capsys.readouterr()
    assert "1 of the records came to nothing, as torn.csv" in said.err
    assert "torn.csv: there is no row" in said.out
    table = pd.read_parquet(out / "fleet.parquet").set_index("record")
    for path in files:
        model = pj.Model.load(folder_of(out, path) / "model.json")
        row, fit = table.loc[path.name], pj.fit(pj.Record.load(path), levels=5)
        assert model.to_json()["weights"] == fit.model.to_json()["weights"]
        assert row.rms == fit.rms_validation
        assert row.percent_of_stroke == pytest.approx(100 * row.rms / fit.record.output_range)
        assert (row.folder, row.verdict) == (folder_of(out, path).name, "fitted")
        assert (row.unit, row.levels, row.why_not) == ("um", 5, "")
    assert table.loc["torn.csv"].verdict == "failed"
    assert "there is no row" in table.loc["torn.csv"].why_not

    # Another file of a name that is there, in another order, moves nothing.
    torn.write_text(files[0].read_text())
    other = tmp_path / "b" / "stage0.csv"
    other.parent.mkdir()
    other.write_text(files[1].read_text().replace("0.01,", "0.010,"))
    before = written(out)
    assert run(other, torn, *files[::-1], files[1], "--fit", "--levels", 5, "--out", out) == 0
    said = capsys.readouterr().out
    assert "3 of 5 were done before, and are kept" in said
    assert "stage1.csv is given twice, and is taken once" in said
    assert written(out).items() > before.items()
    # The table is that of the folder; other options do a record anew, in its place.
    before = written(out)
    assert run(files[0], "--fit", "--levels", 4, "--out", out) == 0
    assert changed(out, before) == {"stage0"}
    table = pd.read_parquet(out / "fleet.parquet")
    assert sorted(table.levels) == [4, 5, 5, 5, 5]
    before = written(out)
    assert run(files[0], "--fit", "--levels", 4, "--out", out) == 0
    assert changed(out, before) == set()
    assert run(files[0], "--fit", "--levels", 4, "--out", out, "--restart") == 0
    assert changed(out, before) == {"stage0"}


@pytest.mark.usefixtures("in_this_process")
def test_a_diagnosis_of_each_is_its_report(files, tmp_path, capsys):
    assert run(files[0], "--effects", "drift", "--levels", 5, "--out", tmp_path, "--json") == 0
    (row,) = json.loads(capsys.readouterr().out)["records"]
    folder = folder_of(tmp_path, files[0])
    found = json.loads((folder / "diagnosis.json").read_text())
    assert (row["verdict"], row["effects"]) == (found["verdict"], ", ".join(found["effects"]))
    assert row["rms"] == found["ladder"][-1]["rms_validation"]
    assert (folder / "report.html").exists()
    # Of a result with other options nothing stays.
    assert run(files[0], "--fit", "--levels", 5, "--out", tmp_path) == 0
    assert sorted(path.name for path in folder.iterdir()) == ["fleet.json", "model.json"]


def test_a_worker_that_is_killed_loses_nothing(files, tmp_path, monkeypatch):
    mark = tmp_path / "mark"

    def dying(record, settings):
        if record.name == "stage1.csv" and not mark.exists():
            mark.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        row = {"verdict": "fitted", "effects": "", "why_not": ""}
        return {"model.json": b"{}"}, row | {"rms": 0.1, "unit": "um", "percent_of_stroke": 1.0}

    monkeypatch.setattr(fleet, "study", dying)
    assert run(*files[:2], "--fit", "--levels", 5, "--workers", 1, "--out", tmp_path / "out") == 0
    assert mark.exists()
    table = pd.read_parquet(tmp_path / "out" / "fleet.parquet")
    assert sorted(table.record) == [path.name for path in files[:2]]
    assert not table.why_not.any()


@pytest.mark.usefixtures("in_this_process")
def test_an_interruption_keeps_what_was_finished(files, tmp_path, monkeypatch, capsys):
    genuine, words = fleet._done, (*files, "--fit", "--levels", 5, "--out", tmp_path)

    def interrupted(*arguments):
        yield next(genuine(*arguments))
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(fleet, "_done", interrupted)
        assert run(*words) == 130
    assert "keeps what was finished; resume with: preisach fleet" in capsys.readouterr().err
    assert len(pd.read_parquet(tmp_path / "fleet.parquet")) == 1
    assert run(*words) == 0
    assert "1 of 3 were done before, and are kept" in capsys.readouterr().out
    assert len(pd.read_parquet(tmp_path / "fleet.parquet")) == 3


@pytest.mark.parametrize(
    ("words", "fragments"),
    [
        (["--levels", 1], ["levels is 1"]),
        (["--effects", "creeep"], ["creeep", "creep"]),
        (["--workers", 0], ["--workers", "0"]),
        (["--scheduler", "tcp://127.0.0.1:1"], ["--scheduler is 'tcp://127.0.0.1:1'", "answered"]),
    ],
)
def test_mistakes_are_one_line_that_names_the_option(
    words, fragments, files, tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr(fleet, "CONNECTING_S", 1)
    (tmp_path / "fleet.parquet").write_bytes(b"PAR1 written by preisach_jax")
    assert run(*files, "--out", tmp_path, *words) == 2
    assert (tmp_path / "fleet.parquet").read_bytes().startswith(b"PAR1 written")
    error = capsys.readouterr().err.strip().splitlines()
    assert len([line for line in error if line.startswith("preisach:")]) == 1
    for fragment in fragments:
        assert fragment in error[-1]


def test_without_dask_what_to_install_is_told(files, tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert run(*files, "--out", tmp_path) == 2
    assert "pip install 'preisach_jax[cluster]'" in capsys.readouterr().err
    assert not Path(tmp_path, "fleet.parquet").exists()

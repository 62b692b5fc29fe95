"""What the user had stays: no command replaces what it reads, or what no command wrote."""

import json
import shutil
import struct
from pathlib import Path

import numpy as np
import pytest
from drivable import model_of
from exported import needs_compiler
from matplotlib.figure import Figure
from typer.main import get_command

from preisach_jax import plot
from preisach_jax.cli import main
from preisach_jax.cli.application import build
from preisach_jax.files import is_ours

RECORD, MODEL = ["stage.csv"], ["model.json"]

# A command line of each command that writes, and the files that it would write.
WRITERS = {
    "diagnose": (
        [*RECORD, "--report", "r"],
        ["r/report.html", "r/diagnosis.json", "r/base.json", "r/model.json", "r/form.svg",
         "r/alternatives/creep.json"],
    ),
    "fit": ([*RECORD, "--out", "m.json"], ["m.json"]),
    "predict": ([*MODEL, *RECORD, "--out", "p.csv"], ["p.csv"]),
    "compare": (
        [*MODEL, *RECORD, "--report", "r"], ["r/report.html", "r/comparison.json", "r/density.svg"]
    ),
    "compare several": (
        [*MODEL, *RECORD, "other.csv", "--report", "r"], ["r/comparison.json", "r/overlay.svg"]
    ),
    "design": (["report", "--out", "next.csv"], ["next.csv"]),
    "compensate": ([*MODEL, *RECORD, "--out", "drive.csv"], ["drive.csv"]),
    "export c": (
        [*MODEL, "--to", "c", "--out", "c"],
        [f"c/{name}" for name in ("preisach_model.c", "preisach_model.h", "preisach_test.c",
                                  "Makefile", "README.md")],
    ),
    "export fmu": ([*MODEL, "--to", "fmu", "--out", "f"], ["f/stage.fmu"]),
    "fleet": ([*RECORD, "--out", "f"], ["f/fleet.parquet"]),
    "sweep": (["--out", "s"], ["s/sweep.json"]),
    "figures": (["--only", "1", "--out", "f"], ["f/figure_01.pdf", "f/figure_01.png"]),
    "look": ([*RECORD, "--plot", "l.png"], ["l.png"]),
    "simulate": (["--seconds", "3", "--out", "s.csv", "--truth", "t.json"], ["s.csv", "t.json"]),
    "demo": (["--out", "d"], ["d/simulated-stage/data.csv", "d/reversal-curves/forc.svg"]),
}  # fmt: skip


def words_of(name):
    return [name.split()[0], *WRITERS[name][0]]


@pytest.fixture
def place(tmp_path, monkeypatch):
    """The test runs in a folder that holds a record, a model and the report of a diagnosis."""
    monkeypatch.chdir(tmp_path)
    t = np.arange(200) / 100
    u = 5 - 5 * np.cos(3 * t)
    rows = [f"{a:.2f},{b:.6f},{c:.6f}" for a, b, c in zip(t, u, u**1.1, strict=True)]
    for name in ("stage.csv", "other.csv"):
        Path(name).write_text("\n".join(["t_s,u_V,z_um", *rows]) + "\n")
    Path("report").mkdir()
    for name in ("model.json", "report/model.json"):
        model_of().save(name)
    budget = {"noise": 0.0, "discretisation": 0.0}
    Path("report/diagnosis.json").write_text(json.dumps({"findings": [], "budget": budget}))
    return tmp_path


def state(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def refused(capsys, words):
    """The one line with which a command is refused."""
    assert main(words) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.count("\n") == 1
    return said.err


def test_every_command_that_writes_takes_force():
    commands = get_command(build()).commands  # pyright: ignore[reportAttributeAccessIssue]
    options = {
        name: {word for each in command.params for word in each.opts}
        for name, command in commands.items()
    }
    for writing in ({"--out", "--report", "--plot", "--truth"}, {"--force"}):
        found = {name for name, words in options.items() if words & writing}
        assert found == {name.split()[0] for name in WRITERS}


MINE = (
    b"mine",
    b"t_s,u_V,z_um\n0,0,0\n0.5,1,1\n",
    b'{"note": "of preisach_jax", "effects": []}',
    b"/* see preisach_model.h of preisach_jax */",
    b"\x89PNG\r\n\x1a\n" + struct.pack(">I4s", 13, b"IHDR") + bytes(90) + b"preisach_jax",
    b"%PDF-1.4\n/Producer (me)\n",
    b"PK\3\4 torn",
)


def test_no_file_of_another_origin_is_taken_for_a_commands(tmp_path):
    for content in MINE:
        (tmp_path / "a").write_bytes(content)
        assert not is_ours(tmp_path / "a"), content


@pytest.mark.parametrize("name", WRITERS)
def test_what_no_command_wrote_is_refused_before_the_work(name, place, capsys):
    for file in WRITERS[name][1]:
        path = place / file
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"mine")
        before = state(place)
        said = refused(capsys, words_of(name))
        assert "--force" in said
        assert file in said
        assert state(place) == before
        path.unlink()


@pytest.mark.parametrize(
    "name",
    [
        *("predict", "compensate", "export c", "figures", "look", "simulate"),
        pytest.param("export fmu", marks=needs_compiler),
    ],
)
def test_what_a_command_wrote_it_writes_again(name, place):
    words = words_of(name)
    had = set(state(place))
    assert main([*words, "--quiet"]) == 0
    written = set(state(place)) - had
    assert written >= {place / file for file in WRITERS[name][1]}
    for path in written:
        assert is_ours(path), path
        path.write_bytes(path.read_bytes() + b" ")
    if name in ("predict", "look", "simulate"):
        assert main([*words, "--quiet"]) == 0
        assert not [path for path in written if path.read_bytes().endswith(b" ")]


def test_force_replaces_what_is_somebody_elses_and_never_what_is_read(place, capsys):
    words = words_of("predict")
    Path("p.csv").write_text("mine")
    assert main([*words, "--force", "--quiet"]) == 0
    assert Path("p.csv").read_text().startswith("t,z_pred")
    Path("empty.csv").touch()  # as `mktemp` makes it
    assert main([*words[:-1], "empty.csv", "--quiet"]) == 0
    Path("r").mkdir()
    shutil.copy("model.json", "r/comparison.json")
    shutil.copy("model.json", "README.md")
    before = state(place)
    for words in (
        ["predict", "model.json", "stage.csv", "--out", "stage.csv"],
        ["predict", "model.json", "book.xlsx#S", "--out", "book.xlsx"],
        ["compare", "r/comparison.json", "stage.csv", "--report", "r"],
        ["export", "README.md", "--to", "c", "--out", "."],
        ["look", "l.png", "--plot", "l.png"],
        ["diagnose", "model.json", "--report", "."],
    ):
        assert "this file is read" in refused(capsys, [*words, "--force"])
        assert state(place) == before


def test_a_report_again_holds_no_figures_of_the_run_before(place):
    out = place / "r"
    out.mkdir()
    for name in ("form.png", "worst.png", "own.png"):
        (out / name).write_bytes(plot.png(Figure()))
    (out / "waterfall.png").write_bytes(b"mine")
    assert main([*words_of("compare several"), "--quiet"]) == 0
    assert {path.name for path in out.iterdir()} == {
        "report.html", "comparison.json", "overlay.svg", "own.png", "waterfall.png",
    }  # fmt: skip
    assert (out / "waterfall.png").read_bytes() == b"mine"
    assert is_ours(out / "comparison.json")

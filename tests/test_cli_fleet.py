"""`preisach fleet`: what it writes and shows, and what it refuses."""

import csv

import numpy as np
import pytest

from preisach_jax.cli import main
from preisach_jax.filter.adaptive import AdaptiveFilter
from preisach_jax.filter.fleet import run_fleet
from preisach_jax.operator.plane import Plane


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Three stages that follow their input with different gains; the second one loses samples."""
    folder = tmp_path_factory.mktemp("fleet")
    rng, paths = np.random.default_rng(2), []
    for k in range(3):
        t = np.arange(600 + 50 * (k > 0)) / 100
        x = 5 + 5 * np.sin(2 * t) * np.cos(0.37 * t)
        z = (2 + k) * x + 0.01 * rng.normal(size=len(t))
        cells = [f"{value:.5f}" for value in z]
        if k == 1:
            cells[100:110] = [""] * 10
        rows = [
            f"{time:.2f},{value:.5f},{cell}" for time, value, cell in zip(t, x, cells, strict=True)
        ]
        paths.append(folder / f"stage{k}.csv")
        paths[-1].write_text("\n".join(["t_s,u_V,z_um", *rows]) + "\n")
    return paths


def run(*words):
    return main(["fleet", *map(str, words)])


def test_it_writes_what_the_filter_finds_of_each(files, tmp_path, capsys, x64):
    words = (*files, "--out", tmp_path, "--levels", 5, "--low", -1, "--high", 11, "--passes", 2)
    assert run(*words, "--chunk", 2) == 0
    shown = capsys.readouterr().out
    table = list(csv.DictReader((tmp_path / "fleet.csv").read_text().splitlines()))
    data = [np.genfromtxt(path, delimiter=",", skip_header=1).T for path in files]
    adaptive = AdaptiveFilter(Plane(5, -1.0, 11.0), "ramp")
    expected = run_fleet(adaptive, [x for _, x, _ in data], [z for _, _, z in data], 2)
    for k, row in enumerate(table):
        assert row["record"] == files[k].name
        assert int(row["samples"]) == len(data[k][0])
        assert int(row["updates"]) == expected.updates[k]
        assert float(row["error (um)"]) == pytest.approx(expected.error[k])
        replay = float(row["replay_error (um)"])
        assert replay == pytest.approx(expected.replay_error[k])
        assert float(row["offset (um)"]) == pytest.approx(expected.offset[k])
        percent = 100 * replay / (np.nanmax(data[k][2]) - np.nanmin(data[k][2]))
        assert float(row["replay_error (%)"]) == pytest.approx(percent)
        assert percent < 5
    assert "error (µm)" in shown
    assert sorted(path.name for path in (tmp_path / "done").iterdir()) == [
        "records_0000-0001.json", "records_0002-0002.json",
    ]  # fmt: skip


def test_it_goes_on_and_says_so_when_it_was_interrupted(files, tmp_path, capsys, monkeypatch):
    calls, genuine = [], run_fleet

    def interrupted(*arguments):
        calls.append(len(arguments[1]))
        if len(calls) == 2:
            raise KeyboardInterrupt
        return genuine(*arguments)

    monkeypatch.setattr("preisach_jax.filter.fleet.run_fleet", interrupted)
    words = (*files, "--out", tmp_path, "--levels", 5, "--chunk", 1)
    assert run(*words) == 130
    assert "keeps the finished chunks; resume with: preisach fleet" in capsys.readouterr().err
    assert run(*words) == 0
    assert calls == [1, 1, 1, 1]
    assert run(*words, "--restart") == 0
    assert calls == [1] * 7


@pytest.mark.parametrize(
    ("words", "fragments"),
    [
        (["--levels", 1], ["--levels is 1"]),
        (["--high", 8], ["stage0.csv: the input reaches from", "to 8: move --low and --high"]),
        (["--hysteron", "play"], ["--hysteron is 'play'"]),
        (["--input", "x"], ["stage0.csv", "x"]),
        (["--process", 0], ["--coordinator"]),
    ],
)
def test_mistakes_are_one_line_that_names_the_option(words, fragments, files, tmp_path, capsys):
    assert run(*files, "--out", tmp_path, *words) == 2
    error = capsys.readouterr().err.strip().splitlines()
    assert len([line for line in error if line.startswith("preisach:")]) == 1
    for fragment in fragments:
        assert fragment in error[-1]


def test_records_that_do_not_belong_together_are_told(files, tmp_path, capsys):
    assert run(files[0], files[0], "--out", tmp_path) == 2
    assert "stage0.csv is given twice" in capsys.readouterr().err
    other = tmp_path / "other.csv"
    other.write_text(files[0].read_text().replace("z_um", "z_nm"))
    assert run(files[1], other, "--out", tmp_path / "out") == 2
    assert "its output has the unit 'nm', and that of" in capsys.readouterr().err
    micro = tmp_path / "micro.csv"  # one unit, however it is written
    micro.write_text(files[1].read_text().replace("z_um", "z (µm)"), encoding="utf-8")
    assert run(files[0], micro, "--out", tmp_path / "out", "--levels", 5, "--chunk", 1) == 0
    assert run(files[0], micro, "--out", tmp_path / "out", "--levels", 6, "--chunk", 1) == 2
    assert "holds a fleet with levels 5 and not 6" in capsys.readouterr().err
    assert run(*files, "--out", files[0].parent) == 2
    assert "the folder of" in capsys.readouterr().err

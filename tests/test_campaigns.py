"""Each campaign at a small size, and the command that runs them."""

import subprocess
import sys
from pathlib import Path

import campaigns
import numpy as np
import pytest
from campaigns import CAMPAIGNS, Campaign
from trust import corruption, mutants

ROOT = Path(__file__).parents[1]


def test_all_campaigns_are_listed_with_their_commands(capsys):
    assert campaigns.main(["--list"]) == 0
    shown = capsys.readouterr().out
    for name, campaign in CAMPAIGNS.items():
        assert f"{name} " in shown
        assert campaign.proves in shown
        assert " ".join(campaign.words) in shown


@pytest.mark.parametrize("name", CAMPAIGNS)
def test_what_a_campaign_runs_is_there(name):
    paths = [word for word in CAMPAIGNS[name].words if word.endswith(".py") or word == "tests"]
    assert paths
    for path in paths:
        assert (ROOT / path.removeprefix("--ignore=")).exists()


def test_an_unknown_campaign_is_named(capsys):
    with pytest.raises(SystemExit, match="2"):
        campaigns.main(["kills", "kisses"])
    assert "there is no campaign 'kisses': one of hidden, readme" in capsys.readouterr().err


def test_a_campaign_that_fails_does_not_stop_the_others(monkeypatch, capfd):
    made = {
        "bad": Campaign("It fails.", ("-c", "raise SystemExit(3)")),
        "absent": Campaign("It lacks a package.", ("-c", ""), needs="no_such_package"),
        "good": Campaign(
            "It works.", ("-c", "import os; print(os.environ['TOLD'])"), environment={"TOLD": "so"}
        ),
    }
    written = []
    monkeypatch.setattr(campaigns, "CAMPAIGNS", made)
    monkeypatch.setattr(campaigns, "write_results", lambda *words: written.append(words))
    assert campaigns.main([]) == 1
    shown = capfd.readouterr().out
    assert "bad: failed with exit code 3" in shown
    assert "absent: not run: needs no_such_package" in shown
    assert "\nso\n" in shown
    assert "good: passed" in shown
    ((name, content),) = written
    assert name == "campaigns.json"
    assert list(content["campaigns"]) == ["bad", "absent", "good"]
    assert campaigns.main(["good", "absent"]) == 0
    assert len(written) == 1


def test_tests_of_campaigns_are_left_out_unless_they_are_asked_for():
    words = [sys.executable, "-m", "pytest", "--collect-only", "-q", "--noconftest"]
    said = [
        subprocess.run(
            [*words, *asked, "tests/test_notebooks.py"],
            cwd=ROOT, capture_output=True, text=True, check=True,
        ).stdout
        for asked in ([], ["-m", "campaign"])
    ]  # fmt: skip
    assert ["test_a_notebook_runs" in each for each in said] == [False, True]


def test_kills_leave_nothing_half():
    words = ["benchmarks/trust/faults.py", "--only", "online", "--kills", "2", "--keep"]
    done = subprocess.run(
        [sys.executable, *words], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "kills=2" in done.stdout


def test_a_soak_finds_no_drift():
    from trust import soak

    rows = soak.measure("blocks", 4_000)
    assert [row["hysteron"] for row in rows] == ["relay", "ramp"] * 2
    for row in rows:
        assert row["samples"] >= 4_000
        assert row["weights_finite"]
        (checkpoint,) = row["checkpoints"]
        rounding = float(np.finfo(row["precision"]).eps)
        assert checkpoint["drift"] < 1e3 * rounding


def test_spoiled_records_have_spikes_and_holes():
    clean = np.linspace(0.0, 10.0, 5000)
    bad = corruption.spoiled(clean, 10.0, 3)
    assert np.isnan(bad).mean() == pytest.approx(0.1, abs=0.02)
    spikes = np.abs(bad - clean) > 0
    assert 35 <= np.count_nonzero(spikes) <= 50  # one in a hundred, less those that are lost
    assert np.nanmax(np.abs(bad - clean)) > 2.0
    np.testing.assert_array_equal(bad, corruption.spoiled(clean, 10.0, 3))


# --- changes of the package ---


@pytest.mark.parametrize("module", mutants.TESTS)
def test_drawn_changes_can_be_run_and_change_one_place(module):
    source = (mutants.PACKAGE / module).read_text(encoding="utf-8")
    found = mutants.drawn(module)
    assert len(found) > 5
    for mutant in found:
        compile(mutant.source, module, "exec")
        assert mutant.source != source
        old, new = source.splitlines(), mutant.source.splitlines()
        assert old[: mutant.line - 1] == new[: mutant.line - 1]
    assert len({mutant.source for mutant in found}) == len(found)


def test_named_changes_are_of_what_is_there():
    assert len(list(mutants.named())) == len(mutants.NAMED)


def test_a_change_that_tests_notice_is_told_from_one_that_they_do_not(tmp_path, monkeypatch):
    for folder in ("preisach_jax", "tests"):
        (tmp_path / folder).mkdir()
    (tmp_path / "preisach_jax" / "__init__.py").touch()
    (tmp_path / "preisach_jax" / "few.py").write_text("A = 1\nB = 2\n")
    (tmp_path / "tests" / "test_few.py").write_text(
        "from preisach_jax.few import A\n\n\ndef test_a():\n    assert A == 1\n"
    )
    (tmp_path / "tests" / "test_none.py").write_text("def test_none():\n    pass\n")
    monkeypatch.setattr(mutants, "TESTS", {"few.py": ("test_none.py", "test_few.py")})
    seen = mutants.tried(mutants.Mutant("few.py", 1, "A", "A = 2\nB = 2\n"), tmp_path)
    assert (seen["outcome"], seen["by"]) == ("noticed", "test_few.py::test_a")
    missed = mutants.tried(mutants.Mutant("few.py", 2, "B", "A = 1\nB = 3\n"), tmp_path)
    assert (missed["outcome"], missed["by"]) == ("survived", "")
    assert (tmp_path / "preisach_jax" / "few.py").read_text() == "A = 1\nB = 2\n"

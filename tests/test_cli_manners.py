"""How the command line behaves: help, JSON, silence, colour, progress, interruption, completion."""

import functools
import io
import json
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from test_cli import stage_columns, write_csv
from typer.main import get_command

from preisach_jax.cli import main, screen
from preisach_jax.cli.application import build
from preisach_jax.effects import library

COMMANDS = sorted(get_command(build()).commands)  # pyright: ignore[reportAttributeAccessIssue]


@pytest.fixture
def inside(tmp_path, monkeypatch):
    """The test runs in a folder that holds a record."""
    write_csv(tmp_path / "stage.csv", stage_columns())
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("command", [[], *([name] for name in COMMANDS)])
def test_a_help_ends_with_examples_that_are_understood(command, capsys):
    assert main([*command, "--help"]) == 0
    shown = capsys.readouterr().out
    assert all(len(line) <= 80 for line in shown.splitlines()), shown
    head, _, tail = shown.partition("\n  Examples:\n")
    assert not command or ("--json" in head and "-q, --quiet" in head)
    lines = tail.rstrip("\n").split("\n")
    assert 2 <= len(lines) <= 4
    application = get_command(build())
    for line in map(str.strip, lines):
        name, *words = shlex.split(line.partition(" > ")[0])[1:]
        assert command in ([], [name])
        found = application.commands[name]  # pyright: ignore[reportAttributeAccessIssue]
        found.make_context(name, words)  # refuses options and arguments that there are not


# JSON


def document(capsys, *words):
    """The one JSON document on stdout, and what stands on stderr."""
    assert main([*map(str, words), "--json"]) == 0
    shown = capsys.readouterr()
    return json.loads(shown.out), shown.err


def content(path):
    return json.loads(Path(path).read_text(encoding="utf-8"))


@pytest.mark.usefixtures("inside")
def test_json_of_results_is_that_of_their_files_and_quiet_leaves_the_verdict(capsys):
    words = ["diagnose", "stage.csv", "--effects", "drift", "--levels", "5", "--report", "found"]
    found, beside = document(capsys, *words)
    assert found == content("found/diagnosis.json")
    assert "guessed from names and units: time t_ms, input u_V, output z_um" in beside
    assert main([*words, "-q"]) == 0
    expected = ": ".join([found["verdict"], ", ".join(found["effects"])]).removesuffix(": ")
    assert capsys.readouterr() == (f"{expected}\n", "")
    fitted, beside = document(capsys, "fit", "stage.csv", "--levels", "5", "--out", "model.json")
    assert fitted == content("model.json")
    assert "700 rows" in beside
    compared, _ = document(capsys, "compare", "model.json", "stage.csv", "--report", "compared")
    assert compared == content("compared/comparison.json")
    assert document(capsys, "predict", "model.json", "stage.csv", "--out", "p.csv")[0] == {
        "files": ["p.csv"], "columns": ["t", "z_pred", "z_low", "z_high"], "rows": 700,
    }  # fmt: skip
    assert main(["predict", "model.json", "stage.csv", "--out", "p.csv", "-q"]) == 0
    assert capsys.readouterr() == ("", "")


def test_json_of_the_library_holds_every_effect_with_its_parameters(capsys, monkeypatch):
    known = library()
    ascii_only = io.TextIOWrapper(io.BytesIO(), encoding="ascii")
    monkeypatch.setattr("sys.stdout", ascii_only)  # it is UTF-8 whatever the terminal takes
    assert main(["effects", "--json"]) == 0
    found = json.loads(ascii_only.buffer.getvalue().decode("utf-8"))  # pyright: ignore[reportAttributeAccessIssue]
    monkeypatch.undo()
    assert [each["name"] for each in found] == list(known)
    assert [each["source"] for each in found] == [effect.source for effect in known.values()]
    lag, _ = document(capsys, "effects", "input_lag")
    assert lag in found
    (tau,) = lag["parameters"]
    assert (tau["name"], tau["unit"]) == ("tau_s", "s")
    assert 0 < tau["low"] < tau["high"]


@pytest.mark.usefixtures("inside")
def test_quiet_hides_no_mistake_and_does_not_silence_the_next_command(capsys):
    assert main(["fit", "none.csv", "--out", "m.json", "-q", "--json"]) == 2
    shown = capsys.readouterr()
    assert (shown.out, "there is no such file" in shown.err) == ("", True)
    assert main(["effects", "creep"]) == 0
    assert "Kelvin-Voigt" in capsys.readouterr().out


# Progress


def test_lines_of_progress_tell_the_time_left(capsys, monkeypatch):
    clock = iter([0.0, 0.0, 10.0, 20.0, 30.0])
    monkeypatch.setattr("time.monotonic", functools.partial(next, clock))
    with screen.progress() as show:
        for text, done in (("a", 0.0), ("b", 0.25), ("c", 0.5), ("d", 0.75)):
            show(text, done)
    assert capsys.readouterr().err.splitlines() == [
        "[  10 s] b (about 30 s left)",
        "[  20 s] c (about 20 s left)",
        "[  30 s] d (about 10 s left)",
    ]


def test_the_time_left_of_a_diagnosis_fits_a_long_search():
    # Share of the time that had passed, and of its search that was done, in a measured one.
    course = [(0.06, 0.0), (0.1, 0.05), (0.16, 0.12), (0.31, 0.16), (0.56, 0.31), (0.75, 0.38)]
    whole, left, shown = 3600.0, screen.TimeLeft(), []
    show = screen.of_a_diagnosis(lambda text, done: shown.append((text, done)))
    show("0", 0.0)
    for passed, done in course:
        show(str(passed), done)
    assert [done for _, done in shown] == sorted(done for _, done in shown)
    for text, done in shown:
        words = left(done, whole * float(text))
        if float(text) > 0.25:
            minutes = float(words.removeprefix("about ").removesuffix(" min left"))
            assert 1 / 3 < 60 * minutes / (whole * (1 - float(text))) < 3


# Interruption


@pytest.mark.skipif(not Path("/proc/self/maps").exists(), reason="needs /proc")
@pytest.mark.parametrize("when", ["libraries are loaded", "it works"])
def test_an_interruption_is_one_line_and_leaves_nothing(when, inside):
    # A shell that started the tests in the background would have them ignore SIGINT.
    heed = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); "
    heed += "from preisach_jax.cli import main, screen; screen._SPARSE_S = 0; exit(main())"
    process = subprocess.Popen(
        [sys.executable, "-c", heed, "diagnose", "stage.csv", "--levels", "5"],
        cwd=inside, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert process.stderr is not None
    if when == "it works":
        assert process.stderr.readline().startswith("[")
    else:
        while "libjax_common" not in Path(f"/proc/{process.pid}/maps").read_text():
            assert process.poll() is None, "it ended before the library was loaded"
            time.sleep(0.002)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=120)
    lines = [line for line in err.splitlines() if not line.startswith("[")]
    assert lines == ["preisach: interrupted"]
    assert process.returncode == 130
    assert sorted(path.name for path in inside.iterdir()) == ["stage.csv"]


@pytest.mark.parametrize("also_in", ["", "_raise_again", "_interrupt"])
def test_an_interruption_that_a_callback_swallows_comes_again(also_in):
    # As in JAX, whose callback of the garbage collector runs at any time. On a busy machine the
    # next interruption comes while the one before is still being dealt with.
    code = (
        "import gc, signal, sys, time\n"
        "from preisach_jax.cli import process\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "process.listen()\n"
        "def callback(phase, info):\n"
        "    if phase == 'start':\n"
        "        signal.raise_signal(signal.SIGINT)\n"
        "gc.callbacks.append(callback)\n"
        "def early(frame, event, argument, left=[1]):\n"
        f"    if frame.f_code.co_name == {also_in!r} and left.pop(0) if left else False:\n"
        "        signal.raise_signal(signal.SIGINT)\n"
        "sys.setprofile(early)\n"
        "try:\n"
        "    gc.collect()\n"
        "    gc.callbacks.clear()\n"
        "    time.sleep(600)\n"
        "except KeyboardInterrupt:\n"
        "    print('noticed')\n"
    )
    done = subprocess.run(  # in a time shorter than the wait that it must end
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=300
    )
    assert (done.stdout, done.stderr) == ("noticed\n", "")


def test_commands_and_effects_are_completed_and_files_left_to_the_shell(monkeypatch, capsys):
    def complete(line):
        monkeypatch.setenv("COMP_WORDS", line)
        monkeypatch.setenv("COMP_CWORD", str(line.count(" ")))
        monkeypatch.setenv("_PREISACH_COMPLETE", "complete_bash")
        with pytest.raises(SystemExit):
            main([])
        return capsys.readouterr().out.split()

    assert {"diagnose", "design", "demo"} <= set(complete("preisach d"))
    assert complete("preisach fit s.csv --effects creep,d") == ["creep,delay", "creep,drift"]
    assert complete("preisach diagnose sta") == []

"""`preisach sweep` and `preisach figures`: what they write and show, and how they can end."""

import json
import signal
import subprocess
import sys
import time
from contextlib import suppress

import jax
import numpy as np
import pytest

from preisach_jax.cli import main
from preisach_jax.sweep import merge, storage, sweep
from preisach_jax.work.manifest import made_with

SETTINGS = ((3, 2), (0.1, 0.2, 0.4), 2, 1000)
WORDS = "sweep --levels 3,2 --noise 0.1,0.2,0.4 --seeds 2 --samples 1000 --seed 5 --chunk 1".split()


@pytest.fixture(scope="module")
def expected():
    levels, noise, seeds, samples = SETTINGS
    return merge([sweep(jax.random.key(5), levels, noise, [s], samples) for s in range(seeds)])


def shown_table(text, first):
    """Cells of the rows below the header that begins with a word, as far as the next empty line."""
    lines = text.splitlines()
    begin = next(k for k, line in enumerate(lines) if line.startswith(first))
    return [line.split() for line in lines[begin + 2 : lines.index("", begin)]]


def test_sweep_shows_and_writes_what_it_found(expected, tmp_path, capsys):
    out = tmp_path / "new" / "sweep"
    assert main([*WORDS, "--out", str(out)]) == 0
    shown = capsys.readouterr().out
    rows = shown_table(shown, "N ")
    assert [row[:2] for row in rows] == [["3", "6"], ["2", "3"]]
    columns = (expected.delta_x, expected.noise_power, expected.mean_output_error(),
               expected.auxiliary_norm(), expected.coefficient)  # fmt: skip
    assert [int(row[2]) for row in rows] == [int(some) for some in expected.events.mean(axis=1)]
    values = np.array([[float(cell) for cell in row[3:8]] for row in rows])
    np.testing.assert_allclose(values, np.transpose(columns), rtol=6e-4)
    errors = [float(row[9]) for row in rows]
    np.testing.assert_allclose(errors, expected.coefficient_error, rtol=0.06)

    law = expected.exponents()["truth"]
    assert f"{law.value:.3f}" in shown
    assert f"{law.low:.3f} to {law.high:.3f}" in shown
    assert "2 seeds of 1,000 samples on" in shown
    assert shown.rstrip().endswith(f"Sweep: {out / 'sweep.json'}")
    content = json.loads((out / "sweep.json").read_text(encoding="utf-8"))
    assert content["rows"][1]["coefficient"] == expected.coefficient[1]
    np.testing.assert_array_equal(storage.load_folder(out).noise_part, expected.noise_part)


def test_a_broken_chunk_is_told_and_a_restart_begins_anew(tmp_path, capsys, monkeypatch):
    assert main([*WORDS, "--out", str(tmp_path)]) == 0
    chunk = tmp_path / "done" / "seeds_0001-0001.json"
    chunk.write_bytes(b"no chunk")
    capsys.readouterr()
    assert main([*WORDS, "--out", str(tmp_path)]) == 0
    assert (
        f"computed again: {chunk} or its part of sweep.zarr cannot be read"
        in capsys.readouterr().out
    )

    computed = []
    genuine = storage.sweep
    monkeypatch.setattr(storage, "sweep", lambda *a: computed.append(a[3]) or genuine(*a))
    assert main([*WORDS, "--out", str(tmp_path)]) == 0
    assert main([*WORDS, "--out", str(tmp_path), "--resume"]) == 0
    assert computed == []
    assert main([*WORDS, "--out", str(tmp_path), "--restart"]) == 0
    assert computed == [[0], [1]]


# The second chunk begins, and never ends.
HANGING = """
import signal, sys, time
from preisach_jax.cli import main
from preisach_jax.sweep import storage

# Tests that run in the background of a shell hand down that interruptions are ignored.
signal.signal(signal.SIGINT, signal.default_int_handler)
genuine = storage.sweep

def hang(key, levels, noise, seeds, samples):
    if seeds == [1]:
        print("hanging", flush=True)
        time.sleep(300)
    return genuine(key, levels, noise, seeds, samples)

storage.sweep = hang
sys.exit(main(sys.argv[1:]))
"""


def ended(process, how):
    """Send a signal to a process until it ends, as a user does; its exit code.

    Python loses an interruption that falls into a finaliser.
    """
    for _ in range(4):
        time.sleep(1)  # the chunk has begun
        process.send_signal(how)
        with suppress(subprocess.TimeoutExpired):
            return process.wait(30)
    process.kill()
    return pytest.fail("it does not end")


@pytest.mark.slow
@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_what_was_ended_from_outside_goes_on_to_the_same_numbers(how, expected, tmp_path):
    out = tmp_path / "a sweep"
    words = [*WORDS, "--restart", "--out", str(out)]
    with subprocess.Popen(
        [sys.executable, "-c", HANGING, *words],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    ) as process:  # fmt: skip
        assert process.stdout is not None
        assert process.stderr is not None
        assert process.stdout.readline() == "hanging\n"
        code = ended(process, how)
        said = process.stderr.read()
    if how == signal.SIGINT:
        assert code == 130
        again = " ".join(["preisach", *WORDS, "--out", f"'{out}'"])
        assert said.splitlines()[-1] == (
            f"preisach: interrupted; {out} keeps the finished chunks; resume with: {again}"
        )
        assert "Traceback" not in said
    else:
        assert code == -signal.SIGKILL
    first = out / "done" / "seeds_0000-0000.json"
    before = first.stat().st_mtime_ns
    assert main([*WORDS, "--out", str(out)]) == 0
    assert first.stat().st_mtime_ns == before
    found = storage.load_folder(out)
    for name in found.AXES:
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    for one, other in zip(found.weights, expected.weights, strict=True):
        np.testing.assert_array_equal(one, other)


def test_an_interruption_tells_how_to_go_on(tmp_path, capsys, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(storage, "sweep", interrupted)
    assert main([*WORDS, "--restart", "--out", str(tmp_path)]) == 130
    message = capsys.readouterr().err
    assert message.count("\n") == 1
    assert message.endswith(
        f"resume with: {' '.join(['preisach', *WORDS, '--out', str(tmp_path)])}\n"
    )


@pytest.mark.parametrize(
    ("words", "fragments"),
    [
        (["sweep"], ["--out", "preisach sweep --help"]),
        (["sweep", "--levels", "5,1"], ["--levels holds 1", "at least 2"]),
        (["sweep", "--levels", "5,many"], ["--levels is '5,many'", "whole numbers by commas"]),
        (["sweep", "--levels", "5,5"], ["--levels holds (5, 5)", "only once"]),
        (["sweep", "--noise", "0.1,-1"], ["--noise holds -1.0", "above 0"]),
        (["sweep", "--noise=-1"], ["--noise holds -1.0"]),
        (["sweep", "--noise", "0"], ["--noise holds 0.0"]),
        (["sweep", "--noise", "0.1;0.2"], ["--noise is '0.1;0.2'", "numbers by commas"]),
        (["sweep", "--noise", ""], ["--noise is ''"]),
        (["sweep", "--seeds", "0"], ["--seeds is 0", "at least 1"]),
        (["sweep", "--seeds", "few"], ["--seeds"]),
        (["sweep", "--samples", "10"], ["--samples is 10", "at least 1000"]),
        (["sweep", "--seed", "-1"], ["--seed is -1"]),
        (["sweep", "--chunk", "0"], ["--chunk is 0"]),
        (["figures"], ["--out", "preisach figures --help"]),
        (["figures", "--only", "four"], ["--only is 'four'"]),
    ],
)  # fmt: skip
def test_mistakes_are_one_line_that_names_the_option(words, fragments, tmp_path, capsys):
    out = ["--out", str(tmp_path / "new")] if len(words) > 1 else []
    assert main([*words, *out]) == 2
    shown = capsys.readouterr()
    assert shown.out == ""
    assert shown.err.startswith("preisach: ")
    assert shown.err.count("\n") == 1
    for fragment in fragments:
        assert fragment in shown.err
    assert not list(tmp_path.iterdir())


def test_a_folder_that_cannot_be_one_or_that_holds_another_sweep(tmp_path, capsys):
    file = tmp_path / "file"
    file.write_text("")
    assert main([*WORDS, "--out", str(file)]) == 2
    assert "this is a file" in capsys.readouterr().err
    settings = storage.sweep_settings(jax.random.key(6), *SETTINGS, 1)
    manifest = {"format": 2, "settings": settings, "made_with": made_with()}
    (tmp_path / "manifest.json").write_text(json.dumps(manifest))
    assert main([*WORDS, "--out", str(tmp_path)]) == 2
    message = capsys.readouterr().err
    assert f"{tmp_path} holds a sweep with key 0,6 and not 0,5: choose another" in message
    assert "--restart" in message


def test_figures_draws_those_that_are_chosen(tmp_path, capsys):
    assert main(["figures", "--out", str(tmp_path), "--only", "1,3", "--quick"]) == 0
    assert str(tmp_path) in capsys.readouterr().out
    drawn = {path.stem for path in tmp_path.rglob("*.png")}
    assert drawn == {"figure_01_quick", "figure_03_quick"}


def test_figures_that_do_not_exist(tmp_path, capsys):
    assert main(["figures", "--out", str(tmp_path / "new"), "--only", "99"]) == 2
    assert "99" in capsys.readouterr().err
    assert not (tmp_path / "new").exists()


def test_the_help_lists_both_commands(capsys):
    assert main(["--help"]) == 0
    shown = capsys.readouterr().out
    assert "sweep       Measure how the residual error grows with noise" in shown
    assert "figures     Draw the figures of the paper, and those that go further." in shown

"""`preisach sweep` and `preisach figures`: what they write and show, and how they can end."""

import json

import jax
import numpy as np
import pytest

from preisach_jax.cli import main
from preisach_jax.paper import sweep as module
from preisach_jax.paper.sweep import Sweep, merge, sweep

# The setting of test_sweep.py, of which the programs are compiled already.
WORDS = (
    "sweep --levels 5,3 --noise 0.05,0.2,0.5 --seeds 4 --samples 1000 --seed 7 --chunk 2".split()
)
CHUNKS = [0, 1], [2, 3]


@pytest.fixture(scope="module")
def expected():
    settings = (5, 3), (0.05, 0.2, 0.5)
    return merge([sweep(jax.random.key(7), *settings, seeds, 1000) for seeds in CHUNKS])


def test_sweep_shows_and_writes_what_it_found(expected, tmp_path, capsys):
    out = tmp_path / "new" / "sweep"
    assert main([*WORDS, "--out", str(out)]) == 0
    shown = capsys.readouterr().out
    lines = shown.splitlines()
    header = next(k for k, line in enumerate(lines) if line.startswith("N "))
    rows = [line.split() for line in lines[header + 2 : header + 4]]
    assert [row[:2] for row in rows] == [["5", "15"], ["3", "6"]]
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
    assert "4 seeds of 1,000 samples on" in shown
    assert shown.rstrip().endswith(f"Sweep: {out / 'sweep.json'}")
    content = json.loads((out / "sweep.json").read_text(encoding="utf-8"))
    assert content["rows"][1]["coefficient"] == expected.coefficient[1]
    np.testing.assert_array_equal(Sweep.load(out).noise_part, expected.noise_part)


def test_what_was_interrupted_goes_on_to_the_same_numbers(expected, tmp_path, capsys, monkeypatch):
    out = tmp_path / "a sweep"
    words = [*WORDS, "--out", str(out)]

    def interrupted(key, levels, noise, seeds, samples):
        if seeds == [2, 3]:
            raise KeyboardInterrupt
        return sweep(key, levels, noise, seeds, samples)

    with monkeypatch.context() as patch:
        patch.setattr(module, "sweep", interrupted)
        assert main([*words, "--restart"]) == 130  # which the hint leaves out
    again = " ".join(["preisach", *WORDS, "--out", f"'{out}'"])
    said = f"preisach: interrupted; {out} keeps what was finished; resume with: {again}\n"
    assert capsys.readouterr().err.endswith(said)
    first = out / "seeds_0000-0001.npz"
    before = first.stat().st_mtime_ns
    # As a process that was killed leaves it:
    (out / ".seeds_0002-0003.npz.0a1b2c3d.999999999.part").write_bytes(b"half")
    assert main(words) == 0
    assert first.stat().st_mtime_ns == before
    found = Sweep.load(out)
    for name in found.AXES:
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    for one, other in zip(found.weights, expected.weights, strict=True):
        np.testing.assert_array_equal(one, other)
    assert not list(out.glob(".*"))
    capsys.readouterr()
    assert main([*WORDS, "--seed", "6", "--out", str(out)]) == 2
    message = capsys.readouterr().err
    assert f"{out} holds a sweep with key 0,7 and not 0,6: choose another" in message
    assert "--restart" in message


@pytest.mark.parametrize(
    ("words", "fragments"),
    [
        (["sweep"], ["--out", "preisach sweep --help"]),
        (["sweep", "--levels", "5,1"], ["--levels holds 1", "at least 2"]),
        (["sweep", "--levels", "5,many"], ["--levels is '5,many'", "whole numbers by commas"]),
        (["sweep", "--noise", "0.1,-1"], ["--noise holds -1.0", "above 0"]),
        (["sweep", "--noise", "0.1;0.2"], ["--noise is '0.1;0.2'", "numbers by commas"]),
        (["sweep", "--seeds", "0"], ["--seeds is 0", "at least 1"]),
        (["sweep", "--samples", "10"], ["--samples is 10", "at least 1000"]),
        (["figures", "--only", "99"], ["99"]),
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

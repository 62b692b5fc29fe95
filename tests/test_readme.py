"""The Python of the README runs as it is written, in its order."""

import importlib
import re
from pathlib import Path
from typing import Any

import pytest

from preisach_jax.diagnosis import selection
from preisach_jax.effects import library

README = Path(__file__).parent.parent / "README.md"

SMALLER = {"seconds=8.0": "seconds=6.0", "levels=37": "levels=9", '"creep", "drift", ': '"creep", '}
"""What makes the blocks small, of shapes as in the documentation; nothing else is changed."""

START = importlib.import_module("preisach_jax.fit.stepwise")  # `preisach_jax.fit` is a function

FEW = ("creep",)


def run_blocks(folder, monkeypatch, changes):
    """Run all blocks in one namespace, with some words in the place of others."""
    text = README.read_text(encoding="utf-8")
    blocks = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    assert blocks
    for old, new in changes.items():
        assert sum(block.count(old) for block in blocks) == 1, old
        blocks = [block.replace(old, new) for block in blocks]
    monkeypatch.chdir(folder)
    names: dict[str, Any] = {"__name__": "readme"}
    for block in blocks:
        exec(compile(block, str(README), "exec"), names)
    return names


def check(names, folder, shown):
    assert "creep" in shown
    assert (folder / "model.json").is_file()
    assert "sensor_lag" in [candidate.effect for candidate in names["found"].candidates]
    assert names["found"].effects[0] == "creep"
    measured = names["record"].output
    assert abs(names["prediction"].output - measured).max() < 0.01 * measured.max()
    assert names["z_sim"].shape == measured.shape


@pytest.mark.slow
def test_the_python_blocks_run_in_order(tmp_path, monkeypatch, capsys):
    """On a short record, a coarse plane that is not refined, and with one effect to try."""
    few = {name: effect for name, effect in library().items() if name in FEW}
    monkeypatch.setattr(START, "DEFAULT_LEVELS", 9)
    monkeypatch.setattr(selection, "refined_levels", lambda rows, levels: None)
    monkeypatch.setattr(selection, "library", lambda: few)
    names = run_blocks(tmp_path, monkeypatch, SMALLER)
    check(names, tmp_path, capsys.readouterr().out)
    assert names["better"].model.plane.levels == 9


@pytest.mark.campaign
def test_the_python_blocks_run_in_order_as_they_are_written(tmp_path, monkeypatch, capsys):
    check(run_blocks(tmp_path, monkeypatch, {}), tmp_path, capsys.readouterr().out)

"""The Python of the README runs as it is written, in its order."""

import re
from pathlib import Path
from typing import Any

import pytest

README = Path(__file__).parent.parent / "README.md"


@pytest.mark.slow
def test_the_python_blocks_run_in_order(tmp_path, monkeypatch, capsys):
    blocks = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)
    assert len(blocks) == 6
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {"__name__": "readme"}
    for block in blocks:
        exec(compile(block, str(README), "exec"), names)
    assert "creep" in capsys.readouterr().out
    assert (tmp_path / "model.json").is_file()
    assert "sensor_lag" in [candidate.effect for candidate in names["found"].candidates]
    assert names["found"].effects[0] == "creep"
    measured = names["record"].output
    assert abs(names["prediction"].output - measured).max() < 0.01 * measured.max()
    assert names["z_sim"].shape == measured.shape


@pytest.mark.parametrize(
    "command", ["diagnose", "predict", "compare", "fit", "simulate", "effects"]
)
def test_the_commands_named_are_there(command):
    from preisach_jax.cli import commands

    assert callable(getattr(commands, command))
    assert f"preisach {command}" in README.read_text(encoding="utf-8")

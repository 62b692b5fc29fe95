"""Where people begin: `preisach` alone, and what the package says of itself."""

import json
import os
import re
import tomllib
from pathlib import Path

from preisach_jax.cli import main
from preisach_jax.cli.application import start

ROOT = Path(__file__).parents[1]


def commands(text):
    return [line.split("  ")[1] for line in text.splitlines() if line.startswith("  preisach")]


def test_without_files_it_leads_to_the_demo(tmp_path, capsys):
    assert start(tmp_path) == 0
    said = capsys.readouterr().out
    assert "There is no record here" in said
    assert commands(said)[0] == "preisach demo"


def test_the_newest_record_stands_in_the_commands(tmp_path, capsys):
    for age, name in enumerate(("new one.csv", "old.csv", "notes.md", "empty.csv")):
        path = tmp_path / name
        path.write_text("" if name == "empty.csv" else "t,u,z\n0,1,2\n")
        os.utime(path, (1e9 - age, 1e9 - age))
    report = tmp_path / "preisach-report"
    report.mkdir()
    (report / "diagnosis.json").write_text("{}")
    for name, content in (("model.json", {"format": "preisach_jax model"}), ("other.json", {})):
        (tmp_path / name).write_text(json.dumps(content))
    start(tmp_path)
    said = capsys.readouterr().out
    assert 'preisach look "new one.csv"' in commands(said)
    assert "new one.csv, old.csv" in said
    assert "notes.md" not in said
    assert "empty.csv" not in said
    assert f"preisach design {report.as_posix()} --out next.csv" in commands(said)
    [line] = [line for line in commands(said) if "compare" in line]
    assert line.endswith('model.json "new one.csv"')


def test_every_command_that_it_names_is_there(tmp_path, capsys):
    start(tmp_path)
    for line in commands(capsys.readouterr().out):
        assert main([*line.split()[1:2], "--help"][: 2 if "--help" not in line else 1]) == 0


def test_citation_recipe_and_changelog_agree_with_the_package():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    version = project["version"]
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    recipe = (ROOT / "recipe" / "meta.yaml").read_text(encoding="utf-8")
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert re.search(rf"^version: {re.escape(version)}$", citation, re.MULTILINE)
    assert f'version = "{version}"' in recipe
    assert f"## [{version}]" in changes
    told = set(re.findall(r"^    - ([\w.-]+) ([<>=].*)$", recipe, re.MULTILINE))
    for needed in project["dependencies"]:
        [(name, limits)] = re.findall(r"^([\w-]+)([<>=].*)$", needed)
        name = {"matplotlib": "matplotlib-base"}.get(name, name)
        assert (name, limits) in told, needed

"""The documentation and the README: their code runs. `make docs` builds the former."""

import re
import shlex
import subprocess
import tomllib
from pathlib import Path
from typing import Any

import pytest
from exported import GCC, STRICT, drawn, needs_compiler
from typer.core import TyperGroup
from typer.main import get_command

from preisach_jax.cli import application
from preisach_jax.export.c import sources
from preisach_jax.export.description import describe

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", *sorted(DOCS.rglob("*.md"))]
BLOCK = re.compile(r"^```python\n(.*?)^```(?:\n+```text\n(.*?)^```)?", re.MULTILINE | re.DOTALL)
FENCE = re.compile(r"^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)


def blocks(page):
    """Python and, where it stands behind it, the text that it prints."""
    return BLOCK.findall(page.read_text(encoding="utf-8"))


def fences(page):
    return FENCE.findall(page.read_text(encoding="utf-8"))


def name_of(page):
    return page.relative_to(ROOT).as_posix()


LONG = ("docs/how-to/form.md", "docs/how-to/magnets.md")
"""Pages that search for minutes; test_form.py and test_magnets.py try the same at once."""


SHORTER = {
    "seconds=8.0": "seconds=6.0",
    "found = pj.diagnose(record)": 'found = pj.diagnose(record, ["creep"], levels=9)',
    'fit(record, effects=("creep",))': 'fit(record, effects=("creep",), levels=9)',
    '["creep", "drift", SensorLag()]': '["creep", SensorLag()], levels=9',
    "levels=37": "levels=9",
    "levels=13": "levels=9",
    "levels=19": "levels=9",
    "pj.fit(record)": "pj.fit(record, levels=13)",
    "pj.fit(record, effects=(Fading(),))": "pj.fit(record, effects=(Fading(),), levels=13)",
    'pj.fit(record, effects=("drift",))': 'pj.fit(record, effects=("drift",), levels=13)',
    "optax.adam(1e-2))": "optax.adam(1e-2), training_steps=400)",
    ".run(x, z)": ".run(x, z, missing=False)",  # one program in place of two
    "key(0), levels=(13, 9, 5), seeds=2, samples=20_000": (  # the setting of test_sweep.py
        "key(7), (5, 3), (0.05, 0.2, 0.5), seeds=2, samples=1000"
    ),
}
"""What makes the blocks quicker; nothing else of them is changed."""


def marked(page):
    return pytest.param(page, marks=[pytest.mark.campaign] * (name_of(page) in LONG))


RUN = [page for page in PAGES if blocks(page)]


@pytest.mark.parametrize("page", [marked(page) for page in RUN], ids=name_of)
def test_the_python_of_a_page_runs_in_its_order(page, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    run_blocks(page, capsys, SHORTER)


@pytest.mark.campaign
@pytest.mark.parametrize("page", RUN, ids=name_of)
def test_the_python_of_a_page_prints_what_stands_there(page, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    run_blocks(page, capsys, {})


def run_blocks(page, capsys, shorter):
    names: dict[str, Any] = {"__name__": "page"}
    for number, (block, printed) in enumerate(blocks(page), start=1):
        quick = block
        for long, short in shorter.items():
            quick = quick.replace(long, short)
        exec(compile(quick, f"{name_of(page)}, block {number}", "exec"), names)
        said = capsys.readouterr().out
        if printed and quick == block:
            (words, numbers), (expected, near) = map(words_and_numbers, (said, printed))
            assert words == expected
            assert numbers == pytest.approx(near, rel=0.02)  # last digits are the machine's


def words_and_numbers(text):
    parts = re.split(r"(-?\d+(?:\.\d+)?(?:e-?\d+)?)", " ".join(text.split()))
    return parts[::2], [float(each) for each in parts[1::2]]


def commands_of(page):
    """The lines of a page that a shell runs with `preisach`."""
    for kind, text in fences(page):
        if kind in ("sh", "console"):
            for line in text.replace("\\\n", " ").splitlines():
                words = shlex.split(line.removeprefix("$ "), comments=True)
                if words[:1] == ["preisach"]:
                    yield words[1:]


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_the_commands_of_a_page_are_understood(page):
    """Names of commands, their options and the number of their values."""
    group = get_command(application.build())
    assert isinstance(group, TyperGroup)
    for name, *words in commands_of(page):
        command = group.commands[name]
        context = command.context_class(command, info_name=name)
        command.make_parser(context).parse_args(words)


def test_every_fence_is_of_a_kind_that_is_tried():
    """`py` is left to the page's own words (minutes, or a cluster), `matlab` has no interpreter."""
    found = [fence for page in PAGES for fence in fences(page)]
    tried = {"python", "text", "sh", "console", "c", "toml", "py", "matlab", ""}
    assert {kind for kind, _ in found} <= tried
    texts = [text for kind, text in found if kind == "toml"]
    assert texts
    assert all(tomllib.loads(text) for text in texts)


@needs_compiler
def test_the_c_of_a_page_compiles_with_an_exported_model(tmp_path):
    texts = [text for page in PAGES for kind, text in fences(page) if kind == "c"]
    assert texts
    for name, content in sources(describe(drawn(["creep"]))).items():
        (tmp_path / name).write_text(content, encoding="utf-8")
    reals = "u = 0, z = 0, z_wanted = 0, z_measured = 0"
    head = f'#include "preisach_model.h"\npreisach_state state;\npreisach_real {reals};\n'
    for text in texts:
        (tmp_path / "page.c").write_text(f"{head}void page(void) {{\n{text}}}\n")
        subprocess.run([GCC, *STRICT, "-fsyntax-only", "page.c"], cwd=tmp_path, check=True)

"""The documentation: its code runs. `make docs` builds it."""

import re
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
PAGES = sorted(DOCS.rglob("*.md"))
BLOCK = re.compile(r"^```python\n(.*?)^```", re.MULTILINE | re.DOTALL)


def blocks(page):
    return BLOCK.findall(page.read_text(encoding="utf-8"))


def name_of(page):
    return page.relative_to(DOCS).as_posix()


LONG = ("how-to/form.md", "how-to/magnets.md")
"""Pages that search for minutes; test_form.py and test_magnets.py try the same at once."""


SHORTER = {"levels=13": "levels=9", "optax.adam(1e-2))": "optax.adam(1e-2), training_steps=400)"}
"""What makes the blocks quicker; nothing else of them is changed."""


def marked(page):
    return pytest.param(page, marks=[pytest.mark.campaign] * (name_of(page) in LONG))


@pytest.mark.parametrize("page", [marked(page) for page in PAGES if blocks(page)], ids=name_of)
def test_the_python_of_a_page_runs_in_its_order(page, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {"__name__": "page"}
    for number, block in enumerate(blocks(page), start=1):
        quick = block
        for long, short in SHORTER.items():
            quick = quick.replace(long, short)
        exec(compile(quick, f"{name_of(page)}, block {number}", "exec"), names)
    capsys.readouterr()

"""The documentation: its code runs, every effect has a page and a picture, every name a place."""

import importlib
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import preisach_jax as pj

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
PAGES = sorted(DOCS.rglob("*.md"))
BLOCK = re.compile(r"^```python\n(.*?)^```", re.MULTILINE | re.DOTALL)


def blocks(page):
    return BLOCK.findall(page.read_text(encoding="utf-8"))


def name_of(page):
    return page.relative_to(DOCS).as_posix()


@pytest.fixture
def helper(monkeypatch):
    """Imports a module of the folder of the documentation."""
    monkeypatch.syspath_prepend(str(DOCS))
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    return importlib.import_module


@pytest.mark.parametrize("page", [page for page in PAGES if blocks(page)], ids=name_of)
def test_the_python_of_a_page_runs_in_its_order(page, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {"__name__": "page"}
    for number, block in enumerate(blocks(page), start=1):
        exec(compile(block, f"{name_of(page)}, block {number}", "exec"), names)
    capsys.readouterr()


def test_the_files_that_are_pages_but_not_run_have_no_python_left_out():
    """A block in a list or a tab would not run: all fences of Python stand at the margin."""
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        assert len(re.findall(r"```python", text)) == len(blocks(page)), name_of(page)


def test_every_effect_has_a_page_and_a_picture(helper):
    pages = helper("effect_pages")
    built = pages.pages()
    for name, effect in pj.effects().items():
        text = built[f"effects/{pages.file_name(name)}.md"]
        assert effect.physics in text
        assert effect.experiment in text
        picture = DOCS / "assets" / "effects" / f"{pages.file_name(name)}.png"
        assert picture.read_bytes().startswith(b"\x89PNG")
        assert f"({pages.file_name(name)}.md)" in built["effects/index.md"]
        for parameter in effect.bound_to(pages.example_survey()).parameters():
            assert f"`{parameter.name}`" in text


def test_pictures_are_small_and_all_are_shown(helper):
    helper("effect_pages")
    shown = "".join(page.read_text(encoding="utf-8") for page in PAGES)
    shown += "".join(helper("effect_pages").pages().values())
    shown += helper("gallery").page()
    for picture in (DOCS / "assets").rglob("*.png"):
        assert picture.stat().st_size < 120_000, picture
        assert picture.relative_to(DOCS).as_posix() in shown, picture


def test_every_axis_of_a_picture_is_drawn_by_a_function(helper):
    telling, pictures = helper("telling"), (DOCS / "pictures.py").read_text(encoding="utf-8")
    assert set(telling.TELLING) == set(pj.effects())
    for each in telling.TELLING.values():
        assert f"def {each.axis}(panel: Panel)" in pictures


def test_every_public_name_is_in_the_reference():
    text = "".join(page.read_text(encoding="utf-8") for page in (DOCS / "reference").glob("*.md"))
    documented = set(re.findall(r"^::: ([\w.]+)$", text, re.MULTILINE))
    members = re.findall(r"members: \[(.*)\]", text)
    listed = {name.strip() for row in members for name in row.split(",")}
    for name in pj.__all__:
        own = getattr(pj, name)
        home = f"{own.__module__}.{own.__name__}"
        whole_module = own.__module__ in documented and not own.__module__.endswith("effects.base")
        assert home in documented or whole_module or name in listed, name
    for home in documented:
        module, _, name = home.rpartition(".")
        try:
            importlib.import_module(home)
        except ModuleNotFoundError:
            assert hasattr(importlib.import_module(module), name), home


@pytest.mark.parametrize("name", sorted(pj.effects()))
def test_every_built_in_effect_is_in_the_reference(name):
    kind = type(pj.effects()[name])
    text = (DOCS / "reference" / "effects.md").read_text(encoding="utf-8")
    assert f"::: {kind.__module__}.{kind.__name__}\n" in text


def test_scores_are_those_of_the_committed_results(helper):
    import json

    scores = helper("scores")
    rows = scores.sample()
    content = json.loads((scores.SAMPLE / "summary.json").read_text(encoding="utf-8"))
    assert len(rows) == content["excitation"]["all"]["cases"]
    plain = [row for row in rows if not row["hidden"] and not row["error"]]
    named = sum(bool(row["effects"]) for row in plain)
    page = scores.page()
    assert f"| nothing hidden, something named: diagnose | {named}/{len(plain)} = " in page
    wrong = [row for row in rows if not row["error"] and not scores.right(row)]
    assert scores.failures(rows).count("\n") == len(wrong) + 1
    for name in ("confusion_all", "false_alarms", "risk"):
        assert f"(blind-{name}.png)" in page


def test_commands_have_their_help(helper):
    page = helper("command_line").page()
    for command in ("diagnose", "predict", "compare", "fit", "design", "fleet", "sweep"):
        assert f"## preisach {command}\n" in page
        assert f"Usage: preisach {command}" in page


@pytest.mark.parametrize(
    ("latex", "expected"),
    [
        (r"\frac{a}{b_1}", "<mfrac><mrow><mi>a</mi></mrow><mrow><msub><mi>b</mi><mn>1</mn></msub>"),
        (r"x^2 < 3", "<msup><mi>x</mi><mn>2</mn></msup><mo>&lt;</mo><mn>3</mn>"),
        (r"\frac12 x", "<mfrac><mn>1</mn><mn>2</mn></mfrac><mi>x</mi>"),
        (r"\dot y", '<mover accent="true"><mi>y</mi><mo stretchy="false">˙</mo></mover>'),
        (r"q\,\mathrm{round}(h)", "<mi>round</mi>"),
    ],
)
def test_formulas_become_mathml(helper, latex, expected):
    assert expected in helper("formulas").mathml(latex)


def test_an_unknown_command_is_refused(helper):
    formulas = helper("formulas")
    with pytest.raises(formulas.UnknownCommandError, match="unheard"):
        formulas.mathml(r"\unheard{x}")


def test_all_formulas_of_docstrings_can_be_translated(helper):
    formulas = helper("formulas")
    found = 0
    for file in (ROOT / "preisach_jax").rglob("*.py"):
        if "record" in file.parts:  # regular expressions
            continue
        text = file.read_text(encoding="utf-8")
        for latex in re.findall(r"\\\((.*?)\\\)", text) + re.findall(r"(?s)\\\[ (.*?)\\\]", text):
            formulas.mathml(latex)
            found += 1
    assert found > 40


def test_no_page_names_a_host_to_fetch_from():
    """Addresses in links are the reader's choice; assets must come with the site."""
    for file in [*PAGES, *(DOCS / "assets").glob("*.*s*"), ROOT / "mkdocs.yml"]:
        if file.suffix != ".png":
            assert "https://unpkg" not in file.read_text(encoding="utf-8")


@pytest.mark.slow
def test_the_site_is_built_without_a_warning_and_fetches_nothing(tmp_path):
    pytest.importorskip("material")
    pytest.importorskip("mkdocstrings")
    environment = os.environ | {"NO_MKDOCS_2_WARNING": "1"}
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "-q", "-d", str(tmp_path)]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "WARNING" not in done.stderr
    fetched = re.compile(r"""(?:src=|url\(|<link[^>]*href=)["']?(?:https?:)?//[^"'> ]*""")
    for file in tmp_path.rglob("*"):
        if file.suffix in {".html", ".css"}:
            text = file.read_text(encoding="utf-8")
            assert not fetched.findall(text), file
            assert 'class="arithmatex"' not in text, file
    assert (tmp_path / "effects" / "creep.html").is_file()
    assert not list(tmp_path.rglob("*.py"))

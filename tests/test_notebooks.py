"""Notebooks run, name nothing that the package lacks, and are stored with their outputs."""

import ast
import importlib
import re
from pathlib import Path

import matplotlib.pyplot as plt
import pytest

nbformat = pytest.importorskip("nbformat")

NOTEBOOKS = sorted((Path(__file__).parents[1] / "notebooks").glob("*.ipynb"))
MOST_BYTES = 3_000_000


def code_cells(notebook):
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def code_of(path):
    """The code of a notebook as one text, without what is for IPython alone."""
    cells = code_cells(nbformat.read(path, as_version=4))
    text = "\n".join(cell.source for cell in cells)
    return "\n".join(line for line in text.splitlines() if not line.startswith("%"))


def test_there_are_notebooks():
    assert NOTEBOOKS


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_stored_as_it_was_run(path):
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    cells = code_cells(notebook)
    assert [cell.execution_count for cell in cells] == list(range(1, len(cells) + 1))
    assert any("image/png" in out.get("data", {}) for cell in cells for out in cell.outputs)
    text = path.read_text(encoding="utf-8")
    assert not re.search(r'"/(home|root|tmp|work)/', text), "a path of one machine"
    assert len(text) < MOST_BYTES


def names_of_the_package(code):
    """What a text imports from the package, and the attributes that it takes of its modules."""
    tree, modules, found = ast.parse(code), {}, []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for each in node.names:
                if each.name.partition(".")[0] == "preisach_jax":
                    modules[each.asname or each.name] = importlib.import_module(each.name)
        elif isinstance(node, ast.ImportFrom) and (node.module or "").startswith("preisach_jax"):
            module = importlib.import_module(node.module or "")
            for each in node.names:
                try:
                    inside = importlib.import_module(f"{node.module}.{each.name}")
                    modules[each.asname or each.name] = inside
                except ModuleNotFoundError:
                    found.append((module, each.name))
    for node in ast.walk(tree):
        match node:
            case ast.Attribute(ast.Name(name), attribute) if name in modules:
                found.append((modules[name], attribute))
            case _:
                pass
    return found


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_what_a_notebook_names_is_there(path):
    found = names_of_the_package(code_of(path))
    assert len(found) >= 5
    assert [(module.__name__, name) for module, name in found if not hasattr(module, name)] == []


@pytest.mark.slow
@pytest.mark.parametrize("name", ["03_your_own_effect"])
def test_the_code_of_a_notebook_runs(name, tmp_path, monkeypatch):
    """In this process, without a kernel to start and with what is compiled already."""
    (path,) = [path for path in NOTEBOOKS if path.stem == name]
    monkeypatch.chdir(tmp_path)
    style = dict(plt.rcParams)
    try:
        exec(compile(code_of(path), str(path), "exec"), {"__name__": "notebook"})
    finally:
        plt.rcParams.update(style)
        plt.close("all")
    assert (tmp_path / "model.json").is_file()


@pytest.mark.campaign
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs(path, tmp_path):
    nbclient = pytest.importorskip("nbclient")
    notebook = nbformat.read(path, as_version=4)
    client = nbclient.NotebookClient(
        notebook, timeout=600, resources={"metadata": {"path": str(tmp_path)}}
    )
    client.execute()  # raises CellExecutionError, which shows the cell
    assert [cell.execution_count for cell in code_cells(notebook)]

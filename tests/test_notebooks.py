"""Notebooks run, name nothing that the package lacks, and are stored with their outputs."""

import ast
import importlib
import re
from pathlib import Path

import pytest

nbformat = pytest.importorskip("nbformat")

NOTEBOOKS = sorted((Path(__file__).parents[1] / "notebooks").glob("*.ipynb"))


def code_cells(notebook):
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_stored_as_it_was_run_and_what_it_names_is_there(path):
    cells = code_cells(nbformat.read(path, as_version=4))
    assert [cell.execution_count for cell in cells] == list(range(1, len(cells) + 1))
    assert any("image/png" in out.get("data", {}) for cell in cells for out in cell.outputs)
    text = path.read_text(encoding="utf-8")
    assert not re.search(r'"/(home|root|tmp|work)/', text), "a path of one machine"
    lines = "\n".join(cell.source for cell in cells).splitlines()
    modules, named = {}, []
    for node in ast.walk(ast.parse("\n".join(line for line in lines if line[:1] != "%"))):
        match node:
            case ast.Import(names):
                modules |= {a.asname or a.name: a.name for a in names if "preisach_jax" in a.name}
            case ast.ImportFrom(str(module), names) if module.startswith("preisach_jax"):
                named += [(module, alias.name) for alias in names]
            case ast.Attribute(ast.Name(name), attribute):
                named.append((name, attribute))
            case _:
                pass
    named = [(modules.get(name, name), attribute) for name, attribute in named]
    named = [(module, each) for module, each in named if module.startswith("preisach_jax")]
    assert len(named) >= 5
    for module, each in named:
        if not hasattr(importlib.import_module(module), each):
            importlib.import_module(f"{module}.{each}")


@pytest.mark.campaign
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs(path, tmp_path):
    nbclient = pytest.importorskip("nbclient")
    notebook = nbformat.read(path, as_version=4)
    resources = {"metadata": {"path": str(tmp_path)}}
    nbclient.NotebookClient(notebook, timeout=600, resources=resources).execute()
    assert [cell.execution_count for cell in code_cells(notebook)]

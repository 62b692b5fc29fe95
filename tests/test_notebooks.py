"""Notebooks run, name nothing that the package lacks, and are stored with their outputs."""

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
    source = "\n".join(cell.source for cell in cells)
    modules = dict(re.findall(r"^import (preisach_jax\S*) as (\w+)$", source, re.M))
    named = [
        (module, each)
        for module, name in modules.items()
        for each in re.findall(rf"\b{name}\.([A-Za-z]\w*)", source)
    ]
    for module, names in re.findall(r"^from (preisach_jax\S*) import (.*)$", source, re.M):
        named += [(module, each.partition(" as ")[0]) for each in names.split(", ")]
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

"""The page on the architecture: a record's way through the package, and its rooms."""

from __future__ import annotations

import ast
import re
from collections.abc import Mapping
from pathlib import Path

import preisach_jax

PACKAGE = Path(preisach_jax.__file__).parent

TEXT = """# Architecture

A measured `Record` becomes a `Fit`, a `Diagnosis` and a `Model`; a model becomes predictions, a
drive, or C code. Results are data: what shows, draws, saves and exports them stands above them.

## The way of a record

1. `record/reading.py`, `record/readers/`: a file becomes a `Table`, by its first bytes or ending.
2. `record/layouts.py`, `record/columns.py`: which column is the time, the input, the output.
3. `record/core.py`, `record/checks.py`, `record/blemishes.py`: the `Record`; faults are refused or
   mended.
4. `look/`: what it can tell, before any fit.
5. `operator/plane.py`, `operator/states.py`: thresholds, and the states of the hysterons along the
   input.
6. `chain/`, `effects/`: the effects around the operator; the output as a matrix of regressors.
7. `identify/`: weights by least squares, parameters by Gauss-Newton around them. Where it comes to
   is a `Point`, which never changes.
8. `fit/stepwise.py`: the plain model, and one with an effect more.
9. `diagnosis/search.py`: whole models with and without effects; `diagnosis/evidence.py` and
   `diagnosis/plausible.py` say what speaks against one.
10. `diagnosis/conclusion.py`, `diagnosis/budget.py`, `diagnosis/limits.py`: all rows, the verdict,
    and how large what was not found may be.
11. `model/`: what is kept: prediction, band, file.
12. `present.py`, `plot/`, `report/`, `app/`, `cli/` show it; `compensation/` and `export/` put it
    to use.

## Where to put what

| what | where |
|---|---|
| an effect | `effects/`: one file; one that is not linear and goes into C, `NAME.c.j2` beside it |
| a kind of file | `record/layouts.py` if it is text that is read already, else `record/readers/` |
| a unit, a name of a quantity | `record/units.py`, `record/quantities.py` |
| a doubt about a fitted effect | `diagnosis/plausible.py` |
| a figure | `plot/`, then `report/content.py` and `app/views.py` |
| a command, an option | `cli/commands.py`, `cli/options.py` |
| another program to export to | `export/` |
| an effect of the simulated stage | `plant/`, which shares no code with the models |

How an effect, a reader and a figure are added step by step: `CONTRIBUTING.md`.

??? note "Rooms and their imports"
    Imports run downward only, those inside functions and for annotations as well, and there are no
    circles; `tests/test_architecture.py` guards both. `fit.plot()` and the like call functions
    above that `preisach_jax/__init__.py` has put into `hooks`.

    | room | what it is for | lines | imports |
    |---|---|---|---|
{rows}
"""


def imports() -> dict[str, set[str]]:
    """The rooms of the package, each with those that it imports."""
    found: dict[str, set[str]] = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        room = path.relative_to(PACKAGE).with_suffix("").parts[0]
        if room in ("__init__", "__main__"):
            continue
        own = found.setdefault(room, set())
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("preisach_jax"):
                parts = (node.module or "").split(".")[1:]
                names = [parts[0]] if parts else [alias.name for alias in node.names]
                own.update(name for name in names if name != room)
    return found


def floors(graph: Mapping[str, set[str]]) -> dict[str, int]:
    """How many rooms lie below each, on the longest way down."""
    known: dict[str, int] = {}

    def floor(room: str) -> int:
        if room not in known:
            known[room] = max((1 + floor(below) for below in graph[room]), default=0)
        return known[room]

    return {room: floor(room) for room in graph}


def _purpose(room: str) -> str:
    path = PACKAGE / room
    file = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    text = ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or ""
    return text.split("\n\n")[0].replace("\n", " ").replace("|", "\\|")


def _lines(room: str) -> int:
    path = PACKAGE / room
    files = path.rglob("*.py") if path.is_dir() else [path.with_suffix(".py")]
    return sum(file.read_text(encoding="utf-8").count("\n") for file in files)


def page() -> str:
    """The page in Markdown.

    Raises:
        FileNotFoundError: if it names a file or a folder that the package does not have.
    """
    for place in re.findall(r"`([a-z_]+(?:/[a-z_.]*)+)`", TEXT):
        if not (PACKAGE / place).exists() and not (PACKAGE.parent / place).exists():
            raise FileNotFoundError(f"the page on the architecture names {place}: follow it there")
    graph, floor = imports(), floors(imports())
    rows = "\n".join(
        f"    | `{room}` | {_purpose(room)} | {_lines(room):,} | "
        f"{', '.join(f'`{other}`' for other in sorted(graph[room])) or 'nothing'} |"
        for room in sorted(graph, key=lambda room: (-floor[room], room))
    )
    return TEXT.replace("{rows}", rows)

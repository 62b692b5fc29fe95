"""The page on the architecture: its drawing and table are made from the imports of the package."""

from __future__ import annotations

import ast
from collections.abc import Iterable, Mapping
from html import escape
from pathlib import Path

import preisach_jax

PACKAGE = Path(preisach_jax.__file__).parent

WIDTH, HEIGHT, GAP_X, GAP_Y = 112, 30, 14, 46

TEXT = """# Architecture

One way in, one way through: a measured `Record` becomes a `Model`, a `Fit`, a `Diagnosis` and a
report, or a drive and C code. Imports run downward only, those inside functions and for annotations
as well, and there are no circles; `tests/test_architecture.py` guards both.

- `operator`, `filter`: the Preisach operator, and the paper's recursive filter on it. They know
  nothing of records.
- `record`, `look`: what was measured, from files of many kinds, and what it can tell before any
  fit.
- `effects`: one file an effect, with its physics, its parameters as fields, and one step.
- `chain`, `identify`, `fit`, `model`: effects around the operator, the separable least squares
  behind a fit, and the model that is saved. A step of the search is a `Point`: immutable, so
  that it can be kept.
- `diagnosis`: from the plain model by a search among whole models to a verdict, with `diagnose`
  or by hand (`explore`).
- `loss`: what closed cycles of a record lose, as measured and by a model.
- `compensation`, `export`: the inverse, and C, FMU and python-control.
- `present`, `plot`, `report`, `app`, `cli`: all that people see. `fit.plot()` and the like call
  functions there that `preisach_jax/__init__.py` has put into `hooks`.
- `plant`, `piezo`, `signals`: simulated stages that share no code with the models.

## What imports what

Each box is a room: a folder or a file of the package. An arrow leads from a room to one that it
imports; arrows that follow from others are left out.

{drawing}

## Rooms

| room | what it is for | lines | imports |
|---|---|---|---|
{rows}
"""


def imports() -> dict[str, set[str]]:
    """The rooms of the package, each with those that it imports."""
    found: dict[str, set[str]] = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        room = _room(path)
        if room in ("__init__", "__main__"):
            continue
        own = found.setdefault(room, set())
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("preisach_jax"):
                parts = (node.module or "").split(".")[1:]
                names = [parts[0]] if parts else [alias.name for alias in node.names]
                own.update(name for name in names if name != room)
    return found


def _room(path: Path) -> str:
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return parts[0]


def floors(graph: Mapping[str, set[str]]) -> dict[str, int]:
    """How many rooms lie below each, on the longest way down."""
    known: dict[str, int] = {}

    def floor(room: str) -> int:
        if room not in known:
            known[room] = max((1 + floor(below) for below in graph[room]), default=0)
        return known[room]

    return {room: floor(room) for room in graph}


def reduced(graph: Mapping[str, set[str]]) -> dict[str, set[str]]:
    """The imports that do not follow from others."""

    def below(room: str) -> set[str]:
        return graph[room].union(*map(below, graph[room]))

    return {room: own - set().union(*map(below, own)) for room, own in graph.items()}


def drawing(graph: Mapping[str, set[str]]) -> str:
    """The rooms by floors, as an SVG picture."""
    arrows, floor = reduced(graph), floors(graph)
    rows: list[list[str]] = [[] for _ in range(1 + max(floor.values()))]
    for room in sorted(graph):
        rows[floor[room]].append(room)
    x: dict[str, float] = {}
    widest = max(map(len, rows))
    for row in rows:  # from below, each room over the middle of those that it imports
        row.sort(key=lambda room: _mean(x[other] for other in graph[room] if other in x))
        pitch = (WIDTH + GAP_X) * widest / len(row)
        x |= {room: pitch * (place + 0.5) for place, room in enumerate(row)}
    high = len(rows) * (HEIGHT + GAP_Y)
    y = {room: high - (floor[room] + 0.5) * (HEIGHT + GAP_Y) for room in graph}
    lines = [
        f'<path d="M{x[room]:.0f},{y[room] + HEIGHT / 2:.0f} '
        f"C{x[room]:.0f},{y[room] + HEIGHT / 2 + GAP_Y / 2:.0f} "
        f"{x[other]:.0f},{y[other] - HEIGHT / 2 - GAP_Y / 2:.0f} "
        f'{x[other]:.0f},{y[other] - HEIGHT / 2:.0f}" marker-end="url(#down)"/>'
        for room, others in arrows.items()
        for other in sorted(others)
    ]
    boxes = [
        f'<rect x="{x[room] - WIDTH / 2:.0f}" y="{y[room] - HEIGHT / 2:.0f}" width="{WIDTH}" '
        f'height="{HEIGHT}" rx="5"/><text x="{x[room]:.0f}" y="{y[room] + 5:.0f}">'
        f"{escape(room)}</text>"
        for room in graph
    ]
    return (
        f'<svg class="architecture" role="img" aria-label="The rooms of the package by floors" '
        f'viewBox="0 0 {(WIDTH + GAP_X) * widest} {high}" xmlns="http://www.w3.org/2000/svg">'
        '<defs><marker id="down" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="6" '
        'markerHeight="6" orient="auto"><path d="M0,0 8,4 0,8z" fill="#777"/></marker></defs>'
        '<g fill="none" stroke="#999" stroke-width="1">' + "".join(lines) + "</g>"
        '<g fill="#f4f6f8" stroke="#4477aa" font-family="sans-serif" font-size="14" '
        'text-anchor="middle">' + "".join(boxes).replace("<text", '<text fill="#222" stroke="none"')
        + "</g></svg>"
    )  # fmt: skip


def _mean(values: Iterable[float]) -> float:
    known = list(values)
    return sum(known) / len(known) if known else 0.0


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
    """The page in Markdown."""
    graph, floor = imports(), floors(imports())
    rows = "\n".join(
        f"| `{room}` | {_purpose(room)} | {_lines(room):,} | "
        f"{', '.join(f'`{other}`' for other in sorted(graph[room])) or 'nothing'} |"
        for room in sorted(graph, key=lambda room: (-floor[room], room))
    )
    return TEXT.format(drawing=drawing(graph), rows=rows)

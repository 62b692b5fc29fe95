"""The Python script that repeats the steps taken on the page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from preisach_jax.diagnosis.exploration import Exploration
from preisach_jax.record import ReadOptions


@dataclass(frozen=True)
class Click:
    """What was done: `"fit"`, `"find"`, `"add"` or `"undo"`, with levels or the effect's name."""

    what: str
    levels: int | None = None
    effect: str = ""


def without_detours(clicks: Sequence[Click]) -> list[Click]:
    """The clicks that lead to the same state: what was added and taken back at once is left out."""
    kept: list[Click] = []
    for click in clicks:
        if click.what in {"fit", "find"}:
            kept = [click]
        elif click.what == "undo" and kept and kept[-1].what == "add":
            kept.pop()
        else:
            kept.append(click)
    return kept


def script(name: str, choice: ReadOptions, clicks: Sequence[Click], step: Exploration) -> str:
    """The text of a script that repeats the clicks and gives the same numbers."""
    record = step.record
    lines = [
        '"""Repeats the steps taken in `preisach app`: python SCRIPT [DATA]."""',
        "",
        "import sys",
        "from pathlib import Path",
        "",
        "import preisach_jax as pj",
        "",
        f"data = sys.argv[1] if len(sys.argv) > 1 else Path(__file__).parent / {name!r}",
        "record = pj.Record.load(",
        "    data,",
        *(f"    {key}={value!r}," for key, value in choice.items() if value),
        ")",
        f"if record.sha256 != {record.sha256!r}:",
        '    sys.exit(f"{data} is not the record of these steps: its values differ")',
        "",
    ]
    for click in without_detours(clicks):
        lines += _lines_of(click)
    lines += [
        "",
        "for rung in step.ladder:",
        '    name = " + ".join(("Preisach model", *rung.effects))',
        "    print(name, rung.rms_validation, record.output_unit)",
        'step.fit.save("model.json")',
        "",
    ]
    return "\n".join(lines)


def _lines_of(click: Click) -> list[str]:
    if click.what == "fit":
        return [f"step = pj.explore(record, levels={click.levels})"]
    if click.what == "find":
        return [
            f"found = pj.diagnose(record, levels={click.levels})",
            "print(found.sentence)",
            "step = pj.Exploration.of(found)",
        ]
    if click.what == "add":
        return [f"step = step.add({click.effect!r})"]
    return ["step = step.before or step"]

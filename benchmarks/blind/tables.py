"""Tables and pictures of the blind benchmark: `python benchmarks/blind/tables.py OUT`.

Prints the tables of the results in OUT, and draws there the confusion matrix and the detection
curves.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np

from blind.pictures import draw_confusion, draw_detection
from blind.rates import COMBINATIONS, EXCITATIONS, WAYS, content_of, read_results

Summary = Mapping[str, Any]


def write_tables(folder: Path) -> None:
    """Print the tables of the results in a folder, and draw their pictures."""
    results = read_results(folder)
    if not results:
        sys.exit(f"there is no result in {folder}")
    parts = content_of(results)
    print(tables_of(parts))
    draw_confusion(parts["all"]["confusion"], folder / "confusion_all.png")
    if any(len(row["by_size"]) > 1 for row in parts["all"]["detection"].values()):
        draw_detection(parts, folder / "detection.png")


def tables_of(parts: Summary) -> str:
    """The tables of `content_of`, in Markdown."""
    kinds = [kind for kind in EXCITATIONS if kind in parts]
    lines = _table("", kinds, _overall(), parts)
    for kind in kinds:
        if parts[kind]["confusion"]:
            lines += _confusion_table(parts[kind]["confusion"], kind)
    for title, corner, name, cell in _sections():
        if rows := _rows_of(parts, name, cell):
            lines += ["", f"## {title}", "", *_table(corner, kinds, rows, parts)]
    return "\n".join(lines) + "\n"


Cell = Callable[[Any], str]
Rows = dict[str, Callable[[Summary], str]]


def _overall() -> Rows:
    rows: Rows = {"cases (failed)": lambda part: f"{part['cases']} ({part['failed']})"}
    judged = {
        "exactly right": "exact",
        "right family": "in_family",
        "exactly right where visible": "exact_where_visible",
        "right family where visible": "in_family_where_visible",
        "all that can be seen named, and nothing else": "seen_and_named",
        "something wrong named": "wrong_name",
    }
    for suite in COMBINATIONS:
        for said, key in judged.items():
            rows[f"{suite}: {said}"] = lambda part, suite=suite, key=key: _rate_cell(
                part[key][suite]
            )
    rows["nothing hidden, said to be adequate"] = lambda part: _rate_cell(part["adequate"])
    for way in WAYS:
        rows[f"nothing hidden, something named: {way}"] = lambda part, way=way: _rate_cell(
            part["false_alarms"][way]
        )
    for way in WAYS:
        rows[f"single, size from 1: first name right: {way}"] = lambda part, way=way: _rate_cell(
            part["first_name_right"][way]
        )
    return rows | {
        "outside the library: unexplained or partly": lambda part: _rate_cell(
            part["admitted_outside"]
        ),
        "95 % intervals of parameters with the truth": lambda part: _rate_cell(part["coverage"]),
        "outside the library: called adequate": lambda part: _rate_cell(part["outside_adequate"]),
        "outside the library: a name": lambda part: _rate_cell(part["wrong_name_outside"]),
        "outside the library: a name of no kin": lambda part: _rate_cell(
            part["not_even_kin_outside"]
        ),
        "printed limits that hold, of what was not named": lambda part: _rate_cell(
            part["limits_hold"]
        ),
        "held-out error over the oracle's: median (quartiles; 95 %)": lambda part: _oracle_cell(
            part["over_oracle"]
        ),
        "seconds a diagnosis: median (90 %)": lambda part: (
            f"{part['seconds']['median']:.0f} ({part['seconds']['p90']:.0f})"
            if part["seconds"]["cases"]
            else ""
        ),
    }


def _sections() -> tuple[tuple[str, str, str, Cell], ...]:
    """Title, corner, name in the summary, and cell of each table of rows."""
    return (
        (
            "Size at which an effect is named in 50 % and in 90 % of the cases; median size at the "
            "printed limit",
            "effect",
            "detection",
            _detection_cell,
        ),
        (
            "Parameters: median relative error; share of 95 % intervals with the truth",
            "parameter",
            "parameters",
            _parameter_cell,
        ),
        (
            "Records that hide nothing: false alarms of the diagnosis",
            "circumstance",
            "false_alarms_by_circumstance",
            _rate_cell,
        ),
        (
            "Records that hide nothing: said to be adequate",
            "circumstance",
            "adequate_by_circumstance",
            _rate_cell,
        ),
        ("Effects that were not named: printed limits that hold", "effect", "limits", _rate_cell),
        ("Hidden effects that were named, alone or beside others", "effect", "found", _rate_cell),
        (
            "Physics outside the library: called adequate (most that this left, over the noise); a "
            "name was given",
            "physics",
            "outside",
            _outside_cell,
        ),
    )


def _rows_of(parts: Summary, table: str, cell: Cell) -> Rows:
    """Rows of one table of the summary: those that any excitation has."""
    names = sorted({name for part in parts.values() for name in part[table]})

    def row(name: str) -> Callable[[Summary], str]:
        return lambda part: cell(part[table][name]) if name in part[table] else ""

    return {name: row(name) for name in names}


def _table(corner: str, kinds: list[str], rows: Rows, parts: Summary) -> list[str]:
    head = [f"| {corner} | {' | '.join(kinds)} |", "|---" * (len(kinds) + 1) + "|"]
    cells = {name: [cell(parts[kind]) for kind in kinds] for name, cell in rows.items()}
    # What was not run has no row.
    return head + [f"| {name} | {' | '.join(row)} |" for name, row in cells.items() if any(row)]


def _rate_cell(rate: Summary) -> str:
    if not rate["of"]:
        return ""
    low, high = 100 * rate["low"], 100 * rate["high"]
    return f"{rate['count']}/{rate['of']} = {100 * rate['rate']:.0f} % [{low:.1f}, {high:.1f}]"


def _outside_cell(row: Summary) -> str:
    adequate, given = row["adequate"], row["named"]
    left = f" ({row['most_left']:.0f})" if row["most_left"] is not None else ""
    return f"{adequate['count']}/{adequate['of']}{left}; {given['count']}/{given['of']}"


def _detection_cell(row: Summary) -> str:
    def shown(size: float) -> str:
        return "all" if size == 0 else "never" if np.isinf(size) else f"{size:.2g}"

    limit = "" if np.isnan(row["limit"]) else f"; {row['limit']:.2g}"
    return f"{shown(row['size_50'])}, {shown(row['size_90'])}{limit}"


def _parameter_cell(row: Summary) -> str:
    coverage = row["coverage"]
    error = 100 * row["median_relative_error"]
    held = f"; {coverage['count']}/{coverage['of']}" if coverage["of"] else ""
    return f"{error:.2g} %{held}"


def _oracle_cell(row: Summary) -> str:
    if not row["cases"]:
        return ""
    return f"{row['median']:.2f} ({row['q25']:.2f} to {row['q75']:.2f}; {row['p95']:.2f})"


def _confusion_table(confusion: Summary, kind: str) -> list[str]:
    columns = sorted({name for counts in confusion.values() for name in counts})
    lines = ["", f"## What is hidden, and what is named first: {kind}", ""]
    lines += [f"| hidden | {' | '.join(columns)} |", "|---" * (len(columns) + 1) + "|"]
    for hidden, counts in confusion.items():
        cells = " | ".join(str(counts.get(column, "")) for column in columns)
        lines.append(f"| {hidden} | {cells} |")
    return lines


if __name__ == "__main__":
    write_tables(Path(sys.argv[1] if len(sys.argv) > 1 else "."))

"""`preisach look`: what a file holds and what the record can tell, before any fit."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from preisach_jax.cli import screen
from preisach_jax.cli.options import READING, Data, Force
from preisach_jax.cli.shared import command
from preisach_jax.errors import InputError

if TYPE_CHECKING:
    from preisach_jax.look import ColumnView, Look
    from preisach_jax.record.columns import ReadOptions
    from preisach_jax.record.table import Table

_LINES = 6  # of a terminal, for the picture of a signal
_GRADES = {"well": "shows well", "poorly": "shows poorly", "not at all": "does not show"}


@command(
    "preisach look scope.csv",
    "preisach look logger.tdms --input drive --output 3",
    "preisach look stage.xlsx --plot stage.png",
    "preisach look stage.h5 --json",
    computes=False,
    reads=READING,
)
def look(
    data: Data,
    columns: ReadOptions,
    plot: Annotated[
        Path | None, typer.Option(metavar="FILE", help="draw it into a PNG as well")
    ] = None,
    force: Force = False,
) -> dict[str, Any]:
    """Show what a file holds and what its record can tell, before any fit."""
    from preisach_jax.files import check_file, write_files
    from preisach_jax.look import columns_of, look_at_tables
    from preisach_jax.record.columns import QuestionError, all_runs, numbered
    from preisach_jax.record.reading import read_tables

    if plot is not None:
        check_file(plot, data, force=force)
        if plot.suffix.lower() != ".png":
            raise InputError(f"--plot is {str(plot)!r}; give a file that ends in .png")
    tables = all_runs(read_tables(data), columns)
    table = numbered(tables, columns.get("table"))
    try:
        found = look_at_tables(tables, data.name, **columns)
    except QuestionError as question:
        views = columns_of(table, {})
        _show_columns(table, views)
        screen.say(f"\nWhich column is which? {question}")
        screen.answer(str(question))
        return {
            "columns": [vars(view) for view in views],
            "question": str(question),
            "command": question.command,
        }
    _show_columns(table, found.columns)
    if len(found.records) > 1:
        rows = [[str(value) for value in each.values()] for each in found.records]
        shown = columns.get("table") or 1
        screen.say(
            f"\n{len(rows)} records of one kind, of which {shown} is shown (--table N shows "
            "another; diagnose takes all, or that one)"
        )
        screen.table(("record", "rows", "from row", "to row"), rows)
    together = len(found.records) > 1 and columns.get("table") is None
    _show(found, f"these {len(found.records)} records together" if together else "this record")
    if plot is not None:
        from preisach_jax.plot import png
        from preisach_jax.plot.look import first_look

        write_files({plot: png(first_look(found))})
        screen.say(f"\nFigure: {plot}")
    return found.to_json()


def _show_columns(table: Table, views: list[ColumnView] | tuple[ColumnView, ...]) -> None:
    rows = [
        (
            view.name,
            view.role or ("" if view.kind == "numbers" else view.kind),
            view.why,
            view.unit,
            "" if view.low is None else f"{view.low:.6g} to {view.high:.6g}",
        )
        for view in views
    ]
    count, size = len(table.columns), table.rows.size
    screen.say(f"{table.source}: {count:,} columns, {size:,} rows\n")
    screen.table(("column", "taken as", "why", "unit", "values"), rows, numbers=False)
    if count > len(views):
        screen.say(f"... and {count - len(views):,} more columns")


def _show(found: Look, what: str) -> None:
    record = found.record
    for note in found.notes:
        screen.note(f"  {note}")
    for role, values in (("input", record.input), ("output", found.excitation.record.output)):
        channel = record.channels[role]
        screen.say(f"\n{role} {channel.name} over time")
        screen.picture(record.time, values, _LINES)
    screen.say()
    screen.table(("", "found"), found.rows(), numbers=False)
    well = ", ".join(found.can_tell) or "no effect"
    screen.answer(f"shows well: {well}")
    screen.say(f"\nEffects that {what} can show, if they are present:")
    for grade, text in _GRADES.items():
        names = [each.effect for each in found.prospects if each.grade == grade]
        if names:
            screen.say(f"  {text}: {', '.join(names)}")
    reasons = {each.why: each for each in found.prospects if each.grade != "well"}
    for why, each in reasons.items():
        names = [p.effect for p in found.prospects if p.why == why and p.grade == each.grade]
        screen.say(f"    {', '.join(names)}: {why}")
    for text in found.record_next()[:3]:
        screen.say(f"  to record next: {text}")

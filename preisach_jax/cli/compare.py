"""`preisach compare`: a model against a record, several models, or several records."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from preisach_jax.cli import screen
from preisach_jax.cli.options import READING, AsPng, Data, Force, ModelFile, with_columns_of
from preisach_jax.cli.shared import command
from preisach_jax.errors import InputError

if TYPE_CHECKING:
    from preisach_jax.diagnosis.comparison import Comparison
    from preisach_jax.record import ReadOptions


@command(
    "preisach compare model.json other.csv",
    "preisach compare model.json other.csv --initial-memory low --report other",
    "preisach compare model.json monday.csv tuesday.csv wednesday.csv",
    "preisach compare base.json model.json other.csv --json",
    reads=READING,
)
def compare(
    context: typer.Context,
    model: ModelFile,
    data: Data,
    columns: ReadOptions,
    others: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="[MORE]...", help="further records, or further models before one record"
        ),
    ] = None,
    report: Annotated[Path, typer.Option(metavar="DIR", help="folder of the report")] = Path(
        "preisach-comparison"
    ),
    as_png: AsPng = False,
    force: Force = False,
) -> dict[str, Any]:
    """Test a model against records, or several models against one."""
    from preisach_jax.files import check_folder
    from preisach_jax.report import comparison_names

    models, records = _sorted([model, data, *(others or ())])
    several = len(models) + len(records) > 2
    check_folder(report, [*models, *records], comparison_names(several), force=force)
    pairs = [(one, record) for one in models for record in records]
    found = {
        label: _compared(*pair, columns)
        for label, pair in zip(_labels(models, records), pairs, strict=True)
    }
    how = {"command": context.obj["command"], "as_png": as_png}
    if len(found) == 1:
        return _show_one(next(iter(found.values())), report, how)
    return _show_several(found, report, how)


def _sorted(paths: Sequence[Path]) -> tuple[list[Path], list[Path]]:
    """The models, first of all what stands first, and the records."""
    first, *others = paths
    models = [first, *(path for path in others if path.suffix.lower() == ".json")]
    records = [path for path in others if path.suffix.lower() != ".json"]
    if not records:
        raise InputError(
            f"{', '.join(map(str, paths))}: there is no record among them; give one after the "
            f"models, as in 'preisach compare base.json model.json stage.csv'"
        )
    if len(models) > 1 and len(records) > 1:
        raise InputError(
            f"{len(models)} models and {len(records)} records; give several records for one model, "
            "or several models for one record"
        )
    return models, records


def _labels(models: Sequence[Path], records: Sequence[Path]) -> list[str]:
    """What each comparison is called: the name of its file, or its path where names are alike."""
    varied = models if len(models) > 1 else records
    names = [path.name for path in varied]
    labels = names if len(set(names)) == len(names) else [str(path) for path in varied]
    if len(set(labels)) < len(labels):
        twice = next(label for label in labels if labels.count(label) > 1)
        raise InputError(f"{twice} is given {labels.count(twice)} times; give each file once")
    return labels


def _compared(model: Path, data: Path, columns: ReadOptions) -> Comparison:
    from preisach_jax.diagnosis.comparison import compare as run
    from preisach_jax.model import Model
    from preisach_jax.record import Record

    loaded = Model.load(model)
    notes: list[str] = []
    columns = with_columns_of(columns, loaded)
    record = Record.load(data, **{**columns, "announce": notes.append})
    screen.show_record(record, notes)
    return run(loaded, record)


def _show_one(comparison: Comparison, report: Path, how: dict[str, Any]) -> dict[str, Any]:
    from preisach_jax.report import write_comparison
    from preisach_jax.report.content import comparison_sentence, error_rows, test_rows

    write_comparison(comparison, report, **how)
    sentence = comparison_sentence(comparison)
    screen.answer(sentence)
    screen.say("\n".join(["", sentence, *comparison.notes, ""]))
    screen.table(("", "value"), error_rows(comparison))
    screen.say()
    screen.table(("test of the residual", "found", "expected"), test_rows(comparison))
    screen.say(f"\nReport: {report / 'report.html'}")
    return comparison.to_json()


def _show_several(
    found: dict[str, Comparison], report: Path, how: dict[str, Any]
) -> dict[str, Any]:
    from preisach_jax.report import comparisons_json, write_comparisons
    from preisach_jax.report.several import HEADERS, several_rows, several_sentence

    write_comparisons(found, report, **how)
    sentence = several_sentence(found)
    screen.answer(sentence)
    screen.say(f"\n{sentence}\n")
    screen.table(HEADERS, several_rows(found))
    screen.say(f"\nReport: {report / 'report.html'}")
    return comparisons_json(found)

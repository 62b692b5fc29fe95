"""`preisach compensate`: the drive that makes a stage follow a wanted output."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from preisach_jax.cli import screen
from preisach_jax.cli.options import Aux, Columns, ModelFile, Output, Rate, Time, Unit, numbers
from preisach_jax.cli.shared import command
from preisach_jax.errors import InputError

if TYPE_CHECKING:
    from preisach_jax.model import Model
    from preisach_jax.record import Record

COLUMNS = ("t", "u", "z_expected", "z_low", "z_high", "reachable")


@command(
    "preisach compensate model.json wanted.csv --out drive.csv",
    "preisach compensate model.json wanted.csv --out drive.csv --limits 0,60",
    "preisach compensate model.json wanted.csv --out drive.csv --after played.csv",
)
def compensate(
    model: ModelFile,
    wanted: Annotated[
        Path, typer.Argument(metavar="WANTED", help="a file with time and wanted output")
    ],
    out: Annotated[Path, typer.Option(metavar="FILE", help="where to write the drive (CSV)")],
    after: Annotated[
        Path | None,
        typer.Option(
            metavar="RECORD",
            help="what was played before, which sets the memory; default: the (last) fitted record",
        ),
    ] = None,
    limits: Annotated[
        str | None,
        typer.Option(metavar="LOW,HIGH", help="limits of the drive; default: the model's range"),
    ] = None,
    slew: Annotated[
        float | None, typer.Option(metavar="MAX", help="greatest rate of the drive per s")
    ] = None,
    time: Time = None,
    output: Output = None,
    aux: Aux = None,
    rate: Rate = None,
    unit: Unit = None,
) -> dict[str, Any]:
    """Find the input that makes the output follow a wanted course."""
    from preisach_jax.compensation import compensate as run
    from preisach_jax.files import check_file, write_files
    from preisach_jax.model import Model

    check_file(out, wanted, model, *([] if after is None else [after]))
    bounds = None if limits is None else numbers("--limits", limits, float)
    loaded = Model.load(model, announce=screen.note)
    columns = Columns(time, None, output, aux or (), rate, unit or ())
    course = _wanted(loaded, wanted, columns)
    past = None
    if after is not None:
        past = Columns(aux=aux or ()).load(after, loaded, need_output=False)
    found = run(loaded, course, after=past, limits=bounds, slew=slew)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    series = (found.time, found.drive, found.expected, found.low, found.high)
    reachable = found.reachable.astype(int)
    writer.writerows(zip(*(values.tolist() for values in (*series, reachable)), strict=True))
    write_files({out: text.getvalue().encode()})
    for sentence in found.notes:
        screen.note(f"{wanted}: {sentence}")
    screen.say(f"{out}: {len(found.time):,} rows")
    lost = int((~found.reachable).sum())
    return screen.written(
        [out], columns=COLUMNS, rows=len(found.time), unreachable=lost, notes=found.notes
    )


def _wanted(model: Model, path: Path, columns: Columns) -> Record:
    """The wanted course as a record whose output it is.

    Raises:
        InputError: if it cannot be loaded.
    """
    from dataclasses import replace

    from preisach_jax.cli.options import units_by_column
    from preisach_jax.record import Record

    output = columns.output or model.columns["output"]
    time = columns.time or (None if columns.rate is not None else model.columns["time"])
    units = units_by_column(columns.unit)
    if "output" in units:
        units["input"] = units.pop("output")
    else:
        units.pop("input", None)
    if time is not None and (own := model.units.get("time")):
        units.setdefault("time", own)
    names = [*columns.aux, *(n for n in _aux_of(model) if n not in columns.aux)]
    # A record has an input without holes: of a course that is its output, which goes by that name
    # in what the reader says of it.
    try:
        course = Record.load(
            path,
            time=time,
            input=output,
            aux=names,
            rate=columns.rate,
            units=units,
            need_output=False,
        )
    except InputError as error:
        said = str(error).replace("--input", "--output")
        raise InputError(said.replace("the input must be", "the wanted output must be")) from error
    if course.torn_row is not None:
        raise InputError(
            f"{path}: the last row, {course.torn_row}, breaks off; complete or remove it"
        )
    channels = {**course.channels, "output": course.channels["input"]}
    return replace(course, output=course.input, channels=channels)


def _aux_of(model: Model) -> list[str]:
    """Auxiliary columns that act on the output of a model."""
    from preisach_jax.effects.of_column import OfColumn

    return list(dict.fromkeys(e.column for e in model.effects if isinstance(e, OfColumn)))

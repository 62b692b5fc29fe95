"""`preisach compensate`: the drive that makes a stage follow a wanted output."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from preisach_jax.cli import screen
from preisach_jax.cli.options import (
    Aux,
    Force,
    ModelFile,
    Output,
    Rate,
    Time,
    Unit,
    numbers,
    units_by_column,
    with_columns_of,
)
from preisach_jax.cli.shared import command


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
            help="record of what was played before; it sets the memory; default: the (last) "
            "fitted record",
        ),
    ] = None,
    limits: Annotated[
        str | None,
        typer.Option(metavar="LOW,HIGH", help="limits of the drive; default: the model's range"),
    ] = None,
    slew: Annotated[
        float | None, typer.Option(metavar="MAX", help="maximum slew rate of the drive, per s")
    ] = None,
    time: Time = None,
    output: Output = None,
    aux: Aux = None,
    rate: Rate = None,
    unit: Unit = None,
    force: Force = False,
) -> dict[str, Any]:
    """Find the input that makes the output follow a wanted course."""
    from preisach_jax.compensation import compensate as run
    from preisach_jax.compensation.exchange import COLUMNS, drive_csv, wanted_course
    from preisach_jax.files import check_file, write_files
    from preisach_jax.model import Model
    from preisach_jax.record import Record
    from preisach_jax.record.reading import read_table

    check_file(out, wanted, model, *([] if after is None else [after]), force=force)
    bounds = None if limits is None else numbers("--limits", limits, float)
    loaded = Model.load(model)
    course = wanted_course(
        loaded, read_table(wanted), wanted.name, time=time, output=output, aux=aux or (), rate=rate,
        units=units_by_column(unit or ()),
    )  # fmt: skip
    past = None
    if after is not None:
        columns = with_columns_of({"aux": tuple(aux or ())}, loaded)
        past = Record.load(after, **{**columns, "need_output": False})
    found = run(loaded, course, after=past, limits=bounds, slew=slew)
    write_files({out: drive_csv(found)})
    for sentence in found.notes:
        screen.note(f"{wanted}: {sentence}")
    screen.say(f"{out}: {len(found.time):,} rows")
    lost = int((~found.reachable).sum())
    return screen.written(
        [out], columns=COLUMNS, rows=len(found.time), unreachable=lost, notes=found.notes
    )

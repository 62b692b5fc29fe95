"""`preisach export`: a model as C for a controller, or as an FMU for a simulation."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from preisach_jax.cli import screen
from preisach_jax.cli.options import Force, ModelFile, effect_names
from preisach_jax.cli.shared import command
from preisach_jax.errors import InputError

KINDS = ("c", "fmu")


@command(
    "preisach export model.json --to c --out controller",
    "preisach export model.json --to c --without drift --out controller",
    "preisach export model.json --to fmu --out simulation",
)
def export(
    model: ModelFile,
    to: Annotated[str, typer.Option("--to", metavar="c|fmu", help="C99, or FMI 3.0 co-simulation")],
    out: Annotated[Path, typer.Option(metavar="DIR", help="folder to write into")],
    rate: Annotated[
        float | None,
        typer.Option("--rate", metavar="HZ", help="sampling rate; else that of the record"),
    ] = None,
    without: Annotated[
        str | None, typer.Option("--without", metavar="A,B", help="effects to leave out, by commas")
    ] = None,
    force: Force = False,
) -> dict[str, Any]:
    """Write a model as C code or as an FMU."""
    from preisach_jax.export import C_FILES, export_c, export_fmu, fmu_name
    from preisach_jax.files import check_folder
    from preisach_jax.model import Model

    if to not in KINDS:
        raise InputError(f"--to is {to!r}; give one of {', '.join(KINDS)}")
    check_folder(out, [model], C_FILES if to == "c" else (), force=force)
    left_out = effect_names(without)
    loaded = Model.load(model)
    if to == "fmu":
        check_folder(out, [model], [fmu_name(loaded)], force=force)
    write = export_c if to == "c" else export_fmu
    files = write(loaded, out, rate, left_out)
    for path in files:
        screen.say(str(path))
    if to == "c":
        screen.say(f"\n'make -C {out}' builds and runs the self test")
    return screen.written(files, rate_hz=rate or 1 / loaded.origin.step_s, without=left_out)

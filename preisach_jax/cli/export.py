"""`preisach export`: a model as C for a controller, or as an FMU for a simulation."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from preisach_jax.cli import screen
from preisach_jax.cli.options import ModelFile, effect_names
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
        str | None,
        typer.Option("--without", metavar="A,B", help="effects to leave out, by commas"),
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", help="replace files in DIR that an export did not write")
    ] = False,
) -> dict[str, Any]:
    """Write a model as C code or as an FMU."""
    from preisach_jax.export import export_c, export_fmu
    from preisach_jax.files import check_folder
    from preisach_jax.model import Model

    if to not in KINDS:
        raise InputError(f"--to is {to!r}; give one of {', '.join(KINDS)}")
    check_folder(out)
    for name in () if force or to != "c" else ("Makefile", "README.md"):
        path = out / name
        if path.is_file() and b"preisach_" not in path.read_bytes():
            raise InputError(
                f"{path}: an export did not write this file; choose another folder, or --force"
            )
    left_out = effect_names(without)
    loaded = Model.load(model)
    write = export_c if to == "c" else export_fmu
    files = write(loaded, out, rate, left_out)
    for path in files:
        screen.say(str(path))
    if to == "c":
        screen.say(f"\n'make -C {out}' builds and runs the self test")
    return screen.written(files, rate_hz=rate or 1 / loaded.origin.step_s, without=left_out)

"""What several commands take: the columns of the data, lists of effects, folders."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar, cast

import typer

from preisach_jax.cli.completion import complete_effects
from preisach_jax.errors import InputError

if TYPE_CHECKING:
    from preisach_jax.model import Model
    from preisach_jax.record.columns import ReadOptions
    from preisach_jax.record.core import Record

_Number = TypeVar("_Number", int, float)

Data = Annotated[
    Path,
    typer.Argument(
        metavar="DATA", help="CSV, Excel, MAT, HDF5, TDMS, LVM, NPZ, Parquet, ..., packed or not"
    ),
]
SeveralData = Annotated[
    list[Path],
    typer.Argument(
        metavar="DATA...",
        help="CSV, Excel, MAT, HDF5, TDMS, LVM, NPZ, Parquet, ..., packed or not; several records "
        "of one machine give one model, with a memory for each",
    ),
]
HoldOut = Annotated[
    list[Path] | None,
    typer.Option(
        "--hold-out",
        metavar="DATA",
        help="a record that is held out whole, in place of blocks of the others; may be repeated",
    ),
]
ModelFile = Annotated[Path, typer.Argument(metavar="MODEL", help="a model.json")]
Time = Annotated[
    str | None,
    typer.Option(
        "--time", metavar="COL", help="column of time: name, number or unit; none: there is none"
    ),
]
Input = Annotated[str | None, typer.Option("--input", metavar="COL", help="column of the input")]
Output = Annotated[
    str | None, typer.Option("--output", metavar="COL", help="column of the measured output")
]
Aux = Annotated[
    list[str] | None,
    typer.Option("--aux", metavar="COL", help="column of an auxiliary quantity; may be repeated"),
]
Rate = Annotated[
    float | None, typer.Option("--rate", metavar="HZ", help="sampling rate, in place of --time")
]
Unit = Annotated[
    list[str] | None,
    typer.Option(
        "--unit", "--units", metavar="COL=UNIT", help="unit of a column, or of time, input, "
        "output; may be repeated",
    ),
]  # fmt: skip
TableNumber = Annotated[
    int | None,
    typer.Option("--table", metavar="N", help="of several tables in the file, the one to read"),
]
InitialMemory = Annotated[
    str | None,
    typer.Option(
        metavar="STATE",
        help="before the first row: low, high, demagnetised or free (unknown); predict and compare "
        "also take as-fitted, that of the model's record",
    ),
]
Effects = Annotated[
    str | None,
    typer.Option(
        "--effects",
        metavar="A,B",
        help="names of effects, by commas",
        autocompletion=complete_effects,
    ),
]
Levels = Annotated[
    int | None, typer.Option("--levels", metavar="N", help="levels of the Preisach plane")
]
Force = Annotated[
    bool, typer.Option("--force", help="replace files that preisach_jax did not write")
]
AsPng = Annotated[bool, typer.Option("--png", help="write the figures as PNG as well")]

READING = {
    "time": Time,
    "input": Input,
    "output": Output,
    "aux": Aux,
    "rate": Rate,
    "unit": Unit,
    "initial_memory": InitialMemory,
    "table": TableNumber,
}
"""The options of the command line that say how a record is read."""


def reading(given: Mapping[str, Any]) -> ReadOptions:
    """The options of `Record.load` from those of the command line."""
    told = {name: value for name, value in given.items() if name not in ("aux", "unit")}
    units = units_by_column(given.get("unit") or ())
    return cast("ReadOptions", {"aux": tuple(given.get("aux") or ()), "units": units, **told})


def with_effects(options: ReadOptions, effects: Sequence[str]) -> ReadOptions:
    """The same with the auxiliary columns that effects are named after."""
    from preisach_jax.effects import column_of

    named = [column_of(name) for name in effects if column_of(name)]
    return {**options, "aux": tuple(dict.fromkeys([*options.get("aux", ()), *named]))}


def with_columns_of(options: ReadOptions, model: Model) -> ReadOptions:
    """The same with the columns of a model, and their units, where none are given."""
    from preisach_jax.record.channels import SAMPLES
    from preisach_jax.record.columns import NO_CLOCK

    units = dict(options.get("units") or {})
    told: dict[str, str | None] = {}
    for role in ("time", "input", "output"):
        name = options.get(role)
        if name is None and not (role == "time" and options.get("rate") is not None):
            name = model.columns[role]
            if role == "time" and model.units.get(role) == SAMPLES:
                told[role] = NO_CLOCK
                continue
            if unit := model.units.get(role):
                units.setdefault(role, unit)
        told[role] = name
    aux = tuple(dict.fromkeys([*options.get("aux", ()), *model.columns["aux"]]))
    return cast("ReadOptions", {**options, **told, "aux": aux, "units": units})


def load_all(
    columns: ReadOptions,
    data: Sequence[Path],
    hold_out: Sequence[Path],
    show: Callable[[Record, list[str]], object],
) -> tuple[list[Record], list[Record]]:
    """Load the records that a model is fitted to, and those that are held out."""
    from preisach_jax.files import is_same
    from preisach_jax.record.core import Record

    given = [*data, *hold_out]
    for position, path in enumerate(given):
        if any(is_same(path, other) for other in given[:position]):
            raise InputError(f"{path}: this record is given twice; give each record once")
    records: list[Record] = []
    fitted = 0
    for position, path in enumerate(given):
        notes: list[str] = []
        several = Record.load_all(path, **{**columns, "announce": notes.append})
        for record in several:
            show(record, list(dict.fromkeys(notes)))
            notes.clear()
        if position < len(data):
            fitted += len(several)
        records += several
    return records[:fitted], records[fitted:]


def check_choice(effects: Sequence[str], levels: int | None) -> None:
    """Make sure that there are such effects and levels, before anything is read or shown."""
    from preisach_jax.effects import column_of, resolve
    from preisach_jax.fit.stepwise import checked_levels

    columns = [column_of(name) for name in effects if column_of(name)]
    resolve(effects, dict.fromkeys(columns, ""))
    checked_levels(levels)


def units_by_column(options: Sequence[str]) -> dict[str, str]:
    """Units from options such as `u=V`."""
    units: Mapping[str, str] = {}
    for option in options:
        column, equals, unit = option.rpartition("=")
        if not equals or not column or not unit:
            raise InputError(f"--unit is {option!r}; give a column and its unit, as in --unit u=V")
        units = {**units, column: unit}
    return dict(units)


def effect_names(option: str | None) -> list[str]:
    """Names from a list such as `creep,drift`."""
    if option is None or not option.strip():
        return []
    names = [name.strip() for name in option.split(",")]
    if "" in names:
        raise InputError(f"--effects is {option!r}; give names by commas, as in creep,drift")
    return names


def numbers(option: str, text: str, kind: Callable[[str], _Number]) -> tuple[_Number, ...]:
    """Numbers from a list such as `75,37,19`."""
    try:
        return tuple(kind(word) for word in text.split(","))
    except ValueError:
        wanted = (
            "whole numbers by commas, as in 9,5"
            if kind is int
            else "numbers by commas, as in 0.01,0.1"
        )
        raise InputError(f"{option} is {text!r}; give {wanted}") from None

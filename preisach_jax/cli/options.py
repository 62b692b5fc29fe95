"""What several commands take: the columns of the data, lists of effects, folders."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

import typer

from preisach_jax.cli.completion import complete_effects
from preisach_jax.errors import InputError

if TYPE_CHECKING:
    from preisach_jax.model import Model
    from preisach_jax.record import Record

_Number = TypeVar("_Number", int, float)

Data = Annotated[
    Path,
    typer.Argument(
        metavar="DATA",
        help="CSV, Excel, MAT, HDF5, TDMS, LVM, NPZ, Parquet, ..., packed or not",
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
    str | None, typer.Option("--time", metavar="COL", help="column of time: name, number or unit")
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
InitialMemory = Annotated[
    str | None,
    typer.Option(
        metavar="STATE", help="before the first row: low, high, demagnetised or free (unknown)"
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


@dataclass(frozen=True)
class Columns:
    """How to read a record: the options of the same names."""

    time: str | None = None
    input: str | None = None
    output: str | None = None
    aux: Sequence[str] = ()
    rate: float | None = None
    unit: Sequence[str] = ()
    initial_memory: str | None = None

    def with_effects(self, effects: Sequence[str]) -> Columns:
        """The same with the auxiliary columns that effects are named after."""
        from preisach_jax.effects import column_of

        named = dict.fromkeys(column_of(name) for name in effects if column_of(name))
        return replace(self, aux=[*self.aux, *(name for name in named if name not in self.aux)])

    def load(
        self,
        path: Path,
        model: Model | None = None,
        *,
        need_output: bool = True,
        announce: Callable[[str], object] | None = None,
    ) -> Record:
        """Load a record; columns that are not told are those that a model remembers.

        Raises:
            InputError: if it cannot be loaded.
        """
        from preisach_jax.record import Record

        units = units_by_column(self.unit)
        told = {"time": self.time, "input": self.input, "output": self.output}
        aux = list(self.aux)
        if model is not None:
            for role, name in told.items():
                if name is None and not (role == "time" and self.rate is not None):
                    told[role] = model.columns[role]
                    if unit := model.units.get(role):
                        units.setdefault(role, unit)
            aux += [name for name in model.columns["aux"] if name not in aux]
        return Record.load(
            path,
            time=told["time"],
            input=told["input"],
            output=told["output"],
            aux=aux,
            rate=self.rate,
            units=units,
            initial_memory=self.initial_memory,
            need_output=need_output,
            announce=announce,
        )


def load_all(
    columns: Columns,
    data: Sequence[Path],
    hold_out: Sequence[Path],
    show: Callable[[Record, list[str]], object],
) -> tuple[list[Record], list[Record]]:
    """Load the records that a model is fitted to, and those that are held out.

    Arguments:
        columns: how to read them.
        data, hold_out: their files.
        show: called with each record and what was guessed about it.

    Raises:
        InputError: if one cannot be loaded, or is given twice.
    """
    given = [*data, *hold_out]
    for position, path in enumerate(given):
        if path.resolve() in [other.resolve() for other in given[:position]]:
            raise InputError(f"{path}: this record is given twice; give each record once")
    records: list[Record] = []
    for path in given:
        notes: list[str] = []
        records.append(columns.load(path, announce=notes.append))
        show(records[-1], notes)
    return records[: len(data)], records[len(data) :]


def check_choice(effects: Sequence[str], levels: int | None) -> None:
    """Make sure that there are such effects and levels, before anything is read or shown.

    Raises:
        InputError: if there are not.
    """
    from preisach_jax.effects import column_of, resolve
    from preisach_jax.fit import checked_levels

    columns = [column_of(name) for name in effects if column_of(name)]
    resolve(effects, dict.fromkeys(columns, ""))
    checked_levels(levels)


def units_by_column(options: Sequence[str]) -> dict[str, str]:
    """Units from options such as `u=V`.

    Raises:
        InputError: if one is not of this form.

    Example:
        >>> units_by_column(["u=V", "z=um"])
        {'u': 'V', 'z': 'um'}
    """
    units: Mapping[str, str] = {}
    for option in options:
        column, equals, unit = option.rpartition("=")
        if not equals or not column or not unit:
            raise InputError(f"--unit is {option!r}; give a column and its unit, as in --unit u=V")
        units = {**units, column: unit}
    return dict(units)


def effect_names(option: str | None) -> list[str]:
    """Names from a list such as `creep,drift`.

    Raises:
        InputError: if a name between two commas is empty.

    Example:
        >>> effect_names("creep, drift"), effect_names(None)
        (['creep', 'drift'], [])
    """
    if option is None or not option.strip():
        return []
    names = [name.strip() for name in option.split(",")]
    if "" in names:
        raise InputError(f"--effects is {option!r}; give names by commas, as in creep,drift")
    return names


def numbers(option: str, text: str, kind: Callable[[str], _Number]) -> tuple[_Number, ...]:
    """Numbers from a list such as `75,37,19`.

    Raises:
        InputError: if it is not a list of such numbers.

    Example:
        >>> numbers("--levels", "75, 37", int)
        (75, 37)
    """
    try:
        return tuple(kind(word) for word in text.split(","))
    except ValueError:
        wanted = (
            "whole numbers by commas, as in 9,5"
            if kind is int
            else "numbers by commas, as in 0.01,0.1"
        )
        raise InputError(f"{option} is {text!r}; give {wanted}") from None

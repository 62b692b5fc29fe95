"""Which column is time, which input, which output: as told, else guessed from names and units."""

from __future__ import annotations

import difflib
import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from preisach_jax.errors import InputError
from preisach_jax.escape import printable
from preisach_jax.record.checks import check_aux_names
from preisach_jax.record.clock import is_time
from preisach_jax.record.table import Table, shortened
from preisach_jax.record.units import seconds_per, split_unit

# How surely a name or a unit tells a role. Names decide, units stand in where names are silent.
# A force is in neither list: it drives a stage and is what a damper answers with.
_SURE, _LIKELY, _BY_UNIT = 3, 2, 1

_SURE_NAMES = {
    "time": (
        "t time zeit timestamp zeitstempel seconds sekunden temps tiempo tempo tijd elapsed"
    ).split(),
    "input": (
        "u x input in voltage volt volts spannung field feld h drive command cmd excitation "
        "setpoint sollwert soll ansteuerung eingang stimulus entrée entree tension"
    ).split(),
    "output": (
        "z y output out displacement disp weg position pos auslenkung hub stroke ausgang response "
        "moment magnetization magnetisation magnetisierung m b sortie déplacement deplacement "
        "istwert ist sensor"
    ).split(),
}
_LIKELY_NAMES = {
    "time": "sec s ms clock uhrzeit datum date datetime".split(),
    "input": "v i current strom amplifier verstärker".split(),
    "output": "x d strain dehnung measured measurement messwert encoder".split(),
}
_UNITS = {
    "input": frozenset("V mV kV T mT Oe kOe A/m kA/m A mA".split()),
    "output": frozenset(
        "m mm um µm μm nm pm rad mrad urad µrad deg emu memu Am2 Am² A·m² A·m2".split()
    ),
}
_MANY, _FEW = 50, 10
"""Columns from which on, and rows below which the channels seem to be rows."""

_ROLES = ("time", "input", "output")
_OPTIONS = {"time": "--time", "input": "--input", "output": "--output"}


class QuestionError(InputError):
    """Names and units do not tell which column is which: the user has to say it."""


@dataclass(frozen=True)
class Roles:
    """Names of the columns by role; `time` is None with a sampling rate, `output` if absent."""

    time: str | None
    input: str
    output: str | None
    aux: tuple[str, ...]
    guessed: tuple[str, ...]  # the roles that were guessed


def assign_roles(
    table: Table,
    *,
    time: str | None,
    input: str | None,
    output: str | None,
    aux: Sequence[str],
    has_rate: bool,
    need_output: bool,
) -> Roles:
    """Give columns their roles: those that are told as told, the others by name and unit.

    Arguments:
        has_rate: whether a sampling rate takes the place of a time column.
        need_output: whether there must be an output; where not, it is not guessed, and a name that
            the file does not have means that the output is absent.
    """
    told = {"time": time, "input": input, "output": output}
    for role, column in table.roles.items():
        is_open = told[role] is None and column not in (*told.values(), *aux)
        if is_open and not (role == "time" and has_rate):
            told[role] = column
    if not need_output and told["output"] not in table.columns:
        told["output"] = None
    told, aux = _resolved(table, told, aux)
    check_aux_names(aux, table.source)
    used = [name for name in (*told.values(), *aux) if name is not None]
    for name in used:
        if used.count(name) > 1:
            raise InputError(
                f"{table.source}, column {name}: named for {used.count(name)} roles; give time, "
                "input, output and each auxiliary column a column of its own"
            )
    # Beside a rate, a column of time is still looked for, lest it be taken for the input.
    wanted = [r for r in _ROLES if told[r] is None and (r != "output" or need_output)]
    optional: set[str] = {"time"} if has_rate else set()
    if set(wanted) - optional:
        if not table.named:
            missing = [role for role in wanted if role not in optional]
            numbers = " ".join(f"{_OPTIONS[r]} {_ROLES.index(r) + 1}" for r in missing)
            raise QuestionError(
                f"{table.source}: the columns have no names (row {table.rows[0]} is numbers "
                "already); add a line of names such as t,u,z, or give the positions, as in "
                f"{numbers}"
            )
        told |= _guess(table, wanted, used, optional)
    guessed = [r for r in wanted if told[r] is not None and not (r == "time" and has_rate)]
    if has_rate:
        told["time"] = None
    assert told["input"] is not None
    return Roles(told["time"], told["input"], told["output"], tuple(aux), tuple(guessed))


def could_be_time(table: Table, column: str) -> bool:
    """Whether a column may be the time, by its name, its unit, or dates and times in its cells."""
    if _sureness("time", column, table) > 0:
        return True
    cells = table.columns[column]
    return cells.dtype == object and is_time(str(cells[0]))


def _resolved(
    table: Table, told: dict[str, str | None], aux: Sequence[str]
) -> tuple[dict[str, str | None], list[str]]:
    """The columns that are meant; numbers are names where there are such, unless they collide."""
    options = [*(_OPTIONS[role] for role in told), *("--aux" for _ in aux)]
    wanted = [*told.values(), *aux]
    for by_name in (True, False):
        found = [
            None if name is None else _found(table, name, option, by_name)
            for name, option in zip(wanted, options, strict=True)
        ]
        chosen = [name for name in found if name is not None]
        if len(set(chosen)) == len(chosen) or not any(name and name.isdecimal() for name in wanted):
            break
    roles = dict(zip(told, found[: len(told)], strict=True))
    return roles, [name for name in found[len(told) :] if name is not None]


def _found(table: Table, name: str, option: str, by_name: bool = True) -> str:
    """The column that is meant by a name, a number or a unit."""
    name = printable(name)  # as the table has it
    if name in table.columns and (by_name or not name.isdecimal()):
        return name
    own = [column for column in table.columns if column != table.roles.get("time")]
    ordered = own if "time" in table.roles else list(table.columns)
    if name.isdecimal() and 1 <= int(name) <= len(ordered):
        return ordered[int(name) - 1]
    alike = [column for column in table.columns if unit_of(table, column) == name]
    if len(alike) == 1:
        return alike[0]
    if alike:
        raise InputError(
            f"{table.source}: {shortened(alike)} have the unit {name!r}; say which column with "
            f"{option}"
        )
    raise _no_such_column(table, name, option)


def unit_of(table: Table, column: str) -> str:
    """The unit of a column, as the file or its name states it; `""` if neither does."""
    return table.units.get(column, split_unit(column)[1])


def _no_such_column(table: Table, name: str, option: str) -> InputError:
    if name in table.left_aside:
        return InputError(f"{table.source}, column {name}: {table.left_aside[name]}")
    folded = {column.lower(): column for column in table.columns}
    near = difflib.get_close_matches(name.lower(), folded, n=1)
    hint = f" (did you mean {folded[near[0]]}?)" if near else ""
    return InputError(
        f"{table.source}: there is no column {name!r}{hint}; the columns are {table.listing()}: "
        f"name one of them with {option}"
    )


def _guess(
    table: Table, wanted: list[str], used: list[str], optional: set[str]
) -> dict[str, str | None]:
    """The one best choice of columns for the `wanted` roles."""
    usable, refused = _usable(table, used)
    sureness = {
        role: {column: s for column in usable if (s := _sureness(role, column, table)) > 0}
        for role in wanted
    }
    # None, so that a role may stay open; more than a few equal columns are a tie in any case.
    choices = [
        [*sorted(sureness[role], key=sureness[role].__getitem__, reverse=True)[:8], None]
        for role in wanted
    ]
    totals: dict[tuple[str | None, ...], int] = {}
    for choice in itertools.product(*choices):
        chosen = [column for column in choice if column is not None]
        if len(set(chosen)) == len(chosen):
            totals[choice] = sum(
                sureness[r].get(c, 0) for r, c in zip(wanted, choice, strict=True) if c is not None
            )
    equal = [choice for choice, total in totals.items() if total == max(totals.values())]
    best = dict(zip(wanted, equal[0], strict=True))
    needed = [role for role in wanted if role not in optional]
    for role in needed:
        column = best[role]
        if column is None:
            missing = [each for each in needed if best[each] is None]
            raise QuestionError(_none_found(table, missing, refused))
        taken = set(best.values()) - {column}
        others = {dict(zip(wanted, choice, strict=True))[role] for choice in equal}
        others |= {c for c, s in sureness[role].items() if s >= sureness[role][column]} - taken
        if len(others) > 1:
            names = shortened([c for c in table.columns if c in others])
            raise QuestionError(
                f"{table.source}: {names} could each be the {role} (the columns are "
                f"{table.listing()}); say which with {_OPTIONS[role]} COL"
            )
    return best


def _usable(table: Table, used: list[str]) -> tuple[list[str], dict[str, str]]:
    """Columns that a role may be guessed for, and why others may not."""
    usable: list[str] = []
    refused: dict[str, str] = {}
    for column in table.columns:
        if column in used:
            continue
        values = table.lenient_numbers(column)
        finite = values[np.isfinite(values)] if values is not None else np.empty(0)
        if values is None:
            refused[column] = "is text"
        elif finite.size == 0:
            refused[column] = "is empty"
        elif np.all(finite == finite[0]):
            refused[column] = f"is constant ({finite[0]:g})"
        elif not re.fullmatch(r"column \d+", column):
            usable.append(column)
    return usable, refused


def why(table: Table, role: str, column: str) -> str:
    """Why a column would be taken for a role, in words."""
    if table.roles.get(role) == column:
        return "the format says so"
    if column not in table.columns:
        return ""
    sure = _sureness(role, column, table)
    if sure in (_SURE, _LIKELY):
        return "by its name"
    return f"by its unit {unit_of(table, column)}" if sure == _BY_UNIT else ""


def _sureness(role: str, column: str, table: Table) -> int:
    """How surely a column's name and unit tell `role`; 0 if they do not."""
    name, unit = split_unit(column)[0], unit_of(table, column)
    name = re.split(r"[/.]", name.strip().lower())[-1]  # `run/u` and `run.u` are u
    is_time_unit = unit != "" and seconds_per(unit) is not None
    if role != "time" and is_time_unit:
        return 0
    if role == "time" and unit and not is_time_unit:
        return 0
    words = [word for word in re.split(r"[^a-zäöüßéèà0-9]+", name) if word]
    sure, likely = _SURE_NAMES[role], _LIKELY_NAMES[role]
    if name in sure:
        return _SURE
    if name in likely or any(len(word) > 1 and word in sure for word in words):
        return _LIKELY
    if is_time_unit or unit in _UNITS.get(role, ()):
        return _BY_UNIT
    return 0


def _none_found(table: Table, roles: Sequence[str], refused: dict[str, str]) -> str:
    """The message for roles that no column's name or unit tells."""
    named_so = [
        f"{column} {why}"
        for column, why in refused.items()
        if any(_sureness(role, column, table) > 0 for role in roles)
    ]
    but = f" ({'; '.join(named_so[:5])})" if named_so else ""
    rate = ", or give the sampling rate with --rate HZ" if "time" in roles else ""
    if len(table.columns) > _MANY and table.rows.size < _FEW:
        return (
            f"{table.source}: there are {len(table.columns):,} columns and {table.rows.size} rows "
            "below their names, so the channels seem to be rows; transpose the table, so that each "
            "is a column"
        )
    options = " ".join(f"{_OPTIONS[role]} COL" for role in roles)
    return (
        f"{table.source}: no column can be guessed to be the {' or the '.join(roles)}{but}; the "
        f"columns are {table.listing()}: name {'one' if len(roles) == 1 else 'each'} with "
        f"{options}{rate}"
    )

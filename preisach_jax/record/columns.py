"""Which column is time, which input, which output: as told, else guessed, and every guess said.

Names and units are asked first; then pairs of quantities of which one drives the other; without
names the place of a column.  Where that leaves a choice it is a question, with a command to copy.
"""

from __future__ import annotations

import difflib
import itertools
import re
import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from typing import TypedDict

import numpy as np

from preisach_jax.errors import InputError
from preisach_jax.escape import printable
from preisach_jax.record.checks import check_aux_names
from preisach_jax.record.clock import is_time
from preisach_jax.record.quantities import COUNTERS, PAIRS, QUALIFIED, quantity_of
from preisach_jax.record.table import Table, shortened
from preisach_jax.record.units import seconds_per, split_unit

NO_CLOCK = "none"
"""What is said in place of a column of time where samples are counted."""

# How surely a name or a unit tells a role. Names decide, units stand in where names are silent.
# A force is in neither list: it drives a stage and is what a damper answers with.
_SURE, _LIKELY, _BY_UNIT = 3, 2, 1

_SURE_NAMES = {
    "time": (
        "t time zeit timestamp zeitstempel seconds sekunden temps tiempo tempo tijd elapsed "
        "时间 時間 время"
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

_SAME = 1e-3
"""Share of its range by which a quantity that stands twice differs from itself at most."""

_SAME_UNNAMED = 1e-5
"""The same where nothing but the numbers says that it is one quantity."""

_ROUGH = 0.5
"""Mean square of the steps over that of any two rows, above which rows do not follow each other."""

_MOST_PAIRED = 500
"""Columns among which pairs of quantities are looked for."""

_MOST_RUNS = 100
"""Records that one table is taken apart into."""

_MOST_COMPARED = 2000
"""Rows on which two columns are compared."""

_ROLES = ("time", "input", "output")
_OPTIONS = {"time": "--time", "input": "--input", "output": "--output"}


class ReadOptions(TypedDict, total=False):
    """The options of `Record.load` and its like; what is left out keeps its default.

    Attributes:
        time, input, output: columns by name, by the beginning of a name that no other has, by
            number (`"2"`) or unit (`"V"`); None to guess from names and units. The time `"none"`:
            samples are counted.
        aux: names of auxiliary columns.
        rate: sampling rate in Hz, in place of a time column.
        units: units by role (`"time"`, `"input"`, `"output"`) or column, where the columns' names
            do not state them or state them wrongly.
        initial_memory: state at the first sample; None: what the format knows, else `"free"`.
        need_output: False to load the input alone, as for a prediction: the output may then be
            absent, the input constant and the record short.
        announce: called with a sentence for everything that was guessed or assumed.
        table: which of several tables in the file, counted from 1; None: the first.
    """

    time: str | None
    input: str | None
    output: str | None
    aux: Sequence[str]
    rate: float | None
    units: Mapping[str, str] | None
    initial_memory: str | None
    need_output: bool
    announce: Callable[[str], object] | None
    table: int | None


def checked(options: ReadOptions) -> ReadOptions:
    """The options with a single auxiliary name as a list of one."""
    for name in options:
        if name not in ReadOptions.__annotations__:
            near = get_close_matches(name, ReadOptions.__annotations__, n=1)
            hint = f"did you mean {near[0]!r}?" if near else "see the help of Record.load"
            raise InputError(f"{name!r} is no option of reading a record; {hint}")
    time, rate = options.get("time"), options.get("rate")
    if time is not None and rate is not None:
        raise InputError(
            f"time is {time!r} and rate is {rate}: give a time column or a rate, not both"
        )
    aux = options.get("aux", ())
    return {**options, "aux": (aux,)} if isinstance(aux, str) else options


class QuestionError(InputError):
    """Names and units do not tell which column is which: the user has to say it.

    Attributes:
        command: one that says it, to copy; None if none is known.
    """

    def __init__(self, text: str, command: str | None = None):
        super().__init__(text if command is None else f"{text}. Say which, as in: {command}")
        self.command = command


@dataclass(frozen=True)
class Roles:
    """Names of the columns by role; `time` is None with a sampling rate or without a clock.

    Arguments:
        guessed: the roles that were guessed.
        counted: whether samples are counted, as there is neither a time nor a rate.
        said: what was made of the columns, in sentences.
    """

    time: str | None
    input: str
    output: str | None
    aux: tuple[str, ...]
    guessed: tuple[str, ...]
    counted: bool = False
    said: tuple[str, ...] = ()


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
    """Give columns their roles: those that are told as told, the others by name, unit or place.

    An output that is not needed is not guessed, and may be absent.
    """
    counted = time == NO_CLOCK and NO_CLOCK not in table.columns
    needs_no_time = has_rate or counted
    told = {"time": None if counted else time, "input": input, "output": output}
    for role, column in table.roles.items():
        is_open = told[role] is None and column not in (*told.values(), *aux)
        if is_open and not (role == "time" and needs_no_time):
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
    said: list[str] = []
    if wanted and not (needs_no_time and wanted == ["time"]):
        guess = _by_name if table.named else _by_place
        told |= guess(table, wanted, told, used, said, may_lack_time=needs_no_time)
    guessed = [r for r in wanted if told[r] is not None and not (r == "time" and needs_no_time)]
    if needs_no_time:
        told["time"] = None
    counted = told["time"] is None and not has_rate
    assert told["input"] is not None
    roles = (told["time"], told["input"], told["output"], tuple(aux), tuple(guessed))
    return Roles(*roles, counted, tuple(said))


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
    """The column that is meant by a name, a number, a unit or the beginning of a name."""
    name = printable(name)  # as the table has it
    if name in table.columns and (by_name or not name.isdecimal()):
        return name
    ordered = list(table.columns)[table.makes_time :]
    if name.isdecimal() and 1 <= int(name) <= len(ordered):
        return ordered[int(name) - 1]
    for what, alike in (
        (f"have the unit {name!r}", [c for c in table.columns if unit_of(table, c) == name]),
        (f"begin with {name!r}", [c for c in table.columns if name and c.startswith(name)]),
    ):
        if len(alike) == 1:
            return alike[0]
        if alike:
            raise InputError(
                f"{table.source}: {shortened(alike)} {what}; say which column with {option}"
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


# --- by names and units -------------------------------------------------------------------------


def _by_name(
    table: Table,
    wanted: list[str],
    told: Mapping[str, str | None],
    used: list[str],
    said: list[str],
    *,
    may_lack_time: bool,
) -> dict[str, str | None]:
    """The one best choice of columns for the `wanted` roles."""
    usable, refused = _usable(table, used)
    usable = _one_of_each(table, usable, said)
    if empty := [column for column, why in refused.items() if why == "is empty"]:
        said.append(f"{table.source}: nothing stands in {shortened(empty)}: left out")
    try:
        found = _by_roles(table, wanted, usable, refused)
    except QuestionError as question:
        times = [c for c in usable if _sureness("time", c, table) > 0 and is_clock(table, c)]
        if "time" in wanted and len(times) > 1:
            raise
        pair = _by_pairs(table, usable, told, said) or _by_channels(table, usable, told, said)
        if pair is None:
            # A constant input, or an output that is empty, is rather what is wrong.
            known = any(_sureness(role, c, table) for role in _ROLES[1:] for c in refused)
            is_open = not (known or told["input"] or told["output"] or len(table.columns) > _MANY)
            refusal = no_record(table, usable, times) if is_open else None
            if refusal is not None:
                raise InputError(f"{table.source}: {refusal}") from None
            raise question from None
        found = {role: pair.get(role) for role in wanted}
        if "time" in wanted:
            found["time"] = times[0] if times else None
    if "time" in wanted and found["time"] is None and not may_lack_time:
        said.append(_counted(table, usable, [c for c in found.values() if c]))
    return found


def _counted(table: Table, usable: list[str], taken: list[str]) -> str:
    """What is said where no column is a time."""
    others = [c for c in usable if c not in taken and rises(table.lenient_numbers(c))]
    hint = f"; {shortened(others)} rises steadily: --time NAME, if it is one" if others else ""
    return (
        f"{table.source}: no time is given: samples are counted, and only what needs no clock is "
        f"tried (with a sampling rate: --rate HZ){hint}"
    )


def _by_roles(
    table: Table, wanted: list[str], usable: list[str], refused: dict[str, str]
) -> dict[str, str | None]:
    """The one best choice by what names and units tell of roles; the time may be missing."""
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
    missing = [role for role in wanted if best[role] is None]
    if set(missing) - {"time"}:
        raise QuestionError(_none_found(table, missing, refused))
    for role in (each for each in wanted if each not in missing):
        column = best[role]
        assert column is not None
        taken = set(best.values()) - {column}
        others = {dict(zip(wanted, choice, strict=True))[role] for choice in equal}
        others |= {c for c, s in sureness[role].items() if s >= sureness[role][column]} - taken
        if len(others) > 1:
            raise _ambiguous(table, [c for c in table.columns if c in others], role)
    return best


def _ambiguous(table: Table, columns: list[str], role: str) -> QuestionError:
    return QuestionError(
        f"{table.source}: {shortened(columns)} could each be the {role} (the columns are "
        f"{table.listing()}); say which with {_OPTIONS[role]} COL"
    )


def _by_pairs(
    table: Table, usable: list[str], told: Mapping[str, str | None], said: list[str]
) -> dict[str, str] | None:
    """Input and output by the first pair of quantities that is there, once each."""
    if len(usable) > _MOST_PAIRED:
        return None
    kinds: dict[str, list[str]] = {}
    for column in usable:
        name = split_unit(column)[0]
        if _sureness("time", column, table) == 0 and not COUNTERS.search(name.lower()):
            kinds.setdefault(quantity_of(name, unit_of(table, column)), []).append(column)
    for role in ("input", "output"):  # what is told is the only one that may be it
        column = told[role]
        if column is not None:
            kind = quantity_of(split_unit(column)[0], unit_of(table, column))
            kinds = {k: c for k, c in kinds.items() if k != kind} | {kind: [column]}
    pairs: list[tuple[str, str]] = []
    for driving, answering in PAIRS:
        ins, outs = kinds.get(driving, []), kinds.get(answering, [])
        if told["input"] not in (None, *ins) or told["output"] not in (None, *outs):
            continue
        if ins and outs:
            if len(ins) > 1 or len(outs) > 1:
                if pairs:
                    break
                role, names = ("input", ins) if len(ins) > 1 else ("output", outs)
                raise _ambiguous(table, names, role)
            pairs.append((ins[0], outs[0]))
    if not pairs:
        return None
    first, *others = pairs
    others = [pair for pair in others if not set(pair) & set(first)]
    if others:
        one, other = others[0]
        command = f"--input {shlex.quote(one)} --output {shlex.quote(other)}"
        said.append(f"{table.source}: {one} and {other} are another pair: {command}")
    return {"input": first[0], "output": first[1]}


def _by_channels(
    table: Table, usable: list[str], told: Mapping[str, str | None], said: list[str]
) -> dict[str, str] | None:
    """Input and output as the two channels of an instrument, in their order, if that is all."""
    signals = [c for c in usable if not rises(table.lenient_numbers(c))]
    kinds = {_channel_kind(column) for column in signals}
    if told["input"] or told["output"] or len(signals) != 2 or len(kinds) > 1 or None in kinds:
        return None
    one, other = signals
    swapped = f"--input {shlex.quote(other)} --output {shlex.quote(one)}"
    said.append(
        f"{table.source}: channels tell no quantity: {one} is taken as the input and {other} as "
        f"the output, in their order; else {swapped}"
    )
    return {"input": one, "output": other}


_CHANNEL = re.compile(r"(ch|chan|channel|kanal|ai|ain)[ _.]?(\d{1,2}|[a-h])|\d{1,2}", re.IGNORECASE)
"""Name of a channel of an oscilloscope or converter: `CH1`, `Channel A`, `ai0`, `2`."""


def _channel_kind(column: str) -> str | None:
    """What a channel is called before its number or letter; None if the column is none."""
    match = _CHANNEL.fullmatch(split_unit(column)[0].strip())
    return (match[1] or "").lower() if match else None


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


# --- the same quantity twice --------------------------------------------------------------------


def rises(values: np.ndarray | None) -> bool:
    """Whether numbers rise from each row to the next, as a clock does."""
    if values is None or len(values) < 2:
        return False
    steps = np.diff(values)
    return bool(np.all(steps > 0) and np.isfinite(steps).all())


def is_clock(table: Table, column: str) -> bool:
    """Whether numbers rise from row to row, or stand still for less than half of the rows."""
    values = table.lenient_numbers(column)
    if values is None or not np.isfinite(values).all():
        return False
    steps = np.diff(values)
    return bool(np.all(steps >= 0) and 2 * np.count_nonzero(steps) > len(steps))


def _one_of_each(table: Table, columns: list[str], said: list[str]) -> list[str]:
    """Columns without those that are another one once more: in another unit, its least, a copy."""
    if len(columns) > _MANY:
        return columns
    kept = _one_clock(table, columns)
    for column in [c for c in kept if _sureness("time", c, table) == 0]:
        name = _bare(column)
        rivals = [c for c in kept if c != column and _is_of_one_kind(table, c, column)]
        is_qualified = bool(QUALIFIED.search(name)) and any(
            not QUALIFIED.search(_bare(c)) for c in rivals
        )
        kind = quantity_of(name, "")  # two channels in volts need not be one quantity
        earlier = [c for c in rivals if columns.index(c) < columns.index(column)]
        named = [
            c
            for c in earlier
            if _bare(c) == name or (kind and quantity_of(split_unit(c)[0], "") == kind)
        ]
        again = next((c for c in named if _is_again(table, c, column, _SAME)), None)
        if is_qualified or again is not None:
            kept.remove(column)
        if again is not None and not is_qualified:
            said.append(f"{table.source}: column {column} is {again} once more and not used")
    return kept


def _bare(column: str) -> str:
    """The name of a column without its unit, in small letters."""
    return split_unit(column)[0].lower()


def _one_clock(table: Table, columns: list[str]) -> list[str]:
    """Columns without the times that do not rise, where one does, or are one time once more."""
    times = [c for c in columns if _sureness("time", c, table) > 0]
    rising = [c for c in times if is_clock(table, c)]
    if not rising or len(times) == 1:
        return columns
    first = next((c for c in rising if unit_of(table, c) in {"s", "sec"}), rising[0])
    same = [c for c in rising if c == first or _is_again(table, first, c, _SAME)]
    # Counters and times since something else; what is no time by its name may still be a signal.
    aside = {c for c in times if c not in rising} | set(same)
    aside = {c for c in aside if c != first and _is_time_alone(table, c)}
    return [c for c in columns if c not in aside]


def _is_time_alone(table: Table, column: str) -> bool:
    return all(_sureness(role, column, table) == 0 for role in ("input", "output"))


def _is_of_one_kind(table: Table, one: str, other: str) -> bool:
    """Whether two columns are the same quantity, by names and units."""
    units = [unit_of(table, column) for column in (one, other)]
    if units[0] and units[0] == units[1]:
        return True
    kinds = [quantity_of(split_unit(c)[0], u) for c, u in zip((one, other), units, strict=True)]
    return kinds[0] != "" and kinds[0] == kinds[1]


def _is_again(table: Table, one: str, other: str, share: float) -> bool:
    """Whether a column is another one times a number, plus one, but for a share of its range."""
    pair = [table.lenient_numbers(column) for column in (one, other)]
    if pair[0] is None or pair[1] is None:
        return False
    some = np.linspace(0, len(pair[0]) - 1, min(len(pair[0]), _MOST_COMPARED)).astype(int)
    x, y = pair[0][some], pair[1][some]
    both = np.isfinite(x) & np.isfinite(y)
    if both.sum() < 3:
        return False
    with np.errstate(all="ignore"):
        x, y = x[both] - np.mean(x[both]), y[both] - np.mean(y[both])
        left: np.ndarray = y - x * (np.dot(x, y) / np.dot(x, x))
        return bool(np.sqrt(left @ left / len(left)) <= share * np.ptp(y) and np.ptp(y) > 0)


# --- without names ------------------------------------------------------------------------------


def _by_place(
    table: Table,
    wanted: list[str],
    told: Mapping[str, str | None],
    used: list[str],
    said: list[str],
    *,
    may_lack_time: bool,
) -> dict[str, str | None]:
    """Columns without names: what rises steadily is the time, then come input and output."""
    usable, _ = _usable(table, used)
    needed = [role for role in wanted if role != "time"]
    found: dict[str, str | None] = dict.fromkeys(wanted)
    clocks: list[str] = []
    if "time" in wanted and len(usable) > len(needed):
        clocks = [c for c in usable if rises(table.lenient_numbers(c))]
        found["time"] = clocks[0] if clocks else None
    signals, copies = _once(table, [c for c in usable if c not in clocks])
    if len(signals) < len(needed):
        raise InputError(
            f"{table.source}: the columns have no names (row {table.rows[0]} is numbers already), "
            f"and beside {_clock_in_words(found)} {_signals(signals)} left for "
            f"{' and '.join(needed)}; a record needs an input and an output, each a column"
        )
    if len(signals) > len(needed) or copies:
        raise _which(table, told, needed, found.get("time"), [*signals, *copies])
    found |= dict(zip(needed, signals, strict=True))
    if "time" in wanted and found["time"] is None and not may_lack_time:
        said.append(_counted(table, usable, signals))
    if aside := len(table.columns) - len(usable) - len(used):
        said.append(f"{table.source}: {aside} columns that are constant or empty were left out")
    return found


def _once(table: Table, columns: list[str]) -> tuple[list[str], list[str]]:
    """Columns without names, each once, and those that are another one once more."""
    copies = [
        c for k, c in enumerate(columns)
        if len(columns) > 2 and any(_is_again(table, o, c, _SAME_UNNAMED) for o in columns[:k])
    ]  # fmt: skip
    return [c for c in columns if c not in copies], copies


def signals_of(table: Table) -> list[str]:
    """The columns that may be input or output: of each quantity one, and no clock."""
    usable, _ = _usable(table, list(table.roles.values()))
    if not table.named:
        return _once(table, [c for c in usable if not rises(table.lenient_numbers(c))])[0]
    return [c for c in _one_of_each(table, usable, []) if _sureness("time", c, table) == 0]


def _clock_in_words(found: Mapping[str, str | None]) -> str:
    return f"column {found['time']}, which rises as a time does," if found.get("time") else "others"


def _signals(left: Sequence[str]) -> str:
    return f"only column {left[0]} is" if left else "no column is"


def _which(
    table: Table,
    told: Mapping[str, str | None],
    needed: list[str],
    time: str | None,
    offered: list[str],
) -> QuestionError:
    """The question which columns without names are input and output, with a command to copy."""
    given = {r: c for r, c in told.items() if c is not None and table.roles.get(r) != c}
    given |= {"time": time} if time is not None else {}
    given |= dict(zip(needed, offered, strict=False))
    command = " ".join(f"{_OPTIONS[r]} {given[r]}" for r in _ROLES if r in given)
    clock = "no column rises as a time does"
    if "time" in table.roles:
        clock = table.notes[0].removeprefix(f"{table.source}: ") if table.notes else "it has a time"
    elif time is not None:
        clock = f"column {time} is the time (put its unit in place of s below)"
        command += " --unit time=s"
    ordered = [c for c in table.columns if c in offered]
    return QuestionError(
        f"{table.source}: the columns have no names (row {table.rows[0]} is numbers already); "
        f"{clock}, and {shortened(ordered)} could each be the {' or the '.join(needed)}",
        f"preisach diagnose {shlex.quote(table.source)} {command}",
    )


def runs_of(table: Table, options: ReadOptions) -> list[Table]:
    """The parts of a table in each of which the time begins anew; the table itself without such."""
    if not table.named or options.get("rate") is not None:
        return [table]
    told = options.get("time") or table.roles.get("time")
    times = [c for c in table.columns if _sureness("time", c, table) >= _LIKELY]
    column = told if told in table.columns else times[0] if len(times) == 1 else None
    values = None if column is None else table.lenient_numbers(column)
    if values is None or not np.isfinite(values).all() or len(values) < 2 * _FEW:
        return [table]
    starts = [0, *(np.flatnonzero(np.diff(values) < 0) + 1).tolist()]
    ends = [*starts[1:], len(values)]
    lengths = [stop - start for start, stop in zip(starts, ends, strict=True)]
    span = max(float(np.ptp(values[a:b])) for a, b in zip(starts, ends, strict=True))
    anew = bool(np.all(np.abs(values[starts] - values[0]) <= 0.01 * span))
    if len(starts) == 1 or not anew or min(lengths) < _FEW or len(starts) > _MOST_RUNS:
        return [table]
    note = f"{table.source}: the time {column} begins anew {len(starts) - 1} times: a record each"
    return [
        replace(
            table,
            columns={name: cells[a:b] for name, cells in table.columns.items()},
            exact={name: cells[a:b] for name, cells in table.exact.items()},
            rows=table.rows[a:b],
            notes=(*table.notes, note),
        )
        for a, b in zip(starts, ends, strict=True)
    ]


def all_runs(tables: Sequence[Table], options: ReadOptions) -> list[Table]:
    """Every run of every table of a file, its dates and clock times as seconds."""
    return [run for table in tables for run in runs_of(table.with_clocks(), options)]


def numbered(tables: Sequence[Table], number: int | None) -> Table:
    """One of the tables of a file by its number, counted from 1; the first by default."""
    if number is not None and not 1 <= number <= len(tables):
        raise InputError(
            f"{tables[0].source}: table {number} is asked for, and there "
            f"{'is 1' if len(tables) == 1 else f'are {len(tables)}'}; give a number from 1 on"
        )
    return tables[(number or 1) - 1]


def several_clocks(table: Table) -> dict[str, list[str]]:
    """The signals of each clock, where there are several and every signal has one; else none.

    A clock stands before its signals where the first column is one, else behind them.  Times that
    are one time once more, or of which one has no signals, are no several clocks.
    """
    if "time" in table.roles or len(table.columns) > _MANY:
        return {}
    if table.named and sum(_sureness("time", c, table) > 0 for c in table.columns) < 2:
        return {}  # known from the names alone
    names = _usable(table, [])[0]
    if table.named:
        clocks = [c for c in names if _sureness("time", c, table) > 0 and is_clock(table, c)]
    else:
        clocks = [c for c in names if rises(table.lenient_numbers(c))]
    if len(clocks) < 2 or len(names) < len(clocks) + 2:
        return {}
    leads = names[0] in clocks
    own: dict[str, list[str]] = {clock: [] for clock in clocks}
    current = None
    for name in names if leads else reversed(names):
        if name in own:
            current = name
        elif current is None:
            return {}
        else:
            own[current].append(name)
    if not all(own.values()) or any(_is_same_clock(table, clocks[0], c) for c in clocks[1:]):
        return {}
    return {clock: each if leads else each[::-1] for clock, each in own.items()}


def _is_same_clock(table: Table, one: str, other: str) -> bool:
    """Whether a time is another one in another unit, or counted from another day."""
    first, second = (table.lenient_numbers(column) for column in (one, other))
    assert first is not None  # they are clocks
    assert second is not None
    if not _is_again(table, one, other, _SAME_UNNAMED):
        return False
    ratio = float(np.ptp(second) / np.ptp(first))
    shift = abs(float(second[0] - ratio * first[0]))
    return shift < 1e-6 * np.ptp(second) or shift > np.ptp(second)


# --- what is no record --------------------------------------------------------------------------


def no_record(table: Table, usable: Sequence[str], times: Sequence[str]) -> str | None:
    """Why a table whose columns tell no roles is no record, if that is plain; else None."""
    signals = [c for c in usable if c not in times]
    labels = [
        name for name, cells in table.columns.items()
        if cells.dtype == object and name not in usable and table.lenient_numbers(name) is None
        and len({str(cell) for cell in cells}) > 0.9 * len(cells)
    ]  # fmt: skip
    if signals and not times and (labels or len(signals) > 2):
        values = [table.lenient_numbers(c) for c in signals]
        if all(_is_rough(each) for each in values if each is not None):
            of = f", one row for each {labels[0]}" if labels else ""
            return (
                f"this is a table of results{of}, not a record: from row to row no column "
                f"({shortened(list(signals))}) goes on; give the file of the measurement, in rows "
                "of time"
            )
    if len(signals) == 1:
        beside = f"beside the time {times[0]} " if times else ""
        return (
            f"{beside}there is one signal only, {signals[0]}, and no input; a record needs what "
            "drives and what answers, each a column"
        )
    return None


def _is_rough(values: np.ndarray) -> bool:
    """Whether neighbouring rows are no more alike than any two."""
    finite = values[np.isfinite(values)]
    if finite.size < _FEW or not np.ptp(finite):
        return True
    steps: np.ndarray = np.diff(finite)
    return float(steps @ steps) / len(steps) > _ROUGH * 2 * float(np.var(finite))


def why(table: Table, role: str, column: str) -> str:
    """Why a column would be taken for a role, in words."""
    if table.roles.get(role) == column:
        return "the format says so"
    if column not in table.columns:
        return ""
    if not table.named:
        return "it rises steadily" if role == "time" else "by its place"
    sure = _sureness(role, column, table)
    if sure in (_SURE, _LIKELY):
        return "by its name"
    if role != "time" and _channel_kind(column) is not None:
        return "by the order of channels"
    if sure == _BY_UNIT:
        return f"by its unit {unit_of(table, column)}"
    kind = quantity_of(split_unit(column)[0], unit_of(table, column))
    return f"as the {kind} of a pair" if kind and role != "time" else ""


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

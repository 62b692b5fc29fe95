"""How the columns of a file, a frame or a dataset become a record: the reading options."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from difflib import get_close_matches
from typing import TypedDict

from preisach_jax.errors import InputError


class ReadOptions(TypedDict, total=False):
    """The options of `Record.load` and its like; what is left out keeps its default.

    Attributes:
        time, input, output: columns by name, number (`"2"`) or unit (`"V"`); None to guess from
            names and units.
        aux: names of auxiliary columns.
        rate: sampling rate in Hz, in place of a time column.
        units: units by role (`"time"`, `"input"`, `"output"`) or column, where the columns' names
            do not state them or state them wrongly.
        initial_memory: state at the first sample; None: what the format knows, else `"free"`.
        need_output: False to load the input alone, as for a prediction: the output may then be
            absent, the input constant and the record short.
        announce: called with a sentence for everything that was guessed or assumed.
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

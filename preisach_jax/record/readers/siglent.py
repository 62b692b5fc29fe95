"""CSV of Siglent oscilloscopes: settings name the channels, whose columns are called `Value` alike.

Format: files of SDS1104X-E and SDS1104X-U oscilloscopes, as their users show them:
`Record Length,Analog:7000` begins the settings, `Source,CH1,CH2` or the labels in
`Vertical Units,CH1:V,CH2:V` (with blanks between them in older ones) name the channels, and
`Second,Value,Value` (older: `Second,Volt,Volt`) stands above the samples.
"""

from __future__ import annotations

import re
from dataclasses import replace

from preisach_jax.errors import InputError
from preisach_jax.record.delimited import read_delimited
from preisach_jax.record.readers.base import Reader
from preisach_jax.record.table import Table
from preisach_jax.record.units import is_unit, plain_unit

_BEGIN = re.compile(r"\s*Record Length,\s*Analog:", re.IGNORECASE)
_HEAD = re.compile(r"^Second,[^\n]*", re.MULTILINE | re.IGNORECASE)
_LABELLED = re.compile(r"([^\s,:]+):[ \t]*([^\s,:]*)")
_TIME = "Second"


def is_siglent(text: str) -> bool:
    """Whether a text begins with the record length of the analog channels, as Siglent's do."""
    return bool(_BEGIN.match(text))


def read_siglent(text: str, source: str) -> Table:
    """Read the channels below the settings, by the names and units that the settings give them.

    Returns:
        The table: the time and the channels, with their units.
    """
    head = _HEAD.search(text)
    if head is None:
        raise InputError(
            f"{source}, row 1: settings of a Siglent oscilloscope begin here, and no line "
            "'Second,Value,...' stands between them and the samples; write it there, or save the "
            "waveform as CSV again"
        )
    above = text[: head.start()]
    about = dict(line.split(",", 1) for line in above.split("\n") if "," in line)
    cells = [cell.strip() for cell in head[0].rstrip(", ").split(",")[1:]]
    units = dict(_LABELLED.findall(about.get("Vertical Units", "")))
    names = _names(about, cells)
    if not units:
        units = {n: plain_unit(c) for n, c in zip(names, cells, strict=True) if is_unit(c)}
    below = ",".join([_TIME, *names]) + text[head.end() :]
    table = read_delimited(below, source, first_row=above.count("\n") + 1)
    stated = {name: unit for name, unit in units.items() if unit and name in table.columns}
    return replace(table, units={**stated, _TIME: "s"})


def _names(about: dict[str, str], cells: list[str]) -> list[str]:
    """Names of the channels: those of the first setting that has one for each column.

    Where there is none, the columns keep their own, and two of the same name are refused.
    """
    named = [[name.strip() for name in about.get("Source", "").split(",") if name.strip()]]
    named += [
        [label for label, _ in _LABELLED.findall(about.get(setting, ""))]
        for setting in ("Vertical Units", "Vertical Scale")
    ]
    return next((names for names in named if len(names) == len(cells)), cells)


SIGLENT = Reader(
    "Siglent CSV",
    is_text=is_siglent,
    read_text=read_siglent,
    note="the settings name the channels and their units",
)

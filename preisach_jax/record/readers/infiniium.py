"""CSV and TSV of Keysight Infiniium oscilloscopes, whose header makes the time.

Format: Infiniium Oscilloscopes Programmer's Reference, Keysight, "CSV and TSV Header Format":
`XInc`, `XOrg`, `XUnits` and `YUnits` have one value a channel; the samples stand below `Data:`.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from preisach_jax.record.delimited import read_delimited
from preisach_jax.record.readers.base import Reader
from preisach_jax.record.sampling import MADE_TIME
from preisach_jax.record.table import Table
from preisach_jax.record.units import plain_unit

_DATA = re.compile(r"^Data:?[^\n]*\n", re.MULTILINE | re.IGNORECASE)


def is_infiniium(text: str) -> bool:
    """Whether a text begins with such a header."""
    return text.lstrip().startswith("Revision:") and "XInc" in text


def read_infiniium(text: str, source: str) -> Table:
    """Read the channels below the header."""
    match = _DATA.search(text)
    header, body = (text[: match.start()], text[match.end() :]) if match else (text, "")
    lines = (re.split(r"[,\t]", line) for line in header.split("\n"))
    about = {first.strip(" :"): [c.strip() for c in others] for first, *others in lines}
    first = body[: max(body.find("\n"), 0)]
    separator = "\t" if "\t" in first else ","
    width = first.count(separator) + 1
    channels = len([cell for cell in about.get("XInc", []) if cell])
    has_time = width == channels + 1
    names = [f"Channel {k + 1}" for k in range(width - has_time)]
    units = [plain_unit(unit) for unit in about.get("YUnits", [])]
    head = separator.join([*(["TIME"] if has_time else []), *names])
    table = read_delimited(head + "\n" + body, source, first_row=header.count("\n") + 1)
    by_column = {name: unit for name, unit in zip(names, units, strict=False) if unit}
    if has_time:
        return replace(table, units={"TIME": "s", **by_column})
    start, step = (float((about.get(key) or ["nan"])[0]) for key in ("XOrg", "XInc"))
    times = start + np.arange(table.rows.size) * step
    return replace(
        table,
        columns={**table.columns, MADE_TIME: times},
        units={MADE_TIME: "s", **by_column},
        roles={"time": MADE_TIME},
    )


INFINIIUM = Reader(
    "Keysight Infiniium CSV",
    is_text=is_infiniium,
    read_text=read_infiniium,
    note="`XOrg` and `XInc` make the time",
)

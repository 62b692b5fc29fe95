"""CSV of Rigol oscilloscopes that count samples: start and increment stand beside the names.

Format: MSO1000Z/DS1000Z Series User's Guide, Rigol, on saving waveforms as CSV:
`X,CH1,CH2,Start,Increment,` above `Sequence,Volt,Volt,-6.0e-03,2.0e-06`; newer ones have
`Time(s),CH1(V),t0 = -1e-3, tInc = 1e-6` (MSO5000) or the same without the column of time.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from preisach_jax.record.delimited import read_delimited
from preisach_jax.record.readers.base import Reader
from preisach_jax.record.sampling import MADE_TIME
from preisach_jax.record.table import Table

_COUNTED = re.compile(r"\s*X,(?P<names>.*?),Start,Increment,*\s*\n\s*Sequence,", re.IGNORECASE)
_STATED = re.compile(
    r"\s*(?P<names>[^\n]*?),\s*t0\s*=\s*(?P<start>[^,\sa-z]*(?:e[+-]?\d+)?)\s*s?\s*,"
    r"\s*tInc\s*=\s*(?P<step>[^,\sa-z]*(?:e[+-]?\d+)?)\s*s?\s*,*\s*\n",
    re.IGNORECASE,
)


def is_rigol(text: str) -> bool:
    """Whether a text begins with start and increment, as Rigol's do."""
    return bool(_COUNTED.match(text) or _STATED.match(text))


def read_rigol(text: str, source: str) -> Table:
    """Read a CSV that counts samples; the time follows from start and increment."""
    if stated := _STATED.match(text):
        start, step = float(stated["start"]), float(stated["step"])
        names, skipped = stated["names"].split(","), 1
    else:
        head, units, _ = text.lstrip().split("\n", 2)
        names = head.rstrip(", \n").split(",")
        cells = units.split(",")
        start, step = (float(cells[names.index(name)]) for name in ("Start", "Increment"))
        names = [f"{n} ({u})" if u else n for n, u in zip(names[:-2], cells, strict=False)]
        skipped = 2
    lead = len(text) - len(text.lstrip())
    body = text[lead:].split("\n", skipped)[skipped]
    first = body[: max(body.find("\n"), 0)]
    extra = first.count(",") + 1 - len(names)
    above = text[:lead].count("\n") + skipped
    head = ",".join([*names, *[""] * extra])
    table = read_delimited(head + "\n" + body, source, first_row=above)
    if any(name.lower().startswith("time") for name in names):
        return table
    columns = {
        name: values
        for name, values in table.columns.items()
        if not name.lower().startswith(("x (", "column ")) or np.isfinite(_finite(values)).any()
    }
    columns = {name: values for name, values in columns.items() if not name.startswith("X (")}
    columns[MADE_TIME] = start + np.arange(table.rows.size) * step
    return replace(
        table, columns=columns, units={**table.units, MADE_TIME: "s"}, roles={"time": MADE_TIME}
    )


def _finite(values: np.ndarray) -> np.ndarray:
    return values if values.dtype != object else np.array([1.0])


RIGOL = Reader(
    "Rigol CSV",
    is_text=is_rigol,
    read_text=read_rigol,
    note="`Start` and `Increment`, or `t0` and `tInc`, make the time",
)

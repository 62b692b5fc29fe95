"""CSV of Tektronix oscilloscopes whose settings stand beside the samples (TDS1000, TDS2000, TBS).

Format: TDS1000 and TDS2000 Series Digital Storage Oscilloscope User Manual, Tektronix, on saving
waveforms: one channel a file, names and values of settings in the first columns, the time and the
value of each sample in the fourth and fifth.  Files of newer series have their settings above the
columns and need no reader of their own.
"""

from __future__ import annotations

import re

from preisach_jax.errors import InputError
from preisach_jax.record.delimited import read_delimited
from preisach_jax.record.readers.base import Reader
from preisach_jax.record.table import Table

_BEGIN = re.compile(r'\s*"?Record Length"?,[^\n,]*,[^\n]*,[^\n]*,[^\n]*\n"?Sample Interval"?,')


def is_tds(text: str) -> bool:
    """Whether a text begins with settings beside samples."""
    return bool(_BEGIN.match(text))


def read_tds(text: str, source: str) -> Table:
    """Read time and channel beside the settings.

    Returns:
        A table of `TIME` and the channel, with their units.
    """
    about: dict[str, str] = {}
    samples: list[str] = []
    begin = len(text) - len(text.lstrip("\n")) + 1
    for row, line in enumerate(text.strip("\n").split("\n"), start=begin):
        cells = [cell.strip().strip('"') for cell in line.split(",")]
        if len(cells) < 5:
            raise InputError(
                f"{source}, row {row}: {len(cells)} cells where time and value stand in the fourth "
                "and fifth; complete or remove the row"
            )
        if cells[0]:
            about[cells[0]] = cells[1]
        samples.append(f"{cells[3]},{cells[4]}")
    name = about.get("Source") or "CH1"
    units = ",".join(about.get(f"{axis} Units") or "-" for axis in ("Horizontal", "Vertical"))
    # Names and units stand in no rows of their own: two rows before the first sample.
    table = "\n".join([f"TIME,{name}", units, *samples, ""])
    return read_delimited(table, source, first_row=begin - 2)


TEKTRONIX = Reader(
    "Tektronix TDS CSV",
    is_text=is_tds,
    read_text=read_tds,
    note="settings beside the samples, one channel a file",
)

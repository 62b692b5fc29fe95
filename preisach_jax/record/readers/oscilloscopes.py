"""CSV of oscilloscopes whose settings make the time or name the channels.

CSV and TSV of Keysight Infiniium oscilloscopes, whose header makes the time.

Format: Infiniium Oscilloscopes Programmer's Reference, Keysight, "CSV and TSV Header Format":
`XInc`, `XOrg`, `XUnits` and `YUnits` have one value a channel; the samples stand below `Data:`.

CSV of Rigol oscilloscopes that count samples: start and increment stand beside the names.

Format: MSO1000Z/DS1000Z Series User's Guide, Rigol, on saving waveforms as CSV:
`X,CH1,CH2,Start,Increment,` above `Sequence,Volt,Volt,-6.0e-03,2.0e-06`; newer ones have
`Time(s),CH1(V),t0 = -1e-3, tInc = 1e-6` (MSO5000) or the same without the column of time.

CSV of Siglent oscilloscopes: settings name the channels, whose columns are called `Value` alike.

Format: files of SDS1104X-E and SDS1104X-U oscilloscopes, as their users show them:
`Record Length,Analog:7000` begins the settings, `Source,CH1,CH2` or the labels in
`Vertical Units,CH1:V,CH2:V` (with blanks between them in older ones) name the channels, and
`Second,Value,Value` (older: `Second,Volt,Volt`) stands above the samples.

CSV of Tektronix oscilloscopes whose settings stand beside the samples (TDS1000, TDS2000, TBS).

Format: TDS1000 and TDS2000 Series Digital Storage Oscilloscope User Manual, Tektronix, on saving
waveforms: one channel a file, names and values of settings in the first columns, the time and the
value of each sample in the fourth and fifth.  Files of newer series have their settings above the
columns and need no reader of their own.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from preisach_jax.errors import InputError
from preisach_jax.record.delimited import read_delimited
from preisach_jax.record.readers.base import Reader
from preisach_jax.record.sampling import MADE_TIME
from preisach_jax.record.table import Table
from preisach_jax.record.units import is_unit, plain_unit

_INFINIIUM_DATA = re.compile(r"^Data:?[^\n]*\n", re.MULTILINE | re.IGNORECASE)


def is_infiniium(text: str) -> bool:
    """Whether a text begins with such a header."""
    return text.lstrip().startswith("Revision:") and "XInc" in text


def read_infiniium(text: str, source: str) -> Table:
    """Read the channels below the header."""
    match = _INFINIIUM_DATA.search(text)
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


_RIGOL_COUNTED = re.compile(
    r"\s*X,(?P<names>.*?),Start,Increment,*\s*\n\s*Sequence,", re.IGNORECASE
)
_RIGOL_STATED = re.compile(
    r"\s*(?P<names>[^\n]*?),\s*t0\s*=\s*(?P<start>[^,\sa-z]*(?:e[+-]?\d+)?)\s*s?\s*,"
    r"\s*tInc\s*=\s*(?P<step>[^,\sa-z]*(?:e[+-]?\d+)?)\s*s?\s*,*\s*\n",
    re.IGNORECASE,
)


def is_rigol(text: str) -> bool:
    """Whether a text begins with start and increment, as Rigol's do."""
    return bool(_RIGOL_COUNTED.match(text) or _RIGOL_STATED.match(text))


def read_rigol(text: str, source: str) -> Table:
    """Read a CSV that counts samples; the time follows from start and increment."""
    if stated := _RIGOL_STATED.match(text):
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
        if not name.lower().startswith(("x (", "column "))
        or np.isfinite(_rigol_finite(values)).any()
    }
    columns = {name: values for name, values in columns.items() if not name.startswith("X (")}
    columns[MADE_TIME] = start + np.arange(table.rows.size) * step
    return replace(
        table, columns=columns, units={**table.units, MADE_TIME: "s"}, roles={"time": MADE_TIME}
    )


def _rigol_finite(values: np.ndarray) -> np.ndarray:
    return values if values.dtype != object else np.array([1.0])


RIGOL = Reader(
    "Rigol CSV",
    is_text=is_rigol,
    read_text=read_rigol,
    note="`Start` and `Increment`, or `t0` and `tInc`, make the time",
)


_SIGLENT_BEGIN = re.compile(r"\s*Record Length,\s*Analog:", re.IGNORECASE)
_SIGLENT_HEAD = re.compile(r"^Second,[^\n]*", re.MULTILINE | re.IGNORECASE)
_SIGLENT_LABELLED = re.compile(r"([^\s,:]+):[ \t]*([^\s,:]*)")
_SIGLENT_TIME = "Second"


def is_siglent(text: str) -> bool:
    """Whether a text begins with the record length of the analog channels, as Siglent's do."""
    return bool(_SIGLENT_BEGIN.match(text))


def read_siglent(text: str, source: str) -> Table:
    """Read the channels below the settings, by the names and units that the settings give them."""
    head = _SIGLENT_HEAD.search(text)
    if head is None:
        raise InputError(
            f"{source}, row 1: settings of a Siglent oscilloscope begin here, and no line "
            "'Second,Value,...' stands between them and the samples; write it there, or save the "
            "waveform as CSV again"
        )
    above = text[: head.start()]
    about = dict(line.split(",", 1) for line in above.split("\n") if "," in line)
    cells = [cell.strip() for cell in head[0].rstrip(", ").split(",")[1:]]
    units = dict(_SIGLENT_LABELLED.findall(about.get("Vertical Units", "")))
    names = _siglent_names(about, cells)
    if not units:
        units = {n: plain_unit(c) for n, c in zip(names, cells, strict=True) if is_unit(c)}
    below = ",".join([_SIGLENT_TIME, *names]) + text[head.end() :]
    table = read_delimited(below, source, first_row=above.count("\n") + 1)
    stated = {name: unit for name, unit in units.items() if unit and name in table.columns}
    return replace(table, units={**stated, _SIGLENT_TIME: "s"})


def _siglent_names(about: dict[str, str], cells: list[str]) -> list[str]:
    """Names of the channels: those of the first setting that has one for each column.

    Where there is none, the columns keep their own, and two of the same name are refused.
    """
    named = [[name.strip() for name in about.get("Source", "").split(",") if name.strip()]]
    named += [
        [label for label, _ in _SIGLENT_LABELLED.findall(about.get(setting, ""))]
        for setting in ("Vertical Units", "Vertical Scale")
    ]
    return next((names for names in named if len(names) == len(cells)), cells)


SIGLENT = Reader(
    "Siglent CSV",
    is_text=is_siglent,
    read_text=read_siglent,
    note="the settings name the channels and their units",
)


_TEKTRONIX_BEGIN = re.compile(
    r'\s*"?Record Length"?,[^\n,]*,[^\n]*,[^\n]*,[^\n]*\n"?Sample Interval"?,'
)


def is_tds(text: str) -> bool:
    """Whether a text begins with settings beside samples."""
    return bool(_TEKTRONIX_BEGIN.match(text))


def read_tds(text: str, source: str) -> Table:
    """Read time and channel beside the settings."""
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

"""LabVIEW measurement files, `.lvm`.

Format: Specification for the LabVIEW Measurement File (.lvm), National Instruments.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

import numpy as np

from preisach_jax.errors import InputError
from preisach_jax.record.clock import clock_seconds
from preisach_jax.record.delimited import read_delimited
from preisach_jax.record.readers.base import Reader
from preisach_jax.record.sampling import MADE_TIME, Signal, table_of_signals
from preisach_jax.record.table import Table
from preisach_jax.record.units import plain_unit

_BEGIN = "LabVIEW Measurement"
_END = "***End_of_Header***"
_SPECIAL = re.compile(r"\*\*\*Start_Special\*\*\*.*?\*\*\*End_Special\*\*\*[^\n]*", re.DOTALL)
_SEPARATORS = {"tab": "\t", "comma": ",", "semicolon": ";"}


@dataclass(frozen=True)
class _Segment:
    """A header by its lines' names, the names of the columns, the rows below, and their place."""

    header: dict[str, list[str]]
    names: list[str]
    body: str
    row: int


def is_lvm(text: str) -> bool:
    """Whether a text begins as LabVIEW measurement files do."""
    return text.lstrip().startswith(_BEGIN)


def read_lvm(text: str, source: str) -> Table:
    """Read the channels of a LabVIEW measurement file."""
    file_header = _header(text[: max(text.find(_END), 0)], None)
    word = (file_header.get("Separator") or ["Tab"])[0]
    separator = _SEPARATORS.get(word.lower(), word or "\t")
    decimal = (file_header.get("Decimal_Separator") or ["."])[0]
    segments = _segments(_SPECIAL.sub("", text), separator, source)
    kind = (file_header.get("X_Columns") or ["One"])[0].lower()
    tables = [_table(segment, kind, separator, decimal, source) for segment in segments]
    return tables[0] if len(tables) == 1 else _joined(tables, segments, source)


def _header(text: str, separator: str | None) -> dict[str, list[str]]:
    lines = (re.split(r"[\t,;]", line) if separator is None else line.split(separator)
             for line in text.split("\n"))  # fmt: skip
    cells = ([cell.strip() for cell in line] for line in lines)
    return {first: others for first, *others in cells if first}


def _segments(text: str, separator: str, source: str) -> list[_Segment]:
    begin = text.find(_END)
    ends: list[int] = []
    while (begin := text.find(_END, begin + 1)) >= 0:
        ends.append(begin)
    if not ends:
        raise InputError(
            f"{source}: the file has no second {_END}, below which the channels stand; export it "
            "again from LabVIEW, or as CSV"
        )
    found: list[_Segment] = []
    start = text.find(_END)
    for k, end in enumerate(ends):
        header = _header(text[start + len(_END) : end], separator)
        below = text.index("\n", end) + 1 if "\n" in text[end:] else len(text)
        stop = text.rfind("\nChannels", below, ends[k + 1]) if k + 1 < len(ends) else len(text)
        names, _, body = text[below:stop].partition("\n")
        row = text.count("\n", 0, below) + 2
        found.append(_Segment(header, names.strip("\n").split(separator), body.strip("\n"), row))
        start = stop - len(_END)
    return found


def _table(segment: _Segment, kind: str, separator: str, decimal: str, source: str) -> Table:
    """The table of one segment, with its column of time."""
    names = [name.strip() for name in segment.names]
    while names and names[-1] in {"", "Comment"}:
        names.pop()
    if not segment.body or len(names) < 2:
        raise InputError(
            f"{source}, row {segment.row}: no samples below the header; give a file with data"
        )
    body = segment.body
    first = body[: body.find("\n")] if "\n" in body else body
    if first.count(separator) + 1 != len(names) or "Comment" in segment.names:
        lines = (line.split(separator)[: len(names)] for line in body.split("\n"))
        body = "\n".join(separator.join([*line, *[""] * (len(names) - len(line))])
                         for line in lines)  # fmt: skip
    places = [f"{k}:{name}" for k, name in enumerate(names)]
    # An extra column that is never empty, for a row of empty cells alone would be skipped.
    table = read_delimited(separator.join(places) + "\n" + body + "\n", source)
    remedy = "correct or remove the row"
    columns = [replace(table, decimal=decimal).numbers(place, remedy) for place in places]
    rows = table.rows + segment.row - 2
    units = dict(zip(_channels(names), _values(segment, "Y_Unit_Label"), strict=False))
    units = {name: plain_unit(unit) for name, unit in units.items() if unit}
    signals = _signals(segment, names, columns, kind)
    steps = {name: signal.step_s for name, signal in signals.items()}
    is_even = len({signal.values.size for signal in signals.values()}) == 1
    if kind == "multi" or not is_even or len(set(steps.values())) > 1:
        with_units = {n: replace(s, unit=units.get(n, "")) for n, s in signals.items()}
        return table_of_signals(with_units, source)
    some = next(iter(signals.values()))
    size = some.values.size
    return Table(
        source,
        {MADE_TIME: some.clock(), **{name: signal.values for name, signal in signals.items()}},
        rows[:size],
        units={MADE_TIME: "s", **units},
        roles={"time": MADE_TIME},
        makes_time=True,
    )


def _channels(names: list[str]) -> list[str]:
    return [name for name in names if name != "X_Value"]


def _values(segment: _Segment, key: str) -> list[str]:
    return [value for value in segment.header.get(key, []) if value != ""]


def _signals(
    segment: _Segment, names: list[str], columns: list[np.ndarray], kind: str
) -> dict[str, Signal]:
    """The channels with their times: of the column before them, the only one, or the header."""
    starts = [_number(value) for value in _values(segment, "X0")]
    steps = [_number(value) for value in _values(segment, "Delta_X")]
    signals: dict[str, Signal] = {}
    times: np.ndarray | None = None
    for name, values in zip(names, columns, strict=True):
        if name == "X_Value":
            times = values if np.isfinite(values).any() else None
            continue
        k = len(signals)
        filled = np.flatnonzero(np.isfinite(values))
        size = int(filled[-1]) + 1 if filled.size else 0
        if times is not None:
            size = int(np.isfinite(times).sum()) if kind != "multi" else size
            signals[name] = Signal(values[:size], times=times[:size])
        else:
            step = steps[min(k, len(steps) - 1)] if steps else 1.0
            start = starts[min(k, len(starts) - 1)] if starts else 0.0
            signals[name] = Signal(values[:size], start, step)
    return signals


def _number(text: str) -> float:
    return float(text.replace(",", "."))


def _joined(tables: list[Table], segments: list[_Segment], source: str) -> Table:
    """Segments of the same channels, one behind the other in time."""
    names = [list(table.columns) for table in tables]
    if any(each != names[0] for each in names):
        raise InputError(
            f"{source}: its {len(tables)} segments have different channels; give each a file of "
            "its own"
        )
    clocks = [table.columns[MADE_TIME] for table in tables]
    note = f"{source}: {len(tables)} segments were put one behind the other"
    if not np.all(np.diff(np.concatenate(clocks)) > 0):
        stamps = [
            f"{(_values(s, 'Date') or [''])[0]} {(_values(s, 'Time') or [''])[0]}" for s in segments
        ]
        found = clock_seconds(np.array([re.sub(r"(\d[.,]\d{9})\d+", r"\1", s) for s in stamps],
                                       dtype=object))  # fmt: skip
        if found is not None and found[0].dtype != object:
            clocks = [c + shift for c, shift in zip(clocks, found[0], strict=True)]
    if not np.all(np.diff(np.concatenate(clocks)) > 0):
        raise InputError(
            f"{source}: its {len(tables)} segments do not follow each other in time; give each a "
            "file of its own"
        )
    columns = {name: np.concatenate([table.columns[name] for table in tables]) for name in names[0]}
    columns[MADE_TIME] = np.concatenate(clocks)
    rows = np.concatenate([table.rows for table in tables])
    return replace(tables[0], columns=columns, rows=rows, notes=(note,))


LVM = Reader(
    "LabVIEW .lvm",
    (".lvm",),
    is_text=is_lvm,
    read_text=read_lvm,
    note="time from `X_Value`, or `X0` and `Delta_X`; units from `Y_Unit_Label`; segments",
)

"""Where the table begins in what an instrument wrote, and what its settings above it say."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import islice

from preisach_jax.record.clock import is_time
from preisach_jax.record.units import is_unit, seconds_per

LONGEST_HEADER = 20_000
"""Lines in which the first row of numbers is looked for."""

_RUN = 3  # rows of numbers, one after the other, that are taken for data

_EXPONENT = r"(?:[eE][+-]?\d+)?"
_NUMBER = re.compile(rf"[+-]?(?:\d+[.,]?\d*|[.,]\d+){_EXPONENT}|[+-]?(?:nan|inf)", re.IGNORECASE)
_GROUPED = re.compile(
    r"[+-]?\d{1,3}(?P<sign>[.,'’ \u00a0\u202f])\d{3}(?:(?P=sign)\d{3})*(?:[.,]\d+)?"
)
_VALUE = re.compile(
    rf"^\s*[A-Za-z ]*?(?P<number>[+-]?(?:\d+[.,]?\d*|[.,]\d+){_EXPONENT})\s*(?P<unit>[^\s,;]*)"
)
_INTERVALS = re.compile(
    r"(?:sampl\w*|scan|x|time|horizontal|zeit)?[ _]?"
    r"(?:interval|period|increment|inc|hresolution|tinterval|tinc)"
    r"|h ?resolution|delta[ _]?[tx]|dt|dx|wf_increment|time ?step|step ?size|sample_time"
    r"|abtast(?:intervall|zeit|periode)|zeitschritt|messintervall",
    re.IGNORECASE,
)
_RATES = re.compile(
    r"(?:sampl\w*|scan|logging|acquisition|data)[ _/-]?(?:rate|frequency|freq)|fs|f_s"
    r"|samples ?(?:/|per) ?s(?:ec(?:ond)?)?|abtast(?:rate|frequenz)|messrate",
    re.IGNORECASE,
)
_PREFIX = {"": 1.0, "m": 1e-3, "k": 1e3, "K": 1e3, "M": 1e6, "G": 1e9}
_PER_SECOND = re.compile(r"(?P<prefix>[mkKMG]?)(?:Hz|S(?:a|amples)?/s(?:ec)?|sps|1/s)?")


@dataclass(frozen=True)
class Setting:
    """A line above the table: its name, its values, and the row of the file."""

    name: str
    values: tuple[str, ...]
    row: int


@dataclass(frozen=True)
class Sampling:
    """What settings say of the time between two rows: seconds, and where it stands."""

    step_s: float
    name: str
    row: int


def is_number(text: str) -> bool:
    """Whether a cell is a number, with a decimal point or comma, or in groups of thousands."""
    text = text.strip()
    return bool(_NUMBER.fullmatch(text) or _GROUPED.fullmatch(text))


def is_row_of_numbers(fields: Sequence[str]) -> bool:
    """Whether the cells of a row are numbers, times or empty, and some are numbers."""
    filled = [field for field in fields if field]
    kinds = [is_number(field) for field in filled]
    return any(kinds) and all(
        kind or is_time(field) for kind, field in zip(kinds, filled, strict=True)
    )


def header_start(rows: Iterable[Sequence[str]]) -> int | None:
    """How many rows stand above the names of a table.

    The first run of rows of numbers is the data; the row above it, or the one above a row of units,
    has the names.
    """
    rows, data = _first_data(rows)
    if data is None or data == 0:
        return data
    width = len(rows[data])
    above = [cell for cell in rows[data - 1] if cell]
    if len(above) == 1 and width > 1 and data > 1:
        return data
    if not _may_be_names(rows[data - 1], width):
        return 0
    names = data - 1
    is_units = all(is_unit(cell) for cell in above)
    if is_units and names > 0 and _is_as_wide(rows[names - 1], width):
        names -= 1
    settings = rows[:names]
    return names if any(_is_setting(row, width) for row in settings) else 0


def _first_data(rows: Iterable[Sequence[str]]) -> tuple[list[Sequence[str]], int | None]:
    """The rows that were read, and the first of a run of rows of numbers."""
    read: list[Sequence[str]] = []
    run = 0
    for row in islice(rows, LONGEST_HEADER):
        alike = run == 0 or len(row) == len(read[-1])
        is_data = len(row) > 1 and is_row_of_numbers(row)
        run = run + 1 if is_data and alike else int(is_data)
        read.append(row)
        if run == _RUN:
            return read, len(read) - _RUN
    return read, None


def _is_as_wide(row: Sequence[str], width: int) -> bool:
    """Whether a row has as many cells as the table; a last one may be empty, or too much."""
    return abs(len(row) - width) <= 1 and len([cell for cell in row if cell]) >= width - 1


def _may_be_names(row: Sequence[str], width: int) -> bool:
    return _is_as_wide(row, width) and not any(is_number(cell) for cell in row)


def _is_setting(row: Sequence[str], width: int) -> bool:
    """Whether a row is no row of a table of this width, but a name with its values."""
    if len([cell for cell in row if cell]) != width or row[0].endswith((":", "=")):
        return True
    return not is_number(row[0]) and all(re.match(r"[+-]?[.,]?\d", cell) for cell in row[1:])


def settings_of(lines: Sequence[str], delimiter: str) -> list[Setting]:
    """The settings that stand above a table, comment signs and all."""
    found: list[Setting] = []
    for row, line in enumerate(lines, start=1):
        bare = line.strip().lstrip("#%").strip()
        cells = [cell.strip().strip('"').strip() for cell in bare.split(delimiter)]
        if len([cell for cell in cells if cell]) < 2 or delimiter == " ":
            cells = [cell.strip() for cell in re.split(r"\t|:\s+|:$|\s*=\s*|;|,(?!\d)", bare)]
        values = tuple(cell for cell in cells[1:] if cell)
        if cells[0] and values:
            found.append(Setting(cells[0].rstrip(" :="), values, row))
    return found


def sampling_of(settings: Sequence[Setting]) -> Sampling | None:
    """The time between two rows, where a setting states it or the rate."""
    for setting in settings:
        bare = re.sub(r"\s*[\[(].*[\])]\s*$", "", setting.name).strip()
        in_name = re.search(r"[\[(]([^\])]*)[\])]\s*$", setting.name)
        match = _VALUE.match(setting.values[0])
        if match is None:
            continue
        unit = match["unit"] or (in_name[1] if in_name else "")
        if not unit and len(setting.values) > 1 and not is_number(setting.values[1]):
            unit = setting.values[1]
        value = float(match["number"].replace(",", "."))
        if _RATES.fullmatch(bare) and (per := _PER_SECOND.fullmatch(unit)) and value > 0:
            return Sampling(1 / (value * _PREFIX[per["prefix"]]), setting.name, setting.row)
        if _INTERVALS.fullmatch(bare) and (factors := seconds_per(unit)) and value > 0:
            return Sampling(value * factors[0] / factors[1], setting.name, setting.row)
    return None

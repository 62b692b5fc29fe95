"""Delimiter-separated text: any common delimiter, decimal sign and comment style.

clevercsv and `pandas.read_csv` find delimiters too, but neither keeps the row of the file in which
a cell stands, which every message here names, nor knows decimal commas beside them.
"""

from __future__ import annotations

import codecs
import csv
import io
import re
import warnings
from bisect import bisect_left
from collections import Counter
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any, cast

import numpy as np

from preisach_jax.errors import InputError
from preisach_jax.record.quantities import foreign_words_in, quantity_of
from preisach_jax.record.sampling import with_stated_time
from preisach_jax.record.settings import (
    LONGEST_HEADER,
    Sampling,
    header_start,
    is_number,
    sampling_of,
    settings_of,
)
from preisach_jax.record.table import GREAT, MOST_COLUMNS, Table, check_names, shortened, told_apart
from preisach_jax.record.units import is_unit, plain_unit, split_unit, units_behind_names

# In this order: where commas are decimal signs, another delimiter stands between the fields, and
# spaces may stand around any of the others.
_DELIMITERS = ("\t", ";", "|", ",", " ")
_DELIMITER_NAMES = {"\t": "tab", " ": "space"}
_COMMENTS = ("#", "%")
_SAMPLE = 200
_BEGINS_WITH_TEXT = re.compile(r"""[\s"'\[(<{*]*(?!(?i:nan|inf)\b)[^\W\d_]""")
_SETTING = re.compile(r"\s*[^\W\d_][^:=\n]*[:=]")
_MOST_TEXT = 0.5  # of the rows: more lines that begin with a text are rows with a column of texts
_MOST_BELOW = 20  # remarks below the rows of a table
_LEAST_ROWS = 10  # of a table that is a record, where there are several
_HEAD_SIGNS = 2**17
"""Signs at the beginning of a long file by which its layout is known."""

# What a number that is still being written may end in, and a whole one does not.
_CUT = re.compile(r"[+-]|[+-]?\d*[.,]|[+-]?(\d+[.,]?\d*|[.,]\d+)[eE][+-]?")


@dataclass(frozen=True)
class _Head:
    """What the lines above the data say: names, units, and where the data begin."""

    names: list[str]
    named: bool
    delimiter: str
    units: dict[str, str]
    first: int  # index of the first line of data
    notes: tuple[str, ...]
    sampling: Sampling | None


def read_delimited(text: str, source: str, first_row: int = 1) -> Table:
    """Read delimiter-separated text.

    Settings of an instrument above the names, blank lines, lines of delimiters only, and comment
    lines (`#`, `%`) are skipped; a comment that holds the names, as `numpy.savetxt` writes it, is
    understood, and so is a row of units below the names.  A last line without line end that breaks
    off, as of a file that is still written, is left out.
    """
    with _closed_marks(source):
        return _regular(text, source, first_row) or _table(text.split("\n"), source, first_row)


@contextmanager
def _closed_marks(source: str) -> Generator[None]:
    """Tell a field between quotation marks that has no end."""
    try:
        yield
    except csv.Error:
        raise InputError(
            f"{source}: a field between quotation marks has more than {csv.field_size_limit():,} "
            "characters; close the quotation mark, or remove the field"
        ) from None


def read_all(text: str, source: str, first_row: int = 1) -> list[Table]:
    """The tables of a text that are records of one kind: those of the names that most rows have."""
    with _closed_marks(source):
        regular = _regular(text, source, first_row)
        return _tables(text.split("\n"), source, first_row) if regular is None else [regular]


def _tables(lines: list[str], source: str, first_row: int) -> list[Table]:
    parts = _parts(lines)
    if len(parts) < 2:
        return [_table(lines, source, first_row)]
    ends = [*parts[1:], len(lines)]
    tables = [
        _table(lines[start:stop] + [""] * (stop < len(lines)), source, start + first_row)
        for start, stop in zip(parts, ends, strict=True)
    ]
    rows = Counter[tuple[str, ...]]()
    for table in tables:
        rows[tuple(table.columns)] += table.rows.size
    names = rows.most_common(1)[0][0]
    several = len([1 for table in tables if tuple(table.columns) == names]) > 1
    kept = [
        table for table in tables
        if tuple(table.columns) == names and not (several and table.rows.size < _LEAST_ROWS)
    ] or [max(tables, key=lambda table: table.rows.size)]  # fmt: skip
    aside = [
        f"{source}: a table of {table.rows.size:,} rows from row {table.rows[0]} on "
        f"({shortened(list(table.columns))}) was left aside: its columns are others, or too few "
        "rows stand below them"
        for table in tables if table not in kept
    ]  # fmt: skip
    return [replace(table, notes=(*table.notes, *aside)) for table in kept]


def _parts(lines: list[str]) -> list[int]:
    """The first line of each table, where names stand again below rows of numbers."""
    texts = [_BEGINS_WITH_TEXT.match(line) is not None for line in lines]
    data = [_is_data(line) and not is_text for line, is_text in zip(lines, texts, strict=True)]
    if not any(data) or sum(texts) > _MOST_TEXT * sum(data) + LONGEST_HEADER * (sum(data) > 1e5):
        return []
    parts, before, names = [0], False, ""
    first = data.index(True)
    if first:
        names = next((line for line in reversed(lines[:first]) if line.strip()), "")
    k = first
    while k < len(lines):
        if data[k]:
            before, k = True, k + 1
            continue
        begin = k
        while k < len(lines) and not data[k]:
            k += 1
        above = [line for line in lines[begin:k] if line.strip() and not _is_comment(line)]
        if not (before and above and k + 1 < len(lines) and data[k] and data[k + 1]):
            continue
        again = above[-1].strip() == names.strip()
        if again or ((len(above) > 1 or not lines[begin].strip()) and _are_names(above, lines[k])):
            parts.append(begin)
            names = above[-1]
    return parts


def _are_names(above: list[str], row: str) -> bool:
    """Whether one of the last two lines above a row has as many cells, and no number."""
    for delimiter in _DELIMITERS:
        width = len(fields_of(row, delimiter))
        for line in above[-2:] if width > 1 else []:
            fields = fields_of(line, delimiter)
            if abs(len(fields) - width) <= 1 and not any(_is_number(f) for f in fields if f):
                return True
    return False


def _regular(text: str, source: str, first_row: int) -> Table | None:
    """The table of a long file whose rows are all alike, which need not be read line by line."""
    if len(text) < 2 * _HEAD_SIGNS:
        return None
    end = text.rfind("\n", 0, _HEAD_SIGNS) + 1
    lines = text[:end].split("\n")[:-1]
    kept = [i for i, line in enumerate(lines) if _is_data(line)]
    if len(kept) < _SAMPLE:
        return None
    head = _head(lines, kept, kept, source, first_row)
    start = sum(len(line) + 1 for line in lines[: head.first])
    body, torn = text[start:], None
    if not body.endswith("\n"):
        last = body.rindex("\n", 0, body.rindex("\n"))
        if _breaks_off(body[last + 1 :].split("\n"), len(head.names), head.delimiter):
            body = body[: body.rindex("\n") + 1]
            torn = head.first + body.count("\n") + first_row
    content = body.encode()
    count = rows_alike(content, head.delimiter, len(head.names))
    if count is None:
        return None
    sample = body[: body.find("\n", _HEAD_SIGNS) + 1 or None].split("\n")
    decimal = decimal_sign(sample, head.delimiter)
    if head.delimiter != "," and "," in body and (decimal != "," or "." in body):
        return None
    try:
        columns, exact = _parse(content, count, head.names, head.delimiter, decimal, source)
    except InputError:  # read line by line, it is said where
        return None
    if _is_irregular(columns):
        return None
    rows = np.arange(count) + head.first + first_row
    return _with_head(head, source, columns, rows, decimal, exact, torn)


def _is_irregular(columns: Mapping[str, np.ndarray]) -> bool:
    """Whether a row has no entry at all, or numbers are mixed with texts, such as `1'234`."""
    import pandas as pd

    texts = [values for values in columns.values() if values.dtype == object]
    if any(is_number(str(values[0])) for values in texts):
        return True
    return bool(np.logical_and.reduce([pd.isna(values) for values in columns.values()]).any())


def _table(lines: list[str], source: str, first_row: int) -> Table:
    kept = [i for i, line in enumerate(lines) if _is_data(line)]
    if not kept:
        raise InputError(f"{source}: the file holds no data; give a file with a line of names")
    if len(kept) > 1 and all(_SETTING.match(lines[i]) for i in kept):
        raise InputError(
            f"{source}: the file holds settings only ({lines[kept[0]].strip()[:60]}, ...) and no "
            "rows of numbers; give the file with the samples"
        )
    is_open = kept[-1] == len(lines) - 1  # the last row has no line end, and may break off
    whole = kept[:-1] if is_open and len(kept) > 1 else kept
    head = _head(lines, kept, whole, source, first_row)
    kept = kept[bisect_left(kept, head.first) :]
    header, delimiter = head.names, head.delimiter
    below: list[int] = []
    while len(kept) > 1 and len(below) < _MOST_BELOW and _is_remark(lines[kept[-1]], head):
        below.insert(0, kept.pop())
    if below:
        is_open = False
        said = (
            f"{source}: row {below[0] + first_row} on ({lines[below[0]].strip()[:60]}), below the "
        )
        head = replace(head, notes=(*head.notes, f"{said}rows of numbers, was left out"))
    torn_row = None
    if is_open and kept and _breaks_off([lines[i] for i in kept[-2:]], len(header), delimiter):
        torn_row = kept.pop() + first_row
    if not kept:
        raise InputError(
            f"{source}: there is no row below the names {shortened(header)}; give a file with data"
        )
    rows = np.array(kept) + first_row
    body = [lines[i] for i in kept]
    width = _check_widths(body, rows, header, delimiter, source)
    if width > len(header):
        header = [*header, f"column {width}"]
    body, assumed = without_groups(body, rows, delimiter, source)
    if assumed:
        head = replace(head, notes=(*head.notes, assumed))
    decimal = decimal_sign(body, delimiter)
    content = "\n".join(body).encode()
    columns, exact = _parse(content, len(body), header, delimiter, decimal, source)
    return _with_head(head, source, columns, rows, decimal, exact, torn_row)


def _is_remark(line: str, head: _Head) -> bool:
    """Whether a line is no row of the table: it begins with a text and is not as wide."""
    is_text = _BEGINS_WITH_TEXT.match(line) is not None
    return is_text and abs(width_of(line, head.delimiter) - len(head.names)) > 1


def _with_head(
    head: _Head,
    source: str,
    columns: Mapping[str, np.ndarray],
    rows: np.ndarray,
    decimal: str,
    exact: Mapping[str, np.ndarray],
    torn_row: int | None,
) -> Table:
    table = Table(
        source,
        columns,
        rows,
        named=head.named,
        decimal=decimal,
        units=head.units,
        notes=head.notes,
        exact=exact,
        torn_row=torn_row,
    )
    return with_stated_time(table, head.sampling)


def _head(lines: list[str], kept: list[int], sure: list[int], source: str, first_row: int) -> _Head:
    """Names, units and settings; `sure` are the kept lines that are known to be whole."""
    _check_width(lines[kept[0]], f"{source}, row {kept[0] + first_row}")
    delimiter, start = _sniff([lines[i] for i in sure[:_SAMPLE]])
    above = _settings(lines, sure)
    if above is not None:
        delimiter, start = above
    place = f"{source}, row {kept[start] + first_row}"
    header, named, first, notes = _header(lines, kept, start, delimiter, place)
    if named and start:
        notes = (f"{source}: {start} line(s) before the names were skipped", *notes)
    if named and _is_second_names(lines, kept[first : first + 3], delimiter, len(header)):
        other = fields_of(lines[kept[first]], delimiter)
        row = kept[first]
        if _told(other) > _told(header):
            place = f"{source}, row {kept[first] + first_row}"
            (header, again), row = told_apart(other, place), kept[start]
            notes += again
        notes += (f"{source}: row {row + first_row}, names once more ({lines[row][:60]}), skipped",)
        first += 1
    units: dict[str, str] = {}
    if named and first < len(kept):
        below = fields_of(lines[kept[first]], delimiter)
        if len(below) == len(header) and any(below) and all(is_unit(f) for f in below if f):
            units = {
                name: plain_unit(unit)
                for name, unit in zip(header, below, strict=True)
                if unit not in {"", "-"}
            }
            first += 1
            if other := [
                n for n, u in units.items() if plain_unit(split_unit(n)[1]) not in ("", u)
            ]:
                notes += (
                    f"{source}: the row of units says {units[other[0]]} where a name says "
                    f"{split_unit(other[0])[1]} ({other[0]}): those of the row were taken",
                )
    if named and not units:
        units = units_behind_names(header)
    begin = kept[first] if first < len(kept) else kept[-1] + 1
    sampling = sampling_of(settings_of(lines[: kept[start]], delimiter))
    return _Head(header, named, delimiter, units, begin, notes, sampling)


def _told(names: Sequence[str]) -> int:
    """How many names tell a quantity, by a word or a unit."""
    return sum(bool(quantity_of(*split_unit(name))) for name in names)


def _is_second_names(lines: list[str], rows: list[int], delimiter: str, width: int) -> bool:
    """Whether a row below the names holds others, as wide, above units or numbers."""
    fields = [fields_of(lines[i], delimiter) for i in rows]
    if len(fields) < 2 or len(fields[0]) != width or width < 2:
        return False
    is_text = all(f and not is_number(f) for f in fields[0]) and not all(map(is_unit, fields[0]))
    data = fields[2] if len(fields) > 2 and all(map(is_unit, fields[1])) else fields[1]
    return is_text and _is_all_numbers(data)


def _check_width(line: str, place: str) -> None:
    """Refuse a million columns before anything is made of them."""
    most = max(line.count(delimiter) + 1 for delimiter in _DELIMITERS if delimiter != " ")
    if most > 4 * MOST_COLUMNS:
        check_names([""] * most, place)


def _settings(lines: list[str], kept: list[int]) -> tuple[str, int] | None:
    """The delimiter, and how many lines of settings stand above the names, if there are any."""
    for delimiter in _DELIMITERS:
        if not any(delimiter in lines[i] for i in kept):
            continue  # of a single column nothing is told, and a long file need not be split
        start = header_start(fields_of(lines[i], delimiter) for i in kept)
        if start is not None:
            return (delimiter, start) if start else None
    return None


def _breaks_off(end: list[str], width: int, delimiter: str) -> bool:
    """Whether the last line has fewer fields than the one above it, or ends within a number."""
    *above, last = end
    if width_of(last, delimiter) < (width_of(above[0], delimiter) if above else width):
        return True
    # Some programs write 4. for 4: then the line above does not end otherwise.
    is_cut = [bool(_CUT.fullmatch(fields_of(line, delimiter)[-1])) for line in end]
    return last.count('"') % 2 == 1 or (is_cut[-1] and not any(is_cut[:-1]))


def _is_data(line: str) -> bool:
    return bool(line.replace('""', "").strip(" \t,;|")) and not _is_comment(line)


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith(_COMMENTS)


def _is_number(field: str) -> bool:
    try:
        float(field.replace(",", "."))
    except ValueError:
        return False
    return True


def _is_all_numbers(fields: Sequence[str]) -> bool:
    filled = [field for field in fields if field]
    return bool(filled) and all(_is_number(field) for field in filled)


def _sniff(sample: list[str]) -> tuple[str, int]:
    """The delimiter, and how many lines before the names belong to neither names nor data."""
    for delimiter in _DELIMITERS:
        widths = {len(fields_of(line, delimiter)) for line in sample}
        if len(widths) == 1 and widths.pop() > 1:
            return delimiter, 0
    # Not every line agrees: lines before the names, a row that breaks off, or a single column.
    if len(sample) > 1 and all(_is_number(line.strip()) for line in sample[1:]):
        return "\t", 0
    best, best_share, best_start = "\t", 0.0, 0
    for delimiter in _DELIMITERS:
        widths = [len(fields_of(line, delimiter)) for line in sample]
        usual, _ = Counter(widths[len(widths) // 2 :]).most_common(1)[0]
        if usual == 1:
            continue
        start = widths.index(usual)
        alike: np.ndarray = np.array(widths[start:]) == usual
        share = float(np.mean(alike)) * (1 - start / len(widths))
        if share > best_share + 0.02:
            best, best_share, best_start = delimiter, share, start
    # Rows that break off, or end in a delimiter, do not move the names.
    is_header = best_start == 1 and not _is_all_numbers(fields_of(sample[0], best))
    if is_header and _is_all_numbers(fields_of(sample[1], best)):
        best_start = 0
    return best, best_start


def _header(
    lines: list[str], kept: list[int], start: int, delimiter: str, place: str
) -> tuple[list[str], bool, int, tuple[str, ...]]:
    """Names, whether the file gives them, how many kept lines stand before the data, and notes."""
    fields = fields_of(lines[kept[start]], delimiter)
    named, first = True, start + 1
    commented = _commented_names(lines[: kept[start]], delimiter, len(fields))
    # Rows of numbers may hold a column of texts.
    if _is_all_numbers(fields) or (commented and any(map(_is_number, fields))):
        first = start
        named = commented is not None
        fields = commented or [str(i + 1) for i in range(len(fields))]
    given = [name or f"column {i + 1}" for i, name in enumerate(fields)]
    names, notes = told_apart(given, place)
    return names, named, first, notes


def _commented_names(before: list[str], delimiter: str, width: int) -> list[str] | None:
    """Names in the last comment line that has as many as there are columns, if any."""
    for line in reversed(before):
        fields = fields_of(line.strip().lstrip("".join(_COMMENTS)).strip(), delimiter)
        if len(fields) == width and all(fields) and not any(_is_number(f) for f in fields):
            return fields
    return None


def _check_widths(
    body: list[str], rows: np.ndarray, header: list[str], delimiter: str, source: str
) -> int:
    """The number of fields in every row: that of the names, or one more that is always empty."""
    widths = np.array([width_of(line, delimiter) for line in body])
    expected = len(header)
    if (
        delimiter != " "
        and np.all(widths == expected + 1)
        and all(line.rstrip(" ").endswith(delimiter) for line in body)
    ):
        return expected + 1
    wrong = np.flatnonzero(widths != expected)
    if wrong.size:
        k = wrong[0]
        hint = ""
        if delimiter == "," and widths[k] > expected:
            hint = ", and where commas are decimal signs separate the columns by ; or tabs"
        raise InputError(
            f"{source}, row {rows[k]}: {widths[k]} field(s) where the names are {expected} "
            f"(delimiter {_DELIMITER_NAMES.get(delimiter, delimiter)}, row begins "
            f"{body[k][:40]!r}); complete or remove the row{hint}"
        )
    return expected


def _parse(
    content: bytes, count: int, header: list[str], delimiter: str, decimal: str, source: str
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """The columns, float64 where every cell is a number or empty, else objects; and great ones
    once more, exactly."""
    import pandas as pd

    options: dict[str, Any] = {
        "sep": r"\s+" if delimiter == " " else delimiter,
        "header": None,
        "names": range(len(header)),
        "index_col": False,
        "skipinitialspace": True,
        "low_memory": False,
    }
    try:
        with warnings.catch_warnings():
            # It means that cells are dropped.
            warnings.simplefilter("error", pd.errors.ParserWarning)
            frame = cast(pd.DataFrame, pd.read_csv(io.BytesIO(content), decimal=decimal, **options))
    except (pd.errors.ParserError, pd.errors.ParserWarning):
        frame = None
    # Every line has as many fields as there are names, so only quotation marks can join lines.
    if frame is None or len(frame) != count:
        raise InputError(
            f'{source}: a quotation mark (") is not closed in its row; close or remove it'
        )
    columns: dict[str, np.ndarray] = {}
    exact: dict[str, np.ndarray] = {}
    for i, name in enumerate(header):
        column = cast(pd.Series, frame[i])
        is_numeric = column.dtype.kind in "iuf"
        columns[name] = column.to_numpy(np.float64 if is_numeric else object)
        if is_numeric and len(column) and abs(columns[name][0]) >= GREAT:
            if column.dtype.kind == "f":
                as_text = cast(
                    pd.DataFrame,
                    pd.read_csv(io.BytesIO(content), usecols=[i], dtype=str, **options),
                )
                column = cast(pd.Series, as_text[i])
            exact[name] = column.to_numpy(np.int64 if column.dtype.kind in "iu" else object)
    return columns, exact


# --- cells ----------------------------------------------------------------------------------------

# A unit in brackets belongs to the name before it: `Weg [µm]` is one name, not two.
_SPACES = re.compile(r"\s+(?![\[(])")
_EXPONENT = r"(?:[eE][+-]?\d+)?"
_WITH_COMMA = re.compile(rf"[+-]?\d*,\d+{_EXPONENT}")
_WITH_POINT = re.compile(rf"[+-]?\d*\.\d+{_EXPONENT}")
_GROUPED = re.compile(
    r"[+-]?\d{1,3}(?P<sign>[.,'’ \u00a0\u202f])\d{3}(?:(?P=sign)\d{3})*(?P<decimals>[.,]\d+)?"
)
_SIGNS = ",.'’ \u00a0\u202f"
_LOOKED_AT = 1000  # rows by which decimal signs and groups are known


def fields_of(line: str, delimiter: str) -> list[str]:
    """The fields of one line, without the white space and quotation marks around them."""
    if delimiter == " ":
        fields = _SPACES.split(line.strip())
    elif '"' in line:
        fields = next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))
    else:
        fields = line.split(delimiter)
    return [field.strip().strip('"') for field in fields]


def width_of(line: str, delimiter: str) -> int:
    """How many fields a line has."""
    if '"' in line:
        return len(fields_of(line, delimiter))
    return len(line.split()) if delimiter == " " else line.count(delimiter) + 1


def decimal_sign(body: Sequence[str], delimiter: str) -> str:
    """`,` where numbers are written with it and none with a point, else `.`."""
    with_comma = islice((line for line in body if "," in line), _LOOKED_AT)
    fields = [field for line in with_comma for field in fields_of(line, delimiter)]
    if not any(_WITH_COMMA.fullmatch(field) for field in fields):
        return "."
    with_point = islice((line for line in body if "." in line), _LOOKED_AT)
    fields = [field for line in with_point for field in fields_of(line, delimiter)]
    return "." if any(_WITH_POINT.fullmatch(field) for field in fields) else ","


def without_groups(
    body: list[str], rows: np.ndarray, delimiter: str, source: str
) -> tuple[list[str], str]:
    """Rows whose numbers have no signs between groups of thousands.

    A sign is taken for one of thousands where it cannot be a decimal sign: it stands twice in a
    number, before another sign, or is none of `.` and `,`.
    """
    sign = _thousands_sign(body, delimiter)
    if sign is None:
        return body, ""
    plain: list[str] = []
    for row, line in zip(rows, body, strict=True):
        if sign not in line:
            plain.append(line)
            continue
        fields = fields_of(line, delimiter)
        for k, field in enumerate(fields):
            if sign not in field or not re.fullmatch(r"[+-]?[\d.,'’ \u00a0\u202f]+", field):
                continue
            match = _GROUPED.fullmatch(field)
            if match is None or match["sign"] != sign:
                raise InputError(
                    f"{source}, row {row}: {field!r} is no number where {sign!r} stands between "
                    "groups of thousands; write the numbers without such signs"
                )
            fields[k] = field.replace(sign, "")
        quoted = ('"' + f + '"' if delimiter in f else f for f in fields)
        plain.append(delimiter.join(quoted))
    return plain, f"{source}: {sign!r} was read as the sign between groups of thousands"


def _thousands_sign(body: Sequence[str], delimiter: str) -> str | None:
    """The sign between groups of thousands, where some number proves it."""
    signs = [sign for sign in _SIGNS if sign != delimiter or any('"' in line for line in body[:1])]
    if not any(sign in line for line in body[:_LOOKED_AT] for sign in signs):
        return None
    grouped: dict[str, bool] = {}
    looked_at = islice((line for line in body if _has_group(line)), _LOOKED_AT)
    fields = [field for line in looked_at for field in fields_of(line, delimiter)]
    for field in fields:
        if match := _GROUPED.fullmatch(field):
            sign, decimals = match["sign"], match["decimals"] or ""
            is_proof = sign not in ".," or field.count(sign) > 1 or bool(decimals)
            grouped[sign] = grouped.get(sign, False) or is_proof
    proven = [sign for sign, is_proof in grouped.items() if is_proof]
    if proven:
        return proven[0]
    # "1,234" in a file that has decimal points elsewhere, and no other kind of comma.
    commas = [field for field in fields if "," in field and _WITH_COMMA.fullmatch(field)]
    points = any(_WITH_POINT.fullmatch(field) for field in fields)
    is_grouped = all(_GROUPED.fullmatch(field) for field in commas)
    return "," if delimiter == "," and commas and points and is_grouped else None


_GROUP = re.compile(r"\d[.,'’ \u00a0\u202f]\d{3}(?!\d)")


def _has_group(line: str) -> bool:
    return _GROUP.search(line) is not None


def rows_alike(body: bytes, delimiter: str, width: int) -> int | None:
    """How many rows there are, where all are plain rows of so many fields; else None.

    Plain means that nothing has to be read line by line: no quotation marks, comments, blank lines
    or lines of delimiters only, one delimiter between two fields, and ASCII alone.
    """
    if width < 2 or not body.isascii() or any(sign in body for sign in (b'"', b"#", b"%", b"\r")):
        return None
    signs = np.frombuffer(body, np.uint8)
    ends = np.flatnonzero((signs == ord(delimiter)) | (signs == ord("\n")))
    kinds = signs[ends]
    if signs[-1] != ord("\n"):
        ends, kinds = np.append(ends, len(signs)), np.append(kinds, ord("\n"))
    if len(ends) % width:
        return None
    kinds = kinds.reshape(-1, width)
    if np.any(kinds[:, :-1] != ord(delimiter)) or np.any(kinds[:, -1] != ord("\n")):
        return None
    # Blanks may stand at either end of a row and in twos, and then delimit nothing.
    if delimiter == " " and (np.any(np.diff(ends) == 1) or ends[0] == 0):
        return None
    return len(kinds)


# --- bytes ----------------------------------------------------------------------------------------

HEAD_BYTES = 65536
"""Bytes at the beginning of a file by which it is known whether it is text."""

_KINDS = {
    b"\x89PNG": "it is a PNG picture",
    b"\xff\xd8\xff": "it is a JPEG picture",
    b"%PDF": "it is a PDF document",
    b"\x7fELF": "it is a program",
    b"\x1f\x8b": "it is compressed by gzip twice: unpack it",
    b"PK\x03\x04": "it is a ZIP archive within another: unpack it",
}
# Signs that no text holds: tabs, line and page ends, the end mark of DOS and escapes are left out.
_CONTROLS = bytes(set(range(32)) - set(b"\t\n\v\f\r\x1a\x1b"))
_SHARE = 0.01  # of such signs that a text may hold, as some loggers write a few


_CODE_PAGES = (
    ("cp1252", "Windows-1252"),
    ("gb18030", "GB 18030"),
    ("cp932", "Shift-JIS"),
    ("cp1251", "Windows-1251"),
)
"""Where no word is known, the first."""


def check_text(head: bytes, source: str) -> None:
    """Refuse a file that is not text, by its beginning."""
    if not is_text(head):
        kind = next((kind for magic, kind in _KINDS.items() if head.startswith(magic)), "")
        is_kind = f" ({kind})" if kind else ""
        raise InputError(
            f"{source}: the file is binary, not text{is_kind}; give a CSV, workbook, NPZ, MAT, "
            "HDF5, TDMS, Parquet, Feather or MicroMag (.forc) file"
        )


def is_text(head: bytes) -> bool:
    """Whether a file is text, by its beginning of up to `HEAD_BYTES` bytes."""
    if _encoding(head) is not None:
        return True
    controls = sum(head.count(bytes([code])) for code in _CONTROLS)
    is_known = head.startswith(tuple(_KINDS))
    return not (is_known or b"\0" in head or controls > _SHARE * len(head))


def decode(content: bytes) -> tuple[str, str]:
    """The text of a file with `\\n` as line end, and what was assumed of its encoding."""
    assumed = ""
    encoding = _encoding(content[:HEAD_BYTES])
    if encoding is not None:
        text = content.decode(encoding, errors="replace").removeprefix("\ufeff")
    else:
        try:
            text = content.decode("utf-8-sig")
        except UnicodeDecodeError:
            encoding, name = _code_page(content[:HEAD_BYTES])
            assumed = f"it is not in UTF-8 and was read as {name}"
            text = content.decode(encoding, errors="replace")
    return text.replace("\r\n", "\n").replace("\r", "\n"), assumed


def _code_page(head: bytes) -> tuple[str, str]:
    """Encoding and name of a code page, by the words of quantities that it makes of a text."""
    found = {
        page: foreign_words_in(head.decode(page[0], errors="ignore").lower())
        for page in _CODE_PAGES
    }
    return max(_CODE_PAGES, key=lambda page: found[page])


def _encoding(head: bytes) -> str | None:
    """UTF-16 by its mark, or by every second byte that is zero; None for anything else."""
    if head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    even, odd = head[::2], head[1::2]
    if len(head) >= 8:
        for name, zeros, others in (("utf-16-le", odd, even), ("utf-16-be", even, odd)):
            if zeros.count(0) > 0.8 * len(zeros) and 0 not in others:
                return name
    return None

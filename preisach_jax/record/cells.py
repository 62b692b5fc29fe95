"""The cells of lines of text: fields, decimal signs, groups of thousands, rows that are alike."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from itertools import islice

import numpy as np

from preisach_jax.errors import InputError

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

    Returns:
        The rows, and what was assumed, `""` if nothing.
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

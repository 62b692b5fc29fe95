"""Names and units from files, made harmless for where they go: one function a destination.

XML and HTML are escaped by their templates, CSV by Python's writer; both get `printable` names.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Collection

UNSEEN = "\N{REPLACEMENT CHARACTER}"

_ACTING = {"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"}
_JOINERS = "\N{ZERO WIDTH NON-JOINER}\N{ZERO WIDTH JOINER}"


def printable(text: str) -> str:
    """A text for a terminal or a table, without characters that act and are not seen.

    Control characters, marks of direction and line separators become a replacement character.
    """
    return "".join(
        c if c in _JOINERS or unicodedata.category(c) not in _ACTING else UNSEEN for c in text
    )


def printable_lines(text: str) -> str:
    """The same line by line."""
    return "\n".join(map(printable, text.split("\n")))


def unit(text: str) -> str:
    """A unit of letters, digits and the signs that units are written with; others become a mark."""
    return "".join(
        c if c.isalnum() or c in " €£¥_%‰°′″'\"·⋅*×/^()[]{}.+-−|:&#²³⁻" else UNSEEN for c in text
    )


def distinct(name: str, others: Collection[str]) -> str:
    """A name that none of some others is, with a number behind it where it must differ."""
    number = 2
    found = name
    while found in others:
        found, number = f"{name} ({number})", number + 1
    return found


def c_comment(text: str) -> str:
    """A text inside a comment of C, which it neither ends nor begins."""
    return re.sub(r"[^A-Za-z0-9 .,:()=<>+%/^_-]", "_", text.replace("µ", "u"))


def markdown(text: str) -> str:
    """A text in a line or a cell of Markdown, of which it begins and ends no part."""
    text = printable(text).replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
    return re.sub(r"([\\`*_{}\[\]()#!|~])", r"\\\1", text)


def literal(text: str) -> str:
    """A text of a figure, in which a dollar sign starts no formula of Matplotlib."""
    return printable_lines(text).replace("$", r"\$")

"""What a reader is, and what all of them need: limits, libraries, one line for a failure."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from preisach_jax.errors import InputError
from preisach_jax.record.table import Table

EXTRA = "files"
"""The extra of this package that holds the libraries of all readers."""

MOST_VALUES = 2**22
"""Values that any file may hold, however small it is."""

MOST_VALUES_A_BYTE = 12
"""Values a byte that a greater file may hold: one of float64 that is compressed a hundredfold."""


@dataclass(frozen=True)
class Reader:
    """A format: how its files are known, and what reads them.

    Arguments:
        is_text: for formats of text that no ending tells: whether a text is one, by its beginning;
            then `read_text` reads it.
        foreign: whether a library reads it that is not of Python, and may end its process.
    """

    name: str
    suffixes: tuple[str, ...] = ()
    starts: tuple[bytes, ...] = ()
    read: Callable[[Path, str], Table | list[Table]] | None = None
    is_text: Callable[[str], bool] | None = None
    read_text: Callable[[str, str], Table] | None = None
    note: str = ""
    foreign: bool = False


def library(module: str, package: str, kind: str, source: str) -> Any:
    """A library that one reader needs."""
    try:
        import_module(module.split(".", maxsplit=1)[0])
        return import_module(module)
    except ImportError:
        raise InputError(
            f"{source}: {kind} need the package {package}; install it with "
            f"pip install 'preisach_jax[{EXTRA}]', or give the record as CSV"
        ) from None


def most_values(size: int) -> int:
    """Values that a file of so many bytes may unpack to."""
    return max(MOST_VALUES, MOST_VALUES_A_BYTE * size)


def check_unpacked(values: float, size: int, source: str, remedy: str) -> None:
    """Refuse before it is unpacked what unpacks to far more than records do."""
    if values > most_values(size):
        raise too_much(values, size, source, remedy)


def too_much(values: float, size: int, source: str, remedy: str) -> InputError:
    """The refusal of a file that unpacks to far more than records do."""
    return InputError(
        f"{source}: its {size:,} bytes unpack to {values:.3g} values or more, and no record is "
        f"compressed so far; if they are right, save it without compression, by {remedy}"
    )


def not_readable(kind: str, error: Exception, source: str, remedy: str) -> InputError:
    """The refusal of a broken file: its kind, what the library says in a line, and a remedy."""
    said = str(error) or type(error).__name__
    brief = said if len(said) <= 200 else f"{said[:200]}..."
    return InputError(f"{source}: not a readable {kind} file ({brief}); {remedy}")

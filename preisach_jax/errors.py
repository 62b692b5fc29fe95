"""The errors of this package: what was given cannot be used, and here is how to mend it.

`InputError` is the base of all that a user sees: `QuestionError` (record.columns), `EffectError`,
`NotFiniteError`.  `PrecisionWarning` is the one warning.  `ContentError` never leaves the package.
And the checks of single numbers that all modules share.
"""

from __future__ import annotations

import math
import operator
from typing import Any


class InputError(ValueError):
    """A mistake in what the user gave: a file, a column, an option, an argument.

    The message is one line. It names the value received, where it was found (file, column, row)
    and the remedy. The command line prints it and exits with code 2, without a traceback.

    Arguments:
        message: the message; runs of white space, line breaks included, become single spaces.

    Example:
        >>> raise InputError("levels is 0: give a whole number of at least 2")
        Traceback (most recent call last):
        ...
        preisach_jax.errors.InputError: levels is 0: give a whole number of at least 2
    """

    def __init__(self, message: str):
        # Values quoted from a file may hold line breaks, and the command line promises one line.
        super().__init__(" ".join(str(message).split()))


class EffectError(InputError):
    """An effect's class that is unfinished, or returns something else than its place asks for."""


class NotFiniteError(InputError, FloatingPointError):
    """A model that gives NaN or infinity at parameters within their bounds.

    A search passes over such parameters; it reaches the user only of a model with chosen effects.
    """


class PrecisionWarning(UserWarning):
    """Measured values in double precision that JAX, in single, rounds by more than they can spare.

    It is given once in a process for the input and once for the output of the filters and of
    `simulate`: where the rounding is above a twentieth of the usual step from sample to sample.
    """


class ContentError(ValueError):
    """What is wrong inside a file, without its name.

    Whoever opened the file catches it and raises an `InputError` with the path and the remedy.
    """


def require_positive(**values: float) -> None:
    """Refuse numbers that are not above 0, NaN among them."""
    for name, value in values.items():
        if not value > 0.0:
            raise InputError(f"{name} is {value!r}: give a number above 0")


def unfinished(effect: Any, method: str) -> EffectError:
    """The error that says which method of an effect's class is missing."""
    return EffectError(
        f"{type(effect).__name__}, the class of the effect {effect.name!r}, lacks a method of its "
        f"place: write {method}"
    )


def require_no_record(name: str, values: Any) -> None:
    """Refuse a record where one of its columns is asked for."""
    if all(hasattr(values, column) for column in ("time", "input", "output")):
        raise InputError(
            f"{name} is a whole {type(values).__name__}: give the columns that are asked for, as "
            "record.time, record.input and record.output"
        )


def shown(value: Any) -> str:
    """A value for a message, in at most 60 characters."""
    if isinstance(value, int) and abs(value) >= 10**30:  # Python refuses to print 4,301 digits
        return "a number of more than 30 digits"
    return f"{value!r:.60}"


def require_list(what: str, given: Any) -> None:
    """Refuse one text, of which the letters would be taken, where a list of names is asked for."""
    if isinstance(given, str):
        raise InputError(f"{what} is {shown(given)}: give a list of names, as in [{shown(given)}]")


def whole_number(what: str, value: Any, least: int, most: float = math.inf) -> int:
    """A whole number as Python's own, or an error that says which ones are taken."""
    try:
        value = operator.index(value)
    except TypeError:
        is_whole = False
    else:
        is_whole = least <= value <= most
    if not is_whole:
        up_to = "" if most == math.inf else f" and at most {most:,}"
        raise InputError(f"{what} {shown(value)}: give a whole number of at least {least}{up_to}")
    return value

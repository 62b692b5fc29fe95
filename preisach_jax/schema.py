"""What a JSON file must hold, as a tree of checks, and the refusal that names the key that differs.

A check is a function of a value and its place, which gives the value as it is used, or raises; a
table of checks by key is the check of a table.  Nothing is built and no nesting is followed beyond
what the checks ask for, so a hostile file costs no more than its reading.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, cast

import numpy as np

from preisach_jax.errors import InputError

Check = Callable[[Any, str], Any] | Mapping[str, Any]
"""`check(value, place)`, or checks by key."""


def checked(value: Any, check: Check, place: str = "") -> Any:
    """A value as its check gives it.

    Arguments:
        value: what was read.
        check: its check; of a table, the checks of its keys, all of which must be there. Further
            keys are left out.
        place: where the value stands, for messages.

    Returns:
        The value, checked.

    Raises:
        InputError: it, or something in it, is not what the check expects.

    Example:
        >>> checked({"levels": 3, "note": ""}, {"levels": whole(2)})
        {'levels': 3}
        >>> checked({"levels": 1}, {"levels": whole(2)})
        Traceback (most recent call last):
        ...
        preisach_jax.errors.InputError: levels is 1: expected a whole number of at least 2
    """
    if not isinstance(check, Mapping):
        return check(value, place)
    table(value, place)
    by_key = cast(Mapping[str, Any], check)
    for key in by_key:
        if key not in value:
            beside = ", ".join(value) or "nothing"
            raise InputError(f"{_inside(place, key)} is missing: expected it beside {beside}")
    return {key: checked(value[key], inner, _inside(place, key)) for key, inner in by_key.items()}


def refusal(value: Any, place: str, expected: str) -> InputError:
    """The error that says what stands at a place and what was expected there.

    Example:
        >>> str(refusal([1, 2], "offset", "a finite number"))
        'offset is a list of 2: expected a finite number'
    """
    return InputError(f"{place} is {_shown(value)}: expected {expected}")


def number(low: float = -math.inf, high: float = math.inf) -> Check:
    """A finite number from `low` to `high`, as float."""
    limits = "" if (low, high) == (-math.inf, math.inf) else f" {_from_to(low, high)}"

    def check(value: Any, place: str) -> float:
        found = _as_float(value)
        if not (math.isfinite(found) and low <= found <= high):
            raise refusal(value, place, f"a finite number{limits}")
        return found

    return check


def bound(value: Any, place: str) -> float | None:
    """An end of an interval: a number, of which JSON writes infinity and NaN as null."""
    found = math.nan if value is None else _as_float(value)
    if math.isnan(found) and not (value is None or isinstance(value, float)):
        raise refusal(value, place, "a number or null")
    return None if math.isnan(found) else found


def share(value: Any, place: str) -> float | None:
    """A number of at least 0, or null where it is not known."""
    found = bound(value, place)
    return None if found is None else checked(found, number(0.0), place)


def whole(low: int, high: int | None = None) -> Check:
    """A whole number from `low` to `high`."""

    def check(value: Any, place: str) -> int:
        is_whole = isinstance(value, int) and not isinstance(value, bool)
        if not (is_whole and value >= low and (high is None or value <= high)):
            limits = _from_to(low, math.inf if high is None else high)
            raise refusal(value, place, f"a whole number {limits}")
        return value

    return check


def flag(value: Any, place: str) -> bool:
    """True or false."""
    if not isinstance(value, bool):
        raise refusal(value, place, "true or false")
    return value


def text(value: Any, place: str) -> str:
    """A text that can be written in any encoding of Unicode."""
    if not isinstance(value, str) or any("\ud800" <= sign <= "\udfff" for sign in value):
        raise refusal(value, place, "a text")
    return value


def one_of(*known: str) -> Check:
    """One of some texts."""

    def check(value: Any, place: str) -> str:
        if value not in known:
            raise refusal(value, place, f"one of {', '.join(known)}")
        return value

    return check


def table(value: Any, place: str) -> Mapping[str, Any]:
    """A table, whatever it holds."""
    if not isinstance(value, Mapping):
        raise refusal(value, place or "the content", "a table")
    found = cast(Mapping[str, Any], value)
    for key in found:
        text(key, f"a key of {place or 'the content'}")
    return found


def table_of(check: Check) -> Check:
    """A table of any keys, whose values pass a check."""

    def all_of(value: Any, place: str) -> dict[str, Any]:
        inside = table(value, place).items()
        return {key: checked(inner, check, _inside(place, key)) for key, inner in inside}

    return all_of


def items(value: Any, place: str) -> Sequence[Any]:
    """A list, whatever it holds."""
    if not isinstance(value, list | tuple):
        raise refusal(value, place, "a list")
    return cast(Sequence[Any], value)


def list_of(check: Check, least: int = 0) -> Check:
    """A list of at least `least` items that pass a check."""

    def all_of(value: Any, place: str) -> list[Any]:
        if len(items(value, place)) < least:
            raise refusal(value, place, f"a list of at least {least}")
        return [checked(inner, check, f"{place}[{i}]") for i, inner in enumerate(value)]

    return all_of


def numbers(value: Any, place: str) -> np.ndarray:
    """A list of finite numbers, as (count,) float64."""
    found = np.array([_as_float(inner) for inner in items(value, place)], dtype=np.float64)
    bad = np.flatnonzero(~np.isfinite(found))
    if bad.size:
        raise refusal(value[bad[0]], f"{place}[{bad[0]}]", "a finite number")
    return found


def like(pattern: Any, most: int) -> Check:
    """What is of the kind of a value: a setting of an effect.

    Arguments:
        pattern: a value of that kind.
        most: greatest whole number that is taken.
    """
    if isinstance(pattern, bool):
        return flag
    if isinstance(pattern, int):
        return whole(0, most)
    if isinstance(pattern, float):
        return number()
    if isinstance(pattern, str):
        return text
    numbers_only = isinstance(pattern, tuple) and all(
        isinstance(inner, float) for inner in cast(tuple[Any, ...], pattern)
    )
    if numbers_only:
        return lambda value, place: tuple(checked(value, list_of(number(), least=1), place))

    def as_given(value: Any, _: str) -> Any:
        return tuple(cast(list[Any], value)) if isinstance(value, list) else value

    return as_given


def _as_float(value: Any) -> float:
    """A number as float; NaN for what is none, or is beyond all floats."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return math.nan
    try:
        return float(value)
    except OverflowError:
        return math.nan


def _inside(place: str, key: str) -> str:
    key = key if len(key) <= 80 else f"{key[:80]}..."
    return f"{place}.{key}" if place else key


def _from_to(low: float, high: float) -> str:
    return f"of at least {low}" if high == math.inf else f"from {low} to {high}"


def _shown(value: Any) -> str:
    """A value in a few words."""
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    if isinstance(value, Mapping):
        return f"a table of {len(cast(Mapping[str, Any], value))}"
    if isinstance(value, list | tuple):
        return f"a list of {len(cast(Sequence[Any], value))}"
    if isinstance(value, int) and abs(value) >= 10**30:
        return "a number of more than 30 digits"
    if isinstance(value, int | float):
        return str(value)
    shown = ascii(value) if isinstance(value, str) and not value.isprintable() else repr(value)
    return shown if len(shown) <= 60 else f"{shown[:60]}..."

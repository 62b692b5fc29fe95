"""What a JSON file must hold, as pydantic types, and the refusal that names the key that differs.

Types are strict: a number in quotes is no number.  Further keys of a table are left out.  What is
pydantic's is the check; the sentence is ours, since its own names neither place nor value in words.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Annotated, Any, cast

import numpy as np
from pydantic import (
    AfterValidator,
    AllowInfNan,
    BeforeValidator,
    Field,
    Strict,
    TypeAdapter,
    ValidationError,
    WrapValidator,
)
from pydantic_core import PydanticCustomError
from typing_extensions import TypedDict  # pydantic needs it before Python 3.12

from preisach_jax.errors import InputError, shown
from preisach_jax.escape import printable

MOST = 1e100
"""Greatest size of a number in a file: its square, and sums of such squares, are finite."""


_UP_TO = f" (up to {MOST:g} in size)"


def checked(value: Any, kind: Any, place: str = "") -> Any:
    """A value as a type takes it."""
    try:
        return _adapter(of_keys(kind)).validate_python(value)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = _place(first["loc"], place)
        if first["type"] == "missing":
            raise _missing(first["input"], where) from None
        expected = _EXPECTED.get(first["type"], first["msg"])
        if first["type"] == "too_short":
            expected = f"a list of at least {first['ctx']['min_length']}"  # pyright: ignore[reportTypedDictNotRequiredAccess]
        raise refusal(first["input"], where, expected) from None


def of_keys(kinds: Any) -> Any:
    """The type of a table with given keys, all of which must be there, from their types by key."""
    if not isinstance(kinds, Mapping):
        return kinds
    inside = {key: of_keys(kind) for key, kind in cast(Mapping[str, Any], kinds).items()}
    return TypedDict("Table", inside)  # pyright: ignore


def refusal(value: Any, place: str, expected: str) -> InputError:
    """The error that says what stands at a place and what was expected there."""
    return InputError(f"{place} is {_shown(value)}: expected {expected}")


@cache
def _adapter(kind: Any) -> TypeAdapter[Any]:
    return TypeAdapter(kind)


_EXPECTED = {
    "float_type": "a finite number",
    "finite_number": "a finite number",
    "greater_than_equal": f"a finite number{_UP_TO}",
    "less_than_equal": f"a finite number{_UP_TO}",
    "dict_type": "a table",
    "list_type": "a list",
    "string_type": "a text",
    "string_unicode": "a text",
    "bool_type": "true or false",
}
"""By pydantic's kinds of errors, what was expected."""


def _wrong(expected: str) -> PydanticCustomError:
    return PydanticCustomError("expected", "{expected}", {"expected": expected})


def _expect(expected: str) -> WrapValidator:
    """Say of whatever is wrong with a value that this was expected."""

    def check(value: Any, inner: Callable[[Any], Any]) -> Any:
        try:
            return inner(value)
        except (ValidationError, OverflowError):
            raise _wrong(expected) from None

    return WrapValidator(check)


def _from_to(low: float, high: float) -> str:
    return f"of at least {low}" if high == math.inf else f"from {low} to {high}"


def number(low: float = -math.inf, high: float = math.inf) -> Any:
    """A number from `low` to `high`, of a size of at most `MOST`, as float."""
    limits = "" if (low, high) == (-math.inf, math.inf) else f" {_from_to(low, high)}"
    return Annotated[
        float, Strict(), AllowInfNan(False), Field(ge=max(low, -MOST), le=min(high, MOST)),
        _expect(f"a finite number{limits}{_UP_TO if high >= MOST else ''}"),
    ]  # fmt: skip


def _null_for_nan(given: Any) -> Any:
    return None if isinstance(given, float) and math.isnan(given) else given


_nan_is_null = BeforeValidator(_null_for_nan)

bound = Annotated[
    Annotated[float, Strict()] | None, _nan_is_null, _expect("a number or null")
]  # fmt: skip
"""An end of an interval: a number, of which JSON writes infinity and NaN as null."""

share = Annotated[number(0.0) | None, _nan_is_null]
"""A number of at least 0, or null where it is not known."""


def whole(low: int, high: int | None = None) -> Any:
    """A whole number from `low` to `high`."""
    limits = _from_to(low, math.inf if high is None else high)
    return Annotated[int, Strict(), Field(ge=low, le=high), _expect(f"a whole number {limits}")]


flag = Annotated[bool, Strict()]
"""True or false."""


def _seen(given: str) -> str:
    if printable(given) != given:
        raise _wrong("a text without control characters")
    return given


text = Annotated[str, Strict(), AfterValidator(_seen), _expect("a text")]
"""A text of characters that are seen, as all names are that a file gives (`escape.printable`)."""

table = Annotated[dict[text, Any], Strict()]
"""A table, whatever it holds."""


def _as_list(given: Any) -> Any:
    return list(cast(tuple[Any, ...], given)) if isinstance(given, tuple) else given


def _as_tuple(given: Any) -> Any:
    return tuple(cast(list[Any], given)) if isinstance(given, list) else given


_listed = BeforeValidator(_as_list)

items = Annotated[list[Any], Strict(), _listed]
"""A list, whatever it holds."""


def one_of(*known: str) -> Any:
    """One of some texts."""
    expected = f"one of {', '.join(known)}"

    def check(value: Any) -> Any:
        if value not in known:
            raise _wrong(expected)
        return value

    return Annotated[Any, AfterValidator(check)]


def table_of(kind: Any) -> Any:
    """A table of any keys, whose values are of a type."""
    return Annotated[dict[text, of_keys(kind)], Strict()]


def list_of(kind: Any, least: int = 0) -> Any:
    """A list of at least `least` items of a type."""
    return Annotated[list[of_keys(kind)], Strict(), Field(min_length=least), _listed]


numbers = Annotated[
    list[Annotated[float, Strict(), AllowInfNan(False), Field(ge=-MOST, le=MOST)]],
    Strict(),
    _listed,
    AfterValidator(lambda found: np.array(found, dtype=np.float64)),
]
"""A list of such numbers, as (count,) float64."""


MOST_COUNT = 10**6
"""Greatest of the numbers of `whole_numbers`."""


def _counts(given: str) -> list[int]:
    found = [int(each) for each in given.split()]
    if any(abs(count) > MOST_COUNT for count in found):
        raise _wrong(f"whole numbers of at most {MOST_COUNT:,}")
    return found


whole_numbers = Annotated[text, AfterValidator(_counts), _expect("a text of whole numbers")]
"""A text of whole numbers between blanks, as a list: as a list of JSON it is much longer."""


def like(pattern: Any, most: int, least: float = -math.inf) -> Any:
    """What is of the kind of a value: a setting of an effect."""
    if isinstance(pattern, bool):
        return flag
    if isinstance(pattern, int):
        return whole(0, most)
    if isinstance(pattern, float):
        return number(least)
    if isinstance(pattern, str):
        return text
    numbers_only = isinstance(pattern, tuple) and all(
        isinstance(inner, float) for inner in cast(tuple[Any, ...], pattern)
    )
    if numbers_only:
        return Annotated[list_of(number(least), least=1 if pattern else 0), AfterValidator(tuple)]
    return Annotated[Any, AfterValidator(_as_tuple)]


def _missing(holder: Any, place: str) -> InputError:
    keys = ", ".join(cast(Mapping[str, Any], holder)) if isinstance(holder, Mapping) else ""
    return InputError(f"{place} is missing: expected it beside {keys or 'nothing'}")


def _place(steps: Sequence[int | str], start: str) -> str:
    place = start
    for step in steps:
        if isinstance(step, int):
            place += f"[{step}]"
        elif step == "[key]":
            place = f"a key of {place.rpartition('.')[0] or 'the content'}"
        else:
            key = step if len(step) <= 80 else f"{step[:80]}..."
            place = f"{place}.{key}" if place else key
    return place or "the content"


def _shown(value: Any) -> str:
    """A value in a few words."""
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    if isinstance(value, Mapping):
        return f"a table of {len(cast(Mapping[str, Any], value))}"
    if isinstance(value, list | tuple):
        return f"a list of {len(cast(Sequence[Any], value))}"
    if isinstance(value, int | float):
        return shown(value)
    text = ascii(value) if isinstance(value, str) and not value.isprintable() else repr(value)
    return text if len(text) <= 60 else f"{text[:60]}..."

"""The library of effects that a rate-independent model may lack."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from importlib import import_module
from importlib.metadata import entry_points
from pkgutil import iter_modules
from typing import Any, cast

from preisach_jax.effects.base import Effect, OfColumn
from preisach_jax.errors import InputError, shown


def _found() -> tuple[type[Effect], ...]:
    """The effects of this folder: the classes in its files that have a name, or a prefix of one."""
    kinds: list[type[Effect]] = []
    for file in iter_modules(__path__):
        module = import_module(f"{__name__}.{file.name}")
        for kind in vars(module).values():
            if isinstance(kind, type) and issubclass(kind, Effect):
                called = vars(kind).get("name") or vars(kind).get("prefix")
                if called and isinstance(called, str) and kind.__module__ == module.__name__:
                    kinds.append(kind)
    kinds.sort(key=lambda kind: kind.rank)
    by_name = {kind().name: kind for kind in kinds}
    for name, kind in by_name.items():
        # It holds both ways, but not every record has a column.
        for other in () if issubclass(kind, OfColumn) else kind.confused_with:
            if other in by_name and name not in by_name[other].confused_with:
                by_name[other].confused_with += (name,)
    return tuple(kinds)


BUILT_IN = _found()
"""The effects of this package."""

ENTRY_POINTS = "preisach_jax.effects"


def library() -> dict[str, Effect]:
    """The library of effects by name, with those that installed packages register.

    A package registers its own by an entry point of the group `preisach_jax.effects` that names
    the class.

    Returns:
        Effects by name; `aux:COL` and its like stand for one effect an auxiliary column.

    Example:
        >>> "creep" in library(), library()["creep"].place.acts_on
        (True, 'the output of the hysteresis')
    """
    effects: list[Effect] = [kind() for kind in BUILT_IN]
    effects += [point.load()() for point in entry_points(group=ENTRY_POINTS)]
    return {effect.name: effect for effect in effects}


OF_COLUMNS: tuple[type[OfColumn], ...] = tuple(
    kind for kind in BUILT_IN if issubclass(kind, OfColumn)
)
"""The effects of an auxiliary column."""


def placeholder(name: str) -> str:
    """The library's name of an effect: of one of a column, that of its placeholder."""
    prefix, colon, _ = name.partition(":")
    of_columns = [kind.prefix for kind in OF_COLUMNS]
    return f"{prefix}:COL" if colon and prefix in of_columns else name


def column_of(name: str) -> str:
    """The auxiliary column that an effect is named after; empty if it is of none."""
    return name.partition(":")[2] if placeholder(name) != name else ""


def listed(asked: Any) -> list[str | Effect]:
    """Names and effects as a list, which may hold nothing else."""
    if isinstance(asked, str | Effect | type) or not isinstance(asked, Iterable):
        shown = repr(asked) if isinstance(asked, str) else _shown(asked)
        raise InputError(f"effects is {shown}: give a list of names and effects, [...]")
    items = list(cast(Iterable[Any], asked))
    for item in items:
        if isinstance(item, type):
            raise InputError(
                f"effects holds the class {item.__name__}: give an effect, {item.__name__}()"
            )
        if not isinstance(item, str | Effect):
            raise InputError(
                f"effects holds {_shown(item)}: give names of the library, or effects of one's own"
            )
    return items


def _shown(value: Any) -> str:
    if isinstance(value, type):
        return f"the class {value.__name__}"
    return f"{shown(value)}, a {type(value).__name__}"


def resolve(
    asked: Iterable[str | Effect], aux_units: dict[str, str], known: Sequence[Effect] = ()
) -> tuple[Effect, ...]:
    """Effects from their names; effects pass as they are.

    Arguments:
        aux_units: the auxiliary columns of the record, with their units.

    Returns:
        The effects, in the order asked.
    """
    names = library() | {effect.name: effect for effect in known}
    found: list[Effect] = []
    for item in listed(asked):
        if isinstance(item, Effect):
            effect = item
        elif item in names and not item.endswith(":COL"):
            effect = names[item]
        elif placeholder(item) != item or item in names:
            effect = _of_column(item, aux_units)
        else:
            near = get_close_matches(item, names, n=1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            raise InputError(
                f"there is no effect {item!r}{hint}; give one of {', '.join(sorted(names))}"
            )
        if effect.name in [other.name for other in found]:
            raise InputError(f"the effect {effect.name!r} is asked for twice; name it once")
        found.append(effect)
    return tuple(found)


def _of_column(name: str, aux_units: dict[str, str]) -> OfColumn:
    prefix, _, column = name.partition(":")
    if column not in aux_units:
        have = ", ".join(aux_units) or "none"
        raise InputError(
            f"the effect {name!r} needs the auxiliary column {column!r}, which the record "
            f"was not loaded with (loaded: {have}); add it with --aux {column}"
        )
    kind = next(kind for kind in OF_COLUMNS if kind.prefix == prefix)
    return kind(column=column, unit=aux_units[column])

"""Effects that hold arrays, such as the weights of a network."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, ClassVar, Protocol, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from preisach_jax.errors import InputError


class _Settable(Protocol):
    __dataclass_fields__: ClassVar[dict[str, Any]]

    def settings(self) -> dict[str, Any]: ...


Kind = TypeVar("Kind", bound=_Settable)


def is_floating(leaf: Any) -> bool:
    """Whether a leaf of an effect is a floating array, of JAX or NumPy."""
    kind: Any = getattr(leaf, "dtype", None)
    return isinstance(leaf, jax.Array | np.ndarray) and jnp.issubdtype(kind, jnp.floating)


def arrays_in(value: Any) -> list[Any]:
    """The floating arrays of a field of an effect, in the order of its tree."""
    return [leaf for leaf in jax.tree.leaves(value) if is_floating(leaf)]


def with_settings(pattern: Kind, settings: dict[str, Any], place: str) -> Kind:
    """An effect of a pattern's kind with the settings of a file."""
    held = [name for name in settings if arrays_in(getattr(pattern, name))]
    if not held:
        return type(pattern)(**settings)
    own = pattern.settings()
    others = {k: v for k, v in settings.items() if k not in held and v != own[k]}

    def fields(effect: Kind) -> list[Any]:
        return [getattr(effect, name) for name in held]

    return eqx.tree_at(
        fields,
        replace(pattern, **others) if others else pattern,
        [_filled(getattr(pattern, name), settings[name], f"{place}.{name}") for name in held],
    )


def _filled(value: Any, arrays: Any, place: str) -> Any:
    """A field of an effect with the arrays of a file, nested lists, in place of its own."""
    expected: list[tuple[int, ...]] = [leaf.shape for leaf in arrays_in(value)]
    try:
        given = [np.asarray(each, dtype=float) for each in arrays]
        shapes = [each.shape for each in given]
    except (TypeError, ValueError):
        given, shapes = [], None
    if shapes != expected or not all(np.isfinite(each).all() for each in given):
        told = "no lists of finite numbers" if shapes is None else f"arrays of {shapes}"
        raise InputError(
            f"{place} holds {told:.80}, and the effect that was passed arrays of {expected}: pass "
            "one of the size that was saved"
        )
    others = iter(given)

    def filled(leaf: Any) -> Any:
        return next(others) if is_floating(leaf) else leaf

    return jax.tree.map(filled, value)

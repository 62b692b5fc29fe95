"""What JAX says of the code of an effect that it cannot trace, as the mistake of its author."""

from __future__ import annotations

import traceback
from collections.abc import Generator
from contextlib import contextmanager
from typing import Any, cast

from jax.errors import JAXTypeError, TracerBoolConversionError

from preisach_jax.errors import EffectError


@contextmanager
def told_as_its_own(effect: Any) -> Generator[None]:
    """Turn JAX's errors of a value that is traced into one line that names the place."""
    try:
        yield
    except JAXTypeError as error:
        kind = cast(type[Any], type(effect))
        frames = traceback.walk_tb(error.__traceback__)
        own = [(f, line) for f, line in frames if f.f_globals.get("__name__") == kind.__module__]
        stack = traceback.StackSummary.extract(iter(own[-1:]))
        at = f" (line {stack[0].lineno}: {stack[0].line})" if stack else ""
        what, remedy = (
            ("branches on", "write jnp.where(condition, a, b) in place of if, and, or, min and max")
            if isinstance(error, TracerBoolConversionError)
            else ("makes a Python number of", "use jax.numpy in place of numpy, math and float()")
        )
        raise EffectError(
            f"the effect {effect.name!r} {what} a value that is not known while JAX traces "
            f"{kind.__name__}{at}: {remedy}"
        ) from error

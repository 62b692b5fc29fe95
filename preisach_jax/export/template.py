"""The templates of generated C, and the pieces of them that stand beside effects.

An effect that is not linear has the file `NAME.c.j2` beside its module.  In it `part` is the effect
in discrete time, `n` its numbers (see `Effect.sampled`), `name` the name of its function in C and
`id` the beginning of the names of what it remembers.  It sets `remembers`, `operations` and
`calls`, the numbers it keeps and what a sample costs at most, and has macros by its place:

    law()            its function: `real NAME(const preisach_state *s, real value, preisach_effects
                     *next)` of the input and of what is added, `real NAME(const preisach_state *s)`
                     of the weights, `real NAME(real signal)` of the sensor, and of thresholds that
                     move `real NAME(real way)`; a sensor that is a map has `NAME_undone` as well
    fields()         what it remembers from sample to sample, in the struct `preisach_effects`
    seen()           of what is fed back: statements that change `path`, by `fed_back`
    slope_of_seen()  the same for `slope`, the derivative of `path` by `fed_back`
"""

from __future__ import annotations

import functools
import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jinja2

from preisach_jax.effects.base import Effect
from preisach_jax.escape import c_comment, markdown, printable_lines

NUMBERS_A_LINE = 4


def real(value: float) -> str:
    """A number as C writes it, to the last bit."""
    return f"REAL({float(value)!r})"


def reals(values: Sequence[float]) -> str:
    """The lines of an initialiser."""
    return _lines([real(value) for value in values])


def plain(values: Sequence[float]) -> str:
    """The lines of an initialiser of doubles."""
    return _lines([repr(float(value)) for value in values])


def _lines(texts: list[str]) -> str:
    rows = [texts[i : i + NUMBERS_A_LINE] for i in range(0, len(texts), NUMBERS_A_LINE)]
    return ",\n".join("    " + ", ".join(row) for row in rows)


def _harmless(value: Any) -> Any:
    return printable_lines(value) if isinstance(value, str) else value


@functools.cache  # which keeps the templates compiled
def environment() -> jinja2.Environment:
    """The templates of the export."""
    made = jinja2.Environment(
        loader=jinja2.PackageLoader("preisach_jax", "export/templates"),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,
        finalize=_harmless,
    )
    made.filters |= {
        "real": real, "reals": reals, "plain": plain, "number": repr, "comment": c_comment,
        "markdown": markdown,
    }  # fmt: skip
    return made


@functools.cache
def _compiled(path: Path) -> jinja2.Template:
    return environment().from_string(path.read_text(encoding="utf-8"))


def piece_of(effect: Effect) -> Path | None:
    """The file of an effect's piece of the C code, if it has one."""
    module = getattr(sys.modules.get(type(effect).__module__), "__file__", None)
    if module is None:
        return None
    path = Path(module).parent / f"{effect.name}.c.j2"
    return path if path.is_file() else None


def filled(path: Path, content: Mapping[str, Any]) -> Any:
    """A piece of the C code for one effect: its macros and what it sets, as attributes."""
    return _compiled(path).make_module({"pi": math.pi, **content})

"""A model as C99: the files of `preisach export --to c`."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from preisach_jax.effects.base import Place
from preisach_jax.export.account import (
    MOST_FILTERED,
    differences,
    filtered_numbers,
    jumps,
    settling,
    sizes,
)
from preisach_jax.export.description import Description, Part, describe
from preisach_jax.export.selftest import self_test
from preisach_jax.export.template import environment
from preisach_jax.model import Model, without_effects


def sums_below(weights: np.ndarray, levels: int) -> np.ndarray:
    """Sums of the weights below each corner of the plane's grid."""
    plane = np.zeros((levels + 1, levels + 1))
    rows, columns = np.tril_indices(levels)
    plane[rows + 1, columns + 1] = weights
    return plane.cumsum(axis=1).cumsum(axis=0)[np.tril_indices(levels + 1)]


def view(model: Description) -> dict[str, Any]:
    """What the templates are filled with."""
    rate = model.widening
    separate = rate is not None and not rate.numbers["reversible"]
    rows, columns = np.tril_indices(model.levels)
    off = np.where((rows == columns) & separate, 0.0, model.weights)
    inputs, outputs, added = (model.at(p) for p in (Place.INPUT, Place.OUTPUT, Place.ADDED))
    source = {part.name: (part.column and _identifier(model, part.column)) or "u" for part in added}
    feedback = [part for part in model.at(Place.HYSTERESIS) if part.feeds_back]
    place, filter_numbers = _placed(outputs)
    others, linear_numbers = _placed([part for part in (*inputs, *added) if part.linear])
    lagging = [part for part in outputs if part.linear is None or not part.linear.passes]
    aux = [column.identifier for column in model.aux]
    diagonal = np.append(0.0, np.cumsum(model.weights[rows == columns]))
    return {
        "model": model,
        "effect_names": ", ".join(part.name for part in model.parts),
        "widening": rate,
        "delay": model.delay,
        "pieces": [part.piece for part in model.parts if part.file],
        "separate_diagonal": separate,
        "speed_held": rate is not None and bool(rate.numbers["reversible"]),
        "signed": model.signed,
        "relay": model.hysteron == "relay",
        "most_reading": 1e3 * (float(np.abs(model.weights).sum()) + abs(model.offset)),
        "most_missed": 10 * (float(np.abs(model.weights).sum()) + abs(model.offset)),
        "most_weight": 2 * float(np.abs(model.weights).sum()),
        "least_weight": "-MOST_WEIGHT" if model.signed or model.polarity < 0 else "REAL(0.0)",
        "greatest_weight": "MOST_WEIGHT" if model.signed or model.polarity > 0 else "REAL(0.0)",
        "adapts": filtered_numbers(model) <= MOST_FILTERED,
        "settling": settling(model),
        "not_adapting": (
            f"through the delay the hysterons would keep {filtered_numbers(model)} numbers, of "
            f"which {MOST_FILTERED} at most are taken for sensible"
        ),
        "quiet": model.hysteron == "relay" and not model.parts and not model.aux,
        "feedback": feedback,
        "timed": ", ".join(p.name for p in model.parts if p.effect.of_time_alone)
        if not model.by_path
        else "",
        "weighing": model.at(Place.WEIGHTS),
        "maps": [part for part in reversed(model.sensor) if not part.resolution],
        "resolution": sum(part.resolution for part in model.sensor),
        "inputs": inputs,
        "outputs": outputs,
        "linears": [part for part in model.parts if part.linear],
        "bent": [part for part in inputs if part.linear and part.numbers.get("arc")],
        "place": place | others,
        "filter_numbers": filter_numbers,
        "linear_numbers": linear_numbers,
        "passing": [part for part in outputs if part not in lagging],
        "settles": bool(lagging),
        "rings": " and ".join(part.name for part in lagging if _rings(part)),
        "led_output": sum(part.linear.lead for part in lagging if part.linear),
        "led_input": sum(part.linear.lead for part in inputs if part.linear),
        "sensors": model.sensor,
        "added": added,
        "source": source,
        "unused_aux": [c for c in model.aux if c.identifier not in source.values()],
        "aux_parameters": "".join(f", preisach_real {name}" for name in aux),
        "aux_reals": "".join(f", real {name}" for name in aux),
        "aux_pointers": "".join(f", real *{name}" for name in aux),
        "aux_arguments": "".join(f", {name}" for name in aux),
        "aux_addresses": "".join(f", &{name}" for name in aux),
        "aux_first": "".join(f", s->{name}" for name in aux),
        "sums": sums_below(off, model.levels).tolist(),
        "diagonal": diagonal.tolist(),
        "thresholds": model.plane.thresholds.tolist(),
        "equal_cells": model.plane.own_thresholds is None,
    }


def _identifier(model: Description, column: str) -> str:
    """The identifier in C of an auxiliary column."""
    return next(each.identifier for each in model.aux if each.name == column)


def _placed(parts: Sequence[Part]) -> tuple[dict[str, int], int]:
    """Where in one array each part remembers its numbers, and the size of that."""
    sizes = [part.linear.numbers if part.linear else 1 for part in parts]
    starts = itertools.accumulate(sizes, initial=0)
    return {part.name: at for part, at in zip(parts, starts, strict=False)}, sum(sizes)


def _rings(part: Part) -> bool:
    return part.linear is not None and part.linear.a.shape[-1] > 1


def sources(model: Description) -> dict[str, str]:
    """Header and source of a model, by file name."""
    made, content = environment(), view(model)
    names = ("preisach_model.h", "preisach_model.c")
    return {name: made.get_template(f"{name}.j2").render(content) for name in names}


def files(
    model: Model,
    rate_hz: float | None = None,
    without: Sequence[str] = (),
    tested: Callable[[Mapping[str, str]], str] = lambda _: "was not run",
) -> dict[str, str]:
    """All files of the C export, by name."""
    described = describe(model, rate_hz, without)
    content = view(described)
    test = self_test(without_effects(model, without), described)
    content |= {
        "test": test,
        "size": sizes(described),
        "jumps": jumps(described),
        "differences": differences(described),
        "parts_said": [part for part in described.parts if part.said],
    }
    made, code = environment(), sources(described)
    for name in ("preisach_test.c", "Makefile"):
        code[name] = made.get_template(f"{name}.j2").render(content)
    content["self_test"] = tested(code)
    return code | {"README.md": made.get_template("README.md.j2").render(content)}

"""What generated code takes in memory and work, and where it differs from `Model.predict`."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from preisach_jax.effects.base import Place
from preisach_jax.export.description import Description, Part

MOST_FILTERED = 200_000
"""Numbers of the hysterons' states behind the effects of the output beyond which C does not learn:
1.6 MB in double."""

LEFT = 0.01
"""Part of the output that a past which is not known may make when learning begins."""

OUTPUT_BELOW = 14
"""Operations of one look-up of the output of a corner."""


def jumps(model: Description) -> bool:
    """Whether the output jumps, so that rounding of a float may put it on the other side."""
    return model.hysteron == "relay" or bool(model.chain.converters)


def looks_ahead(model: Description) -> bool:
    """Whether a law in `Model.predict` uses a sample that is still to come."""
    rate = model.widening
    return rate is not None and not rate.numbers["corners"]


def differences(model: Description) -> list[str]:
    """Sentences on where the code differs from `Model.predict`, which knows the whole record."""
    if model.widening is None:
        return []
    said: list[str] = []
    if looks_ahead(model):
        said.append(
            "`Model.predict` takes the speed of the input from the samples before and after; this "
            "code from the last three. The speeds differ by two thirds of the third difference of "
            "the input."
        )
    return [
        *said,
        "The speed at the first sample is known at the second one: the first output has no "
        "widening of the thresholds, and from the second on it is as if it had.",
    ]


def _numbers_of_effects(model: Description) -> int:
    """Numbers that the effects remember."""
    return 2 + 2 * (model.hysteron == "relay") + sum(_numbers_of(part) for part in model.parts)


def _numbers_of(part: Part) -> int:
    """Numbers that an effect remembers of one signal."""
    if part.linear is not None:
        return part.linear.numbers + 3 * bool(part.numbers.get("arc"))
    return part.numbers["whole"] + 2 if part.is_delay else part.piece.remembers


def filtered_numbers(model: Description) -> int:
    """Numbers that learning keeps of the hysterons' states behind the effects of the output."""
    own = sum(_numbers_of(part) for part in model.at(Place.OUTPUT))
    return model.levels * (model.levels + 1) // 2 * (own + 1 if own else 0)


def settling(model: Description) -> int:
    """Samples after which the past of the effects of the output makes less than `LEFT` of it."""
    return sum(_settling(part) for part in model.at(Place.OUTPUT))


def _settling(part: Part) -> int:
    if part.linear is None:
        return part.numbers["whole"] + 1
    gains = np.abs(part.linear.c).max(axis=1)
    kept = np.abs(np.linalg.eigvals(part.linear.a)).max(axis=1)
    felt = gains > LEFT
    passed = np.log(LEFT / gains[felt]) / np.log(kept[felt])
    return min(math.ceil(passed.max(initial=0.0)), 2**31 - 1)


def _operations(part: Part) -> int:
    """Operations of a part in one sample, in the worst case."""
    if part.linear is not None:
        arc = 10 * bool(part.numbers.get("arc"))
        return 2 + (3 + 2 * part.linear.a.shape[-1]) * part.linear.b.size + arc
    return 5 if part.is_delay else part.piece.operations


def sizes(model: Description) -> dict[str, Any]:
    """Counts of numbers and operations, in the worst case."""
    levels = model.levels
    cells, sums = levels * (levels + 1) // 2, (levels + 1) * (levels + 2) // 2
    rate = model.widening
    diagonal = levels + 1 if rate is not None and not rate.numbers["reversible"] else 0
    corners = 2 * levels + 2 if rate is not None else levels + 2
    effects = _numbers_of_effects(model)
    lean = 4 * corners + effects + 6 + len(model.aux)
    outputs = 2 * sum(_operations(part) for part in model.at(Place.OUTPUT))
    coefficients = sum(_constants(part) for part in model.parts)
    return {
        "state": lean + 2 * cells + sums + diagonal + 1 + filtered_numbers(model),
        "lean": lean,
        "constants": max(cells, sums + diagonal)
        + coefficients
        + levels * (model.hysteron == "relay"),
        "stack": 2 * (effects + 16) + levels + 30,
        "step_moves": corners,
        "step_flops": 4 * OUTPUT_BELOW + 40 + 10 * (rate is not None),
        "effect_flops": sum(_operations(part) for part in model.parts) + 4,
        "calls": sum(part.piece.calls for part in model.parts if part.file),
        "tries": 102 if not (rate is not None and rate.numbers["reversible"]) else 306,
        "adapt_flops": (36 + outputs) * cells + OUTPUT_BELOW * 2 * corners,
    }


def _constants(part: Part) -> int:
    if part.linear is not None:
        return 1 + part.linear.a.size + 2 * part.linear.b.size
    return sum(np.size(n) for n in part.numbers.values())

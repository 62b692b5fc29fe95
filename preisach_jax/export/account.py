"""What generated code takes in memory and work, and where it differs from `Model.predict`."""

from __future__ import annotations

import math
from typing import Any

from preisach_jax.effects.places import Place
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
    rounding = {"input_quantisation", "output_quantisation"}
    return model.hysteron == "relay" or any(part.kind in rounding for part in model.parts)


def looks_ahead(model: Description) -> bool:
    """Whether a law in `Model.predict` uses a sample that is still to come."""
    rate = model.part("rate_dependence")
    return rate is not None and not rate.numbers["corners"]


def differences(model: Description) -> list[str]:
    """Sentences on where the code differs from `Model.predict`, which knows the whole record."""
    if model.part("rate_dependence") is None:
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
    fixed = {"input_lag": 6, "slew_limit": 2, "rate_dependence": 3, "output_lag": 2,
             "resonance": 3, "auxiliary": 2, "moving": 1, "eddy_currents": 1}  # fmt: skip
    if part.kind == "delay":
        whole = part.numbers["whole"]
        assert isinstance(whole, int)
        return whole + 2
    if part.kind == "creep":
        return 1 + _length(part, "gain")
    if part.kind == "operator_creep":
        return _length(part, "gain")
    return 2 * _length(part, "gain") if part.kind == "reptation" else fixed.get(part.kind, 0)


def filtered_numbers(model: Description) -> int:
    """Numbers that learning keeps of the hysterons' states behind the effects of the output."""
    own = sum(_numbers_of(part) for part in model.at(Place.OUTPUT))
    return model.levels * (model.levels + 1) // 2 * (own + 1 if own else 0)


def settling(model: Description) -> int:
    """Samples after which the past of the effects of the output makes less than `LEFT` of it."""
    return sum(_settling(part) for part in model.at(Place.OUTPUT))


def _settling(part: Part) -> int:
    numbers: Any = part.numbers
    if part.kind == "delay":
        return numbers["whole"] + 1
    if part.kind == "resonance":  # away and speed turn and shrink by the root of their determinant
        (a, b, _), (c, d, _) = numbers["away"], numbers["speed"]
        elements = [(1.0, math.sqrt(a * d - b * c))]
    elif part.kind == "output_lag":
        elements = [(1.0, numbers["decay"])]
    else:
        elements = list(zip(numbers["gain"], numbers["decay"], strict=True))
    passed = [
        math.log(LEFT / abs(gain)) / math.log(decay) for gain, decay in elements if abs(gain) > LEFT
    ]
    return min(math.ceil(max(passed, default=0.0)), 2**31 - 1)


def _length(part: Part, name: str) -> int:
    numbers = part.numbers[name]
    assert isinstance(numbers, tuple)
    return len(numbers)


def _operations(part: Part) -> int:
    """Operations of a part in one sample, in the worst case."""
    fixed = {"input_lag": 18, "slew_limit": 18, "input_quantisation": 2, "rate_dependence": 10,
             "ageing": 3, "output_lag": 6, "delay": 5, "resonance": 14, "auxiliary": 7,
             "drift": 3, "output_quantisation": 2, "moving": 5, "eddy_currents": 3}  # fmt: skip
    if part.kind in fixed:
        return fixed[part.kind]
    if part.kind == "creep":
        return 8 * _length(part, "gain")
    if part.kind == "operator_creep":
        return 35 * _length(part, "gain")
    if part.kind == "reptation":
        return 8 + 14 * _length(part, "gain")
    if part.kind == "hum":
        return 7 * _length(part, "cosine")
    return 29 * (40 + 9 * _length(part, "ripples"))  # the map of the sensor, at most 29 times


def _calls(part: Part) -> int:
    """Calls of the mathematical library in one sample, in the worst case."""
    fixed = {"ageing": 1, "rate_dependence": 1, "reptation": 2}
    fixed |= {"input_quantisation": 1, "output_quantisation": 1}
    if part.kind == "operator_creep":
        return 3 * _length(part, "gain")
    if part.kind == "hum":
        return 2 * _length(part, "cosine")
    if part.kind == "drift":
        return _length(part, "waves") if "waves" in part.numbers else 1
    if part.kind == "output_nonlinearity":
        return 58 * _length(part, "ripples")
    return fixed.get(part.kind, 0)


def sizes(model: Description) -> dict[str, Any]:
    """Counts of numbers and operations, in the worst case."""
    levels = model.levels
    cells, sums = levels * (levels + 1) // 2, (levels + 1) * (levels + 2) // 2
    rate = model.part("rate_dependence")
    diagonal = levels + 1 if rate is not None and not rate.numbers["reversible"] else 0
    corners = 2 * levels + 2 if rate is not None else levels + 2
    effects = _numbers_of_effects(model)
    lean = 4 * corners + effects + 6 + len(model.aux)
    outputs = 2 * sum(_operations(part) for part in model.at(Place.OUTPUT))
    coefficients = sum(
        len(n) if isinstance(n, tuple) else 1 for part in model.parts for n in part.numbers.values()
    )
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
        "calls": sum(_calls(part) for part in model.parts),
        "tries": 102 if not (rate is not None and rate.numbers["reversible"]) else 306,
        "adapt_flops": (36 + outputs) * cells + OUTPUT_BELOW * 2 * corners,
    }

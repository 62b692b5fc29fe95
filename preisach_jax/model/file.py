"""The fields of a model from its file, every key of which is checked."""

from __future__ import annotations

import json
import sys
from collections.abc import Generator, Iterable, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NotRequired

import numpy as np

from preisach_jax.chain.coefficients import Coefficients
from preisach_jax.chain.description import Chain
from preisach_jax.effects import BUILT_IN, library, listed, placeholder
from preisach_jax.effects.base import Effect, with_settings
from preisach_jax.errors import InputError
from preisach_jax.files import check_regular
from preisach_jax.model.band import PARTS, SLICES, Band
from preisach_jax.model.origin import FORMAT, FORMAT_VERSION, Origin, ParameterEstimate
from preisach_jax.model.schema import (
    bound,
    checked,
    items,
    like,
    list_of,
    number,
    numbers,
    of_keys,
    one_of,
    refusal,
    share,
    table,
    table_of,
    text,
    whole,
    whole_numbers,
)
from preisach_jax.operator.inputs import HYSTERONS
from preisach_jax.operator.plane import Plane
from preisach_jax.record.samples import INITIAL_MEMORIES


def read(path: Path) -> Mapping[str, Any]:
    """The content of a model's file."""
    check_regular(path, "give a model file, as 'preisach fit ... --out model.json' writes it")
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except RecursionError:
        raise InputError(
            f"{path}: this is no model file (its JSON is nested too deeply); write one with "
            "'preisach fit ... --out model.json'"
        ) from None
    except OSError as error:
        raise InputError(
            f"{path}: the model cannot be read ({error.strerror}); check the path"
        ) from error
    except ValueError as error:
        raise InputError(
            f"{path}: this is no model file (it is not valid JSON: {error}); write one with "
            "'preisach fit ... --out model.json'"
        ) from error


def fields_of(content: Mapping[str, Any], effects: Iterable[Effect] = ()) -> dict[str, Any]:
    """The fields of `Model`, from what `Model.to_json` gave."""
    if not isinstance(content, Mapping) or content.get("format") != FORMAT:
        raise InputError(
            f"this JSON is no model of preisach_jax (no 'format': '{FORMAT}'); write one with "
            "'preisach fit ... --out model.json'"
        )
    found: Any = content.get("format_version")
    if isinstance(found, bool) or found != FORMAT_VERSION:
        written_by = content.get("library_version")
        raise InputError(
            f"the model has format version {found!r:.20} (written by preisach_jax "
            f"{written_by if isinstance(written_by, str) else 'of no version':.20}), and this "
            f"library reads version {FORMAT_VERSION}; install the version that wrote it, "
            "or fit anew"
        )
    with _named_as_damage():
        sound = checked(content, _CONTENT)
    own = [effect for effect in listed(effects) if isinstance(effect, Effect)]
    kinds = _kinds_of(sound["effects"], {effect.name: effect for effect in own})
    with _named_as_damage():
        return _fields_of(sound, kinds)


@contextmanager
def _named_as_damage() -> Generator[None]:
    try:
        yield
    except InputError as error:
        raise InputError(
            f"the model file is damaged ({error}); correct it, or fit the model again"
        ) from error


MOST_COLUMNS = 1000
"""Most columns that an effect may have where a file says how many: a built-in one has some ten."""

LEAST = 1e-60
"""Least span of the input, and least time: what is divided by it stays finite."""

_ESTIMATE = {"value": number(), "low": bound, "high": bound, "unit": text}


_LAW = of_keys(
    {"shares": numbers, "usual_speed": number(0.0), "cell": number(0.0), "least": number(0.0)}
)
_OTHERS = of_keys(
    {
        "of_blocks": whole(0),
        "step": numbers,
        "weights": list_of(whole_numbers),
        "offset": list_of(numbers),
        "added": list_of(numbers),
        "parameters": list_of(numbers),
    }
)
_BAND = of_keys(
    {"speed": numbers, "since_s": numbers, "half": numbers, "law": _LAW, "others": _OTHERS | None}
)


def _band_from(found: dict[str, Any] | None, chain: Chain) -> Band | None:
    if found is None:
        return None
    for key, count in (("speed", SLICES - 1), ("since_s", SLICES - 1), ("half", SLICES**2)):
        if len(found[key]) != count:
            raise InputError(f"band.{key} is a list of {len(found[key])}: expected {count}")
    if len(found["law"]["shares"]) != PARTS:
        count = len(found["law"]["shares"])
        raise InputError(f"band.law.shares is a list of {count}: expected {PARTS}")
    _check_others(found["others"], chain)
    return Band.from_json(found)


def _check_others(found: dict[str, Any] | None, chain: Chain) -> None:
    """Refuse other models that are not of the chain."""
    if found is None:
        return
    models = len(found["offset"])
    if len(found["step"]) != models:
        raise InputError(
            f"band.others.step is a list of {len(found['step'])}: expected {models}, as many as "
            "offset has"
        )
    counts = {
        "weights": chain.plane.cells,
        "offset": 1,
        "added": len(chain.coefficients),
        "parameters": sum(len(effect.parameters()) for effect in chain.effects),
    }
    for key, count in counts.items():
        if len(found[key]) != models:
            raise InputError(
                f"band.others.{key} is a list of {len(found[key])}: expected {models}, as many as "
                "offset has"
            )
        for i, row in enumerate(found[key]):
            if len(row) != count:
                raise InputError(
                    f"band.others.{key}[{i}] is a list of {len(row)}: expected {count}"
                )


_CONTENT = of_keys(
    {
        "hysteron": one_of(*HYSTERONS),
        "levels": whole(2),
        "low": number(),
        "high": number(),
        "thresholds": NotRequired[numbers],
        "offset": number(),
        "weights": numbers,
        "memory": numbers,
        "first_run": numbers,
        "visited": items,
        "effects": list_of({"name": text, "settings": table, "parameters": table_of(_ESTIMATE)}),
        "columns": {"time": text, "input": text, "output": text, "aux": list_of(text)},
        "units": table_of(text),
        "sampling": {"step_s": number(LEAST), "rows": whole(2)},
        "identification": {
            "record": text,
            "sha256": text,
            "rows": whole(2),
            "inputs_sha256": text,
            "start_s": number(),
            "stop_s": number(),
            "step_s": number(LEAST),
            "initial_memory": one_of(*INITIAL_MEMORIES),
            "history": list_of(numbers, least=2),
        },
        "rms_validation": number(0.0),
        "noise": share,
        "discretisation": share,
        "band": _BAND | None,
    }
)
"""What the file of a model holds, apart from what says that it is one."""


def _fields_of(content: dict[str, Any], kinds: Sequence[Effect]) -> dict[str, Any]:
    """The fields from checked content; what belongs together is checked first."""
    _check_plane(content)
    effects = _effects_from(content["effects"], kinds)
    plane = Plane(content["levels"], content["low"], content["high"], content.get("thresholds"))
    weights = content["weights"]
    polarity = -1 if weights.sum() < 0 else 1
    signed = bool((weights < 0).any() and (weights > 0).any())
    chain = Chain(plane, effects, content["hysteron"], polarity, signed)
    parameters = _parameters_from(content["effects"], chain)
    values = {
        effect.name: {
            parameter.name: parameters[effect.name][parameter.name].value
            for parameter in effect.parameters()
        }
        for effect in effects
    }
    added = [parameters[effect][each.name].value for effect, each in chain.coefficients]
    return {
        "chain": chain,
        "values": values,
        "coefficients": Coefficients(
            content["weights"],
            content["memory"],
            content["offset"],
            np.asarray(added),
            content["first_run"],
        ),
        "parameters": parameters,
        "visited": np.array(content["visited"], dtype=bool),
        "columns": content["columns"],
        "units": content["units"],
        "origin": _origin_from(content["identification"]),
        "rms_validation": content["rms_validation"],
        "noise": content["noise"],
        "discretisation": content["discretisation"],
        "band": _band_from(content["band"], chain),
    }


def _check_plane(content: dict[str, Any]) -> None:
    """Refuse limits that are none, and arrays that do not fit the levels."""
    if not content["low"] < content["high"]:
        raise refusal(content["low"], "low", f"a number below high, which is {content['high']}")
    levels = content["levels"]
    cells = levels * (levels + 1) // 2
    counts = {"weights": (cells,), "memory": (cells,), "visited": (cells,)}
    for name, allowed in (counts | {"first_run": (0, 2 * levels)}).items():
        if len(content[name]) not in allowed:
            expected = f"as many numbers as {levels} levels have cells, {cells}"
            if name == "first_run":
                expected = f"two numbers a level, {2 * levels}, or none"
            raise InputError(f"{name} is a list of {len(content[name])}: expected {expected}")
    size = max(abs(content["low"]), abs(content["high"]))
    least = max(LEAST, levels * float(np.spacing(size)))  # thresholds that differ, and their gap
    if content["high"] - content["low"] < least:
        raise refusal(content["high"], "high", f"a number at least {least:.3g} above low")
    for i, visited in enumerate(content["visited"]):
        if visited not in (0, 1):
            raise refusal(visited, f"visited[{i}]", "0 or 1")


def _kinds_of(entries: list[dict[str, Any]], own: Mapping[str, Effect]) -> list[Effect]:
    """One effect of the kind of each entry, of one's own or of the library."""
    known = library() | dict(own) if entries else {}
    kinds: list[Effect] = []
    for entry in entries:
        name = entry["name"]
        kind = known.get(name if name in own else placeholder(name))
        if kind is None:
            raise InputError(
                f"the model holds the effect {name!r:.60}, which this library does not know; pass "
                "it: Model.load(path, effects=[...])"
            )
        kinds.append(kind)
    return kinds


def _effects_from(entries: list[dict[str, Any]], kinds: Sequence[Effect]) -> tuple[Effect, ...]:
    """The effects of a file, with the settings that it gives them."""
    names = [entry["name"] for entry in entries]
    for i, name in enumerate(names):
        if name in names[:i]:
            raise refusal(name, f"effects[{i}].name", "each effect once")
    return tuple(
        _set(kind, entry, f"effects[{i}]")
        for i, (kind, entry) in enumerate(zip(kinds, entries, strict=True))
    )


def _set(pattern: Effect, entry: dict[str, Any], place: str) -> Effect:
    """The effect of a pattern's kind with the settings of a file."""
    is_ours = type(pattern) in BUILT_IN
    most = MOST_COLUMNS if is_ours else sys.maxsize
    fields = pattern.settings()
    for key in entry["settings"]:
        if key not in fields:
            expected = f"one of {', '.join(fields)}" if fields else "none"
            raise InputError(f"{place}.settings has {key!r:.60}: expected {expected}")
    # A time of a built-in effect is above zero; what one's own means by its names is not known.
    least = {key: LEAST if is_ours and key.endswith("_s") else -np.inf for key in fields}
    settings = {
        key: checked(value, like(fields[key], most, least[key]), f"{place}.settings.{key}")
        for key, value in entry["settings"].items()
    }
    try:
        effect = with_settings(pattern, settings, f"{place}.settings")
        declared = [*effect.parameters(), *getattr(effect, "coefficients", tuple)()]
    except (ArithmeticError, ValueError) as error:
        raise InputError(f"{place}.settings are of no {entry['name']}: {error}") from error
    if effect.name != entry["name"]:
        raise refusal(entry["name"], f"{place}.name", f"{effect.name!r:.60}, by its settings")
    checked(
        entry["parameters"],
        {parameter.name: table for parameter in declared},
        f"{place}.parameters",
    )
    return effect


def _parameters_from(
    entries: list[dict[str, Any]], chain: Chain
) -> dict[str, dict[str, ParameterEstimate]]:
    """The estimates of a file; values outside the bounds of their effects are refused."""
    parameters = {
        entry["name"]: {
            name: ParameterEstimate(
                estimate["value"],
                -np.inf if estimate["low"] is None else estimate["low"],
                np.inf if estimate["high"] is None else estimate["high"],
                estimate["unit"],
            )
            for name, estimate in entry["parameters"].items()
        }
        for entry in entries
    }
    for i, effect in enumerate(chain.effects):
        for parameter in effect.parameters():
            place = f"effects[{i}].parameters.{parameter.name}.value"
            value = parameters[effect.name][parameter.name].value
            checked(value, number(float(parameter.low), float(parameter.high)), place)
    return parameters


def _origin_from(content: dict[str, Any]) -> Origin:
    place = "identification.history"
    if len(content["history"]) != 2 or len({len(row) for row in content["history"]}) != 1:
        raise InputError(f"{place} must be two lists of one length: time and input")
    history = np.stack(content["history"])
    if history.shape[1] < 2 or not np.all(np.diff(history[0]) > 0):
        raise InputError(f"{place}[0] must be at least two times, each above the one before")
    if not content["start_s"] < content["stop_s"]:
        raise refusal(content["stop_s"], "identification.stop_s", "a time above start_s")
    remembered: dict[str, Any] = content | {"history": history}
    return Origin(**remembered)

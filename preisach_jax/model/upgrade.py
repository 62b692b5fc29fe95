"""Contents of older model files as contents of the present format, which predict the same.

Each step takes the content of one format version and gives that of the next.  It adds what that
version did not know of, with the numbers that leave every prediction as it was, and looks at no
more than it changes: the content is checked as a whole afterwards.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from preisach_jax.model.schema import checked, items, list_of, table, table_of, text

Content = Mapping[str, Any]

_EFFECTS = {"effects": list_of({"name": text, "settings": table, "parameters": table})}


def upgraded(content: Content, version: int) -> Content:
    """The content of an older model file in the present format.

    Arguments:
        content: what the file holds; it stays as it is.
        version: its format version, from 1 on.

    Returns:
        Content of the present format, of which only what was added is checked.

    Raises:
        InputError: if something on which an addition depends is damaged.

    Example:
        >>> upgraded({"effects": []}, 2)
        {'effects': [], 'first_run': []}
        >>> upgraded({"format_version": 3}, 3)
        {'format_version': 3}
    """
    while version in UPGRADES:
        content = UPGRADES[version](content)
        version += 1
    return content


def _with_starts(content: Content) -> Content:
    """Creep as if at rest before its record, which was all that version 1 knew."""
    unit = checked(content, {"units": table_of(text)})["units"].get("output", "")
    rest = {"value": 0.0, "low": None, "high": None, "unit": unit}
    effects = checked(content, _EFFECTS)["effects"]
    for i, entry in enumerate(effects):
        if entry["name"] == "creep" and set(entry["settings"]) == {"tau_s"}:
            elements = checked(entry["settings"]["tau_s"], items, f"effects[{i}].settings.tau_s")
            starts = {f"start_{k}": rest for k in range(1, len(elements) + 1)}
            entry["parameters"] = {**entry["parameters"], **starts}
    return {**content, "effects": effects}


def _with_first_run(content: Content) -> Content:
    """No hysterons of the first run, and the one form that rate dependence used to have."""
    form = {"with_reversible": True, "with_corners": True}
    effects = checked(content, _EFFECTS)["effects"]
    for entry in effects:
        known = set(entry["settings"])
        if entry["name"] == "rate_dependence" and known == {"reference_per_s", "range_u"}:
            entry["settings"] = {**entry["settings"], **form}
    return {**content, "effects": effects, "first_run": []}


UPGRADES: Mapping[int, Callable[[Content], Content]] = {1: _with_starts, 2: _with_first_run}
"""By the version from which it leads to the next one."""

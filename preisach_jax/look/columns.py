"""What a look says of the columns of a file: their roles, why, and what they hold."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from preisach_jax.record.channels import Channel
from preisach_jax.record.columns import unit_of, why
from preisach_jax.record.table import Table

AUXILIARY = "aux"
"""Role of every column beside time, input and output."""

MOST_COLUMNS = 40
"""Columns of a file that are shown one by one."""


@dataclass(frozen=True)
class ColumnView:
    """A column of a file: its role, `""` if none, why, its unit, and what it holds."""

    name: str
    role: str
    why: str
    unit: str
    kind: str
    low: float | None
    high: float | None


def columns_of(
    table: Table, channels: Mapping[str, Channel], told: Sequence[str] = ()
) -> list[ColumnView]:
    """The columns of a file with their roles and why."""
    roles = {
        channel.name: key if key in ("time", "input", "output") else AUXILIARY
        for key, channel in channels.items()
    }
    views: list[ColumnView] = []
    for name in list(table.columns)[:MOST_COLUMNS]:
        role = roles.get(name, "")
        values = table.lenient_numbers(name)
        finite = values[np.isfinite(values)] if values is not None else np.empty(0)
        kind = "numbers"
        if values is None:
            kind = "text"
        elif not finite.size:
            kind = "empty"
        elif np.all(finite == finite[0]):
            kind = "constant"
        reason = (
            "you named it" if role in (*told, AUXILIARY) else why(table, role, name) if role else ""
        )
        low, high = (float(finite.min()), float(finite.max())) if finite.size else (None, None)
        views.append(ColumnView(name, role, reason, unit_of(table, name), kind, low, high))
    if table.left_aside:
        views += [ColumnView(name, "", why_not, "", "left aside", None, None)
                  for name, why_not in list(table.left_aside.items())[:MOST_COLUMNS]]  # fmt: skip
    return views

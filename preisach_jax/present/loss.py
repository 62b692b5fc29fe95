"""Losses of closed cycles as rows of texts with units."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from preisach_jax.quantity import number, pretty_unit, scaled

if TYPE_CHECKING:
    from preisach_jax.loss import Loss
    from preisach_jax.record import Record

MOST_ROWS = 12
"""Kinds of cycles that are shown; diagnosis.json has all."""


def loss_table(loss: Loss | None, record: Record) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Headers with units, and one row a kind of cycle: those that lose most, the slowest first."""
    if loss is None or not loss.cycles:
        return (), []
    kinds = loss.kinds
    sizes = [abs(kind.model if math.isnan(kind.measured) else kind.measured) for kind in kinds]
    most = sorted(range(len(kinds)), key=lambda k: -sizes[k])[:MOST_ROWS]
    kinds = [kinds[k] for k in sorted(most)]
    units = [record.input_unit, record.output_unit]
    swings = [
        [0.5 * (kind.input_high - kind.input_low) for kind in kinds],
        [0.5 * (kind.output_high - kind.output_low) for kind in kinds],
    ]
    scales = [scaled(max(map(_known, swing)), unit)
              for swing, unit in zip(swings, units, strict=True)]  # fmt: skip
    joules = pretty_unit(loss.unit).replace("m3", "m³")
    sides = [
        f"{side} ±{' (' + unit + ')' if unit else ''}"
        for side, (_, unit) in zip(("input", "output"), scales, strict=True)
    ]
    headers = ("frequency (Hz)", "cycles", *sides, f"measured loss ({joules})",
               f"model ({joules})", "95 % band", "difference %")  # fmt: skip
    rows: list[tuple[str, ...]] = []
    for place, kind in enumerate(kinds):
        shown = [
            _text(factor * swing[place], 4)
            for swing, (factor, _) in zip(swings, scales, strict=True)
        ]
        rows.append(
            (
                number(1 / kind.duration_s, 3),
                str(kind.count),
                *shown,
                _text(kind.measured, 4),
                _text(kind.model, 4),
                f"{_text(kind.low, 4)} to {_text(kind.high, 4)}",
                _text(kind.difference_percent, 2),
            )
        )
    return headers, rows


def loss_lines(loss: Loss | None, record: Record) -> list[str]:
    """The same, a line each."""
    headers, rows = loss_table(loss, record)
    if not rows:
        return []
    widths = [max(map(len, column)) for column in zip(headers, *rows, strict=True)]
    return ["loss per cycle"] + [
        "  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True))
        for row in (headers, *rows)
    ]


def _known(value: float) -> float:
    return 0.0 if math.isnan(value) else value


def _text(value: float, digits: int) -> str:
    return "-" if math.isnan(value) else number(value, digits)

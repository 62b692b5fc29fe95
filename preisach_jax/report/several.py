"""Several comparisons side by side: their table, and what it shows in a sentence."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from preisach_jax.quantity import number, quantity, scaled
from preisach_jax.report.content import shareable, software_rows

if TYPE_CHECKING:
    from preisach_jax.diagnosis.comparison import Comparison

HEADERS = ("", "effects", "RMS error", "% of stroke", "largest", "fit %", "in the model's band")


def several_rows(comparisons: Mapping[str, Comparison]) -> list[tuple[str, ...]]:
    """One row a comparison, below `HEADERS`; errors in one common unit."""
    several = list(comparisons.values())
    units = {each.record.output_unit for each in several}
    factor, unit = scaled(max(each.rms for each in several), several[0].record.output_unit)
    rows: list[tuple[str, ...]] = []
    for name, each in comparisons.items():
        if len(units) > 1:
            factor, unit = scaled(each.rms, each.record.output_unit)
        rows.append(
            (
                name,
                ", ".join(each.effects) or "none",
                f"{number(factor * each.rms, 3)} {unit}".rstrip(),
                number(100 * each.rms / each.record.output_range, 3),
                f"{number(factor * each.max_abs, 3)} {unit}".rstrip(),
                f"{each.fit_percent:.2f}",
                f"{100 * each.tests.inside_band:.0f} %",
            )
        )
    return rows


def several_sentence(comparisons: Mapping[str, Comparison]) -> str:
    """Which comparison leaves least and which most, in shares of the stroke."""
    shares = {name: 100 * each.rms / each.record.output_range for name, each in comparisons.items()}
    least, most = min(shares, key=shares.__getitem__), max(shares, key=shares.__getitem__)
    best, worst = comparisons[least], comparisons[most]
    small = quantity(best.rms, best.record.output_unit, 3)
    great = quantity(worst.rms, worst.record.output_unit, 3)
    text = (
        f"{least} has the smallest error, {small} RMS ({number(shares[least], 3)} % of stroke), "
        f"and {most} the largest, {great} ({number(shares[most], 3)} %)."
    )
    own = [
        name for name, each in comparisons.items() if each.record.sha256 == each.model.origin.sha256
    ]
    if own:
        text += f" Identified on this very record, so no independent test: {', '.join(own)}."
    return text


def several_page(comparisons: Mapping[str, Comparison], command: str | None) -> dict[str, Any]:
    """All that the page of several comparisons says."""
    first = next(iter(comparisons.values()))
    is_one_record = all(e.record.sha256 == first.record.sha256 for e in comparisons.values())
    count = len(comparisons)
    notes = [f"{name}: {note}" for name, each in comparisons.items() for note in each.notes]
    return {
        "title": f"{count} models, {first.record.name}" if is_one_record else f"{count} records",
        "heading": "Models against one record" if is_one_record else "One model against records",
        "sentence": several_sentence(comparisons),
        "notes": notes,
        "headers": HEADERS,
        "rows": several_rows(comparisons),
        "software": software_rows(),
        "command": shareable(command),
    }

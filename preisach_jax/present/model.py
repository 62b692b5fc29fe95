"""A model as rows of texts with units, and as HTML."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from preisach_jax.present import html
from preisach_jax.quantity import interval, number, scaled

if TYPE_CHECKING:
    from preisach_jax.model import Model, ParameterEstimate


def plane_text(model: Model) -> str:
    """Levels, cells and limits of a model's plane, and the signs of its weights if not positive."""
    axis = "output" if model.chain.mechanics else "input"
    plane, unit = model.plane, model.units.get(axis, "")
    factor, shown = scaled(max(abs(plane.low), abs(plane.high)), unit)
    span = f"{number(factor * plane.low)} to {number(factor * plane.high)} {shown}".rstrip()
    falls = ", output falls as the input rises" if model.chain.polarity < 0 else ""
    if model.chain.signed:
        falls = ", weights of both signs"
    return f"{model.chain.size_text}, {plane.cells:,} cells, {axis} from {span}{falls}"


def model_rows(model: Model) -> list[tuple[str, str]]:
    """What a model is made of: plane, cells, effects and the record that it was fitted to."""
    return [
        ("plane", plane_text(model)),
        ("cells visited", f"{100 * model.visited.mean():.0f} %"),
        ("effects", ", ".join(effect.name for effect in model.effects) or "none"),
        ("identified on", f"{model.origin.record}, {model.origin.rows:,} rows"),
    ]


MOST_SHOWN = 8
"""Parameters of one finding that are shown; the model file has all."""


def parameter_rows(
    parameters: Mapping[str, ParameterEstimate], all_in: str = "model.json"
) -> list[tuple[str, str]]:
    """Parameters with their 95 % intervals, as texts; of many the first few, and where all are."""
    rows = [(name, interval(e.value, e.low, e.high, e.unit)) for name, e in parameters.items()]
    if len(rows) <= MOST_SHOWN:
        return rows
    few = MOST_SHOWN // 2
    return [*rows[:few], (f"and {len(rows) - few} more", f"in {all_in}")]


def chain_rows(model: Model) -> list[tuple[str, str, str, str]]:
    """A model in the order in which a signal passes it: place, part, parameter, value."""
    rows: list[tuple[str, str, str, str]] = []
    operator = [("hysteresis", "Preisach operator", "plane", plane_text(model))]
    for effect in model.chain.in_order:
        if effect.place != "input":
            rows += operator
            operator = []
        where, part = str(effect.place), effect.name
        for parameter, value in parameter_rows(
            model.parameters[effect.name], "Model.parameters"
        ) or [("", "")]:
            rows.append((where, part, parameter, value))
            where = part = ""
    return rows + operator


def chain_table(model: Model) -> str:
    """The chain in its order, with parameters and their intervals, as HTML."""
    return html.table(("acts on", "part", "parameter", "value"), chain_rows(model))


def as_html(model: Model) -> str:
    """Line, chain and record of a model, for notebooks."""
    return html.block(
        html.heading(model.line),
        chain_table(model),
        html.sentence(f"Identified on {model.origin.record}, {model.origin.rows:,} rows."),
    )

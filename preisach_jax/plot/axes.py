"""What is drawn along an axis: values in the unit that reads best, and a label that names it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from preisach_jax.diagnosis import residuals as stats
from preisach_jax.model import Model
from preisach_jax.quantity import scaled
from preisach_jax.record.core import Record
from preisach_jax.record.units import split_unit


@dataclass(frozen=True, eq=False)
class Axis:
    """One coordinate of every row of a record.

    Attributes:
        values: (time,) in the unit of the label.
        label: name and unit.
        is_logarithmic: whether a logarithmic scale shows it best.
    """

    values: np.ndarray
    label: str
    is_logarithmic: bool = False


def record_axes(record: Record) -> dict[str, Axis]:
    """What residuals are looked at against, row by row."""
    rate = stats.input_rate(record.time, record.input, record.starts)
    since = stats.time_since_reversal(record.time, record.input, starts=record.starts)
    return {
        "time": Axis(record.time, record.time_label),
        "input": _axis(record.input, record.input_unit, column_name(record, "input")),
        "output": _axis(record.output, record.output_unit, column_name(record, "output")),
        "rate": _axis(rate, record.rate_unit, f"rate of {column_name(record, 'input')}"),
        "since": _axis(
            since, record.time_unit, "time since the input last turned",
            is_logarithmic=bool(since.max() > 100 * record.step_s),
        ),
    }  # fmt: skip


def column_name(record: Record, role: str) -> str:
    """What a column is called on an axis: its role and its name without the unit."""
    own = split_unit(record.channels[role].name)[0]
    return role if own == role else f"{role} {own}"


def with_unit(name: str, unit: str) -> str:
    """A label of a name and its unit, if it has one."""
    return f"{name} ({unit})" if unit else name


def plane_edges(model: Model) -> tuple[np.ndarray, str]:
    """(levels + 1,) borders of a model's cells on either axis, and the unit that they are in."""
    plane = model.plane
    edges = plane.edges
    factor, shown = scaled(greatest(edges), model.units.get("input", ""))
    return factor * edges, shown


def shown_range(model: Model) -> tuple[float, float]:
    """Part of the range of `plane_edges` that is shown: all of it, or where most thresholds lie.

    A narrow steep loop would be a dot on the whole plane.
    """
    edges, _ = plane_edges(model)
    levels = model.plane.levels
    low, high = edges[[levels // 5, levels - levels // 5]]
    low, high = max(edges[0], 2 * low - high), min(edges[-1], 2 * high - low)
    if high - low > (edges[-1] - edges[0]) / 2:
        low, high = edges[0], edges[-1]
    return float(low), float(high)


def shown_density(model: Model) -> np.ndarray:
    """(cells,) weights as they are shown, over the area of their cells in that of `plane_edges`."""
    edges = plane_edges(model)[0]
    factor = (edges[-1] - edges[0]) / (model.plane.high - model.plane.low)
    return shown_weights(model) / (factor**2 * model.plane.areas)


def shown_weights(model: Model) -> np.ndarray:
    """(cells,) weights as they are shown: without their sign where all have the same."""
    return model.weights if model.chain.signed else np.abs(model.weights)


def density_scale(model: Model, values: np.ndarray) -> tuple[float, float, str]:
    """In what a density on the plane is shown, and where its colours end.

    They end at the greatest size off the diagonal α = β, whose reversible cells may hold many
    times as much.

    Arguments:
        values: (cells,) density in the output's unit over the square of that of `plane_edges`; NaN
            where there is none.

    Returns:
        Factor to the unit shown, end of the colours in that unit, and the unit.
    """
    plane, shown = model.plane, plane_edges(model)[1]
    there = ~np.isnan(values) & np.asarray(model.visited, dtype=bool)
    sizes = np.abs(values)
    off_diagonal = sizes[there & (plane.alpha_index != plane.beta_index)]
    top = float(off_diagonal.max(initial=0.0)) or float(sizes[there].max(initial=0.0)) or 1.0
    factor, out_shown = scaled(top, model.units.get("output", ""))
    square = f"{shown}²" if shown and not set(shown) & set("/·²") else f"({shown})²"
    return factor, factor * top, f"{out_shown}/{square}" if shown else out_shown


def greatest(values: np.ndarray) -> float:
    """The greatest magnitude of values that may be missing."""
    return float(np.nanmax(np.abs(values)))


def _axis(values: np.ndarray, unit: str, name: str, *, is_logarithmic: bool = False) -> Axis:
    factor, shown = scaled(greatest(values), unit)
    return Axis(factor * values, with_unit(name, shown), is_logarithmic)

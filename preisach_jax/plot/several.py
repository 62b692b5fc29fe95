"""Several comparisons in one figure: many models of one record, or many records of one model."""

from __future__ import annotations

from collections.abc import Mapping

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from preisach_jax.diagnosis.comparison import Comparison
from preisach_jax.diagnosis.residuals import binned
from preisach_jax.escape import literal
from preisach_jax.look.drawing import extremes
from preisach_jax.plot.axes import column_name, with_unit
from preisach_jax.plot.style import MEASURED, STYLE
from preisach_jax.quantity import scaled

# Okabe and Ito's palette, as far as it differs from the grey of what was measured.
SHADES = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#F0E442")

COLUMNS = 1200
"""Stretches of time whose extremes are drawn."""

MOST_POINTS = 20_000
"""Samples of a loop that are drawn; more are thinned evenly."""


@mpl.rc_context(STYLE)
def overlay(comparisons: Mapping[str, Comparison]) -> Figure:
    """Draw comparisons over each other."""
    several = list(comparisons.values())
    first = several[0]
    is_one_record = all(each.record.sha256 == first.record.sha256 for each in several)
    figure = Figure(figsize=(8.6, 7.4 if is_one_record else 5.8), layout="constrained")
    if is_one_record:
        panels = figure.subplot_mosaic(
            [["time", "time"], ["residual", "residual"], ["loop", "errors"]]
        )
    else:
        panels = figure.subplot_mosaic([["residual", "residual"], ["loop", "errors"]])
    shades = {name: SHADES[k % len(SHADES)] for k, name in enumerate(comparisons)}
    if is_one_record:
        _courses(panels["time"], comparisons, shades)
    _residuals(panels["residual"], comparisons, shades)
    if is_one_record:
        _over_input(panels["loop"], comparisons, shades)
    else:
        _loops(panels["loop"], comparisons, shades)
    _errors(panels["errors"], comparisons, shades)
    handles = [Line2D([], [], color=shade, lw=2) for shade in shades.values()]
    labels = [literal(name) for name in shades]
    if is_one_record:
        handles.append(Line2D([], [], color=MEASURED, lw=2.6))
        labels.append("measured")
    figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 4))
    return figure


def _scale(comparisons: Mapping[str, Comparison], values: list[np.ndarray]) -> tuple[float, str]:
    unit = next(iter(comparisons.values())).record.output_unit
    return scaled(max(float(np.nanmax(np.abs(each))) for each in values), unit)


def _drawn(axes: Axes, time: np.ndarray, values: np.ndarray, shade: str, width: float) -> None:
    columns = max(min(COLUMNS, len(time) // 4), 10)
    middle, low, high = extremes(time, values, columns)
    line = np.ravel(np.stack([low, high], axis=1))
    axes.plot(np.repeat(middle, 2), line, color=shade, lw=width, alpha=0.85)


def _courses(axes: Axes, comparisons: Mapping[str, Comparison], shades: dict[str, str]) -> None:
    record = next(iter(comparisons.values())).record
    factor, unit = _scale(comparisons, [record.output])
    _drawn(axes, record.time, factor * record.output, MEASURED, 2.6)
    for name, each in comparisons.items():
        _drawn(axes, record.time, factor * each.prediction, shades[name], 0.9)
    axes.set_ylabel(literal(with_unit(column_name(record, "output"), unit)))
    axes.tick_params(labelbottom=False)
    axes.set_title(literal(record.name))
    axes.margins(x=0.01)


def _residuals(axes: Axes, comparisons: Mapping[str, Comparison], shades: dict[str, str]) -> None:
    factor, unit = _scale(comparisons, [each.residual for each in comparisons.values()])
    axes.axhline(0, color="0.3", lw=0.7)
    for name, each in comparisons.items():
        time = each.record.time - each.record.time[0]
        _drawn(axes, time, factor * each.residual, shades[name], 0.9)
    axes.set_xlabel("time since the first row (s)")
    axes.set_ylabel(with_unit("residual", unit))
    axes.set_title("Residuals")
    axes.margins(x=0.01)


def _over_input(axes: Axes, comparisons: Mapping[str, Comparison], shades: dict[str, str]) -> None:
    """Median residual of each model over the input, with what 90 % of the samples lie within."""
    record = next(iter(comparisons.values())).record
    factor, unit = _scale(comparisons, [each.residual for each in comparisons.values()])
    across, input_unit = scaled(float(np.max(np.abs(record.input))), record.input_unit)
    axes.axhline(0, color="0.3", lw=0.7)
    for name, each in comparisons.items():
        rows = each.record.measured
        bins = binned(across * each.record.input[rows], factor * each.residual[rows])
        axes.plot(bins.centre, bins.median, color=shades[name], lw=1.4)
        axes.fill_between(bins.centre, bins.low, bins.high, color=shades[name], alpha=0.2, lw=0)
    axes.set_xlabel(literal(with_unit(column_name(record, "input"), input_unit)))
    axes.set_ylabel(with_unit("residual", unit))
    axes.set_title("Residual over the input")


def _loops(axes: Axes, comparisons: Mapping[str, Comparison], shades: dict[str, str]) -> None:
    """What was measured, over the input; the greatest loops beneath the others."""
    records = {name: each.record for name, each in comparisons.items()}
    first = next(iter(records.values()))
    factor, unit = _scale(comparisons, [record.output for record in records.values()])
    along = max(float(np.max(np.abs(record.input))) for record in records.values())
    across, input_unit = scaled(along, first.input_unit)
    for name in sorted(records, key=lambda name: -records[name].output_range):
        record = records[name]
        rows = slice(None, None, max(1, len(record) // MOST_POINTS))
        axes.plot(
            across * record.input[rows], factor * record.output[rows], color=shades[name], lw=0.5,
            alpha=0.7,
        )  # fmt: skip
    axes.set_xlabel(literal(with_unit(column_name(first, "input"), input_unit)))
    axes.set_ylabel(literal(with_unit(column_name(first, "output"), unit)))
    axes.set_title("Measured loops")


def _errors(axes: Axes, comparisons: Mapping[str, Comparison], shades: dict[str, str]) -> None:
    places = list(range(len(comparisons)))
    shares = [100 * each.rms / each.record.output_range for each in comparisons.values()]
    axes.barh(places, shares, color=list(shades.values()), height=0.6)
    for place, share in zip(places, shares, strict=True):
        axes.text(share, place, f" {share:.3g} %", va="center", fontsize=8)
    axes.set_yticks(places, [literal(_shortened(name)) for name in comparisons])
    axes.set_ylim(len(comparisons) - 0.5, -0.5)
    axes.set_xlim(0, 1.25 * max(shares))
    axes.xaxis.set_major_locator(MaxNLocator(5))
    axes.grid(axis="y", visible=False)
    axes.set_xlabel("RMS error (% of stroke)")
    axes.set_title("Errors")


def _shortened(name: str, most: int = 24) -> str:
    return name if len(name) <= most else f"{name[: most - 1]}…"

"""Tracking with more and more of a model's inverse: its error over time, and as a waterfall."""

from __future__ import annotations

from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from preisach_jax.compensation import Loop
from preisach_jax.plot.style import AFTER, BEFORE, MEASURED, STYLE
from preisach_jax.quantity import quantity, scaled

COLOURS = (MEASURED, "#E69F00", BEFORE, AFTER)
LINES = ("-", "--", "-.", "-")

BEGIN = 0.1
"""Share of the course that is taken for its beginning, and not counted."""


@mpl.rc_context(STYLE)
def draw_loop(loop: Loop) -> Figure:
    """The course, the errors over time on a logarithmic scale, and their RMS."""
    figure = Figure(figsize=(8.0, 5.6), layout="constrained")
    axes: Any = figure.subplot_mosaic([["course", "bars"], ["errors", "bars"]], width_ratios=(3, 2))
    begin = BEGIN * float(loop.time[-1] - loop.time[0])
    rms = loop.errors(begin)
    factor, unit = scaled(max(rms.values()), loop.unit)
    _course(axes["course"], loop.time, loop.wanted, loop.unit)
    errors = axes["errors"]
    for (name, reading), colour, line in zip(loop.readings.items(), COLOURS, LINES, strict=True):
        time, error = _envelope(loop.time, np.abs(reading - loop.wanted))
        floor = np.maximum(error, 1e-4 * min(rms.values()) + 1e-12)
        errors.semilogy(time, factor * floor, line, color=colour, label=name)
    errors.set_ylim(bottom=factor * 0.1 * max(min(rms.values()), 1e-6 * max(rms.values())))
    errors.set(xlabel="time (s)", ylabel=f"error ({unit})".replace(" ()", ""))
    errors.set_title("Largest error around each instant")
    errors.set_ylim(top=40 * errors.get_ylim()[1])
    errors.legend(ncols=2, loc="upper right")
    bars = axes["bars"]
    places = np.arange(len(rms))[::-1]
    values = factor * np.array(list(rms.values()))
    bars.barh(places, values, color=COLOURS, height=0.6)
    bars.set_xscale("log")
    bars.set_xlim(values.min() / 3, values.max() * 60)
    bars.set_yticks(places, list(rms))
    bars.grid(visible=False, axis="y")
    for place, name, value in zip(places, rms, values, strict=True):
        bars.annotate(
            quantity(rms[name], loop.unit, 3), (value, place), (4, 0),
            textcoords="offset points", va="center",
        )  # fmt: skip
    bars.set(xlabel=f"RMS tracking error ({unit})".replace(" ()", ""))
    bars.set_title("Error after each step of the inversion")
    return figure


def _course(axes: Any, time: np.ndarray, wanted: np.ndarray, unit: str) -> None:
    axes.plot(time, wanted, color=MEASURED, label="wanted")
    axes.set(ylabel=f"output ({scaled(0.0, unit)[1]})".replace(" ()", ""))
    axes.set_title("Wanted output")


def _envelope(
    time: np.ndarray, values: np.ndarray, bins: int = 200
) -> tuple[np.ndarray, np.ndarray]:
    """Greatest value in each of some stretches of time."""
    starts = np.unique(
        np.linspace(0, len(values), min(bins, len(values)), endpoint=False, dtype=int)
    )
    return time[starts], np.maximum.reduceat(values, starts)

"""Figures of measurement and models: over time, and as loops."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from preisach_jax.escape import literal
from preisach_jax.plot.style import STYLE
from preisach_jax.plot.traces import (
    Trace,
    Traces,
    add_legend,
    draw_course,
    draw_loop,
    record_of,
    worst_stretch,
)
from preisach_jax.quantity import quantity


@mpl.rc_context(STYLE)
def measured_and_model(traces: Traces) -> Figure:
    """Measured output and model over time: the whole record, and where the error is greatest."""
    record = record_of(traces)
    figure = Figure(figsize=(8.2, 6.6), layout="constrained")
    whole, zoom, rest = figure.subplots(3, 1, height_ratios=[1, 1.15, 0.85])
    rows = worst_stretch(traces)
    draw_course(whole, traces, slice(0, len(record.time)), "output")
    whole.set_title("Whole record")
    whole.axvspan(
        record.time[rows.start], record.time[rows.stop - 1], facecolor="none", edgecolor="0.2",
        lw=1.2, zorder=5,
    )  # fmt: skip
    whole.set_xlabel("")
    draw_course(zoom, traces, rows, "output")
    zoom.set_title("The framed part, where the error is largest")
    zoom.set_xlabel("")
    draw_course(rest, traces, rows, "residual")
    rest.set_title("Its residual (measured minus model)")
    add_legend(figure, traces, measured=True)
    return figure


@mpl.rc_context(STYLE)
def where_it_errs_most(traces: Traces) -> Figure:
    """Measured output and models over the stretch of the greatest error, and what they leave."""
    figure = Figure(figsize=(8.2, 4.1), layout="constrained")
    upper, lower = figure.subplots(2, 1, height_ratios=[1.3, 1], sharex=True)
    rows = worst_stretch(traces)
    draw_course(upper, traces, rows, "output")
    draw_course(lower, traces, rows, "residual")
    upper.set_xlabel("")
    lower.set_xlabel("time (s)")
    add_legend(figure, traces, measured=True)
    return figure


@mpl.rc_context(STYLE)
def loop(traces: Traces) -> Figure:
    """Output against input: the whole record as measured, and with models where they err most."""
    record = record_of(traces)
    figure = Figure(figsize=(8.2, 4.0), layout="constrained")
    whole, zoom = figure.subplots(1, 2)
    draw_loop(whole, record, {}, slice(0, len(record.time)), width=0.6)
    whole.set_title("Loops as measured, whole record")
    draw_loop(zoom, record, traces, worst_stretch(traces))
    zoom.set_title("Loops where the error is largest")
    add_legend(figure, traces, measured=True, held_out=False)
    return figure


@mpl.rc_context(STYLE)
def overview(fit: Trace) -> Figure:
    """One simulation at a glance: over time, as a loop, and its residual."""
    traces = {"model": fit}
    everything = slice(0, len(fit.record.time))
    figure = Figure(figsize=(8.2, 6.0), layout="constrained")
    panels = figure.subplot_mosaic([["time", "time"], ["loop", "residual"]], height_ratios=[1, 1.2])
    draw_course(panels["time"], traces, everything, "output")
    draw_loop(panels["loop"], fit.record, traces, everything)
    draw_course(panels["residual"], traces, everything, "residual")
    error = np.sqrt(np.nanmean(fit.residual[fit.validation] ** 2))
    rms = quantity(float(error), fit.record.output_unit, 3)
    panels["residual"].set_title(f"Residual; {rms} RMS held out")
    title = "Preisach model" + "".join(f" + {name}" for name in fit.effects)
    panels["time"].set_title(literal(f"{fit.record.name}: {title}"))
    add_legend(figure, traces, measured=True)
    return figure

"""Figures of a diagnosis: errors, effects that were tried, what remains and its form."""

from __future__ import annotations

from textwrap import wrap

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from preisach_jax.diagnosis.form import LABEL, SparseForm
from preisach_jax.diagnosis.remainder import Relation
from preisach_jax.diagnosis.result import MOST_RELATIONS, Diagnosis
from preisach_jax.errors import InputError
from preisach_jax.plot.axes import greatest, with_unit
from preisach_jax.plot.style import AFTER, BEFORE, FLOOR, MEASURED, REFUSED, STYLE
from preisach_jax.quantity import change, number, scaled


@mpl.rc_context(STYLE)
def waterfall(found: Diagnosis) -> Figure:
    """Held-out error against effects added, with the floor of noise and discretisation."""
    errors = np.array([rung.rms_validation for rung in found.rungs])
    names = [rung.name.replace(" ", "\n") for rung in (*found.memoryless, found.ladder[0])]
    base = len(found.memoryless)
    for fewer, more in zip(found.ladder, found.ladder[1:], strict=False):
        added = [name for name in more.effects if name not in fewer.effects]
        names.append("\n".join(f"+ {name}" for name in added) or "refitted")
    floor = float(np.hypot(found.budget.noise, found.budget.discretisation))
    factor, unit = scaled(errors[base:].max(), found.budget.unit)
    errors, floor = factor * errors, factor * floor
    least = min(errors.min(), floor) if floor > 0 else errors.min()
    logarithmic = bool(errors.max() > 10 * max(least, 1e-300))
    width = min(4.2 + 1.1 * len(errors), 11)
    figure = Figure(figsize=(width, 3.6), layout="constrained")
    axes = figure.add_subplot()
    bottom = 0.3 * least if logarithmic else 0.0  # two lines of text have room
    for place, error in enumerate(errors):
        shade = AFTER if place > base else BEFORE
        axes.bar(place, error - bottom, bottom=bottom, width=0.62, color=shade, zorder=2)
        label = f"{number(error, 3)} {unit}".rstrip()
        if place:
            saved = errors[place - 1] - error
            axes.bar(
                place, saved, bottom=error, width=0.62, color="none",
                edgecolor=AFTER, linestyle=":", hatch="///", alpha=0.35, zorder=2,
            )  # fmt: skip
            axes.plot([place - 0.69, place + 0.31], [errors[place - 1]] * 2, color="0.4", lw=0.8)
            label += f"\n{change(-100 * saved / errors[place - 1])}"
        inside = logarithmic or error > 0.2 * errors.max()
        box = {"facecolor": shade, "lw": 0, "pad": 1} if inside else None
        axes.annotate(
            label, (place, error), xytext=(0, -4 if inside else 4), textcoords="offset points",
            ha="center", va="top" if inside else "bottom", color="white" if inside else "black",
            fontsize=8.5, zorder=6, bbox=box,
        )  # fmt: skip
    if floor > 0:
        axes.axhline(floor, color=FLOOR, lw=1.8, ls="--", zorder=5)
        axes.annotate(
            f"noise and\ndiscretisation\n{number(floor, 3)} {unit}".rstrip(), (1.01, floor),
            xycoords=("axes fraction", "data"), color=FLOOR, va="center", fontsize=8.5,
        )  # fmt: skip
    if logarithmic:
        axes.set_yscale("log")
        axes.set_ylim(bottom, 1.25 * errors.max())
        axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.yaxis.set_major_formatter(_plain_number)
        axes.yaxis.set_minor_formatter(NullFormatter())
    else:
        axes.set_ylim(0, 1.08 * max(errors.max(), floor))
    axes.set_xlim(-0.6, len(errors) - 0.4)
    axes.set_xticks(range(len(names)), names)
    axes.grid(axis="x", visible=False)
    axes.set_ylabel(f"held-out error, RMS ({unit})" if unit else "held-out error, RMS")
    axes.set_title("Error of the model as effects are added")
    return figure


@mpl.rc_context(STYLE)
def candidates(found: Diagnosis) -> Figure:
    """Gain of the effects that were tried, and why each was added or not.

    Those that were fitted are drawn; a table has the others too.
    """
    fitted = [each for each in found.candidates if np.isfinite(each.rms_validation)]
    tried = sorted(fitted, key=lambda c: (c.step, not c.accepted, -c.gain))
    reasons = ["\n".join(wrap("added" if c.accepted else c.why_not, 62)) for c in tried]
    places: list[float] = []
    headings: list[tuple[float, int]] = []
    place = 0.0
    for position, (candidate, reason) in enumerate(zip(tried, reasons, strict=True)):
        if not position or candidate.step != tried[position - 1].step:
            place += 0.35 if position else 0.0
            headings.append((place, candidate.step))
            place += 0.9
        places.append(place + 0.25 * reason.count("\n"))
        place += 1.0 + 0.5 * reason.count("\n")
    figure = Figure(figsize=(10.8, 1.1 + 0.27 * max(place, 2)), layout="constrained")
    axes, beside = figure.subplots(1, 2, width_ratios=(5, 4), sharey=True)
    gains = np.array([100 * c.gain for c in tried])
    lowest = -20.0 if np.any(gains < 0) else 0.0
    for y, gain, candidate, reason in zip(places, gains, tried, reasons, strict=True):
        shade = AFTER if candidate.accepted else REFUSED
        axes.barh(y, max(gain, lowest), height=0.7, color=shade)
        beyond = "< " if gain < lowest else ""
        shown = lowest if gain < lowest else gain
        axes.annotate(
            f"{beyond}{shown:z.1f} %", (max(shown, 0), y), xytext=(4, 0),
            textcoords="offset points", va="center", fontsize=8, in_layout=False,
        )  # fmt: skip
        beside.annotate(
            reason, (0, y), xycoords=("axes fraction", "data"), va="center", fontsize=8,
            color="black" if candidate.accepted else "0.35", in_layout=False,
        )  # fmt: skip
    for y, step in headings:
        onto = " + ".join(found.effects[:step])
        text = f"on the model with {onto}" if onto else "on the model without effects"
        axes.annotate(
            text, (0, y), xycoords=("axes fraction", "data"), va="center", fontsize=8.5,
            fontweight="bold", annotation_clip=False, in_layout=False,
        )  # fmt: skip
    beside.set_axis_off()
    axes.set_yticks(places, [c.effect for c in tried])
    axes.set_ylim(place + 0.1, -0.5)
    axes.set_xlim(lowest, 115)
    axes.set_xticks(np.arange(lowest, 101, 20))
    axes.grid(axis="y", visible=False)
    axes.set_xlabel("decrease of the held-out mean square (%)")
    axes.set_title("Effects that were tried")
    return figure


def _plain_number(value: float, position: float) -> str:
    del position  # which tick it is does not matter
    return number(value)


def drawn(found: Diagnosis) -> list[Relation]:
    """The relations of a diagnosis that have a picture."""
    return [relation for relation in found.remainder[:MOST_RELATIONS] if len(relation.mean)]


@mpl.rc_context(STYLE)
def remainder(found: Diagnosis) -> Figure:
    """The mean remainder over each quantity that it goes with."""
    relations = drawn(found)
    columns = min(len(relations), 2)
    rows = -(-len(relations) // 2)
    figure = Figure(figsize=(4.1 * columns, 2.6 * rows + 0.4), layout="constrained")
    factor, unit = scaled(
        max(float(np.abs(each.mean).max()) for each in relations), found.budget.unit
    )
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes, relation in zip(panels, relations, strict=False):
        _panel(axes, relation, factor)
        axes.set_ylabel(with_unit("mean remainder", unit))
    for axes in panels[len(relations) :]:
        axes.set_axis_off()
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


def _panel(axes: Axes, relation: Relation, factor: float) -> None:
    axes.axhline(0.0, color=MEASURED, lw=0.8)
    band = factor * relation.band
    axes.fill_between(
        relation.position, -band, band, color=MEASURED, alpha=0.3, lw=0, label="by chance (99 %)"
    )
    axes.plot(
        relation.position, factor * relation.mean, color=AFTER, marker="o", ms=3,
        label="mean of a part of the rows",
    )  # fmt: skip
    side = ", along the move" if relation.along_move else ""
    axes.set_title(f"{100 * relation.share:.0f} % of its power{side}")
    axes.set_xlabel(with_unit(relation.quantity, relation.unit))


@mpl.rc_context(STYLE)
def dependence(form: SparseForm) -> Figure:
    """The mean remainder over the leading term of a form."""
    shown = form.dependence
    if shown is None:
        raise InputError(f"{form!r} has no terms to draw; give a form that is offered")
    factor, unit = scaled(greatest(shown.remainder), form.unit)
    along, unit_along = scaled(greatest(shown.position), shown.unit)
    figure = Figure(figsize=(5.2, 3.3), layout="constrained")
    axes = figure.add_subplot()
    axes.axhline(0.0, color=MEASURED, lw=0.8)
    axes.plot(
        along * shown.position, factor * shown.remainder, color=BEFORE, marker="o", ms=4, ls="",
        label="measured minus model",
    )  # fmt: skip
    axes.plot(along * shown.position, factor * shown.form, color=AFTER, label="the form")
    axes.set_xlabel(with_unit(shown.label, unit_along))
    axes.set_ylabel(with_unit("mean remainder", unit))
    axes.set_title(f"Remainder over the leading term ({LABEL})")
    axes.legend()
    return figure

"""What a form says: the remainder over its leading term, or a learned term over its states."""

from __future__ import annotations

from textwrap import wrap

import matplotlib as mpl
from matplotlib.figure import Figure

from preisach_jax.diagnosis.form import SparseForm
from preisach_jax.diagnosis.learned import LearnedTerm
from preisach_jax.diagnosis.state import LABEL
from preisach_jax.errors import InputError
from preisach_jax.plot.axes import greatest, with_unit
from preisach_jax.plot.style import AFTER, BEFORE, FLOOR, MEASURED, STYLE
from preisach_jax.quantity import quantity, scaled

LABEL_WIDTH = 32
"""Characters of a line below a panel."""


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


@mpl.rc_context(STYLE)
def curves(term: LearnedTerm) -> Figure:
    """How a learned term depends on the states that matter most."""
    if not term.curves:
        raise InputError(f"the learned term has no curves to draw ({term.why_not}); give another")
    courses = [course for each in term.curves for course in (each.mean, each.low, each.high)]
    factor, unit = scaled(max(greatest(course) for course in courses), term.unit)
    figure = Figure(figsize=(3.4 * len(term.curves), 3.3), layout="constrained")
    panels = figure.subplots(1, len(term.curves), sharey=True, squeeze=False)[0]
    for axes, curve in zip(panels, term.curves, strict=True):
        along, unit_along = scaled(greatest(curve.position), curve.state.unit)
        beside = curve.beside
        axes.axhline(0.0, color=MEASURED, lw=0.8)
        axes.plot(along * curve.position, factor * curve.mean, color=AFTER, label="mean")
        for value, course, colour, dashes in (
            (curve.beside_low, curve.low, BEFORE, "--"),
            (curve.beside_high, curve.high, FLOOR, "-."),
        ):
            label = f"{beside.symbol} = {quantity(value, beside.unit, 2)}"
            axes.plot(along * curve.position, factor * course, dashes, color=colour, label=label)
        name = f"{curve.state.symbol}: {curve.state.name}"
        axes.set_xlabel("\n".join(wrap(with_unit(name, unit_along), LABEL_WIDTH)))
        axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, columnspacing=1.0,
                    handlelength=1.6, borderaxespad=0.2)  # fmt: skip
    panels[0].set_ylabel(with_unit("learned term", unit))
    figure.suptitle(f"The learned term ({LABEL})", x=0.01, ha="left", weight="bold")
    return figure

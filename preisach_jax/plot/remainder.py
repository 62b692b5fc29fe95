"""What the remainder of a model goes with: one panel a quantity, with the band of chance."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from preisach_jax.diagnosis.remainder import Relation
from preisach_jax.diagnosis.result import MOST_RELATIONS, Diagnosis
from preisach_jax.plot.axes import with_unit
from preisach_jax.plot.style import AFTER, MEASURED, STYLE
from preisach_jax.quantity import scaled


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

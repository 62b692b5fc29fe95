"""What a sparse form says: the remainder over its leading term, and what the form takes away."""

from __future__ import annotations

import matplotlib as mpl
from matplotlib.figure import Figure

from preisach_jax.diagnosis.form import LABEL, SparseForm
from preisach_jax.errors import InputError
from preisach_jax.plot.axes import greatest, with_unit
from preisach_jax.plot.style import AFTER, BEFORE, MEASURED, STYLE
from preisach_jax.quantity import scaled


@mpl.rc_context(STYLE)
def dependence(form: SparseForm) -> Figure:
    """The mean remainder over the leading term of a form.

    Arguments:
        form: a form that is offered.

    Returns:
        The figure: means over parts of equal numbers of rows, of measured minus model and of what
        the form takes away.

    Raises:
        InputError: if the form has no terms.

    Example:
        >>> dependence(pj.find_form(found))  # doctest: +SKIP
    """
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

"""Figures show the numbers of the results, with units, and leave matplotlib as it was."""

from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.colors import to_hex
from stand_ins import make_diagnosis, make_fit, make_model, make_record

from preisach_jax import plot
from preisach_jax.effects.creep import Creep


@pytest.fixture(scope="module")
def found():
    return make_diagnosis()


def texts(figure: Any) -> str:
    """All texts of a figure."""
    found = [text.get_text() for axes in figure.axes for text in axes.texts]
    found += [text.get_text() for legend in figure.legends for text in legend.get_texts()]
    for axes in figure.axes:
        found += [axes.get_title(loc="left"), axes.get_xlabel(), axes.get_ylabel()]
    return "\n".join(found)


def bars(axes: Any) -> list[Any]:
    """The bars of an axis; matplotlib declares them as patches of any form."""
    return list(axes.patches)


def test_waterfall_bars_stand_for_the_held_out_errors(found):
    (axes,) = plot.waterfall(found).axes
    tops = [bar.get_y() + bar.get_height() for bar in bars(axes)]
    # in nm, as the greatest is 0.6 um; between the models, the bars of what was saved
    np.testing.assert_allclose(tops, [600, 210, 600, 31, 210])
    assert axes.get_yscale() == "log"
    assert "(nm)" in axes.get_ylabel()
    floor = next(line for line in axes.lines if to_hex(line.get_color()).upper() == plot.FLOOR)
    np.testing.assert_allclose(np.asarray(floor.get_ydata(), dtype=float), 20.0)
    names = [label.get_text() for label in axes.get_xticklabels()]
    assert names[1:] == ["+ creep", "+ drift"]
    assert "−65 %" in texts(axes.figure)


def test_axes_carry_units(found):
    traces = plot.before_and_after(found)
    time, drive, rate, output, since = plot.residuals(traces).axes
    assert [a.get_xlabel().rpartition("(")[2] for a in (time, drive, rate, output, since)] == [
        "s)", "V)", "V/s)", "µm)", "ms)",
    ]  # fmt: skip
    assert all(a.get_ylabel() == "residual (µm)" for a in (time, drive, rate, output, since))
    whole = plot.measured_and_model(traces).axes[0]
    assert whole.get_ylabel() == "output (µm)"
    figure = plot.density(found.model)
    assert figure.axes[0].get_xlabel() == "switching-off threshold β (V)"
    assert figure.axes[1].get_ylabel() == "density (nm/V²)"


def test_held_out_blocks_are_shaded():
    fit = make_fit(make_record())
    axes = plot.measured_and_model({"model": fit}).axes[0]
    shaded = [
        (patch.get_x(), patch.get_x() + patch.get_width())
        for patch in bars(axes)
        if to_hex(patch.get_facecolor()).upper() == plot.HELD_OUT
    ]
    inside = np.zeros(len(fit.record), dtype=bool)
    for begin, end in shaded:
        inside |= (fit.record.time >= begin) & (fit.record.time <= end)
    np.testing.assert_array_equal(inside & fit.record.measured, fit.validation)


def test_density_is_weight_over_area_and_unvisited_cells_are_hatched():
    model = make_model(levels=4)
    figure = plot.density(model)
    collections: list[Any] = list(figure.axes[0].collections)
    shown, hatched = collections[:2]
    area = (100 / 4) ** 2
    values = np.ma.filled(shown.get_array(), np.nan) / 1e3  # nm to um
    expected = model.plane.matrix(np.where(model.visited, model.weights / area, np.nan))
    np.testing.assert_allclose(values, expected)
    assert hatched.get_hatch()
    assert np.sum(~np.ma.getmaskarray(hatched.get_array())) == np.sum(~model.visited)
    assert "never visited by this record (20 % of the cells)" in texts(figure)


def test_candidates_show_gain_and_reason(found):
    axes, _ = plot.candidates(found).axes
    widths = [bar.get_width() for bar in bars(axes)]
    np.testing.assert_allclose(widths, [87.8, 41.0, -20.0, 97.8, 1.0])
    shown = texts(axes.figure)
    assert "creep does more" in shown
    assert "< -20.0 %" in shown
    assert "on the model with creep + drift" in shown
    blue = [to_hex(bar.get_facecolor()).upper() == plot.AFTER for bar in bars(axes)]
    assert blue == [True, False, False, True, False]


def test_figures_of_odd_records_can_be_drawn_and_settings_of_matplotlib_are_left_alone():
    before = dict(mpl.rcParams)
    name = r"$\frac{x}{$ <b>&</b> Weg [µm]"
    record = make_record(60, units={}, name=name)
    fit = make_fit(record, (Creep(),))
    for figure in (plot.overview(fit), plot.loop({name: fit}), plot.residual_tests({name: fit})):
        assert plot.png(figure).startswith(b"\x89PNG")
    assert dict(mpl.rcParams) == before

"""The paper's figures can be read: units on their axes, type large enough, nothing on top."""

import itertools
import json

import matplotlib as mpl
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from preisach_jax.errors import InputError
from preisach_jax.plot.paper import FIGURES, PRINT, figures

SWEEPS = ("8", "11")
"""Figures of sweeps that take long to compile; figure 9 is of one as well."""


def marked(number):
    return pytest.param(number, marks=[pytest.mark.campaign] * (number in SWEEPS))


@pytest.fixture(scope="module", params=map(marked, FIGURES))
def drawn(request):
    """A figure from short records, drawn as it is for a file, with its data."""
    one = FIGURES[request.param]
    data = one.data(**one.quick)
    figure = one.draw(data)
    with mpl.rc_context(PRINT):
        FigureCanvasAgg(figure).draw()
    return request.param, data, figure


def tick_labels(axis):
    """Labels of the ticks that are in view; matplotlib keeps others that it does not draw."""
    low, high = sorted(axis.get_view_interval())
    ticks = zip(axis.get_major_ticks(), axis.get_majorticklocs(), strict=True)
    return [
        tick.label1 for tick, place in ticks if low <= place <= high and tick.label1.get_visible()
    ]


def texts_of(figure):
    found = [text for axes in figure.axes for text in axes.texts]
    found += [text for legend in figure.legends for text in legend.get_texts()]
    for axes in figure.axes:
        if axes.axison:
            found += [axes.xaxis.label, axes.yaxis.label, axes._left_title]
            found += [label for axis in (axes.xaxis, axes.yaxis) for label in tick_labels(axis)]
        legend = axes.get_legend()
        found += legend.get_texts() if legend else []
    return [text for text in found if text.get_text()]


def test_axes_have_labels_with_units_in_type_that_is_large_enough(drawn):
    number, _, figure = drawn
    shown = [axes for axes in figure.axes if axes.axison]
    assert bool(shown) != (number in ("2", "3"))
    for axes in shown:
        sharing = axes.get_shared_x_axes().get_siblings(axes)
        assert any(other.get_xlabel() for other in sharing)
        assert any(other.get_ylabel() for other in axes.get_shared_y_axes().get_siblings(axes))
        for label in (axes.get_xlabel(), axes.get_ylabel()):
            plain = label in {"", "recursion", "levels N"} or "/ W" in label
            assert plain or "(" in label, label
    assert min(text.get_fontsize() for text in texts_of(figure)) >= 7.0


def test_no_two_texts_overlap(drawn):
    number, _, figure = drawn
    renderer = FigureCanvasAgg(figure).get_renderer()
    boxes = [
        (text.get_text(), text.get_window_extent(renderer).shrunk(0.9, 0.8))
        for text in texts_of(figure)
        if text.get_visible()
    ]
    boxes = [(text, box) for text, box in boxes if box.width > 0]
    for (text, box), (other, its) in itertools.combinations(boxes, 2):
        assert not box.overlaps(its), f"figure {number}: {text!r} on {other!r}"


def test_chosen_figures_are_written(tmp_path):
    paths = figures(tmp_path / "out", ["7", "1"], quick=True)
    names = [path.name for path in paths]
    kinds = ("pdf", "png", "json")
    assert names == [f"figure_{n}_quick.{kind}" for n in ("07", "01") for kind in kinds]
    assert all(path.stat().st_size > 500 for path in paths)
    content = json.loads((tmp_path / "out" / "figure_07_quick.json").read_text())
    assert content["figure"] == 7
    assert content["title"] == FIGURES["7"].title
    assert content["caption"].startswith("Measurement and adaptive filter, N = 37")
    assert len(content["time_s"]) == len(content["model_um"]) == 400


def test_unknown_figures_are_refused_before_the_work(tmp_path):
    with pytest.raises(InputError, match="there is no figure 12: choose from 1, 2, 3"):
        figures(tmp_path / "out", ["1", "12"])
    assert not (tmp_path / "out").exists()

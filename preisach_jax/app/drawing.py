"""How the figures of the page look: their style at every width, their ranges and their legends."""

from __future__ import annotations

from typing import Any

import numpy as np
from bokeh.models import BoxSelectTool
from bokeh.plotting import figure

CHOSEN = "#CC79A7"
"""Colour of what is brushed: one of Okabe and Ito's that no curve has."""

DRAWING = ":host { filter: var(--plots); }"
"""Style of a figure: dark mode turns its light and dark over and keeps its hues."""

NARROW = "@media (max-width: 999px)"
"""The window is a phone's or a tablet's: one column, which scrolls as a whole."""

GRID = NARROW + " { :host { flex-direction: column !important; } }"
"""Style of figures side by side, which stand below each other on a phone."""

INK = ":host, .bk-slider-title, .bk-clearfix { color: var(--ink); }"
"""Style of texts beside the figures."""

PLOTS = f"""
:host {{ flex: 1 1 20rem !important; min-width: 0 !important;
  height: max(540px, calc(100vh - 21rem)) !important; }}
{NARROW} {{ :host {{ width: 100% !important; height: 1180px !important; }} }}
"""
"""Style of all figures together: they fill what the window leaves."""


def drawn_figure(title: str, x: str, y: str, **options: Any) -> Any:
    """A figure in the page's style."""
    settings: dict[str, Any] = {
        "tools": "pan,wheel_zoom,box_zoom,reset,save", "sizing_mode": "stretch_both",
        "min_width": 240, "min_height": 240,
    }  # fmt: skip
    drawn: Any = figure(
        title=title, x_axis_label=unformatted(x), y_axis_label=unformatted(y),
        stylesheets=[DRAWING], **(settings | options),
    )  # fmt: skip
    drawn.toolbar.update(logo=None, autohide=False)
    drawn.title.text_font_size = "13px"
    return drawn


def brushed(drawn: Any) -> Any:
    """A figure in which a drag of the mouse chooses rows: a stretch of time, or a rectangle."""
    brush = BoxSelectTool(dimensions="width" if drawn.title.text == "Time" else "both")
    brush.description = "Choose rows"
    brush.renderers = []  # what is chosen is shown by glyphs of its own, and alike in all views
    drawn.add_tools(brush)
    drawn.toolbar.active_drag = brush
    return drawn


def keep_ranges(drawn: Any) -> None:
    """Let the ranges of a figure follow what it shows now, and nothing that is added later.

    What is chosen is added then, on a layer of its own: a brush draws that layer anew, not curves.
    It has no place in a legend, which is drawn with the curves.
    """
    for shown in (drawn.x_range, drawn.y_range):
        shown.renderers = list(drawn.renderers)


def place_legend(drawn: Any, place: str) -> None:
    """Put the legend of a figure where it hides little; a click on a name hides its curve."""
    drawn.legend.update(
        location=place, click_policy="hide", label_text_font_size="11px", padding=4,
        background_fill_alpha=0.75, spacing=0, glyph_height=14,
    )  # fmt: skip


def span(shown: Any, start: float, end: float) -> None:
    """Show a range, also when the view is reset."""
    shown.update(start=start, end=end, reset_start=start, reset_end=end)


def limits_of(values: np.ndarray) -> tuple[float, float]:
    """Ends of an axis with a little room beside its values."""
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    return low - 0.03 * (high - low), high + 0.03 * (high - low)


def unformatted(text: str) -> str:
    """A text of which nothing is taken for a formula: Bokeh's begin with two dollar signs."""
    return text.replace("$$", "$ $").replace("\\(", "( ").replace("\\[", "[ ")

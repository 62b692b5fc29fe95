"""How all figures look, and their files."""

from __future__ import annotations

import io
import warnings
from collections.abc import Generator
from contextlib import contextmanager
from typing import Any

import matplotlib as mpl
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.font_manager import fontManager

# Okabe and Ito's palette, which colour-blind readers can tell apart.
MEASURED = "#8C8C8C"
BEFORE = "#D55E00"
AFTER = "#0072B2"
FLOOR = "#009E73"
REFUSED = "#B0B0B0"
HELD_OUT = "#F0E442"

OTHER_SCRIPTS = (
    "Noto Sans CJK SC", "Noto Sans CJK JP", "WenQuanYi Zen Hei", "Microsoft YaHei", "SimHei",
    "PingFang SC", "Yu Gothic", "MS Gothic", "Hiragino Sans", "Malgun Gothic",
)  # fmt: skip
"""Fonts for names that DejaVu Sans has no letters for, where one is installed."""

STYLE: dict[Any, Any] = {
    "figure.dpi": 110,
    "font.family": ["DejaVu Sans", *sorted({*OTHER_SCRIPTS} & {*fontManager.get_font_names()})],
    "font.size": 9,
    "axes.titlesize": 10,
    "axes.titlelocation": "left",
    "axes.titleweight": "bold",
    "axes.titley": 1.0,  # else matplotlib measures all ticks again to place each title
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.formatter.useoffset": False,
    "grid.color": "#E4E4E4",
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "legend.fontsize": 8,
    "lines.linewidth": 1.1,
    "svg.hashsalt": "preisach",
    "pdf.fonttype": 42,  # letters as outlines of a font, which printers take and readers can search
    "hatch.linewidth": 0.5,
}


def _lay_out(figure: Figure) -> None:
    """Find the layout of a figure now and keep it.

    Matplotlib finds the layout anew, and draws once in vain, for each file that it saves.
    """
    engine = figure.get_layout_engine()
    if engine is not None:
        for axes in figure.axes:
            for spine in axes.spines.values():  # to be measured, each has all ticks updated again
                spine.set_in_layout(False)
        engine.execute(figure)
        figure.set_layout_engine("none")


@contextmanager
def _styled() -> Generator[None]:
    """How files of figures are drawn; letters that no font has are boxes, without a word."""
    with mpl.rc_context(STYLE), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from font")
        yield


@contextmanager
def _resolution(figure: Figure, dpi: int) -> Generator[None]:
    """Dots an inch of what is drawn inside."""
    usual = figure.dpi
    figure.set_dpi(dpi)
    try:
        yield
    finally:
        figure.set_dpi(usual)


# `savefig` draws every figure twice, the first time to find a layout: files of a report are drawn
# by the canvas itself.


@_styled()
def svg(figure: Figure) -> str:
    """A figure as the text of an SVG file; equal figures give equal texts."""
    stream = io.StringIO()
    _lay_out(figure)
    with _resolution(figure, 150):
        metadata = {"Date": None, "Creator": "preisach_jax"}
        FigureCanvasSVG(figure).print_svg(stream, metadata=metadata)
    return stream.getvalue()


@_styled()
def pdf(figure: Figure) -> bytes:
    """A figure as the bytes of a PDF file; equal figures give equal bytes."""
    stream = io.BytesIO()
    unsaid = {"CreationDate": None, "Creator": None, "Producer": "preisach_jax"}
    figure.savefig(stream, format="pdf", dpi=300, metadata=unsaid)
    return stream.getvalue()


@_styled()
def png(figure: Figure, dpi: int = 140) -> bytes:
    """A figure as the bytes of a PNG file."""
    stream = io.BytesIO()
    _lay_out(figure)
    with _resolution(figure, dpi):
        FigureCanvasAgg(figure).print_png(stream, metadata={"Software": "preisach_jax"})
    return stream.getvalue()

"""Pictures of the benchmark, in colours that colour-blind readers can tell apart."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

VERDICTS = ("adequate", "unexplained")
# Okabe and Ito's palette, with a marker each.
EXCITATIONS = {
    "rich": ("#0072B2", "o"),
    "fair": ("#E69F00", "s"),
    "periodic": ("#009E73", "D"),
    "poor": ("#D55E00", "^"),
}
STYLE: dict[Any, Any] = {
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
}


@mpl.rc_context(STYLE)
def draw_confusion(confusion: Mapping[str, Mapping[str, int]], path: Path) -> None:
    """What is hidden against what is named first, as shares of each row with the counts."""
    said = {name for counts in confusion.values() for name in counts} - set(VERDICTS)
    columns = sorted(said | (set(confusion) - {"nothing"} - _outside(confusion)))
    columns += VERDICTS
    rows = sorted(confusion, key=lambda row: (row == "nothing", row in _outside(confusion), row))
    counts = np.array([[confusion[row].get(column, 0) for column in columns] for row in rows])
    shares = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    size = max(6.4, 3.2 + 0.42 * len(columns)), 2.4 + 0.3 * len(rows)
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.add_subplot()
    image = axes.imshow(shares, cmap="Blues", vmin=0, vmax=1, aspect="auto")
    for row, column in zip(*np.nonzero(counts), strict=True):
        dark = shares[row, column] > 0.5
        axes.text(
            column,
            row,
            str(counts[row, column]),
            ha="center",
            va="center",
            color="white" if dark else "black",
        )
    axes.set_xticks(range(len(columns)), columns, rotation=60, ha="right", rotation_mode="anchor")
    axes.set_yticks(range(len(rows)), rows)
    axes.set_xlabel("named first, or the verdict where nothing is named")
    axes.set_ylabel("hidden")
    axes.set_title("Single effects from their nominal size on", loc="left")
    axes.axvline(len(columns) - len(VERDICTS) - 0.5, color="black", linewidth=0.8)
    axes.spines[:].set_visible(False)
    figure.colorbar(image, label="share of the row")
    figure.savefig(path, dpi=140)


def _outside(confusion: Mapping[str, Any]) -> set[str]:
    return {row for row in confusion if row.endswith("(not in library)")}


@mpl.rc_context(STYLE)
def draw_detection(parts: Mapping[str, Mapping[str, Any]], path: Path) -> None:
    """How often an effect is named against its size, one panel an effect."""
    names = sorted({name for part in parts.values() for name in part["detection"]})
    across = min(4, len(names))
    down = -(-len(names) // across)
    figure = Figure(figsize=(2.6 * across + 0.6, 2.1 * down + 0.9), layout="constrained")
    panels = figure.subplots(down, across, sharex=True, sharey=True, squeeze=False).ravel()
    for panel in panels[len(names) :]:
        panel.set_visible(False)
    for panel, name in zip(panels, names, strict=False):
        panel.set_title(name, loc="left")
        for place, (kind, (colour, marker)) in enumerate(EXCITATIONS.items()):
            row = parts.get(kind, {}).get("detection", {}).get(name)
            if row is not None:
                _curve(panel, row, colour, marker, nudge=1.05 ** (place - 1.5))
        panel.set_xscale("log")
        panel.set_xticks([0.1, 0.5, 1, 4], ["0.1", "0.5", "1", "4"])
        panel.minorticks_off()
        panel.set_ylim(-0.05, 1.05)
        panel.grid(color="#E4E4E4", linewidth=0.6)
    figure.supxlabel("size, 1 is nominal")
    figure.supylabel("share named (bars: 95 %)")
    handles = [
        Line2D([], [], color=colour, marker=marker, markersize=4, label=kind)
        for kind, (colour, marker) in EXCITATIONS.items()
    ]
    handles.append(Line2D([], [], color="black", linestyle=":", label="printed limit (median)"))
    figure.legend(handles=handles, loc="outside upper right", ncols=len(handles))
    figure.savefig(path, dpi=140)


def _curve(panel, row: Mapping[str, Any], colour: str, marker: str, nudge: float):
    size = np.array([float(level) for level in row["by_size"]])
    rates = row["by_size"].values()
    middle, low, high = np.array([[one["rate"], one["low"], one["high"]] for one in rates]).T
    ends = np.abs(np.stack([low, high]) - middle)
    panel.errorbar(
        size * nudge,
        middle,
        ends,
        color=colour,
        marker=marker,
        markersize=4,
        linewidth=1.1,
        elinewidth=0.6,
    )
    if np.isfinite(row["limit"]):
        panel.axvline(row["limit"] * nudge, color=colour, linestyle=":", linewidth=1.1)

"""Pictures of the benchmark, in colours that colour-blind readers can tell apart."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from blind.rates import WAYS

VERDICTS = ("adequate", "unexplained")
# Okabe and Ito's palette, with a marker each.
EXCITATIONS = {
    "rich": ("#0072B2", "o"),
    "fair": ("#E69F00", "s"),
    "periodic": ("#009E73", "D"),
    "poor": ("#D55E00", "^"),
}
LABELS = {
    "diagnose": "diagnose",
    "forward": "forward\ncriterion",
    "held_out": "held-out\nerror",
    "correlation": "largest\ncorrelation",
    "sparse": "sparse\nregression",
}
STYLE: dict[Any, Any] = {
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
}


@mpl.rc_context(STYLE)
def draw_confusion(confusion: Mapping[str, Mapping[str, int]], kind: str, path: Path) -> None:
    """What is hidden against what is named first, as shares of each row with the counts.

    Arguments:
        confusion: counts by what is hidden and what is said.
        kind: the excitation, for the title.
        path: the PNG to write.
    """
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
    axes.set_title(f"Excitation: {kind}; single effects from their nominal size on", loc="left")
    axes.axvline(len(columns) - len(VERDICTS) - 0.5, color="black", linewidth=0.8)
    axes.spines[:].set_visible(False)
    figure.colorbar(image, label="share of the row")
    figure.savefig(path, dpi=140)


def _outside(confusion: Mapping[str, Any]) -> set[str]:
    return {row for row in confusion if row.endswith("(not in library)")}


@mpl.rc_context(STYLE)
def draw_detection(parts: Mapping[str, Mapping[str, Any]], path: Path) -> None:
    """How often an effect is named against its size, one panel an effect.

    Arguments:
        parts: the summary of each excitation.
        path: the PNG to write.
    """
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


def _with_ends(rates: Iterable[Mapping[str, Any]]) -> tuple[np.ndarray, np.ndarray]:
    """Rates, and how far their intervals reach below and above each."""
    middle, low, high = np.array([[one["rate"], one["low"], one["high"]] for one in rates]).T
    return middle, np.abs(np.stack([low, high]) - middle)


def _curve(panel, row: Mapping[str, Any], colour: str, marker: str, nudge: float):
    size = np.array([float(level) for level in row["by_size"]])
    middle, ends = _with_ends(row["by_size"].values())
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


@mpl.rc_context(STYLE)
def draw_false_alarms(parts: Mapping[str, Mapping[str, Any]], path: Path) -> None:
    """How often something is named where nothing is hidden, by each way to name.

    Arguments:
        parts: the summary of each excitation.
        path: the PNG to write.
    """
    figure = Figure(figsize=(7.4, 3.6), layout="constrained")
    axes = figure.add_subplot()
    for place, (kind, (colour, marker)) in enumerate(EXCITATIONS.items()):
        if kind not in parts or not parts[kind]["false_alarms"]["diagnose"]["of"]:
            continue
        rates = [parts[kind]["false_alarms"][way] for way in WAYS]
        middle, ends = _with_ends(rates)
        axes.errorbar(
            np.arange(len(WAYS)) + 0.15 * (place - 1.5),
            100 * middle,
            100 * ends,
            color=colour,
            marker=marker,
            linestyle="none",
            capsize=2,
            label=f"{kind} ({rates[0]['of']} records)",
        )
    axes.set_xticks(range(len(WAYS)), [LABELS[way] for way in WAYS])
    axes.set_ylim(-3, 103)
    axes.set_ylabel("% of records that hide nothing")
    axes.set_title(f"False alarms of {len(WAYS)} ways to name an effect (bars: 95 %)", loc="left")
    axes.grid(axis="y", color="#E4E4E4", linewidth=0.6)
    figure.legend(loc="outside right upper")
    figure.savefig(path, dpi=140)


@mpl.rc_context(STYLE)
def draw_risk(parts: Mapping[str, Mapping[str, Any]], path: Path) -> None:
    """Share of names that are wrong against that of effects found, as the test gets stricter.

    Arguments:
        parts: the summary of each excitation.
        path: the PNG to write.
    """
    figure = Figure(figsize=(6.0, 3.8), layout="constrained")
    axes = figure.add_subplot()
    for kind, (colour, marker) in EXCITATIONS.items():
        rows = parts[kind]["risk_and_coverage"] if kind in parts else []
        rows = [row for row in rows if row["wrong"]["of"] and row["found"]["of"]]
        if not rows:
            continue
        found, wrong = ([100 * row[name]["rate"] for row in rows] for name in ("found", "wrong"))
        axes.plot(found, wrong, color=colour, marker=marker, markersize=4, label=kind)
        labels: dict[tuple[float, float], list[str]] = {}
        for row, point in zip(rows, zip(found, wrong, strict=True), strict=True):
            labels.setdefault(point, []).append(f"{row['least_score']:g}")
        for point, same in labels.items():
            text = "–".join(dict.fromkeys((same[0], same[-1])))
            axes.annotate(text, point, (3, 3), textcoords="offset points", fontsize=7)
    axes.set_xlim(-3, 103)
    axes.set_ylim(-0.5, max(5.0, 1.1 * axes.get_ylim()[1]))
    axes.set_xlabel("visible hidden effects that are named, %")
    axes.set_ylabel("names that are wrong, %")
    axes.set_title("Risk against coverage; beside the points, the least score", loc="left")
    axes.grid(color="#E4E4E4", linewidth=0.6)
    figure.legend(loc="outside right upper")
    figure.savefig(path, dpi=140)


@mpl.rc_context(STYLE)
def draw_reliability(rows: Sequence[Mapping[str, Any]], path: Path) -> None:
    """How often intervals of parameters have the truth, against how often they should.

    Arguments:
        rows: a rate for each level, as in the summary.
        path: the PNG to write.
    """
    figure = Figure(figsize=(4.6, 4.4), layout="constrained")
    axes = figure.add_subplot()
    levels = [row["level"] for row in rows]
    middle, ends = _with_ends(rows)
    colour, marker = EXCITATIONS["rich"]
    axes.plot([0, 100], [0, 100], color="black", linestyle=":", label="as stated")
    axes.errorbar(
        levels, 100 * middle, 100 * ends, color=colour, marker=marker, markersize=4, capsize=2,
        label=f"{rows[0]['of']} parameters (bars: 95 %)",
    )  # fmt: skip
    axes.set_xlim(40, 101)
    axes.set_ylim(40, 101)
    axes.set_xlabel("level of the interval, %")
    axes.set_ylabel("intervals that have the truth, %")
    axes.set_title("Intervals of effects named rightly", loc="left")
    axes.grid(color="#E4E4E4", linewidth=0.6)
    axes.legend(loc="lower right")
    figure.savefig(path, dpi=140)

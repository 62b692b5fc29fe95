"""The figures by number, computed, drawn and written to files."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from preisach_jax import paper
from preisach_jax.errors import InputError
from preisach_jax.files import check_folder, json_bytes, write_files
from preisach_jax.paper.numbers import FigureData, Progress
from preisach_jax.plot.paper.courses import bode, convergence, hysteron, loops, time_frame
from preisach_jax.plot.paper.diagrams import adaptive_filter, experiment
from preisach_jax.plot.paper.levels import (
    coefficients,
    proportionality,
    recursions,
    relays_and_ramps,
)
from preisach_jax.plot.style import pdf, png

DPI = 300


@dataclass(frozen=True)
class PaperFigure:
    """A figure of the paper.

    Attributes:
        title: what it shows.
        data: computes its numbers; takes `progress` and what `quick` names.
        draw: draws them.
        quick: arguments with which it is computed in a few seconds.
    """

    title: str
    data: Callable[..., FigureData]
    draw: Callable[[Any], Figure]
    quick: Mapping[str, Any] = field(default_factory=dict[str, Any])


_SHORT_SWEEP = {"levels": (13, 9, 5), "seeds": 2, "samples": 4000}

FIGURES: Mapping[str, PaperFigure] = {
    "1": PaperFigure("Hysteron", paper.hysteron_loops, hysteron),
    "2": PaperFigure("Adaptive hysteresis filter", paper.filter_diagram, adaptive_filter),
    "3": PaperFigure("Experiment", paper.experiment_diagram, experiment),
    "4": PaperFigure("Frequency response", paper.bode, bode, {"realisations": 2}),
    "5": PaperFigure("Input-output loops", paper.loops, loops, {"seconds": 2.0, "samples": 4000}),
    "6": PaperFigure(
        "Squared output error", paper.convergence, convergence, {"samples": 4000, "records": 2}
    ),
    "7": PaperFigure(
        "Measurement and model", paper.time_frame, time_frame, {"samples": 4000, "seconds": 0.2}
    ),
    "8": PaperFigure(
        "Residual error against quantisation noise",
        paper.proportionality,
        proportionality,
        _SHORT_SWEEP,
    ),
    "9": PaperFigure(
        "Weight error against noise, with the truth known",
        paper.coefficients,
        coefficients,
        _SHORT_SWEEP,
    ),
    "10": PaperFigure(
        "Relays against ramps",
        paper.relays_and_ramps,
        relays_and_ramps,
        {"levels": (5, 9, 13), "samples": 4000, "every": 2},
    ),
    "11": PaperFigure(
        "Recursions compared",
        paper.recursions,
        recursions,
        {"levels": 5, "samples": 2000, "passes": (1, 2)},
    ),
}
"""The figures by number: 1 to 8 are the paper's, the others go further."""


def figure_names(chosen: Sequence[str] | None, quick: bool) -> list[str]:
    """Names of the files of figures, three for each number; None is all."""
    numbers = list(FIGURES) if chosen is None else [str(number) for number in chosen]
    for number in numbers:
        if number not in FIGURES:
            raise InputError(f"there is no figure {number}: choose from {', '.join(FIGURES)}")
    stems = [f"figure_{int(number):02}{'_quick' if quick else ''}" for number in numbers]
    return [f"{stem}.{kind}" for stem in stems for kind in ("pdf", "png", "json")]


def figures(
    folder: str | Path,
    chosen: Sequence[str] | None = None,
    quick: bool = False,
    progress: Progress | None = None,
) -> list[Path]:
    """Compute and draw figures, and write each as PDF, as PNG and as the numbers behind it.

    Arguments:
        chosen: numbers of figures, as in ("4", "8"); None is all.
        quick: whether to compute short records and few realisations, to try it out.
    """
    folder = Path(folder)
    numbers = list(FIGURES) if chosen is None else [str(number) for number in chosen]
    names = figure_names(numbers, quick)
    check_folder(folder)
    written: list[Path] = []
    for place, number in enumerate(numbers):

        def show(text: str, part: float, place: int = place, number: str = number) -> None:
            if progress is not None:
                progress(f"figure {number}: {text}", (place + part) / len(numbers))

        one = FIGURES[number]
        data = one.data(progress=show, **(one.quick if quick else {}))
        drawn = one.draw(data)
        content = {"figure": int(number), "title": one.title, "quick": quick, **data.to_json()}
        paths = [folder / name for name in names[3 * place : 3 * place + 3]]
        made = (pdf(drawn), png(drawn, DPI), json_bytes(content))
        written += write_files(dict(zip(paths, made, strict=True)))
    if progress is not None:
        progress("figures are drawn", 1.0)
    return written

"""Reports: one self-contained page, its figures as files, and the results as JSON."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jinja2

from preisach_jax import plot
from preisach_jax.files import check_folder, file_name, is_ours, json_bytes, write_files
from preisach_jax.plot.diagnosis import dependence, drawn, remainder
from preisach_jax.plot.style import png, svg
from preisach_jax.report.content import comparison_page, diagnosis_page, several_page

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from preisach_jax.diagnosis.comparison import Comparison
    from preisach_jax.diagnosis.result import Diagnosis

__all__ = [
    "comparison_names",
    "comparisons_json",
    "diagnosis_names",
    "write_comparison",
    "write_comparisons",
    "write_report",
]

_COMPARED = ("measured_and_model", "loop", "residuals", "residual_tests", "density")
_DIAGNOSED = (*_COMPARED, "worst", "waterfall", "candidates", "remainder", "form")
_SEVERAL = ("overlay",)


def diagnosis_names(folder: Path) -> list[str]:
    """Names of the files that a report of a diagnosis may write into a folder."""
    # Which alternatives there will be is known after the work only.
    held = [f"alternatives/{path.name}" for path in folder.glob("alternatives/*.json")]
    files = ["report.html", "diagnosis.json", "base.json", "model.json", *held]
    return files + _pictures(_DIAGNOSED)


def comparison_names(several: bool) -> list[str]:
    """Names of the files that a report of one comparison, or of several, may write."""
    figures = _SEVERAL if several else _COMPARED
    return ["report.html", "comparison.json", *_pictures(figures)]


def _pictures(figures: Iterable[str]) -> list[str]:
    return [f"{name}.{kind}" for name in figures for kind in ("svg", "png")]


def write_report(
    found: Diagnosis, folder: Path, *, command: str | None = None, as_png: bool = False
) -> list[Path]:
    """Write the report of a diagnosis.

    Arguments:
        found: the diagnosis.
        folder: where to; it is made if it does not exist.
        command: the command line that made it, for the page.
        as_png: whether to write the figures as PNG as well, which takes as long again.

    Returns:
        The files: `report.html`, `diagnosis.json`, `base.json` (the model without effects),
        `model.json` (the final one), `alternatives/` (a model with each other member of a family
        in place of the effect that was named), and the figures as SVG.

    Raises:
        InputError: if the folder cannot be written to; then nothing was.

    Example:
        >>> write_report(found, Path("report"))  # doctest: +SKIP
    """
    folder = Path(folder)
    check_folder(folder)
    page = diagnosis_page(found, command)
    traces = plot.before_and_after(found)
    figures = {
        "worst": plot.where_it_errs_most(traces),
        "waterfall": plot.waterfall(found),
        "measured_and_model": plot.measured_and_model(traces),
        "loop": plot.loop(traces),
        "residuals": plot.residuals(traces),
        "residual_tests": plot.residual_tests(traces),
        "candidates": plot.candidates(found),
    }
    if not found.model.chain.mechanics:  # there the axes of the plane are no inputs
        figures["density"] = plot.density(found.model)
    if drawn(found):
        figures["remainder"] = remainder(found)
    if found.form is not None and found.form.dependence is not None:
        figures["form"] = dependence(found.form)
    files = {
        "diagnosis.json": json_bytes(found.to_json()),
        "base.json": json_bytes(found.base.model.to_json()),
        "model.json": json_bytes(found.model.to_json()),
    }
    for name, model in found.alternatives.items():
        files[f"alternatives/{file_name(name)}.json"] = json_bytes(model.to_json())
    return _write(folder, "report.html.j2", page, files, figures, as_png)


def write_comparison(
    comparison: Comparison, folder: Path, *, command: str | None = None, as_png: bool = False
) -> list[Path]:
    """Write the report of a comparison.

    Arguments:
        comparison: a model beside a measurement.
        folder: where to; it is made if it does not exist.
        command: the command line that made it, for the page.
        as_png: whether to write the figures as PNG as well, which takes as long again.

    Returns:
        The files: `report.html`, `comparison.json`, and the figures as SVG.

    Raises:
        InputError: if the folder cannot be written to; then nothing was.

    Example:
        >>> write_comparison(compare(model, record), Path("report"))  # doctest: +SKIP
    """
    folder = Path(folder)
    check_folder(folder)
    traces = {"model": comparison}
    figures = {
        "measured_and_model": plot.measured_and_model(traces),
        "loop": plot.loop(traces),
        "residuals": plot.residuals(traces),
        "residual_tests": plot.residual_tests(traces),
    }
    if not comparison.model.chain.mechanics:
        figures["density"] = plot.density(comparison.model)
    page = comparison_page(comparison, command)
    files = {"comparison.json": json_bytes(comparison.to_json())}
    return _write(folder, "comparison.html.j2", page, files, figures, as_png)


def write_comparisons(
    comparisons: Mapping[str, Comparison],
    folder: Path,
    *,
    command: str | None = None,
    as_png: bool = False,
) -> list[Path]:
    """Write the report of several comparisons, of one model or of one record.

    Arguments:
        comparisons: by what each is called.
        folder: where to; it is made if it does not exist.
        command: the command line that made it, for the page.
        as_png: whether to write the figures as PNG as well, which takes as long again.

    Returns:
        The files: `report.html`, `comparison.json` (a list), and `overlay.svg`.

    Raises:
        InputError: if the folder cannot be written to; then nothing was.

    Example:
        >>> write_comparisons({"mon": first, "tue": second}, Path("report"))  # doctest: +SKIP
    """
    from preisach_jax.plot.several import overlay

    folder = Path(folder)
    check_folder(folder)
    figures = {"overlay": overlay(comparisons)}
    page = several_page(comparisons, command)
    files = {"comparison.json": json_bytes(comparisons_json(comparisons))}
    return _write(folder, "several.html.j2", page, files, figures, as_png)


def comparisons_json(comparisons: Mapping[str, Comparison]) -> dict[str, Any]:
    """The content of `comparison.json` for several comparisons."""
    return {"comparisons": [{"name": name, **each.to_json()} for name, each in comparisons.items()]}


def _write(
    folder: Path,
    template: str,
    page: Mapping[str, Any],
    files: Mapping[str, bytes],
    figures: Mapping[str, Figure],
    as_png: bool,
) -> list[Path]:
    """Draw the figures, each once, and write them with the page that shows them."""
    drawn = {name: svg(figure).encode(errors="replace") for name, figure in figures.items()}
    contents = {"report.html": _rendered(template, page, drawn), **files}
    contents |= {f"{name}.svg": content for name, content in drawn.items()}
    if as_png:
        contents |= {f"{name}.png": png(figure) for name, figure in figures.items()}
    written = write_files({folder / name: content for name, content in contents.items()})
    # Figures of the run before are of other data, and beside the new page they would mislead.
    for name in {*_pictures((*_DIAGNOSED, *_SEVERAL))} - contents.keys():
        old = folder / name
        if old.is_file() and not old.is_symlink() and is_ours(old):
            old.unlink()
    return written


def _rendered(template: str, page: Mapping[str, Any], drawn: Mapping[str, bytes]) -> bytes:
    # Names of columns and effects come from files and may hold anything: all is escaped.
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("preisach_jax", "report"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    inline = "data:image/svg+xml;base64,"
    sources = {name: inline + base64.b64encode(each).decode() for name, each in drawn.items()}
    # A file's name may hold bytes that are no text.
    text = environment.get_template(template).render(page, figures=sources)
    return text.encode(errors="replace")

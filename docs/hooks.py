"""Pages that are made when the site is built (effects, scores, architecture, ...); formulas."""

from __future__ import annotations

import os
import re
import sys
from html import unescape
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
for folder in (HERE, HERE.parent, HERE.parent / "benchmarks"):
    if str(folder) not in sys.path:
        sys.path.insert(0, str(folder))

import architecture  # noqa: E402
import claims  # noqa: E402
import command_line  # noqa: E402
import effect_pages  # noqa: E402
import gallery  # noqa: E402
import measurements  # noqa: E402
import provenance  # noqa: E402
import scores  # noqa: E402
from latex2mathml.converter import convert  # noqa: E402
from mkdocs.exceptions import PluginError  # noqa: E402
from mkdocs.structure.files import File, Files  # noqa: E402

FORMULA = re.compile(r'<(span|div) class="arithmatex">\s*\\[(\[](.*?)\\[)\]]\s*</\1>', re.DOTALL)
"""A formula as arithmatex marks it."""


def generated() -> dict[str, str]:
    """All generated pages in Markdown by their place in the documentation."""
    return {
        **effect_pages.pages(),
        "gallery.md": gallery.page(),
        "method/measurements.md": measurements.page(),
        "method/scores.md": scores.page(),
        "reference/architecture.md": architecture.page(),
        "reference/command-line.md": command_line.page(),
    }


def on_config(config: Any) -> Any:
    """Put one page an effect into the navigation, and say which results are of another version.

    With PREISACH_RELEASE=1 such results end the build.
    """
    if others := provenance.outdated():
        line = f"results of another version of the package: {', '.join(others)}"
        if os.environ.get("PREISACH_RELEASE") == "1":
            raise PluginError(
                f"{line}; make them anew (make claims), or release what they measured"
            )
        sys.stderr.write(f"{line}\n")
    for section in config.nav:
        if "Effects" in section:
            section["Effects"] = list(effect_pages.pages())
    return config


def on_files(files: Files, config: Any) -> Files:
    """Add the generated pages to those that are written by hand."""
    for place, text in generated().items():
        files.append(File.generated(config, place, content=text))
    for picture in scores.SAMPLE.glob("*.png"):
        place = f"method/blind-{picture.name}"
        files.append(File.generated(config, place, abs_src_path=str(picture)))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Files) -> str:
    """A page without the sentences whose result is not there; the effects' one with their code."""
    del config, files
    if page.file.src_uri == "reference/effects.md":
        markdown += effect_pages.reference()
    return claims.without_missing(f"docs/{page.file.src_uri}", markdown)


def on_page_content(html: str, page: Any, config: Any, files: Files) -> str:
    """Formulas as MathML, which needs neither scripts nor fonts."""
    del page, config, files

    def mathml(found: re.Match[str]) -> str:
        formula = convert(unescape(found[2]), display="block" if found[1] == "div" else "inline")
        if "\\" in formula:  # what it does not know it passes on as it is
            raise PluginError(f"{found[2]}: has a command that latex2mathml does not know")
        return formula

    return FORMULA.sub(mathml, html)

"""Pages that are made when the site is built (effects, scores, architecture, ...); formulas."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
for folder in (HERE, HERE.parent, HERE.parent / "benchmarks"):
    if str(folder) not in sys.path:
        sys.path.insert(0, str(folder))

import architecture  # noqa: E402
import command_line  # noqa: E402
import effect_pages  # noqa: E402
import formulas  # noqa: E402
import gallery  # noqa: E402
import measurements  # noqa: E402
import scores  # noqa: E402
from mkdocs.structure.files import File, Files  # noqa: E402


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
    """Put one page an effect into the navigation."""
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
    """The code of the built-in effects, at the end of their reference."""
    del config, files
    if page.file.src_uri == "reference/effects.md":
        return markdown + effect_pages.reference()
    return markdown


def on_page_content(html: str, page: Any, config: Any, files: Files) -> str:
    """Formulas as MathML, which needs neither scripts nor fonts."""
    del page, config, files
    return formulas.in_page(html)

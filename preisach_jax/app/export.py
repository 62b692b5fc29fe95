"""What can be taken away from the page: report, model, figures, and the script that repeats it."""

from __future__ import annotations

import io
import tempfile
import zipfile
from collections.abc import Sequence
from pathlib import Path

from preisach_jax.app.script import Click, script
from preisach_jax.diagnosis.exploration import Exploration
from preisach_jax.diagnosis.result import Diagnosis
from preisach_jax.fit import Progress
from preisach_jax.record import ReadOptions
from preisach_jax.report import write_report


def exports(
    step: Exploration,
    found: Diagnosis | None,
    name: str,
    choice: ReadOptions,
    clicks: Sequence[Click],
    progress: Progress,
) -> dict[str, bytes]:
    """The files that the page offers."""
    progress("drawing conclusions", 0.1)
    concluded = found or step.conclude(progress)
    progress("writing the report", 0.7)
    with tempfile.TemporaryDirectory() as folder:
        command = "preisach app (the script repeat.py repeats these steps)"
        paths = write_report(concluded, Path(folder), command=command, as_png=True)
        contents = {path.name: path.read_bytes() for path in paths}
    figures = io.BytesIO()
    with zipfile.ZipFile(figures, "w") as archive:
        for file, content in contents.items():
            if file.endswith(".png"):
                archive.writestr(file, content)
    kept = ("report.html", "model.json", "diagnosis.json")
    return {
        **{file: contents[file] for file in kept},
        "figures.zip": figures.getvalue(),
        "repeat.py": script(name, choice, clicks, step).encode(),
    }

"""The steps that were taken: to go back to, to repeat, to save, and to take away."""

from __future__ import annotations

import io
import json
import math
import tempfile
import zipfile
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Annotated, Any

from pydantic import Field

from preisach_jax.app import panels
from preisach_jax.app.layout import button
from preisach_jax.app.upload import MOST_BYTES, Upload, harmless_name
from preisach_jax.diagnosis import diagnose, find_form
from preisach_jax.diagnosis.exploration import Exploration, explore
from preisach_jax.diagnosis.result import Candidate, Diagnosis
from preisach_jax.diagnosis.selection import effects_to_try
from preisach_jax.errors import ContentError, InputError
from preisach_jax.files import json_bytes
from preisach_jax.fit import Fit, Progress
from preisach_jax.model.schema import checked, list_of, number, one_of, share, table_of, text, whole
from preisach_jax.quantity import quantity
from preisach_jax.record.columns import ReadOptions
from preisach_jax.record.core import Record
from preisach_jax.report import write_report


@dataclass(frozen=True)
class Click:
    """What was done: `"fit"`, `"find"`, `"add"` or `"undo"`, with levels or the effect's name."""

    what: str
    levels: int | None = None
    effect: str = ""


def without_detours(clicks: Sequence[Click]) -> list[Click]:
    """The clicks that lead to the same state: what was added and taken back at once is left out."""
    kept: list[Click] = []
    for click in clicks:
        if click.what in {"fit", "find"}:
            kept = [click]
        elif click.what == "undo" and kept and kept[-1].what == "add":
            kept.pop()
        else:
            kept.append(click)
    return kept


def script(name: str, choice: ReadOptions, clicks: Sequence[Click], step: Exploration) -> str:
    """The text of a script that repeats the clicks and gives the same numbers."""
    record = step.record
    digests: Any = [run.sha256 for run in record.runs] or record.sha256
    read = "[each.sha256 for each in record]" if record.runs else "record.sha256"
    lines = [
        '"""Repeats the steps taken in `preisach app`: python SCRIPT [DATA]."""',
        "",
        "import sys",
        "from pathlib import Path",
        "",
        "import preisach_jax as pj",
        "",
        f"data = sys.argv[1] if len(sys.argv) > 1 else Path(__file__).parent / {name!r}",
        f"record = pj.Record.load{'_all' if record.runs else ''}(",
        "    data,",
        *(f"    {key}={value!r}," for key, value in choice.items() if value),
        ")",
        f"if {read} != {digests!r}:",
        '    sys.exit(f"{data} is not the record of these steps: its values differ")',
        "",
    ]
    for click in without_detours(clicks):
        lines += _lines_of(click)
    lines += [
        "",
        "for rung in step.ladder:",
        '    name = " + ".join(("Preisach model", *rung.effects))',
        "    print(name, rung.rms_validation, step.record.output_unit)",
        'step.fit.save("model.json")',
        "",
    ]
    return "\n".join(lines)


def _lines_of(click: Click) -> list[str]:
    if click.what == "fit":
        return [f"step = pj.explore(record, levels={click.levels})"]
    if click.what == "find":
        return [
            f"found = pj.diagnose(record, levels={click.levels})",
            "print(found.sentence)",
            "step = pj.Exploration.of(found)",
        ]
    if click.what == "add":
        return [f"step = step.add({click.effect!r})"]
    return ["step = step.before or step"]


SUFFIX = ".preisach"
FORMAT = 2

MOST_TOLD = 10_000_000
"""Most bytes of what a project says beside its record and its models."""


@dataclass(frozen=True)
class Project:
    """What a project file holds.

    Attributes:
        name: what the record's file was called.
        content: its bytes.
        choice: its columns.
        clicks: what was done, without detours.
        errors: held-out errors of the steps, in output units, to compare with when repeated.
    """

    name: str
    content: bytes
    choice: ReadOptions
    clicks: tuple[Click, ...]
    errors: tuple[float, ...]


def packed(
    name: str,
    content: bytes,
    choice: ReadOptions,
    clicks: Sequence[Click],
    step: Exploration | None,
) -> bytes:
    """A project as the bytes of a ZIP archive."""
    steps = () if step is None else step.steps
    told = {
        "format": FORMAT,
        "name": name,
        "record": f"record/{harmless_name(name)}",
        "choice": dict(choice),
        "clicks": [asdict(click) for click in clicks],
        "errors": [each.fit.rms_validation for each in steps],
    }
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("project.json", json_bytes(told))
        archive.writestr(str(told["record"]), content)
        for place, each in enumerate(steps):
            archive.writestr(f"models/{place}.json", json_bytes(each.fit.model.to_json()))
    return file.getvalue()


def unpacked(name: str, content: bytes) -> Project:
    """The project in a file."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            told: Any = json.loads(_member(archive, "project.json", MOST_TOLD))
            found: Any = checked(told, {"format": whole(0)})["format"]
            if found > FORMAT:
                raise ContentError(
                    f"the project has format {found} and this version reads {FORMAT}; open it with "
                    "the version that wrote it"
                )
            sound = checked(told, _CONTENT)
            return _project(sound, _member(archive, sound["record"], MOST_BYTES))
    except ContentError as error:
        raise InputError(f"{name}: {error}") from None
    except (InputError, *_DAMAGE) as error:
        what = str(error) if isinstance(error, InputError) else f"{type(error).__name__}: {error}"
        raise InputError(
            f"{name}: the project file is damaged ({' '.join(what.split())}); save it again or "
            "open the record itself"
        ) from None


_DAMAGE = (
    zipfile.BadZipFile, zlib.error, EOFError, KeyError, OSError,
    RecursionError, RuntimeError, ValueError,
)  # fmt: skip
"""What reading an archive and its JSON ends with, where they are not what was written."""

_name = Annotated[text, Field(max_length=1000)]
_column = _name | None

_CONTENT = {
    "format": whole(FORMAT, FORMAT),
    "name": _name,
    "record": _name,
    "choice": {
        "time": _column, "input": _name, "output": _name, "aux": list_of(_name),
        "rate": number(0.0) | None, "units": table_of(_name) | None, "table": whole(1) | None,
    },
    "clicks": Annotated[
        list_of({"what": one_of("fit", "find", "add", "undo"), "levels": whole(2) | None,
                 "effect": _name}), Field(max_length=1000),
    ],
    "errors": list_of(share),
}  # fmt: skip
"""Of each key of `project.json`, what it holds."""


def _member(archive: zipfile.ZipFile, path: str, most: int) -> bytes:
    """The bytes of a member: of no more than is taken, whatever it says of its own size."""
    told = archive.getinfo(path)
    if told.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise InputError(f"{path} is packed as no project is: save it again")
    with archive.open(path) as member:
        content = member.read(most + 1)
    if len(content) > most:
        raise ContentError(
            f"{path} unpacks to more than {most / 1e6:.0f} MB, which is the most that the page "
            "takes; use the command line for the record itself"
        )
    if len(content) != told.file_size:
        raise InputError(f"{path} is not as long as it says: save it again")
    return content


def _project(told: Mapping[str, Any], content: bytes) -> Project:
    choice = told["choice"]
    return Project(
        PurePosixPath(told["name"]).name,
        content,
        {
            "time": choice["time"], "input": choice["input"], "output": choice["output"],
            "aux": tuple(choice["aux"]), "rate": choice["rate"], "units": choice["units"],
            "table": choice["table"],
        },
        tuple(Click(each["what"], each["levels"], each["effect"]) for each in told["clicks"]),
        tuple(math.nan if error is None else error for error in told["errors"]),
    )  # fmt: skip


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


@dataclass(frozen=True)
class Walk:
    """The steps that were taken, and where among them the page is.

    Attributes:
        last: the furthest step.
        clicks: what led to it.
        found: the diagnosis that led to it, None if it was reached by hand.
        back: how many steps the page has gone back from it.
    """

    last: Exploration
    clicks: tuple[Click, ...]
    found: Diagnosis | None = None
    back: int = 0

    @property
    def step(self) -> Exploration:
        """The step that is shown."""
        return self.last.steps[len(self.last.steps) - 1 - self.back]

    @property
    def diagnosis(self) -> Diagnosis | None:
        """The diagnosis, where it is its last step that is shown."""
        return self.found if self.back == 0 else None

    @property
    def way(self) -> tuple[Click, ...]:
        """What leads to the step that is shown."""
        return (*self.clicks, *[Click("undo")] * self.back)

    @property
    def asks_for_form(self) -> bool:
        """Whether effects were compared, something remains, and no form of it was sought."""
        found, budget = self.diagnosis, self.step.known_budget
        if found is None:
            was_compared = bool(self.step.known_candidates)
            return was_compared and budget is not None and not budget.is_met
        return found.form is None and found.leaves_a_part

    def with_form(self, progress: Progress) -> Walk:
        """The walk up to the step that is shown, with a form of what remains of it."""
        found = self.diagnosis or self.step.conclude(progress)
        found = replace(found, form=find_form(found, progress=progress))
        return Walk(self.step, self.way, found)

    def at(self, place: int) -> Walk:
        """The same walk with another of its steps shown, counted from the plain model."""
        return Walk(self.last, self.clicks, self.found, len(self.last.steps) - 1 - place)

    def on(self, step: Exploration, click: Click) -> Walk:
        """The walk with one more step; those that it had gone back from are left."""
        return Walk(step, (*self.way, click))


def searched(
    record: Record,
    levels: int | None,
    watch: Callable[[Exploration, tuple[Candidate, ...]], None],
    progress: Progress,
) -> tuple[Diagnosis, Exploration]:
    """Run a whole diagnosis, and show each of its steps.

    Returns:
        The diagnosis, and its last step.
    """
    tried, steps = effects_to_try(record, None), list[Exploration]()

    def on_step(fit: Fit, candidates: tuple[Candidate, ...]) -> None:
        before = next((s for s in reversed(steps) if s.effects == fit.effects[:-1]), None)
        steps.append(Exploration(fit, tried, before))
        watch(steps[-1], candidates)

    found = diagnose(record, levels=levels, progress=progress, watch=on_step)
    return found, Exploration.of(found)


def repeated(record: Record, clicks: Sequence[Click], progress: Progress) -> Walk:
    """Take the steps of clicks again."""
    walk: Walk | None = None
    for click in clicks:
        if click.what == "fit":
            walk = Walk(explore(record, levels=click.levels, progress=progress), (click,))
        elif click.what == "find":
            found = diagnose(record, levels=click.levels, progress=progress)
            walk = Walk(Exploration.of(found), (click,), found)
        elif walk is None:
            raise InputError(f"the steps begin with {click.what!r}; the first step must be a fit")
        elif click.what == "add":
            walk = walk.on(walk.step.add(click.effect, progress), click)
        elif walk.step.before is not None:
            walk = walk.at(len(walk.step.effects) - 1)
    if walk is None:
        raise InputError(f"the project {record.name!r} holds no steps; open the record itself")
    return walk


def saved(upload: Upload, choice: ReadOptions, walk: Walk | None) -> dict[str, bytes]:
    """A project of a file and the steps on it, by the name that it is offered under."""
    clicks = without_detours(walk.way) if walk else []
    whole = packed(upload.name, upload.content, choice, clicks, walk.step if walk else None)
    return {Path(upload.name).stem + SUFFIX: whole}


def time_line(walk: Walk | None, show: Callable[[int], None]) -> list[Any]:
    """A button for each step of a walk, with its error; the one that is shown stands out."""
    if walk is None:
        return []
    buttons: list[Any] = [panels.pane(panels.doing("Steps:"))]
    buttons[0].sizing_mode = None
    shown = len(walk.last.steps) - 1 - walk.back
    for place, (step, rung) in enumerate(zip(walk.last.steps, walk.last.ladder, strict=True)):
        name = f"+ {rung.effects[-1]}" if rung.effects else "Preisach model"
        error = quantity(rung.rms_validation, step.record.output_unit, 3)
        label = f"{name}: {error}" + (" (shown)" if place == shown else "")
        kind = "primary" if place == shown else "default"
        buttons.append(button(label, partial(_go, show, place), kind))
    return buttons


def _go(show: Callable[[int], None], place: int, event: Any) -> None:
    del event
    show(place)

"""A project as one file: the record as it came, the columns, what was clicked, and the models."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import PurePosixPath
from typing import Any, cast

from preisach_jax.app.script import Click
from preisach_jax.app.upload import MOST_BYTES, harmless_name
from preisach_jax.diagnosis.exploration import Exploration
from preisach_jax.errors import ContentError, InputError
from preisach_jax.files import json_bytes
from preisach_jax.record import ReadOptions

SUFFIX = ".preisach"
FORMAT = 1
_MOST_CLICKS = 1000


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
    """A project as the bytes of a ZIP archive.

    Arguments:
        name: what the record's file was called.
        content: its bytes.
        choice: its columns.
        clicks: what was done, without detours.
        step: the state that it led to, None before the first fit.
    """
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
    """The project in a file.

    Arguments:
        name: what the file is called, for messages.
        content: its bytes.

    Raises:
        InputError: it is no project, one of a newer version, or damaged.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            told = json.loads(_member(archive, "project.json", name))
            if told.get("format") != FORMAT:
                raise InputError(
                    f"{name}: the project has format {told.get('format')!r} and this version reads "
                    f"{FORMAT}; open it with the version that wrote it"
                )
            return _project(told, _member(archive, told["record"], name))
    except (zipfile.BadZipFile, KeyError, TypeError, ValueError, AttributeError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(
            f"{name}: the project file is damaged ({type(error).__name__}: {error}); save it "
            "again or open the record itself"
        ) from None


def _member(archive: zipfile.ZipFile, path: str, name: str) -> bytes:
    size = archive.getinfo(path).file_size
    if size > MOST_BYTES:
        raise InputError(
            f"{name}: {path} unpacks to {size / 1e6:.0f} MB, and the page takes "
            f"{MOST_BYTES / 1e6:.0f} MB; use the command line for the record itself"
        )
    return archive.read(path)


def _project(told: Mapping[str, Any], content: bytes) -> Project:
    choice = cast(Mapping[str, Any], told["choice"])
    clicks = [Click(str(c["what"]), c["levels"], str(c["effect"])) for c in told["clicks"]]
    if len(clicks) > _MOST_CLICKS or {c.what for c in clicks} - {"fit", "find", "add", "undo"}:
        raise ContentError("the steps are not ones that the page can repeat")
    return Project(
        PurePosixPath(str(told["name"])).name,
        content,
        {
            "time": choice["time"], "input": choice["input"], "output": choice["output"],
            "aux": tuple(choice["aux"]), "rate": choice["rate"], "units": choice["units"],
        },
        tuple(clicks),
        tuple(float(error) for error in told["errors"]),
    )  # fmt: skip

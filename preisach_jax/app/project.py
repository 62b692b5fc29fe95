"""A project as one file: the record as it came, the columns, what was clicked, and the models."""

from __future__ import annotations

import io
import json
import math
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import PurePosixPath
from typing import Annotated, Any

from pydantic import Field

from preisach_jax.app.script import Click
from preisach_jax.app.upload import MOST_BYTES, harmless_name
from preisach_jax.diagnosis.exploration import Exploration
from preisach_jax.errors import ContentError, InputError
from preisach_jax.files import json_bytes
from preisach_jax.model.schema import checked, list_of, number, one_of, share, table_of, text, whole
from preisach_jax.record import ReadOptions

SUFFIX = ".preisach"
FORMAT = 1

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
    "format": whole(1, FORMAT),
    "name": _name,
    "record": _name,
    "choice": {
        "time": _column, "input": _name, "output": _name, "aux": list_of(_name),
        "rate": number(0.0) | None, "units": table_of(_name) | None,
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
        },
        tuple(Click(each["what"], each["levels"], each["effect"]) for each in told["clicks"]),
        tuple(math.nan if error is None else error for error in told["errors"]),
    )  # fmt: skip

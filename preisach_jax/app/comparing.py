"""What the page compares: its model and its record beside others that were dropped."""

from __future__ import annotations

import shlex
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import cast

from preisach_jax.app.upload import Upload
from preisach_jax.diagnosis.comparison import Comparison, compare
from preisach_jax.diagnosis.exploration import Exploration
from preisach_jax.errors import InputError
from preisach_jax.files import json_bytes
from preisach_jax.fit import Progress
from preisach_jax.model import Model
from preisach_jax.record import ReadOptions, Record
from preisach_jax.report import write_comparisons

OWN_MODEL = "page-model.json"
"""What the model of the page is called, among others and as a file."""


@dataclass(frozen=True)
class Dropped:
    """A file to compare with: a record, or a model where its name ends in .json.

    Attributes:
        name: as the user called it.
        content: its bytes.
    """

    name: str
    content: bytes

    @property
    def is_model(self) -> bool:
        """Whether it is a model."""
        return self.name.lower().endswith(".json") and b'"preisach' in self.content[:2000]


@dataclass(frozen=True)
class Compared:
    """What a comparison shows.

    Attributes:
        found: the comparisons by what each is called, of one model or of one record.
        picture: the overlay as SVG.
        command: the command line that does the same.
        files: contents by name: the report, the model of the page.
    """

    found: dict[str, Comparison]
    picture: bytes
    command: str
    files: dict[str, bytes]


def compared(step: Exploration, dropped: Sequence[Dropped], progress: Progress) -> Compared:
    """Test the model of a step against records, or several models against one record.

    Records alone are compared under the model of the step, beside its own record; models alone
    under its record; several models and one record under that record.
    """
    models = [each for each in dropped if each.is_model]
    records = [each for each in dropped if not each.is_model]
    if models and len(records) > 1:
        raise InputError(
            f"{len(models) + 1} models and {len(records)} records; take away all records but one, "
            "or all models"
        )
    own, name = step.fit.model, step.record.name
    if twice := {OWN_MODEL, name} & {each.name for each in dropped}:
        raise InputError(
            f"{min(twice)}: what is open here is called the same; give the file another name"
        )
    known = {OWN_MODEL: own} | {each.name: _model(each) for each in models}
    found: dict[str, Comparison] = {}
    if models:
        record = _record(records[0], own) if records else step.record
        for k, (title, model) in enumerate(known.items()):
            progress(f"comparing {title}", k / len(known))
            found[title] = compare(model, record)
        names = [*known, records[0].name if records else name]
    else:
        progress(f"comparing {name}", 0.0)
        found[name] = compare(own, step.record)
        for k, each in enumerate(records, start=1):
            progress(f"comparing {each.name}", k / (len(records) + 1))
            found[each.name] = compare(own, _record(each, own))
        names = [OWN_MODEL, *found]
    progress("drawing", 0.95)
    command = shlex.join(["preisach", "compare", *names])
    with tempfile.TemporaryDirectory() as place:
        paths = write_comparisons(found, Path(place), command=command)
        files = {path.name: path.read_bytes() for path in paths}
    picture = files.pop("overlay.svg")
    files[OWN_MODEL] = json_bytes(own.to_json())
    return Compared(found, picture, command, files)


def _model(dropped: Dropped) -> Model:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.json"
        path.write_bytes(dropped.content)
        try:
            return Model.load(path)
        except InputError as error:
            raise InputError(str(error).replace(str(path), dropped.name)) from None


def _record(dropped: Dropped, model: Model) -> Record:
    """The record in a file, by the columns of the model where it has them, else as guessed."""
    upload = Upload.of(dropped.name, dropped.content)
    table = upload.table
    told = {
        role: model.columns[role]
        for role in ("time", "input", "output")
        if model.columns[role] in table.columns
    }
    units = {role: model.units[role] for role in told if model.units.get(role)}
    options = {**told, "units": units, "aux": tuple(model.columns["aux"])}
    return Record.of_table(table, dropped.name, **cast(ReadOptions, options))

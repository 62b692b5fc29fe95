"""The manifest of long work in a folder: its settings, and what its numbers depend on."""

from __future__ import annotations

import json
from importlib.metadata import version
from pathlib import Path
from typing import Any, cast

import jax

from preisach_jax.errors import ContentError, InputError
from preisach_jax.files import json_bytes, write_files
from preisach_jax.work.chunks import MANIFEST, Chunks

FORMAT = 2

_REMEDY = "choose another folder with --out, or start again with --restart"


def open_work(chunks: Chunks, resume: bool, result: Path | None) -> None:
    """Write the manifest of new work, or make sure that the one there has the same settings."""
    folder, settings, items = chunks.folder, chunks.settings, f"{chunks.item}s"
    manifest: dict[str, Any] = {
        "format": FORMAT, "work": chunks.work, "settings": settings, "made_with": made_with()
    }  # fmt: skip
    old = read_manifest(folder, chunks.work, items) if resume else None
    if old is None:
        if result is not None:
            result.unlink(missing_ok=True)
        chunks.clear()
        write_files({folder / MANIFEST: json_bytes(manifest)})
        return
    there, now = ({**one["settings"], **one["made_with"]} for one in (old, manifest))
    held = there[items]
    if len(held) < len(settings[items]) and held == settings[items][: len(held)]:
        there[items] = now[items]  # more items continue the work
    other = [name for name in now if there.get(name) != now[name]]
    other.sort(key=lambda name: name == items)
    if other:
        differ = ", ".join(
            f"{name} {_shown(there.get(name))} and not {_shown(now[name])}" for name in other
        )
        raise InputError(f"{folder} holds a {chunks.work} with {differ}: {_REMEDY}")
    if held != settings[items]:
        if result is not None:
            result.unlink(missing_ok=True)
        write_files({folder / MANIFEST: json_bytes(manifest)})


def made_with() -> dict[str, str]:
    """What numbers depend on beside the settings, in their last places.

    Returns:
        Versions by the names of packages, and the kind of the device.

    Example:
        >>> sorted(made_with())
        ['device', 'jax', 'jaxlib', 'numpy', 'preisach_jax']
    """
    versions = {name: version(name) for name in ("preisach_jax", "jax", "jaxlib", "numpy")}
    return versions | {"device": jax.devices()[0].device_kind}


def read_manifest(folder: Path, work: str, items: str) -> dict[str, Any] | None:
    """Read the manifest of a folder.

    Arguments:
        folder: the folder.
        work: what it should be, as `sweep`.
        items: the setting that lists what is computed.

    Returns:
        Its content; None if there is none.

    Raises:
        InputError: it cannot be read, or is that of other work.
    """
    path = folder / MANIFEST
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        if content["format"] > FORMAT:
            raise InputError(
                f"{path} has the format {content['format']}, and {FORMAT} is the newest that this "
                "version reads: update preisach_jax, or choose another folder with --out"
            )
        if content.get("work", "sweep") != work:
            raise InputError(f"{folder} holds a {content['work']} and no {work}: {_REMEDY}")
        if not (content["settings"].keys() >= {items, "chunk"} and content["made_with"].keys()):
            raise ContentError(f"it lacks the {items}, the chunk or the versions")
        return content
    except (FileNotFoundError, NotADirectoryError):
        return None
    except InputError:
        raise
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(
            f"{path} cannot be read as the manifest of a {work} ({error}): {_REMEDY}"
        ) from error


def _shown(value: Any) -> str:
    """A setting in few words."""
    if not isinstance(value, list):
        return str(value)
    each = cast(list[Any], value)
    if any(isinstance(one, str) for one in each):
        return str(len(each))
    if len(each) > 8:
        return f"{each[0]} ... {each[-1]} ({len(each)} values)"
    return ",".join(str(one) for one in each)

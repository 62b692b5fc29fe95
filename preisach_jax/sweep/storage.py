"""Sweeps on disk, in chunks of seeds, each written as it is done: an interruption loses little.

A folder holds `manifest.json` (the settings), `sweep.zarr` (the arrays) with `done/`, which says
what of them is whole, and at the end `sweep.json`. The realisation of a seed depends on the key and
its number only: a sweep that was interrupted ends with the same numbers, on whatever devices.

Of several processes the first one alone reads and writes the folder; all compute every chunk.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax
import numpy as np

from preisach_jax.devices import from_first, is_first
from preisach_jax.errors import InputError, whole_number
from preisach_jax.files import json_bytes, write_files
from preisach_jax.sweep import LEVELS, NOISE_UM, checked_settings, sweep
from preisach_jax.sweep.chunks import ARRAYS, Chunks
from preisach_jax.sweep.result import Sweep, merge

FORMAT = 2
_REMEDY = "choose another folder with --out, or start anew with --restart"
MANIFEST, RESULT = "manifest.json", "sweep.json"


def sweep_to_folder(
    folder: str | Path,
    key: jax.Array,
    levels: Sequence[int] = LEVELS,
    noise: Sequence[float] = NOISE_UM,
    seeds: int | Sequence[int] = 8,
    samples: int = 50_000,
    chunk: int = 8,
    resume: bool = True,
    progress: Callable[[str, float], None] | None = None,
    announce: Callable[[str], object] | None = None,
) -> Sweep | None:
    """Run a sweep by chunks of seeds into a folder, or go on with one that was interrupted.

    Args:
        folder: the folder; it need not exist.
        key: random key (`jax.random.key`); realisation i depends on the key and on i only.
        levels: N of the planes, each at least 2.
        noise: standard deviations of the noise where the truth is known, µm.
        seeds: how many realisations of input and noise, or their numbers; more than the folder
            holds continue its sweep.
        samples: time steps at 2 kHz.
        chunk: how many seeds are computed at once, and written when they are done.
        resume: keep the chunks that are there; otherwise start anew.
        progress: called with a text and the part that is done.
        announce: called with a note for each chunk that is there and must be computed again, and if
            memory is too small for a whole chunk at once.

    Returns:
        The results of all seeds; in processes other than the first, those that it computed with
        them, which may be none.

    Raises:
        InputError: a number is out of its range, the folder holds a sweep of other settings, or it
            cannot be written to.

    Example:
        >>> import tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     found = sweep_to_folder(
        ...         folder, jax.random.key(0), (5, 3), (0.1,), seeds=2, samples=2000, chunk=1
        ...     )
        ...     print(sorted(path.name for path in Path(folder).iterdir()))
        ...     print(sorted(path.name for path in Path(folder, "done").iterdir()))
        ['done', 'manifest.json', 'sweep.json', 'sweep.zarr']
        ['seeds_0000-0000.json', 'seeds_0001-0001.json']
    """
    folder = Path(folder)
    settings = sweep_settings(key, levels, noise, seeds, samples, chunk)
    chunks = Chunks(folder, settings)
    wanted = list(chunks)
    parts: list[Sweep | None] = [None] * len(wanted)
    if is_first():
        _open(folder, settings, resume)
        parts = [_stored(chunks, numbers, announce) for numbers in wanted]
    missing = np.flatnonzero(from_first(np.array([part is None for part in parts])))
    there = len(wanted) - len(missing)
    found_there = f" ({there} were there)" if there else ""
    for done, position in enumerate(missing, start=there):
        if progress is not None:
            progress(f"chunk {done + 1} of {len(wanted)}{found_there}", done / len(wanted))
        part = _computed(key, settings, wanted[position], announce)
        if is_first():
            chunks.write(part)
        parts[position] = part
    found = [part for part in parts if part is not None]
    if not is_first():
        return merge(found) if found else None
    whole = merge(found)
    write_files({folder / RESULT: json_bytes(whole.to_json())})
    return whole


def load_folder(folder: str | Path) -> Sweep:
    """Read a sweep that `sweep_to_folder` finished.

    Args:
        folder: the folder.

    Returns:
        The results of all seeds.

    Raises:
        InputError: it holds no sweep, or one that is not whole.
    """
    folder = Path(folder)
    manifest = _manifest(folder)
    if manifest is None:
        raise InputError(f"{folder}: there is no {MANIFEST}; give a folder that a sweep wrote")
    chunks = Chunks(folder, manifest["settings"])
    wanted = list(chunks)
    missing = sum(not chunks.note(numbers).exists() for numbers in wanted)
    if missing:
        raise InputError(
            f"{folder}: {missing} of {len(wanted)} chunks of the sweep are missing; finish it by "
            "the command that began it"
        )
    return merge([chunks.read(numbers) for numbers in wanted])


def sweep_settings(
    key: jax.Array,
    levels: Sequence[int],
    noise: Sequence[float],
    seeds: int | Sequence[int],
    samples: int,
    chunk: int,
) -> dict[str, Any]:
    """Settings of a sweep on disk as they stand in its manifest.

    Args:
        key: random key.
        levels: N of the planes.
        noise: standard deviations of the noise, µm.
        seeds: how many realisations, or their numbers.
        samples: time steps.
        chunk: how many seeds are computed at once.

    Returns:
        Lists and numbers by name.

    Raises:
        InputError: a number is out of its range; the message begins with the argument's name.

    Example:
        >>> sweep_settings(jax.random.key(3), (9, 5), (0.1,), 2, 2000, 8)["key"]
        [0, 3]
    """
    levels, noise, numbers, samples = checked_settings(levels, noise, seeds, samples)
    return {
        "key": jax.random.key_data(key).tolist(),
        "levels": list(levels),
        "noise": list(noise),
        "seeds": list(numbers),
        "samples": samples,
        "chunk": whole_number("chunk is", chunk, 1),
    }


def _open(folder: Path, settings: dict[str, Any], resume: bool) -> None:
    """Write the manifest of a new sweep, or make sure that the one there has the same settings."""
    manifest = {"format": FORMAT, "settings": settings, "made_with": made_with()}
    old = _manifest(folder) if resume else None
    if old is None:
        (folder / RESULT).unlink(missing_ok=True)
        Chunks(folder, settings).clear()
        shutil.rmtree(folder / ARRAYS, ignore_errors=True)
        write_files({folder / MANIFEST: json_bytes(manifest)})
        return
    there, now = ({**one["settings"], **one["made_with"]} for one in (old, manifest))
    held = there["seeds"]
    if len(held) < len(settings["seeds"]) and held == settings["seeds"][: len(held)]:
        there["seeds"] = now["seeds"]  # more seeds continue a sweep
    other = [name for name in now if there.get(name) != now[name]]
    if other:
        differ = ", ".join(
            f"{name} {_shown(there.get(name))} and not {_shown(now[name])}" for name in other
        )
        raise InputError(f"{folder} holds a sweep with {differ}: {_REMEDY}")
    if held != settings["seeds"]:
        (folder / RESULT).unlink(missing_ok=True)
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


def _manifest(folder: Path) -> dict[str, Any] | None:
    path = folder / MANIFEST
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        if content["format"] > FORMAT:
            raise InputError(
                f"{path} has the format {content['format']}, and {FORMAT} is the newest that this "
                "version reads: update preisach_jax, or choose another folder with --out"
            )
        if not (content["settings"].keys() >= {"seeds", "chunk"} and content["made_with"].keys()):
            raise ValueError("it lacks the seeds, the chunk or the versions")
        return content
    except (FileNotFoundError, NotADirectoryError):
        return None
    except InputError:
        raise
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(
            f"{path} cannot be read as the manifest of a sweep ({error}): {_REMEDY}"
        ) from error


def _stored(
    chunks: Chunks, numbers: list[int], announce: Callable[[str], object] | None
) -> Sweep | None:
    """A chunk that is there and whole; else None, with a note if a part of it is there."""
    if not chunks.note(numbers).exists():
        return None
    try:
        return chunks.read(numbers)
    except InputError as error:
        if announce is not None:
            announce(f"computed again: {error}")
        return None


def _computed(
    key: jax.Array,
    settings: dict[str, Any],
    numbers: list[int],
    announce: Callable[[str], object] | None,
) -> Sweep:
    """A chunk; if memory is too small for all its seeds at once, by halves."""
    try:
        return sweep(key, settings["levels"], settings["noise"], numbers, settings["samples"])
    except (MemoryError, jax.errors.JaxRuntimeError) as error:
        too_large = isinstance(error, MemoryError) or "RESOURCE_EXHAUSTED" in str(error)
        if not too_large or len(numbers) == 1 or jax.process_count() > 1:
            raise
    half = (len(numbers) + 1) // 2
    if announce is not None:
        announce(f"too little memory for {len(numbers)} seeds at once: {half} are taken")
    halves = numbers[:half], numbers[half:]
    return merge([_computed(key, settings, part, announce) for part in halves])


def _shown(value: Any) -> str:
    """A setting in few words."""
    if isinstance(value, list) and len(value) > 8:
        return f"{value[0]} ... {value[-1]} ({len(value)} values)"
    return ",".join(str(one) for one in value) if isinstance(value, list) else str(value)

"""Sweeps on disk, in chunks of seeds, each written as it is done: an interruption loses little.

A folder holds `manifest.json` (the settings), `chunks/seeds_0000-0007.npz` and so on (one `Sweep`
each), and at the end `sweep.json`. Files appear whole or not at all, and the realisation of a seed
depends on the key and its number only: a sweep that was interrupted ends with the same numbers.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax

from preisach_jax.errors import InputError, whole_number
from preisach_jax.files import json_bytes, write_files
from preisach_jax.sweep import LEVELS, NOISE_UM, checked_settings, sweep
from preisach_jax.sweep.result import Sweep, merge

FORMAT = 1
_REMEDY = "choose another folder with --out, or start anew with --restart"
MANIFEST, RESULT, CHUNKS = "manifest.json", "sweep.json", "chunks"


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
) -> Sweep:
    """Run a sweep by chunks of seeds into a folder, or go on with one that was interrupted.

    Args:
        folder: the folder; it need not exist.
        key: random key (`jax.random.key`); realisation i depends on the key and on i only.
        levels: N of the planes, each at least 2.
        noise: standard deviations of the noise where the truth is known, µm.
        seeds: how many realisations of input and noise, or their numbers.
        samples: time steps at 2 kHz.
        chunk: how many seeds are computed at once, and written when they are done.
        resume: keep the chunks that are there; otherwise start anew.
        progress: called with a text and the part that is done.
        announce: called with a note for each chunk that is there and must be computed again.

    Returns:
        The results of all seeds.

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
        ...     print(sorted(path.name for path in Path(folder, "chunks").iterdir()))
        ['chunks', 'manifest.json', 'sweep.json']
        ['seeds_0000-0000.npz', 'seeds_0001-0001.npz']
    """
    folder = Path(folder)
    settings = sweep_settings(key, levels, noise, seeds, samples, chunk)
    _open(folder, settings, resume)
    paths = _chunk_paths(folder, settings)
    parts = []
    for path, numbers in paths:
        if progress is not None:
            progress(f"chunk {len(parts) + 1} of {len(paths)}", len(parts) / len(paths))
        part = _stored(path, settings, numbers, announce)
        if part is None:
            part = sweep(key, settings["levels"], settings["noise"], numbers, settings["samples"])
            part.save(path)
        parts.append(part)
    found = merge(parts)
    write_files({folder / RESULT: json_bytes(found.to_json())})
    return found


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
    paths = _chunk_paths(folder, manifest["settings"])
    missing = sum(not path.exists() for path, _ in paths)
    if missing:
        raise InputError(
            f"{folder}: {missing} of {len(paths)} chunks of the sweep are missing; finish it by "
            "the command that began it"
        )
    return merge([Sweep.load(path) for path, _ in paths])


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
        for path in (folder / RESULT, *folder.glob(f"{CHUNKS}/seeds_*.npz")):
            path.unlink(missing_ok=True)
        write_files({folder / MANIFEST: json_bytes(manifest)})
        return
    there, now = ({**one["settings"], **one["made_with"]} for one in (old, manifest))
    other = [name for name in now if there.get(name) != now[name]]
    if other:
        differ = ", ".join(
            f"{name} {_shown(there.get(name))} and not {_shown(now[name])}" for name in other
        )
        raise InputError(f"{folder} holds a sweep with {differ}: {_REMEDY}")


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


def _chunk_paths(folder: Path, settings: dict[str, Any]) -> list[tuple[Path, list[int]]]:
    """File and seeds of each chunk."""
    seeds, chunk = settings["seeds"], settings["chunk"]
    chunks = [seeds[begin : begin + chunk] for begin in range(0, len(seeds), chunk)]
    return [
        (folder / CHUNKS / f"seeds_{numbers[0]:04d}-{numbers[-1]:04d}.npz", numbers)
        for numbers in chunks
    ]


def _stored(
    path: Path,
    settings: dict[str, Any],
    numbers: list[int],
    announce: Callable[[str], object] | None,
) -> Sweep | None:
    """A chunk that is there, whole and of these settings; else None, with a note if it is there."""
    if not path.exists():
        return None
    try:
        part = Sweep.load(path)
        held = (part.key, part.levels, part.noise_um, part.seeds)
        wanted = (*(settings[name] for name in ("key", "levels", "noise")), numbers)
        if all(a.tolist() == b for a, b in zip(held, wanted, strict=True)) and (
            part.samples == settings["samples"]
        ):
            return part
        why = f"{path} is of another sweep"
    except InputError as error:
        why = str(error)
    if announce is not None:
        announce(f"computed again: {why}")
    return None


def _shown(value: Any) -> str:
    """A setting in few words."""
    if isinstance(value, list) and len(value) > 8:
        return f"{value[0]} ... {value[-1]} ({len(value)} values)"
    return ",".join(str(one) for one in value) if isinstance(value, list) else str(value)

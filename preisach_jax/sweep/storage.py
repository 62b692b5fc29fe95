"""Sweeps on disk, in chunks of seeds.

A folder holds `manifest.json`, `sweep.zarr` with `done/`, and at the end `sweep.json`. The
realisation of a seed depends on the key and its number only: a sweep that was interrupted ends with
the same numbers, on whatever devices.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np

from preisach_jax.devices import is_first
from preisach_jax.errors import InputError, whole_number
from preisach_jax.files import json_bytes, write_files
from preisach_jax.sweep import LEVELS, NOISE_UM, checked_settings, sweep
from preisach_jax.sweep.result import Sweep, merge
from preisach_jax.work.chunks import MANIFEST, Chunks, Values
from preisach_jax.work.manifest import read_manifest
from preisach_jax.work.run import Work, work_in_chunks

RESULT = "sweep.json"

_ABOUT = ("first", "slope", "compile_s", "run_s", "device")


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

    Arguments:
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
    chunks = _chunks(folder, settings)

    def compute(numbers: list[int]) -> Sweep:
        return sweep(key, settings["levels"], settings["noise"], numbers, settings["samples"])

    def write(numbers: list[int], part: Sweep) -> None:
        chunks.write(numbers, _arrays(part), {name: getattr(part, name) for name in _ABOUT})

    def read(numbers: list[int]) -> Sweep:
        return _part(chunks, numbers)

    work = Work(compute, read, write, merge)
    found = work_in_chunks(chunks, work, resume, folder / RESULT, progress, announce)
    if found is not None and is_first():
        write_files({folder / RESULT: json_bytes(found.to_json())})
    return found


def load_folder(folder: str | Path) -> Sweep:
    """Read a sweep that `sweep_to_folder` finished.

    Arguments:
        folder: the folder.

    Returns:
        The results of all seeds.

    Raises:
        InputError: it holds no sweep, or one that is not whole.
    """
    folder = Path(folder)
    manifest = read_manifest(folder, "sweep", "seeds")
    if manifest is None:
        raise InputError(f"{folder}: there is no {MANIFEST}; give a folder that a sweep wrote")
    chunks = _chunks(folder, manifest["settings"])
    wanted = list(chunks)
    missing = sum(not chunks.note(numbers).exists() for numbers in wanted)
    if missing:
        raise InputError(
            f"{folder}: {missing} of {len(wanted)} chunks of the sweep are missing; finish it by "
            "the command that began it"
        )
    return merge([_part(chunks, numbers) for numbers in wanted])


def sweep_settings(
    key: jax.Array,
    levels: Sequence[int],
    noise: Sequence[float],
    seeds: int | Sequence[int],
    samples: int,
    chunk: int,
) -> dict[str, Any]:
    """Settings of a sweep on disk as they stand in its manifest.

    Arguments:
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


def _chunks(folder: Path, settings: dict[str, Any]) -> Chunks:
    labels = {
        "level": Values(("level",), np.array(settings["levels"])),
        "noise": Values(("noise",), np.array(settings["noise"]), "um"),
        "seed": Values(("seed",), np.array(settings["seeds"])),
    }
    return Chunks(folder, "sweep", "seed", settings, settings["seeds"], labels)


def _arrays(part: Sweep) -> dict[str, Values]:
    """All arrays of a sweep that have seeds."""
    found = {
        name: Values(axes, getattr(part, name), unit) for name, (axes, unit) in part.AXES.items()
    }
    for N, rows in zip(part.levels, part.weights, strict=True):
        found[f"weights_{N}"] = Values(("seed", "output", f"cell_{N}"), rows, "um")
    return found


def _part(chunks: Chunks, numbers: list[int]) -> Sweep:
    """The sweep of a chunk of seeds in a folder."""
    settings = chunks.settings
    weights = [f"weights_{N}" for N in settings["levels"]]
    arrays, about = chunks.read(numbers, (*Sweep.AXES, *weights))
    return Sweep(
        levels=np.array(settings["levels"]),
        noise_um=np.array(settings["noise"]),
        seeds=np.array(numbers),
        samples=settings["samples"],
        key=np.array(settings["key"], np.uint32),
        weights=tuple(arrays[name] for name in weights),
        **{name: arrays[name] for name in Sweep.AXES},
        **{name: about[name] for name in _ABOUT},
    )

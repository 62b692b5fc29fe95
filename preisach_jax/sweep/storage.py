"""A sweep in a folder: a file for each chunk of seeds, so that an interruption loses little.

The realisation of a seed depends on the key and its number only: a sweep that was interrupted ends
with the same numbers, on whatever devices.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import cast

import jax
import numpy as np

from preisach_jax.errors import InputError, whole_number
from preisach_jax.files import json_bytes, write_files
from preisach_jax.sweep import LEVELS, NOISE_UM, checked_settings, sweep
from preisach_jax.sweep.result import Sweep, merge

RESULT = "sweep.json"

CHUNKS = "seeds_*.npz"


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
) -> Sweep:
    """Run a sweep by chunks of seeds into a folder, or go on with one that was interrupted."""
    folder = Path(folder)
    levels, noise, numbers, samples = checked_settings(levels, noise, seeds, samples)
    chunk = whole_number("chunk is", chunk, 1)
    there = {path: _read(path) for path in sorted(folder.glob(CHUNKS))}
    if resume:
        asked = {"levels": levels, "noise_um": noise, "samples": samples,
                 "key": jax.random.key_data(key)}  # fmt: skip
        for path, part in there.items():
            _check_same(path, part, asked)
    else:
        for path in there:
            path.unlink(missing_ok=True)
        there = {}
    parts = list(there.values())
    held = {seed for part in parts for seed in part.seeds.tolist()}
    missing = [seed for seed in numbers if seed not in held]
    for begin in range(0, len(missing), chunk):
        own = missing[begin : begin + chunk]
        if progress is not None:
            done = len(held) + begin
            progress(f"seed {done + 1} of {len(held) + len(missing)}",
                     done / (len(held) + len(missing)))  # fmt: skip
        parts.append(_computed(key, levels, noise, own, samples))
        parts[-1].save(folder / f"seeds_{own[0]:04d}-{own[-1]:04d}.npz")
    found = merge(sorted(parts, key=lambda part: int(part.seeds[0])))
    write_files({folder / RESULT: json_bytes(found.to_json())})
    return found


def load_folder(folder: Path) -> Sweep:
    """The results of all seeds in a folder."""
    parts = [_read(path) for path in sorted(folder.glob(CHUNKS))]
    if not parts:
        raise InputError(f"{folder}: there is no {CHUNKS} in it; give a folder that a sweep wrote")
    return merge(parts)


def _read(path: Path) -> Sweep:
    return Sweep.from_file(
        path, f"remove {path.name} and give the same command again, which computes its seeds anew"
    )


def _computed(
    key: jax.Array,
    levels: Sequence[int],
    noise: Sequence[float],
    seeds: Sequence[int],
    samples: int,
) -> Sweep:
    try:
        return sweep(key, levels, noise, seeds, samples)
    except (MemoryError, cast(type[Exception], jax.errors.JaxRuntimeError)) as error:
        if not (isinstance(error, MemoryError) or "RESOURCE_EXHAUSTED" in str(error)):
            raise
        raise InputError(
            f"memory is too small for {len(seeds)} seeds at once: give a smaller chunk; the seeds "
            "that were finished stay"
        ) from error


def _check_same(path: Path, part: Sweep, asked: Mapping[str, object]) -> None:
    """Make sure that a chunk has the settings that are asked for."""
    for name, value in asked.items():
        held, wanted = np.ravel(getattr(part, name)), np.ravel(cast(float, value))
        if not np.array_equal(held, wanted):
            held, wanted = (",".join(f"{one:g}" for one in each) for each in (held, wanted))
            raise InputError(
                f"{path.parent} holds a sweep with {name.removesuffix('_um')} {held} and not "
                f"{wanted}: choose another folder with --out, or start again with --restart"
            )

"""Long work that is done chunk by chunk, and goes on after an interruption."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Generic, NamedTuple, TypeVar, cast

import jax
import numpy as np

from preisach_jax.devices import from_first, is_first
from preisach_jax.errors import InputError
from preisach_jax.work.chunks import MANIFEST, Chunks
from preisach_jax.work.manifest import open_work

Part = TypeVar("Part")

Progress = Callable[[str, float], None]

Announce = Callable[[str], object]


class Work(NamedTuple, Generic[Part]):
    """What to do for a chunk.

    Attributes:
        compute: makes the part of some items.
        read: the part of a chunk from the folder.
        write: a part to the folder.
        merge: joins parts.
    """

    compute: Callable[[list[int]], Part]
    read: Callable[[list[int]], Part]
    write: Callable[[list[int], Part], None]
    merge: Callable[[Sequence[Part]], Part]


def work_in_chunks(
    chunks: Chunks,
    work: Work[Part],
    resume: bool = True,
    result: Path | None = None,
    progress: Progress | None = None,
    announce: Announce | None = None,
) -> Part | None:
    """Compute all chunks that are not there, or go on with what was interrupted.

    Arguments:
        chunks: of the work.
        work: what to do for one.
        resume: keep the chunks that are there; otherwise start anew.
        result: a file that the finished work writes; it is removed where it no longer fits.
        progress: called with a text and the part that is done.
        announce: called with a note for each chunk that is there and must be computed again, and if
            memory is too small for a whole chunk at once.

    Returns:
        All parts joined; in processes other than the first, those that it computed with them, or
        None.

    Raises:
        InputError: the folder holds work with other settings, or it cannot be written to.
    """
    wanted = list(chunks)
    parts: list[Part | None] = [None] * len(wanted)
    if is_first():
        open_work(chunks, resume, result)
        parts = [_stored(chunks, work, numbers, announce) for numbers in wanted]
    missing = np.flatnonzero(from_first(np.array([part is None for part in parts])))
    there = len(wanted) - len(missing)
    found_there = f" ({there} were there)" if there else ""
    for done, position in enumerate(missing, start=there):
        if progress is not None:
            progress(f"chunk {done + 1} of {len(wanted)}{found_there}", done / len(wanted))
        numbers = wanted[position]
        part = _computed(chunks, work, numbers, announce)
        if is_first():
            if not (chunks.folder / MANIFEST).exists():
                raise InputError(
                    f"{chunks.folder}: it was removed or emptied while the {chunks.work} ran; give "
                    "the same command again, which begins anew"
                )
            work.write(numbers, part)
        parts[position] = part
    found = [part for part in parts if part is not None]
    return work.merge(found) if found else None


def _stored(
    chunks: Chunks, work: Work[Part], numbers: list[int], announce: Announce | None
) -> Part | None:
    """A chunk that is there and whole; else None, with a note if a part of it is there."""
    if not chunks.note(numbers).exists():
        return None
    try:
        return work.read(numbers)
    except InputError as error:
        if announce is not None:
            announce(f"computed again: {error}")
        return None


def _computed(
    chunks: Chunks, work: Work[Part], numbers: list[int], announce: Announce | None
) -> Part:
    """A chunk; if memory is too small for all its items at once, by halves."""
    try:
        return work.compute(numbers)
    except (MemoryError, cast(type[Exception], jax.errors.JaxRuntimeError)) as error:
        too_large = isinstance(error, MemoryError) or "RESOURCE_EXHAUSTED" in str(error)
        if not too_large or len(numbers) == 1 or jax.process_count() > 1:
            raise
    half = (len(numbers) + 1) // 2
    if announce is not None:
        announce(f"too little memory for {len(numbers)} {chunks.item}s at once: {half} are taken")
    halves = numbers[:half], numbers[half:]
    return work.merge([_computed(chunks, work, part, announce) for part in halves])

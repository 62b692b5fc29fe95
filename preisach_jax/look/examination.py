"""Look at a record or a file: find what stands out, and judge what the record can tell."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Unpack

import numpy as np
import scipy

from preisach_jax.look import stretches
from preisach_jax.look.columns import ColumnView, columns_of
from preisach_jax.look.prospects import Excitation, of_several, prospects
from preisach_jax.look.result import Look
from preisach_jax.record.columns import ReadOptions, all_runs, numbered
from preisach_jax.record.core import Record
from preisach_jax.record.faults import faults
from preisach_jax.record.marks import spans
from preisach_jax.record.reading import read_tables
from preisach_jax.record.spikes import WINDOW, gross_spikes, input_spikes, isolated_spikes
from preisach_jax.record.table import Table

SPIKE_SHARE = 0.3
"""Share of a spike's height that the samples beside it must have to be part of it."""

SHARPER = 2.0
"""Times the steps of the course just before and after a spike that it rises and falls by."""


def look(
    record: Record | str | os.PathLike[str],
    *,
    effects: Sequence[str] | None = None,
    columns: Sequence[ColumnView] = (),
    notes: Sequence[str] = (),
) -> Look:
    """Look at a record before any fit: sampling, excitation, blemishes, and what it can tell.

    Arguments:
        record: the measurement, or a file, whose columns are guessed.
        effects: names of the effects to judge; all of the library by default.
        columns: the columns of the file it was made of, as `columns_of` gives them.
        notes: what was guessed and assumed when it was read.

    Returns:
        What was found; `plot()` draws it, `to_json()` has the numbers.

    Raises:
        InputError: the input or the output is constant, or too little was measured.

    Example:
        >>> t = np.arange(3000) / 100
        >>> u = np.abs((t % 4) - 2)
        >>> found = look(Record.from_arrays(t, u, u**1.1, units={"input": "V"}))
        >>> len(found.excitation.turns), found.excitation.repeats, "creep" in found.cannot_tell
        (14, 7, True)
    """
    if not isinstance(record, Record):
        return look_at_file(record)
    record.check_identifiable()
    gross = gross_spikes(record)
    of_input = input_spikes(record)
    clean = record.without(gross)
    course = _interpolated(clean)
    smooth = scipy.ndimage.median_filter(course, WINDOW, mode="nearest")
    turning = stretches.turns(clean.bridged(of_input))
    alone = isolated_spikes(clean, smooth) & ~_at_turns(clean, turning)
    alone &= _as_high_as_beside(np.abs(course - smooth), alone)
    alone = _sharper_than_around(course, alone)
    clean = clean.without(alone).bridged(of_input)
    still = stretches.rests(clean)
    sick = faults(clean)
    excitation = Excitation(
        clean,
        turning,
        tuple(still),
        tuple(stretches.strokes(clean, turning, still)),
        stretches.noise_rms(clean.output),
        stretches.resolution(clean.output),
        stretches.resolution(clean.input),
    )
    return Look(
        record,
        excitation,
        np.flatnonzero(gross | alone),
        np.flatnonzero(of_input),
        stretches.at_fault(clean, "stuck", sick),
        stretches.at_fault(clean, "clipped", sick),
        stretches.at_fault(clean, "wrapped", sick),
        prospects(excitation, None if effects is None else tuple(effects)),
        tuple(columns),
        tuple(notes),
    )


def look_at_table(given: Table, name: str, /, **options: Unpack[ReadOptions]) -> Look:
    """Look at the record in the columns of a file."""
    notes: list[str] = []
    options["announce"] = notes.append
    record = Record.of_table(given, name, **options)
    told = [role for role in ("time", "input", "output") if options.get(role)]
    return look(record, columns=columns_of(given, record.channels, told), notes=notes)


def look_at_file(path: str | os.PathLike[str], **options: Unpack[ReadOptions]) -> Look:
    """Look at the first record in a file, or that of the option `table`; see `look_at_table`."""
    return look_at_tables(all_runs(read_tables(path), options), Path(path).name, **options)


def look_at_tables(parts: Sequence[Table], name: str, /, **options: Unpack[ReadOptions]) -> Look:
    """Look at one of the records of a file, as `all_runs` gives them, and list all of them.

    Unless one is asked for, what can be told is judged of all together, as they are diagnosed.
    """
    found = look_at_table(numbered(parts, options.get("table")), name, **options)
    if len(parts) > 1 and options.get("table") is None:
        others = [look_at_table(part, name, **options).excitation for part in parts[1:]]
        found = replace(found, prospects=prospects(of_several([found.excitation, *others])))
    records = tuple(
        {"name": f"{name}, table {k}" if len(parts) > 1 else name, "rows": part.rows.size,
         "first_row": int(part.rows[0]), "last_row": int(part.rows[-1])}
        for k, part in enumerate(parts, start=1)
    )  # fmt: skip
    return replace(found, records=records)


def _as_high_as_beside(height: np.ndarray, found: np.ndarray) -> np.ndarray:
    """(K,) bool: rows that stand out nearly as much as any beside them.

    A running median that passes a spike by on a slope is off by a little around it.
    """
    beside = scipy.ndimage.maximum_filter1d(np.where(found, height, 0.0), 2 * WINDOW + 1)
    return height > SPIKE_SHARE * np.asarray(beside)


def _sharper_than_around(course: np.ndarray, found: np.ndarray) -> np.ndarray:
    """(K,) bool: of the stretches found, those that begin and end with a jump.

    The peak of a fast course rises over some samples, of which its step is one among equals.
    """
    kept = np.zeros_like(found)
    for start, stop in spans(found):
        if start < 2 or stop > len(course) - 2:
            continue
        before, into = np.abs(np.diff(course[start - 2 : start + 1]))
        out, after = np.abs(np.diff(course[stop - 1 : stop + 2]))
        kept[start:stop] = into > SHARPER * before and out > SHARPER * after
    return kept


def _at_turns(record: Record, turning: np.ndarray) -> np.ndarray:
    """(K,) bool: rows beside turns and jumps of the input, where the output may well jump."""
    steps = np.abs(np.diff(record.input, prepend=record.input[:1]))
    jumps = steps > 10 * np.median(steps)
    jumps[turning] = True
    return np.asarray(scipy.ndimage.binary_dilation(jumps, iterations=WINDOW))


def _interpolated(record: Record) -> np.ndarray:
    """(K,) output with straight lines where nothing was measured."""
    there = record.measured
    return np.interp(record.time, record.time[there], record.output[there])

"""TDMS, the binary files of LabVIEW and DIAdem."""

from __future__ import annotations

import logging
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from preisach_jax.errors import ContentError, InputError
from preisach_jax.record.containers import table_of_arrays
from preisach_jax.record.readers.base import Reader, check_unpacked, library, not_readable
from preisach_jax.record.sampling import Signal, table_of_signals, with_stated_time
from preisach_jax.record.settings import Sampling
from preisach_jax.record.table import Table
from preisach_jax.record.units import plain_unit

_UNITS = ("unit_string", "NI_UnitDescription")


def read_tdms(path: Path, source: str) -> Table:
    """Read the channels of a TDMS file; needs the optional package npTDMS.

    The index file beside it, `.tdms_index`, is not read: it may be of another state of the file.
    """
    nptdms = library("nptdms", "npTDMS", "TDMS files", source)
    try:
        with _silent(), path.open("rb") as stream, nptdms.TdmsFile.open(stream) as file:
            groups = [group for group in file.groups() if group.channels()]
            channels = {
                (each.name if len(groups) == 1 else f"{group.name}/{each.name}"): each
                for group in groups
                for each in group.channels()
                if len(each)
            }
            values = sum(len(each) for each in channels.values())
            check_unpacked(values, path.stat().st_size, source, "its defragmentation in LabVIEW")
            arrays = {name: np.asarray(each[:]) for name, each in channels.items()}
            about = {name: dict(each.properties) for name, each in channels.items()}
            if not arrays:
                raise ContentError("it holds no channels with samples")
    except InputError:
        raise
    except Exception as error:  # npTDMS raises many kinds on a broken file
        remedy = "defragment it in LabVIEW or DIAdem, or export it as CSV"
        raise not_readable("TDMS", error, source, remedy) from None
    units = {name: unit for name in arrays if (unit := _unit(about[name]))}
    steps = {name: float(about[name].get("wf_increment", 0)) for name in arrays}
    stated = {name: step for name, step in steps.items() if step > 0}
    if len({array.size for array in arrays.values()}) > 1 and stated:
        return table_of_signals(_signals(arrays, about, stated, units), source)
    step = next(iter(stated.values()), None)
    table = table_of_arrays(arrays, source, units=units)
    return with_stated_time(table, None if step is None else Sampling(step, "wf_increment", 0))


@contextmanager
def _silent() -> Generator[None]:
    """Keep npTDMS from writing pages of bytes to the terminal before it fails."""
    manager = library("nptdms.log", "npTDMS", "TDMS files", "a TDMS file").log_manager
    before = manager.log_level
    manager.set_level(logging.CRITICAL)
    try:
        yield
    finally:
        manager.set_level(before)


def _unit(properties: dict[str, Any]) -> str:
    return plain_unit(next((str(properties[n]) for n in _UNITS if properties.get(n)), ""))


def _signals(
    arrays: dict[str, np.ndarray],
    about: dict[str, dict[str, Any]],
    steps: dict[str, float],
    units: dict[str, str],
) -> dict[str, Signal]:
    """The channels that have a sample interval, their starts on a common clock."""
    starts: dict[str, float] = {}
    times: dict[str, Any] = {name: about[name].get("wf_start_time") for name in steps}
    dated: list[Any] = [time for time in times.values() if isinstance(time, np.datetime64)]
    for name in steps:
        starts[name] = float(about[name].get("wf_start_offset", 0.0))
        if len(dated) == len(steps):
            starts[name] += float((times[name] - min(dated)) / np.timedelta64(1, "s"))
    return {
        name: Signal(arrays[name], starts[name], step, units.get(name, ""))
        for name, step in steps.items()
        if arrays[name].dtype.kind in "iuf"
    }


TDMS = Reader(
    "LabVIEW TDMS",
    (".tdms",),
    (b"TDSm",),
    read_tdms,
    note="`channel`, or `group/channel`; time from `wf_increment`, units from `unit_string`",
)

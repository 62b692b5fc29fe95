"""`preisach fleet`: one adaptive filter on the records of many stages."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from preisach_jax.cli import screen
from preisach_jax.cli.options import Force
from preisach_jax.cli.resumable import (
    Chunk,
    Coordinator,
    Distributed,
    Process,
    Processes,
    Resume,
    check_work,
    named_by_option,
    run_in_folder,
    start_devices,
)
from preisach_jax.cli.shared import command
from preisach_jax.errors import InputError
from preisach_jax.quantity import pretty_unit

if TYPE_CHECKING:
    from preisach_jax.filter.fleet import FleetResult
    from preisach_jax.operator.plane import Plane
    from preisach_jax.record import ReadOptions, Record

_NAMES = ("levels", "low", "high", "hysteron", "passes", "step_size", "chunk")

TABLE = "fleet.csv"
SHOWN = 20
"""Records that are printed, and no more."""


@command(
    "preisach fleet stages/*.csv --out fleet",
    "preisach fleet stages/*.csv --out fleet --levels 37 --low 0 --high 75",
    "preisach fleet stages/*.csv --out fleet --json --quiet > fleet.json",
    reads=("time", "input", "output", "rate", "unit"),
)
def fleet(
    context: typer.Context,
    data: Annotated[list[Path], typer.Argument(metavar="DATA...", help="records of like stages")],
    columns: ReadOptions,
    out: Annotated[
        Path, typer.Option(metavar="DIR", help="folder of the results; a fleet in it is resumed")
    ],
    levels: Annotated[int, typer.Option(metavar="N", help="levels of the Preisach plane")] = 37,
    low: Annotated[
        float | None,
        typer.Option(
            metavar="X",
            help="lower limit of the plane [of all inputs; give it if records may follow]",
        ),
    ] = None,
    high: Annotated[
        float | None, typer.Option(metavar="X", help="upper limit of the plane [of all inputs]")
    ] = None,
    hysteron: Annotated[str, typer.Option(metavar="KIND", help="ramp or relay")] = "ramp",
    passes: Annotated[int, typer.Option(metavar="P", help="number of passes over each record")] = 5,
    step_size: Annotated[
        float, typer.Option(metavar="MU", help="step size; below 1 for noisy records")
    ] = 1.0,
    chunk: Chunk = 16,
    resume: Resume = True,
    distributed: Distributed = False,
    coordinator: Coordinator = None,
    processes: Processes = None,
    process: Process = None,
    force: Force = False,
) -> dict[str, Any] | None:
    """Identify many stages at once by the adaptive filter, each from saturated low."""
    from preisach_jax.devices import disconnect, is_first
    from preisach_jax.files import is_same, write_files
    from preisach_jax.filter.adaptive import AdaptiveFilter
    from preisach_jax.filter.fleet import fleet_to_folder
    from preisach_jax.operator.plane import Plane

    check_work(out, "fleet", "record", data, TABLE, force)
    if inside := next(
        (path for path in data if is_same(Path(os.path.realpath(path)).parent, out)), None
    ):
        raise InputError(
            f"--out is {out}, the folder of {inside}: choose another, or the table of results is "
            "taken for a record later"
        )
    start_devices(distributed, coordinator, processes, process)
    records = _load(data, {**columns, "initial_memory": "low"})
    low = min(record.input.min() for record in records) if low is None else low
    high = max(record.input.max() for record in records) if high is None else high
    plane = named_by_option(_NAMES, Plane, levels, low, high)
    _check_range(data, records, plane)
    adaptive = named_by_option(
        _NAMES, partial(AdaptiveFilter, plane, hysteron, step_size=step_size)
    )
    pairs = [(record.input, record.output) for record in records]
    names = _names(data)

    def run(**watchers: Any) -> FleetResult | None:
        work = partial(fleet_to_folder, out, adaptive, pairs, names, passes, chunk, resume)
        return named_by_option(_NAMES, partial(work, **watchers))

    found = run_in_folder(out, context.obj["command"], run)
    content = None
    if found is not None and is_first():
        unit_of_output = records[0].output_unit
        rows = _rows(names, records, found)
        write_files({out / TABLE: _table(unit_of_output, rows)})
        _show(unit_of_output, rows)
        screen.say(f"\nTable: {out / TABLE}; weights: {out / 'fleet.zarr'}")
        content = screen.written(
            [out / TABLE, out / "fleet.zarr"],
            unit=unit_of_output,
            records=[row._asdict() for row in rows],
        )
    disconnect()
    return content


def _load(paths: Sequence[Path], columns: ReadOptions) -> list[Record]:
    """All records; those of a fleet have the same units.

    Raises:
        InputError: if one cannot be loaded, is given twice or has other units than the first.
    """
    from preisach_jax.record import Record
    from preisach_jax.record.blemishes import torn_line

    records: list[Record] = []
    for number, path in enumerate(paths):
        if path in paths[:number]:
            raise InputError(f"{path} is given twice: give each record once")
        notes: list[str] = []
        record = Record.load(path, **{**columns, "announce": notes.append})
        for role in ("input", "output"):
            here, first = (one.channels[role].unit for one in (record, (records or [record])[0]))
            if pretty_unit(here) != pretty_unit(first):
                raise InputError(
                    f"{path}: its {role} has the unit {here!r}, and that of {paths[0]} {first!r}: "
                    "convert the numbers of one of them (--unit only names a unit and converts "
                    "nothing)"
                )
        if len(paths) <= SHOWN:
            screen.show_record(record, notes)
        elif record.torn_row is not None:
            screen.note(f"{path}: {torn_line(record)}")
        records.append(record)
    if len(paths) > SHOWN:
        samples = sum(len(record.time) for record in records)
        screen.note(f"{len(records)} records, {samples:,} samples in all")
    return records


def _names(paths: Sequence[Path]) -> list[str]:
    """What the results call the records: their files, from the folder that holds them all.

    Folders above it tell who works where, which is nobody's business who reads the results.

    Example:
        >>> _names([Path("/home/ada/a/x.csv"), Path("/home/ada/b/x.csv")])
        ['a/x.csv', 'b/x.csv']
    """
    whole = [Path(os.path.realpath(path)).parent / path.name for path in paths]
    try:
        common = os.path.commonpath([path.parent for path in whole])
    except ValueError:  # on several drives
        return [str(path) for path in paths]
    return [path.relative_to(common).as_posix() for path in whole]


def _check_range(paths: Sequence[Path], records: Sequence[Record], plane: Plane) -> None:
    for path, record in zip(paths, records, strict=True):
        least, most = record.input.min(), record.input.max()
        if least < plane.low or most > plane.high:
            raise InputError(
                f"{path}: the input reaches from {least:.6g} to {most:.6g}, and the plane from "
                f"{plane.low:.6g} to {plane.high:.6g}: move --low and --high outward"
            )


class Row(NamedTuple):
    """What the table tells of one record; errors in the unit of the output."""

    record: str
    samples: int
    updates: int
    error: float
    replay_error: float
    offset: float
    replay_error_percent: float


def _rows(names: Sequence[str], records: Sequence[Record], found: FleetResult) -> list[Row]:
    import numpy as np

    ranges = [np.nanmax(record.output) - np.nanmin(record.output) for record in records]
    return [
        Row(
            name, len(record.time), int(found.updates[k]), float(found.error[k]),
            float(found.replay_error[k]), float(found.offset[k]),
            float(100 * found.replay_error[k] / ranges[k]),
        )
        for k, (name, record) in enumerate(zip(names, records, strict=True))
    ]  # fmt: skip


def _table(unit: str, rows: Sequence[Row]) -> bytes:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    own = f" ({unit})" if unit else ""
    writer.writerow(
        [
            "record",
            "samples",
            "updates",
            f"error{own}",
            f"replay_error{own}",
            f"offset{own}",
            "replay_error (%)",
        ]
    )
    writer.writerows(row._replace(record=_no_formula(row.record)) for row in rows)
    return text.getvalue().encode(errors="replace")


def _no_formula(name: str) -> str:
    """A name that no spreadsheet takes for a formula, which might call programs or send data away.

    Example:
        >>> _no_formula("=1+1.csv"), _no_formula("stage.csv")
        ("'=1+1.csv", 'stage.csv')
    """
    return f"'{name}" if name.startswith(("=", "+", "-", "@", "\t", "\r")) else name


def _show(unit: str, rows: Sequence[Row]) -> None:
    """Print the records, the worst first."""
    own = f" ({pretty_unit(unit)})" if unit else ""
    short = [Path(row.record).name for row in rows]
    named = dict(zip((row.record for row in rows), short, strict=True))
    if len(set(short)) < len(short):
        named = {row.record: row.record for row in rows}
    worst = sorted(rows, key=lambda row: -row.replay_error_percent)
    screen.say()
    screen.table(
        ("record", "samples", "updates", f"error{own}", f"replay error{own}", "% of its range"),
        [
            (named[row.record], f"{row.samples:,}", f"{row.updates:,}", f"{row.error:.4g}",
             f"{row.replay_error:.4g}", f"{row.replay_error_percent:.3g}")
            for row in worst[:SHOWN]
        ],
    )  # fmt: skip
    if len(worst) > SHOWN:
        screen.say(f"... and {len(worst) - SHOWN} better")
    screen.say(
        "\nerror: of the next increment, while the filter runs; replay error: of the whole record, "
        "simulated by the final weights, beside a constant (the offset in the table)"
    )
    idle = [row.record for row in rows if not row.updates]
    if idle:
        screen.say(f"nothing was learnt from {', '.join(idle)}: the input hardly moves")

"""`preisach fleet`: many records, each diagnosed or fitted as a task of Dask."""

from __future__ import annotations

import io
import json
import logging
import os
import re
import signal
import tempfile
import threading
import time
import warnings
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from preisach_jax.cli import screen
from preisach_jax.cli.options import (
    READING,
    Effects,
    Force,
    Levels,
    check_choice,
    effect_names,
    with_effects,
)
from preisach_jax.cli.process import kept_between_runs
from preisach_jax.cli.shared import Resume, command, resumable
from preisach_jax.errors import InputError, whole_number
from preisach_jax.quantity import quantity

if TYPE_CHECKING:
    from preisach_jax.record.columns import ReadOptions
    from preisach_jax.record.core import Record

TABLE, ROW = "fleet.parquet", "fleet.json"

SHOWN = 20
"""Records that are printed, and no more."""

MOST_WAITING = 256
"""Records that are handed to the scheduler before others are done."""

CONNECTING_S = 30
"""Seconds within which a scheduler must answer."""

Row = dict[str, Any]
"""What the table tells of one record; errors in the unit of its output."""

COLUMNS = ("record", "folder", "verdict", "effects", "rms_base", "rms", "unit",
           "percent_of_stroke", "levels", "seconds", "why_not")  # fmt: skip


@command(
    "preisach fleet stages/*.csv --out fleet",
    "preisach fleet stages/*.csv --fit --effects creep,delay --out fleet",
    "preisach fleet stages/*.csv --scheduler tcp://node1:8786 --out fleet",
    reads=READING,
)
def fleet(
    context: typer.Context,
    data: Annotated[list[Path], typer.Argument(metavar="DATA...", help="a record of each stage")],
    columns: ReadOptions,
    out: Annotated[
        Path,
        typer.Option(metavar="DIR", help="folder of the results; those that it holds are kept"),
    ],
    effects: Effects = None,
    levels: Levels = None,
    fit: Annotated[
        bool, typer.Option("--fit", help="fit the effects of --effects; diagnose nothing")
    ] = False,
    workers: Annotated[
        int | None, typer.Option(metavar="W", help="processes on this machine [one a core]")
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="a Dask scheduler whose workers do it instead"),
    ] = None,
    resume: Resume = True,
    force: Force = False,
) -> dict[str, Any]:
    """Diagnose or fit many records, one after another on every core or host."""
    from preisach_jax.files import check_folder, json_bytes, write_files
    from preisach_jax.report import diagnosis_names

    for package in ("distributed", "pyarrow"):
        if find_spec(package) is None:
            raise InputError(
                f"the package {package} is missing: pip install 'preisach_jax[cluster]'"
            )
    names = effect_names(effects)
    check_choice(names, levels)
    if workers is not None:
        whole_number("--workers is", workers, 1)
    check_folder(out, data, [TABLE], force=force)
    failed: list[Row] = []
    records = dict(_loaded(data, with_effects(columns, names), failed))
    folders = {path: out / _folder_name(path, record) for path, record in records.items()}
    for folder in folders.values():
        check_folder(folder, data, [ROW, *diagnosis_names(folder)], force=force)
    settings = {
        "does": "fit" if fit else "diagnose",
        "effects": names,
        "levels": levels,
        "version": version("preisach_jax"),
    }
    left = {
        path: record
        for path, record in records.items()
        if not resume or not _is_held(folders[path] / ROW, _identity(record, settings))
    }
    if kept := len(records) - len(left):
        screen.note(f"{kept} of {len(records)} were done before, and are kept")
    try:
        with resumable(out, context.obj["command"]):
            for path, row, files in _done(left, settings, workers, scheduler):
                if not files:
                    failed.append({**row, "record": _name(path)})
                    continue
                folder = folders[path]
                about = {**row, "record": _name(path), "folder": folder.name}
                files[ROW] = json_bytes({**_identity(records[path], settings), "row": about})
                earlier = {*diagnosis_names(folder)} - {*files}
                write_files({folder / each: content for each, content in files.items()})
                for each in earlier:  # of a result with other options
                    (folder / each).unlink(missing_ok=True)
    finally:
        table = _write_table(out, failed)
    _show(table)
    screen.say(f"\nTable: {out / TABLE}; one folder a record in {out}")
    if failed:
        for row in failed[:SHOWN]:
            screen.note(f"{row['record']}: {row['why_not']}")
        raise InputError(
            f"{len(failed)} of the records came to nothing, as {failed[0]['record']}; the column "
            f"why_not of {out / TABLE} says why: mend or leave them out, and give the same command "
            "again"
        )
    return screen.written([out / TABLE, *folders.values()], records=table)


def study(record: Record, settings: Mapping[str, Any]) -> tuple[dict[str, bytes], Row]:
    """Diagnose or fit one record, in a worker: the files of its folder, and its row."""
    import jax

    from preisach_jax.diagnosis import diagnose
    from preisach_jax.files import json_bytes
    from preisach_jax.fit import fit
    from preisach_jax.report import write_report

    names, levels = settings["effects"], settings["levels"]
    begin = time.perf_counter()
    with jax.enable_x64(True), kept_between_runs():
        if settings["does"] == "fit":
            last = fit(record, names, levels)
            verdict, effects, base = "fitted", names, None
            files = {"model.json": json_bytes(last.model.to_json())}
        else:
            found = diagnose(record, names or None, levels)
            verdict, effects, last = found.verdict, found.effects, found.final
            base = found.base.rms_validation
            with tempfile.TemporaryDirectory() as folder:
                place = Path(folder)
                files = {
                    path.relative_to(place).as_posix(): path.read_bytes()
                    for path in write_report(found, place)
                }
    row = {
        "verdict": verdict,
        "effects": ", ".join(effects),
        "rms_base": base,
        "rms": last.rms_validation,
        "unit": record.output_unit,
        "percent_of_stroke": 100 * last.rms_validation / record.output_range,
        "levels": last.model.plane.levels,
        "seconds": time.perf_counter() - begin,
        "why_not": "",
    }
    return files, row


def _loaded(
    paths: Sequence[Path], columns: ReadOptions, failed: list[Row]
) -> Iterator[tuple[Path, Record]]:
    """The records by their files; what cannot be read gets a row that says why."""
    from preisach_jax.record.core import Record

    seen: set[str] = set()
    for path in paths:
        place, notes = os.path.realpath(path), list[str]()
        if place in seen:
            screen.note(f"{path} is given twice, and is taken once")
            continue
        seen.add(place)
        try:
            record = Record.load(path, **{**columns, "announce": notes.append})
        except InputError as error:
            failed.append({**_failed(error, f"{path}: "), "record": _name(path)})
            continue
        if len(paths) <= SHOWN:
            screen.show_record(record, notes)
        yield path, record


def _done(
    records: Mapping[Path, Record],
    settings: Mapping[str, Any],
    workers: int | None,
    scheduler: str | None,
) -> Iterator[tuple[Path, Row, dict[str, bytes]]]:
    """The row and the files of each record, as soon as it is done."""
    from preisach_jax.cores import usable_cores

    if not records:
        return
    waiting, futures = iter(records.items()), dict[Any, Path]()
    workers = min(workers or usable_cores(), len(records))
    with (
        warnings.catch_warnings(),
        _client(workers, scheduler) as (client, completed),
        screen.progress() as show,
    ):
        warnings.filterwarnings("ignore", message="Sending large graph")  # each task has a record

        def submit() -> None:
            for path, record in waiting:
                future = client.submit(study, record, settings, pure=False)
                futures[future] = path
                completed.add(future)
                return

        for _ in range(MOST_WAITING):
            submit()
        show(f"{len(records)} records", 0.0)
        for count, future in enumerate(completed, start=1):
            path, error = futures.pop(future), future.exception()
            if error is None:
                files, row = cast(tuple[dict[str, bytes], Row], future.result())
                yield path, row, files
            else:
                yield path, _failed(error), {}
            future.release()
            submit()
            show(f"{count} of {len(records)} records done", count / len(records))


@contextmanager
def _client(workers: int, scheduler: str | None) -> Generator[tuple[Any, Any]]:
    """A client of Dask, of workers on this machine or of a scheduler that stands elsewhere."""
    from distributed import Client, LocalCluster, as_completed

    connected, cluster_of = cast(Any, Client), cast(Any, LocalCluster)
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # what fails is told in the table
    if scheduler is None:
        with _leaving_interrupts_to_this_process():
            cluster = cluster_of(
                n_workers=workers,
                threads_per_worker=1,
                memory_limit=0,  # the system knows better when memory ends
                dashboard_address="127.0.0.1:0",
                silence_logs=logging.CRITICAL,
            )
        with cluster, connected(cluster) as client:
            yield client, as_completed()
        return
    try:
        client = connected(scheduler, timeout=CONNECTING_S)
    except (OSError, ValueError, TypeError) as error:
        raise InputError(
            f"--scheduler is {scheduler!r}, and no Dask scheduler answered there ({error}): give "
            "its address, as tcp://HOST:8786; `dask scheduler` starts one, `dask worker` workers"
        ) from None
    with client:
        _check_versions(client, scheduler)
        yield client, as_completed()


@contextmanager
def _leaving_interrupts_to_this_process() -> Generator[None]:
    """Processes that are started inside do not hear Ctrl-C, of which each would tell at length."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _check_versions(client: Any, scheduler: str) -> None:
    """Make sure that the workers have this version of the package."""
    here = version("preisach_jax")
    found = client.run(_version_here)
    if not found:
        screen.note(f"{scheduler} has no worker yet: waiting for one (dask worker {scheduler})")
    others = {name: one for name, one in found.items() if one != here}
    if others:
        name, other = next(iter(others.items()))
        raise InputError(
            f"--scheduler is {scheduler}: its worker {name} has preisach_jax {other}, and this is "
            f"{here}: install the same version on all"
        )


def _version_here() -> str:
    try:
        return version("preisach_jax")
    except ImportError:
        return "not at all"


def _failed(error: BaseException, named: str = "") -> Row:
    """The row of a record that came to nothing; its own column names it already."""
    if type(error).__name__ == "KilledWorker":
        why = "its worker died again and again: too little memory for it? Take fewer --workers"
    elif isinstance(error, InputError):
        why = str(error).removeprefix(named)
    else:
        why = f"{type(error).__name__}: {error}"
    return {"verdict": "failed", "effects": "", "why_not": why}


def _name(path: Path) -> str:
    """What the table calls a record: its file as it was given, or its name alone.

    Folders above the one where the command is given tell who works where.
    """
    plain = path.name if path.is_absolute() or ".." in path.parts else path.as_posix()
    return plain.encode(errors="replace").decode()


def _folder_name(path: Path, record: Record) -> str:
    """A name for the folder of a record, which depends on nothing but its file and values."""
    stem = re.sub(r"[^\w-]", "_", path.stem.encode(errors="replace").decode())
    return f"{stem}-{record.sha256[:8]}"


def _identity(record: Record, settings: Mapping[str, Any]) -> dict[str, Any]:
    """What a result was made of: values, what they are taken for, and what was asked."""
    channels = {role: [each.name, each.unit] for role, each in record.channels.items()}
    memory = record.initial_memory
    return {"sha256": record.sha256, "settings": settings, "channels": channels, "memory": memory}


def _read(path: Path) -> dict[str, Any]:
    """What a folder says of the record that it was made of; nothing, if it cannot be read."""
    try:
        content: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        return content if "row" in content else {}
    except (OSError, ValueError, TypeError):
        return {}


def _is_held(path: Path, identity: Mapping[str, Any]) -> bool:
    """Whether a folder holds the result of a record."""
    return _read(path).items() >= identity.items()


def _write_table(out: Path, failed: Sequence[Row]) -> list[Row]:
    """The rows of all records in a folder, and of those that failed, as Parquet."""
    import pyarrow
    from pyarrow import parquet

    from preisach_jax.files import PARQUET_MARK, write_files

    there = (_read(path).get("row") for path in sorted(out.glob(f"*/{ROW}")))
    rows = [dict.fromkeys(COLUMNS) | row for row in [*filter(None, there), *failed]]
    if not rows:
        return []
    arrow, parquet, file = cast(Any, pyarrow), cast(Any, parquet), io.BytesIO()
    table = arrow.table({name: [row[name] for row in rows] for name in COLUMNS})
    parquet.write_table(table.replace_schema_metadata({PARQUET_MARK: b"fleet"}), file)
    write_files({out / TABLE: file.getvalue()})
    return rows


def _show(rows: Sequence[Row]) -> None:
    """Print the records, those with the largest error first."""
    worst = sorted(rows, key=lambda row: -(row.get("percent_of_stroke") or float("inf")))
    screen.say()
    screen.table(
        ("record", "verdict", "effects", "rms", "% of stroke"),
        [
            (
                row["record"],
                row["verdict"],
                row["effects"],
                "" if row["why_not"] else quantity(row["rms"], row["unit"], 3),
                "" if row["why_not"] else f"{row['percent_of_stroke']:.3g}",
            )
            for row in worst[:SHOWN]
        ],
    )
    if len(worst) > SHOWN:
        screen.say(f"... and {len(worst) - SHOWN} with less")

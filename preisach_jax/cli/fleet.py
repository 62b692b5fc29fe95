"""`preisach fleet`: many records, each diagnosed or fitted as a task of Dask."""

from __future__ import annotations

import logging
import os
import tempfile
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
from preisach_jax.cli.compiled import kept_between_runs
from preisach_jax.cli.options import (
    READING,
    Effects,
    Force,
    Levels,
    check_choice,
    effect_names,
    with_effects,
)
from preisach_jax.cli.resumable import Resume, resumable
from preisach_jax.cli.shared import command
from preisach_jax.errors import InputError, whole_number
from preisach_jax.quantity import quantity

if TYPE_CHECKING:
    from preisach_jax.record import ReadOptions, Record

TABLE, ROW = "fleet.parquet", "fleet.json"

SHOWN = 20
"""Records that are printed, and no more."""

MOST_WAITING = 256
"""Records that are handed to the scheduler before others are done."""

CONNECTING_S = 30
"""Seconds within which a scheduler must answer."""

Row = dict[str, Any]
"""What the table tells of one record; errors in the unit of its output."""


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
        Path, typer.Option(metavar="DIR", help="folder of the results; what it holds is kept")
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
    titles = _names(data)
    folders = [out / name for name in _folder_names(titles)]
    check_folder(out, data, [TABLE], force=force)
    for folder in folders:
        check_folder(folder, data, [ROW, *diagnosis_names(folder)], force=force)
    rows: dict[int, Row] = {}
    records = dict(_loaded(data, titles, with_effects(columns, names), rows))
    settings = {
        "does": "fit" if fit else "diagnose",
        "effects": names,
        "levels": levels,
        "version": version("preisach_jax"),
    }
    for k in list(records) if resume else ():
        held = _held(folders[k] / ROW)
        if held and held.items() >= _identity(records[k], settings).items():
            rows[k] = {**held["row"], "record": titles[k]}
            del records[k]
    if held := sum(not row["why_not"] for row in rows.values()):
        screen.note(f"{held} of {len(data)} were done before, and are kept")
    before = len(rows)
    try:
        with resumable(out, context.obj["command"]):
            for k, row, files in _done(records, settings, workers, scheduler):
                rows[k] = {"record": titles[k], **row}
                if not files:
                    continue
                files[ROW] = json_bytes({**_identity(records[k], settings), "row": rows[k]})
                earlier = {*diagnosis_names(folders[k])} - {*files}
                write_files({folders[k] / name: content for name, content in files.items()})
                for name in earlier:  # of a result with other options
                    (folders[k] / name).unlink(missing_ok=True)
    finally:
        table = [rows[k] for k in sorted(rows)]
        if len(rows) > before or not records:  # else a table that is there says more
            _write_table(out / TABLE, table)
    _show(table)
    screen.say(f"\nTable: {out / TABLE}; one folder a record in {out}")
    failed = [row for row in table if row["why_not"]]
    if failed:
        raise InputError(
            f"{len(failed)} of {len(table)} records came to nothing ({failed[0]['record']}: "
            f"{failed[0]['why_not']}); the column why_not of {out / TABLE} has all: mend or leave "
            "them out, and give the same command again"
        )
    return screen.written([out / TABLE, *folders], records=table)


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
            verdict, effects, base = "", names, {}
            files = {"model.json": json_bytes(last.model.to_json())}
        else:
            found = diagnose(record, names or None, levels)
            verdict, effects, last = found.verdict, found.effects, found.final
            base = {"rms_base": found.base.rms_validation}
            with tempfile.TemporaryDirectory() as folder:
                place = Path(folder)
                files = {
                    path.relative_to(place).as_posix(): path.read_bytes()
                    for path in write_report(found, place)
                }
    row = {
        "verdict": verdict,
        "effects": ", ".join(effects),
        **base,
        "rms": last.rms_validation,
        "unit": record.output_unit,
        "percent_of_stroke": 100 * last.rms_validation / record.output_range,
        "levels": last.model.plane.levels,
        "seconds": time.perf_counter() - begin,
        "why_not": "",
    }
    return files, row


def _loaded(
    paths: Sequence[Path], titles: Sequence[str], columns: ReadOptions, rows: dict[int, Row]
) -> Iterator[tuple[int, Record]]:
    """The records by their numbers; what cannot be read gets its row."""
    from preisach_jax.record import Record

    seen: set[str] = set()
    for number, path in enumerate(paths):
        place = os.path.realpath(path)
        if place in seen:
            raise InputError(f"{path}: this record is given twice; give each record once")
        seen.add(place)
        notes: list[str] = []
        try:
            record = Record.load(path, **{**columns, "announce": notes.append})
        except InputError as error:
            rows[number] = {"record": titles[number], **_failed(error, f"{path}: ")}
            continue
        if len(paths) <= SHOWN:
            screen.show_record(record, notes)
        yield number, record


def _done(
    records: Mapping[int, Record],
    settings: Mapping[str, Any],
    workers: int | None,
    scheduler: str | None,
) -> Iterator[tuple[int, Row, dict[str, bytes]]]:
    """The row and the files of each record, as soon as it is done."""
    from preisach_jax.cores import usable_cores

    if not records:
        return
    waiting, futures = iter(records.items()), dict[Any, int]()
    workers = min(workers or usable_cores(), len(records))
    with (
        warnings.catch_warnings(),
        _client(workers, scheduler) as (client, completed),
        screen.progress() as show,
    ):
        warnings.filterwarnings("ignore", message="Sending large graph")  # each task has a record

        def submit() -> None:
            for number, record in waiting:
                future = client.submit(study, record, settings, pure=False)
                futures[future] = number
                completed.add(future)
                return

        for _ in range(MOST_WAITING):
            submit()
        show(f"{len(records)} records", 0.0)
        for count, future in enumerate(completed, start=1):
            number, error = futures.pop(future), future.exception()
            if error is None:
                files, row = cast(tuple[dict[str, bytes], Row], future.result())
                yield number, row, files
            else:
                yield number, _failed(error), {}
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
        with (
            cluster_of(
                n_workers=workers,
                threads_per_worker=1,
                memory_limit=0,  # the system knows better when memory ends
                dashboard_address="127.0.0.1:0",
                silence_logs=logging.CRITICAL,
            ) as cluster,
            connected(cluster) as client,
        ):
            yield client, as_completed()
        return
    try:
        client = connected(scheduler, timeout=CONNECTING_S)
    except (OSError, ValueError, TypeError) as error:
        raise InputError(
            f"--scheduler is {scheduler!r}, and no Dask scheduler answered there in {CONNECTING_S} "
            f"s ({error}): start one by `dask scheduler`, and workers by `dask worker ADDRESS`"
        ) from None
    with client:
        _check_versions(client, scheduler)
        yield client, as_completed()


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
    return {"verdict": "", "effects": "", "why_not": why}


def _names(paths: Sequence[Path]) -> list[str]:
    """What the table calls the records: their files, from the folder that holds them all.

    Folders above it tell who works where, which is nobody's business who reads the results.
    """
    whole = [Path(os.path.realpath(path)).parent / path.name for path in paths]
    try:
        common = os.path.commonpath([path.parent for path in whole])
        names = [path.relative_to(common).as_posix() for path in whole]
    except ValueError:  # on several drives
        names = [str(path) for path in paths]
    return [name.encode(errors="replace").decode() for name in names]


def _folder_names(names: Sequence[str]) -> list[str]:
    """A name for the folder of each record: that of its file, or what tells it from the others."""
    from preisach_jax.files import file_name

    for shown in ([file_name(Path(name).stem) for name in names], [*map(file_name, names)]):
        if len(set(shown)) == len(shown):
            return shown
    return [f"{number}_{file_name(name)}" for number, name in enumerate(names)]


def _identity(record: Record, settings: Mapping[str, Any]) -> dict[str, Any]:
    """What a result was made of: values, what they are taken for, and what was asked."""
    channels = {role: [each.name, each.unit] for role, each in record.channels.items()}
    memory = record.initial_memory
    return {"sha256": record.sha256, "settings": settings, "channels": channels, "memory": memory}


def _held(path: Path) -> dict[str, Any] | None:
    """What a folder says of the record that it was made of; None if it says nothing."""
    import json

    try:
        held = json.loads(path.read_text(encoding="utf-8"))
        return held if "row" in held else None
    except (OSError, ValueError, AttributeError):
        return None


def _write_table(path: Path, rows: Sequence[Row]) -> None:
    """The table as Parquet, in which `files.is_ours` knows it again."""
    import io

    import pyarrow
    from pyarrow import parquet

    from preisach_jax.files import PARQUET_MARK, write_files

    arrow, parquet, file = cast(Any, pyarrow), cast(Any, parquet), io.BytesIO()
    columns = list(dict.fromkeys(name for row in rows for name in row))
    table = arrow.table({name: [row.get(name) for row in rows] for name in columns})
    parquet.write_table(table.replace_schema_metadata({PARQUET_MARK: b"fleet"}), file)
    write_files({path: file.getvalue()})


def _show(rows: Sequence[Row]) -> None:
    """Print the records, those with the largest error first."""
    worst = sorted(rows, key=lambda row: -(row.get("percent_of_stroke") or float("inf")))
    screen.say()
    screen.table(
        ("record", "verdict", "effects", "rms", "% of stroke"),
        [
            (
                Path(row["record"]).name,
                row["verdict"] or ("failed" if row["why_not"] else "fitted"),
                row["effects"],
                "" if row["why_not"] else quantity(row["rms"], row["unit"], 3),
                "" if row["why_not"] else f"{row['percent_of_stroke']:.3g}",
            )
            for row in worst[:SHOWN]
        ],
    )
    if len(worst) > SHOWN:
        screen.say(f"... and {len(worst) - SHOWN} with less")

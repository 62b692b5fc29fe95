"""Run the blind benchmark: how often is `preisach_jax.diagnose` right?

    python benchmarks/blind/run.py --out build/blind --limit 20      # of the development draw 1
    python benchmarks/blind/run.py --out build/blind --draw 2 --suite single --effects creep
    python benchmarks/blind/run.py --out build/told --report         # for figures that are told

Stages that share no code with the package hide effects of known size. `--report` draws the records
by the name of the commit that is checked out, and takes neither a changed tree nor a selection:
what is told was frozen before it was drawn. Each finished case is one line of OUT/results.jsonl;
the same command goes on where it was interrupted, and writes the tables and pictures (`tables.py`)
of all that is there. A case that ends the process three times counts as crashed.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from provenance import commit, git
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from blind.cases import COUNTS, Case, make_cases
from blind.rates import FILE, Result, read_results
from blind.tables import write_tables

Judge = Callable[[Case], Result]

ONE_THREAD = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "NPROC": "1",  # threads of XLA
    "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false",
    "JAX_PLATFORMS": "cpu",
}
CASES_A_WORKER = 40
"""Cases a worker after which all are replaced, so that what they compiled does not pile up."""

STARTS, MOST_STARTS = "starts.txt", 3
"""File of the cases that were begun, and how often one may be that never comes to an end."""


def run_cases(
    cases: Sequence[Case], folder: Path, workers: int, judge: Judge, draw: str = "1"
) -> None:
    """Judge the cases that have no result yet, and append each result to the file as it comes."""
    results = read_results(folder)
    if others := {row.get("draw", "older") for row in results} - {draw}:
        sys.exit(f"{folder} has results of draw {', '.join(others)}; choose another folder")
    done = {result["id"] for result in results}
    left = [case for case in cases if case.id not in done]
    conditions = _conditions() | {"draw": draw}
    if others := {row["commit"] for row in results} - {conditions["commit"]}:
        sys.exit(
            f"{folder} has results of commit {', '.join(others)}, and {conditions['commit']} is "
            "checked out; a draw is judged by one version: choose another folder"
        )
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / FILE).open("a") as file, Progress(*columns, TimeRemainingColumn()) as progress:
        file.write("\n")  # the last line may be torn
        task = progress.add_task("judging", total=len(cases), completed=len(cases) - len(left))
        for result in _judged(left, workers, partial(_begun, judge, folder / STARTS)):
            now = datetime.now(UTC).isoformat(timespec="seconds")
            file.write(json.dumps(result | conditions | {"finished": now}) + "\n")
            file.flush()
            progress.update(task, advance=1, description=result["id"])


def _begun(judge: Judge, starts: Path, case: Case) -> Result:
    """Judge a case, and note that it was begun; too often without an end, and it has crashed."""
    before = starts.read_text().splitlines() if starts.exists() else []
    if before.count(case.id) >= MOST_STARTS:
        return judge(replace(case, ends=True))
    with starts.open("a") as file:
        file.write(case.id + "\n")
    return judge(case)


def run_or_stop(cases: Sequence[Case], folder: Path, workers: int, judge: Judge, draw: str) -> None:
    """The same for a command: leaves with a word on how to go on if it is interrupted."""
    # Else the workers would outlive this process.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        run_cases(cases, folder, workers, judge, draw)
    except KeyboardInterrupt:
        sys.exit("stopped; what was finished is kept, and the same command goes on")
    except BrokenProcessPool:
        sys.exit("a worker was killed (too little memory?); the same command goes on")


def _judged(cases: Sequence[Case], workers: int, judge: Judge) -> Iterator[dict[str, Any]]:
    if workers == 0:
        yield from map(judge, cases)
        return
    # Pools that replace single workers can wait for ever for one of them (CPython issue 115634).
    size = CASES_A_WORKER * workers
    for begin in range(0, len(cases), size):
        yield from _by_new_workers(cases[begin : begin + size], workers, judge)


def _by_new_workers(cases: Sequence[Case], workers: int, judge: Judge) -> Iterator[dict[str, Any]]:
    with ProcessPoolExecutor(
        workers,
        mp_context=multiprocessing.get_context("spawn"),
        initializer=_leave_interrupts_to_the_parent,
    ) as pool:
        futures = [pool.submit(judge, case) for case in cases]
        try:
            for future in as_completed(futures):
                yield future.result()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            for child in multiprocessing.active_children():
                child.terminate()
            raise


def _leave_interrupts_to_the_parent() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _conditions() -> dict[str, Any]:
    packages = ("preisach_jax", "jax", "jaxlib", "numpy", "scipy")
    return {"versions": {package: version(package) for package in packages}, "commit": commit()}


def _names(text: str) -> list[str]:
    return [name for name in text.split(",") if name]


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description="How often is preisach_jax.diagnose right?  Interrupt at will; the same "
        "command goes on."
    )
    parser.add_argument("--out", type=Path, required=True, help="folder of the results")
    parser.add_argument("--report", action="store_true", help="draw by the commit checked out")
    parser.add_argument("--draw", default="1", help="number of a development draw")
    parser.add_argument("--suite", type=_names, default=[], help=f"of {','.join(COUNTS)}")
    parser.add_argument("--effects", type=_names, default=[], help="only cases that hide one")
    parser.add_argument("--excitation", type=_names, default=[], help="of poor,periodic,fair,rich")
    parser.add_argument("--limit", type=int, help="at most so many cases, spread evenly")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    return parser.parse_args()


def main() -> None:
    """Run what the command line asks for, and write the tables."""
    asked = _arguments()
    draw = asked.draw
    if asked.report:
        if asked.suite or asked.effects or asked.excitation or asked.limit is not None:
            sys.exit("run.py: --report judges the whole draw; leave the selection out")
        if git("status", "--porcelain", "--", "preisach_jax", "benchmarks/blind") != "":
            sys.exit("run.py: --report judges a commit; commit what was changed (git status) first")
        draw = commit()
    elif not draw.isdigit():
        sys.exit(f"run.py: --draw is {draw!r}; a development draw is a number, such as --draw 1")
    try:
        cases = make_cases(draw, asked.suite, asked.effects, asked.excitation, asked.limit)
    except ValueError as error:
        sys.exit(f"run.py: {error}")
    os.environ.update(ONE_THREAD)
    from blind.judge import judge  # loads JAX, which must see the environment

    run_or_stop(cases, asked.out, asked.workers, judge, draw)
    write_tables(asked.out)


if __name__ == "__main__":
    main()

"""Run the blind benchmark: how often is `preisach_jax.diagnose` right?

    python benchmarks/blind/run.py --out blind                     # all development cases
    python benchmarks/blind/run.py --out blind --limit 200 --workers 4
    python benchmarks/blind/run.py --out told --seeds reporting    # for figures that are told

Stages that share no code with the package hide effects of known size.  Each finished case is one
line of OUT/results.jsonl; the same command goes on where it was interrupted, and writes the tables
and pictures (`tables.py`) of all that is there.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from blind.cases import REPEATS, SEEDS, SIZES, Case, Choice, make_cases
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


def run_cases(cases: Sequence[Case], folder: Path, workers: int, judge: Judge) -> None:
    """Judge the cases that have no result yet, and append each result to the file as it comes."""
    done = {result["id"] for result in read_results(folder)}
    left = [case for case in cases if case.id not in done]
    conditions = _conditions()
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / FILE
    content = path.read_bytes() if path.exists() else b""
    with path.open("a") as file, Progress(*columns, TimeRemainingColumn()) as progress:
        if content and not content.endswith(b"\n"):  # torn: what follows gets a line of its own
            file.write("\n")
        task = progress.add_task("judging", total=len(cases), completed=len(cases) - len(left))
        for result in _judged(left, workers, judge):
            now = datetime.now(UTC).isoformat(timespec="seconds")
            file.write(json.dumps(result | conditions | {"finished": now}) + "\n")
            file.flush()
            progress.update(task, advance=1, description=result["id"])


def run_or_stop(cases: Sequence[Case], folder: Path, workers: int, judge: Judge) -> None:
    """The same for a command: leaves with a word on how to go on if it is interrupted."""
    # Else the workers would outlive this process.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        run_cases(cases, folder, workers, judge)
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
    return {
        "versions": {package: version(package) for package in packages},
        "commit": _commit(Path(__file__).parent),
    }


def _commit(folder: Path) -> str:
    """The commit that is checked out, with a plus sign if the package was changed since."""

    def git(*words: str) -> str:
        command = ["git", "-C", str(folder), *words]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()

    try:
        changed = git("status", "--porcelain", "--", ":/preisach_jax")
        return git("rev-parse", "HEAD") + ("+" if changed else "")
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


def _names(text: str) -> list[str]:
    return [name for name in text.split(",") if name]


def _sizes(text: str) -> list[float]:
    return [float(size) for size in _names(text)]


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description="How often is preisach_jax.diagnose right?  Interrupt at will; the same "
        "command goes on."
    )
    parser.add_argument("--out", type=Path, required=True, help="folder of the results")
    parser.add_argument("--seeds", choices=list(SEEDS), default="development")
    parser.add_argument("--suite", type=_names, default=[], help=f"of {','.join(REPEATS)}")
    parser.add_argument("--effects", type=_names, default=[], help="only cases that hide one")
    parser.add_argument("--excitation", type=_names, default=[], help="of poor,periodic,fair,rich")
    parser.add_argument(
        "--size", type=_sizes, default=[], help=f"of {','.join(f'{size:g}' for size in SIZES)}"
    )
    parser.add_argument("--limit", type=int, help="at most so many cases, spread evenly")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    return parser.parse_args()


def main() -> None:
    """Run what the command line asks for, and write the tables."""
    asked = _arguments()
    try:
        choice = Choice(
            asked.suite, asked.effects, asked.excitation, asked.size, asked.seeds, asked.limit
        )
    except ValueError as error:
        sys.exit(f"run.py: {error}")
    os.environ.update(ONE_THREAD)
    from blind.judge import judge  # loads JAX, which must see the environment

    run_or_stop(make_cases(choice), asked.out, asked.workers, judge)
    write_tables(asked.out)


if __name__ == "__main__":
    main()

"""Fuzz the readers of files, guided by coverage: each gives a result or says what is wrong.

    python benchmarks/trust/fuzz.py --seconds 60                  # every reader for a minute
    python benchmarks/trust/fuzz.py --seconds 600 npz model       # these for ten
    python benchmarks/trust/fuzz.py --seconds 60 --keep found     # what broke goes into found/

A file of less than a megabyte must give a record (or a model), or an `InputError` of one line,
within 2 s of computing and 1 GiB of memory; anything else, a warning among it, is a failure.  Files
start from valid ones (`seeds.py`) and are damaged by bytes and by their structure
(`mutations.py`); those that reach new branches are damaged further.  Each reader runs in a process
of its own.  Needs Atheris, which is no dependency of the package: `pip install atheris`.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import re
import resource
import shutil
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
os.environ.setdefault("JAX_PLATFORMS", "cpu")

from trust.mutations import DAMAGE, damaged_bytes
from trust.seeds import ENDINGS, SEEDS, readable_files

MOST_BYTES = 1_000_000
MOST_SECONDS = 2.0
MOST_GROWTH_MIB = 1024
MOST_MESSAGE = 2500
INSTRUMENTED = (
    "preisach_jax.record preisach_jax.model preisach_jax.model.schema "
    "preisach_jax.effects numpy.lib._format_impl scipy.io.matlab zipfile"
).split()


def read_record(path: Path) -> None:
    """Read a file as a record: with guessed columns, and with its first ones in their order."""
    from preisach_jax.errors import InputError
    from preisach_jax.record import Record
    from preisach_jax.record.reading import read_table

    table = read_table(path)
    said: list[str] = []
    refusals = []
    names = list(table.columns)
    for options in (
        {},
        dict(zip(("time", "input", "output"), names, strict=False)) | {"aux": names[3:4]},
        {"input": names[0], "rate": 10.0, "need_output": False},
    ):
        try:
            record = Record.of_table(table, path.name, **options, announce=said.append)
            repr(record), record._repr_html_(), record.to_pandas()
        except InputError as error:
            refusals.append(error)
    if len(refusals) == 3:
        raise refusals[0]


def read_model(path: Path) -> None:
    """Read a file as a model, which must then write itself and read itself back."""
    from preisach_jax.model import Model

    model = Model.load(path)
    repr(model), model._repr_html_()
    twice = []
    for _ in range(2):
        model.save(path)
        twice.append(path.read_bytes())
        model = Model.load(path)
    if twice[0] != twice[1]:
        raise AssertionError("a model that was read back is written otherwise")


def reader_of(name: str) -> Callable[[Path], None]:
    """The function that reads files of a reader."""
    return read_model if name == "model" else read_record


class Campaign:
    """Runs one reader on one file after another, and keeps what broke."""

    def __init__(self, reader: str, folder: Path, seconds: float):
        self.reader, self.folder = reader, folder
        self.read = reader_of(reader)
        shared = Path("/dev/shm")
        self.place = Path(tempfile.mkdtemp(dir=shared if shared.is_dir() else None))
        self.path = self.place / f"file{ENDINGS[reader]}"
        self.stop = time.monotonic() + seconds
        self.counts = {"executions": 0, "read": 0, "refused": 0}
        self.failures: dict[str, dict[str, Any]] = {}
        self.slowest_s = 0.0
        self.growth_mib = 0.0

    def __call__(self, data: bytes) -> None:
        """Read one file; ends the process when the time is over."""
        from preisach_jax.errors import InputError

        if time.monotonic() > self.stop:
            self.save()
            os._exit(0)
        if len(data) > MOST_BYTES:
            return
        self.counts["executions"] += 1
        if self.counts["executions"] % 200 == 0:
            self.save()  # a file may end the process
        self.path.write_bytes(data)
        resident, began = _resident_mib(), time.process_time()
        try:
            self.read(self.path)
            self.counts["read"] += 1
        except InputError as error:
            self.counts["refused"] += 1
            if len(str(error)) > MOST_MESSAGE:
                self.note("a message too long", str(error)[:200], data)
        except Exception as error:
            self.note(_place(error), f"{type(error).__name__}: {str(error)[:300]}", data)
        spent = time.process_time() - began
        growth = _peak_mib() - resident
        self.slowest_s = max(self.slowest_s, spent)
        if spent > MOST_SECONDS:
            self.note("too slow", f"{spent:.1f} s", data)
        if growth > self.growth_mib:
            self.growth_mib = growth
            if growth > MOST_GROWTH_MIB:
                self.note("too much memory", f"{growth:.0f} MiB", data)

    def note(self, where: str, what: str, data: bytes) -> None:
        """Keep a failure, the smallest file of each place."""
        known = self.failures.get(where)
        times = 1 if known is None else known["times"] + 1
        if known is None or len(data) < known["bytes"]:
            name = f"{self.reader}-{len(self.failures) if known is None else known['number']}"
            (self.folder / (name + ENDINGS[self.reader])).write_bytes(data)
            number = len(self.failures) if known is None else known["number"]
            known = {"number": number, "what": what, "bytes": len(data)}
        self.failures[where] = known | {"times": times}
        self.save()

    def save(self) -> None:
        """Write the figures."""
        figures = self.counts | {
            "failures": [{"where": where, **what} for where, what in self.failures.items()],
            "slowest_s": round(self.slowest_s, 3),
            "greatest_growth_mib": round(self.growth_mib, 1),
        }
        (self.folder / f"{self.reader}.json").write_text(json.dumps(figures))


def _place(error: BaseException) -> str:
    """Where an exception was raised, and the last place in the package on the way."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if "preisach_jax" in frame.filename] or frames
    named = f"{Path(own[-1].filename).name}:{own[-1].lineno} {own[-1].name}"
    return f"{type(error).__name__} at {named}"


def _resident_mib() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 2**20


def _peak_mib() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def work(reader: str, seconds: float, folder: Path, seed: int) -> None:
    """Fuzz one reader in this process, which ends with it."""
    import atheris

    with atheris.instrument_imports(include=INSTRUMENTED):
        import preisach_jax.model
        import preisach_jax.record.reading  # noqa: F401
    corpus = folder / f"{reader}.corpus"
    corpus.mkdir()
    for i, content in enumerate(readable_files(reader)):
        (corpus / f"seed-{i}").write_bytes(content)
    warnings.simplefilter("error")
    # A leap of memory is a failure of its own, not the end of the process.
    resource.setrlimit(resource.RLIMIT_AS, (24 * 2**30, 24 * 2**30))
    campaign = Campaign(reader, folder, seconds)
    (folder / "first").write_bytes(readable_files(reader)[0])
    shutil.copy(folder / "first", campaign.path)
    campaign.read(campaign.path)  # the first reading imports, which is no time of any file
    damage = DAMAGE[reader]

    def mutator(data: bytes, most: int, seed: int) -> bytes:
        rng = random.Random(seed)
        if not data or rng.random() < 0.15:
            return atheris.Mutate(data, most)
        try:
            return damage(data, rng)[:most]
        except Exception:  # already too damaged to be taken apart
            return damaged_bytes(data, rng)[:most]

    options = [f"-max_len={MOST_BYTES}", "-len_control=0", "-rss_limit_mb=0", "-timeout=20"]
    options += [f"-artifact_prefix={folder}/{reader}-died-", f"-seed={seed}"]
    atheris.Setup([sys.argv[0], *options, str(corpus)], campaign, custom_mutator=mutator)
    atheris.Fuzz()


def fuzz(reader: str, seconds: float, folder: Path, seed: int) -> dict[str, Any]:
    """Fuzz one reader in processes of its own, a new one where a file has ended the last."""
    stop = time.monotonic() + seconds
    parts = []
    while not parts or (parts[-1]["died"] and time.monotonic() + 5 < stop):
        parts.append(_process(reader, stop - time.monotonic(), folder, seed + len(parts)))
    failures: dict[str, dict[str, Any]] = {}
    for failure in (failure for part in parts for failure in part["failures"]):
        known = failures.get(failure["where"], {"times": 0})
        failures[failure["where"]] = failure | {"times": known["times"] + failure["times"]}
    sums = {name: sum(part[name] for part in parts) for name in ("executions", "read", "refused")}
    most = ("edges", "features", "corpus", "slowest_s", "greatest_growth_mib")
    return (
        sums
        | {name: max(part[name] for part in parts) for name in most}
        | {"failures": list(failures.values())}
    )


def _process(reader: str, seconds: float, folder: Path, seed: int) -> dict[str, Any]:
    """Fuzz one reader in one process; what was found."""
    inside = folder / f"{reader}-{seed}"
    inside.mkdir()
    command = [sys.executable, __file__, "--worker", "--seconds", str(seconds)]
    command += ["--keep", str(inside), "--seed", str(seed), reader]
    done = subprocess.run(command, capture_output=True, text=True, errors="replace", check=False)
    log = done.stdout + done.stderr
    covered = re.findall(r"cov: (\d+) ft: (\d+) corp: (\d+)", log) or [(0, 0, 0)]
    found = dict(zip(("edges", "features", "corpus"), map(int, covered[-1]), strict=True))
    kept = inside / f"{reader}.json"
    nothing = {"executions": 0, "read": 0, "refused": 0, "failures": []}
    nothing |= {"slowest_s": 0.0, "greatest_growth_mib": 0.0}
    figures: dict[str, Any] = json.loads(kept.read_text()) if kept.exists() else nothing
    died = done.returncode != 0
    if died:
        frames = re.findall(r'File ".*?([^/"]+)", line (\d+) in (\w+)', log)[:1]
        where = f"the process at {frames}" if frames else "the process"
        what = f"ended with code {done.returncode}: {log[-1500:]}"
        figures["failures"].append({"where": where, "what": what, "times": 1})
    return {"died": died} | found | figures


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line; its result is the number of failures."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("readers", nargs="*", metavar="reader", help=", ".join(SEEDS))
    parser.add_argument("--seconds", type=float, default=60.0, help="time of each reader")
    parser.add_argument("--keep", type=Path, help="folder for files that break a reader")
    parser.add_argument("--seed", type=int, default=1, help="of the random numbers")
    parser.add_argument("--worker", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    unknown = set(options.readers) - set(SEEDS)
    if unknown:
        parser.error(f"there is no reader {unknown.pop()!r}; the readers are {', '.join(SEEDS)}")
    try:
        version("atheris")
    except ModuleNotFoundError:
        parser.error("this needs Atheris, which is not installed: pip install atheris")
    if options.worker:
        work(options.readers[0], options.seconds, options.keep, options.seed)
    found = {}
    with tempfile.TemporaryDirectory() as temporary:
        for reader in options.readers or SEEDS:
            folder = Path(temporary)
            found[reader] = fuzz(reader, options.seconds, folder, options.seed)
            print(f"{reader}: {json.dumps(found[reader])}", flush=True)
            if options.keep is not None:
                for part in folder.glob(f"{reader}-*"):
                    shutil.copytree(part, options.keep / part.name, dirs_exist_ok=True)
    _write(found, options.seconds)
    return min(sum(len(figures["failures"]) for figures in found.values()), 100)


def _write(found: dict[str, Any], seconds: float) -> None:
    """Write the figures of readers beside those of others that are on file."""
    from conditions import RESULTS, write_results

    path = RESULTS / "trust" / "fuzz.json"
    before = json.loads(path.read_text())["readers"] if path.exists() else {}
    path.parent.mkdir(parents=True, exist_ok=True)
    packages = ("atheris", "pandas", "pyarrow")
    write_results(
        "trust/fuzz.json",
        {
            "fuzzing": {package: version(package) for package in packages},
            "most": {"bytes": MOST_BYTES, "seconds": MOST_SECONDS, "growth_mib": MOST_GROWTH_MIB},
            "readers": before | {r: {"seconds": seconds, **f} for r, f in found.items()},
        },
    )


if __name__ == "__main__":
    sys.exit(main())

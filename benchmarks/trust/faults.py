"""Kill the program at random moments while it writes, and look at what is left.

    python benchmarks/trust/faults.py                      # all kinds, some 130 kills
    python benchmarks/trust/faults.py --only online sweep

Children that are forked from a process which has imported everything and computed nothing run a
sweep, a diagnosis, write its report again and again, or save an online filter again and
again.  They are killed by SIGKILL after delays that a seed draws, most of them while files are
being written.  After each kill every file must be whole, and at the end the resumed work must be
that of an undisturbed run to the last bit, with no temporary file left.  Writes
`benchmarks/results/trust/faults.json`.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path

os.environ.setdefault("JAX_PLATFORMS", "cpu")
os.environ.setdefault("MPLBACKEND", "Agg")

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import jax
import numpy as np
from conditions import write_results
from PIL import Image

import preisach_jax as pj
from preisach_jax.cli import main as command_line
from preisach_jax.files import write_files
from preisach_jax.filter.state import FilterState
from preisach_jax.paper.sweep import sweep_to_folder

PATIENCE_S = 300
"""Seconds after which a child that neither ends nor is due counts as hanging."""


@dataclass
class Tally:
    """What was done to one kind of work, and what came of it.

    Attributes:
        kind: of work.
        kills: children that were killed.
        while_writing: of them, those that left a temporary file.
        ended_before: children that had finished when the signal came.
        whole_files: files that were looked at after kills, all of them whole unless in `failures`.
        finished: works that were finished after kills and compared with an undisturbed one.
        failures: what was not as it must be.
        seconds: of all of it.
    """

    kind: str
    kills: int = 0
    while_writing: int = 0
    ended_before: int = 0
    whole_files: int = 0
    finished: int = 0
    failures: list[str] = field(default_factory=list)
    seconds: float = 0.0


def forked(work: Callable[[], object], log: Path) -> int:
    """Start a child that does some work, and prints into a file; its number."""
    child = os.fork()
    if child:
        return child
    code = 1
    try:
        with log.open("w") as file:
            for stream in (1, 2):
                os.dup2(file.fileno(), stream)
            try:
                work()
                code = 0
            except BaseException:
                traceback.print_exc()
            sys.stdout.flush()
            sys.stderr.flush()
    finally:
        os._exit(code)


def ended(child: int, log: Path) -> str:
    """Wait for a child; what it complained of, "" if it did its work."""
    _, status = os.waitpid(child, 0)
    return log.read_text()[-2000:] or f"ended by {status}" if status else ""


def killed(child: int, due: Callable[[], bool], delay_s: float) -> bool:
    """Kill a child a while after it is due; whether it was still at work."""
    limit = time.monotonic() + PATIENCE_S
    while not due() and time.monotonic() < limit:
        if os.waitpid(child, os.WNOHANG)[0]:
            return False
        time.sleep(0.0005)
    time.sleep(delay_s)
    os.kill(child, signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    return os.WIFSIGNALED(status)


def temporary(folder: Path) -> list[Path]:
    """Files that a writer had not finished."""
    return [path for path in folder.rglob("*") if path.suffix in {".part", ".partial"}]


def look_at(folder: Path) -> int:
    """Read every file in a folder as what its name says it is; how many there are.

    Raises:
        Exception: if one is not whole.
    """
    files = [path for path in folder.rglob("*") if path.is_file()]
    unfinished = set(temporary(folder))
    seen = [path for path in files if path not in unfinished]
    for path in seen:
        content = path.read_bytes()
        if path.suffix == ".json":
            parsed = json.loads(content)
            if isinstance(parsed, dict) and parsed.get("format") == "preisach_jax model":
                pj.Model.load(path)
        elif path.suffix == ".html":
            assert content.rstrip().endswith(b"</html>"), path
        elif path.suffix == ".png":
            with Image.open(path) as picture:
                picture.load()
        elif path.suffix == ".npz":
            (pj.Sweep if path.name.startswith("seeds") else pj.OnlineFilter).load(path)
        elif path.suffix == ".csv":
            assert content.endswith(b"\n"), path
    return len(seen)


class Trial:
    """One kind of work in a folder of its own: what to kill, and how to look at what is left.

    Arguments:
        folder: where all is written.
        generator: draws the moments.
        tally: what is counted.
    """

    def __init__(self, folder: Path, generator: np.random.Generator, tally: Tally):
        self.folder, self.generator, self.tally = folder, generator, tally
        self.log = folder / "log"

    def do(self, work: Callable[[], object], what: str) -> bool:
        """Do something to the end in a child, and note a failure; whether it went well."""
        complaint = ended(forked(work, self.log), self.log)
        if complaint:
            self.tally.failures.append(f"{what}: {complaint}")
        return not complaint

    def kill(
        self,
        work: Callable[[], object],
        out: Path,
        due: Callable[[], bool],
        within_s: float,
        also: Callable[[], object] = lambda: None,
    ) -> None:
        """Kill a child, and look at its folder and at what else there is to compare."""
        delay = self.generator.uniform(0.0, within_s)
        if not killed(forked(work, self.log), due, delay):
            self.tally.ended_before += 1
            if "Traceback" in self.log.read_text():
                self.tally.failures.append(f"by itself: {self.log.read_text()[-2000:]}")
            return
        self.tally.kills += 1
        self.tally.while_writing += bool(temporary(out))
        count = self.folder / "count"

        def look() -> None:
            count.write_text(str(look_at(out)))
            also()

        if self.do(look, f"after a kill of {self.tally.kind}"):
            self.tally.whole_files += int(count.read_text())

    def clean(self, out: Path) -> None:
        """What must hold in the end."""
        self.tally.finished += 1
        if left := temporary(out):
            names = ", ".join(path.name for path in left)
            self.tally.failures.append(f"left behind: {names}")


def online(trial: Trial, kills: int) -> None:
    """An online filter is saved after every sample; what is loaded is a state that it was in."""
    out = trial.folder / "online"
    out.mkdir()
    path = out / "state.npz"
    k = np.arange(3000)
    x = 5 + 5 * np.sin(k / 9) * np.cos(k / 41)
    adaptive = pj.AdaptiveFilter(pj.Plane(levels=37, low=0.0, high=10.0))

    def work() -> None:
        running = pj.OnlineFilter(adaptive)
        for u in x:
            running(u, 3 * u)
            running.save(path)

    def compare() -> None:
        state = pj.OnlineFilter.load(path).state
        again = pj.OnlineFilter(adaptive)
        for u in x:
            again(u, 3 * u)
            if np.float32(u) == state.input:
                break
        for name in FilterState.__dataclass_fields__:
            expected, found = (np.asarray(getattr(one, name)) for one in (again.state, state))
            np.testing.assert_array_equal(found, expected, err_msg=name)

    def saved_anew(before: int) -> bool:
        return path.exists() and path.stat().st_mtime_ns != before

    while trial.tally.kills < kills and not trial.tally.failures:
        before = path.stat().st_mtime_ns if path.exists() else 0
        trial.kill(work, out, partial(saved_anew, before), within_s=0.3, also=compare)
    trial.do(lambda: pj.OnlineFilter.load(path).save(path), "the next save")
    trial.clean(out)


def record_file(folder: Path, number: int = 0, samples: int = 800) -> Path:
    """A small record with a drift, as CSV."""
    t = np.arange(samples) / 100
    u = 5 - 5 * np.cos(t * (1 + t / (8 + number)))
    z = (1 + number) * u**1.1 + 0.3 * np.exp(-0.5 * t)
    path = folder / f"stage{number}.csv"
    rows = [f"{a:.2f},{b:.6f},{c:.6f}" for a, b, c in zip(t, u, z, strict=True)]
    path.write_text("\n".join(["t_s,u_V,z_um", *rows]) + "\n")
    return path


def called(words: list[str]) -> Callable[[], None]:
    """The command line, which must end by 0."""

    def call() -> None:
        code = command_line(words)
        assert code == 0, code

    return call


def diagnose(trial: Trial, kills: int) -> None:
    """`preisach diagnose` is killed at any time, and as it writes; then it is run again."""
    data, out = record_file(trial.folder), trial.folder / "report"
    whole = trial.folder / "whole"
    words = ["diagnose", str(data), "--effects", "drift", "--levels", "7", "--quiet"]
    begin = time.monotonic()
    trial.do(called([*words, "--report", str(whole)]), "an undisturbed diagnosis")
    trial.do(called([*words, "--report", str(out)]), "an old report")
    took = (time.monotonic() - begin) / 2
    work = called([*words, "--report", str(out)])
    while trial.tally.kills < kills and not trial.tally.failures:
        if trial.tally.kills % 3:
            trial.kill(work, out, lambda: bool(temporary(out)), within_s=0.05)
        else:
            trial.kill(work, out, lambda: True, within_s=took)
    trial.do(work, "the next diagnosis")
    trial.clean(out)
    same_files(trial, whole, out, ("diagnosis.json", "model.json", "base.json"))


def same_files(trial: Trial, whole: Path, out: Path, names: tuple[str, ...]) -> None:
    """Note files that are not those of an undisturbed run to the last byte."""
    for name in names:
        if (whole / name).read_bytes() != (out / name).read_bytes():
            trial.tally.failures.append(f"{name} is another than without kills")


def report(trial: Trial, kills: int) -> None:
    """Two reports take each other's place again and again; each file is of one or the other."""
    data, out = record_file(trial.folder), trial.folder / "report"
    for levels in (5, 7):
        words = ["diagnose", str(data), "--effects", "drift", "--levels", str(levels), "--quiet"]
        trial.do(called([*words, "--report", str(trial.folder / str(levels))]), "a report")
    both = [
        {out / path.name: path.read_bytes() for path in (trial.folder / str(levels)).iterdir()}
        for levels in (5, 7)
    ]

    def work() -> None:
        while True:
            for contents in both:
                write_files(contents)

    def compare() -> None:
        for path in set(out.iterdir()) - set(temporary(out)):
            assert path.read_bytes() in [contents[path] for contents in both], path

    while trial.tally.kills < kills and not trial.tally.failures:
        trial.kill(work, out, lambda: bool(temporary(out)), within_s=0.3, also=compare)
    trial.do(lambda: write_files(both[0]), "the next report")
    trial.clean(out)
    same_files(trial, trial.folder / "5", out, tuple(path.name for path in both[0]))


def sweep(trial: Trial, kills: int) -> None:
    """A sweep is killed, goes on and is killed again, until it is done; then another one."""

    def work(out: Path) -> None:
        sweep_to_folder(out, jax.random.key(0), (5, 3), (0.1, 1.0), seeds=10, samples=1000, chunk=1)

    whole = trial.folder / "whole"
    trial.do(lambda: work(whole), "undisturbed work")
    expected, wanted, round_ = pj.Sweep.load(whole), done(whole), 0
    while trial.tally.kills < kills and not trial.tally.failures:
        out = trial.folder / f"out{round_}"
        round_ += 1
        while trial.tally.kills < kills and done(out) < wanted and not trial.tally.failures:
            begin = done(out) + trial.generator.integers(0, 3)
            trial.kill(partial(work, out), out, partial(has_done, out, int(begin)), within_s=0.15)
        trial.do(partial(work, out), "the rest of the work")
        trial.clean(out)
        found = pj.Sweep.load(out)
        for name in expected.AXES:
            if not np.array_equal(getattr(expected, name), getattr(found, name), equal_nan=True):
                trial.tally.failures.append(f"{name} is another than without kills")


def done(out: Path) -> int:
    """Chunks that are finished."""
    return len(list(out.glob("seeds_*.npz")))


def has_done(out: Path, count: int) -> bool:
    """Whether so many chunks are finished."""
    return done(out) >= count


KINDS: dict[str, tuple[Callable[[Trial, int], None], int]] = {
    "online": (online, 60),
    "sweep": (sweep, 14),
    "report": (report, 40),
    "diagnose": (diagnose, 8),
}
"""Kinds of work, and how often each is killed."""


def main() -> None:
    """Kill all kinds of work, or those that were named."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="+", choices=KINDS, default=list(KINDS))
    parser.add_argument("--kills", type=int, help="of each kind")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keep", action="store_true", help="write no result")
    chosen = parser.parse_args()
    tallies = []
    with tempfile.TemporaryDirectory() as temporary_folder:
        os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", f"{temporary_folder}/compiled")
        jax.config.update("jax_compilation_cache_dir", os.environ["JAX_COMPILATION_CACHE_DIR"])
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0)
        for kind in chosen.only:
            campaign, kills = KINDS[kind]
            tally, begin = Tally(kind), time.monotonic()
            folder = Path(temporary_folder) / kind
            folder.mkdir()
            generator = np.random.default_rng([chosen.seed, sum(kind.encode())])
            campaign(Trial(folder, generator, tally), chosen.kills or kills)
            tally.seconds = round(time.monotonic() - begin, 1)
            print(tally, flush=True)
            tallies.append(tally)
    failures = sum(len(tally.failures) for tally in tallies)
    if not chosen.keep:
        content = {
            "seed": chosen.seed,
            "kills": sum(tally.kills for tally in tallies),
            "failures": failures,
            "kinds": [asdict(tally) for tally in tallies],
        }
        write_results("trust/faults.json", content)
    sys.exit(bool(failures))


if __name__ == "__main__":
    main()

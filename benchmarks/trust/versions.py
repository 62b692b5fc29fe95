"""Does the package install and work with the oldest and the newest of all that it asks for?

    python benchmarks/trust/versions.py --pythons 3.11=/path/to/python3.11 3.13=/path/to/python3.13

Builds the sdist and the wheel, installs them by uv into empty environments in a temporary folder,
once with the oldest version that every lower bound of pyproject.toml allows and once with the
newest, runs `smoke.py` there and the tests of the core, and writes
`benchmarks/results/trust/versions.json`.  uv finds packages as its own variables say (`UV_INDEX`,
`UV_FIND_LINKS`, `UV_INDEX_STRATEGY`).
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time
import tomllib
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from datetime import date
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
RESULT = ROOT / "benchmarks" / "results" / "trust" / "versions.json"

CORE = ("hysteron", "events", "filter", "online", "recursion", "model", "record")
"""The tests of the core: files whose names begin so."""

TEST_TOOLS = ("pytest>=8.3,<10", "hypothesis>=6.120,<7", "pyarrow>=18,<26", "xarray>=2024.10,<2027")

SHOWN_LINES = 25


@dataclass(frozen=True)
class Environment:
    """An environment to try.

    Attributes:
        python: its version, as 3.11.
        resolution: which versions uv takes: "lowest-direct" or "highest".
        artefact: what is installed: "wheel" or "sdist".
        with_tests: whether the tests of the core run, too.
    """

    python: str
    resolution: str
    artefact: str
    with_tests: bool


@dataclass
class Outcome:
    """What happened there.

    Attributes:
        environment: where.
        seconds: by step.
        versions: of all packages.
        not_oldest: packages that are newer than the lower bound, where the oldest were wanted: no
            older one is there for this Python.
        tests: the last line of the tests.
        failed_first: tests that failed, and were run once more.
        failed: the step that failed, if one did.
        last_lines: what it printed last.
    """

    environment: Environment
    seconds: dict[str, float] = field(default_factory=dict)
    versions: dict[str, str] = field(default_factory=dict)
    not_oldest: list[str] = field(default_factory=list)
    tests: str = ""
    failed_first: list[str] = field(default_factory=list)
    failed: str = ""
    last_lines: list[str] = field(default_factory=list)


class StepFailedError(Exception):
    """A step ended by an error; the message is what it printed."""


def step(outcome: Outcome, name: str, command: Sequence[str | Path], **options: Any) -> str:
    """Run a command, and note how long it took.

    Raises:
        StepFailedError: if it fails.
    """
    begin = time.monotonic()
    done = subprocess.run(
        [str(word) for word in command], capture_output=True, text=True, check=False, **options
    )
    outcome.seconds[name] = round(time.monotonic() - begin, 1)
    if done.returncode:
        outcome.failed = name
        outcome.last_lines = (done.stdout + done.stderr).splitlines()[-SHOWN_LINES:]
        raise StepFailedError
    return done.stdout


def try_environment(
    environment: Environment, interpreter: str, built: dict[str, Path], folder: Path
) -> Outcome:
    """Install, run the smoke test, and the tests of the core.

    Arguments:
        environment: what to try.
        interpreter: the Python of it.
        built: wheel and sdist.
        folder: an empty folder for all that is written.
    """
    outcome = Outcome(environment)
    home = folder / "environment"
    python = home / "bin" / "python"
    # Neither the checkout nor what a shell has set may help.
    alone = {k: v for k, v in os.environ.items() if k not in {"PYTHONPATH", "VIRTUAL_ENV"}}
    alone |= {"JAX_PLATFORMS": "cpu", "MPLBACKEND": "Agg", "PYTHONWARNINGS": "default"}
    try:
        step(outcome, "environment", ["uv", "venv", "--python", interpreter, home])
        install = ["uv", "pip", "install", "--python", python]
        # Beside the package its requirements are named: uv takes the oldest of what is named alone.
        asked = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["dependencies"]
        artefact = built[environment.artefact]
        chosen = ["--resolution", environment.resolution, artefact, *asked]
        step(outcome, "install", [*install, *chosen], env=alone)
        listed = step(outcome, "list", ["uv", "pip", "list", "--python", python, "--format=json"])
        outcome.versions = {one["name"]: one["version"] for one in json.loads(listed)}
        if environment.resolution == "lowest-direct":
            outcome.not_oldest = not_oldest(asked, outcome.versions)
        empty = folder / "smoke"
        empty.mkdir()
        shutil.copy(ROOT / "benchmarks" / "trust" / "smoke.py", folder)
        step(outcome, "smoke", [python, folder / "smoke.py", empty], cwd=folder, env=alone)
        if environment.with_tests:
            step(outcome, "test tools", [*install, *TEST_TOOLS], env=alone)
            tests = unpacked_tests(built["sdist"], folder)
            files = sorted(p for name in CORE for p in tests.glob(f"tests/test_{name}*.py"))
            # Oldest packages may use what is deprecated in each other: this is not of our doing.
            lenient = ["-W", "default::DeprecationWarning"] * (environment.resolution != "highest")
            command = [home / "bin" / "pytest", "-q", *lenient, *files]
            try:
                said = step(outcome, "tests", command, cwd=tests, env=alone)
            except StepFailedError:  # tests that measure time fail on a machine that is busy
                outcome.failed_first = [
                    line for line in outcome.last_lines if line.startswith("FAILED")
                ]
                outcome.failed, outcome.last_lines = "", []
                said = step(outcome, "tests again", [*command, "--lf"], cwd=tests, env=alone)
            outcome.tests = said.splitlines()[-1]
    except StepFailedError:
        print(*outcome.last_lines, sep="\n")
    return outcome


def not_oldest(asked: Sequence[str], versions: dict[str, str]) -> list[str]:
    """The packages that are newer than the bound that pyproject.toml sets."""
    found = []
    for requirement in asked:
        match = re.match(r"([\w-]+)>=([\d.]+)", requirement)
        assert match is not None, requirement
        name, bound = match.groups()
        if re.sub(r"(\.0)+$", "", versions[name]) != re.sub(r"(\.0)+$", "", bound):
            found.append(f"{name} {versions[name]}")
    return found


def unpacked_tests(sdist: Path, folder: Path) -> Path:
    """The tests of the sdist without the package, so that the installed one is tested."""
    with tarfile.open(sdist) as archive:
        archive.extractall(folder / "sdist", filter="data")
    (root,) = (folder / "sdist").iterdir()
    shutil.rmtree(root / "preisach_jax")
    return root


def build(folder: Path) -> dict[str, Path]:
    """Build sdist and wheel of what is committed, whatever else lies in the checkout."""
    source, archive = folder / "source", folder / "source.tar"
    folder.mkdir()
    subprocess.run(["git", "archive", "--output", archive, "HEAD"], cwd=ROOT, check=True)
    with tarfile.open(archive) as packed:
        packed.extractall(source, filter="data")
    subprocess.run(["uv", "build", "--quiet", "--out-dir", folder, source], check=True)
    (wheel,), (sdist,) = folder.glob("*.whl"), folder.glob("*.tar.gz")
    return {"wheel": wheel, "sdist": sdist}


def environments(pythons: Sequence[str]) -> list[Environment]:
    """The oldest Python with the oldest and newest packages, the newest Python, and those between.

    Wheels have the same files on every Python, so that the sdist is tried once on each end.
    """
    oldest, *between, newest = pythons
    return [
        Environment(oldest, "lowest-direct", "wheel", with_tests=True),
        Environment(newest, "highest", "wheel", with_tests=True),
        Environment(oldest, "highest", "sdist", with_tests=False),
        *(Environment(python, "highest", "wheel", with_tests=False) for python in between),
        Environment(newest, "lowest-direct", "sdist", with_tests=False),
    ]


def main() -> None:
    """Try all environments, and write what came of it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pythons", nargs="+", required=True, metavar="VERSION=PATH")
    parser.add_argument("--only", type=int, nargs="*", help="numbers of environments, from 0")
    chosen = parser.parse_args()
    interpreters = dict(word.split("=", 1) for word in chosen.pythons)
    outcomes: dict[int, dict[str, Any]] = {}
    if chosen.only is not None and RESULT.exists():  # the others stay
        outcomes = dict(enumerate(json.loads(RESULT.read_text())["outcomes"]))
    with tempfile.TemporaryDirectory() as temporary:
        built = build(Path(temporary) / "dist")
        for number, environment in enumerate(environments(list(interpreters))):
            if chosen.only is not None and number not in chosen.only:
                continue
            folder = Path(temporary) / str(number)
            folder.mkdir()
            outcome = try_environment(environment, interpreters[environment.python], built, folder)
            print(environment, outcome.failed or "works", outcome.seconds, outcome.tests)
            outcomes[number] = asdict(outcome) | {"date": date.today().isoformat()}
            shutil.rmtree(folder)
    failed = sum(bool(outcome["failed"]) for outcome in outcomes.values())
    content = {
        "environments": len(outcomes),
        "failed": failed,
        "outcomes": [outcomes[number] for number in sorted(outcomes)],
    }
    RESULT.parent.mkdir(parents=True, exist_ok=True)
    RESULT.write_text(json.dumps(content, indent=1) + "\n")
    sys.exit(bool(failed))


if __name__ == "__main__":
    main()

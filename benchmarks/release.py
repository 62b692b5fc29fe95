"""Build what is released and try it as a user gets it: `make release-check`.

Wheel and sdist are built, the wheel is installed with the pinned packages into an environment of
its own, and the commands of the README are run there, outside of this folder. What a tool that is
not here would have to try (conda, pipx) is said to be untried. With UV_OFFLINE=1 all packages come
from uv's cache.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tarfile
import time
import tomllib
import zipfile
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).parents[1]
PLACE = ROOT / "build" / "release"
LONGEST_CHANGES = 60
"""Lines of a screen."""

IN_WHEEL = (
    "preisach_jax/py.typed",
    "preisach_jax/bundled/beam.csv",
    "preisach_jax/bundled/conventional_example.forc",
    "preisach_jax/report/report.html.j2",
)
IN_SDIST = (
    "Makefile",
    "requirements-run.lock",
    "requirements.lock",
    "tests/test_start.py",
    *IN_WHEEL,
)

FIT = """
import numpy as np, preisach_jax as pj
t = np.arange(3000) / 100
u = 5 - 5 * np.cos(t * (1 + t / 40))
assert pj.fit(pj.Record.from_arrays(t, u, u**1.1), levels=9).fit_percent > 99
assert "site-packages" in pj.__file__, pj.__file__
"""


class Untried(Exception):  # noqa: N818 - it is no error
    """What this machine has no tool for."""


def call(*words: str | Path, cwd: Path = ROOT) -> str:
    clean = {k: v for k, v in os.environ.items() if k not in {"PYTHONPATH", "VIRTUAL_ENV"}}
    done = subprocess.run(
        [str(word) for word in words],
        cwd=cwd,
        env=clean,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        last = (done.stderr.strip() or done.stdout.strip()).splitlines()[-12:]
        raise RuntimeError("\n  ".join([" ".join(map(str, words)), *last]))
    return done.stdout


def tool(name: str) -> str:
    """A program beside this Python, or on the path."""
    found = shutil.which(name, path=str(Path(sys.executable).parent)) or shutil.which(name)
    if found is None:
        raise Untried(f"there is no {name} here")
    return found


def version() -> str:
    return tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]


def wheel() -> Path:
    return PLACE / f"preisach_jax-{version()}-py3-none-any.whl"


def build() -> None:
    shutil.rmtree(PLACE, ignore_errors=True)
    call(sys.executable, "-m", "hatchling", "build", "-d", PLACE)
    with zipfile.ZipFile(wheel()) as file:
        lacking = set(IN_WHEEL) - set(file.namelist())
    with tarfile.open(PLACE / f"preisach_jax-{version()}.tar.gz") as file:
        names = {name.partition("/")[2] for name in file.getnames()}
        lacking |= set(IN_SDIST) - names
        file.extractall(PLACE / "unpacked", filter="data")
    if lacking:
        raise RuntimeError(f"not packed: {', '.join(sorted(lacking))}")
    # A wheel that is built from the sdist is the same one.
    [unpacked] = (PLACE / "unpacked").iterdir()
    call(
        sys.executable,
        "-m",
        "hatchling",
        "build",
        "-t",
        "wheel",
        "-d",
        PLACE / "again",
        cwd=unpacked,
    )
    with zipfile.ZipFile(wheel()) as one, zipfile.ZipFile(PLACE / "again" / wheel().name) as two:
        if {(i.filename, i.CRC) for i in one.infolist()} != {
            (i.filename, i.CRC) for i in two.infolist()
        }:
            raise RuntimeError("the wheel from the sdist differs from the one from this folder")


def install() -> None:
    call(sys.executable, "-m", "venv", PLACE / "venv")
    python = PLACE / "venv" / "bin" / "python"
    try:
        first = [tool("uv"), "pip", "install", "--python", python]
    except Untried:
        first = [python, "-m", "pip", "install"]
    call(*first, "--only-binary", ":all:", "--require-hashes", "-r", ROOT / "requirements-run.lock")
    call(*first, "--no-deps", wheel())


def installed(*words: str | Path) -> str:
    return call(PLACE / "venv" / "bin" / words[0], *words[1:], cwd=PLACE)


def commands() -> None:
    if installed("preisach", "--version").strip() != f"preisach {version()}":
        raise RuntimeError("preisach --version is not that of pyproject.toml")
    if "diagnose" not in installed("preisach", "--help"):
        raise RuntimeError("preisach --help lacks its commands")


def demo() -> None:
    said = installed("preisach", "demo", "--out", PLACE / "demo", "--force")
    for folder in ("beam", "simulated-stage"):
        if not (PLACE / "demo" / folder / "report.html").is_file():
            raise RuntimeError(f"the demo left no report in {folder}")
    if "The verdict was wrong" in said:
        raise RuntimeError("the demo's verdict of the simulated stage is wrong")


def fit() -> None:
    installed("python", "-c", FIT)


def uvx() -> None:
    call(tool("uvx"), "--from", wheel(), "preisach", "--version", cwd=PLACE)


def pipx() -> None:
    call(tool("pipx"), "run", "--spec", wheel(), "preisach", "--version", cwd=PLACE)


def conda() -> None:
    recipe = (ROOT / "recipe" / "meta.yaml").read_text()
    if f'version = "{version()}"' not in recipe:
        raise RuntimeError("recipe/meta.yaml has another version")
    call(tool("conda-build"), ROOT / "recipe")


def changelog() -> None:
    text = (ROOT / "CHANGELOG.md").read_text()
    own = text.partition(f"## [{version()}]")[2].partition("\n## ")[0]
    count = own.count("\n")
    if not 0 < count <= LONGEST_CHANGES:
        raise RuntimeError(f"{version()} has {count} lines in CHANGELOG.md")
    if not re.match(r" - \d{4}-\d\d-\d\d\n", own):
        raise Untried("the version has no date yet")


def documentation() -> None:
    call(tool("mkdocs"), "build", "--strict", "--quiet", "--site-dir", PLACE / "site")


def tag() -> None:
    tags = call("git", "tag", "--points-at", "HEAD").split()
    if f"v{version()}" not in tags:
        raise Untried(f"this commit has no tag v{version()}")


STEPS: tuple[tuple[str, Callable[[], None]], ...] = (
    ("wheel, sdist, and a wheel from the sdist", build),
    ("wheel into a new environment", install),
    ("preisach --version, --help", commands),
    ("preisach demo", demo),
    ("a fit in Python", fit),
    ("uvx", uvx),
    ("pipx run", pipx),
    ("conda recipe", conda),
    ("CHANGELOG", changelog),
    ("documentation", documentation),
    ("tag", tag),
)


def main() -> int:
    failed = False
    for name, step in STEPS:
        start = time.monotonic()
        try:
            step()
            result = "ok"
        except Untried as why:
            result = f"not tried: {why}"
        except RuntimeError as error:
            result, failed = f"FAILED: {error}", True
        print(f"{name:42} {time.monotonic() - start:6.1f} s  {result}", flush=True)
        if failed and step in {build, install}:
            break
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())

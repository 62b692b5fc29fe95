"""Which code a result belongs to: its commit, and whether the package has changed since."""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
RESULTS = Path(os.environ.get("PREISACH_RESULTS", ROOT / "benchmarks" / "results"))
"""Folder of the results; `claims.py` has them made anew in another one."""


def git(*words: str) -> str | None:
    """What git says about this tree; None without git, outside a clone, or where it fails."""
    command = ["git", "-C", str(ROOT), *words]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    return done.stdout.strip()


def commit() -> str:
    """The commit that is checked out, with a plus sign if the package was changed since."""
    head, changed = git("rev-parse", "HEAD"), git("status", "--porcelain", "--", "preisach_jax")
    return "unknown" if head is None else head + ("+" if changed else "")


def rows_of(path: Path) -> Iterator[Any]:
    """What the lines of a `.jsonl` hold; one that was torn by a sudden end is left out."""
    for line in path.read_bytes().split(b"\n"):
        try:
            row = json.loads(line)
        except ValueError:  # empty, or torn
            continue
        yield row


def commits_of(path: Path) -> set[str]:
    """The commits that a result carries: one, or one a line of a `.jsonl`."""
    one_a_line = path.suffix == ".jsonl"
    rows = rows_of(path) if one_a_line else [json.loads(path.read_text(encoding="utf-8"))]
    return {row.get("commit", "unknown") for row in rows}


def outdated() -> dict[str, list[str]] | None:
    """Results of another package than the one here, by name, with their commits.

    A result belongs to this package if no file of it differs from that commit's. None outside a
    clone, where nothing can be compared.
    """
    if git("rev-parse", "HEAD") is None:
        return None
    same: dict[str, bool] = {}
    found: dict[str, list[str]] = {}
    for path in sorted([*RESULTS.glob("*.json"), *RESULTS.glob("*/*.jsonl")]):
        for each in sorted(commits_of(path)):
            if each not in same:
                same[each] = git("diff", "--quiet", each, "--", "preisach_jax") is not None
            if not same[each]:
                found.setdefault(path.relative_to(RESULTS).as_posix(), []).append(each)
    return found

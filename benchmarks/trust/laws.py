"""Count the cases in which each law of the tests was tried.

    python benchmarks/trust/laws.py                          # all tests
    python benchmarks/trust/laws.py tests/test_laws*.py      # some of them

Runs every property of these tests that Hypothesis draws cases for, and writes how many it tried
and how many failed to `benchmarks/results/trust/laws.json`.
"""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from conditions import write_results

ROOT = Path(__file__).resolve().parents[2]
_TEST = re.compile(r"^(tests/\S+?)::(.+):$")
_COUNT = re.compile(r"(\d+) passing, (\d+) failing")


def counted(lines: list[str]) -> dict[str, dict[str, int]]:
    """Cases and failures of each property, from what pytest prints with Hypothesis's statistics."""
    laws: dict[str, dict[str, int]] = {}
    name = ""
    for line in lines:
        if found := _TEST.match(line.strip()):
            name = f"{found[1]}::{found[2].partition('[')[0]}"
        elif name and (found := _COUNT.search(line)):
            law = laws.setdefault(name, {"cases": 0, "failures": 0})
            law["cases"] += int(found[1])
            law["failures"] += int(found[2])
    return laws


def main() -> None:
    """Run the properties and write the counts."""
    command = [
        sys.executable, "-m", "pytest", "-q", "-m", "hypothesis", "-p", "no:cacheprovider",
        "--hypothesis-show-statistics", *(sys.argv[1:] or ["tests"]),
    ]  # fmt: skip
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    laws = counted(done.stdout.splitlines())
    if not laws:
        sys.exit(done.stdout[-2000:] + done.stderr[-2000:])
    write_results(
        "trust/laws.json", {"last_line": done.stdout.strip().splitlines()[-1], "laws": laws}
    )


if __name__ == "__main__":
    main()

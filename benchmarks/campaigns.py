"""Run what proves rather than protects: minutes to hours that `make test` does without.

    python benchmarks/campaigns.py                    # all of them, one after another
    python benchmarks/campaigns.py notebooks kills    # some of them
    python benchmarks/campaigns.py --list

Each is a command of its own, told by `--list`; one that fails does not stop the others.  Ends with
exit code 1 if any failed, and writes what came of each to `benchmarks/results/campaigns.json` when
all were run.  What a campaign tries at full size, a test of `make test` tries small.
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from conditions import write_results

ROOT = Path(__file__).resolve().parents[1]


@dataclass(frozen=True)
class Campaign:
    """A command that proves something.

    Attributes:
        proves: what, in a sentence.
        words: the command after `python`.
        needs: a package that it needs and this project does not.
        environment: what is set for it.
    """

    proves: str
    words: tuple[str, ...]
    needs: str = ""
    environment: dict[str, str] = field(default_factory=dict)


def _tests(*words: str) -> tuple[str, ...]:
    return ("-m", "pytest", "-q", "-m", "campaign", *words)


CAMPAIGNS = {
    "hidden": Campaign(
        "Hidden effects are named on default planes and further seeds.",
        _tests("tests", "--ignore=tests/test_readme.py", "--ignore=tests/test_notebooks.py"),
    ),
    "readme": Campaign("The README runs as it is written.", _tests("tests/test_readme.py")),
    "notebooks": Campaign("Every notebook runs in a kernel.", _tests("tests/test_notebooks.py")),
    "laws": Campaign(
        "The laws of the model hold in 500 cases each.",
        ("-m", "pytest", "-q", "-m", "hypothesis and not campaign", "tests"),
        environment={"PREISACH_EXAMPLES": "500"},
    ),
    "kills": Campaign(
        "Killed processes and full disks leave nothing half.", ("benchmarks/trust/faults.py",)
    ),
    "fuzz": Campaign(
        "Readers refuse damaged files in plain words.",
        ("benchmarks/trust/fuzz.py", "--seconds", "60"),
        needs="atheris",
    ),
    "soak": Campaign(
        "Filters run for 10⁷ samples.",
        ("benchmarks/trust/soak.py", "--samples", "1e7", "--out", "build/soak.json"),
    ),
    "spoiled": Campaign(
        "Spoiled records are judged as clean ones are.",
        ("benchmarks/trust/corruption.py", "--out", "build/spoiled"),
    ),
    "drive": Campaign(
        "Simulated stages follow wanted courses, and courses out of reach are told.",
        ("benchmarks/drive.py", "--folder", "build/drive"),
    ),
    "exported": Campaign(
        "Generated C equals `predict` in 100 models over 10⁶ samples each.",
        ("benchmarks/export.py", "--models", "100", "--samples", "1000000"),
    ),
    "endurance": Campaign(
        "Generated C holds 10⁹ samples of jitter, and odd samples under sanitizers.",
        ("benchmarks/endurance.py", "--jitter", "1000000000", "--fuzz", "300000"),
    ),
    "blind": Campaign(
        "The diagnosis names what is hidden in development records.",
        ("benchmarks/blind/run.py", "--out", "build/blind", "--limit", "60"),
    ),
}


def run(name: str) -> dict[str, str | float]:
    """Run one campaign: whether it passed, failed or could not be run, and its seconds."""
    campaign = CAMPAIGNS[name]
    if campaign.needs and importlib.util.find_spec(campaign.needs) is None:
        return {"outcome": f"not run: needs {campaign.needs}", "seconds": 0.0}
    begin = time.perf_counter()
    done = subprocess.run(
        [sys.executable, *campaign.words],
        cwd=ROOT,
        env=os.environ | campaign.environment,
        check=False,
    )
    outcome = "passed" if done.returncode == 0 else f"failed with exit code {done.returncode}"
    return {"outcome": outcome, "seconds": round(time.perf_counter() - begin, 1)}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the campaigns that are named, or all."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("names", nargs="*", metavar="campaign", help=", ".join(CAMPAIGNS))
    parser.add_argument("--list", action="store_true", help="what there is, and its command")
    asked = parser.parse_args(arguments)
    for name in asked.names:
        if name not in CAMPAIGNS:
            parser.error(f"there is no campaign {name!r}: one of {', '.join(CAMPAIGNS)}")
    if asked.list:
        for name, campaign in CAMPAIGNS.items():
            settings = "".join(f"{key}={value} " for key, value in campaign.environment.items())
            print(f"{name:10s} {campaign.proves}")
            print(f"{'':10s} {settings}python {' '.join(campaign.words)}")
        return 0
    results: dict[str, dict[str, str | float]] = {}
    for name in asked.names or CAMPAIGNS:
        print(f"--- {name}: {CAMPAIGNS[name].proves}", flush=True)
        results[name] = run(name)
        print(f"--- {name}: {results[name]['outcome']} ({results[name]['seconds']} s)", flush=True)
    if not asked.names:
        write_results("campaigns.json", {"campaigns": results})
    return int(any(str(each["outcome"]).startswith("failed") for each in results.values()))


if __name__ == "__main__":
    sys.exit(main())

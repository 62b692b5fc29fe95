"""Measure what a user waits for: a diagnosis and a prediction as whole processes.

    python benchmarks/whole_process.py

writes `benchmarks/results/whole_process.json` with device, versions and date.  Whole processes are
measured from outside, with start-up, report and peak memory; the first run finds no compiled code,
the others that of the runs before.  Settings are the default ones: all effects are tried.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

from common import write_results

from preisach_jax.plant import simulate_stage

SAMPLES, RATE_HZ, SEED = 36_000, 2000.0, 11
HIDDEN = ((), ("creep",), ("creep", "input_lag"), ("creep", "input_lag", "drift"))
RUNS = 3


def write_stage(path: Path, effects: tuple[str, ...]) -> None:
    """A simulated record as a CSV file."""
    simulate_stage(SEED, SAMPLES / RATE_HZ, effects, RATE_HZ).save(path)


def whole_process(arguments: list[str]) -> dict[str, float]:
    """Wall seconds and peak memory of one run of the command line.

    The peak is an upper bound: a child process begins with the peak of the one that starts it.
    """
    start = time.perf_counter()
    child = subprocess.Popen(
        [sys.executable, "-m", "preisach_jax.cli", *arguments], stdout=subprocess.DEVNULL
    )
    _, status, usage = os.wait4(child.pid, 0)
    if status != 0:
        raise RuntimeError(f"preisach {' '.join(arguments)} ended with status {status}")
    return {
        "wall_s": time.perf_counter() - start,
        "cpu_s": usage.ru_utime + usage.ru_stime,
        "peak_GiB": usage.ru_maxrss / 2**20,
    }


def diagnosis(folder: Path, effects: tuple[str, ...]) -> dict:
    """The first run of a diagnosis with no compiled code, and the median of later ones."""
    data, report = folder / "stage.csv", folder / "report"
    write_stage(data, effects)
    columns = ["--time", "t_s", "--input", "u_V", "--output", "z_um"]
    arguments = ["diagnose", str(data), *columns, "--report", str(report), "--quiet"]
    runs = [whole_process(arguments) for _ in range(1 + RUNS)]
    found = json.loads((report / "diagnosis.json").read_text())
    return {
        "samples": SAMPLES,
        "hidden": list(effects),
        "verdict": found["verdict"],
        "effects": found["effects"],
        "rms_validation": found["ladder"][-1]["rms_validation"],
        "first_run": runs[0],
        **_medians(runs[1:]),
    }


def prediction(folder: Path) -> dict:
    """A prediction by a fresh process."""
    arguments = ["predict", str(folder / "report" / "model.json"), str(folder / "stage.csv")]
    runs = [whole_process([*arguments, "--out", str(folder / "pred.csv")]) for _ in range(RUNS)]
    return {"samples": SAMPLES, **_medians(runs)}


def _medians(runs: list[dict[str, float]]) -> dict:
    walls = [run["wall_s"] for run in runs]
    return {
        "wall_s": median(walls),
        "wall_s_spread": [min(walls), max(walls)],
        "cpu_s": median(run["cpu_s"] for run in runs),
        "peak_GiB": max(run["peak_GiB"] for run in runs),
    }


def main() -> None:
    """Run everything and write the results."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        # As on a machine where the program never ran; later runs find what earlier ones compiled.
        os.environ["XDG_CACHE_HOME"] = str(folder / "cache")
        diagnoses = []
        for effects in HIDDEN:
            diagnoses.append(diagnosis(folder, effects))
            print(json.dumps(diagnoses[-1]), flush=True)
        predicted = prediction(folder)
        print(json.dumps(predicted), flush=True)
    write_results("whole_process.json", {"diagnose": diagnoses, "predict": predicted})


if __name__ == "__main__":
    main()

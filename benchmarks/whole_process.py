"""Measure what a user waits for: a diagnosis and a prediction, as whole processes and when warm.

    python benchmarks/run.py whole_process

writes `benchmarks/results/whole_process.json` with device, versions and date.  Whole processes are
measured from outside (start-up and compilation included, peak memory of the process); the warm
figures are those of a second call in one process, in which nothing is compiled any more.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

from conditions import write_results
from jax import monitoring

import preisach_jax as pj
from preisach_jax.plant import simulate_stage

DIAGNOSED, PREDICTED, RATE_HZ = 27_000, 36_000, 2000.0
HIDDEN = ((), ("creep",), ("input_lag",))


def write_stage(path: Path, samples: int, effects: tuple[str, ...], seed: int) -> None:
    """A simulated record as a CSV file."""
    simulate_stage(seed, samples / RATE_HZ, effects, RATE_HZ).save(path)


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
    """The command line on a fresh process, and the library on its first and its second call."""
    data = folder / "stage.csv"
    write_stage(data, DIAGNOSED, effects, seed=11)
    columns = ["--time", "t_s", "--input", "u_V", "--output", "z_um"]
    row = {"samples": DIAGNOSED, "hidden": list(effects)}
    row |= whole_process(["diagnose", str(data), *columns, "--report", str(folder / "report")])
    row["verdict"] = json.loads((folder / "report" / "diagnosis.json").read_text())["verdict"]
    record = pj.Record.load(data, time="t_s", input="u_V", output="z_um")
    compiled = []

    def listen(event: str, duration: float, **_: object) -> None:
        if event.endswith("backend_compile_duration"):
            compiled.append(duration)

    monitoring.register_event_duration_secs_listener(listen)
    for call in ("first_call", "second_call"):
        compiled.clear()
        start = time.perf_counter()
        pj.diagnose(record)
        row[call] = {
            "wall_s": time.perf_counter() - start,
            "of_it_compiling_s": float(sum(compiled)),
            "compilations": len(compiled),
        }
    monitoring.unregister_event_duration_listener(listen)
    return row


def prediction(folder: Path) -> dict:
    """A prediction of a long record by a fresh process, three times."""
    model = folder / "report" / "model.json"
    data = folder / "long.csv"
    write_stage(data, PREDICTED, (), seed=11)
    arguments = ["predict", str(model), str(data), "--out", str(folder / "pred.csv")]
    runs = [whole_process(arguments) for _ in range(3)]
    return {
        "samples": PREDICTED,
        "wall_s": median(run["wall_s"] for run in runs),
        "wall_s_spread": [min(r["wall_s"] for r in runs), max(r["wall_s"] for r in runs)],
        "peak_GiB": max(run["peak_GiB"] for run in runs),
    }


def main() -> None:
    """Run everything and write the results."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        diagnoses = []
        for effects in HIDDEN:
            diagnoses.append(diagnosis(folder, effects))
            print(json.dumps(diagnoses[-1]), flush=True)
        predicted = prediction(folder)
        print(json.dumps(predicted), flush=True)
    own_peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    content = {"own_peak_GiB": own_peak, "diagnose": diagnoses, "predict": predicted}
    write_results("whole_process.json", content)


if __name__ == "__main__":
    main()

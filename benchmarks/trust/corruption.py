"""Spoil the records of the blind benchmark, and see whether the diagnosis still says the same.

    python benchmarks/trust/corruption.py --limit 60 --workers 2

Each case is diagnosed as it was recorded, and with one output in a hundred moved by a normal number
times a fifth of the stroke and one in ten lost.  Reporting seeds, all excitations; each finished
case is one line of `benchmarks/results/trust/corruption/results.jsonl`, the same command goes on
where it was interrupted, and `corruption.json` beside that folder sums up.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
from blind.cases import Case, Choice, make_cases
from blind.results import read_results
from blind.run import ONE_THREAD, run_or_stop
from blind.world import make_measurement

FOLDER = Path(__file__).parents[1] / "results" / "trust" / "corruption"
SPIKES, HEIGHT, LOST = 0.01, 0.2, 0.1
SUITES = ("none", "single", "pairs", "outside")
SECONDS, LEVELS = 4.0, 13
"""Length of a record and levels of the plane: those of the blind benchmark take minutes a case."""


def spoiled(output: np.ndarray, stroke: float, seed: int) -> np.ndarray:
    """An output with spikes of a fifth of the stroke, one in a hundred, and a tenth of it lost."""
    rng = np.random.default_rng([seed, 7])
    there = np.flatnonzero(np.isfinite(output))
    rows = rng.choice(there, int(SPIKES * len(there)), replace=False)
    output = output.copy()
    output[rows] += HEIGHT * stroke * rng.normal(size=len(rows))
    output[rng.random(len(output)) < LOST] = np.nan
    return output


def compared(case: Case) -> dict[str, Any]:
    """What is said of a case as it is, and of the spoiled one."""
    import preisach_jax as pj  # in the worker, which has set its environment by then

    start = perf_counter()
    made = make_measurement(
        case.effects, case.seed, case.excitation, case.seconds, case.rate_hz, case.nothing
    )
    said = [
        pj.diagnose(
            pj.Record.from_arrays(
                made.time, made.input, output, aux=made.aux, name=case.id,
                units={"input": "V", "output": "um"},
            ),
            levels=LEVELS,
        )
        for output in (made.output, spoiled(made.output, made.stroke_um, case.seed))
    ]  # fmt: skip
    clean, spoilt = (
        {
            "verdict": found.verdict,
            "effects": list(found.effects),
            "rms": found.ladder[-1].rms_validation,
            "spikes": len(found.steps[-1].record.spikes),
            "close": list(found.close),
        }
        for found in said
    )
    seconds = perf_counter() - start
    return {"id": case.id, "clean": clean, "spoiled": spoilt, "seconds": seconds}


def summary(results: list[dict[str, Any]]) -> dict[str, Any]:
    """How many verdicts and names changed, and by how much the error did.

    A verdict that says that it is close, on either record, has told that it may change.
    """
    pairs = [(result["clean"], result["spoiled"]) for result in results]
    error = [bad["rms"] / clean["rms"] - 1 for clean, bad in pairs]
    changed = [
        (c, b) for c, b in pairs if (c["verdict"], c["effects"]) != (b["verdict"], b["effects"])
    ]
    return {
        "cases": len(pairs),
        "spikes": f"{SPIKES:.0%} of the samples, normal, {HEIGHT:g} of the stroke",
        "lost": f"{LOST:.0%} of the samples",
        "verdict_changed": sum(c["verdict"] != b["verdict"] for c, b in pairs),
        "names_changed": sum(c["effects"] != b["effects"] for c, b in pairs),
        "changed": len(changed),
        "changed_and_not_close": sum(not (c["close"] or b["close"]) for c, b in changed),
        "error_change_median": float(np.median(error)),
        "error_change_greatest": float(max(error, key=abs)),
        "error_changed_by_more_than_a_tenth": sum(abs(e) > 0.1 for e in error),
        "left_out_of_clean_records": sum(clean["spikes"] for clean, _ in pairs),
        "commits": sorted({result["commit"] for result in results}),
    }


def main() -> None:
    """Compare the cases that have no result yet, and sum up all that is there."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--limit", type=int, default=60, help="cases")
    parser.add_argument("--out", type=Path, help="with development seeds, into this folder")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    asked = parser.parse_args()
    os.environ.update(ONE_THREAD)
    seeds = "development" if asked.out else "reporting"
    folder = asked.out or FOLDER
    cases = make_cases(Choice(SUITES, seeds=seeds, limit=asked.limit))
    cases = [replace(case, seconds=SECONDS) for case in cases]
    run_or_stop(cases, folder, asked.workers, compared)
    found = summary(read_results(folder))
    if asked.out:
        print(json.dumps(found, indent=1))
        return
    from conditions import write_results  # loads JAX, which must see the environment

    write_results(
        "trust/corruption.json",
        found | {"seeds": seeds, "seconds_a_record": SECONDS, "levels": LEVELS},
    )


if __name__ == "__main__":
    main()

"""Judge the same development cases before and after a change of the library, and compare.

    python benchmarks/blind/verdicts.py --out before           # with the code as it was
    python benchmarks/blind/verdicts.py --out after            # with the code as it is
    python benchmarks/blind/verdicts.py --out after --against before

The set holds some 120 short records on a plane of 13 levels: 40 with nothing hidden, three of each
effect alone, pairs and triples; so that a change can be judged within an hour.  It can be
interrupted and goes on.  The comparison is printed, and lists every case that differs.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
import traceback
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np

from blind.cases import Case, Choice, make_cases
from blind.machines import STRENGTHS as MACHINES
from blind.rates import has_wrong_name, is_exact
from blind.results import read_results
from blind.run import ONE_THREAD, run_or_stop
from blind.world import EFFECTS, make_measurement

SECONDS, RATE_HZ, LEVELS = 5.0, 1000.0, 13
PARTS = 60
"""Parts into which each group is cut, so that any beginning is an even sample of the whole."""


def chosen_cases() -> list[Case]:
    """The fixed set, in an order in which any first part is an even sample."""
    single = [
        case
        for name in EFFECTS
        if name not in MACHINES
        for case in make_cases(
            Choice(["single"], effects=[name], sizes=[1.0], excitations=["rich"], limit=3)
        )
    ]
    groups = [
        make_cases(Choice(["none"], excitations=["poor", "fair", "rich"], limit=40)),
        single,
        make_cases(Choice(["pairs"], excitations=["rich"], limit=20)),
        make_cases(Choice(["triples"], excitations=["rich"], limit=10)),
    ]
    cases = [
        case
        for part in range(PARTS)
        for group in groups
        for case in group[part * len(group) // PARTS : (part + 1) * len(group) // PARTS]
    ]
    return [replace(case, seconds=SECONDS, rate_hz=RATE_HZ) for case in cases]


def judge(case: Case) -> dict[str, Any]:
    """Diagnose one case; what was said, and what was hidden."""
    import preisach_jax as pj

    made = make_measurement(
        case.effects, case.seed, case.excitation, case.seconds, case.rate_hz, case.nothing
    )
    units = {"input": "V", "output": "um"}
    record = pj.Record.from_arrays(made.time, made.input, made.output, aux=made.aux, units=units)
    hidden = {"id": case.id, "suite": case.suite, "hidden": list(made.truth)}
    begin = time.perf_counter()
    try:
        found = pj.diagnose(record, levels=LEVELS)
    except Exception:
        return hidden | {"error": traceback.format_exc(limit=-3)}
    return hidden | {
        "error": None,
        "noise_um": made.noise_um,
        "verdict": found.verdict,
        "effects": list(found.effects),
        "families": [list(finding.family) for finding in found.findings],
        "base": found.ladder[0].rms_validation,
        "final": found.ladder[-1].rms_validation,
        "seconds": time.perf_counter() - begin,
    }


def compared(before: Sequence[dict[str, Any]], after: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Right and wrong names, errors and times of the cases that both have.

    Arguments:
        before, after: results of two states of the library.

    Returns:
        Counts by suite, the ratio of final errors, seconds, and the cases that differ.
    """
    old = {one["id"]: one for one in before if not one["error"]}
    pairs = [(old[one["id"]], one) for one in after if one["id"] in old and not one["error"]]
    suites: dict[str, Any] = {}
    for suite in ("none", "single", "pairs", "triples"):
        rows = [pair for pair in pairs if pair[0]["suite"] == suite]
        suites[suite] = {"cases": len(rows)} | {
            name: {
                "exactly_right": sum(is_exact(pair[k]) for pair in rows),
                "with_a_wrong_name": sum(has_wrong_name(pair[k]) for pair in rows),
            }
            for k, name in enumerate(("before", "after"))
        }
    ratio = np.array([new["final"] / was["final"] for was, new in pairs])
    return {
        "suites": suites,
        "final_error_ratio": {q: float(np.quantile(ratio, q)) for q in (0.05, 0.5, 0.95)},
        "final_error_within_2_percent": int(np.sum(ratio < 1.02)),
        "median_seconds": [
            float(np.median([pair[k]["seconds"] for pair in pairs])) for k in (0, 1)
        ],
        "differing": [
            {
                "id": was["id"],
                "hidden": was["hidden"],
                "before": [was["verdict"], was["effects"], was["final"]],
                "after": [new["verdict"], new["effects"], new["final"]],
            }
            for was, new in pairs
            if (was["verdict"], was["effects"]) != (new["verdict"], new["effects"])
        ],
    }


def main() -> None:
    """Judge what has no result yet, and compare if that is asked for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--out", type=Path, required=True, help="folder of the results")
    parser.add_argument("--against", type=Path, help="results of another state, to compare with")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--limit", type=int, help="at most so many cases")
    asked = parser.parse_args()
    os.environ.update(ONE_THREAD)
    run_or_stop(chosen_cases()[: asked.limit], asked.out, asked.workers, judge)
    if asked.against:
        import json

        found = compared(read_results(asked.against), read_results(asked.out))
        print(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()

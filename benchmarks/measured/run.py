"""Diagnose measured records and set expectations and baselines beside the verdicts.

    python -m benchmarks.measured.run FOLDER            (all records)
    python -m benchmarks.measured.run FOLDER fsm_piezo_300mV.csv

FOLDER holds the records; their licences and sources are in `expectations.toml`, where what a
physicist expects was written before the run.  Writes `benchmarks/results/measured.json` with
device, versions and date; of the other records it keeps what it has.
"""

from __future__ import annotations

import json
import sys
import time
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from common import RESULTS, write_results
from provenance import commit

import preisach_jax as pj
from measured.baselines import BASELINES
from preisach_jax.diagnosis.result import VERDICTS
from preisach_jax.effects import resolve

EXPECTATIONS = Path(__file__).with_name("expectations.toml")


@dataclass(frozen=True)
class Expectation:
    """A measured record, and what a physicist expects of it.

    Attributes:
        file: its name.
        source: whose it is, and its licence.
        units: of its columns x and z.
        aux: columns that may act as well.
        physics: what is to be missing, in words.
        required: families of effects of which one each is to be named.
        allowed: effects that may be named beside them.
        verdicts: those that fit.
        initial_memory: state at the first sample, where the source tells it.
    """

    file: str
    source: str
    units: dict[str, str]
    aux: tuple[str, ...]
    physics: str
    required: tuple[tuple[str, ...], ...]
    allowed: tuple[str, ...]
    verdicts: tuple[str, ...]
    initial_memory: str = "free"

    def __post_init__(self) -> None:
        """Raise `InputError` if an effect or a verdict is none."""
        names = {name for family in self.required for name in family} | set(self.allowed)
        resolve(sorted(names), dict.fromkeys(self.aux, ""))
        if unknown := [verdict for verdict in self.verdicts if verdict not in VERDICTS]:
            raise pj.InputError(
                f"{self.file}: there is no verdict {unknown[0]!r} (known: {', '.join(VERDICTS)})"
            )

    def outcome(self, verdict: str, effects: Sequence[str]) -> str:
        """Whether a verdict is `right`, `wrong` (a name that is not there), or `missed`."""
        known = {name for family in self.required for name in family} | set(self.allowed)
        if set(effects) - known:
            return "wrong"
        named = all(set(family) & set(effects) for family in self.required)
        return "right" if named and verdict in self.verdicts else "missed"


def expectations(path: Path = EXPECTATIONS) -> list[Expectation]:
    """Those of a file."""
    content = tomllib.loads(path.read_text(encoding="utf-8"))
    found = []
    for record in content["record"]:
        try:
            found.append(Expectation(**{key: _frozen(value) for key, value in record.items()}))
        except (pj.InputError, TypeError) as error:
            raise pj.InputError(f"{path}: {record.get('file', 'a record')}: {error}") from error
    return found


def _frozen(value: Any) -> Any:
    return tuple(map(_frozen, value)) if isinstance(value, list) else value


def judged(expected: Expectation, folder: Path) -> dict[str, Any]:
    """What the diagnosis says of a record, and what the baselines reach on its held-out rows."""
    record = pj.Record.load(
        folder / expected.file,
        time="t",
        input="x",
        output="z",
        aux=expected.aux,
        units=expected.units,
        initial_memory=expected.initial_memory,
    )
    begin = time.perf_counter()
    found = pj.diagnose(record)
    seconds = time.perf_counter() - begin
    print(f"\n{expected.file}\n{found.summary()}", flush=True)
    stroke = record.output_range
    return {
        "file": expected.file,
        "source": expected.source,
        "samples": len(record),
        "physicist": expected.physics,
        "expected": {"effects": expected.required, "verdicts": expected.verdicts},
        "outcome": expected.outcome(found.verdict, found.effects),
        "verdict": found.verdict,
        "sentence": found.sentence,
        "families": [list(finding.family) for finding in found.findings],
        "ladder": [
            {
                "effects": list(rung.effects),
                "percent_of_stroke": 100 * rung.rms_validation / stroke,
                "fit_percent": rung.fit_percent,
            }
            for rung in found.ladder
        ],
        "baselines_percent_of_stroke": _baselines(record, found.final.validation),
        "budget_percent_of_stroke": {
            name: 100 * getattr(found.budget, name) / stroke
            for name in ("noise", "discretisation", "memory", "unexplained")
        },
        "located": found.located,
        "remainder": found.remainder_in_words,
        "seconds": seconds,
    }


def _baselines(record: pj.Record, held_out: np.ndarray) -> dict[str, float | None]:
    """Held-out RMS errors in per cent of the stroke; None where a simulation diverges."""
    inputs = np.column_stack([record.input, *record.aux.values()])
    rows = record.measured & ~held_out
    judged_rows = record.measured & held_out
    output = np.where(record.measured, record.output, record.output[rows].mean())
    reached: dict[str, float | None] = {}
    for name, baseline in BASELINES.items():
        if name == "NARX" and find_spec("sysidentpy") is None:
            continue
        with np.errstate(all="ignore"):
            simulated = baseline(record.time, inputs, output, rows)
            rms = np.sqrt(np.mean((simulated - output)[judged_rows] ** 2))
        percent = 100 * float(rms) / record.output_range
        reached[name] = percent if np.isfinite(percent) and percent < 100 else None
        print(f"{name}: {percent:.3g} % of the stroke", flush=True)
    return reached


def main() -> None:
    """Diagnose the records of a folder and write the table."""
    if len(sys.argv) < 2 or not Path(sys.argv[1]).is_dir():
        sys.exit(f"usage: python {sys.argv[0]} FOLDER [FILE ...], a folder with the records")
    folder, chosen = Path(sys.argv[1]), sys.argv[2:]
    every = expectations()
    asked = [each for each in every if not chosen or each.file in chosen]
    if unknown := set(chosen) - {each.file for each in every}:
        sys.exit(f"there is no expectation of {', '.join(sorted(unknown))}")
    if missing := [each.file for each in asked if not (folder / each.file).is_file()]:
        sys.exit(f"{folder} lacks {', '.join(missing)}")
    now = commit()
    results = RESULTS / "measured.json"
    earlier = json.loads(results.read_text())["records"] if results.is_file() else []
    kept = {record["file"]: record for record in earlier if "outcome" in record}
    for each in asked:
        kept[each.file] = judged(each, folder) | {"commit": now}
        done = [kept[one.file] for one in every if one.file in kept]
        write_results("measured.json", {"records": done})


if __name__ == "__main__":
    main()

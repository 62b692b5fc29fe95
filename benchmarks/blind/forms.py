r"""How often is a sparse form found where the library has no name, and how often where nothing is?

    python benchmarks/blind/forms.py --out forms                  # development seeds 1 and 2
    python benchmarks/blind/forms.py --out forms --kinds drag warming --first 5 --seeds 1 --plain 0
    python benchmarks/blind/forms.py --out forms --kinds drag --effects drift --levels 25
    python benchmarks/blind/forms.py --out told --first 900 --seeds 3 --plain 200 --report

Ten kinds of physics that are no effect of the library are added, by NumPy alone, to the output of
stages that share no code with the package. Each record is diagnosed with the whole library, and a
form is sought of what is left. The error with the form stands beside that of the true law: of the
plain model fitted to the same record without what was hidden. Plain records hide nothing; of these
it is counted how often a form is offered, by the command (which asks for a form only where the
verdict leaves something) and by the search alone (whatever the verdict).  Each finished record is
one line of OUT/results.jsonl, and the same command goes on where it was interrupted.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np

from blind.excitation import make_drive
from blind.rates import rate
from blind.results import read_results
from blind.run import ONE_THREAD, run_or_stop
from blind.stage import make_stage

if TYPE_CHECKING:
    import preisach_jax as pj

SECONDS, RATE_HZ = 12.0, 250.0
SIZE, NOISE = (0.005, 0.03), 1e-4
"""RMS of what is hidden, and of the noise, in parts of the stroke."""

ENOUGH = 1.3
"""Times the error of the true law that the form may leave."""

VOLTS = 100.0


@dataclass(frozen=True)
class Hiding:
    """A record to diagnose.

    Attributes:
        kind: one of `LAWS`, or None where nothing is hidden.
        seed: of the record.
        effects, levels: of the diagnosis; None where it chooses.
    """

    kind: str | None
    seed: int
    effects: tuple[str, ...] | None = None
    levels: int | None = None

    @property
    def id(self) -> str:
        """What tells it from the others."""
        said = [f"{name}={value}" for name, value in self.settings.items() if value is not None]
        return "/".join([self.kind or "nothing", str(self.seed), *said])

    @property
    def settings(self) -> dict[str, Any]:
        """Of the diagnosis."""
        effects = None if self.effects is None else "+".join(self.effects)
        return {"effects": effects, "levels": self.levels}


@dataclass(frozen=True, eq=False)
class Scene:
    """What the laws may depend on, along the record.

    Attributes:
        t: (time,) in parts of the record, 0 to 1.
        u, h: (time,) input and output of the stage, -1 to 1.
        v: (time,) rate of the input, in parts of one that is seldom exceeded.
        load: (time,) a load, about -1 to 1.
        rng: for the numbers of the law.
    """

    t: np.ndarray
    u: np.ndarray
    h: np.ndarray
    v: np.ndarray
    load: np.ndarray
    rng: np.random.Generator

    def late(self, values: np.ndarray) -> np.ndarray:
        """(time,) what follows values with a time constant of 2 to 15 % of the record."""
        share = -np.expm1(-self.t[1] / self.rng.uniform(0.02, 0.15))
        out, now = np.empty_like(values), float(values[0])
        for k, value in enumerate(values.tolist()):
            now += share * (value - now)
            out[k] = now
        return out


LAWS: dict[str, Callable[[Scene], np.ndarray]] = {
    "position_rate": lambda s: s.u * s.v,
    "rate_cubed": lambda s: s.v**3,
    "drag": lambda s: s.v * np.abs(s.v),
    "column_rate": lambda s: s.load * s.v,
    "warming": lambda s: s.late(s.v**2),
    "warm_gain": lambda s: s.h * s.late(np.abs(s.v)),
    "thinning": lambda s: (1 + 0.8 * s.u) * s.v / (1 + np.abs(s.v) / s.rng.uniform(0.2, 0.6)),
    "exponential": lambda s: np.exp(s.rng.uniform(1.0, 1.8) * s.u) * s.v,
    "dry_position": lambda s: s.u * np.tanh(s.v / s.rng.uniform(0.05, 0.2)),
    "column_bow": lambda s: np.abs(s.load) ** s.rng.uniform(1.3, 1.8) * (1 + 0.5 * s.u),
}


def made(kind: str | None, seed: int) -> tuple[pj.Record, np.ndarray]:
    """A record, and (time,) what is hidden in it, in um.

    Arguments:
        kind: one of `LAWS`, or None for nothing.
        seed: of everything random.
    """
    import preisach_jax as pj  # in the worker, which has set its environment by then

    count = round(SECONDS * RATE_HZ)
    t = np.arange(count) / RATE_HZ
    x = make_drive("fair" if seed % 2 else "rich", SECONDS, seed, RATE_HZ)(t)
    stage = make_stage(seed)
    clean = stage.response(x)
    rng = np.random.default_rng([seed, 8])
    v = np.gradient(x, t)
    at = np.linspace(0.0, SECONDS, 31)
    load = np.interp(t, at, rng.uniform(-1.0, 1.0, 31))
    moving = np.abs(v)[np.abs(v) > 1e-6]
    scene = Scene(
        t / SECONDS, 2 * x - 1, 2 * (clean - clean.min()) / np.ptp(clean) - 1,
        v / np.quantile(moving, 0.95), load, rng,
    )  # fmt: skip
    hidden = np.zeros(count)
    if kind is not None:
        law = LAWS[kind](scene)
        low, high = np.log10(SIZE)
        hidden = law / law.std() * stage.stroke_um * 10 ** rng.uniform(low, high)
    noise = NOISE * stage.stroke_um * np.random.default_rng([seed, 9]).normal(size=count)
    units = {"input": "V", "output": "um", "load": "N"}
    record = pj.Record.from_arrays(
        t, VOLTS * x, clean + hidden + noise, aux={"load": 10 * load}, units=units
    )
    return record, hidden


def judge(case: Hiding) -> dict[str, Any]:
    """What is found in one record."""
    found = nothing(case) if case.kind is None else measured(case)
    return {"id": case.id, "kind": case.kind, "seed": case.seed} | case.settings | found


def measured(case: Hiding) -> dict[str, Any]:
    """What is found of one kind: verdict, effects, form, and the errors beside the true law's."""
    import preisach_jax as pj

    record, hidden = made(case.kind, case.seed)
    found = pj.diagnose(record, case.effects, case.levels)
    form = pj.find_form(found)
    without = pj.Record.from_arrays(record.time, record.input, record.output - hidden)
    law = pj.fit(without, levels=found.model.plane.levels).rms_validation
    return {
        "hidden_rms": float(hidden.std()),
        "verdict": found.verdict,
        "named": list(found.effects),
        "offered": form.offered,
        "formula": form.formula,
        "why_not": form.why_not,
        "plain_rms": found.ladder[0].rms_validation,
        "model_rms": found.ladder[-1].rms_validation,
        "form_rms": form.rms_after,
        "law_rms": law,
        "ratio": form.rms_after / law,
    }


def nothing(case: Hiding) -> dict[str, Any]:
    """Whether a form is offered of a plain record: by the command, and by the search alone."""
    import preisach_jax as pj
    from preisach_jax.diagnosis.pursuit import DRAWS, sought
    from preisach_jax.fit import double_precision

    record, _ = made(None, case.seed)
    found = pj.diagnose(record, case.effects, case.levels)
    with double_precision():
        alone = sought(found.final, found.budget.discretisation, 0, DRAWS)
    return {
        "verdict": found.verdict,
        "named": list(found.effects),
        "offered": pj.find_form(found).offered,
        "by_search": alone.offered,
        "why_not": alone.why_not,
        "gain": alone.evidence.get("gain", 0.0),
        "chance": alone.chance,
    }


def summed(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Rates with their intervals."""
    found = [row for row in rows if row["kind"] is not None]
    plain = [row for row in rows if row["kind"] is None]
    return {
        "as_good_as_the_law": rate(each["offered"] and each["ratio"] <= ENOUGH for each in found),
        "offered": rate(each["offered"] for each in found),
        "offered_of_nothing": rate(each["offered"] for each in plain),
        "offered_of_nothing_by_search": rate(each["by_search"] for each in plain),
    }


def _told(row: dict[str, Any]) -> str:
    said = f"{row['id']:20} {row['verdict']:17} {'+'.join(row['named']):24}"
    if row["kind"] is None:
        return f"{said} offered {row['offered']}, by the search {row['by_search']}"
    return (
        f"{said} {row['model_rms']:8.4f} -> {row['form_rms']:8.4f}, law {row['law_rms']:8.4f} um, "
        f"ratio {row['ratio']:6.2f}: {row['formula'] or row['why_not']}"
    )


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--out", type=Path, required=True, help="folder of the results")
    parser.add_argument("--kinds", nargs="*", default=list(LAWS), choices=list(LAWS))
    parser.add_argument("--effects", nargs="*", help="effects to try, if not the whole library")
    parser.add_argument("--levels", type=int, help="levels of the plane, if not found")
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--plain", type=int, default=10)
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--report", action="store_true", help="write benchmarks/results/forms.json")
    return parser.parse_args()


def main() -> None:
    """Measure, print, and write what is found."""
    asked = _arguments()
    os.environ.update(ONE_THREAD)
    settings = (None if asked.effects is None else tuple(asked.effects), asked.levels)
    seeds = range(asked.first, asked.first + asked.seeds)
    plain = range(asked.first, asked.first + asked.plain)
    cases = [Hiding(kind, seed, *settings) for seed in seeds for kind in asked.kinds]
    cases += [Hiding(None, seed, *settings) for seed in plain]
    run_or_stop(cases, asked.out, asked.workers, judge)
    wanted = {case.id for case in cases}
    rows = [row for row in read_results(asked.out) if row["id"] in wanted]
    print(*map(_told, rows), json.dumps(summary := summed(rows), indent=1), sep="\n")
    if asked.report:
        from conditions import write_results

        world = {"seconds": SECONDS, "rate_hz": RATE_HZ, "size": SIZE, "noise": NOISE}
        content = {"world": world, "first_seed": asked.first, "summary": summary, "rows": rows}
        write_results("forms.json", content)


if __name__ == "__main__":
    main()

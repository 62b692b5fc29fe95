r"""How much of what comes do the 95 % bands of `predict` hold, and how wide are they?

    python benchmarks/blind/bands.py --records 12                   # development seeds 1 to 12
    python benchmarks/blind/bands.py --hidden creep --levels 25
    python benchmarks/blind/bands.py --first 900 --records 3 --report \
        --hidden nothing creep output_lag drift resonance

Of each simulated record of 12 s, which shares no code with the package, the first 9 s identify a
model, but some blocks that are kept from the fit altogether.  It predicts those blocks
(`inside`), the 3 s that follow (`forecast`), and another record of the same stage (`new`), and
the share of the measured rows inside the band is told: of all, and in slices.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
from common import write_results

import preisach_jax as pj
from blind.world import Measurement, make_measurement

SECONDS, FITTED_S, RATE_HZ = 12.0, 9.0, 500.0
BLOCKS, BLOCK_S = 8, 0.15
"""Blocks of the fitted part that are kept from the fit."""

DRIVES = ("rich", "fair")
KINDS = ("inside", "forecast", "new")
KNOWN_AS = {"nothing": ()}
"""Effects of the fitted model, where they are not those that are hidden."""


def measured(seed: int, effect: str, drive: str, levels: int) -> dict[str, Any]:
    """Counts of one record: rows inside the band by kind and slice, width and error by kind."""
    hidden = {} if effect == "nothing" else {effect: 1.0}
    made = make_measurement(hidden, seed, drive, SECONDS, RATE_HZ)
    rows = np.arange(len(made.time))
    fitted = made.time < FITTED_S
    rng = np.random.default_rng([seed, 77])
    inside = np.zeros(len(rows), dtype=bool)
    for begin in rng.uniform(1.0, FITTED_S - BLOCK_S, BLOCKS):
        inside |= (made.time >= begin) & (made.time < begin + BLOCK_S)
    output = np.where(inside, np.nan, made.output)
    record = pj.Record.from_arrays(made.time[fitted], made.input[fitted], output[fitted])
    model = pj.fit(record, KNOWN_AS.get(effect, (effect,)), levels=levels).model
    found: dict[str, Any] = {"seed": seed, "effect": effect, "drive": drive}
    found["intervals"] = [
        (name, number.value, number.low, number.high, made.truth[effect][name])
        for name, number in model.parameters.get(effect, {}).items()
        if name in made.truth.get(effect, {})
    ]
    passed = visited(made, fitted & ~inside)
    whole = pj.Record.from_arrays(made.time, made.input, made.output)
    told = model.predict(whole)
    for kind, chosen in (("inside", inside), ("forecast", ~fitted)):
        found[kind] = counted(made, told, chosen, passed)
    other = DRIVES[1 - DRIVES.index(drive)]
    fresh = make_measurement(hidden, seed, other, 6.0, RATE_HZ)
    clear = fresh.time > 0.5
    span = model.plane.high - model.plane.low
    beyond = np.maximum(model.plane.low - fresh.input, fresh.input - model.plane.high)
    if beyond.max() <= 0.005 * span:
        again = pj.Record.from_arrays(fresh.time, fresh.input, fresh.output)
        found["new"] = counted(fresh, model.predict(again), clear, passed)
    return found


def place(made: Measurement) -> np.ndarray:
    """(time,) cell of a coarse plane of input and last turning value, found by walking."""
    low, span = made.input.min(), np.ptp(made.input)
    u = (made.input - low) / span
    turn, last, highest, lowest = np.zeros(len(u)), u[0], u[0], u[0]
    for k, value in enumerate(u):
        if value > highest:
            highest = value
            if highest - lowest > 0.01:
                last = lowest
        elif highest - value > 0.01:
            last, lowest = highest, value
            highest = value
        lowest = min(lowest, value)
        turn[k] = last
    return np.floor(u * 11.99).astype(int) * 12 + np.floor(np.clip(turn, 0, 1) * 11.99).astype(int)


def visited(made: Measurement, rows: np.ndarray) -> Callable[[Measurement], np.ndarray]:
    """How many of some rows of a record lie in the cell of each row of another."""
    counts = np.bincount(place(made)[rows], minlength=144)
    return lambda other: counts[place(other)]


def counted(
    made: Measurement,
    told: pj.Prediction,
    chosen: np.ndarray,
    passed: Callable[[Measurement], np.ndarray],
) -> dict[str, Any]:
    """Rows inside the band by slice, mean width, and RMS error, over the chosen rows."""
    error = np.abs(made.output - told.output)
    hit = (made.output >= told.low) & (made.output <= told.high)
    half = (told.high - told.low) / 2
    speed = np.abs(np.gradient(made.input, made.time))
    turned = np.flatnonzero(np.diff(np.sign(np.diff(made.input))) != 0) + 1
    marks = np.concatenate([[0], turned])
    since = made.time - made.time[marks[np.searchsorted(marks, np.arange(len(speed)), "right") - 1]]
    visits = passed(made)
    slices = {"all": np.ones(len(hit), dtype=bool)}
    for name, values in (("speed", speed), ("since turn", since), ("visits", visits)):
        edges = np.quantile(values[chosen], (1 / 3, 2 / 3))
        part = np.searchsorted(edges, values)
        slices |= {f"{name} {k + 1}/3": part == k for k in range(3)}
    for second in range(3):
        ahead = made.time - FITTED_S
        slices[f"second {second + 1}"] = (ahead >= second) & (ahead < second + 1)
    return {
        "slices": {
            name: (int(hit[chosen & rows].sum()), int((chosen & rows).sum()))
            for name, rows in slices.items()
        },
        "half": float(half[chosen].mean()),
        "rms": float(np.sqrt(np.mean(error[chosen] ** 2))),
    }


def summed(own: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Coverage in per cent, of all records and of the worst by slice, and median widths."""
    slices: dict[str, dict[str, float]] = {}
    for name in own[0]["slices"]:
        each = [one["slices"][name] for one in own]
        hits, rows = np.sum(each, axis=0)
        if rows:
            worst = min(h / n for h, n in each if n)
            slices[name] = {"percent": 100 * hits / rows, "worst": 100 * worst}
    return {
        "records": len(own),
        "width": float(np.median([one["half"] / (1.96 * one["rms"]) for one in own])),
        "slices": slices,
    }


def by_effect(everything: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """What `summed` says of each kind, seeds and intervals, by hidden effect."""
    told: dict[str, Any] = {}
    for effect in dict.fromkeys(one["effect"] for one in everything):
        found = [one for one in everything if one["effect"] == effect]
        told[effect] = {
            kind: summed([one[kind] for one in found if kind in one])
            for kind in KINDS
            if any(kind in one for one in found)
        }
        told[effect]["seeds"] = [one["seed"] for one in found]
        told[effect]["intervals"] = [each for one in found for each in one["intervals"]]
    return told


def main() -> None:
    """Measure, print the tables, and write the counts where asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--records", type=int, default=8, help="development seeds 1 to this")
    parser.add_argument("--first", type=int, default=1, help="first seed")
    parser.add_argument("--hidden", nargs="+", default=["nothing", "creep"])
    parser.add_argument("--levels", type=int, default=13)
    parser.add_argument("--report", action="store_true", help="write results/bands.json")
    chosen = parser.parse_args()
    everything: list[dict[str, Any]] = []
    for effect in chosen.hidden:
        everything += [
            measured(seed, effect, DRIVES[seed % 2], chosen.levels)
            for seed in range(chosen.first, chosen.first + chosen.records)
        ]
        # After each effect, so that what ends early has told what it measured.
        told = {"levels": chosen.levels, "hidden": by_effect(everything)}
        print(json.dumps(told["hidden"][effect]), flush=True)
        if chosen.report:
            write_results("bands.json", told)


if __name__ == "__main__":
    main()

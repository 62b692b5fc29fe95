"""Let the adaptive filter run for long, and break its sensor on the way.

    python benchmarks/trust/soak.py                    # all parts, an hour or more
    python benchmarks/trust/soak.py single faults      # some of them
    python benchmarks/trust/soak.py --samples 1e5      # quickly

Parts: `single` samples, `blocks`, runs in `event` form over all samples at once, and `faults` of
the sensor. A stage with known weights and noise is followed along a record that begins and ends in
saturation and is repeated, with new noise each time. At checkpoints the output that the filter
keeps is compared with a fresh sum of weights times states. Writes
`benchmarks/results/trust/soak.json`; parts that are not run keep their results there.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
import time
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

os.environ.setdefault("JAX_PLATFORMS", "cpu")

import jax
import numpy as np

from preisach_jax.filter.adaptive import AdaptiveFilter
from preisach_jax.filter.online import OnlineFilter
from preisach_jax.filter.state import FilterState
from preisach_jax.operator.plane import Plane
from preisach_jax.operator.simulation import simulate

RESULTS = Path(__file__).resolve().parents[1] / "results" / "trust" / "soak.json"

PERIOD, BLOCK, END = 100_000, 20_000, 2_000
NOISE = 0.01  # deviation, in parts of the output's range
PER_LEVEL = 0.11  # levels that the input moves in a sample: some nine samples a level
CHECKPOINTS = 10.0 ** np.arange(4, 10)

FAULTS = {
    "none": lambda z, rng: z,
    "output lost": lambda z, rng: np.full_like(z, np.nan),
    "every second output lost": lambda z, rng: np.where(rng.random(z.size) < 0.5, np.nan, z),
    "spikes of 1e6 sigma": lambda z, rng: (
        z + 1e6 * NOISE * rng.choice([-1, 0, 1], z.size, p=[0.005, 0.99, 0.005])
    ),
    "stuck": lambda z, rng: np.full_like(z, z[0]),
    "polarity reversed": lambda z, rng: -z,
    "sensor clipped at half": lambda z, rng: np.minimum(z, 0.5),
}
FAULTY, WINDOW = 5_000, 1_000


def memory_mib() -> float:
    """Resident memory of this process."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def wandering(plane: Plane, samples: int, seed: int = 0) -> np.ndarray:
    """Ramps between random turning points, from saturated low and back to it."""
    rng = np.random.default_rng(seed)
    speed = PER_LEVEL * plane.delta_x
    span = plane.high - plane.low
    turns = plane.low + span * rng.random(samples)
    turns[:2] = plane.low, plane.high
    reached = np.append(0.0, np.cumsum(np.abs(np.diff(turns)))) / speed
    back = math.ceil(span / speed) + 2
    x = np.interp(np.arange(samples - back), reached, turns)
    fall = np.maximum(x[-1] - speed * np.arange(1, back + 1), plane.low)
    return np.append(x, fall)


def stage(plane: Plane, hysteron: str, samples: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Input, output without noise, of the range 1, and weights of a stage on the plane."""
    weights = np.random.default_rng(1).uniform(0.2, 1.0, plane.cells)
    weights /= weights.sum()
    x = wandering(plane, samples)
    return x, np.asarray(simulate(plane, weights, x, hysteron)), weights


def periods(x: np.ndarray, z: np.ndarray, samples: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Blocks of the repeated record, with new noise, until there are so many samples."""
    rng = np.random.default_rng(2)
    for begin in range(0, samples, BLOCK):
        part = slice(begin % PERIOD, begin % PERIOD + BLOCK)
        yield x[part], (z[part] + rng.normal(0.0, NOISE, BLOCK)).astype(z.dtype)


def drift(kept: float, state: FilterState) -> float:
    """How far a kept output is off the sum of weights times states, in parts of Σ|R̂|y."""
    terms = np.asarray(state.weights, float) * np.asarray(state.states, float)
    return abs(kept - math.fsum(terms)) / max(math.fsum(np.abs(terms)), 1e-300)


class Compilations:
    """Counts what JAX compiles."""

    def __init__(self) -> None:
        self.count = 0
        jax.monitoring.register_event_duration_secs_listener(self._note)

    def _note(self, event: str, duration_secs: float, **_: str | int) -> None:
        self.count += event == "/jax/core/compile/backend_compile_duration"


COMPILED = Compilations()


def followed(
    online: OnlineFilter,
    x: np.ndarray,
    z: np.ndarray,
    samples: int,
    take_in: Callable[[np.ndarray, np.ndarray], None],
) -> dict:
    """Feed blocks for long; drift, memory and speed at checkpoints, and the error at the end."""
    rows, spent, done, worst = [], [], 0, 0.0
    compiled = 0
    checkpoints = sorted({float(n) for n in CHECKPOINTS if n <= samples} | {float(samples)})
    for x_part, z_part in periods(x, z, samples):
        begin = time.perf_counter()
        take_in(x_part, z_part)
        spent.append(time.perf_counter() - begin)
        # At rest, and without an output, nothing is learnt: this is what the filter keeps.
        kept = online(float(x_part[-1]))
        worst = max(worst, drift(kept, online.state))
        done += BLOCK
        if done <= 2 * BLOCK:
            compiled = COMPILED.count
        while checkpoints and done >= checkpoints[0]:
            rows.append(
                {
                    "samples": done,
                    "drift": drift(kept, online.state),
                    "worst_drift_so_far": worst,
                    "memory_mib": memory_mib(),
                    "microseconds_a_sample": 1e6 * float(np.median(spent[-50:])) / BLOCK,
                    "compilations_since_second_block": COMPILED.count - compiled,
                }
            )
            checkpoints.pop(0)
    weights = np.asarray(online.state.weights)
    return {
        "samples": done,
        "seconds": sum(spent),
        "checkpoints": rows,
        "weights_finite": bool(np.isfinite(weights).all()),
        "weights_least_and_most": [float(weights.min()), float(weights.max())],
    }


def soak_online(part: str, samples: int, precision: str, hysteron: str, levels: int) -> dict:
    """One sample a call, or by blocks."""
    plane = Plane(levels=levels, low=0.0, high=10.0)
    x, z, truth = stage(plane, hysteron, PERIOD)
    x, z = x.astype(precision), z.astype(precision)
    online = OnlineFilter(AdaptiveFilter(plane, hysteron, step_size=0.2))

    def by_samples(x: np.ndarray, z: np.ndarray) -> None:
        for sample in zip(x.tolist(), z.tolist(), strict=True):
            online(*sample)

    take_in = by_samples if part == "single" else online.block
    row = followed(online, x, z, samples, take_in)
    off = np.asarray(online.state.weights) - truth
    return row | {"weight_error_in_parts": float(np.linalg.norm(off) / np.linalg.norm(truth))}


def soak_event(samples: int, precision: str, hysteron: str, levels: int) -> dict:
    """Runs in event form over records that grow: the outputs at their ends against fresh sums."""
    plane = Plane(levels=levels, low=0.0, high=10.0)
    filt = AdaptiveFilter(plane, hysteron, step_size=0.2)
    x, z, _ = stage(plane, hysteron, PERIOD)
    # Relays see only the crossings of levels: such a record stands for one nine times as long.
    part = slice(None, None, round(1 / PER_LEVEL) if hysteron == "relay" else None)
    rng, rows = np.random.default_rng(3), []
    for count in sorted({int(n) for n in CHECKPOINTS if PERIOD <= n <= samples} | {samples}):
        long_x = np.resize(x[part], count).astype(precision)
        long_z = np.resize(z[part], count)
        long_z = (long_z + NOISE * rng.standard_normal(count)).astype(precision)
        begin = time.perf_counter()
        found = filt.run(long_x, long_z, form="event")
        output = np.asarray(found.output)
        seconds = time.perf_counter() - begin
        # From the same weights as there, all hysterons are summed up at every sample.
        last = slice(count - END, count)
        state = filt.run(long_x[: count - END], long_z[: count - END], form="event").state
        fresh = np.asarray(filt.run(long_x[last], long_z[last], state).output)
        rows.append(
            {
                "samples": count,
                "events": int(np.count_nonzero(np.asarray(found.switched))),
                "seconds": seconds,
                "drift_in_parts_of_the_range": float(np.abs(output[last] - fresh).max()),
                "memory_mib": memory_mib(),
                "finite": bool(np.isfinite(output).all()),
            }
        )
        print("  ", rows[-1], flush=True)
    return {"runs": rows}


def recovery(filt: AdaptiveFilter, x: np.ndarray, z: np.ndarray) -> Iterator[dict]:
    """After each fault, samples until the filter errs as little as if the output had been lost."""
    x, z = np.tile(x, 3), np.tile(z, 3)
    sound = z + np.random.default_rng(4).normal(0.0, NOISE, z.size)
    begin = PERIOD + 20_000
    end = begin + FAULTY

    def errors(output: np.ndarray) -> np.ndarray:
        """What windows of the prediction err by, beside a constant."""
        return (output - z[end:]).reshape(-1, WINDOW).std(axis=1)

    start = OnlineFilter(filt)
    start.block(x[:begin], sound[:begin])
    lost = OnlineFilter(filt, start.state)
    lost.block(x[begin:end])
    undisturbed = errors(lost.block(x[end:], sound[end:]))
    for fault, broken in FAULTS.items():
        online = OnlineFilter(filt, start.state)
        online.block(x[begin:end], broken(sound[begin:end], np.random.default_rng(5)))
        after = np.asarray(online.state.weights)
        output = online.block(x[end:], sound[end:])
        late = errors(output) > 1.25 * undisturbed + 0.1 * NOISE
        windows = int(np.flatnonzero(late)[-1]) + 1 if late.any() else 0
        yield {
            "fault": fault,
            "weights_moved": float(np.linalg.norm(after - np.asarray(lost.state.weights))),
            "finite": bool(np.isfinite(after).all() and np.isfinite(output).all()),
            "samples_to_recover": windows * WINDOW if windows < len(late) else None,
            "error_after_fault": float(errors(output)[0]),
            "error_at_the_end": float(errors(output)[-1]),
            "error_at_the_end_without_fault": float(undisturbed[-1]),
        }


def soak_faults() -> list[dict]:
    """Faults of the sensor for 5,000 samples, and how long the filter takes to forget them."""
    rows = []
    settings = {
        "paper's rule": {},
        "step size 0.2": {"step_size": 0.2},
        "error limit of 5 deviations": {"error_limit": 5 * math.sqrt(2) * NOISE},
        "nonnegative": {"nonnegative": True},
        "error limit, nonnegative": {"error_limit": 5 * math.sqrt(2) * NOISE, "nonnegative": True},
        "leakage 1e-4": {"leakage": 1e-4},
    }
    plane = Plane(levels=9, low=0.0, high=10.0)
    for hysteron in ("relay", "ramp"):
        x, z, _ = stage(plane, hysteron, PERIOD)
        for name, options in settings.items():
            filt = AdaptiveFilter(plane, hysteron, **options)
            for found in recovery(filt, x, z):
                rows.append({"hysteron": hysteron, "filter": name} | found)
                print("  ", rows[-1], flush=True)
    return rows


def cases_of(part: str, samples: int) -> list[tuple[int, str, str, int]]:
    """Samples, precision, kind of hysteron and levels of the runs of a part."""
    most = {"single": 10**6, "blocks": 10**7, "event": 10**7}[part]
    count = min(samples, most)
    cases = [
        (count, precision, hysteron, 19)
        for precision in ("float64", "float32")
        for hysteron in ("relay", "ramp")
    ]
    if part == "blocks" and samples >= 10**8:
        cases += [(10**8, "float64", "relay", 9)]
    return cases


def measure(part: str, samples: int) -> list[dict]:
    """All rows of a part."""
    if part == "faults":
        with jax.enable_x64(True):
            return soak_faults()
    rows = []
    for count, precision, hysteron, levels in cases_of(part, samples):
        row = {"precision": precision, "hysteron": hysteron, "levels": levels}
        print(part, count, row, flush=True)
        with jax.enable_x64(precision == "float64"):
            found = (
                soak_event(count, precision, hysteron, levels)
                if part == "event"
                else soak_online(part, count, precision, hysteron, levels)
            )
        rows.append(row | found)
        print("  ", json.dumps(found), flush=True)
    return rows


def main() -> None:
    """Run parts and write the results."""
    names = ("single", "blocks", "event", "faults")
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("parts", nargs="*", choices=[[], *names], help="all, unless named")
    parser.add_argument("--samples", type=float, default=1e8, help="of the longest run")
    parser.add_argument("--out", type=Path, default=RESULTS)
    given = parser.parse_args()
    packages = ("preisach_jax", "jax", "jaxlib", "numpy", "equinox")
    for part in given.parts or names:
        begin = time.perf_counter()
        rows = measure(part, int(given.samples))
        content = json.loads(given.out.read_text()) if given.out.exists() else {}
        content[part] = {
            "date": datetime.now(UTC).isoformat(timespec="seconds"),
            "versions": {"python": sys.version.split()[0]} | {p: version(p) for p in packages},
            "hours": (time.perf_counter() - begin) / 3600,
            "noise_in_parts_of_the_range": NOISE,
            "rows": rows,
        }
        given.out.parent.mkdir(parents=True, exist_ok=True)
        given.out.write_text(json.dumps(content, indent=1) + "\n")
        print(f"written to {given.out}", flush=True)


if __name__ == "__main__":
    main()

"""Measure how time grows with levels, samples and lanes, and how much memory long records take.

    python benchmarks/run.py growth

Relays from event to event, double precision, one core.  Exponents are fitted to the larger half of
each series, where what does not grow weighs least, and drawn beside those expected.  The peak of
memory is that of a process of its own, and what the run adds to it, its compilation included for
the forward run (Linux only).
"""

from __future__ import annotations

import json
import os
import subprocess
import sys

import jax
import jax.numpy as jnp
import matplotlib as mpl
import numpy as np
from conditions import RESULTS, write_results
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullFormatter
from timing import measured

from preisach_jax.filter.adaptive import AdaptiveFilter
from preisach_jax.operator.plane import Plane
from preisach_jax.operator.simulation import simulate
from preisach_jax.plant import RANGE_V
from preisach_jax.plot.style import AFTER, BEFORE, STYLE, png
from preisach_jax.signals import bernoulli_ramp

EVENTS, REPEATS, LONG = 4_000, 15, 10_000_000
LEVELS = (9, 19, 37, 75, 150, 300)
SAMPLES = (12_500, 25_000, 50_000, 100_000, 200_000, 400_000)
LANES = (1, 8, 64, 256, 1024, 4096)


def walk(plane: Plane, count: int = EVENTS) -> np.ndarray:
    """(1 + count,) input that passes one threshold a sample, in sweeps of random length."""
    rng = np.random.default_rng(plane.levels)
    levels, level, way = [0], 0, 1
    while len(levels) <= count:
        goal = rng.integers(level, plane.levels) + 1 if way > 0 else rng.integers(0, max(level, 1))
        levels += list(range(level + way, goal + way, way))
        level, way = levels[-1], -way
    # Halfway between two thresholds, so that each step passes one.
    ends = np.clip(np.array(levels[: count + 1]), 0, plane.levels)
    return np.clip((ends + 0.01) * plane.delta_x, 0.0, plane.high)


def adapted(plane: Plane, outputs: int) -> dict:
    """Time of the filter over so many outputs of one input."""
    x = walk(plane)
    z = np.random.default_rng(0).normal(size=(outputs, len(x)))
    filt = AdaptiveFilter(plane)
    batch = jax.jit(jax.vmap(lambda z: filt.run(x, z, missing=False).weights))
    return measured(lambda: batch(z), REPEATS)


def over_levels() -> list[dict]:
    """The recursion on planes of several sizes, at one number of events."""
    rows = []
    for levels in LEVELS:
        plane = Plane(levels=levels, low=0.0, high=1.0)
        rows.append({"levels": levels, "events": EVENTS} | adapted(plane, 1))
    return rows


def over_samples() -> list[dict]:
    """Simulation of records of several lengths."""
    plane, rows = Plane(levels=37, low=0.0, high=RANGE_V), []
    weights = jnp.ones(plane.cells)
    for samples in SAMPLES:
        x = bernoulli_ramp(jax.random.key(0), samples, 2000.0, high=RANGE_V)
        time = measured(lambda x=x: simulate(plane, weights, x, "relay"), REPEATS)
        rows.append({"samples": samples} | time)
    return rows


def over_lanes() -> list[dict]:
    """The recursion for several numbers of outputs of one input."""
    plane, rows = Plane(levels=37, low=0.0, high=1.0), []
    for lanes in LANES:
        rows.append({"lanes": lanes} | adapted(plane, lanes))
    return rows


def exponent(rows: list[dict], name: str) -> float:
    """Slope of log time over the larger half of a series."""
    half = rows[len(rows) // 2 - 1 :]
    # Other work on the machine only ever adds to the time: the least one is the surest.
    x, y = ([np.log(row[key]) for row in half] for key in (name, "least_s"))
    return float(np.polyfit(x, y, 1)[0])


PEAK = """
import ctypes, json, sys
import jax, jax.numpy as jnp, numpy as np
jax.config.update("jax_enable_x64", sys.argv[1] == "gradient")
from preisach_jax.operator.simulation import simulate
from preisach_jax.filter.adaptive import AdaptiveFilter
from preisach_jax.operator.plane import Plane

task, samples = sys.argv[1], int(sys.argv[2])
plane = Plane(levels=37, low=0.0, high=75.0)
weights = jnp.ones(plane.cells)
rng = np.random.default_rng(0)
x = np.abs(np.cumsum(rng.normal(0.0, 0.05, samples).astype(np.float32)) % 150.0 - 75.0)
x = jnp.asarray(x, jnp.result_type(float))
few = x[:1000]

def run(x):
    if task == "forward":
        return jax.block_until_ready(simulate(plane, weights, x, "relay"))
    loss = lambda w: jnp.sum(simulate(plane, w, x, "relay") ** 2)
    return jax.block_until_ready(jax.value_and_grad(loss)(weights))

def resident(what):
    lines = open("/proc/self/status").read().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(what)) / 1024

run(few)
if task == "gradient":
    run(x)  # what compiling takes is there before
    ctypes.CDLL("libc.so.6").malloc_trim(0)
before = resident("VmRSS")
open("/proc/self/clear_refs", "w").write("5")  # the peak is counted from here
run(x)
peak = resident("VmHWM")
print(json.dumps({"process_MiB": peak, "run_MiB": peak - before}))
"""


def peak(task: str, samples: int) -> dict:
    """Peak memory of a process of its own, and what the run added to it, in MiB."""
    command = [sys.executable, "-c", PEAK, task, str(samples)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return {"task": task, "samples": samples} | json.loads(done.stdout)


def _shown(value: float, _: int) -> str:
    """A number on an axis, in thousands from ten thousand on."""
    return f"{value / 1000:g}k" if value >= 10_000 else f"{value:g}"


def draw(series: dict[str, tuple[str, str, float, list[dict]]]) -> None:
    """Time over size, with the exponents expected as dashed lines."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(11, 3.6), layout="constrained")
        axes = figure.subplots(1, len(series))
        for axis, (title, (name, label, expected, rows)) in zip(axes, series.items(), strict=True):
            x, y = (np.array([row[key] for row in rows]) for key in (name, "least_s"))
            axis.loglog(
                x, 1e3 * y, "o-", color=AFTER, label=f"measured, {exponent(rows, name):.2f}"
            )
            line = 1e3 * y[-1] * (x / x[-1]) ** expected
            axis.loglog(x, line, "--", color=BEFORE, label=f"exponent {expected:g}")
            axis.set(title=title, xlabel=label, ylabel="time (ms)")
            axis.xaxis.set_major_locator(FixedLocator(list(x)))
            axis.xaxis.set_major_formatter(FuncFormatter(_shown))
            axis.yaxis.set_major_formatter(FuncFormatter(_shown))
            axis.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            for side in (axis.xaxis, axis.yaxis):
                side.set_minor_formatter(NullFormatter())
            axis.legend()
    (RESULTS / "growth.png").write_bytes(png(figure))


def main() -> None:
    """Measure all, and write figures and picture."""
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    jax.config.update("jax_enable_x64", True)
    series = {
        f"levels, {EVENTS} events, one lane": ("levels", "levels N", 1.0, over_levels()),
        "samples, N = 37": ("samples", "samples K", 1.0, over_samples()),
        f"lanes, N = 37, {EVENTS} events": ("lanes", "lanes", 1.0, over_lanes()),
    }
    draw(series)
    memory = [peak("forward", LONG), peak("gradient", 50_000)]
    fitted = {title: exponent(rows, name) for title, (name, _, _, rows) in series.items()}
    for title, value in fitted.items():
        print(f"{title}: exponent {value:.2f}")
    for row in memory:
        print(row)
    rows = {title: rows for title, (_, _, _, rows) in series.items()}
    write_results("growth.json", {"exponents": fitted, "series": rows, "memory": memory})


if __name__ == "__main__":
    main()

"""Measure what one sample costs from Python: the online filter, and the jitted step beside it.

    python benchmarks/run.py streaming

writes `benchmarks/results/streaming.json` with device, versions and date.  A Bernoulli ramp at
2 kHz is fed sample by sample, in double precision, by one thread that is pinned to one core.  The
times are those of single calls, garbage collection and all; the first call, which may compile, is
told apart.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable

import jax
import numpy as np
from conditions import write_results

from preisach_jax.filter.adaptive import AdaptiveFilter
from preisach_jax.filter.online import OnlineFilter
from preisach_jax.operator.checks import HYSTERONS
from preisach_jax.operator.plane import Plane
from preisach_jax.plant import RANGE_V
from preisach_jax.signals import bernoulli_ramp

LEVELS, RATE_HZ = (9, 19, 37, 75), 2000.0
SAMPLES, JITTED_SAMPLES = 50_000, 10_000
PERCENTILES = (50, 90, 99, 99.9)
EDGES_US = np.geomspace(1.0, 1e5, 101)  # twenty bins a decade


def jitted(filt: AdaptiveFilter) -> Callable[[float, float], float]:
    """A sample a call by the compiled `AdaptiveFilter.step`."""
    start, step = jax.jit(AdaptiveFilter.init), jax.jit(AdaptiveFilter.step)
    state = None

    def take_in(x: float, z: float) -> float:
        nonlocal state
        state, info = step(filt, start(filt, x, z) if state is None else state, x, z)
        return float(info.output)

    return take_in


def latency(take_in: Callable[[float, float], float], x: list, z: list) -> dict:
    """Microseconds of single calls: percentiles and a histogram."""
    spent = []
    for sample in zip(x, z, strict=True):
        begin = time.perf_counter_ns()
        take_in(*sample)
        spent.append((time.perf_counter_ns() - begin) / 1e3)
    first, later = spent[0], np.array(spent[1:])
    counts = np.histogram(later.clip(EDGES_US[0], EDGES_US[-1]), EDGES_US)[0]
    row = {f"p{percent}_us": float(np.percentile(later, percent)) for percent in PERCENTILES}
    return {
        "samples": len(x),
        "least_us": later.min(),
        **row,
        "most_us": later.max(),
        "first_us": first,
        "histogram": counts,
    }


def measure() -> list[dict]:
    """A row for every kind of hysteron, plane and way to take in a sample."""
    x = bernoulli_ramp(jax.random.key(0), SAMPLES, RATE_HZ, high=RANGE_V)
    z = 1.5 * np.asarray(x) + np.random.default_rng(0).normal(0.0, 0.01, SAMPLES)
    x, z = np.asarray(x).tolist(), z.tolist()
    rows = []
    for hysteron in HYSTERONS:
        for levels in LEVELS:
            filt = AdaptiveFilter(Plane(levels=levels, low=0.0, high=RANGE_V), hysteron)
            for way, take_in, samples in (
                ("online", OnlineFilter(filt), SAMPLES),
                ("jitted step", jitted(filt), JITTED_SAMPLES),
            ):
                measured = latency(take_in, x[:samples], z[:samples])
                rows.append({"way": way, "hysteron": hysteron, "levels": levels, **measured})
                print(
                    f"{way}, {hysteron}, N = {levels}: median {measured['p50_us']:.1f}, "
                    f"p99 {measured['p99_us']:.1f} us",
                    flush=True,
                )
    return rows


def main() -> None:
    """Measure and write the results."""
    pins = hasattr(os, "sched_setaffinity")
    cores = os.sched_getaffinity(0) if pins else set()
    if pins:
        os.sched_setaffinity(0, {max(cores)})
    try:
        with jax.enable_x64(True):
            rows = measure()
    finally:
        if pins:
            os.sched_setaffinity(0, cores)
    content = {
        "rate_hz": RATE_HZ,
        "pinned_to_one_core": pins,
        "histogram_edges_us": EDGES_US,
        "rows": rows,
    }
    write_results("streaming.json", content)


if __name__ == "__main__":
    main()

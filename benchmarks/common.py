"""What the benchmarks share: seconds of calls, and results as JSON files with where and when."""

from __future__ import annotations

import json
import os
import platform
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import date
from importlib.metadata import version
from pathlib import Path

import jax
import numpy as np
from provenance import RESULTS, commit

REPEATS = 9


def write_results(name: str, content: dict) -> Path:
    """Write measured figures with commit, device, versions and date among the results."""
    conditions = {
        "commit": commit(),
        "date": date.today().isoformat(),
        "device": f"{platform.machine()} {jax.devices()[0].device_kind}, {os.cpu_count()} cores, "
        f"{platform.system()}",
        "backend": jax.default_backend(),
        "python": platform.python_version(),
        "versions": {
            package: version(package)
            for package in ("preisach_jax", "jax", "jaxlib", "numpy", "scipy", "equinox")
        },
        "load_average_at_end": os.getloadavg(),
    }
    RESULTS.mkdir(parents=True, exist_ok=True)
    path = RESULTS / name
    text = json.dumps(conditions | content, indent=1, default=np.ndarray.tolist)
    path.write_text(text + "\n")
    print(f"written to {path}")
    return path


def timed(function: Callable, *arguments) -> float:
    """Seconds of one call, its result included."""
    begin = time.perf_counter()
    jax.block_until_ready(function(*arguments))
    return time.perf_counter() - begin


def measured(function: Callable, repeats: int = REPEATS) -> dict[str, float]:
    """Seconds of the first call, which compiles, and median and range of those after it."""
    first = timed(function)
    return {"first_s": first} | spread([timed(function) for _ in range(repeats)])


def spread(seconds: list[float]) -> dict[str, float]:
    """Median and range of repeated measurements."""
    return {
        "median_s": float(np.median(seconds)),
        "least_s": min(seconds),
        "most_s": max(seconds),
        "repeats": len(seconds),
    }


@contextmanager
def one_core() -> Iterator[None]:
    """Keep this process on one core, where the system can."""
    cores = os.sched_getaffinity(0) if hasattr(os, "sched_setaffinity") else None
    if cores:
        os.sched_setaffinity(0, {max(cores)})
    try:
        yield
    finally:
        if cores:
            os.sched_setaffinity(0, cores)


PERCENTILES = (50, 90, 99, 99.9)


def latency(take_in: Callable[[float, float], float], x: list, z: list) -> dict:
    """Microseconds of single calls; the first, which may compile, apart."""
    spent = []
    for sample in zip(x, z, strict=True):
        begin = time.perf_counter_ns()
        take_in(*sample)
        spent.append((time.perf_counter_ns() - begin) / 1e3)
    first, later = spent[0], np.array(spent[1:])
    row = {f"p{percent}_us": float(np.percentile(later, percent)) for percent in PERCENTILES}
    ends = {"least_us": later.min(), "most_us": later.max(), "first_us": first}
    return {"samples": len(x)} | row | ends

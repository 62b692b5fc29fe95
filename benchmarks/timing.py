"""Seconds of one call, and of many."""

from __future__ import annotations

import time
from collections.abc import Callable

import jax
import numpy as np

REPEATS = 9


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

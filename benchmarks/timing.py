"""Seconds of one call, and of many."""

from __future__ import annotations

import time
from collections.abc import Callable

import jax
import numpy as np


def timed(function: Callable, *arguments) -> float:
    """Seconds of one call, its result included."""
    begin = time.perf_counter()
    jax.block_until_ready(function(*arguments))
    return time.perf_counter() - begin


def spread(seconds: list[float]) -> dict[str, float]:
    """Median and range of repeated measurements."""
    return {
        "median_s": float(np.median(seconds)),
        "least_s": min(seconds),
        "most_s": max(seconds),
        "repeats": len(seconds),
    }

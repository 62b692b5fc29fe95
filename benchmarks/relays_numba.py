"""The paper's recursion and the model's output, with relays, as one would write them for numba.

The same as `relays.c`, loop by loop: an input that passes no threshold costs a comparison.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module

import numpy as np


def _settle(lowest, highest, level, to):
    lowest[level:to] = to
    highest[to:level] = to
    for i in range(len(lowest)):
        lowest[i] = min(lowest[i], to)
        highest[i] = max(highest[i], to)


def _start(levels, level):
    lowest, highest = np.zeros(levels, np.int64), np.full(levels, level)
    lowest[:level] = level
    return lowest, highest


def _switched(levels, lowest, highest, level, to, cells):
    """Indices of the relays that a move switches, and how many they are."""
    count = 0
    if to > level:
        for i in range(level, to):
            for j in range(lowest[i], i + 1):
                cells[count] = i * (i + 1) // 2 + j
                count += 1
    else:
        for j in range(level - 1, to - 1, -1):
            for i in range(j, highest[j]):
                cells[count] = i * (i + 1) // 2 + j
                count += 1
    return count


def _level(x, low, delta_x, levels):
    return min(max(int((x - low) / delta_x + 0.5), 0), levels)


def numba_functions() -> tuple[Callable, Callable] | None:
    """`(adapt, simulate)`, which take what those of `relays.c` take; None without numba."""
    try:
        njit = import_module("numba").njit(fastmath=True)
    except ImportError:
        return None
    helpers = [njit(each) for each in (_level, _start, _switched, _settle)]
    return _adapt(njit, *helpers), _simulate(njit, *helpers)


def _adapt(njit, level_of, start, switched, settle):
    @njit
    def adapt(levels, low, delta_x, x, z, weights):
        level = level_of(x[0], low, delta_x, levels)
        lowest, highest = start(levels, level)
        cells = np.empty(len(weights), np.int64)
        reference, error = z[0].copy(), np.empty(z.shape[1])
        for k in range(1, len(x)):
            to = level_of(x[k], low, delta_x, levels)
            if to == level:
                continue
            sign = 1.0 if to > level else -1.0
            count = switched(levels, lowest, highest, level, to, cells)
            if count:
                error[:] = 0.0
                for c in range(count):
                    for lane in range(z.shape[1]):
                        error[lane] += weights[cells[c], lane]
                for lane in range(z.shape[1]):
                    rise = z[k, lane] - reference[lane]
                    error[lane] = sign * (rise - sign * error[lane]) / count
                    reference[lane] = z[k, lane]
                for c in range(count):
                    for lane in range(z.shape[1]):
                        weights[cells[c], lane] += error[lane]
            settle(lowest, highest, level, to)
            level = to

    return adapt


def _simulate(njit, level_of, start, switched, settle):
    @njit
    def simulate(levels, low, delta_x, x, weights, output):
        level = level_of(x[0], low, delta_x, levels)
        lowest, highest = start(levels, level)
        cells = np.empty(len(weights), np.int64)
        output[0] = 0.0
        for i in range(level):
            for j in range(i + 1):
                output[0] += weights[i * (i + 1) // 2 + j]
        for k in range(1, len(x)):
            output[k] = output[k - 1]
            to = level_of(x[k], low, delta_x, levels)
            if to == level:
                continue
            sign = 1.0 if to > level else -1.0
            count = switched(levels, lowest, highest, level, to, cells)
            for c in range(count):
                output[k] += sign * weights[cells[c]]
            settle(lowest, highest, level, to)
            level = to

    return simulate

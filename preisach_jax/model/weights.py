"""Weights whose sums do not depend on the order of summation."""

from __future__ import annotations

import math

import numpy as np


def exactly_summable(weights: np.ndarray) -> np.ndarray:
    """Weights rounded so that sums of them are exact in any order.

    They become whole multiples of a step, 2^-51 of a power of two above the sum of their sizes, so
    that relays give the same output to the bit however it is summed: here all at once, in generated
    code from a table.

    Arguments:
        weights: (cells,) weights.

    Returns:
        (cells,) weights, changed by less than 5e-16 of the sum of their sizes.
    """
    total = float(np.abs(weights).sum())
    step = 2.0 ** (math.frexp(total)[1] - 51)
    return np.round(weights / step) * step if total > 0 else weights

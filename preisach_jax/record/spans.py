"""Spans of rows that have something in common."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool


def spans(marked: Bool[np.ndarray, " time"]) -> list[tuple[int, int]]:
    """First row of each unbroken span of marked rows, and the row behind its last.

    Arguments:
        marked: `(time,)`, the rows.
    """
    edges = np.flatnonzero(np.diff(marked.astype(np.int8), prepend=0, append=0))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))

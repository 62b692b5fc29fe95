"""How far apart other models, that the record could have led to, predict."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from preisach_jax.chain import Chain, Coefficients
from preisach_jax.model.band import Others
from preisach_jax.record import Record
from preisach_jax.record.course import reversals
from preisach_jax.record.joined import without_rows

Numbers = tuple[Mapping[str, Mapping[str, float]], Coefficients]
"""Nonlinear parameters by effect and name, and linear coefficients."""

MOST_ROWS = 8_000
"""Samples of a longer record along which other models are simulated, straight in between."""

SMALL_TURN = 0.002
"""Share of the input's range by which it must come back for a turn to be among them."""


def differences(
    chain: Chain,
    here: Numbers,
    others: Others | None,
    record: Record,
    run: Callable[[Numbers, Record], np.ndarray],
) -> tuple[np.ndarray, np.ndarray]:
    """What other models predict minus what the one that was identified does.

    Returns:
        (row,) samples of the record: all, or the `few_rows` of a long one; and (model, row) the
        differences there, in output units.
    """
    count = len(record.time)
    rows = few_rows(record) if count > MOST_ROWS else np.arange(count)
    if others is None or not len(others.offset):
        return rows, np.zeros((0, len(rows)))
    few = without_rows(record, rows) if count > MOST_ROWS else record
    middle = run(here, few)
    apart = [run(_moved(chain, here, others, k), few) - middle for k in range(len(others.offset))]
    return rows, np.stack(apart)


def spread_of(
    chain: Chain,
    here: Numbers,
    others: Others | None,
    record: Record,
    run: Callable[[Numbers, Record], np.ndarray],
) -> np.ndarray:
    """Deviation of the output among other models, with the arguments of `differences`.

    Returns:
        (time, 2) in output units: of those of the record's blocks, and of the prior; none without
        other models.
    """
    if others is None:
        return np.zeros((len(record.time), 2))
    kept, apart = differences(chain, here, others, record, run)
    parts = (apart[: others.of_blocks], apart[others.of_blocks :])
    spread = np.sqrt(np.stack([np.sum(part**2, axis=0) for part in parts], axis=1))
    if len(kept) == len(record.time):
        return spread
    rows = np.arange(len(record.time))
    columns: list[np.ndarray] = [np.interp(rows, kept, column) for column in spread.T]
    return np.stack(columns, axis=1)


def few_rows(record: Record) -> np.ndarray:
    """Samples of a long record to keep: its ends, where the input turns, and evenly in between."""
    count = len(record.time)
    turns = reversals(record.input, SMALL_TURN * float(np.ptp(record.input)), record.starts)
    kept = np.zeros(count, dtype=bool)
    kept[[0, count - 1, *record.starts]] = True
    kept[turns] = True
    left = np.flatnonzero(~kept)
    more = max(MOST_ROWS - int(kept.sum()), 0)
    kept[left[np.arange(more) * len(left) // max(more, 1)]] = True
    return np.flatnonzero(kept)


def _moved(chain: Chain, here: Numbers, others: Others, k: int) -> Numbers:
    values = {effect: dict(own) for effect, own in here[0].items()}
    names = [(e.name, p.name) for e in chain.effects for p in e.parameters()]
    for (effect, name), change in zip(names, others.parameters[k].tolist(), strict=True):
        values[effect][name] += change
    moved = replace(
        here[1],
        weights=here[1].weights + others.weights[k],
        offset=here[1].offset + float(others.offset[k]),
        added=here[1].added + others.added[k],
    )
    return values, moved

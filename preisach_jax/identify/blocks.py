"""Blocks of a record that identify or are held out, and records that are thinned."""

from __future__ import annotations

import numpy as np
import scipy

from preisach_jax.record import Record

BLOCKS = 96
"""Contiguous blocks of measured rows into which a record is cut."""

FOLDS = 4
"""One block of four is held out; the other three folds identify, and choose the prior.
Where whole runs are held out, their rows are the fourth fold."""

STEPS = (3, 3, 3, 5, 5, 5)
"""Blocks from one that is held out to the next.  Were they always four, a drive whose period is so
long, or a half or a quarter of that, would show the rows held out the same part of its course."""

LEAST_STRETCHES = 64
"""Stretches into which the input of a run is cut at least where a record is thinned."""

IDENTIFICATION = np.arange(FOLDS - 1)

VALIDATION = np.array([FOLDS - 1])

ALL = np.arange(FOLDS)


def rows_kept(record: Record, limit: int) -> np.ndarray:
    """Samples of a record to keep, about `limit`; each run gets its share of them."""
    kept: list[np.ndarray] = []
    for rows in record.stretches:
        count = rows.stop - rows.start
        own = max(round(limit * count / len(record)), LEAST_STRETCHES)
        kept.append(rows.start + thinned_rows(record.input[rows], min(own, count)))
    return np.concatenate(kept)


def blocks_of(record: Record, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(row,) block and fold of each of the measured rows of a record."""
    block, fold = np.zeros(len(rows), dtype=int), np.zeros(len(rows), dtype=int)
    by_blocks = not any(run.held_out for run in record.runs)
    first = 0
    for position, stretch in enumerate(record.stretches):
        inside = (rows >= stretch.start) & (rows < stretch.stop)
        own, count = rows[inside] - stretch.start, stretch.stop - stretch.start
        # A short record has fewer blocks, but all folds of them.
        most = FOLDS * max(1, round(BLOCKS / FOLDS * inside.sum() / len(rows)))
        blocks = min(most, FOLDS * (len(own) // (2 * FOLDS)))
        # Lost samples must not move what is held out, nor leave a block without rows.
        cut = own * blocks // count
        if blocks and np.bincount(cut, minlength=blocks).min() < 0.75 * len(own) / blocks:
            cut = np.arange(len(own)) * blocks // len(own)
        block[inside] = first + cut
        if by_blocks:
            fold[inside] = _folds(max(blocks, 1), held_out=True)[cut]
        elif record.runs[position].held_out:
            fold[inside] = FOLDS - 1
        else:
            fold[inside] = _folds(max(blocks, 1), held_out=False)[cut]
        first += max(blocks, 1)
    return block, fold


def _folds(blocks: int, held_out: bool) -> np.ndarray:
    """(block,) a fold of each block; the last one, if some are held out, every `STEPS` blocks."""
    fold = np.full(blocks, -1)
    if held_out:
        at = np.cumsum(np.resize(STEPS, blocks)) - 1
        fold[at[at < blocks]] = FOLDS - 1
        if blocks > 1 and fold[-1] == FOLDS - 1:
            # The ends of a run identify: what is not measured beyond them is unknown.
            fold[-2:] = fold[-2:][::-1]
    others = np.flatnonzero(fold < 0)
    count = np.arange(len(others))
    fold[others] = (count + count // 7) % (FOLDS - 1)  # 7: nor are these in step with a period
    return fold


def thinned_rows(values: np.ndarray, limit: int) -> np.ndarray:
    """Samples of an input to keep: its extremes, more where it bends, fewer where it does not.

    The input is cut into stretches, of which half are shared out evenly and half by the square
    root of the second difference around a sample: that spreads the error of straight lines between
    the samples evenly.  Of each stretch the first sample is kept, and where the input turns inside
    it, those of its least and its greatest value, so that no reversal is lost but inside a stretch.

    Arguments:
        values: (time,) the input.
    """
    count = len(values)
    bend = np.zeros(count)
    bend[1:-1] = np.sqrt(np.abs(np.diff(values, n=2)))
    share = scipy.ndimage.uniform_filter1d(bend, 15)
    for _ in range(5):  # a sample needs no more than a stretch of its own
        share = np.minimum(share / max(share.sum(), np.finfo(float).tiny), 2.0 / limit)
    share = 0.5 / count + 0.5 * share / max(share.sum(), np.finfo(float).tiny)
    stretch = np.floor(np.cumsum(share) / share.sum() * limit * (1 - 1e-12)).astype(int)
    starts = np.flatnonzero(np.diff(stretch, prepend=-1))
    keep = np.zeros(count, dtype=bool)
    keep[[0, -1]] = True
    keep[starts] = True
    turns = np.zeros(count, dtype=bool)
    moved = np.flatnonzero(np.diff(values))  # a converter repeats the value at a turning point
    turns[moved[:-1][np.diff(np.sign(np.diff(values)[moved])) != 0] + 1] = True
    sizes = np.diff(starts, append=count)
    for extreme in (np.minimum, np.maximum):
        keep |= turns & (values == np.repeat(extreme.reduceat(values, starts), sizes))
    others = np.flatnonzero(~keep)
    filling = min(-int(keep.sum()) % max(limit // 16, 1), len(others))
    keep[others[np.arange(filling) * len(others) // max(filling, 1)]] = True
    return np.flatnonzero(keep)

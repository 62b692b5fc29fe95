"""Fig. 6: the squared output error over the record, and its asymptotes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from preisach_jax.paper.experiment import IDENTIFICATION_HZ, LEVELS, Identification, identification
from preisach_jax.paper.hinge import Hinge, fit_hinge, knee_interval
from preisach_jax.paper.numbers import FigureData, Progress, report
from preisach_jax.plant import RANGE_V
from preisach_jax.sweep import RESIDUAL_FROM
from preisach_jax.theory import largest_slope, quantisation_step


@dataclass(frozen=True, eq=False)
class Convergence(FigureData):
    """Fig. 6: squared output error over the record, and its asymptotes.

    Attributes:
        sample: (events,) k of the switching samples of the first record.
        error_squared_um2: (events,) e²(k) there.
        block_sample: (blocks,) k at the middle of each block of `block` samples.
        block_power_um2: (blocks,) mean of e² over the switching samples of a block in all records.
        block: samples of a block.
        hinge: the asymptotes of log10 of the blocks' power over k.
        knee_low: lower end of the 95 % interval of the knee over records.
        knee_high: its upper end.
        increment_squared_um2: (I δx)², the square of a level's increment, (28).
        mean_squared_um2: mean of e² over the switching samples of the residual interval.
        first: m of (30), the first sample of the residual interval.
        samples: samples of a record.
        records: number of records.
        levels: N.
    """

    sample: np.ndarray
    error_squared_um2: np.ndarray
    block_sample: np.ndarray
    block_power_um2: np.ndarray
    block: int
    hinge: Hinge
    knee_low: float
    knee_high: float
    increment_squared_um2: float
    mean_squared_um2: float
    first: int
    samples: int
    records: int
    levels: int

    @property
    def caption(self) -> str:
        hinge = self.hinge
        return (
            f"Squared output error of the recursive identification, N = {self.levels}; k counts "
            f"samples at {IDENTIFICATION_HZ / 1e3:g} kHz, and the {self.sample.size} dots are "
            "those of one record at which hysterons switch. Thin: mean of e² over blocks of "
            f"{self.block} samples and {self.records} records. Asymptotes: least squares fit to "
            "its logarithm of a line and a level that meet; the knee is at k = "
            f"{hinge.knee:.0f} (95 % interval over records {self.knee_low:.0f} to "
            f"{self.knee_high:.0f}), the level {10**hinge.level:.2g} µm². Over k ≥ {self.first} "
            f"the mean of e² is {self.mean_squared_um2:.2g} µm². The errors start near the square "
            f"of a level's increment, (I δx)² = {self.increment_squared_um2:.1f} µm² (dotted)."
        )


def convergence(
    levels: int = LEVELS,
    seed: int = 0,
    samples: int = 50_000,
    records: int = 8,
    progress: Progress | None = None,
) -> Convergence:
    """Squared output error of the recursive identification, Fig. 6."""
    runs: list[Identification] = []
    for number in range(records):
        report(progress, "recursive identification", number / records)
        runs.append(identification(seed + number, samples, levels))
    block, first = samples // 100, round(RESIDUAL_FROM * samples)
    middle = (np.arange(100) + 0.5) * block
    power = np.array([_block_power(run, block) for run in runs])
    # A block in which some record has no event is left out.
    whole = np.isfinite(power).all(axis=0)
    middle, power = middle[whole], power[:, whole]
    low, high = knee_interval(middle, power)
    one = runs[0]
    events = np.flatnonzero(one.is_event)
    late = [run.error_um[first:][run.is_event[first:]] ** 2 for run in runs]
    step = quantisation_step(largest_slope(one.input_v, one.stroke_um), RANGE_V / levels)
    return Convergence(
        sample=events,
        error_squared_um2=one.error_um[events] ** 2,
        block_sample=middle,
        block_power_um2=power.mean(axis=0),
        block=block,
        hinge=fit_hinge(middle, np.log10(power.mean(axis=0))),
        knee_low=low,
        knee_high=high,
        increment_squared_um2=float(step) ** 2,
        mean_squared_um2=float(np.mean(np.concatenate(late))),
        first=first,
        samples=samples,
        records=records,
        levels=levels,
    )


def _block_power(run: Identification, block: int) -> np.ndarray:
    """(100,) mean of e² at events in each block of samples; NaN without events."""
    events = np.flatnonzero(run.is_event)
    events = events[events < 100 * block]
    total = np.bincount(events // block, run.error_um[events] ** 2, 100)
    count = np.bincount(events // block, minlength=100)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)

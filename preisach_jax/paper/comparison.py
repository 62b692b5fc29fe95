"""Fig. 10 and 11: relays against ramps, and the recursions against each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import cast

import jax
import numpy as np

from preisach_jax.errors import InputError
from preisach_jax.filter.comparison import RecursionScore, compare_recursions
from preisach_jax.identify.regression import (
    choose_strength,
    normal_equations,
    penalties,
    solve_nonnegative,
)
from preisach_jax.operator.inputs import HYSTERONS
from preisach_jax.operator.plane import Plane
from preisach_jax.operator.states import hysteron_states
from preisach_jax.paper.numbers import FigureData, report
from preisach_jax.paper.sweep import PowerLaw, fit_power_law
from preisach_jax.piezo import experiment
from preisach_jax.plant import RANGE_V, make_stage
from preisach_jax.signals import bernoulli_ramp
from preisach_jax.theory import Progress

RATE_HZ = 2000.0
NOISE_UM = 0.006
FITTED_LEVELS = (9, 13, 19, 37, 75)
BLOCKS = 16
"""Blocks of the fitted rows, every other one a fold, between which the prior is chosen."""

CHUNK = 5000
"""Samples whose states are in memory at once."""

START_STRENGTH = 1e-4
ABOVE_NOISE = 1.2
"""Levels count for an exponent where the residual is more than so many times the noise."""


@dataclass(frozen=True, eq=False)
class HysteronComparison(FigureData):
    """Fig. 10: batch least squares with relays and with ramps.

    RMS residuals, and errors against the output without noise, are those on the part of the record
    that was not fitted.
    """

    levels: np.ndarray  # (level,) N, ascending
    relay_um: np.ndarray  # (level,) residual
    ramp_um: np.ndarray
    relay_error_um: np.ndarray  # (level,) error
    ramp_error_um: np.ndarray
    relay: PowerLaw  # exponent of the error in N
    ramp: PowerLaw | None  # the same, over the first `ramp_levels`; None where they are too few
    ramp_levels: int  # how many levels have a residual clear of the noise
    noise_um: float  # standard deviation of the sensor's noise
    stroke_um: float  # range of the output
    seconds: float  # length of the fitted part, and of the other

    @property
    def caption(self) -> str:
        if self.ramp is None:
            ramp = "it meets the noise too early for an exponent to be fitted"
        else:
            ramp = (
                f"as N^{self.ramp.value:.2f} (95 %: {self.ramp.low:.2f} to {self.ramp.high:.2f}) "
                + (
                    f"up to N = {self.levels[self.ramp_levels - 1]}, beyond which the residual is "
                    "all but noise"
                    if self.ramp_levels < self.levels.size
                    else "all the way"
                )
            )
        return (
            f"Residual of batch least squares with a smoothness prior on "
            f"{self.seconds:g} s that were not fitted, after {self.seconds:g} s that were, of a "
            f"stage on no grid with {self.stroke_um:.0f} µm stroke and {1e3 * self.noise_um:g} nm "
            "sensor noise (open), and error against its output without noise (filled). With relays "
            f"the error falls as N^{self.relay.value:.2f} (95 %: "
            f"{self.relay.low:.2f} to {self.relay.high:.2f}); with ramps {ramp}."
        )


def relays_and_ramps(
    levels: Sequence[int] = FITTED_LEVELS,
    samples: int = 100_000,
    every: int = 8,
    seed: int = 3,
    progress: Progress | None = None,
) -> HysteronComparison:
    """Fit a smooth stage with relays and with ramps on planes of several sizes, Fig. 10."""
    N = np.array(levels)
    if N.size < 3 or np.any(np.diff(N) <= 0):
        raise InputError(f"levels are {tuple(levels)}: give at least three, ascending")
    input_key, noise_key = jax.random.split(jax.random.key(seed))
    with jax.enable_x64(True):
        x = np.asarray(bernoulli_ramp(input_key, samples, RATE_HZ, low=0.0, high=RANGE_V))
        noise = NOISE_UM * np.asarray(jax.random.normal(noise_key, x.shape))
        clean = make_stage(seed).hysteresis(x)
        work = np.cumsum(np.repeat(N.astype(float) ** 4, 2))
        found = np.empty((2, N.size, 2))
        strengths = dict.fromkeys(HYSTERONS, START_STRENGTH)
        for n, one in enumerate(N):
            plane = Plane(int(one), 0.0, RANGE_V)
            for h, hysteron in enumerate(HYSTERONS):
                before = work[2 * n + h - 1] if n + h else 0.0
                report(progress, f"{hysteron}s, N = {one}", before / work[-1])
                *found[h, n], strengths[hysteron] = _held_out(
                    plane, hysteron, x, clean, noise, every, strengths[hysteron]
                )
    (relay, relay_error), (ramp, ramp_error) = found.transpose(0, 2, 1)
    clear = ramp > ABOVE_NOISE * NOISE_UM
    kept = int(np.argmin(clear)) if not clear.all() else N.size
    return HysteronComparison(
        levels=N,
        relay_um=relay,
        ramp_um=ramp,
        relay_error_um=relay_error,
        ramp_error_um=ramp_error,
        relay=fit_power_law(N, relay_error),
        ramp=fit_power_law(N[:kept], ramp_error[:kept]) if kept > 2 else None,
        ramp_levels=kept,
        noise_um=NOISE_UM,
        stroke_um=float(np.ptp(clean)),
        seconds=samples / 2 / RATE_HZ,
    )


_states = jax.jit(hysteron_states, static_argnames="hysteron")


def _regressors(plane: Plane, hysteron: str, x: np.ndarray, every: int) -> np.ndarray:
    """(row, cells + 1) states at one of `every` samples, and a column of ones."""
    start = np.asarray(plane.initial_states("low", x[0], hysteron))
    rows: list[np.ndarray] = []
    for begin in range(0, x.size, CHUNK):
        part = x[begin : begin + CHUNK]
        states = np.asarray(cast(jax.Array, _states(plane, part, start, hysteron=hysteron)))
        start = states[-1]
        rows.append(states[-begin % every :: every])
    states = np.concatenate(rows)
    return np.concatenate([states, np.ones((len(states), 1))], axis=1)


def _held_out(
    plane: Plane,
    hysteron: str,
    x: np.ndarray,
    clean: np.ndarray,
    noise: np.ndarray,
    every: int,
    strength: float,
) -> tuple[float, float, float]:
    """RMS residual and error over the second half, and the strength that the first one chose."""
    matrix, target = _regressors(plane, hysteron, x, every), (clean + noise)[::every]
    half = len(target) // 2
    block = np.arange(half) * BLOCKS // half
    order = np.argsort(block % 2, kind="stable")  # a fold is one slice of rows
    free = np.zeros(plane.cells + 1, bool)  # bounds would cost much time, and change little
    equations = normal_equations(
        matrix[order], target[order], block[order] % 2, free, penalties(plane.levels, ())
    )
    folds = np.arange(2)
    strength = choose_strength(equations, folds, strength)
    solution = solve_nonnegative(*equations.system(folds, strength), free)
    left = target[half:] - matrix[half:] @ solution
    error = left - noise[::every][half:]
    return float(np.sqrt(np.mean(left**2))), float(np.sqrt(np.mean(error**2))), strength


@dataclass(frozen=True, eq=False)
class RecursionComparison(FigureData):
    """Fig. 11: what the recursions learn from one record, in parts of the output's range.

    Errors are the RMS of e at events over the last half; replays that of output less model with the
    final weights over a new record.
    """

    names: tuple[str, ...]  # the recursions and their settings
    relay_error: np.ndarray  # (recursion,)
    relay_replay: np.ndarray
    ramp_error: np.ndarray
    ramp_replay: np.ndarray
    levels: int
    samples: int  # of each record

    @property
    def caption(self) -> str:
        best = int(np.argmin(self.ramp_replay))
        return (
            f"Recursions over one record of {self.samples} samples, N = {self.levels}: error e at "
            "events in the last half (open), and output less model when the final weights replay a "
            "record that was not used (filled); the error during the run flatters rules that only "
            "explain the last few events. With relays all are held up by the quantisation of the "
            f"input, {100 * self.relay_replay.min():.2g} % at best; with ramps the best replay is "
            f"that of {self.names[best]}, {100 * self.ramp_replay[best]:.2g} % of the range, "
            f"against {100 * self.ramp_replay[0]:.2g} % for the paper's rule in one pass."
        )


def recursions(
    levels: int = 19,
    samples: int = 25_000,
    seed: int = 0,
    passes: Sequence[int] = (1, 2, 5, 20),
    progress: Progress | None = None,
) -> RecursionComparison:
    """Compare the paper's rule, its passes and step sizes, and least squares, Fig. 11."""
    plane = Plane(levels, 0.0, RANGE_V)
    with jax.enable_x64(True):
        report(progress, "records", 0.0)
        keys = jax.random.split(jax.random.key(seed))
        draw = partial(experiment, samples=samples, rate_hz=RATE_HZ)
        (x, z), (new_x, new_z) = (
            (np.asarray(record.input_v), np.asarray(record.stroke_um)) for record in map(draw, keys)
        )
        rows: dict[str, tuple[RecursionScore, ...]] = {}
        for part, hysteron in enumerate(HYSTERONS):
            report(progress, f"recursions with {hysteron}s", 0.1 + 0.45 * part)
            rows[hysteron] = compare_recursions(
                plane, x, z, new_x, new_z, hysteron, passes=tuple(passes)
            )
    return RecursionComparison(
        names=tuple(row.name for row in rows["relay"]),
        relay_error=np.array([row.error for row in rows["relay"]]),
        relay_replay=np.array([row.replay for row in rows["relay"]]),
        ramp_error=np.array([row.error for row in rows["ramp"]]),
        ramp_replay=np.array([row.replay for row in rows["ramp"]]),
        levels=levels,
        samples=samples,
    )

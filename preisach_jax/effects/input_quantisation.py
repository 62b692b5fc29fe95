"""Steps of the converter that makes the drive from the recorded command."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from preisach_jax.effects.base import InputEffect, Survey
from preisach_jax.effects.parameter import parameter
from preisach_jax.effects.spectrum import strongest_lines

MOST_STEPS = 5000
"""Steps over the range of the input beyond which they are not looked for."""

NEARLY_WHOLE, MOST_WHOLE = 0.1, 0.5
"""Distance of a move, from sample to sample, from whole steps within which its rounding stays the
same, and the share of such moves from which on steps cannot be told from a constant shift."""

PROBED = 1.618e-3
"""Step over the range of the input from which its limit is searched: no whole part of a lattice
that commands are recorded on, which would be rounded to itself."""

STRETCH = 8
"""Rows over which a move is averaged."""


class InputQuantisation(InputEffect):
    r"""Steps of the drive that the recorded command does not show: \(u' = q\,[u/q]\).

    Rounding has no useful derivative: it is kept along each step, and the search hardly moves a
    start.  So the starts are found to a small part of a step over the whole range, from the
    residual, which goes up and down once a step.

    Arguments:
        starts: values of q from which the search starts, in input units; the bounds lie half a
            per cent outside.
        range_u: range of the input.

    Example:
        >>> import jax.numpy as jnp
        >>> u = jnp.array([0.0, 0.2, 0.3, 0.7])
        >>> InputQuantisation(quantum=0.5).apply(u, jnp.arange(4.0)).tolist()
        [0.0, 0.0, 0.5, 0.5]
    """

    name = "input_quantisation"
    rank = 6
    needs_clock = False
    in_words = "coarse steps of the drive's converter"
    limited_by_residual = True
    rounds = True
    physics = (
        "The command is recorded as it was computed, but the digital-to-analogue converter before "
        "the amplifier has a finite number of steps: the material is driven by the nearest of "
        "them."
    )
    source = (
        "B. Widrow, I. Kollár, Quantization Noise, Cambridge University Press 2008, ch. 1 and 19"
    )
    signature = "sawtooth residual with the period of one step of the input"
    confused_with = ("output_quantisation",)
    experiment = (
        "one slow ramp over some tens of steps: those of the input come at equal distances of the "
        "input, those of the output at equal distances of the output"
    )
    starts: tuple[float, ...] = (1e-6,)
    range_u: float = 1.0
    quantum: float = parameter(
        "{u}",
        lambda own: 0.995 * min(own.starts),
        lambda own: 1.005 * max(own.starts),
        start=lambda own: own.starts,
        meaning="step of the converter",
        name="step",
    )

    def bound_to(self, survey: Survey) -> InputQuantisation:
        values = survey.input
        if len(values) < 2 or not np.ptp(values) > 0:
            return self
        reach = float(np.ptp(values))
        apart = reach * float(np.diff(np.unique(np.round(values / reach, 9))).min())
        # Of values on a lattice, steps of less than two spacings look like coarser ones.
        low, high = 4 / reach, min(MOST_STEPS / reach, 0.5 / apart)
        steps: list[float] = []
        if high > 2 * low and np.ptp(survey.residual) > 0:
            # Where the input dwells, one error of rounding would count many times.
            runs = np.abs(np.diff(values)) > 0.2 * reach / len(values)
            ends = np.append(runs, False) | np.append(False, runs)
            found = _steps_of(values[ends], survey.residual[ends], low, high)
            moves = _moves_a_sample(survey)
            steps = [step for step in found if _is_seen(step, moves)]
        # Where there are none, one too fine to do anything.
        return InputQuantisation(starts=tuple(steps) or (1e-6 * reach,), range_u=reach)

    def probe(self, times: float = 1.0) -> InputQuantisation:
        return InputQuantisation((times * PROBED * self.range_u,), self.range_u)

    def sampled(self, step_s: float, amounts: tuple[float, ...]) -> dict[str, Any]:
        return {"step": self.quantum}

    def init(self, first: Array) -> tuple[()]:
        return ()

    def step(self, state: tuple[()], value: Array, dt: Array) -> tuple[tuple[()], Array]:
        return state, self.quantum * jnp.round(value / self.quantum)


def _moves_a_sample(survey: Survey) -> np.ndarray:
    """(stretch,) how far the input moves from sample to sample, along stretches of one direction.

    An average over some rows knows it better than the lattice on which they were recorded.
    """
    ahead = np.diff(survey.input)
    if len(ahead) < STRETCH:
        return np.abs(ahead)
    windows = np.lib.stride_tricks.sliding_window_view(ahead, STRETCH)
    straight = np.abs(np.sign(windows).sum(axis=1)) == STRETCH
    moved = survey.input[STRETCH:] - survey.input[:-STRETCH]
    seconds = survey.time[STRETCH:] - survey.time[:-STRETCH]
    return np.abs(moved / seconds)[straight] * survey.step_s


def _is_seen(step: float, moves: np.ndarray) -> bool:
    """Whether the rounding to steps changes along most moves, `(move,)`, of an input.

    At one rate a move may be as long as one step, or as some: the samples then see one point of
    each, and its sawtooth is a constant that differs from branch to branch.
    """
    turns = moves / step
    whole = (turns > 0.5) & (np.abs(turns - np.round(turns)) < NEARLY_WHOLE)
    return not moves.size or float(np.mean(whole)) < MOST_WHOLE


def _steps_of(values: np.ndarray, residual: np.ndarray, low: float, high: float) -> list[float]:
    """The two steps whose sawtooth explains most of a residual, the better first.

    They are looked for at the lines of the residual over the input and, as these may be harmonics,
    at the first parts of their frequencies.  Lines are bent by a tenth of a period over the range
    where the height of the sawtooth changes; a sawtooth whose height is a parabola is not.
    """
    lines = [
        line
        for white in (False, True)
        for line in strongest_lines(values, residual, low, high, 1 / (16 * high), 4, white)
    ]
    reach = float(np.ptp(values))
    heights = np.vander((values - values.mean()) / reach, 3)

    def unexplained(step: float) -> float:
        sawtooth = (step * np.round(values / step) - values)[:, None] * heights
        moment = sawtooth.T @ residual
        return -float(moment @ np.linalg.lstsq(sawtooth.T @ sawtooth, moment, rcond=None)[0])

    def best_near(step: float, shifts: np.ndarray) -> tuple[float, float]:
        # Rounding makes the goal rugged, so a grid of shifts is tried, in periods over the range.
        return min((unexplained(at), at) for at in (step * (1 + shifts * step / reach)).tolist())

    coarse, fine = np.linspace(-0.3, 0.3, 31), np.linspace(-0.02, 0.02, 17)
    parts = [k / line for line in lines for k in range(1, 5) if line / k >= low]
    rough = sorted(best_near(step, coarse) for step in parts)
    other = [near for near in rough if abs(near[1] / rough[0][1] - 1) > 0.01]
    return [step for _, step in sorted(best_near(at, fine) for _, at in rough[:1] + other[:1])]

"""Models without hysteresis, below the Preisach model on the ladder: is there any to be seen?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from preisach_jax.diagnosis.evidence import simple_ratio
from preisach_jax.fit import Fit
from preisach_jax.operator.plane import Plane, position_on

LEAST_GAIN = 0.05
"""Relative fall of the held-out mean square that hysteresis must bring."""

LITTLE = 2e-3
"""RMS over the stroke below which hysteresis, or what cells cannot follow, is little."""

MOST_BY_CHANCE = 0.5
"""Mean square of the Preisach model, over that without hysteresis, that its weights may leave of
noise on the rows that identify it."""

MOST_UNLIKE = 1.5
"""RMS error on the rows that identify, over that on the rows held out, beyond which these are not
like those: with a drive of one period, all of them may lie where the loop is closed."""


@dataclass(frozen=True)
class Memoryless:
    """A model without hysteresis, with its errors in output units on the rows of the ladder.

    Attributes:
        name: "straight line" or "single-valued curve".
        rms_identification, rms_validation, max_abs_validation, fit_percent: as of other models.
        does_as_well: whether the mean square of the Preisach model is hardly less on the held-out
            rows, and no less than by its many weights on the others.
        does_nearly: whether it leaves little of the stroke, or less than what does not matter.
        offset, slope: of the line, at no input and by the input, in the units of the record.
    """

    name: str
    rms_identification: float
    rms_validation: float
    max_abs_validation: float
    fit_percent: float
    does_as_well: bool
    does_nearly: bool
    offset: float | None
    slope: float | None


def memoryless(fit: Fit, tolerance: float = 0.0) -> tuple[Memoryless, Memoryless]:
    r"""A straight line and a single-valued curve, on the same rows as a fit.

    \(z = c_r + a u\) and \(z = c_r + \sum_i a_i \rho_i(u)\) by least squares, with the ramps
    \(\rho_i\) of one axis of the plane and a constant of each run r: what the Preisach model can do
    on its diagonal.

    Arguments:
        tolerance: RMS error, in output units, that does not matter.
    """
    record, plane = fit.record, fit.model.plane
    if fit.model.chain.mechanics is not None:  # its plane is not that of the input
        plane = Plane(plane.levels, float(record.input.min()), float(record.input.max()))
    position = position_on(plane, record.input)[:, np.newaxis]
    ramps = np.clip(position - np.arange(plane.levels), 0.0, 1.0)
    constants = np.zeros((len(record), len(record.stretches)))
    for run, rows in enumerate(record.stretches):
        constants[rows, run] = 1.0
    constants = constants[:, constants[fit.identification].any(axis=0)]
    constants[~constants.any(axis=1)] = 1 / constants.shape[1]  # of the mean of the other runs
    least = max(tolerance, LITTLE * record.output_range)
    found: list[Memoryless] = []
    eps = float(np.finfo(float).eps) * float(np.nanmax(np.abs(record.output)))
    line = record.input[:, np.newaxis]
    for name, columns in (("straight line", line), ("single-valued curve", ramps)):
        matrix = np.concatenate([constants, columns], axis=1)
        rows = fit.identification
        solution = np.linalg.lstsq(matrix[rows], record.output[rows], rcond=None)[0]
        residual = record.output - matrix @ solution
        held_out, output = residual[fit.validation], record.output[fit.validation]
        spread = np.linalg.norm(output - output.mean())
        rms, rms_identification = (
            float(np.sqrt(np.mean(each**2))) for each in (held_out, residual[rows])
        )
        falls = simple_ratio(fit.rms_validation**2, rms**2)
        inside = simple_ratio(fit.rms_identification**2, rms_identification**2)
        found.append(
            Memoryless(
                name,
                rms_identification,
                rms,
                float(np.max(np.abs(held_out))),
                float(100 * (1 - np.linalg.norm(held_out) / spread)),
                falls > 1 - LEAST_GAIN
                and inside > MOST_BY_CHANCE
                and rms_identification <= MOST_UNLIKE * max(rms, eps),
                max(rms, rms_identification) <= least,
                float(solution[:-1].mean()) if name == "straight line" else None,
                float(solution[-1]) if name == "straight line" else None,
            )
        )
    return found[0], found[1]


def sufficient(models: tuple[Memoryless, ...], is_all_noise: bool) -> Memoryless | None:
    """The simplest model without hysteresis that does as well, if what is left is little or noise.

    Arguments:
        is_all_noise: whether what the Preisach model leaves is noise; where its cells are the
            limit, or something is missing, that a curve does as well says nothing.
    """
    fit = (m for m in models if m.does_as_well and (m.does_nearly or is_all_noise))
    return next(fit, None)

"""Models without hysteresis, below the Preisach model on the ladder: is there any to be seen?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from preisach_jax.diagnosis.evidence import LEAST_GAIN, compare_residuals
from preisach_jax.fit import Fit
from preisach_jax.operator.hysteron import position_on
from preisach_jax.operator.plane import Plane

LITTLE = 2e-3
"""Held-out error of a model without hysteresis, over the stroke, below which there is little."""


@dataclass(frozen=True)
class Memoryless:
    """A model without hysteresis, with its errors in output units on the rows of the ladder.

    Attributes:
        name: "straight line" or "single-valued curve".
        rms_identification, rms_validation, max_abs_validation, fit_percent: as of other models.
        does_as_well: whether the Preisach model is no better on the held-out rows by more than
            chance.
        does_nearly: whether it leaves little of the stroke, or less than what does not matter.
    """

    name: str
    rms_identification: float
    rms_validation: float
    max_abs_validation: float
    fit_percent: float
    does_as_well: bool
    does_nearly: bool


def memoryless(fit: Fit, tolerance: float = 0.0) -> tuple[Memoryless, Memoryless]:
    r"""A straight line and a single-valued curve, on the same rows as a fit.

    \(z = c_r + a u\) and \(z = c_r + \sum_i a_i \rho_i(u)\) by least squares, with the ramps
    \(\rho_i\) of one axis of the plane and a constant of each run r: what the Preisach model can do
    on its diagonal.

    Arguments:
        fit: the Preisach model without effects.
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
    for name, columns in (("straight line", position), ("single-valued curve", ramps)):
        matrix = np.concatenate([constants, columns], axis=1)
        rows = fit.identification
        solution = np.linalg.lstsq(matrix[rows], record.output[rows], rcond=None)[0]
        residual = record.output - matrix @ solution
        # The whitened criterion is not asked: a loop is easily predicted from row to row.
        evidence = compare_residuals(residual, fit)
        held_out, output = residual[fit.validation], record.output[fit.validation]
        spread = np.linalg.norm(output - output.mean())
        rms = float(np.sqrt(np.mean(held_out**2)))
        found.append(
            Memoryless(
                name,
                float(np.sqrt(np.mean(residual[rows] ** 2))),
                rms,
                float(np.max(np.abs(held_out))),
                float(100 * (1 - np.linalg.norm(held_out) / spread)),
                not (evidence.gain >= LEAST_GAIN and evidence.z >= evidence.least_z),
                rms <= least,
            )
        )
    return found[0], found[1]

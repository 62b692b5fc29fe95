"""Quantisation noise and the residual error of an experiment, eq. (27)-(31)."""

from __future__ import annotations

import math

import numpy as np
from jax.typing import ArrayLike

from preisach_jax.errors import InputError


def largest_slope(x: ArrayLike, z: ArrayLike, span: float | None = None) -> float:
    """Largest slope of the measured hysteresis, I = max ∂z/∂x, eq. (27).

    Slopes are taken between crossings of neighbouring lines on the axis of the input, `span` apart,
    so that neither noise nor a turning point is divided by a small step.

    Arguments:
        x: (time,) input.
        z: (time,) output.
        span: distance of the lines, in the unit of the input; None is 2 % of its range.

    Returns:
        I, in the unit of the output per unit of the input.

    Raises:
        InputError: the lengths differ, or the input crosses no two neighbouring lines.

    Example:
        >>> x = np.linspace(0.0, 1.0, 1001)
        >>> round(largest_slope(x, x**2), 2)
        1.98
    """
    x, z = np.asarray(x, float), np.asarray(z, float)
    if x.shape != z.shape or x.ndim != 1:
        raise InputError(f"x has the shape {x.shape} and z {z.shape}: give both (time,)")
    span = 0.02 * float(np.ptp(x)) if span is None else span
    line = np.floor((x - x.min()) / span) if span > 0 else np.zeros_like(x)
    at = np.flatnonzero(np.diff(line, prepend=line[:1]))
    dx, dz = np.diff(x[at]), np.diff(z[at])
    apart = np.abs(dx) > 0.5 * span
    if not apart.any():
        raise InputError(f"x crosses no two lines {span!r} apart: give a record with more movement")
    return float(np.max(dz[apart] / dx[apart]))


def quantisation_step(slope: float, delta_x: ArrayLike) -> np.ndarray:
    """Bound of the step that quantising the input makes in the output, Z_q = I δx, eq. (28).

    Arguments:
        slope: I, eq. (27).
        delta_x: δx, any shape.

    Returns:
        Z_q, in the unit of the output.

    Example:
        >>> round(float(quantisation_step(2.53, 75 / 37)), 2)
        5.13
    """
    return slope * np.asarray(delta_x, float)


def quantisation_noise_power(slope: float, delta_x: ArrayLike) -> np.ndarray:
    """Bound of the power of the quantisation noise, W ≈ I² δx²/12, eq. (29).

    Arguments:
        slope: I, eq. (27).
        delta_x: δx, any shape.

    Returns:
        W, in the squared unit of the output.

    Example:
        >>> round(float(quantisation_noise_power(2.53, 75 / 37)), 2)
        2.19
    """
    return quantisation_step(slope, delta_x) ** 2 / 12.0


def mean_output_error(error: ArrayLike) -> float:
    """Averaged residual output error, ⟨e⟩ = (1/(M-m) Σ_{k=m}^{M} e²(k))^½, eq. (30).

    Arguments:
        error: (count,) e(k) of the residual interval k = m ... M; what one k is, a sample or a
            switching event, is the caller's choice and is to be said. At least two.

    Returns:
        ⟨e⟩, in the unit of the output.

    Raises:
        InputError: fewer than two errors are given.

    Example:
        >>> mean_output_error([3.0, 4.0])
        5.0
    """
    error = np.asarray(error, float)
    if error.size < 2:
        raise InputError(f"there are {error.size} errors: give at least 2 for the average (30)")
    return math.sqrt(float(np.sum(error**2)) / (error.size - 1))


def auxiliary_norm(mean_error: ArrayLike, cells: ArrayLike) -> np.ndarray:
    """Auxiliary norm of the weight error, ((⟨e⟩/L)² L)^½ = ⟨e⟩/√L, eq. (31).

    Arguments:
        mean_error: ⟨e⟩, eq. (30), any shape.
        cells: L, a shape that broadcasts.

    Returns:
        The norm, in the unit of the output.

    Example:
        >>> float(auxiliary_norm(3.0, 9))
        1.0
    """
    return np.asarray(mean_error) / np.sqrt(np.asarray(cells, float))

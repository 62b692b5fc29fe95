"""The weight error in noise, step by step, eq. (13)-(15)."""

from __future__ import annotations

import math

import numpy as np
from jax.typing import ArrayLike

from preisach_jax.errors import InputError
from preisach_jax.operator.plane import Plane
from preisach_jax.operator.simulation import simulate


def measured_output(plane: Plane, weights: ArrayLike, x: ArrayLike, noise: ArrayLike) -> np.ndarray:
    """Output of a hysteresis on the grid as a sensor sees it, z(k) = Σ_{P⁺} R_i + n(k), eq. (13).

    Arguments:
        plane: the Preisach plane.
        weights: (cells,) weights R, in the unit of the output.
        x: (time,) input, in the unit of the plane; relays start from saturated low.
        noise: (time,) noise n, in the unit of the output.

    Returns:
        (time,) output.

    Raises:
        InputError: a shape or a type is wrong.

    Example:
        >>> plane = Plane(levels=2, low=0.0, high=2.0)
        >>> measured_output(plane, [1.0, 2.0, 4.0], [0.0, 2.0], [0.5, -0.5]).tolist()
        [0.5, 6.5]
    """
    clean, noise = np.asarray(simulate(plane, weights, x, "relay")), np.asarray(noise)
    if noise.shape != clean.shape:
        raise InputError(
            f"noise has the shape {noise.shape} and x {clean.shape}: give one a sample"
        )
    return clean + noise


def noise_power(noise: ArrayLike) -> float:
    """Average power of measurement noise, W = (1/K) Σ n²(k), eq. (14).

    Arguments:
        noise: (time,) noise n.

    Returns:
        W, in the squared unit of the noise.

    Example:
        >>> noise_power([1.0, -1.0, 2.0, 0.0])
        1.5
    """
    return float(np.mean(np.square(np.asarray(noise, float))))


def next_squared_error(
    squared_error: ArrayLike, switching_sum: ArrayLike, area: ArrayLike, nu: ArrayLike
) -> np.ndarray:
    """Squared norm of the weight error after one step, an identity, eq. (15).

    ‖E(k+1)‖² = ‖E(k)‖² - (Σ_S E)²/A + ν²/A, with E of S⁻ counted negative in the sum.

    Arguments:
        squared_error: ‖E(k)‖², any shape.
        switching_sum: signed sum of the weight errors over S(k).
        area: A(k) ≥ 1, eq. (11).
        nu: ν(k), noise at this event less noise at the one before.

    Returns:
        ‖E(k+1)‖², in the common shape.

    Example:
        >>> float(next_squared_error(4.0, 2.0, 2, 1.0))
        2.5
    """
    nu, switching_sum = np.asarray(nu, float), np.asarray(switching_sum, float)
    return np.asarray(squared_error) + (nu**2 - switching_sum**2) / np.asarray(area)


def checked_variance(noise_variance: float) -> float:
    """A noise power, or an error that says what it may be.

    Arguments:
        noise_variance: W.

    Returns:
        W.

    Raises:
        InputError: it is negative or not finite.

    Example:
        >>> checked_variance(0.5)
        0.5
    """
    if not 0.0 <= noise_variance < math.inf:
        raise InputError(f"noise_variance is {noise_variance!r}: give 0 or a number above it")
    return float(noise_variance)

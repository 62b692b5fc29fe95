"""How fast the weight error converges and what noise leaves of it, bounds (16)-(25).

T is the number of steps in which an input creates every triangle of the plane, W the power of the
measurement noise n, and ν(k) = n(k+1) - n(k). What a given input really does with noise is in
`preisach_jax.theory.propagation`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from jax.typing import ArrayLike

from preisach_jax.errors import InputError
from preisach_jax.operator.plane import Plane
from preisach_jax.theory.noise import checked_variance
from preisach_jax.theory.propagation import propagate_error


def contraction_bound(T: ArrayLike, N: ArrayLike) -> np.ndarray:
    """Least share of ‖E‖² that is lost in T steps without noise, C ≥ 1/(16 N (N T + 2)²), eq. (24).

    Arguments:
        T: steps in which every triangle is created, any shape.
        N: levels of the plane, a shape that broadcasts.

    Returns:
        Lower bound of C(T, N), in the common shape.

    Raises:
        InputError: T or N is below 1.

    Example:
        >>> float(contraction_bound(1, 2))
        0.001953125
    """
    T, N = _steps_and_levels(T, N)
    return 1.0 / (16.0 * N * (N * T + 2.0) ** 2)


def noise_gain_bound(T: ArrayLike, N: ArrayLike) -> np.ndarray:
    """Most that noise takes from the switching sum, D ≤ T² N², eq. (24).

    Arguments:
        T: steps in which every triangle is created, any shape.
        N: levels of the plane, a shape that broadcasts.

    Returns:
        Upper bound of D(T, N), in the common shape.

    Raises:
        InputError: T or N is below 1.

    Example:
        >>> float(noise_gain_bound(2, 3))
        36.0
    """
    T, N = _steps_and_levels(T, N)
    return (T * N) ** 2


def error_recursion(T: ArrayLike, N: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients of ‖E(k+T)‖² ≤ q ‖E(k)‖² + (B/T) Σ ν², eq. (17): q = 1 - C, B = D + T, eq. (18).

    Arguments:
        T: steps in which every triangle is created, any shape.
        N: levels of the plane, a shape that broadcasts.

    Returns:
        `(q, B)` with the bounds (24).

    Raises:
        InputError: T or N is below 1.

    Example:
        >>> [float(c) for c in error_recursion(1, 2)]
        [0.998046875, 5.0]
    """
    T, N = _steps_and_levels(T, N)
    return 1.0 - contraction_bound(T, N), noise_gain_bound(T, N) + T


def switching_sum_bound(
    squared_error: ArrayLike, nu: ArrayLike, T: ArrayLike, N: ArrayLike
) -> np.ndarray:
    """What the largest (Σ_S E)² of a period reaches at least, C ‖E‖² - (D/T) Σ ν², eq. (16).

    Arguments:
        squared_error: ‖E‖² at the beginning of the period.
        nu: (steps,) ν of the period.
        T: steps of the period, in which every triangle is created.
        N: levels of the plane.

    Returns:
        () lower bound; negative where noise hides the error.

    Raises:
        InputError: T or N is below 1.

    Example:
        >>> float(switching_sum_bound(512.0, [0.0], 1, 2))
        1.0
    """
    noise = noise_gain_bound(T, N) / np.asarray(T) * np.sum(np.square(np.asarray(nu, float)))
    return contraction_bound(T, N) * np.asarray(squared_error) - noise


def error_after_period(
    squared_error: ArrayLike, nu: ArrayLike, T: ArrayLike, N: ArrayLike
) -> np.ndarray:
    """Bound of ‖E‖² after a period, q ‖E‖² + (B/T) Σ ν², eq. (17).

    Arguments:
        squared_error: ‖E‖² at the beginning of the period.
        nu: (steps,) ν of the period.
        T: steps of the period, in which every triangle is created.
        N: levels of the plane.

    Returns:
        () upper bound.

    Raises:
        InputError: T or N is below 1.

    Example:
        >>> float(error_after_period(512.0, [1.0], 1, 2))
        516.0
    """
    q, B = error_recursion(T, N)
    power = np.sum(np.square(np.asarray(nu, float))) / np.asarray(T)
    return q * np.asarray(squared_error) + B * power


def expected_error(
    squared_error: float, noise_variance: float, T: ArrayLike, N: int, periods: int = 1
) -> float:
    """Bound of ⟨‖E‖²⟩ after so many periods; for one period eq. (19), else (20) or (22).

    ⟨‖E(k_l)‖²⟩ ≤ (1 - ⟨C⟩)^l ‖E(0)‖² + 2 (⟨B⟩/⟨C⟩) W; one period adds 2 ⟨B⟩ W.

    Arguments:
        squared_error: ‖E(0)‖².
        noise_variance: W.
        T: steps of a period (20), or (periods,) draws of it where they are random (22).
        N: levels of the plane.
        periods: l.

    Returns:
        Upper bound.

    Raises:
        InputError: T or N is below 1, or the variance is negative.

    Example:
        >>> expected_error(0.0, 1.0, 1, 2, periods=1)
        10.0
    """
    W = checked_variance(noise_variance)
    B, C = float(np.mean(error_recursion(T, N)[1])), float(np.mean(contraction_bound(T, N)))
    noise = 2.0 * B * W if periods == 1 else 2.0 * B / C * W
    return (1.0 - C) ** periods * squared_error + noise


def residual_error_bound(noise_variance: float, T: ArrayLike, N: int) -> float:
    """Bound of ⟨‖E‖²⟩ in the long run, 2 (⟨B⟩/⟨C⟩) W, eq. (21), and (23) where T is random.

    Arguments:
        noise_variance: W.
        T: steps of a period (21), or (periods,) draws of it (23).
        N: levels of the plane.

    Returns:
        Upper bound, proportional to W.

    Raises:
        InputError: T or N is below 1, or the variance is negative.

    Example:
        >>> residual_error_bound(2.0, 1, 2)
        10240.0
    """
    W = checked_variance(noise_variance)
    _, B = error_recursion(T, N)
    return 2.0 * float(np.mean(B) / np.mean(contraction_bound(T, N))) * W


def residual_ratio_bound(T: ArrayLike, N: ArrayLike) -> np.ndarray:
    """Bound of ⟨‖E_res‖²⟩/W, 32 N T (N T + 2)² (T N² + 1), eq. (25).

    Arguments:
        T: steps in which every triangle is created, any shape.
        N: levels of the plane, a shape that broadcasts.

    Returns:
        Upper bound, in the common shape.

    Raises:
        InputError: T or N is below 1.

    Example:
        >>> float(residual_ratio_bound(1, 2))
        5120.0
    """
    T, N = _steps_and_levels(T, N)
    return 32.0 * N * T * (N * T + 2.0) ** 2 * (T * N**2 + 1.0)


def every_triangle(plane: Plane) -> np.ndarray:
    """Input that creates all possible triangles, the condition of (16)-(25), and then returns.

    From below all thresholds it goes over α_i, then below β_j in one step, which switches off just
    the triangle Δ = {β_j ≤ β ≤ α ≤ α_i}, and then below all thresholds.

    Arguments:
        plane: the Preisach plane.

    Returns:
        (T + 1,) input with T = 3L - N steps, whose first and last value are `plane.low`.

    Example:
        >>> every_triangle(Plane(levels=2, low=0.0, high=2.0)).tolist()
        [0.0, 1.0, 0.0, 2.0, 0.0, 2.0, 1.0, 0.0]
    """
    edges = np.linspace(plane.low, plane.high, plane.levels + 1)
    path = [plane.low]
    for i, j in zip(plane.alpha_index, plane.beta_index, strict=True):
        path += [edges[i + 1], edges[j]] + ([plane.low] if j else [])
    return np.array(path)


class BoundCheck(NamedTuple):
    """Bound (25) beside what noise really does, on an input that creates every triangle.

    Attributes:
        levels: N.
        steps: T, the steps in which every triangle is created.
        ratio: ⟨‖E‖²⟩/W at the end of the last period, exact.
        bound: its bound, eq. (25).
        orders: orders of magnitude by which the bound is loose, log10(bound/ratio).
    """

    levels: int
    steps: int
    ratio: float
    bound: float
    orders: float


def check_bound(levels: int, periods: int = 10) -> BoundCheck:
    """Compare the bound (25) with the exact residual error where its condition holds.

    The input repeats `every_triangle`, and the error starts at the truth.

    Arguments:
        levels: N of the plane.
        periods: how often every triangle is created; the ratio grows towards its limit.

    Returns:
        The ratio, its bound, and the orders of magnitude between them.

    Raises:
        InputError: N is below 2.

    Example:
        >>> check = check_bound(levels=2, periods=3)
        >>> check.steps, check.ratio < check.bound
        (7, True)
    """
    if periods < 1:
        raise InputError(f"periods is {periods}: give at least 1")
    plane = Plane(levels=levels, low=0.0, high=float(levels))
    period = every_triangle(plane)
    steps = period.size - 1
    moments = propagate_error(plane, np.append(period[:1], np.tile(period[1:], periods)), 0.0)
    ratio, bound = float(moments.variance[-1]), float(residual_ratio_bound(steps, levels))
    return BoundCheck(levels, steps, ratio, bound, math.log10(bound / ratio))


def _steps_and_levels(T: ArrayLike, N: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    T, N = np.asarray(T, float), np.asarray(N, float)
    for name, value in (("T", T), ("N", N)):
        if not np.all(value >= 1):
            raise InputError(f"{name} is {value.min()}: it must be at least 1")
    return T, N

"""Convergence of the adaptive filter in noise, eq. (13)-(25) and (27)-(31), and beyond.

In (16)-(25) T is the number of steps in which an input creates every triangle of the plane, N the
levels, W the power of the measurement noise n, and ν(k) = n(k+1) - n(k). T and N may be arrays that
broadcast. What a given input really does with noise is found by `propagate_error`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jax.typing import ArrayLike

from preisach_jax.errors import InputError
from preisach_jax.operator.events import switching
from preisach_jax.operator.plane import Plane
from preisach_jax.operator.simulation import simulate

Progress = Callable[[str, float], None]
"""Called with what is being done and the part that is done."""


# --- noise and the weight error, step by step, eq. (13)-(15) ---


def measured_output(plane: Plane, weights: ArrayLike, x: ArrayLike, noise: ArrayLike) -> np.ndarray:
    """Output of relays on the grid as a sensor sees it, z(k) = Σ_{P⁺} R_i + n(k), eq. (13).

    Arguments:
        plane: the Preisach plane.
        weights: (cells,) weights R, in the unit of the output.
        x: (time,) input, in the unit of the plane; relays start from saturated low.
        noise: (time,) noise n, in the unit of the output.

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

    Example:
        >>> noise_power([1.0, -1.0, 2.0, 0.0])
        1.5
    """
    return float(np.mean(np.square(np.asarray(noise, float))))


def next_squared_error(
    squared_error: ArrayLike, switching_sum: ArrayLike, area: ArrayLike, nu: ArrayLike
) -> np.ndarray:
    """Squared norm after one step, ‖E(k+1)‖² = ‖E(k)‖² - (Σ_S E)²/A + ν²/A, an identity, eq. (15).

    Arguments:
        squared_error: ‖E(k)‖².
        switching_sum: sum of the weight errors over S(k), with those of S⁻ counted negative.
        area: A(k) ≥ 1, eq. (11).
        nu: ν(k), noise at this event less noise at the one before.

    Example:
        >>> float(next_squared_error(4.0, 2.0, 2, 1.0))
        2.5
    """
    nu, switching_sum = np.asarray(nu, float), np.asarray(switching_sum, float)
    return np.asarray(squared_error) + (nu**2 - switching_sum**2) / np.asarray(area)


# --- bounds, eq. (16)-(25) ---


def contraction_bound(T: ArrayLike, N: ArrayLike) -> np.ndarray:
    """Least share of ‖E‖² that is lost in T steps without noise, C ≥ 1/(16 N (N T + 2)²), eq. (24).

    Example:
        >>> float(contraction_bound(1, 2))
        0.001953125
    """
    T, N = _steps_and_levels(T, N)
    return 1.0 / (16.0 * N * (N * T + 2.0) ** 2)


def noise_gain_bound(T: ArrayLike, N: ArrayLike) -> np.ndarray:
    """Most that noise takes from the switching sum, D ≤ T² N², eq. (24).

    Example:
        >>> float(noise_gain_bound(2, 3))
        36.0
    """
    T, N = _steps_and_levels(T, N)
    return (T * N) ** 2


def error_recursion(T: ArrayLike, N: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """(q, B) of ‖E(k+T)‖² ≤ q ‖E(k)‖² + (B/T) Σ ν², eq. (17): q = 1 - C, B = D + T, eq. (18).

    Example:
        >>> [float(c) for c in error_recursion(1, 2)]
        [0.998046875, 5.0]
    """
    return 1.0 - contraction_bound(T, N), noise_gain_bound(T, N) + np.asarray(T, float)


def switching_sum_bound(
    squared_error: ArrayLike, nu: ArrayLike, T: ArrayLike, N: ArrayLike
) -> np.ndarray:
    """Least that the largest (Σ_S E)² of a period reaches, C ‖E‖² - (D/T) Σ ν², eq. (16).

    It is negative, and says nothing, where noise hides the error.

    Arguments:
        squared_error: ‖E‖² at the beginning of the period.
        nu: (steps,) ν of the period.

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

    Example:
        >>> expected_error(0.0, 1.0, 1, 2, periods=1)
        10.0
    """
    W = _checked_variance(noise_variance)
    B, C = float(np.mean(error_recursion(T, N)[1])), float(np.mean(contraction_bound(T, N)))
    noise = 2.0 * B * W if periods == 1 else 2.0 * B / C * W
    return (1.0 - C) ** periods * squared_error + noise


def residual_error_bound(noise_variance: float, T: ArrayLike, N: int) -> float:
    """Bound of ⟨‖E‖²⟩ in the long run, 2 (⟨B⟩/⟨C⟩) W, eq. (21), and (23) for random T.

    Example:
        >>> residual_error_bound(2.0, 1, 2)
        10240.0
    """
    W = _checked_variance(noise_variance)
    _, B = error_recursion(T, N)
    return 2.0 * float(np.mean(B) / np.mean(contraction_bound(T, N))) * W


def residual_ratio_bound(T: ArrayLike, N: ArrayLike) -> np.ndarray:
    """Bound of ⟨‖E_res‖²⟩/W, 32 N T (N T + 2)² (T N² + 1), eq. (25).

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

    The input repeats `every_triangle`, `periods` times, and the error starts at the truth: the
    ratio grows towards its limit.

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


def _checked_variance(noise_variance: float) -> float:
    if not 0.0 <= noise_variance < math.inf:
        raise InputError(f"noise_variance is {noise_variance!r}: give 0 or a number above it")
    return float(noise_variance)


# --- quantisation and the residual error of an experiment, eq. (27)-(31) ---


def largest_slope(x: ArrayLike, z: ArrayLike, span: float | None = None) -> float:
    """Largest slope of the measured hysteresis, I = max ∂z/∂x, eq. (27).

    Slopes are taken between crossings of neighbouring lines on the axis of the input, `span` apart
    (2 % of its range if not given), so that neither noise nor a turning point is divided by a small
    step.

    Arguments:
        x: (time,) input.
        z: (time,) output.
        span: distance of the lines, in the unit of the input.

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

    Example:
        >>> round(float(quantisation_step(2.53, 75 / 37)), 2)
        5.13
    """
    return slope * np.asarray(delta_x, float)


def quantisation_noise_power(slope: float, delta_x: ArrayLike) -> np.ndarray:
    """Bound of the power of the quantisation noise, W ≈ I² δx²/12, eq. (29).

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

    Example:
        >>> mean_output_error([3.0, 4.0])
        5.0
    """
    error = np.asarray(error, float)
    if error.size < 2:
        raise InputError(f"there are {error.size} errors: give at least 2 for the average (30)")
    return math.sqrt(float(np.sum(error**2)) / (error.size - 1))


def auxiliary_norm(mean_error: ArrayLike, cells: ArrayLike) -> np.ndarray:
    """Auxiliary norm, ((⟨e⟩/L)² L)^½ = ⟨e⟩/√L, eq. (31).

    The paper takes it for the norm of the weight error, of which it is a small part; `norm_factor`
    has the one that follows it.

    Example:
        >>> float(auxiliary_norm(3.0, 9))
        1.0
    """
    return np.asarray(mean_error) / np.sqrt(np.asarray(cells, float))


# --- beyond the paper: mean and covariance of the weight error, exactly ---


class ErrorMoments(NamedTuple):
    """Mean and covariance of the weight error E = R̂ - R along an input.

    Attributes:
        sample: (events,) sample of each event.
        mean_squared: (events,) ‖⟨E⟩‖² after each event: what is left of the initial error.
        variance: (events,) tr Cov(E) after each event: what the noise has brought in. Divided by W
            it does not depend on W. ⟨‖E‖²⟩ is the sum of both.
        output_variance: (events,) variance of the output error e(k) of each event.
        mean: (cells,) ⟨E⟩ at the end.
        covariance: (cells, cells) Cov(E) at the end.
    """

    sample: np.ndarray
    mean_squared: np.ndarray
    variance: np.ndarray
    output_variance: np.ndarray
    mean: np.ndarray
    covariance: np.ndarray


def propagate_error(
    plane: Plane,
    x: ArrayLike,
    initial_error: ArrayLike,
    noise_variance: float = 1.0,
    progress: Progress | None = None,
) -> ErrorMoments:
    """Mean and covariance of the weight error for a given input and noise power, exactly.

    With s = ±1 on S± and ν = n(k) - n(k'), where k' is the event before, the recursion is
    E⁺ = (I - s sᵀ/A) E + s ν/A. Noise is white, but ν is not: n(k') is in E already. With
    P = Cov(E), b = Cov(E, n(k')) = s' W/A' of the event before, p = P s, q = sᵀ p and β = sᵀ b,

        P⁺ = P - v sᵀ - s vᵀ,   v = (p + b)/A - s (q/2 + W + β)/A²,

    ⟨E⟩⁺ = (I - s sᵀ/A) ⟨E⟩, and e = ν - sᵀE has the variance 2W + q + 2β. As s has at most about N
    entries, an event costs O(N L) operations; the covariance takes 8 L² bytes.

    Arguments:
        plane: the Preisach plane.
        x: (time,) input, in the unit of the plane; relays start from saturated low.
        initial_error: (cells,) or () E(0) = R̂(0) - R, in the unit of the output.
        noise_variance: W, in the squared unit of the output.
        progress: called with a text and the part that is done.

    Example:
        >>> plane = Plane(levels=2, low=0.0, high=2.0)
        >>> moments = propagate_error(plane, [0.0, 2.0], initial_error=[1.0, 0.0, -1.0])
        >>> [round(float(m[-1]), 6) for m in (moments.mean_squared, moments.variance)]
        [2.0, 0.666667]
    """
    W = _checked_variance(noise_variance)
    error = np.asarray(initial_error, float)
    if error.shape not in ((), (plane.cells,)):
        raise InputError(f"initial_error has the shape {error.shape}: give () or ({plane.cells},)")
    mean = np.broadcast_to(error, plane.cells).copy()
    events = switching(plane, x)
    covariance = np.zeros((plane.cells, plane.cells))
    before = np.zeros(plane.cells)  # b
    rows = np.empty((3, len(events)))
    for k, (_, g, cells) in enumerate(events):
        A = len(cells)
        mean[cells] -= mean[cells].sum() / A
        p = covariance[cells].sum(axis=0)
        q, beta = p[cells].sum(), g * before[cells].sum()
        v = (p + g * before) / A
        v[cells] -= (q / 2 + W + beta) / A**2
        covariance[cells] -= v
        covariance[:, cells] -= v[:, None]
        before[:] = 0.0
        before[cells] = g * W / A
        rows[:, k] = mean @ mean, np.trace(covariance), 2 * W + q + 2 * beta
        if progress is not None and k % 256 == 0:
            progress(f"covariance of {plane.cells} weights", k / len(events))
    sample = np.array([event.sample for event in events], int)
    mean_squared, variance, output_variance = rows
    return ErrorMoments(sample, mean_squared, variance, output_variance, mean, covariance)


def noise_coefficient(
    plane: Plane, x: ArrayLike, first: int, last: int, progress: Progress | None = None
) -> float:
    """Practical coefficient of proportionality ⟨‖E_res‖²⟩/W of an input, in place of (25).

    What noise adds to ⟨‖E‖²⟩ for W = 1, tr Cov(E), averaged over the samples of an interval; for
    this input exact, and independent of the weights and of W.

    Arguments:
        plane: the Preisach plane.
        x: (time,) input, in the unit of the plane; relays start from saturated low.
        first: first sample m of the interval, at or after the first event.
        last: sample after the last one, M.
        progress: called with a text and the part that is done.

    Example:
        >>> plane = Plane(levels=2, low=0.0, high=2.0)
        >>> round(noise_coefficient(plane, [0.0, 2.0, 2.0], first=1, last=3), 6)
        0.666667
    """
    _check_last(x, last)
    moments = propagate_error(plane, x, 0.0, progress=progress)
    return float(average_over_samples(moments.variance, moments.sample, first, last))


def norm_factor(plane: Plane, x: ArrayLike, first: int, last: int) -> float:
    """By what ⟨e⟩ (30) over switching samples is to be multiplied for √⟨‖E_res‖²⟩, for an input.

    √(⟨tr Cov(E)⟩/⟨Var e⟩), of which W cancels: the norm of the weight error in white noise, from
    what is measured. (31) has 1/√L in its place.

    Arguments:
        plane: the Preisach plane.
        x: (time,) input, in the unit of the plane; relays start from saturated low.
        first: first sample m of the interval, at or after the first event.
        last: sample after the last one, M.

    Example:
        >>> plane = Plane(levels=2, low=0.0, high=2.0)
        >>> round(norm_factor(plane, [0.0, 2.0, 2.0], first=1, last=3), 6)
        0.57735
    """
    _check_last(x, last)
    moments = propagate_error(plane, x, 0.0)
    added = average_over_samples(moments.variance, moments.sample, first, last)
    within = (moments.sample >= first) & (moments.sample < last)
    if not within.any():
        raise InputError(f"the interval is {first} to {last}: give one in which relays switch")
    return math.sqrt(float(added) / float(np.mean(moments.output_variance[within])))


def _check_last(x: ArrayLike, last: int) -> None:
    if last > np.shape(x)[0]:
        raise InputError(f"last is {last}: give at most {np.shape(x)[0]}, the number of samples")


def average_over_samples(
    values: ArrayLike, sample: ArrayLike, first: int, last: int
) -> np.ndarray | float:
    """Average over the samples m ... M-1 of what only changes at events.

    Arguments:
        values: (events, ...) values after each event.
        sample: (events,) samples of the events, ascending.
        first: first sample m of the average; at or after the first event.
        last: sample M after the last one.

    Example:
        >>> float(average_over_samples([1.0, 3.0], [0, 3], 1, 5))
        2.0
    """
    values, sample = np.asarray(values, float), np.asarray(sample)
    if np.any(np.diff(sample) < 0):
        raise InputError(
            f"sample holds {sample.size} events that are not in order: sort them with their values"
        )
    if not sample.size:
        raise InputError(f"there are {sample.size} events: give an input that passes thresholds")
    if not sample[0] <= first < last:
        raise InputError(
            f"the interval is {first} to {last}: it must not be empty, nor begin before the first "
            f"event, at sample {sample[0]}"
        )
    edges = np.clip(np.append(sample, last), first, last)
    return np.tensordot(np.diff(edges) / (last - first), values, axes=1)

"""The practical coefficient: mean and covariance of the weight error, exactly."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jax.typing import ArrayLike

from preisach_jax.errors import InputError
from preisach_jax.operator.blocks import switching
from preisach_jax.operator.plane import Plane
from preisach_jax.theory.noise import checked_variance


class ErrorMoments(NamedTuple):
    """Mean and covariance of the weight error E = R̂ - R along an input.

    Attributes:
        sample: (events,) sample of each event.
        mean_squared: (events,) ‖⟨E⟩‖² after each event: what is left of the initial error.
        variance: (events,) tr Cov(E) after each event: what the noise has brought in. Divided by W
            it does not depend on W. ⟨‖E‖²⟩ is the sum of both.
        mean: (cells,) ⟨E⟩ at the end.
        covariance: (cells, cells) Cov(E) at the end.
    """

    sample: np.ndarray
    mean_squared: np.ndarray
    variance: np.ndarray
    mean: np.ndarray
    covariance: np.ndarray


def propagate_error(
    plane: Plane,
    x: ArrayLike,
    initial_error: ArrayLike,
    noise_variance: float = 1.0,
    progress: Callable[[str, float], None] | None = None,
) -> ErrorMoments:
    """Mean and covariance of the weight error for a given input and noise power, exactly.

    With s = ±1 on S± and ν = n(k) - n(k'), where k' is the event before, the recursion is
    E⁺ = (I - s sᵀ/A) E + s ν/A. Noise is white, but ν is not: n(k') is in E already. With
    P = Cov(E), b = Cov(E, n(k')) = s' W/A' of the event before, p = P s, q = sᵀ p and β = sᵀ b,

        P⁺ = P - v sᵀ - s vᵀ,   v = (p + b)/A - s (q/2 + W + β)/A²,

    and ⟨E⟩⁺ = (I - s sᵀ/A) ⟨E⟩. As s has at most about N entries, an event costs O(N L) operations;
    the covariance takes 8 L² bytes.

    Arguments:
        plane: the Preisach plane.
        x: (time,) input, in the unit of the plane; relays start from saturated low.
        initial_error: (cells,) or () E(0) = R̂(0) - R, in the unit of the output.
        noise_variance: W, in the squared unit of the output.
        progress: called with a text and the part that is done.

    Returns:
        The moments after each event.

    Raises:
        InputError: the variance is negative or a shape is wrong.

    Example:
        >>> plane = Plane(levels=2, low=0.0, high=2.0)
        >>> moments = propagate_error(plane, [0.0, 2.0], initial_error=[1.0, 0.0, -1.0])
        >>> [round(float(m[-1]), 6) for m in (moments.mean_squared, moments.variance)]
        [2.0, 0.666667]
    """
    W = checked_variance(noise_variance)
    error = np.asarray(initial_error, float)
    if error.shape not in ((), (plane.cells,)):
        raise InputError(f"initial_error has the shape {error.shape}: give () or ({plane.cells},)")
    mean = np.broadcast_to(error, plane.cells).copy()
    events = switching(plane, x)
    covariance = np.zeros((plane.cells, plane.cells))
    before = np.zeros(plane.cells)  # b
    mean_squared, variance = np.empty(len(events)), np.empty(len(events))
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
        mean_squared[k] = mean @ mean
        variance[k] = np.trace(covariance)
        if progress is not None and k % 256 == 0:
            progress(f"covariance of {plane.cells} weights", k / len(events))
    sample = np.array([event.sample for event in events], int)
    return ErrorMoments(sample, mean_squared, variance, mean, covariance)


def noise_coefficient(
    plane: Plane,
    x: ArrayLike,
    first: int,
    last: int,
    progress: Callable[[str, float], None] | None = None,
) -> float:
    """Practical coefficient of proportionality ⟨‖E_res‖²⟩/W of an input, in place of (25).

    What noise adds to ⟨‖E‖²⟩ for W = 1, tr Cov(E), averaged over the samples of an interval.

    Arguments:
        plane: the Preisach plane.
        x: (time,) input, in the unit of the plane; relays start from saturated low.
        first: first sample m of the interval, at or after the first event.
        last: sample after the last one, M.
        progress: called with a text and the part that is done.

    Returns:
        The coefficient; for this input exact, and independent of the weights and of W.

    Raises:
        InputError: a shape is wrong or the interval cannot be used.

    Example:
        >>> plane = Plane(levels=2, low=0.0, high=2.0)
        >>> round(noise_coefficient(plane, [0.0, 2.0, 2.0], first=1, last=3), 6)
        0.666667
    """
    if last > np.shape(x)[0]:
        raise InputError(f"last is {last}: give at most {np.shape(x)[0]}, the number of samples")
    moments = propagate_error(plane, x, 0.0, progress=progress)
    return float(average_over_samples(moments.variance, moments.sample, first, last))


def average_over_samples(
    values: ArrayLike, sample: ArrayLike, first: int, last: int
) -> np.ndarray | float:
    """Average over samples of what only changes at events.

    Arguments:
        values: (events, ...) values after each event.
        sample: (events,) samples of the events, ascending.
        first: first sample m of the average; at or after the first event.
        last: sample M after the last one.

    Returns:
        (...) average over the samples m ... M-1.

    Raises:
        InputError: the interval is empty, or begins before the first event.

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

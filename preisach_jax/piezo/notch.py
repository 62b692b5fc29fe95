"""Rational discrete-time filters: the paper's notch, and the resonances that it removes."""

from __future__ import annotations

from typing import NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.typing import ArrayLike

from preisach_jax.errors import InputError, require_positive

RATE_HZ = 5000.0  # of the controller, the amplifier and the encoder


# F(d) of (26) is written in positive powers of d, whose inverse is the backward shift, so that
# these are also the coefficients of 1, d^-1, d^-2, ...
NOTCH_NUMERATOR = np.array([0.430, -1.409, 1.987, -1.385, 0.416])
NOTCH_DENOMINATOR = np.array([1.0, -2.174, 1.752, -0.620, 0.081])
LIGHT_DAMPING = 0.1


class Modes(NamedTuple):
    """Lightly damped modes, in ascending order of frequency.

    Arguments:
        frequency_hz: (modes,) natural frequencies |s|/2π, Hz.
        damping: (modes,) damping ratios -Re(s)/|s|.
    """

    frequency_hz: np.ndarray
    damping: np.ndarray


def linear_filter(numerator: ArrayLike, denominator: ArrayLike, x: ArrayLike) -> jax.Array:
    """Rational discrete-time filter that is settled at the first sample.

    y = (B/A) x with B = Σ b_i d^-i and A = Σ a_i d^-i, run as y = G x + (C/A) Δx with Δx(k) =
    x(k) - x(k-1), G = B(1)/A(1) and C = (B - G A)/(1 - d^-1), and C/A in transposed direct form II.
    So the settled state is zero, and the state holds small numbers only: with the resonances of
    `paper_stage` single precision then costs 0.1 nm, where B/A itself costs 2.7 nm.

    Arguments:
        numerator: (order_b + 1,) coefficients b_0, b_1, ... of 1, d^-1, ...
        denominator: (order_a + 1,) coefficients a_0, a_1, ...; a_0 and their sum are not zero.
        x: (time,) signal.

    Returns:
        (time,) filtered signal; differentiable in all arguments.

    Raises:
        InputError: a shape or type is wrong, a_0 is zero, or there is no finite gain G at rest.

    Example:
        >>> linear_filter([0.5], [1.0, -0.5], [1.0, 1.0, 3.0, 3.0]).tolist()
        [1.0, 1.0, 2.0, 2.5]
    """
    x = row(x, "the signal")
    b, a = row(numerator, "the numerator"), row(denominator, "the denominator")
    _check_denominator(denominator)
    return cast(jax.Array, _filter(b.astype(x.dtype), a.astype(x.dtype), x))


@jax.jit
def _filter(b: jax.Array, a: jax.Array, x: jax.Array) -> jax.Array:
    b, a = b / a[0], a / a[0]
    order = max(b.shape[0], a.shape[0]) - 1
    b, a = (jnp.pad(row, (0, order + 1 - row.shape[0])) for row in (b, a))
    gain = jnp.sum(b) / jnp.sum(a)
    c = jnp.cumsum(b - gain * a)  # the last is zero

    def advance(state: jax.Array, move: jax.Array) -> tuple[jax.Array, jax.Array]:
        state = jnp.append(state, 0.0)
        output = c[0] * move + state[0]
        return state[1:] + c[1:] * move - a[1:] * output, output

    moves = jnp.diff(x, prepend=x[:1])
    return gain * x + jax.lax.scan(advance, jnp.zeros(order, x.dtype), moves)[1]


def notch_filter(u: ArrayLike) -> jax.Array:
    """The paper's notch filter F(d), eq. (26), settled at the first sample; its gain at rest is 1.

    Arguments:
        u: (time,) command at 5 kHz, V.

    Returns:
        (time,) drive, V; it can leave the range of the command by a little.

    Raises:
        InputError: `u` is not a row of real numbers.

    Example:
        >>> [round(v, 4) for v in notch_filter([0.0, 1.0, 1.0]).tolist()]
        [0.0, 0.43, -0.0442]
    """
    return linear_filter(NOTCH_NUMERATOR, NOTCH_DENOMINATOR, u)


def resonances(polynomial: ArrayLike, rate_hz: float = RATE_HZ) -> Modes:
    """Lightly damped modes, with a damping ratio below 0.1, among the roots of a polynomial.

    A root d belongs to s = ln(d)/T; its natural frequency is |s|/2π and its damping -Re(s)/|s|.

    Arguments:
        polynomial: (order + 1,) real coefficients, those of 1, d^-1, d^-2, ...
        rate_hz: sampling rate 1/T, Hz.

    Returns:
        The modes; of F's numerator in (26) they are the stage's resonances.

    Raises:
        InputError: the sampling rate is not positive.

    Example:
        >>> resonances(NOTCH_NUMERATOR).frequency_hz.round(1).tolist()
        [337.7, 587.0]
    """
    require_positive(rate_hz=rate_hz)
    roots = np.roots(np.asarray(polynomial, float))
    # One root of each pair; the logarithm of zero is never asked for.
    s = np.log(roots[roots.imag > 0.0]) * rate_hz
    damping = -s.real / np.abs(s)
    light = np.flatnonzero(np.abs(damping) < LIGHT_DAMPING)
    light = light[np.argsort(np.abs(s[light]))]
    return Modes(np.abs(s[light]) / (2.0 * np.pi), damping[light])


def row(values: ArrayLike, name: str) -> jax.Array:
    """Real numbers in a row, as a floating array."""
    array = jnp.asarray(values)
    if not jnp.issubdtype(array.dtype, jnp.floating):
        if not jnp.issubdtype(array.dtype, jnp.integer):
            raise InputError(f"{name} has the type {array.dtype}: give real numbers")
        array = array.astype(jnp.result_type(float))
    if array.ndim != 1 or array.shape[0] == 0:
        raise InputError(f"{name} has the shape {array.shape}: give a row with one value or more")
    # A Python number is weakly typed; a fixed type saves compiling everything twice. Within a
    # compiled function an array of NumPy's is still in double precision.
    return array.astype(jax.dtypes.canonicalize_dtype(array.dtype))


def _check_denominator(denominator: ArrayLike) -> None:
    if isinstance(denominator, Tracer):
        return
    a = np.asarray(denominator, float)
    if a[0] == 0.0 or abs(a.sum()) <= 1e-12 * np.abs(a).sum():
        raise InputError(
            f"the denominator is {a.tolist()}: its first coefficient and its sum must not be zero"
        )

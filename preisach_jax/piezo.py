"""The paper's experiment in JAX: command, notch filter (26), piezo stage, encoder, at 5 kHz.

A simulated world that shares no code with the models. For many records, map `experiment` over keys.
"""

from __future__ import annotations

import math
from typing import NamedTuple, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jax.core import Tracer
from jax.typing import ArrayLike

from preisach_jax.errors import InputError, require_positive
from preisach_jax.plant import ENCODER_STEP_UM, RANGE_V
from preisach_jax.signals import bernoulli_ramp
from preisach_jax.signals.checks import as_key

RATE_HZ = 5000.0  # of the controller, the amplifier and the encoder

# F(d) of (26) is written in positive powers of d, whose inverse is the backward shift, so that
# these are also the coefficients of 1, d^-1, d^-2, ...
NOTCH_NUMERATOR = np.array([0.430, -1.409, 1.987, -1.385, 0.416])
NOTCH_DENOMINATOR = np.array([1.0, -2.174, 1.752, -0.620, 0.081])
LIGHT_DAMPING = 0.1

PLAYS = 256
PARTICIPATION = (0.8, 0.2)  # of the two resonances in the static stroke


# --- rational filters: the notch, and the resonances that it removes ---


class Modes(NamedTuple):
    """Lightly damped modes, in ascending order of frequency.

    Attributes:
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

    Example:
        >>> linear_filter([0.5], [1.0, -0.5], [1.0, 1.0, 3.0, 3.0]).tolist()
        [1.0, 1.0, 2.0, 2.5]
    """
    x = _row(x, "the signal")
    b, a = _row(numerator, "the numerator"), _row(denominator, "the denominator")
    if not isinstance(denominator, Tracer):
        given = np.asarray(denominator, float)
        if given[0] == 0.0 or abs(given.sum()) <= 1e-12 * np.abs(given).sum():
            raise InputError(
                f"the denominator is {given.tolist()}: its first coefficient and its sum must not "
                "be zero"
            )
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

    Example:
        >>> [round(v, 4) for v in notch_filter([0.0, 1.0, 1.0]).tolist()]
        [0.0, 0.43, -0.0442]
    """
    return linear_filter(NOTCH_NUMERATOR, NOTCH_DENOMINATOR, u)


def resonances(polynomial: ArrayLike, rate_hz: float = RATE_HZ) -> Modes:
    """Lightly damped modes, with a damping ratio below 0.1, among the roots of a polynomial.

    A root d belongs to s = ln(d)/T; its natural frequency is |s|/2π and its damping -Re(s)/|s|. Of
    F's numerator in (26) they are the stage's resonances.

    Arguments:
        polynomial: (order + 1,) real coefficients, those of 1, d^-1, d^-2, ...
        rate_hz: sampling rate 1/T, Hz.

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


def _row(values: ArrayLike, name: str) -> jax.Array:
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


# --- the stage ---


class PiezoStage(eqx.Module):
    """Piezo stage: rate-independent hysteresis, then resonances.

    Play k keeps v between u - slack_up and u + slack_down, and the stage moves by
    h = Σ_k (slope_k v_k + curvature_k v_k²/2), zero at rest at 0 V: generalised plays with a
    quadratic generating function (Visintin, Differential Models of Hysteresis, 1994). The slacks
    are continuous, so that h is continuous too, and on no model's grid. The resonances follow as a
    rational filter from h to the stroke.

    It starts saturated low: a play is then where it comes to rest whenever the drive returns to
    0 V, which is the memory of a Preisach model over 0 V to 75 V with all hysterons off.

    Arguments:
        slack_up: (plays,) V, by which a rising drive is ahead.
        slack_down: (plays,) V, by which a falling drive is behind.
        slope: (plays,) µm/V.
        curvature: (plays,) µm/V².
        numerator: coefficients of the resonances' numerator, of 1, d^-1, ... at 5 kHz.
        denominator: the same of their denominator.

    Example:
        >>> up, top, down = paper_stage().hysteresis([37.5, 75.0, 37.5]).round(1).tolist()
        >>> print(f"{up:.1f} {top:.1f} {down:.1f}")
        46.4 111.8 65.2
    """

    slack_up: np.ndarray | jax.Array
    slack_down: np.ndarray | jax.Array
    slope: np.ndarray | jax.Array
    curvature: np.ndarray | jax.Array
    numerator: np.ndarray | jax.Array
    denominator: np.ndarray | jax.Array

    def hysteresis(self, v: ArrayLike) -> jax.Array:
        """(time,) stroke h without the resonances along a drive in V, from saturated low, µm.

        Differentiable in `v` and in the stage's parameters.
        """
        return _stroke(self, _row(v, "the drive"))

    def response(self, v: ArrayLike) -> jax.Array:
        """(time,) stroke along a drive at 5 kHz in V, settled at the first sample, µm."""
        return linear_filter(self.numerator, self.denominator, self.hysteresis(v))


@eqx.filter_jit
def _stroke(stage: PiezoStage, v: jax.Array) -> jax.Array:
    up, down, slope, bend = (
        jnp.asarray(values, v.dtype)
        for values in (stage.slack_up, stage.slack_down, stage.slope, stage.curvature)
    )
    ones = jnp.ones_like(slope)
    rest = (down * (slope + 0.5 * bend * down)) @ ones

    def advance(plays: jax.Array, value: jax.Array) -> tuple[jax.Array, jax.Array]:
        plays = jnp.clip(plays, value - up, value + down)
        # Mapped over records, this sum runs twice as fast as jnp.sum or (...) @ plays.
        return plays, (plays * (slope + 0.5 * bend * plays)) @ ones

    return jax.lax.scan(advance, down, v)[1] - rest


def paper_stage(plays: int = PLAYS) -> PiezoStage:
    """The stage of the default experiment, made to look like the paper's.

    With w the sum of a play's slacks over 75 V, the slopes of all plays up to w add up to about
    1.2 + 0.1 w + 1.22 w⁴ µm/V: a reversible part, Rayleigh's law for small loops, and a steep rest.
    So the rising branch is convex, the falling one concave, and the greatest slope
    I = max ∂z/∂x = 2.53 µm/V (27) is at the upper vertex of the major loop. The plays' slopes grow
    with the drive, which makes the branches differ: at the lower vertex the slope is 2.47 µm/V. The
    resonances are those that the notch filter (26) removes.

    Arguments:
        plays: number of plays, at least 2. With 256 the stroke is within 0.8 nm (RMS 0.15 nm) of
            that with ever more, with 128 within 2.1 nm; the encoder's step is 1.22 nm.

    Example:
        >>> round(float(paper_stage().hysteresis([75.0])[0]), 1)
        111.8
    """
    if plays < 2:
        raise InputError(f"plays is {plays}: give at least 2")
    edges = np.linspace(0.0, 1.0, plays)
    middles = 0.5 * (edges[1:] + edges[:-1])
    slacks = RANGE_V * np.concatenate([[0.0], middles])
    hysteretic = np.diff(0.1 * edges + 1.22 * edges**4)
    bend = 0.2 / RANGE_V
    # About the middle of the range, so that the bend leaves the mean slope alone.
    slope = np.concatenate([[1.2], hysteretic * (1.0 - 0.5 * bend * RANGE_V)])
    curvature = np.concatenate([[0.0], hysteretic * bend])
    numerator, denominator = _resonant_filter()
    return PiezoStage(0.6 * slacks, 0.4 * slacks, slope, curvature, numerator, denominator)


def _resonant_filter() -> tuple[np.ndarray, np.ndarray]:
    """Sum of the modes, static gain 1, for an input that runs straight from sample to sample."""
    parts: list[tuple[np.ndarray, np.ndarray]] = []
    for share, f, damping in zip(PARTICIPATION, *resonances(NOTCH_NUMERATOR), strict=True):
        omega = 2.0 * np.pi * f
        mode = scipy.signal.lti([share * omega**2], [1.0, 2.0 * damping * omega, omega**2])
        sampled = mode.to_discrete(1.0 / RATE_HZ, "foh")
        parts.append((sampled.num, sampled.den))
    (b_1, a_1), (b_2, a_2) = parts
    return np.polymul(b_1, a_2) + np.polymul(b_2, a_1), np.polymul(a_1, a_2)


# --- the experiment ---


class PiezoRecord(NamedTuple):
    """One record of the experiment.

    Attributes:
        time_s: (time,) s.
        command_v: (time,) command before the notch filter, V.
        input_v: (time,) drive of the stage, V: what the identification calls x.
        stroke_um: (time,) measured stroke z, µm.
    """

    time_s: jax.Array
    command_v: jax.Array
    input_v: jax.Array
    stroke_um: jax.Array


def _in_steps(position: jax.Array, step: float) -> jax.Array:
    return position if step == 0.0 else jnp.round(position / step) * step


_encoded = jax.custom_jvp(_in_steps, nondiff_argnums=(1,))


@_encoded.defjvp
def _encoded_jvp(
    step: float, primals: tuple[jax.Array], tangents: tuple[jax.Array]
) -> tuple[jax.Array, jax.Array]:
    return _encoded(primals[0], step), tangents[0]


def encode(position: jax.Array, step: float) -> jax.Array:
    """Position in whole steps of an encoder, step·round(z/step), both in µm; a step of 0 is none.

    The derivative is that without an encoder, since the true one is zero wherever it exists.

    Example:
        >>> import jax
        >>> encode(jax.numpy.asarray(0.8), 0.5).item(), jax.grad(encode)(0.8, 0.5).item()
        (1.0, 1.0)
    """
    return _encoded(position, step)


def experiment(
    key: jax.Array,
    samples: int,
    stage: PiezoStage | None = None,
    rate_hz: float = 2000.0,
    noise_um: float = 0.0,
    encoder_step_um: float = ENCODER_STEP_UM,
) -> PiezoRecord:
    """Simulate one record of the paper's experiment, section IV.

    A Bernoulli ramp over 0 V to 75 V is commanded at 5 kHz and smoothed by the notch filter (26);
    the amplifier keeps it in this range, which here cuts off no more than rounding; the stage moves
    and the encoder reads. Of the pairs (x, z) of one instant those at floor(5 kHz k/rate) are kept,
    at 2 kHz every second or third. To a rate-independent hysteresis uneven steps of time mean
    nothing, while interpolated pairs would lie on chords along which the stage never ran.

    Arguments:
        key: random key (`jax.random.key`).
        samples: number of samples at the lower rate.
        stage: the stage; None is `paper_stage()`.
        rate_hz: rate of the record, Hz; at most 5 kHz. The paper's identification ran at 2 kHz.
        noise_um: standard deviation of white noise of the sensor, µm, before the encoder rounds.
        encoder_step_um: step of the encoder, µm; 0 is none.

    Returns:
        The record; `jax.jit` and `jax.vmap` over keys work.

    Example:
        >>> import jax
        >>> record = experiment(jax.random.key(0), samples=1000)
        >>> record.stroke_um.shape, [f"{t:.4f}" for t in record.time_s[:3]]
        ((1000,), ['0.0000', '0.0004', '0.0010'])
    """
    key = as_key(key)
    if samples != int(samples) or samples < 1:
        raise InputError(f"samples is {samples}: give a whole number of at least 1")
    if not 0.0 < rate_hz <= RATE_HZ:
        raise InputError(f"rate_hz is {rate_hz!r}: give a number above 0, at most {RATE_HZ:g}")
    for name, value in (("noise_um", noise_um), ("encoder_step_um", encoder_step_um)):
        if not isinstance(value, Tracer) and not 0.0 <= value < math.inf:
            raise InputError(f"{name} is {value!r}: give 0 or a number above it")
    stage = paper_stage() if stage is None else stage
    return _experiment(key, samples, stage, rate_hz, jnp.asarray(noise_um), encoder_step_um)


@eqx.filter_jit
def _experiment(
    key: jax.Array,
    samples: int,
    stage: PiezoStage,
    rate_hz: float,
    noise_um: jax.Array,
    encoder_step_um: float,
) -> PiezoRecord:
    # A whole multiple must not fall to the sample below by rounding.
    kept = np.floor(np.arange(samples) * (RATE_HZ / rate_hz) + 1e-6).astype(int)
    coin_key, noise_key = jax.random.split(key)
    command = bernoulli_ramp(coin_key, int(kept[-1]) + 1, RATE_HZ, low=0.0, high=RANGE_V)
    drive = jnp.clip(notch_filter(command), 0.0, RANGE_V)
    stroke = stage.response(drive)[kept]
    noise = noise_um * jax.random.normal(noise_key, stroke.shape, stroke.dtype)
    return PiezoRecord(
        time_s=jnp.asarray(kept / RATE_HZ, stroke.dtype),
        command_v=command[kept],
        input_v=drive[kept],
        stroke_um=encode(stroke + noise, encoder_step_um),
    )

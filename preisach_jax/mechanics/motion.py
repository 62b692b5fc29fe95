"""The motion of a body on a hysteretic spring along a force."""

from __future__ import annotations

import math
from typing import Any, Generic, NamedTuple, TypeVar, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Array, Float

from preisach_jax.errors import InputError
from preisach_jax.mechanics.laws import Law

ANGLE = 0.16
"""Radians of the natural oscillation in one step of the integration: its phase is then right to
4e-6 a period."""

MOST_SUBSTEPS = 100
"""Steps of the integration between two samples at most: more of them bridge a gap."""

LawOf = TypeVar("LawOf", bound=Law)


class Body(eqx.Module, Generic[LawOf]):
    r"""A body: \(m \ddot z + c \dot z + k z + H(z) = u\)."""

    mass: Array
    damping: Array
    stiffness: Array
    law: LawOf


class Force(NamedTuple):
    """A force between its samples: a polynomial from each to the next one.

    Attributes:
        coefficients: (time - 1, 6) of the powers 0 to 5 of the share of the interval.
        intervals: (time - 1,) lengths of the intervals, in s.
    """

    coefficients: Float[Array, "interval power"]
    intervals: Float[Array, " interval"]

    @staticmethod
    def through(time: np.ndarray, force: np.ndarray) -> Force:
        """The spline of degree five through samples of a force; at least eight of them.

        Of a force whose spectrum ends at 0.4 of the Nyquist frequency it misses 1e-4 there, and
        1e-8 at a tenth of it.

        Arguments:
            time: (time,) times, in s.
            force: (time,) samples.
        """
        intervals = np.diff(time)
        spline: Any = scipy.interpolate.make_interp_spline(time, force, k=5)
        powers: list[np.ndarray] = [
            spline.derivative(power)(time[:-1]) * intervals**power / math.factorial(power)
            for power in range(6)
        ]
        return Force(jnp.asarray(np.stack(powers, axis=1)), jnp.asarray(intervals))

    def cut(self, start: int, stop: int) -> Force:
        """The intervals from `start` to `stop`."""
        return Force(self.coefficients[start:stop], self.intervals[start:stop])


def substeps_of(time: np.ndarray, f_hz: float) -> int:
    """Steps of the integration between two samples, for a body of a natural frequency.

    Arguments:
        time: (time,) times, in s.
        f_hz: the natural frequency, in Hz.
    """
    longest = int(np.argmax(np.diff(time)))
    gap = float(time[longest + 1] - time[longest])
    steps = max(1, math.ceil(2 * math.pi * f_hz * gap / ANGLE))
    if steps > MOST_SUBSTEPS:
        raise InputError(
            f"samples {longest + 1} and {longest + 2} lie {gap:.4g} s apart, "
            f"{gap * f_hz:.3g} periods of the mechanics of {f_hz:.4g} Hz: what the force did "
            "between them is not known; give a record without this gap"
        )
    return steps


State = tuple[Array, Array, Array]
"""Displacement, speed and memory."""


def motion(
    body: Body[Any], force: Force, start: State, substeps: int
) -> tuple[Float[Array, " time"], State]:
    """The displacement of a body along a force.

    Runge-Kutta steps of fourth order (E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary
    Differential Equations I, Springer 1993, ch. II.1).  A step in which the motion turns round, or
    the law passes its mark, is taken in two, up to there and from there on: the slope of the force
    jumps there.

    Returns:
        (time,) displacement, and the state at the last sample.
    """

    def over(carry: State, interval: tuple[Array, Array]) -> tuple[State, Array]:
        coefficients, length = interval

        def within(state: State, position: Array) -> tuple[State, None]:
            share = 1.0 / substeps
            return _split(body, state, coefficients, length, position * share, share), None

        positions = jnp.arange(substeps, dtype=coefficients.dtype)
        carry, _ = jax.lax.scan(within, carry, positions)
        return carry, carry[0]

    z, speed, memory = start
    dtype = force.coefficients.dtype
    begun = (jnp.asarray(z, dtype), jnp.asarray(speed, dtype), jnp.asarray(memory, dtype))
    last, path = jax.lax.scan(over, begun, (force.coefficients, force.intervals))
    return jnp.concatenate([begun[0][None], path]), last


def _split(
    body: Body[Any], state: State, coefficients: Array, length: Array, begin: Array, share: float
) -> State:
    """One step of the integration, in two parts where the slope of the force jumps in it."""
    whole, slopes = _stepped(body, state, coefficients, length, begin, share)
    turn, turns = _zero(state[1], whole[1], slopes[0] * share * length)
    marks = body.law.mark(state[2]), body.law.mark(whole[2])
    kink, kinks = _zero(*marks, body.law.mark(slopes[1]) * share * length)
    part = jnp.where(turns, turn, kink)

    def in_two() -> State:
        first, _ = _stepped(body, state, coefficients, length, begin, part * share)
        rest = (1.0 - part) * share
        return _stepped(body, first, coefficients, length, begin + part * share, rest)[0]

    def in_one() -> State:
        return whole

    return cast(State, jax.lax.cond(turns | kinks, in_two, in_one))


def _zero(first: Array, last: Array, slope: Array) -> tuple[Array, Array]:
    """Where between 0 and 1 a parabola passes zero, and whether its ends have two signs."""
    passes = first * last < 0
    bend = last - first - slope
    root = jnp.sqrt(jnp.where(passes, jnp.maximum(slope**2 - 4 * bend * first, 0.0), 1.0))
    below = jnp.where(passes, jnp.sign(first) * root - slope, 1.0)
    return jnp.clip(jnp.where(passes, 2 * first / below, 1.0), 0.0, 1.0), passes


def _stepped(
    body: Body[Any],
    state: State,
    coefficients: Array,
    length: Array,
    begin: Array,
    share: Array | float,
) -> tuple[State, tuple[Array, Array]]:
    """One Runge-Kutta step over a share of an interval; acceleration and rate at its start."""
    z, speed, memory = state
    step, law = share * length, body.law

    def slopes(z: Array, speed: Array, memory: Array, at: Array) -> tuple[Array, Array, Array]:
        force = jnp.polyval(coefficients[::-1], at) - law.force(memory, z)
        rest = force - body.damping * speed - body.stiffness * z
        return speed, rest / body.mass, law.rate(memory, speed)

    def moved(by: tuple[Array, Array, Array], part: Array) -> tuple[Array, Array, Array]:
        return z + part * by[0], speed + part * by[1], memory + part * by[2]

    first = slopes(z, speed, memory, begin)
    second = slopes(*moved(first, step / 2), begin + share / 2)
    third = slopes(*moved(second, step / 2), begin + share / 2)
    fourth = slopes(*moved(third, step), begin + share)
    mean = [
        (a + 2 * b + 2 * c + d) / 6 for a, b, c, d in zip(first, second, third, fourth, strict=True)
    ]
    end = moved((mean[0], mean[1], mean[2]), step)
    return (end[0], end[1], law.committed(end[2], end[0])), (first[1], first[2])

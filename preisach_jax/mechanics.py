"""The motion of a body on a hysteretic spring: m z'' + c z' + k z + H(z) = u."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Generic, NamedTuple, Protocol, TypeVar, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Array, Float

from preisach_jax.effects.restoring_force import BOUC_WEN, RestoringForce
from preisach_jax.errors import InputError
from preisach_jax.operator.plane import Plane, hysteron_step

ANGLE = 0.16
"""Radians of the natural oscillation in one step of the integration: its phase is then right to
4e-6 a period."""

MOST_SUBSTEPS = 100
"""Steps of the integration between two samples at most: more of them bridge a gap."""

FARTHEST = 2.0
"""Times the displacement of the record that was fitted up to which a prediction is believed."""

LEAST_SAMPLES = 8
"""Samples that the spline through the force takes."""

CLOSES = 3.0
"""Times what is above the band of an input anyway that its end may add there if it closes."""

UNEVEN = 0.01
"""Share of the time step by which steps may differ."""

QUIET = 1e-5
"""Share of the power of an input above its band from which on nothing can be seen there."""


class RestoringLaw(Protocol):
    """A force that depends on the path of a displacement, and not on how fast it is passed."""

    def force(self, memory: Array, z: Array) -> Array:
        """Force at a displacement that is reached on a monotone path from that of the memory."""
        ...

    def rate(self, memory: Array, speed: Array) -> Array:
        """Time derivative of a memory that moves with the displacement; zero if it does not."""
        ...

    def committed(self, memory: Array, z: Array) -> Array:
        """The memory once the displacement has come to z on a monotone path."""
        ...

    def mark(self, memory: Array) -> Array:
        """Linear function of the memory at whose zero the slope of the force jumps, if any."""
        ...


class BoucWen(eqx.Module):
    r"""Bouc-Wen law: one state, \(dy/dz = [1 - |y|^n (\beta\,\mathrm{sgn}(y\,dz) + \gamma)]/Z\).

    The force is \(H = K_h Z y\): a spring of stiffness \(K_h\) that yields where the bracket
    falls, and stiffens where it rises.  The memory is \(y\), `(1,)`.
    """

    stiffness: Array
    range_z: Array
    beta: Array
    gamma: Array
    exponent: Array

    def force(self, memory: Float[Array, " 1"], z: Array) -> Array:
        del z
        return self.stiffness * self.range_z * memory[0]

    def rate(self, memory: Float[Array, " 1"], speed: Array) -> Float[Array, " 1"]:
        # The power of zero has no derivative with respect to the exponent.
        away = memory != 0
        size = jnp.where(away, jnp.abs(jnp.where(away, memory, 1.0)) ** self.exponent, 0.0)
        bent = self.beta * jnp.abs(speed) * jnp.sign(memory) + self.gamma * speed
        return (speed - size * bent) / self.range_z

    def committed(self, memory: Float[Array, " 1"], z: Array) -> Float[Array, " 1"]:
        del z
        return memory

    def mark(self, memory: Float[Array, " 1"]) -> Array:
        return memory[0]


class PreisachSpring(eqx.Module):
    """The Preisach operator of the displacement, with ramp hysterons.

    The memory is the states of the hysterons, `(cells,)`.  The force is counted from that of the
    middle of all states, so that a demagnetised operator gives none at the middle of its plane.

    Arguments:
        weights: (cells,) weights, in units of force.
    """

    plane: Plane
    weights: Float[Array, " cells"]

    def demagnetised(self, dtype: Any) -> Float[Array, " cells"]:
        """States of an operator demagnetised around the middle of its plane."""
        total = np.asarray(self.plane.alpha_index) + np.asarray(self.plane.beta_index)
        middle = self.plane.levels - 1
        return jnp.asarray(np.where(total == middle, 0.5, total < middle), dtype)

    def force(self, memory: Float[Array, " cells"], z: Array) -> Array:
        return jnp.sum(self.weights * (self.committed(memory, z) - 0.5))

    def rate(self, memory: Float[Array, " cells"], speed: Array) -> Float[Array, " cells"]:
        del speed
        return jnp.zeros_like(memory)

    def committed(self, memory: Float[Array, " cells"], z: Array) -> Float[Array, " cells"]:
        return hysteron_step(self.plane, memory, z, z, "ramp")

    def mark(self, memory: Float[Array, " cells"]) -> Array:
        return jnp.zeros_like(memory[0])


LawOf = TypeVar("LawOf", bound=RestoringLaw)


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
    """Steps of the integration between two samples, for a body of a natural frequency."""
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
    at_start = (jnp.asarray(z, dtype), jnp.asarray(speed, dtype), jnp.asarray(memory, dtype))
    last, path = jax.lax.scan(over, at_start, (force.coefficients, force.intervals))
    return jnp.concatenate([at_start[0][None], path]), last


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


def body_of(
    effect: RestoringForce, values: Mapping[str, float], plane: Plane, weights: Any
) -> Body[Any]:
    """The body of a model, with (cells,) weights in units of force."""
    stiffness = jnp.asarray(values["stiffness"], dtype=float)
    omega = 2 * np.pi * values["f_hz"]
    law: RestoringLaw
    if effect.law == BOUC_WEN:
        shape = [jnp.asarray(values[name], dtype=float) for name in ("beta", "gamma", "n")]
        law = BoucWen(values["share"] * stiffness, jnp.asarray(effect.range_z), *shape)
    else:
        law = PreisachSpring(plane, jnp.asarray(weights, dtype=float))
    rest = (1 - values["share"]) * stiffness
    return Body(stiffness / omega**2, 2 * values["zeta"] * stiffness / omega, rest, law)


def fitted_start(effect: RestoringForce, plane: Plane) -> State:
    """The state at the first sample of the record that was fitted."""
    return _state(effect, plane, effect.start_z, effect.start_speed, effect.start_y)


def at_rest(effect: RestoringForce, plane: Plane) -> State:
    """The state of a body at rest and demagnetised."""
    return _state(effect, plane, 0.0, 0.0, 0.0)


def _state(effect: RestoringForce, plane: Plane, z: float, speed: float, y: float) -> State:
    place = jnp.asarray(z, dtype=float)
    if effect.law == BOUC_WEN:
        memory = jnp.asarray([y], dtype=float)
    else:
        operator = PreisachSpring(plane, jnp.zeros(plane.cells))
        memory = operator.committed(operator.demagnetised(place.dtype), place)
    return place, jnp.asarray(speed, dtype=float), memory


def along(
    body: Body[Any], start: State, time: np.ndarray, force: np.ndarray, f_hz: float
) -> tuple[np.ndarray, State]:
    """(time,) displacement along a force, and the state at its end."""
    if len(time) < LEAST_SAMPLES:
        raise InputError(
            f"the record has {len(time)} samples, and the force between them is not known from "
            f"fewer than {LEAST_SAMPLES}; give a longer record"
        )
    path, last = _moved(body, Force.through(time, force), start, substeps_of(time, f_hz))
    return np.asarray(path), last


@eqx.filter_jit
def _moved(body: Body[Any], force: Force, start: State, substeps: int) -> tuple[Array, State]:
    return motion(body, force, start, substeps)


def closes(time: np.ndarray, force: np.ndarray) -> bool:
    """Whether an input repeats: its end goes over into its start as if it were one period of it.

    Behind a period cut anywhere else, the jump between the ends fills the spectrum above the band.
    Where the times are not even, the answer is no.
    """
    count, steps = len(force), np.diff(time)
    if np.ptp(steps) > UNEVEN * np.median(steps):
        return False
    centred = force - force.mean()
    cut = np.abs(np.fft.rfft(centred)) ** 2
    window = np.sin(np.pi * (np.arange(count) + 0.5) / count) ** 4
    shaped = np.abs(np.fft.rfft(centred * window)) ** 2 / np.mean(window**2)
    total = np.asarray(np.cumsum(shaped), float)
    if total[-1] == 0:
        return True
    last = int(np.sum(total < 0.999 * total[-1]))
    edge = min(int(1.3 * last) + 8, count)
    if len(cut) - edge < count // 20:
        return False  # the band reaches up to half the sampling rate
    floor, found = float(np.mean(shaped[edge:])), float(np.mean(cut[edge:]))
    quiet = floor * (len(cut) - edge) <= QUIET * total[-1]
    return bool(quiet and found <= CLOSES * floor + 1e-20 * total[-1])

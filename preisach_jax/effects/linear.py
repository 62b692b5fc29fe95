r"""Linear time-invariant effects: one description, from which all else comes.

An effect of the input, of the output or of an auxiliary column that is linear says in
`state_space` what it is over a step in which its signal v goes straight to \(v^+\),

\[ x^+ = A x + b\,(v^+ - v), \qquad y^+ = d\,v^+ + c\,x^+, \]

with x zero at rest.  Its course over a record, its step from sample to sample, its inverse, the
generated C and the system of python-control all follow from that.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


class StateSpace(NamedTuple):
    """A linear effect over one step; A has sections on its diagonal, and nothing beside them.

    Attributes:
        a: (section, size, size) those of A: relaxations have the size 1, modes the size 2.
        b: (section, size) what a move of the signal does to the states.
        c: (..., section, size) what the states add to each output.
        d: (...) what the signal does, which is the gain at rest.
    """

    a: Array
    b: Array
    c: Array
    d: Array

    def moved(self, states: Array, rise: Array) -> Array:
        """States after a step in which the signal has moved, `(section, size)`."""
        return (self.a * states[..., None, :]).sum(-1) + self.b * rise

    def output(self, states: Array, value: Array) -> Array:
        """What comes out where the signal has a value."""
        return self.d * value + (self.c * jnp.broadcast_to(states, self.c.shape)).sum((-2, -1))


def relaxation(tau_s: Array | float, dt: Array) -> tuple[Array, Array]:
    r"""What \(\tau\dot y = v - y\) keeps of \(y - v\) in a step, and its share of the move of v.

    \[ (y - v)^+ = e^{-\Delta t/\tau} (y - v) - \tau (1 - e^{-\Delta t/\tau})/\Delta t\,(v^+ - v) \]
    """
    # dt is zero at the first sample: the safe step keeps 0/0 out of values and gradients.
    safe_dt = jnp.where(dt > 0, dt, 1.0)
    decay = jnp.exp(-safe_dt / tau_s)
    share = tau_s * -jnp.expm1(-safe_dt / tau_s) / safe_dt
    return jnp.where(dt > 0, decay, 1.0), jnp.where(dt > 0, share, 1.0)


def relaxations(tau_s: Array, dt: Array) -> tuple[Array, Array]:
    r"""A and b of low-passes side by side, whose states are \(y - v\); tau_s is `(section,)`."""
    decay, share = relaxation(tau_s, dt)
    return decay[:, None, None], -share[:, None]


def oscillators(f_hz: Array, zeta: Array, dt: Array) -> tuple[Array, Array]:
    r"""A and b of modes of unit gain side by side, of the states \(y - v\) and \(\dot y/\omega\).

    \[ \ddot y + 2\zeta\omega\dot y + \omega^2 (y - v) = 0 \]

    Arguments:
        f_hz, zeta: (section,) natural frequencies without damping, and damping ratios.
    """
    angle = 2 * jnp.pi * f_hz * jnp.where(dt > 0, dt, 1.0)
    root = jnp.sqrt(1 - zeta**2)
    decay = jnp.exp(-zeta * angle)
    cosine, sine = decay * jnp.cos(root * angle), decay * jnp.sin(root * angle) / root
    gone = 1 - cosine - zeta * sine
    a = jnp.stack([1 - gone, sine, -sine, cosine - zeta * sine], axis=-1).reshape(-1, 2, 2)
    b = jnp.stack([-(sine + 2 * zeta * gone), gone], axis=-1) / angle[:, None]
    kept, jumped = jnp.broadcast_to(jnp.eye(2), a.shape), jnp.broadcast_to(_JUMPED, b.shape)
    return jnp.where(dt > 0, a, kept), jnp.where(dt > 0, b, jumped)


_JUMPED = np.array([-1.0, 0.0])
"""b of a mode over no time, in which its output stays."""


def over_steps(state_space: Callable[[Array], StateSpace], dt: Array) -> StateSpace:
    """A linear effect over many steps, `(step,)`: A and b of each, and c and d, which stay."""
    axes: Any = (0, 0, None, None)
    return jax.vmap(state_space, out_axes=StateSpace(*axes))(dt)


def response(
    state_space: Callable[[Array], StateSpace],
    signal: Float[Array, " time"],
    time: Float[Array, " time"],
) -> Array:
    """A signal behind a linear effect that was at rest before its first sample.

    Arguments:
        state_space: the effect over a step of so many seconds.
        signal: (time,) the signal.
        time: (time,) in s, ascending.

    Returns:
        (time, ...) the outputs.
    """
    dt = jnp.diff(time, prepend=time[:1])
    steps = over_steps(state_space, dt)
    rises = jnp.diff(signal, prepend=signal[:1])

    def advance(states: Array, now: tuple[Array, ...]) -> tuple[Array, Array]:
        a, b, value, rise = now
        law = steps._replace(a=a, b=b)
        states = law.moved(states, rise)
        return states, law.output(states, value)

    rest = jnp.zeros(steps.b.shape[1:], signal.dtype)
    return jax.lax.scan(advance, rest, (steps.a, steps.b, signal, rises))[1]


def filtered(law: StateSpace, step: Array, signals: Array) -> Array:
    """`response` to many signals at once, whose states advance side by side.

    Arguments:
        law: the effect over each length of a step; A and b by length.
        step: (time,) which of them leads to each sample.
        signals: (time, signal) the signals.

    Returns:
        (time, signal) the outputs.
    """
    sections, size = law.b.shape[1:]
    rises = jnp.diff(signals, axis=0, prepend=signals[:1])

    # State by state: products of small matrices took five times as long.
    def advance(
        states: tuple[Array, ...], now: tuple[Array, Array, Array]
    ) -> tuple[tuple[Array, ...], Array]:
        a, b, rise = now
        kept = [[a[:, i, j, None] * state for j, state in enumerate(states)] for i in range(size)]
        states = tuple(sum(kept[i], b[:, i, None] * rise[None]) for i in range(size))
        added = [(law.c[:, i, None] * state).sum(axis=0) for i, state in enumerate(states)]
        return states, sum(added[1:], added[0])

    rest = (jnp.zeros((sections, signals.shape[1]), signals.dtype),) * size
    return law.d * signals + jax.lax.scan(advance, rest, (law.a[step], law.b[step], rises))[1]

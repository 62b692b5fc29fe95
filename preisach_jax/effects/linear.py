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
import scipy
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


@np.errstate(over="ignore", invalid="ignore")
def filtered(law: StateSpace, step: np.ndarray, signals: np.ndarray) -> np.ndarray:
    """`response` of known numbers to many signals: a banded triangular system for each section.

    Nothing is compiled for it, and LAPACK takes a third of the time of a scan.

    Arguments:
        law: the effect over each length of a step, in NumPy; A and b by length.
        step: (time,) which of them leads to each sample.
        signals: (time, signal) the signals.

    Returns:
        (time, signal) the outputs.
    """
    signals = np.asfortranarray(signals)  # as LAPACK takes it: each signal in one piece
    count, many = signals.shape
    rises = np.zeros_like(signals)
    np.subtract(signals[1:], signals[:-1], out=rises[1:])
    output = np.asarray(law.d) * signals
    sections, size = law.b.shape[1:]
    for section in range(sections):
        a, b = law.a[step, section], law.b[step, section]
        # Below the ones of the diagonal stands what is kept of the states of the sample before.
        bands = np.zeros((2 * size, size * count), signals.dtype, order="F")
        bands[0] = 1.0
        for row, column in np.ndindex(size, size):
            bands[size + row - column, column : size * (count - 1) : size] = -a[1:, row, column]
        moved = np.empty((size * count, many), signals.dtype, order="F")
        for row in range(size):
            np.multiply(rises, b[:, row, None], out=moved[row::size])
        (solve,) = scipy.linalg.get_lapack_funcs(("tbtrs",), (bands, moved))
        states, _ = solve(bands, moved, uplo="L", overwrite_b=True)
        for row in range(size):
            if (share := float(law.c[section, row])) != 0.0:
                output += share * states[row::size]
    return output

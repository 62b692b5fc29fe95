"""First-order low-passes for effects of one's own, exact for what goes straight between samples."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

from preisach_jax.effects.linear import StateSpace, relaxation, relaxations, response


def low_pass_step(state: Array, value: Array, dt: Array, tau_s: Array | float) -> Array:
    r"""First-order low-pass after `dt`, exact for a signal that goes straight to its new value.

    \[ \tau \dot y = v - y,\quad
       y^+ = v^+ + e^{-\Delta t/\tau} (y - v) - (v^+ - v)\,\tau (1 - e^{-\Delta t/\tau})/\Delta t \]

    Arguments:
        state: `(y, v)` stacked on the last axis: output and input after the last step.
        dt: time since the last sample, in s; zero leaves the output as it is.
        tau_s: time constant in s, positive.

    Returns:
        The new `(y, v)`.
    """
    output, last = state[..., 0], state[..., 1]
    decay, share = relaxation(tau_s, dt)
    moved = value + decay * (output - last) - share * (value - last)
    return jnp.stack([moved, value * jnp.ones_like(output)], axis=-1)


def low_passed(
    signal: Float[Array, " time"], time: Float[Array, " time"], tau_s: Array
) -> Float[Array, " time"]:
    r"""A signal behind a first-order low-pass \(\tau \dot y = x - y\) that begins at rest.

    Arguments:
        signal: (time,) signal x.
        time: (time,) in s, ascending.
        tau_s: time constant in s, positive.

    Returns:
        (time,) y, in the unit of the signal.
    """

    def state_space(dt: Array) -> StateSpace:
        one = jnp.ones((1, 1))
        return StateSpace(*relaxations(jnp.atleast_1d(tau_s), dt), one, jnp.ones(()))

    return response(state_space, signal, time)

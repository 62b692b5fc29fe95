"""First-order low-passes, exact for signals that go straight from sample to sample."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


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
    # dt is zero at the first sample: the safe step keeps 0/0 out of values and gradients.
    safe_dt = jnp.where(dt > 0, dt, 1.0)
    decay = jnp.exp(-safe_dt / tau_s)
    slope_part = (value - last) * tau_s * -jnp.expm1(-safe_dt / tau_s) / safe_dt
    moved = value + decay * (output - last) - slope_part
    return jnp.stack([jnp.where(dt > 0, moved, output), value * jnp.ones_like(output)], axis=-1)


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

    def advance(state: Array, sample: tuple[Array, Array]) -> tuple[Array, Array]:
        value, step_s = sample
        state = low_pass_step(state, value, step_s, tau_s)
        return state, state[0]

    start = jnp.stack([signal[0], signal[0]])
    return jax.lax.scan(advance, start, (signal, jnp.diff(time, prepend=time[:1])))[1]


def limited(change: Float[Array, " time"]) -> Float[Array, " time"]:
    """The lesser of each change and the last one, and zero where their signs differ.

    With what a signal bends by limited so, its corners stay corners (the minmod limiter: A. Harten,
    J. Comput. Phys. 49 (1983) 357-393).

    Arguments:
        change: (time,) changes from sample to sample; before the first one there was none.

    Returns:
        (time,) in units of the changes.
    """
    last = jnp.pad(change, (1, 0))[:-1]
    lesser = jnp.where(jnp.abs(change) < jnp.abs(last), change, last)
    return jnp.where(change * last > 0, lesser, 0.0)


def smoothed_rate(
    signal: Float[Array, " time"], time: Float[Array, " time"], tau_s: Array
) -> Float[Array, " time"]:
    r"""Rate of a signal behind a first-order low-pass, from samples that are past.

    \[ \tau \dot w = \dot x - w, \qquad
       \dot x = d_k + \frac{2t - t_{k-1} - t_k}{\Delta t_k} c_k, \quad
       d_k = \frac{x_k - x_{k-1}}{\Delta t_k}, \quad
       c_k = \tfrac12 \Delta t_k\,\bar a_k, \quad
       a_k = 2\frac{d_k - d_{k-1}}{\Delta t_k + \Delta t_{k-1}} \]

    for \(t_{k-1} < t \le t_k\), with the `limited` \(\bar a\) of a.  It is exact for a signal that
    goes straight over two intervals or more from corner to corner; that of a smooth signal is not
    half a sample late, as the difference to the sample before alone would be.

    Arguments:
        signal: (time,) signal x.
        time: (time,) in s, ascending; samples at one instant have no rate between them.
        tau_s: time constant in s, positive.

    Returns:
        (time,) w, in units of the signal per s; zero at the first sample.
    """
    dt = jnp.diff(time, prepend=time[:1])
    safe_dt = jnp.where(dt > 0, dt, 1.0)
    rate = jnp.diff(signal, prepend=signal[:1]) / safe_dt
    apart = (safe_dt + jnp.roll(safe_dt, 1)) / 2
    # Before the first interval no rate is known from which that would have changed.
    change = (jnp.diff(rate, prepend=rate[:1]) / apart).at[:2].set(0.0)
    bend = limited(change) * safe_dt / 2
    early, late = rate - bend, rate + bend

    def advance(speed: Array, sample: tuple[Array, Array, Array]) -> tuple[Array, Array]:
        begin, end, step_s = sample
        speed = low_pass_step(jnp.stack([speed, begin]), end, step_s, tau_s)[0]
        return speed, speed

    return jax.lax.scan(advance, jnp.zeros_like(rate[0]), (early, late, dt))[1]

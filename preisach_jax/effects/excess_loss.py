"""Excess loss: moving domain walls need a field by the square root of the rate of induction."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

from preisach_jax.effects.base import RATES, AddedEffect, Signals
from preisach_jax.effects.parameter import Parameter, coefficient


class ExcessLoss(AddedEffect):
    r"""A field beside the static one, where the input is the induction.

    \[ c\,\mathrm{sgn}(\dot u)\,|\dot u|^{1/2} \]

    The rate at a sample is the mean of the intervals on both sides.

    Example:
        >>> import jax, numpy as np
        >>> t = np.arange(4.0)
        >>> jax.jit(ExcessLoss().columns)(Signals(t, 4 * np.abs(t - 2), {}))[:, 0].tolist()
        [-2.0, -2.0, 0.0, 2.0]
    """

    name = "excess_loss"
    rank = 25
    in_words = "an excess loss (domain walls need a field by the root of the input's rate)"
    goes_with_speed = True
    # Other machines have no domain walls, and a root of the rate looks like any other widening.
    on_request = True
    of_field = "output"
    physics = (
        "The flux of a metallic core changes by domain walls that move, few at a time: eddy "
        "currents flow around each of them, and the faster the change, the more walls take part. "
        "So the field that they need beside the static one, and the loss of a cycle, go with the "
        "square root of the rate. The classical eddy currents of a sheet go with the rate itself, "
        "which is what viscosity has where the induction is the input."
    )
    source = (
        "G. Bertotti, Hysteresis in Magnetism, Academic Press 1998, ch. 12; G. Bertotti, IEEE "
        "Trans. Magn. 24 (1988) 621-630 (separation of losses)"
    )
    signature = (
        "loops of H over B that widen by the square root of the frequency, alike from one end of "
        "the loop to the other"
    )
    confused_with = ("viscosity", "eddy_currents", "rate_dependence")
    needs = (RATES,)
    experiment = (
        "sines of the induction of one amplitude at five or more frequencies over two decades: "
        "the loss of a cycle less that of a slow one goes with the root of the frequency, and that "
        "of classical eddy currents with the frequency"
    )

    def coefficients(self) -> tuple[Parameter, ...]:
        return (coefficient("c", "{z} s^0.5/{u}^0.5", "field for a rate of one"),)

    def columns(self, signals: Signals) -> Float[Array, "time column"]:
        step, moved = jnp.diff(signals.time), jnp.diff(signals.input)
        rate = jnp.where(step > 0, moved / jnp.where(step > 0, step, 1.0), 0.0)
        either = jnp.stack([jnp.append(rate[:1], rate), jnp.append(rate, rate[-1:])])
        rate = either.mean(axis=0)
        return (jnp.sign(rate) * jnp.sqrt(jnp.abs(rate)))[:, None]

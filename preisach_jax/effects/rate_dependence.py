"""Rate dependence: the faster the input, the wider the hysterons."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float

from preisach_jax.effects.parameter import parameter
from preisach_jax.effects.speed import SpeedWidening


class RateDependence(SpeedWidening):
    r"""Thresholds that move outward with speed: \(\alpha + \delta, \beta - \delta\).

    \[ \delta = c\,|\dot u / v|^p \]

    Arguments:
        reference_per_s: the speed v, in input units per s: the greatest of the record.
        range_u: range of the input; bounds the coefficient c, the widening at that speed.
        with_reversible: whether the reversible part lags as well, as if it had thresholds.
        with_corners: whether the input has corners, so that it turns at full speed, and the speed
            at a sample is that of the interval before it. Else the input is smooth, rests where it
            turns, and the speed is the mean of the intervals on both sides.

    Example:
        >>> import jax.numpy as jnp
        >>> t = jnp.arange(4.0)
        >>> law = RateDependence(reference_per_s=2.0, coefficient=0.5, exponent=1.0)
        >>> law.widening(jnp.abs(t - 2), t).tolist()
        [0.25, 0.25, 0.0, 0.0]
    """

    name = "rate_dependence"
    rank = 7
    in_words = "rate dependence (the faster the input, the wider the loop)"
    physics = (
        "Domain walls are damped: to switch in less time they need more field, so the thresholds "
        "move apart with the speed of the input, and the loop widens with a power of the rate. At "
        "rest nothing is left of it."
    )
    source = (
        "I. D. Mayergoyz, Mathematical Models of Hysteresis and Their Applications, Elsevier 2003, "
        "ch. 2 (dynamic models); M. Al Janaideh, S. Rakheja, C.-Y. Su, IEEE/ASME Trans. "
        "Mechatronics 16 (2011) 734-744 (thresholds that depend on the rate)"
    )
    signature = (
        "loops wider at speed on both branches, by a power of the rate below or near one; none "
        "where the input rests, and less at turning points"
    )
    confused_with = ("input_lag", "slew_limit", "eddy_currents", "log_rate", "excess_loss")
    experiment = (
        "triangles of one size at five or more rates over two decades: a lag widens the loop in "
        "proportion to the rate, a threshold that moves by its power; and steps with holds, in "
        "which a lag goes on moving and a threshold does not"
    )
    coefficient: float = parameter(
        "{u}",
        0.0,
        lambda own: 0.25 * own.range_u,
        start=lambda own: (0.01 * own.range_u,),
        meaning=lambda own: f"widening of each threshold at {own.reference_per_s:.4g} units per s",
    )
    exponent: float = parameter("1", 0.1, 2.0, start=(0.3, 0.6, 1.0), meaning="power of the rate")

    def sampled(self, step_s: float, amounts: tuple[float, ...]) -> dict[str, Any]:
        return {
            "coefficient": self.coefficient,
            "exponent": self.exponent,
            "per_sample": self.reference_per_s * step_s,
            "corners": self.with_corners,
            "reversible": self.with_reversible,
        }

    def law(self, speed: Float[Array, " time"]) -> Float[Array, " time"]:
        # A power has no derivative at rest, where there is no widening either.
        moving = speed > 1e-6
        power = jnp.where(moving, speed, 1.0) ** self.exponent
        return self.coefficient * jnp.where(moving, power, 0.0)

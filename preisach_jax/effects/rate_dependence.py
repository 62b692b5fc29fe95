"""Rate dependence: the faster the input, the wider the hysterons."""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from preisach_jax.effects.base import RATES, HysteresisEffect, Survey, Values
from preisach_jax.effects.parameter import Parameter


class RateDependence(HysteresisEffect):
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
        >>> values = {"coefficient": 0.5, "exponent": 1.0}
        >>> RateDependence(reference_per_s=2.0).widening(values, jnp.abs(t - 2), t).tolist()
        [0.25, 0.25, 0.0, 0.0]
    """

    name: ClassVar[str] = "rate_dependence"
    goes_with_speed: ClassVar[bool] = True
    physics: ClassVar[str] = (
        "Domain walls are damped: to switch in less time they need more field, so the thresholds "
        "move apart with the speed of the input, and the loop widens with a power of the rate. At "
        "rest nothing is left of it."
    )
    source: ClassVar[str] = (
        "I. D. Mayergoyz, Mathematical Models of Hysteresis and Their Applications, Elsevier 2003, "
        "ch. 2 (dynamic models); M. Al Janaideh, S. Rakheja, C.-Y. Su, IEEE/ASME Trans. "
        "Mechatronics 16 (2011) 734-744 (thresholds that depend on the rate)"
    )
    signature: ClassVar[str] = (
        "loops wider at speed on both branches, by a power of the rate below or near one; none "
        "where the input rests, and less at turning points"
    )
    confused_with: ClassVar[tuple[str, ...]] = (
        "input_lag",
        "slew_limit",
        "eddy_currents",
        "log_rate",
    )
    needs: ClassVar[tuple[str, ...]] = (RATES,)
    experiment: ClassVar[str] = (
        "triangles of one size at five or more rates over two decades: a lag widens the loop in "
        "proportion to the rate, a threshold that moves by its power; and steps with holds, in "
        "which a lag goes on moving and a threshold does not"
    )
    reference_per_s: float = 1.0
    range_u: float = 1.0
    with_reversible: bool = eqx.field(static=True, default=False)
    with_corners: bool = eqx.field(static=True, default=False)

    def parameters(self) -> tuple[Parameter, ...]:
        return (
            Parameter(
                "coefficient",
                "{u}",
                0.0,
                0.25 * self.range_u,
                start=(0.01 * self.range_u,),
                meaning=f"widening of each threshold at {self.reference_per_s:.4g} units per s",
            ),
            Parameter(
                "exponent", "1", 0.1, 2.0, start=(0.3, 0.6, 1.0), meaning="power of the rate"
            ),
        )

    def bound_to(self, survey: Survey) -> RateDependence:
        if len(survey.time) < 2:
            return self
        speed = survey.speeds
        fastest, swing = float(np.quantile(speed, 0.99)), float(np.ptp(survey.input))
        return RateDependence(reference_per_s=fastest or swing / survey.step_s, range_u=swing)

    def variants(self, survey: Survey) -> tuple[RateDependence, ...]:
        bound = self.bound_to(survey)
        forms = ((False, False), (True, True), (True, False), (False, True))
        return tuple(
            type(self)(bound.reference_per_s, bound.range_u, reversible, corners)
            for reversible, corners in forms
        )

    @property
    def widens_reversible(self) -> bool:
        return self.with_reversible

    def widening(
        self, values: Values, path: Float[Array, " time"], time: Float[Array, " time"]
    ) -> Float[Array, " time"]:
        width = 1 if self.with_corners else 2
        dt = time[width:] - time[:-width]
        speed = jnp.abs(path[width:] - path[:-width]) / jnp.where(dt > 0, dt, 1.0)
        last = speed[-1:] if width == 2 else speed[:0]
        speed = jnp.concatenate([speed[:1], speed, last]) / self.reference_per_s
        return self.law(values, speed)

    def law(self, values: Values, speed: Float[Array, " time"]) -> Float[Array, " time"]:
        """By how much thresholds move outward at a speed over the reference."""
        # A power has no derivative at rest, where there is no widening either.
        moving = speed > 1e-6
        power = jnp.where(moving, speed, 1.0) ** values["exponent"]
        return values["coefficient"] * jnp.where(moving, power, 0.0)

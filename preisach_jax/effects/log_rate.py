"""Widening of the loop by the logarithm of the rate, over decades."""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array

from preisach_jax.effects.base import Survey, Values
from preisach_jax.effects.parameter import Parameter
from preisach_jax.effects.rate_dependence import RateDependence


class LogRate(RateDependence):
    r"""Thresholds that move outward with the logarithm of the speed.

    \[ \delta = c\,\log_{10}(1 + |\dot u| / v_0) \]

    Arguments:
        reference_per_s: greatest speed of the record, in input units per s, below which \(v_0\) is
            searched.
        range_u: range of the input; bounds the coefficient c, the widening by a decade of speed.
        with_reversible, with_corners: as for `RateDependence`.

    Example:
        >>> t = jnp.arange(4.0)
        >>> values = {"coefficient": 0.5, "slow_speed": 0.25}
        >>> LogRate(with_corners=True).widening(values, 2.25 * t, t).tolist()
        [0.5, 0.5, 0.5, 0.5]
    """

    name: ClassVar[str] = "log_rate"
    special: ClassVar[bool] = True
    physics: ClassVar[str] = (
        "A domain wall or a polar region leaves a barrier by thermal activation: over a wait ten "
        "times as short, it needs a field that is higher by a constant. So thresholds move apart "
        "with the logarithm of the rate over many decades, in relaxors, ferroelectrics, hard "
        "magnets and viscoelastic solids."
    )
    source: ClassVar[str] = (
        "G. Bertotti, Hysteresis in Magnetism, Academic Press 1998, ch. 14 (thermal relaxation: "
        "coercive field by the logarithm of the rate); M. Vopsaroiu, J. Blackburn, M. G. Cain, "
        "P. M. Weaver, Phys. Rev. B 82 (2010) 024109 (thermally activated switching)"
    )
    signature: ClassVar[str] = (
        "loops wider by a constant for each decade of the rate, on both branches"
    )
    confused_with: ClassVar[tuple[str, ...]] = ("rate_dependence", "creep", "operator_creep")
    experiment: ClassVar[str] = (
        "triangles of one size at five or more rates over three decades: the width goes by the "
        "logarithm of the rate or by a power of it"
    )

    def parameters(self) -> tuple[Parameter, ...]:
        return (
            Parameter(
                "coefficient",
                "{u}",
                0.0,
                0.1 * self.range_u,
                start=(0.005 * self.range_u,),
                meaning="widening of each threshold by a decade of the rate",
            ),
            Parameter(
                "slow_speed",
                "{u}/s",
                1e-6 * self.reference_per_s,
                0.03 * self.reference_per_s,
                start=(3e-4 * self.reference_per_s, 1e-2 * self.reference_per_s),
                log=True,
                meaning="speed below which there is no widening",
                open_ended=True,
            ),
        )

    def bound_to(self, survey: Survey) -> LogRate:
        bound = super().bound_to(survey)
        return LogRate(bound.reference_per_s, bound.range_u)

    def law(self, values: Values, speed: Array) -> Array:
        return values["coefficient"] * jnp.log10(
            1 + speed * (self.reference_per_s / values["slow_speed"])
        )

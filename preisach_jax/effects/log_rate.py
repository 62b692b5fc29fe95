"""Widening of the loop by the logarithm of the rate, over decades."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array

from preisach_jax.effects.parameter import parameter
from preisach_jax.effects.speed import SpeedWidening


class LogRate(SpeedWidening):
    r"""Thresholds that move outward with the logarithm of the speed.

    \[ \delta = c\,\log_{10}(1 + |\dot u| / v_0) \]

    Arguments:
        reference_per_s: greatest speed of the record, in input units per s, below which \(v_0\) is
            searched.
        range_u: range of the input; bounds the coefficient c, the widening by a decade of speed.
        with_reversible, with_corners: as for `SpeedWidening`.

    Example:
        >>> t = jnp.arange(4.0)
        >>> law = LogRate(with_corners=True, coefficient=0.5, slow_speed=0.25)
        >>> law.widening(2.25 * t, t).tolist()
        [0.5, 0.5, 0.5, 0.5]
    """

    name = "log_rate"
    rank = 23
    in_words = "a widening of the loop with the logarithm of the rate"
    special = True
    physics = (
        "A domain wall or a polar region leaves a barrier by thermal activation: over a wait ten "
        "times as short, it needs a field that is higher by a constant. So thresholds move apart "
        "with the logarithm of the rate over many decades, in relaxors, ferroelectrics, hard "
        "magnets and viscoelastic solids."
    )
    source = (
        "G. Bertotti, Hysteresis in Magnetism, Academic Press 1998, ch. 14 (thermal relaxation: "
        "coercive field by the logarithm of the rate); M. Vopsaroiu, J. Blackburn, M. G. Cain, "
        "P. M. Weaver, Phys. Rev. B 82 (2010) 024109 (thermally activated switching)"
    )
    signature = "loops wider by a constant for each decade of the rate, on both branches"
    confused_with = ("rate_dependence", "creep", "operator_creep")
    experiment = (
        "triangles of one size at five or more rates over three decades: the width goes by the "
        "logarithm of the rate or by a power of it"
    )

    coefficient: float = parameter(
        "{u}",
        0.0,
        lambda own: 0.1 * own.range_u,
        start=lambda own: (0.005 * own.range_u,),
        meaning="widening of each threshold by a decade of the rate",
    )
    slow_speed: float = parameter(
        "{u}/s",
        lambda own: 1e-6 * own.reference_per_s,
        lambda own: 0.03 * own.reference_per_s,
        log=True,
        start=lambda own: (3e-4 * own.reference_per_s, 1e-2 * own.reference_per_s),
        meaning="speed below which there is no widening",
        open_ended="both",
    )

    def law(self, speed: Array) -> Array:
        return self.coefficient * jnp.log10(1 + speed * (self.reference_per_s / self.slow_speed))

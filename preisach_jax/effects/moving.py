"""Moving model: the output acts back on the input of the hysterons."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Array, Float

from preisach_jax.effects.base import HEIGHTS, HysteresisEffect, Survey
from preisach_jax.effects.parameter import parameter


class Moving(HysteresisEffect):
    r"""Feedback of the output: \(v = u + a\,h\) drives the hysterons.

    The sum is brought back to the range of the input, so that both ends of the loop stay on the
    plane, \(x = u_0 + (u - u_0 + a h) / (1 + a H / U)\) with the ranges U of the input and H of
    the output: another scale of the thresholds, which the density takes up.

    Arguments:
        low_u, range_u: lower end u0 and range U of the input.
        range_z: range H of the output.

    Example:
        >>> import jax.numpy as jnp
        >>> ends = jnp.array([0.0, 1.0])
        >>> Moving(a=0.5).fed_back(ends, ends, ends).tolist()
        [0.0, 1.0]
    """

    name = "moving"
    rank = 9
    needs = (HEIGHTS,)
    needs_clock = False
    in_words = "feedback of the output on the material (minor loops that are not congruent)"
    feeds_back = True
    # It compensates discretisation of a coarse plane, and takes minutes on a fine one.
    on_request = True
    physics = (
        "The field that a domain feels is that from outside and that of all other domains, which "
        "goes with the magnetisation (the polarisation, the strain). Minor loops between the same "
        "inputs are then no longer congruent: their height depends on the output at which they lie."
    )
    source = (
        "E. Della Torre, IEEE Trans. Audio Electroacoust. 14 (1966) 86-92; E. Della Torre, "
        "Magnetic Hysteresis, IEEE Press 1999, ch. 4 (moving model)"
    )
    signature = (
        "minor loops of equal swing whose heights differ between the branches of the major loop; "
        "independent of time and rate"
    )
    confused_with = ("output_nonlinearity",)
    experiment = (
        "equal minor loops at five or more biases, each on both branches: a feedback changes their "
        "height with the output, a nonlinear sensor does so alike on both branches"
    )
    low_u: float = 0.0
    range_u: float = 1.0
    range_z: float = 1.0
    a: float = parameter(
        "{u}/{z}",
        lambda own: -0.4 * (own.range_u / own.range_z),
        lambda own: 1.0 * (own.range_u / own.range_z),
        meaning="input for unit output",
    )

    def bound_to(self, survey: Survey) -> Moving:
        if len(survey.time) < 2:
            return self
        swing_u, swing_z = float(np.ptp(survey.input)), float(np.ptp(survey.output))
        return replace(self, low_u=float(survey.input.min()), range_u=swing_u, range_z=swing_z)

    def sampled(self, step_s: float, amounts: tuple[float, ...]) -> dict[str, Any]:
        scale = 1 + self.a * self.range_z / self.range_u
        return {"gain": self.a, "low": self.low_u, "scale": scale}

    def fed_back(
        self,
        path: Float[Array, " time"],
        output: Float[Array, " time"],
        time: Float[Array, " time"],
    ) -> Float[Array, " time"]:
        moved = path - self.low_u + self.a * output
        return self.low_u + moved / (1 + self.a * self.range_z / self.range_u)

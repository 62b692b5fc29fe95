"""Coarse converter of the output."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from preisach_jax.effects.base import SensorEffect, Survey
from preisach_jax.effects.parameter import parameter
from preisach_jax.record.course import lattice_step

RESOLVED = 1e-3
"""Relative half width of the bounds around the step that the record shows."""


class OutputQuantisation(SensorEffect):
    r"""Reading in the steps of a converter: \(z = q\,\mathrm{round}(h / q)\).

    Arguments:
        step_z: the step that the record shows; `bound_to` reads it off the output.

    Example:
        >>> import jax.numpy as jnp
        >>> OutputQuantisation(quantum=0.5).converted(jnp.array([0.2, 0.3])).tolist()
        [0.0, 0.5]
    """

    name = "output_quantisation"
    rank = 17
    needs_clock = False
    in_words = "coarse steps of the sensor's converter"
    physics = (
        "The converter behind the sensor has steps. Where they are greater than the noise, the "
        "reading stands still and jumps; what is lost in between no model can bring back, but a "
        "model that knows the steps predicts the readings."
    )
    source = "B. Widrow, I. Kollár, Quantization Noise, Cambridge University Press 2008, ch. 4"
    signature = "a residual spread evenly over one step; readings that come again exactly"
    confused_with = ("input_quantisation",)
    experiment = (
        "a slow ramp over a few steps: readings come again exactly with a coarse sensor, and the "
        "output itself moves in jumps with a coarse drive; or a finer range of the converter"
    )
    step_z: float = 1e-9
    quantum: float = parameter(
        "{z}",
        lambda own: own.step_z * (1 - RESOLVED),
        lambda own: own.step_z * (1 + RESOLVED),
        start=lambda own: (own.step_z,),
        meaning="step of the reading",
        name="step",
    )

    def bound_to(self, survey: Survey) -> OutputQuantisation:
        fine = 1e-9 * float(np.ptp(survey.output)) if len(survey.output) else self.step_z
        return OutputQuantisation(lattice_step(survey.output) or fine or 1e-9)

    @property
    def resolution(self) -> float:
        return self.quantum

    def sampled(self, step_s: float, amounts: tuple[float, ...]) -> dict[str, Any]:
        return {"step": self.quantum}

    def converted(self, reading: Float[Array, " time"]) -> Float[Array, " time"]:
        return self.quantum * jnp.round(reading / self.quantum)

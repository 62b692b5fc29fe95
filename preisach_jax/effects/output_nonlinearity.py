"""Nonlinear output: the sensor, or what saturates, bends the whole loop alike."""

from typing import ClassVar

import jax.numpy as jnp
import numpy as np

from preisach_jax.effects.base import Parameter, SensorEffect, Survey


class OutputNonlinearity(SensorEffect):
    r"""Memoryless map of the output, written backwards: \(z - c_2 P_2(x) - c_3 P_3(x) = h\).

    P are Legendre polynomials of the reading over its range, \(x = 2 (z - z_0)/Z - 1\).

    Arguments:
        low_z, range_z: lower end and range of the reading.

    Example:
        >>> [c.name for c in OutputNonlinearity().coefficients()]
        ['c_2', 'c_3']
    """

    name: ClassVar[str] = "output_nonlinearity"
    physics: ClassVar[str] = (
        "The reading is not in proportion to the displacement: a capacitive or inductive sensor "
        "away from its calibration, a lever, a material near saturation. Whatever the history, "
        "equal outputs are bent alike."
    )
    source: ClassVar[str] = (
        "A. J. Fleming, Sens. Actuators A 190 (2013) 106-126 (sensors of nanopositioning systems); "
        "L. Ljung, System Identification, 2nd ed., Prentice Hall 1999, sec. 5.2 (Wiener models)"
    )
    signature: ClassVar[str] = (
        "a smooth curve against the output, the same on both branches; most of it is absorbed by "
        "the density, what is left shows in minor loops"
    )
    confused_with: ClassVar[tuple[str, ...]] = ("moving",)
    experiment: ClassVar[str] = (
        "calibrate the sensor against another; or equal minor loops at five or more biases on both "
        "branches"
    )
    low_z: float = 0.0
    range_z: float = 1.0

    def parameters(self):
        return ()

    def coefficients(self):
        return tuple(
            Parameter(f"c_{k}", "{z}", -jnp.inf, jnp.inf, meaning=f"amplitude of the {name} part")
            for k, name in ((2, "quadratic"), (3, "cubic"))
        )

    def bound_to(self, survey: Survey):
        if len(survey.time) < 2:
            return self
        return OutputNonlinearity(float(survey.output.min()), float(np.ptp(survey.output)))

    def columns(self, values, reading):
        x = 2 * (reading - self.low_z) / self.range_z - 1
        return jnp.stack([(3 * x**2 - 1) / 2, (5 * x**3 - 3 * x) / 2], axis=-1)

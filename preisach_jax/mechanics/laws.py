"""Hysteretic restoring forces of a displacement."""

from __future__ import annotations

from typing import Any, Protocol

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from preisach_jax.operator.plane import Plane, hysteron_step


class Law(Protocol):
    """A force that depends on the path of a displacement, and not on how fast it is passed."""

    def force(self, memory: Array, z: Array) -> Array:
        """Force at a displacement that is reached on a monotone path from that of the memory."""
        ...

    def rate(self, memory: Array, speed: Array) -> Array:
        """Time derivative of a memory that moves with the displacement; zero if it does not."""
        ...

    def committed(self, memory: Array, z: Array) -> Array:
        """The memory once the displacement has come to z on a monotone path."""
        ...

    def mark(self, memory: Array) -> Array:
        """Linear function of the memory at whose zero the slope of the force jumps, if any."""
        ...


class OneState(eqx.Module):
    r"""Bouc-Wen law: one state, \(dy/dz = [1 - |y|^n (\beta\,\mathrm{sgn}(y\,dz) + \gamma)]/Z\).

    The force is \(H = K_h Z y\): a spring of stiffness \(K_h\) that yields where the bracket
    falls, and stiffens where it rises.  The memory is \(y\), `(1,)`.
    """

    stiffness: Array
    range_z: Array
    beta: Array
    gamma: Array
    exponent: Array

    def force(self, memory: Float[Array, " 1"], z: Array) -> Array:
        del z
        return self.stiffness * self.range_z * memory[0]

    def rate(self, memory: Float[Array, " 1"], speed: Array) -> Float[Array, " 1"]:
        # The power of zero has no derivative with respect to the exponent.
        away = memory != 0
        size = jnp.where(away, jnp.abs(jnp.where(away, memory, 1.0)) ** self.exponent, 0.0)
        bent = self.beta * jnp.abs(speed) * jnp.sign(memory) + self.gamma * speed
        return (speed - size * bent) / self.range_z

    def committed(self, memory: Float[Array, " 1"], z: Array) -> Float[Array, " 1"]:
        del z
        return memory

    def mark(self, memory: Float[Array, " 1"]) -> Array:
        return memory[0]


class Operator(eqx.Module):
    """The Preisach operator of the displacement, with ramp hysterons.

    The memory is the states of the hysterons, `(cells,)`.  The force is counted from that of the
    middle of all states, so that a demagnetised operator gives none at the middle of its plane.

    Arguments:
        weights: (cells,) weights, in units of force.
    """

    plane: Plane
    weights: Float[Array, " cells"]

    def demagnetised(self, dtype: Any) -> Float[Array, " cells"]:
        """States of an operator demagnetised around the middle of its plane."""
        total = np.asarray(self.plane.alpha_index) + np.asarray(self.plane.beta_index)
        middle = self.plane.levels - 1
        return jnp.asarray(np.where(total == middle, 0.5, total < middle), dtype)

    def force(self, memory: Float[Array, " cells"], z: Array) -> Array:
        return jnp.sum(self.weights * (self.committed(memory, z) - 0.5))

    def rate(self, memory: Float[Array, " cells"], speed: Array) -> Float[Array, " cells"]:
        del speed
        return jnp.zeros_like(memory)

    def committed(self, memory: Float[Array, " cells"], z: Array) -> Float[Array, " cells"]:
        return hysteron_step(self.plane, memory, z, z, "ramp")

    def mark(self, memory: Float[Array, " cells"]) -> Array:
        return jnp.zeros_like(memory[0])

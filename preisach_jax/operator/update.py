"""What an error does to the weights: the step of the paper's rule, (8), (12), and its options."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.typing import ArrayLike


class UpdateRule(eqx.Module):
    """The step R̂ ← R̂ + μ ê s/(sᵀs) of an update (a pytree).

    The error ê that is used is e, without update where |e| ≤ the dead zone, and cut off at ± the
    limit. Without options it is the paper's rule.

    Arguments:
        step_size: () or (lanes,) step size μ; 0 learns nothing.
        dead_zone: () or (lanes,) size of errors that update nothing, in the unit of the output.
        error_limit: () or (lanes,) size at which errors are cut off, same unit.
        nonnegative: whether weights that fall below 0 are set to 0.
    """

    step_size: ArrayLike = 1.0
    dead_zone: ArrayLike | None = None
    error_limit: ArrayLike | None = None
    nonnegative: bool = eqx.field(static=True, default=False)

    def learns(self, error: jax.Array) -> jax.Array:
        """Tell which errors update the weights."""
        if self.dead_zone is None:
            return jnp.ones_like(error, bool)
        return jnp.abs(error) > self.dead_zone

    def rate(self, error: jax.Array, squared: ArrayLike) -> jax.Array:
        """The factor of s in an update, μ ê/(sᵀs).

        Arguments:
            error: e, any shape that broadcasts with the settings, in the unit of the output.
        """
        if self.error_limit is not None:
            limit = jnp.asarray(self.error_limit, error.dtype)
            error = jnp.clip(error, -limit, limit)
        return jnp.divide(jnp.multiply(self.step_size, error), squared)

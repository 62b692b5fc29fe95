"""Cells of the plane by number, and laid out in rows and columns."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike

from preisach_jax.operator.plane import Plane


def flat_index(alpha_index: ArrayLike, beta_index: ArrayLike) -> jax.Array:
    """Flat index i(i+1)/2 + j of a cell."""
    i = jnp.asarray(alpha_index)
    return i * (i + 1) // 2 + jnp.asarray(beta_index)


def laid_out(plane: Plane, values: ArrayLike) -> jax.Array:
    """Lay values of the cells out on the plane, for sums along its rows and columns.

    Arguments:
        values: (cells,) one value a cell.

    Returns:
        (levels, levels) matrix, row α index, column β index; 0 where α < β.
    """
    values = jnp.asarray(values)
    matrix = jnp.zeros((plane.levels, plane.levels), values.dtype)
    return matrix.at[plane.alpha_index, plane.beta_index].set(values)

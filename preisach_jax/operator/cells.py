"""Cells of the plane by number, and laid out in rows and columns."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike

from preisach_jax.operator.plane import Plane


def flat_index(alpha_index: ArrayLike, beta_index: ArrayLike) -> jax.Array:
    """Flat index i(i+1)/2 + j of a cell.

    Arguments:
        alpha_index: row i of the plane, any shape.
        beta_index: column j ≤ i, a shape that broadcasts with it.

    Returns:
        Index of the cell, in the common shape.

    Example:
        >>> int(flat_index(2, 1)), int(Plane(levels=5, low=0.0, high=1.0).alpha_index[4])
        (4, 2)
    """
    i = jnp.asarray(alpha_index)
    return i * (i + 1) // 2 + jnp.asarray(beta_index)


def laid_out(plane: Plane, values: ArrayLike) -> jax.Array:
    """Lay values of the cells out on the plane, for sums along its rows and columns.

    Arguments:
        plane: the Preisach plane.
        values: (cells,) one value a cell.

    Returns:
        (levels, levels) matrix, row α index, column β index; 0 where α < β.

    Example:
        >>> laid_out(Plane(levels=2, low=0.0, high=1.0), [1.0, 2.0, 3.0]).tolist()
        [[1.0, 0.0], [2.0, 3.0]]
    """
    values = jnp.asarray(values)
    matrix = jnp.zeros((plane.levels, plane.levels), values.dtype)
    return matrix.at[plane.alpha_index, plane.beta_index].set(values)

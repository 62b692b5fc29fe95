"""The Preisach operator from branch to branch: work that does not grow with the plane.

After a turning point the output differs from the one there by twice the Everett function, until the
input has wiped the turning point out; then the branch goes on from an earlier one (return-point
memory, Mayergoyz). So each output needs the sample that its branch departs from, which a stack of
the nested extremes yields in some operations a sample, and one value of the Everett function, which
is bilinear within a cell of the plane. Relays see the input as whole levels.
"""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from preisach_jax.operator.cells import laid_out
from preisach_jax.operator.checks import as_float, require_hysteron
from preisach_jax.operator.events import moves_of, relay_levels
from preisach_jax.operator.hysteron import position_on
from preisach_jax.operator.plane import Plane

_Nesting = tuple[jax.Array, jax.Array, jax.Array, jax.Array | bool, jax.Array]
"""Turning points not wiped out yet, their values and number, the direction, and the last value."""


def branch_starts(path: ArrayLike) -> jax.Array:
    """Find, for each sample of a path, the turning point from which its branch departs.

    That is the last one that the path has not wiped out by reaching beyond it; at a turning point
    it is still the one before.

    Arguments:
        path: (time,) values; the first is the lowest there can be.

    Returns:
        (time,) index of a sample; 0 for the first branch.
    """
    path = jax.lax.stop_gradient(as_float(path, "path"))
    index = jnp.arange(path.shape[0], dtype=jnp.int32)

    def advance(carry: _Nesting, sample: tuple[jax.Array, jax.Array]) -> tuple[_Nesting, jax.Array]:
        nested, values, depth, rose, before = carry
        k, now = sample
        rises = jnp.where(now == before, rose, now > before)
        turns = rises != rose
        depth = depth + turns
        nested = nested.at[depth].set(jnp.where(turns, k - 1, nested[depth]))
        values = values.at[depth].set(jnp.where(turns, before, values[depth]))

        def closes_a_loop(depth: jax.Array) -> jax.Array:
            other = values[depth - 1]
            return (depth >= 2) & jnp.where(rises, now >= other, now <= other)

        def one_loop_less(depth: jax.Array) -> jax.Array:
            return depth - 2

        depth = jax.lax.while_loop(closes_a_loop, one_loop_less, depth)
        return (nested, values, depth, rises, now), nested[depth]

    start: _Nesting = (
        jnp.zeros_like(index),
        jnp.full_like(path, path[0]),
        jnp.int32(0),
        True,
        path[0],
    )
    return jax.lax.scan(advance, start, (index, path))[1]


def weight_between(
    plane: Plane, weights: jax.Array, upper: jax.Array, lower: jax.Array
) -> jax.Array:
    """Weight of the hysterons that switch between two positions, twice the Everett function.

    2E = Σ R max(ρ_i(upper) - ρ_j(lower), 0) in constant time, from sums of weights above, right of,
    and above and right of each cell, of which ramps take a part.

    Arguments:
        weights: (cells,) weights R, in the unit of the output.

    Returns:
        Weights in that shape, in the unit of the output.
    """
    last = plane.levels - 1
    i = jnp.minimum(upper.astype(jnp.int32), last)
    j = jnp.minimum(lower.astype(jnp.int32), last)
    part_of_row, part_of_column = upper - i, 1.0 - (lower - j)

    matrix = laid_out(plane, weights)
    beyond = jnp.pad(jnp.cumsum(matrix[:, :0:-1], axis=1)[:, ::-1], ((0, 0), (0, 1)))
    tables = jnp.stack([beyond, matrix])
    before = jnp.pad(jnp.cumsum(tables[:, :-1], axis=1), ((0, 0), (1, 0), (0, 0)))
    # Of whole rows whole cells and cells of column j; of row i whole cells and the one in column j.
    whole, column, row, corner = (
        table.ravel().at[i * plane.levels + j].get(mode="promise_in_bounds")
        for table in (*before, *tables)
    )
    of_corner = jnp.maximum(part_of_row + part_of_column - 1.0, 0.0)
    return whole + part_of_column * column + part_of_row * row + of_corner * corner


def output_along_branches(
    plane: Plane, weights: ArrayLike, x: ArrayLike, hysteron: str = "ramp", initial: str = "low"
) -> jax.Array:
    """Output of the Preisach model, eq. (6), from the turning points of the input.

    z(k) = z(p) ± 2E(x(k), x(p)), where the branch of sample k departs from sample p.  The sums
    along nested branches double their reach log₂(time) times. Work and memory do not depend on the
    plane.

    Arguments:
        weights: (cells,) weights R, in the unit of the output.
        x: (time,) input, in the unit of the plane; beyond it hysterons saturate.

    Returns:
        (time,) output, in the unit of the weights; differentiable in them, and with ramps in `x`.
    """
    require_hysteron(hysteron)
    weights, x = as_float(weights, "weights"), as_float(x, "the input x")
    past = plane.initial_turns(initial, hysteron).astype(x.dtype)
    if hysteron == "ramp":
        return output_after(plane, weights, past, x)
    levels = relay_levels(plane, x, int(past[-1]))
    if isinstance(levels, jax.Array):
        return _output(plane, weights, past, levels.astype(x.dtype))
    # With a known input only the samples that move the level count.
    until = np.cumsum(np.diff(levels, prepend=levels[0]) != 0, dtype=np.int32)
    moves = np.append(levels[0], moves_of(levels)[1]).astype(x.dtype)
    return _output(plane, weights, past, jnp.asarray(moves), jnp.asarray(until))


def output_after(plane: Plane, weights: jax.Array, past: ArrayLike, x: jax.Array) -> jax.Array:
    """Output of ramps along an input that comes after some turning points.

    Arguments:
        weights: (cells,) weights R, in the unit of the output.
        past: (turns,) turning points before it, as positions (x - low)/δx; the first is 0, and one
            that is there twice is no other memory, but lets memories share what is compiled.
        x: (time,) input, in the unit of the plane; beyond it hysterons saturate.

    Returns:
        (time,) output, in the unit of the weights; differentiable in them and in `x`.
    """
    position = jnp.clip(position_on(plane, x), 0.0, plane.levels)
    return _output(plane, weights, jnp.asarray(past, x.dtype), position)


@eqx.filter_jit
def _output(
    plane: Plane,
    weights: jax.Array,
    past: np.ndarray | jax.Array,
    path: jax.Array,
    samples: Any = slice(None),
) -> jax.Array:
    path = jnp.concatenate([past, path])
    start = branch_starts(path)
    there = path[start]
    between = weight_between(plane, weights, jnp.maximum(path, there), jnp.minimum(path, there))
    rises = jnp.where(path > there, between, jnp.where(path < there, -between, 0.0))

    def reach_further(
        carry: tuple[jax.Array, jax.Array], _: None
    ) -> tuple[tuple[jax.Array, jax.Array], None]:
        output, start = carry
        return (output + output[start], start[start]), None

    rounds = max(path.shape[0] - 1, 1).bit_length()
    output = jax.lax.scan(reach_further, (rises, start), length=rounds)[0][0]
    return output[past.shape[0] :][samples]

"""The Preisach model's output along an input, eq. (6): dense, or from branch to branch.

After a turning point the output differs from the one there by twice the Everett function, until the
input has wiped the turning point out; then the branch goes on from an earlier one (return-point
memory, Mayergoyz). So each output needs the sample that its branch departs from, which a stack of
the nested extremes yields in some operations a sample, and one value of the Everett function, which
is bilinear within a cell of the plane: work that does not grow with the plane. Relays see the input
as whole levels.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jax.typing import ArrayLike

from preisach_jax.errors import InputError
from preisach_jax.operator.events import moves_of, relay_levels
from preisach_jax.operator.inputs import as_float, require_hysteron
from preisach_jax.operator.plane import Plane, hysteron_step, laid_out, position_on
from preisach_jax.operator.states import as_path, path_and_start, require_plane

FORMS = ("auto", "dense", "event")

LEAST_MOVES = 65
"""To which fewer are filled up, so that short inputs share what is compiled."""


def simulate(
    plane: Plane,
    weights: ArrayLike,
    x: ArrayLike,
    hysteron: str = "ramp",
    initial: ArrayLike | str = "low",
    form: str = "auto",
) -> jax.Array:
    """Simulate the Preisach model.

    z(k) = Σ R_i y_i(k), eq. (6), with states 0 and 1 (relays) or between (ramps). The dense form
    advances all states at every sample. It needs memory for the states of one sample; its gradient,
    for 2√time of them. The event form goes from one turning point of the input to the next, and
    does not become slower with the number of hysterons (`output_along_branches`).

    Arguments:
        plane: the Preisach plane.
        weights: (cells,) weights R, in the unit of the output.
        x: (time,) input, in the unit of the plane.
        hysteron: "relay" or "ramp".
        initial: (cells,) states before the first sample, or the name of an initial memory (see
            `Plane.initial_states`).
        form: "dense", "event", or "auto": the event form where it can be had, which is from any
            named initial memory.

    Returns:
        (time,) output; differentiable in `weights`, and with ramps in `x`.

    Raises:
        InputError: a shape, a type or a name is wrong, there is no event form, or the input leaves
            the plane or is not finite (inside a compiled function hysterons saturate instead).

    Example:
        >>> plane = Plane(levels=2, low=0.0, high=2.0)
        >>> simulate(plane, [1.0, 2.0, 4.0], [0.0, 2.0, 1.0, 0.0]).tolist()
        [0.0, 7.0, 3.0, 0.0]
    """
    require_plane(plane)
    weights = as_float(weights, "weights")
    if weights.shape != (plane.cells,):
        raise InputError(f"weights has the shape {weights.shape}: give ({plane.cells},)")
    x = as_path(plane, x)
    if not isinstance(initial, str):
        chosen_form(form, "from initial states of one's own")
        return _simulate(plane, weights, x, hysteron, as_float(initial, "initial"))
    if chosen_form(form, "") == "dense":
        return _simulate(plane, weights, x, hysteron, initial)
    return output_along_branches(plane, weights, x, hysteron, initial)


def chosen_form(form: str, why_not: str) -> str:
    """Choose between the dense form and the event form."""
    if form not in FORMS:
        raise InputError(f"form is {form!r}: it must be one of {', '.join(map(repr, FORMS))}")
    if form == "event" and why_not:
        raise InputError(f"there is no event form {why_not}: use form='auto' or 'dense'")
    return "dense" if form == "dense" or why_not else "event"


@eqx.filter_jit
def _simulate(
    plane: Plane, weights: jax.Array, x: jax.Array, hysteron: str, initial: ArrayLike | str
) -> jax.Array:
    x, start = path_and_start(plane, x, initial, hysteron)

    def advance(
        carry: tuple[jax.Array, jax.Array], value: jax.Array
    ) -> tuple[tuple[jax.Array, jax.Array], jax.Array]:
        states, previous = carry
        states = hysteron_step(plane, states, previous, value, hysteron)
        return (states, value), jnp.sum(weights * states)

    # The reverse pass recomputes the states chunk by chunk. The last chunk is filled up with an
    # input at rest, which changes nothing.
    samples = x.shape[0]
    chunk = math.isqrt(samples - 1) + 1
    chunks = -(-samples // chunk)
    filled = jnp.concatenate([x, jnp.broadcast_to(x[-1], (chunks * chunk - samples,))])
    scan_chunk = cast(Callable[..., Any], jax.checkpoint(partial(jax.lax.scan, advance)))
    output: jax.Array = jax.lax.scan(scan_chunk, (start, x[0]), filled.reshape(chunks, chunk))[1]
    return output.ravel()[:samples]


_Nesting = tuple[jax.Array, jax.Array, jax.Array, jax.Array | bool, jax.Array]
"""Turning points not wiped out yet, their values and number, the direction, and the last value."""


@eqx.filter_jit
def branch_starts(path: ArrayLike) -> jax.Array:
    """Find, for each sample of a path, the turning point from which its branch departs.

    That is the last one that the path has not wiped out by reaching beyond it; at a turning point
    it is still the one before; 0 for the first branch. The first value is the lowest there can be.
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
    """
    place, shares = _cell_between(jnp, plane, upper, lower)
    sums = _sums(jnp, laid_out(plane, weights))
    whole, column, row, corner = (
        table.ravel().at[place].get(mode="promise_in_bounds") for table in sums
    )
    of_column, of_row, of_corner = shares
    return whole + of_column * column + of_row * row + of_corner * corner


def _cell_between(xp: Any, plane: Plane, upper: Any, lower: Any) -> tuple[Any, tuple[Any, ...]]:
    """Flat index of the cell in which two positions end, and their parts of its sums."""
    last = plane.levels - 1
    i = xp.minimum(upper.astype(xp.int32), last)
    j = xp.minimum(lower.astype(xp.int32), last)
    of_row, of_column = upper - i, 1.0 - (lower - j)
    of_corner = xp.maximum(of_row + of_column - 1.0, 0.0)
    return i * plane.levels + j, (of_column, of_row, of_corner)


def _sums(xp: Any, matrix: Any) -> Any:
    """Sums of `(levels, levels, ...)` weights for each cell, `(4, levels, levels, ...)`.

    Of the rows above it whole ones, beyond its column, and in it; of its own row what is beyond it,
    and the cell itself.
    """
    rest = [(0, 0)] * (matrix.ndim - 2)
    beyond = xp.cumsum(matrix[:, :0:-1], axis=1)[:, ::-1]
    tables = xp.stack([xp.pad(beyond, [(0, 0), (0, 1), *rest]), matrix])
    before = xp.pad(xp.cumsum(tables[:, :-1], axis=1), [(0, 0), (1, 0), (0, 0), *rest])
    return xp.concatenate([before, tables])


def output_along_branches(
    plane: Plane, weights: ArrayLike, x: ArrayLike, hysteron: str = "ramp", initial: str = "low"
) -> jax.Array:
    """Output of the Preisach model, eq. (6), from the turning points of the input.

    z(k) = z(p) ± 2E(x(k), x(p)), where the branch of sample k departs from sample p.  The sums
    along nested branches double their reach log₂(time) times. Work and memory do not depend on the
    plane. The output is differentiable in the weights, and with ramps in `x`.
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
    moves = np.pad(moves, (0, max(LEAST_MOVES - len(moves), 0)), "edge")
    return _output(plane, weights, past, jnp.asarray(moves), jnp.asarray(until))


def output_after(plane: Plane, weights: jax.Array, past: ArrayLike, x: jax.Array) -> jax.Array:
    """Output of ramps along an input that comes after some turning points.

    `past` are these as (turns,) positions; the first is 0, and one that is there twice is no other
    memory, but lets memories share what is compiled.
    """
    position = jnp.clip(position_on(plane, x), 0.0, plane.levels)
    return _output(plane, weights, jnp.asarray(past, x.dtype), position)


def outputs_after(plane: Plane, weights: np.ndarray, past: np.ndarray, x: np.ndarray) -> np.ndarray:
    """`output_after` of known numbers for many weights, `(cells, vector)`: (time, vector).

    What the path asks of the sums of the weights is a sparse matrix, four numbers a sample.
    """
    levels, vectors = plane.levels, weights.shape[1]
    matrix = np.zeros((levels, levels, vectors))
    matrix[plane.alpha_index, plane.beta_index] = weights
    position: np.ndarray = np.clip(position_on(plane, x), 0.0, levels)
    path: np.ndarray = np.concatenate([past, position])
    start: np.ndarray = np.asarray(branch_starts(path))
    there = path[start]
    place, parts = _cell_between(np, plane, np.maximum(path, there), np.minimum(path, there))
    shares = np.stack([np.ones_like(path), *parts], axis=1) * np.sign(path - there)[:, None]
    places = place[:, None] + levels**2 * np.arange(4)
    asked = scipy.sparse.csr_array(
        (shares.ravel(), places.ravel(), 4 * np.arange(len(path) + 1)),
        shape=(len(path), 4 * levels**2),
    )
    output = asked @ _sums(np, matrix).reshape(-1, vectors)
    turns, branch = np.unique(start, return_inverse=True)
    at_turns, leads = output[turns], branch[turns].tolist()
    for turn in range(1, len(turns)):
        at_turns[turn] += at_turns[leads[turn]]
    output += at_turns[branch]
    return output[len(past) :]


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

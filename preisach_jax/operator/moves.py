"""The paper's rule for ramps, (8), (12): which line of the plane each sample moves, and its update.

Every sample moves ramps, but only those that it is passing: while the input rises through cell m of
its axis the ramps of row m, while it falls through it those of column m. So a sample costs O(N),
and once more for each cell of the axis that it leaves behind.
"""

from __future__ import annotations

import math
from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from preisach_jax.operator.events import rounded_up
from preisach_jax.operator.plane import Plane, flat_index, position_on

EVENT_SIZE = 0.5
"""An event is a sample by which the states have moved by sᵀs ≥ 1/2 since the last one.

For relays that is any switch, as sᵀs = A is then a whole number. For ramps it bounds what noise ν
of the output does to the weights, |ν|/√(sᵀs), while a move of the input by δx always reaches it.
"""

MOVES_TO_REFRESH = 1024
"""After so many moves at most, what is summed up along them is summed afresh over the plane, so
that rounding does not pile up in it."""


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
        """The factor of s in an update, μ ê/(sᵀs)."""
        if self.error_limit is not None:
            limit = jnp.asarray(self.error_limit, error.dtype)
            error = jnp.clip(error, -limit, limit)
        return jnp.divide(jnp.multiply(self.step_size, error), squared)


class RampMoves(eqx.Module):
    """The moves that an input makes ramps do (a pytree).

    Attributes:
        line: (moves,) row that is passed upward, or column that is passed downward.
        rising: (moves,) which of the two.
        part: (moves,) how far the input is in that cell of its axis, 0 to 1; rising, no ramp of the
            row is below it then, falling, none of the column above.
        ends: (samples,) the last move of each sample.
    """

    line: jax.Array
    rising: jax.Array
    part: jax.Array
    ends: jax.Array

    def cells(self, plane: Plane) -> jax.Array:
        """(levels,) flat indices of the cells of a line, filled up with `plane.cells`."""
        along = jnp.arange(plane.levels)
        row = jnp.where(along <= self.line, flat_index(self.line, along), plane.cells)
        column = jnp.where(along >= self.line, flat_index(along, self.line), plane.cells)
        return jnp.where(self.rising, row, column)


def ramp_moves(plane: Plane, x: ArrayLike) -> RampMoves:
    """Find the moves that a known (time,) input makes ramps do."""
    x = np.asarray(x, np.result_type(np.asarray(x), np.float32))
    position = np.clip(position_on(plane, x), 0.0, plane.levels).astype(x.dtype)
    before = np.append(position[:1], position[:-1])
    rising = position > before
    last = plane.levels - 1
    up = np.minimum(np.floor(before), last), np.ceil(position) - 1
    down = np.maximum(np.ceil(before) - 1, 0), np.floor(position)
    first, final = (np.where(rising, one, other) for one, other in zip(up, down, strict=True))
    # An input that rests moves nothing.
    final = np.where(position == before, first, final)
    count = np.abs(final - first).astype(int) + 1
    ends = np.cumsum(count) - 1
    sample = np.repeat(np.arange(len(x)), count)
    passed = np.arange(len(sample)) - np.repeat(ends - count + 1, count)
    line = first[sample] + np.where(rising, 1, -1)[sample] * passed
    part = np.clip(position[sample] - line, 0.0, 1.0)
    part = np.where((position == before)[sample], 1.0, part)
    filling = (0, rounded_up(len(line)) - len(line))
    return RampMoves(
        jnp.asarray(np.pad(line.astype(np.int32), filling)),
        jnp.asarray(np.pad(rising[sample], filling)),
        jnp.asarray(np.pad(part.astype(x.dtype), filling, constant_values=1.0)),
        jnp.asarray(ends.astype(np.int32)),
    )


class RampRun(NamedTuple):
    """What the recursion found along an input.

    Attributes:
        weights: (cells,) weights after the last sample.
        states: (cells,) states after it.
        reference_states: (cells,) states at the last event.
        reference: () measured output at the last event.
        output: (time,) the model's output before each update.
        error: (time,) error e(k), eq. (7).
        squared: (time,) sᵀs of the events that update weights, 0 at other samples.
    """

    weights: jax.Array
    states: jax.Array
    reference_states: jax.Array
    reference: jax.Array
    output: jax.Array
    error: jax.Array
    squared: jax.Array


class _Adapting(NamedTuple):
    cells: jax.Array
    """Weight, state, and state at the last event, of each cell."""
    squared: jax.Array
    rise: jax.Array
    output: jax.Array
    reference: jax.Array
    oldest: jax.Array


_Move = tuple[jax.Array, RampMoves, jax.Array, jax.Array]
"""Number of a move, its line, the output at its sample, and whether it ends it; or many of them."""

_SoFar = tuple[jax.Array, jax.Array, jax.Array]
"""Cells, output and oldest move that has not been learnt from."""


def _in_rows(values: jax.Array, size: int) -> jax.Array:
    return values.reshape(-1, size)


def adapt_over_moves(
    plane: Plane,
    moves: RampMoves,
    z: jax.Array,
    weights: jax.Array,
    states: jax.Array,
    rule: UpdateRule | None = None,
) -> RampRun:
    """Run the recursion of ramps over their moves, as `AdaptiveFilter.step` does at every sample.

    At an event e = Δz - R̂ᵀs and R̂ ← R̂ + μ e s/(sᵀs), where only the lines that were moved since
    the last one are touched. Output, R̂ᵀs and sᵀs are carried along, and are summed afresh from time
    to time. No value of the measured (time,) output z is missing.
    """
    rule = UpdateRule() if rule is None else rule
    count = moves.line.shape[0]
    index = jnp.arange(count, dtype=moves.ends.dtype)
    at_end = jnp.zeros(count, bool).at[moves.ends].set(True)
    own_z = z.at[jnp.searchsorted(moves.ends, index)].get(mode="clip")
    lines = RampMoves(moves.line, moves.rising, moves.part.astype(weights.dtype), index)

    def advance(carry: _Adapting, move: _Move) -> tuple[_Adapting, jax.Array]:
        number, line, z, ends = move
        cells = line.cells(plane)
        weight, old, reference = carry.cells.at[cells].get(mode="fill", fill_value=0.0).T
        new = jnp.where(line.rising, jnp.maximum(old, line.part), jnp.minimum(old, line.part))
        step = jnp.where(cells < plane.cells, new - old, 0.0)
        change = jnp.sum(weight * step)
        squared = carry.squared + jnp.sum((2 * (old - reference) + step) * step)
        rise, output = carry.rise + change, carry.output + change
        error = z - carry.reference - rise
        event = ends & (squared >= EVENT_SIZE)
        learns = event if rule.dead_zone is None else event & rule.learns(error)
        row = jnp.stack([output, error, jnp.where(learns, squared, 0.0)])
        values = carry.cells.at[cells].set(jnp.stack([weight, new, reference], axis=1), mode="drop")
        rate = rule.rate(error, jnp.where(event, squared, 1.0))
        rate = rate if rule.dead_zone is None else jnp.where(learns, rate, 0.0)
        last = jnp.where(event, number, -1)
        values, output, oldest = _learnt(
            plane, rule, lines, rate, (values, output, carry.oldest), last
        )
        reference = jnp.where(event, z, carry.reference)
        squared, rise = jnp.where(event, 0.0, squared), jnp.where(event, 0.0, rise)
        return _Adapting(values, squared, rise, output, reference, oldest), row

    def advance_afresh(carry: _Adapting, stretch: _Move) -> tuple[_Adapting, jax.Array]:
        weight, state, reference = carry.cells.T
        moved = state - reference
        sums = {"squared": moved @ moved, "rise": weight @ moved, "output": weight @ state}
        return jax.lax.scan(advance, carry._replace(**sums), stretch)

    zero = jnp.zeros((), weights.dtype)
    values = jnp.stack([weights, states, states], axis=1)
    start = _Adapting(values, zero, zero, zero, z[0], index[0])
    # Of two sizes that are both rounded up, the one divides the other in few parts.
    size = math.gcd(count, MOVES_TO_REFRESH) if count > MOVES_TO_REFRESH else count
    stretches = jax.tree.map(partial(_in_rows, size=size), (index, lines, own_z, at_end))
    carry, rows = jax.lax.scan(advance_afresh, start, stretches)
    weight, state, reference = carry.cells.T
    output, error, squared = rows.reshape(count, 3)[moves.ends].T
    return RampRun(weight, state, reference, carry.reference, output, error, squared)


def _learnt(
    plane: Plane,
    rule: UpdateRule,
    lines: RampMoves,
    rate: jax.Array,
    so_far: _SoFar,
    last: jax.Array,
) -> _SoFar:
    """Cells, output and oldest move not learnt from, after the lines of some moves are updated."""

    def one_line(so_far: _SoFar) -> _SoFar:
        values, output, number = so_far

        def of_number(each: jax.Array) -> jax.Array:
            return each[number]

        cells = jax.tree.map(of_number, lines).cells(plane)
        weight, state, reference = values.at[cells].get(mode="fill", fill_value=0.0).T
        moved = state - reference
        share = rate * moved
        if rule.nonnegative:
            floor = jnp.where(moved != 0, 0.0, -jnp.inf)
            share = jnp.maximum(weight + share, floor) - weight
        new = jnp.stack([weight + share, state, state], axis=1)
        values = values.at[cells].set(new, mode="drop")
        return values, output + jnp.sum(share * state), number + 1

    def unfinished(so_far: _SoFar) -> jax.Array:
        return so_far[-1] <= last

    return jax.lax.while_loop(unfinished, one_line, so_far)

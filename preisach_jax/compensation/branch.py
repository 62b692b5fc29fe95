r"""The Preisach operator inverted sample by sample, from the memory that each sample leaves.

Along a monotone branch the output of an operator with weights that are not negative rises with its
input, so that for each output between its ends there is an input that gives it (the inverse along
Everett's branches: P. Krejci, K. Kuhnen, IEE Proc. Control Theory Appl. 148 (2001) 185-192).  For
ramps the branch is a row of straight pieces, on which Newton steps end exactly; for relays it is a
row of steps, of which the nearest is taken.
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from preisach_jax.operator.plane import Plane, input_at, position_on

MOST_TRIALS = 80
"""Trials in which an input is found; three to five are usual."""


class Operator(eqx.Module):
    """A Preisach operator on an input from 0 to `levels`, with which it rises.

    Attributes:
        plane: from 0 to `levels`, with the thresholds where they lie.
        weights: (start, levels, levels) weights of the states that were off before the first
            sample, and of those that were on.
        all_widen: whether a widening also moves the thresholds of reversible hysterons, α = β.
        relays: whether hysterons are relays.
    """

    plane: Plane
    weights: Array
    all_widen: bool = eqx.field(static=True)
    relays: bool = eqx.field(static=True)

    @staticmethod
    def of(plane: Plane, weights: np.ndarray, memory: np.ndarray, relays: bool, all_widen: bool):
        """The operator of weights and of what unknown starts add, `(cells,)` each."""
        cells = (plane.alpha_index, plane.beta_index)
        laid_out = np.zeros((2, plane.levels, plane.levels))
        laid_out[0][cells] = weights - memory
        laid_out[1][cells] = memory
        return Operator(plane.scaled(plane.levels), jnp.asarray(laid_out), all_widen, relays)

    @property
    def levels(self) -> int:
        """Levels of the plane."""
        return self.weights.shape[-1]

    def start(self) -> Array:
        """States before the first sample."""
        zeros = jnp.zeros(self.weights.shape[1:], self.weights.dtype)
        return jnp.stack([zeros, zeros + 1.0])

    def moved(self, states: Array, position: Array, widening: Array) -> tuple[Array, Array]:
        """Output and states after the input has gone straight to a position."""
        on_alpha, on_beta = self._reached(position - widening), self._reached(position + widening)
        new = jnp.minimum(on_beta[None, None, :], jnp.maximum(states, on_alpha[None, :, None]))
        if not self.all_widen:
            diagonal = jnp.eye(self.levels, dtype=bool)
            new = jnp.where(diagonal[None], self._reached(position)[None, :, None], new)
        return jnp.vdot(new, self.weights), new

    def _reached(self, position: Array) -> Array:
        index = jnp.arange(self.levels, dtype=self.weights.dtype)
        position = position_on(self.plane, jnp.asarray(position, index.dtype))
        if self.relays:
            return (position > index + 0.5).astype(index.dtype)
        return jnp.clip(position - index, 0.0, 1.0)


class BranchBounds(NamedTuple):
    """What a sample allows: positions from `low` to `high`, at most `step` from the last one.

    Where `forced` is a number, the input is there, whatever is wanted.
    """

    low: Array
    high: Array
    step: Array
    forced: Array


class _BranchTrial(NamedTuple):
    tried: Array | int
    position: Array
    bottom: Array
    top: Array
    done: Array


def inverse_step(
    operator: Operator,
    state: tuple[Array, Array],
    wanted: Array,
    widening: Array,
    bounds: BranchBounds,
) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """The new state, and position and output, nearest to a wanted output within the bounds."""
    states, before = state
    low = jnp.maximum(bounds.low, before - bounds.step)
    high = jnp.minimum(bounds.high, before + bounds.step)
    # From beyond the limits the input comes back as fast as it may.
    low, high = jnp.minimum(low, before + bounds.step), jnp.maximum(high, before - bounds.step)
    low = jnp.minimum(low, high)
    find = _nearest_step if operator.relays else _on_branch
    position = find(operator, states, before, wanted, widening, low, high)
    position = jnp.where(jnp.isnan(bounds.forced), position, bounds.forced)
    output, states = operator.moved(states, position, widening)
    return (states, position), (position, output)


def _on_branch(
    operator: Operator,
    states: Array,
    before: Array,
    wanted: Array,
    widening: Array,
    low: Array,
    high: Array,
) -> Array:
    most = jnp.abs(operator.weights).sum()
    eps = float(np.finfo(np.dtype(most.dtype)).eps)
    close, narrow = 4 * eps * most, 4 * eps * operator.levels

    def output(position: Array) -> Array:
        return operator.moved(states, position, widening)[0]

    def improved(trial: _BranchTrial) -> _BranchTrial:
        given, slope = jax.jvp(output, (trial.position,), (jnp.ones_like(wanted),))
        lacking = wanted - given
        bottom = jnp.where(lacking > 0, trial.position, trial.bottom)
        top = jnp.where(lacking > 0, trial.top, trial.position)
        newton = jnp.clip(trial.position + lacking / jnp.where(slope > 0, slope, 1.0), bottom, top)
        # At corners, and where nothing moves, halving the bracket goes on.
        good = (slope > 0) & (trial.tried % 4 != 3)
        after = jnp.where(good, newton, (bottom + top) / 2)
        done = (jnp.abs(lacking) <= close) | (top - bottom <= narrow)
        after = jnp.where(jnp.abs(lacking) <= close, trial.position, after)
        return _BranchTrial(trial.tried + 1, after, bottom, top, done)

    def unfinished(trial: _BranchTrial) -> Array:
        return ~trial.done & (trial.tried < MOST_TRIALS)

    first = jnp.clip(before, low, high)
    trial = _BranchTrial(0, first, low, high, jnp.asarray(False))
    return jax.lax.while_loop(unfinished, improved, trial).position


def _nearest_step(
    operator: Operator,
    states: Array,
    before: Array,
    wanted: Array,
    widening: Array,
    low: Array,
    high: Array,
) -> Array:
    """Between two thresholds of relays all positions are alike: the middle of the best of them."""
    middles = input_at(operator.plane, jnp.arange(operator.levels + 1, dtype=states.dtype))

    def missed(position: Array) -> Array:
        return jnp.abs(operator.moved(states, position, widening)[0] - wanted)

    off = jax.vmap(missed)(middles)
    best = middles[jnp.argmin(off)]
    stays = missed(before) <= off.min()
    return jnp.clip(jnp.where(stays, before, best), low, high)


@eqx.filter_jit
def follow(operator: Operator, path: Array, widening: Array) -> tuple[Array, Array]:
    """States after a path of positions, and the last of them."""

    def advance(states: Array, now: tuple[Array, Array]) -> tuple[Array, None]:
        return operator.moved(states, *now)[1], None

    return jax.lax.scan(advance, operator.start(), (path, widening))[0], path[-1]


@eqx.filter_jit
def inverse(
    operator: Operator,
    state: tuple[Array, Array],
    wanted: Array,
    widening: Array,
    bounds: BranchBounds,
) -> tuple[Array, Array]:
    """Positions along a wanted output, and the outputs that they give, all `(time,)`."""
    step = partial(inverse_step, operator)

    def advance(
        state: tuple[Array, Array], sample: tuple[Array, Array, BranchBounds]
    ) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        return step(state, *sample)

    return jax.lax.scan(advance, state, (wanted, widening, bounds))[1]

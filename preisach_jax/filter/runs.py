"""Runs of the adaptive filter over a record: sample by sample, and over moves."""

from __future__ import annotations

import dataclasses
from functools import partial
from typing import Protocol, cast

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike, DTypeLike

from preisach_jax.filter.state import FilterInfo, FilterResult, FilterState
from preisach_jax.operator.moves import RampMoves, RampRun, adapt_over_moves
from preisach_jax.operator.plane import Plane
from preisach_jax.operator.update import UpdateRule


class Steps(Protocol):
    """What a run needs of the filter: its plane, how it starts, and what a sample does to it."""

    @property
    def plane(self) -> Plane: ...

    def init(self, x0: ArrayLike, z0: ArrayLike) -> FilterState:
        """Start at the first sample."""
        ...

    def step(
        self, state: FilterState, x: ArrayLike, z: ArrayLike, adapt: ArrayLike = True
    ) -> tuple[FilterState, FilterInfo]:
        """Take in one sample."""
        ...

    def rule(self, dtype: DTypeLike) -> UpdateRule:
        """What an error does to the weights."""
        ...


@partial(jax.jit, static_argnames=("passes", "adapt"))
def run_over_samples(
    filt: Steps, x: jax.Array, z: jax.Array, state: FilterState | None, passes: int, adapt: bool
) -> FilterResult:
    """Run sample by sample, in a scan of the filter's step.

    Arguments:
        x: (time,) input, in the unit of the plane.
        z: (time,) measured output, in its unit; NaN where it is missing.
        adapt: whether to learn.
    """
    start = filt.init(x[0], z[0]) if state is None else state

    def advance(
        state: FilterState, sample: tuple[jax.Array, jax.Array]
    ) -> tuple[FilterState, FilterInfo]:
        return filt.step(state, *sample, adapt)

    def one_pass(
        carry: tuple[FilterState, FilterInfo], _: None
    ) -> tuple[tuple[FilterState, FilterInfo], None]:
        before = dataclasses.replace(start, weights=carry[0].weights)
        return jax.lax.scan(advance, before, (x, z)), None

    no_rows = FilterInfo(*[jnp.zeros(x.shape, start.weights.dtype)] * len(FilterInfo._fields))
    state, info = jax.lax.scan(one_pass, (start, no_rows), length=passes)[0]
    return FilterResult(state.weights, *info, state)


def _rule(filt: Steps, dtype: DTypeLike, adapt: bool) -> UpdateRule:
    rule = filt.rule(dtype)
    return rule if adapt else dataclasses.replace(rule, step_size=jnp.zeros((), dtype))


@partial(jax.jit, static_argnames=("passes", "adapt"))
def run_over_moves(
    filt: Steps, x: jax.Array, z: jax.Array, moves: RampMoves, passes: int, adapt: bool
) -> FilterResult:
    """Run ramps over the lines of the plane that each sample moves, O(N) a sample.

    Arguments:
        x: (time,) input, in the unit of the plane.
        z: (time,) measured output, in its unit.
        adapt: whether to learn.
    """
    start = filt.init(x[0], z[0])
    rule = _rule(filt, z.dtype, adapt)

    def one_pass(weights: jax.Array) -> RampRun:
        return adapt_over_moves(filt.plane, moves, z, weights, start.states, rule)

    def learnt(_: jax.Array, weights: jax.Array) -> jax.Array:
        return one_pass(weights).weights

    before = cast(jax.Array, jax.lax.fori_loop(1, passes, learnt, start.weights))
    found = one_pass(before)
    state = FilterState(found.weights, found.states, x[-1], found.reference_states, found.reference)
    switched = found.squared if adapt else jnp.zeros_like(found.squared)
    return FilterResult(found.weights, found.output, found.error, switched, state)

"""Runs of the adaptive filter over a record: sample by sample, over events, over moves."""

from __future__ import annotations

import dataclasses
from functools import partial
from typing import Protocol, cast

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike, DTypeLike

from preisach_jax.filter.state import FilterInfo, FilterResult, FilterState
from preisach_jax.operator.events import events_and_states, relays_between
from preisach_jax.operator.learning import adapt_and_share, adapt_over_events
from preisach_jax.operator.moves import RampMoves, RampRun, adapt_over_moves
from preisach_jax.operator.plane import Plane
from preisach_jax.operator.switching import Switching
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
    filt: Steps,
    x: jax.Array,
    z: jax.Array,
    state: FilterState | None,
    passes: int,
    adapt: bool,
) -> FilterResult:
    """Run sample by sample, in a scan of the filter's step.

    Arguments:
        filt: the filter.
        x: (time,) input, in the unit of the plane.
        z: (time,) measured output, in its unit; NaN where it is missing.
        state: the state after an earlier part of the record, if there was one.
        passes: how often the record is taken in.
        adapt: whether to learn.

    Returns:
        The weights after the last sample, the rows of each sample and the final state.
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


def run_over_events(
    filt: Steps, x: jax.Array, z: jax.Array, passes: int, adapt: bool
) -> FilterResult:
    """Run relays from switching event to switching event, O(N) an event.

    Arguments:
        filt: the filter.
        x: (time,) input, in the unit of the plane.
        z: (time,) measured output, in its unit.
        passes: how often the record is taken in.
        adapt: whether to learn.

    Returns:
        The weights after the last sample, the rows of each sample and the final state.
    """
    switching, states = events_and_states(filt.plane, x)
    stretches = relays_between(filt.plane, x, switching)
    rows, weights = cast(
        tuple[FilterInfo, jax.Array],
        _rows_over_events(filt, x, z, switching, stretches, passes, adapt),
    )
    sample = jnp.max(jnp.where(switching.area > 0, switching.sample, 0))
    state = FilterState(weights, states, x[-1], states, z[sample])
    return FilterResult(weights, rows.output, rows.error, rows.switched, state)


@partial(jax.jit, static_argnames=("passes", "adapt"))
def _rows_over_events(
    filt: Steps,
    x: jax.Array,
    z: jax.Array,
    switching: Switching,
    stretches: tuple[jax.Array, jax.Array],
    passes: int,
    adapt: bool,
) -> tuple[FilterInfo, jax.Array]:
    start = filt.init(x[0], z[0])
    measured = z.at[switching.sample].get(mode="clip")
    increments = jnp.diff(measured, prepend=z[:1])[:, None]
    area = switching.area.astype(z.dtype)
    rule = _rule(filt, z.dtype, adapt)

    def one_pass(_: jax.Array, weights: jax.Array) -> jax.Array:
        return adapt_over_events(filt.plane, switching, increments, weights, rule)[0]

    first = start.weights[:, None]
    before = cast(jax.Array, jax.lax.fori_loop(1, passes, one_pass, first))
    # Outside the loop, where XLA does not copy the weights at each event.
    weights, error, settled, unsettled = _settled_over_events(
        filt.plane, rule, switching, increments, before, stretches
    )
    learns = (area > 0) & rule.learns(error) & adapt

    def at_events(values: jax.Array, steady: jax.Array) -> jax.Array:
        return steady.at[switching.sample].set(values, mode="drop")

    moved = at_events(jnp.ones(area.shape, int), jnp.zeros(z.shape, int))
    # Events so far, and before this sample. In whole numbers: floating ones end in counting.
    until = jnp.cumsum(moved)
    steady = jnp.concatenate([jnp.sum(before[:, 0] * start.states)[None], settled])[until]
    reference = jnp.concatenate([z[:1], measured])[until - moved]
    info = FilterInfo(
        output=at_events(unsettled, steady),
        error=at_events(error, z - reference),
        switched=at_events(jnp.where(learns, area, 0.0), jnp.zeros_like(z)),
    )
    return info, weights[:, 0]


def _settled_over_events(
    plane: Plane,
    rule: UpdateRule,
    switching: Switching,
    increments: jax.Array,
    weights: jax.Array,
    stretches: tuple[jax.Array, jax.Array],
) -> tuple[jax.Array, jax.Array, jax.Array, jax.Array]:
    """Weights after events, the error of each, and the output after and before its update."""
    first, lowest = stretches

    def one_stretch(
        weights: jax.Array, stretch: tuple[Switching, jax.Array, jax.Array]
    ) -> tuple[jax.Array, tuple[jax.Array, jax.Array, jax.Array]]:
        switching, increments, lowest = stretch
        on = jnp.asarray(plane.beta_index) < lowest[plane.alpha_index]
        begin = jnp.sum(jnp.where(on, weights[:, 0], 0.0))
        weights, error, share = adapt_and_share(plane, switching, increments, weights, rule)
        rise = jnp.where(switching.area > 0, (increments - error)[:, 0], 0.0)
        # What has switched on takes its share of the error along.
        after = rise + jnp.where(switching.rising, share[:, 0], 0.0)
        settled = begin + jnp.cumsum(after)
        return weights, (error[:, 0], settled, settled - after + rise)

    def in_stretches(each: jax.Array) -> jax.Array:
        return each.reshape(len(first), -1, *each.shape[1:])

    rows = jax.tree.map(in_stretches, (switching, increments))
    weights, found = jax.lax.scan(one_stretch, weights, (*rows, lowest))
    error, settled, unsettled = (each.ravel() for each in found)
    return weights, error, settled, unsettled


@partial(jax.jit, static_argnames=("passes", "adapt"))
def run_over_moves(
    filt: Steps,
    x: jax.Array,
    z: jax.Array,
    moves: RampMoves,
    passes: int,
    adapt: bool,
) -> FilterResult:
    """Run ramps over the lines of the plane that each sample moves, O(N) a sample.

    Arguments:
        filt: the filter.
        x: (time,) input, in the unit of the plane.
        z: (time,) measured output, in its unit.
        moves: of the ramps along the input.
        passes: how often the record is taken in.
        adapt: whether to learn.

    Returns:
        The weights after the last sample, the rows of each sample and the final state.
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

"""The adaptive filter over the thresholds that relays pass: O(N) each, whatever is traced."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.typing import ArrayLike

from preisach_jax.filter.state import FilterResult, FilterState
from preisach_jax.operator.cells import flat_index
from preisach_jax.operator.events import relay_levels, rounded_up
from preisach_jax.operator.plane import Plane


class Passages(NamedTuple):
    """The thresholds that an input passes, `(passages,)` each, one after the other.

    Of an event, a sample that passes several, all lines are read before the error is known, and
    are gone through once more to be written.
    """

    sample: Any
    line: Any
    rising: Any
    begins: Any
    reads: Any
    solves: Any
    writes: Any
    ends: Any
    following: Any
    """The sample of the next event."""


class _Carry(NamedTuple):
    """What goes from passage to passage.

    `rise` and `area` add up over the lines of an event, and `rate` is what its error moves each
    weight by; `unsettled` is the output before that. Since the reference sample, with the output
    `z`, the model has risen by `since`. The states are `behind` the reference where an output was
    missing at an event. Rounding has taken `lost` from the sum `output` (Kahan).
    """

    weights: jax.Array
    on: jax.Array
    reference: jax.Array
    output: jax.Array
    unsettled: jax.Array
    lost: jax.Array
    rise: jax.Array
    area: jax.Array
    rate: jax.Array
    since: jax.Array
    z: jax.Array
    behind: jax.Array


class _Rows(NamedTuple):
    """What is recorded at an event, from it on, and from the sample on that made up for a gap.

    An error is the measured output less the `base`.
    """

    output: tuple[jax.Array, jax.Array, jax.Array]
    base: tuple[jax.Array, jax.Array, jax.Array]
    switched: tuple[jax.Array, jax.Array]
    made_up: jax.Array


def passages_along(levels: Any, room: int | None = None) -> tuple[Passages, Any]:
    """The thresholds that an input passes, and how many by the end of each sample.

    Arguments:
        levels: (1 + time,) integers, first that before the first sample; NumPy's if they are known.
        room: for so many passages; needed if the levels are not known.
    """
    xp: Any = np if isinstance(levels, np.ndarray) else jnp
    change = xp.diff(levels)
    count = xp.abs(change)
    taken = xp.where(count > 1, 2 * count, count)
    until = xp.cumsum(taken)
    room = rounded_up(int(until[-1])) if room is None else room
    number, samples = xp.arange(room), len(change)
    sample = xp.searchsorted(until, number, side="right")
    there = sample < samples
    at = xp.minimum(sample, samples - 1)
    place, count = number - (until[at] - taken[at]), xp.where(there, count[at], 0)
    rising, passed = change[at] > 0, place % xp.maximum(count, 1)
    # The next event of each sample: the first later one that takes anything.
    where_taken = xp.where(taken > 0, xp.arange(samples), samples)
    later = xp.append(_least_from_here(where_taken)[1:], samples)
    return Passages(
        sample=sample,
        line=xp.where(rising, levels[at] + passed, levels[at] - 1 - passed),
        rising=rising,
        begins=there & (place == 0),
        reads=there & (place < count),
        solves=there & (place == count - 1),
        writes=there & ((place >= count) | (count == 1)),
        ends=there & (place == taken[at] - 1),
        following=later[at],
    ), until


def _least_from_here(values: Any) -> Any:
    """(time,) least of a value and all that follow it."""
    if isinstance(values, np.ndarray):
        return cast(Any, np.minimum).accumulate(values[::-1])[::-1]
    return cast(Any, jax.lax).cummin(values, reverse=True)


def levels_along(plane: Plane, x: ArrayLike, before: ArrayLike) -> Any:
    """(1 + time,) levels of an input, first that of the input before it.

    On which side of a threshold an input rests that has come from elsewhere is not known: the one
    from which it passes it again, which switches nothing that has switched.

    Arguments:
        plane: the Preisach plane.
        x: (time,) input, in the unit of the plane.
        before: () input before the first sample.
    """
    known = not any(isinstance(each, Tracer) for each in (x, before))
    xp: Any = np if known else jnp
    course = xp.append(xp.asarray(before), xp.asarray(x))
    moves = course != course[0]
    falls = course[xp.argmax(moves)] < course[0]
    return relay_levels(plane, course, cast(int, xp.where(falls, plane.levels, 0)))


def run_over_passages(
    filt: Any,
    x: jax.Array,
    z: jax.Array,
    known: np.ndarray | None,
    state: FilterState | None,
    passes: int,
    adapt: bool,
    room: int | None,
) -> FilterResult:
    """Run relays over the thresholds that the input passes, eq. (7), (8), (11), (12).

    Arguments:
        filt: the filter.
        x: (time,) input, in the unit of the plane.
        z: (time,) measured output, in its unit; NaN where it is missing.
        known: (time,) the input as it was given, if it is known: inside a compiled function all
            that JAX has touched is traced.
        state: the state after an earlier part of the record, if there was one.
        passes: how often the record is taken in.
        adapt: whether to learn.
        room: for so many passages where the input is traced; without it, for one a sample.

    Returns:
        The weights after the last sample, the rows of each sample and the final state.
    """
    before = state.input if state is not None else known[0] if known is not None else x[0]
    measured = z if state is None else jnp.append(state.reference_output, z)
    gaps = None if isinstance(measured, Tracer) else not np.isfinite(measured).all()
    if state is not None and gaps is False:
        one, other = state.states, state.reference_states
        traced = isinstance(one, Tracer) or isinstance(other, Tracer)
        gaps = None if traced else bool((one != other).any())
    if filt.sampling == "sample":
        gaps = False
    if known is None or isinstance(before, Tracer):
        return cast(Any, _run)(filt, x, z, state, passes, adapt, None, room or len(x), gaps)
    levels = levels_along(filt.plane, known.astype(x.dtype), np.asarray(before, x.dtype))
    passages = passages_along(levels)
    return cast(Any, _run)(filt, x, z, state, passes, adapt, passages, 0, gaps)


@partial(jax.jit, static_argnames=("passes", "adapt", "room", "gaps"))
def _run(
    filt: Any,
    x: jax.Array,
    z: jax.Array,
    state: FilterState | None,
    passes: int,
    adapt: bool,
    passages: tuple[Passages, Any] | None,
    room: int,
    gaps: bool | None,
) -> FilterResult:
    missing = jnp.isnan(x)
    if passages is None:  # a sample without input changes nothing: the one before stands for it
        source = jax.lax.cummax(jnp.where(missing, 0, jnp.arange(len(x))))
        x, z = x[source], z[source]
    start = filt.init(x[0], z[0]) if state is None else state
    if passages is None:
        passages = passages_along(levels_along(filt.plane, x, start.input), room)
    steps, until = passages
    given = (filt, z, steps, until, start)
    run = partial(_rows_of_passes, passes, adapt)
    if gaps is None:
        unlike = start.states != start.reference_states
        gaps_are = ~jnp.isfinite(z).all() | unlike.any() | ~jnp.isfinite(start.reference_output)
        rows = _whichever(run, gaps_are, given)
    else:
        rows = run(gaps, given)
    weights, on, reference, last_z, *signals = rows
    # What there was no room for is not known.
    until = jnp.asarray(until)
    lost = until > len(steps.sample)
    output, error, switched = (jnp.where(lost, jnp.nan, signal) for signal in signals)
    error = jnp.where(missing, jnp.nan, error)
    weights = jnp.where(lost[-1], jnp.nan, weights)
    final = FilterState(weights, on, x[-1], reference, last_z)
    return FilterResult(weights, output, error, switched, final)


def _rows_of_passes(passes: int, adapt: bool, gaps: bool, given: Any) -> tuple[jax.Array, ...]:
    """Weights, states, reference and its output at the end; output, error and area in time."""
    recursion = _Recursion(*given, adapt=adapt, gaps=gaps)

    def learnt(_: int, weights: jax.Array) -> jax.Array:
        return recursion.run(weights)[0].weights

    weights = recursion.start.weights
    if passes > 1:
        weights = cast(jax.Array, jax.lax.fori_loop(1, passes, learnt, weights))
    found, *signals = recursion.run(weights)
    on = found.on.astype(weights.dtype)
    if recursion.every_sample:
        return found.weights, on, on, recursion.z[-1], *signals
    reference = found.reference.astype(weights.dtype) if gaps else on
    return found.weights, on, reference, found.z, *signals


def _whichever(
    run: Callable[[bool, Any], tuple[jax.Array, ...]], gaps: jax.Array, given: Any
) -> tuple[jax.Array, ...]:
    """A run with gaps where there are any, and one without them where there are none.

    Of a condition, `vmap` would run both branches; a loop of no turn costs nothing.
    """
    floating, rest = cast(Any, eqx.partition(given, eqx.is_inexact_array))

    def once(again: Callable[[Any], Any], given: Any, nothing: Any, gaps: jax.Array) -> Any:
        def turn(carry: Any) -> Any:
            # What depends on the turn is not computed before the loop.
            gaps, kept = jax.lax.optimization_barrier((carry[0], given))
            return gaps & False, again(kept)

        begun: Any = (gaps, nothing)
        return jax.lax.while_loop(lambda carry: carry[0], turn, begun)[1]

    @jax.custom_vjp
    def chosen(gaps: jax.Array, floating: Any, rest: Any) -> Any:
        without = run(False, eqx.combine(floating, rest))
        return once(lambda kept: run(True, eqx.combine(*kept)), (floating, rest), without, gaps)

    def forward(gaps: jax.Array, floating: Any, rest: Any) -> Any:
        return chosen(gaps, floating, rest), (gaps, floating, rest)

    def backward(given: Any, cotangents: Any) -> Any:
        gaps, floating, rest = given

        def back(with_gaps: bool, floating: Any, rest: Any) -> Any:
            def of(floating: Any) -> Any:
                return run(with_gaps, eqx.combine(floating, rest))

            return cast(Any, jax).vjp(of, floating)[1](cotangents)[0]

        without = back(False, floating, rest)
        found = once(lambda kept: back(True, *kept), (floating, rest), without, gaps)
        return None, found, None

    chosen.defvjp(forward, backward)
    return cast(Any, chosen(gaps, floating, rest))


class _Recursion:
    """The recursion over passages, for one output.

    Arguments:
        filt: the filter.
        z: (time,) measured output.
        steps, until: what `passages_along` found.
        start: the state before the first sample.
        adapt: whether to learn.
        gaps: whether outputs may be missing.
    """

    def __init__(
        self,
        filt: Any,
        z: jax.Array,
        steps: Passages,
        until: Any,
        start: FilterState,
        adapt: bool,
        gaps: bool,
    ):
        self.plane, self.rule, self.adapt = filt.plane, filt.rule(z.dtype), adapt
        self.z, self.start, self.gaps = z, start, gaps
        self.steps = Passages(*(jnp.asarray(each) for each in steps))
        self.every_sample = filt.sampling == "sample"
        self.until = jnp.asarray(until)
        # The first sample with an output, from each sample on.
        there: Any = jnp.where(jnp.isfinite(z), jnp.arange(len(z)), len(z))
        self.measured = jnp.append(_least_from_here(there), len(z)) if gaps else there

    def run(self, weights: jax.Array) -> tuple[_Carry, jax.Array, jax.Array, jax.Array]:
        """What is carried at the end, and (time,) output, error and how many relays switched."""
        start, steps = self.start, self.steps
        on = start.states > 0.5
        reference = start.reference_states > 0.5 if self.gaps else jnp.zeros(0, bool)
        zero = jnp.zeros((), weights.dtype)
        since, behind = zero, jnp.zeros((), bool)
        if self.gaps:
            since = jnp.sum(weights * (on.astype(weights.dtype) - reference.astype(weights.dtype)))
            behind = (on != reference).any()
        begun = _Carry(
            weights, on, reference, jnp.sum(weights * on), zero, zero, zero, zero, zero, since,
            start.reference_output, behind,
        )  # fmt: skip
        out, base = begun.output, begun.z + begun.since
        rows = _Rows((out, out, out), (base, base, base), (zero, zero), jnp.array(-1))
        rows_before = rows
        if self.gaps:
            first = jnp.where(steps.ends.any(), steps.sample[jnp.argmax(steps.ends)], len(self.z))
            begun, rows_before = self._made_up(begun, rows, jnp.array(0), first)
        before = jnp.append(start.reference_output, self.z[:-1])  # of each sample
        of_event = jnp.asarray(steps.sample)
        given = (steps, self.z.at[of_event].get(mode="clip"), before.at[of_event].get(mode="clip"))
        found, rows = jax.lax.scan(lambda carry, each: self._pass(carry, *each), begun, given)

        def before_all(one: jax.Array, more: jax.Array) -> jax.Array:
            return jnp.append(one[None], more, 0)

        rows = jax.tree.map(before_all, rows_before, rows)
        return found, *self._rows(rows, before)

    def _pass(
        self, carry: _Carry, step: Passages, z: jax.Array, before: jax.Array
    ) -> tuple[_Carry, _Rows]:
        """Read a line, or write it, or both."""
        levels, cells = self.plane.levels, self.plane.cells
        along, line, rising = jnp.arange(levels), step.line, step.rising
        index = jnp.where(rising, flat_index(line, along), flat_index(along, line))
        on_plane = jnp.where(rising, along <= line, along >= line)
        index = jnp.where(on_plane, index, cells)
        weights = carry.weights.at[index].get(mode="fill", fill_value=0.0)
        was = carry.on.at[index].get(mode="fill", fill_value=False)
        switches = on_plane & (was != rising)
        sign = jnp.where(rising, 1.0, -1.0).astype(weights.dtype)
        kept = jnp.where(step.begins, 0.0, 1.0).astype(weights.dtype)
        reads = switches & step.reads
        rise = kept * carry.rise + sign * jnp.sum(jnp.where(reads, weights, 0.0))
        area = kept * carry.area + jnp.sum(reads)
        if self.every_sample:
            carry = carry._replace(z=before)
        base = carry.z + carry.since + rise
        error = z - base
        event = jnp.isfinite(error) & (area > 0)
        learns = event & ~carry.behind & self.adapt & self.rule.learns(error)
        # The inner `where` keeps NaN out of the gradient, the outer one out of the update.
        rate = self.rule.rate(jnp.where(learns, error, 0.0), jnp.maximum(area, 1.0))
        rate = jnp.where(step.solves, jnp.where(learns, rate, 0.0), carry.rate)
        move = jnp.where(switches & step.writes, sign * rate, 0.0)
        new = weights + move
        if self.rule.nonnegative:
            new = jnp.where(move != 0, jnp.maximum(new, 0.0), new)
        renews = event & ~carry.behind
        now_on = jnp.where(switches & step.writes, rising, was)
        reference = carry.reference
        if self.gaps:
            was = reference.at[index].get(mode="fill", fill_value=False)
            was = jnp.where(renews & step.writes, now_on, was)
            reference = reference.at[index].set(was, mode="drop")
        output, lost = _added(carry.output, carry.lost, jnp.where(step.solves, rise, 0.0))
        unsettled = jnp.where(step.solves, output, carry.unsettled)
        output, lost = _added(output, lost, jnp.where(rising, jnp.sum(new - weights), 0.0))
        ends = step.ends
        carry = _Carry(
            weights=carry.weights.at[index].set(new, mode="drop"),
            on=carry.on.at[index].set(now_on, mode="drop"),
            reference=reference,
            output=output,
            unsettled=unsettled,
            lost=lost,
            rise=rise,
            area=area,
            rate=rate,
            since=jnp.where(ends & ~renews, carry.since + rise, jnp.where(ends, 0.0, carry.since)),
            z=jnp.where(ends & renews, z, carry.z),
            behind=carry.behind | (ends & ~renews & (area > 0)),
        )
        area = jnp.where(learns, area, 0.0)
        after = carry.z + carry.since
        rows = _Rows((unsettled, output, output), (base, after, after), (area, area), step.sample)
        if not self.gaps:
            nothing = jnp.zeros_like(carry.since)
            return carry._replace(since=nothing, behind=jnp.zeros_like(carry.behind)), rows
        return self._made_up(carry, rows, step.sample, jnp.where(ends, step.following, -1))

    def _made_up(
        self, carry: _Carry, rows: _Rows, sample: jax.Array, following: jax.Array
    ) -> tuple[_Carry, _Rows]:
        """Learn all that has switched since the reference where the next output comes."""
        at = self.measured[sample]
        z = self.z.at[at].get(mode="clip")
        comes = at < following
        error = z - carry.z - carry.since
        learns = self.rule.learns(error) & self.adapt
        differs = comes & carry.behind & jnp.isfinite(error)
        weights, gain, area = self._at_once(carry, error, learns, differs)
        renews = comes & ((area > 0) | ~jnp.isfinite(carry.z))
        output, lost = _added(carry.output, carry.lost, gain)
        carry = carry._replace(
            weights=weights,
            output=output,
            lost=lost,
            reference=jnp.where(renews, carry.on, carry.reference),
            since=jnp.where(comes, 0.0, carry.since),
            z=jnp.where(renews, z, carry.z),
            behind=carry.behind & ~comes,
        )
        area = jnp.where(learns, area, 0.0)
        at_once = differs & (at == sample) & (rows.made_up >= 0)
        switched = (jnp.where(at_once, area, rows.switched[0]), area)
        outputs = (*rows.output[:2], output)
        base = (*rows.base[:2], carry.z + carry.since)
        return carry, _Rows(outputs, base, switched, jnp.where(renews, at, sample))

    def _at_once(
        self, carry: _Carry, error: jax.Array, learns: jax.Array, differs: jax.Array
    ) -> tuple[jax.Array, jax.Array, jax.Array]:
        """Weights after a difference of any states, their share in the output, and the area."""
        weights = carry.weights
        moved = carry.on.astype(weights.dtype) - carry.reference.astype(weights.dtype)
        area = jnp.where(differs, jnp.sum(jnp.abs(moved)), 0.0)
        learns = learns & (area > 0)
        rate = self.rule.rate(jnp.where(learns, error, 0.0), jnp.maximum(area, 1.0))
        new = weights + jnp.where(learns, rate, 0.0) * moved
        if self.rule.nonnegative:
            new = jnp.where(learns & (moved != 0), jnp.maximum(new, 0.0), new)
        return new, jnp.sum((new - weights) * carry.on), area

    def _rows(self, rows: _Rows, before: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
        """(time,) output, error and how many relays switched, at each sample."""
        now = jnp.arange(len(self.z))
        last = jnp.minimum(self.until, len(self.steps.sample))
        of, at_event = rows.made_up[last], jnp.diff(last, prepend=0) > 0

        def choose(three: tuple[jax.Array, jax.Array, jax.Array]) -> jax.Array:
            here, since, again = (each[last] for each in three)
            return jnp.where(at_event, here, jnp.where(now > of, again, since))

        error = self.z - choose(rows.base)
        if self.every_sample:
            error = jnp.where(at_event, error, self.z - before)
        made_up = (now == of) & ~at_event
        area = jnp.where(made_up, rows.switched[1][last], 0.0)
        switched = jnp.where(at_event, rows.switched[0][last], area)
        return choose(rows.output), error, switched


def _added(total: jax.Array, lost: jax.Array, more: jax.Array) -> tuple[jax.Array, jax.Array]:
    """A sum and what rounding has taken from it, with one more term (Kahan)."""
    more = more - lost
    new = total + more
    return new, (new - total) - more

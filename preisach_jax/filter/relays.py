"""The adaptive filter over the relays that switch, block by block, whatever is traced."""

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
from preisach_jax.operator.events import WIDTH, Blocks, Room, relay_blocks, relay_levels, rounded_up
from preisach_jax.operator.plane import Plane

STRETCH = 256
"""Visits in a stretch, which is passed over if the input needs none of them."""

LEAKING_STRETCH = 32
"""After so many visits the distance from the initial weights, which leakage shrinks by a common
factor, is multiplied by that: often enough for single precision, up to a leakage of 0.9."""


_BY_CELL = jax.lax.ScatterDimensionNumbers(
    update_window_dims=(1,), inserted_window_dims=(), scatter_dims_to_operand_dims=(0,)
)


class Visits(NamedTuple):
    """The blocks in the order in which they are read and written, `(visits,)` each.

    The blocks that are learnt from at one sample are all read before the error is known, and are
    gone through once more to be written; one alone is read and written at once.

    Attributes:
        block: number of the block.
        start: number of the first visit of those that are learnt from at once.
        sample: at which the block is learnt from; beyond the last one if never.
        reads, solves, writes: whether the block is read, the error is found, the block is written.
        done: (time,) how many visits by the end of each sample.
        extra: (time,) how many of them write what was read before.
        learns: (time,) whether any block is learnt from there.
    """

    block: Any
    start: Any
    sample: Any
    reads: Any
    solves: Any
    writes: Any
    done: Any
    extra: Any
    learns: Any


def visits_of(until: Any, learnt: Any, room: int | None) -> Visits:
    """Order the visits of blocks, of which so many are read, and learnt from, by each sample."""
    xp: Any = np if room is None else jnp
    none = xp.zeros(1, until.dtype)
    read, count = (xp.diff(one, prepend=none) for one in (until, learnt))
    extra = xp.where((count == 1) & (read == 1), 0, count)
    written = xp.cumsum(extra)
    done, ends = until + written, learnt + written
    number = xp.arange(rounded_up(int(done[-1])) if room is None else room)
    sample = xp.searchsorted(ends, number, side="right")
    never, at = sample == len(ends), xp.minimum(sample, len(ends) - 1)
    of, started = xp.where(never, len(number), count[at]), ends[at] - count[at] - extra[at]
    place = number - xp.where(never, ends[-1], started)
    again = place >= of
    once = (of == 1) & (extra[at] == 0)
    first = xp.where(never, learnt[-1], learnt[at] - count[at])
    return Visits(
        block=first + xp.where(again, place - of, place),
        start=number - place,
        sample=sample,
        reads=~again & (number < done[-1]),
        solves=(place == of) | once,
        writes=again | once,
        done=done,
        extra=extra,
        learns=count > 0,
    )


class _Step(NamedTuple):
    """What a visit takes in: the cells of a block, and numbers."""

    cells: jax.Array
    prior: jax.Array
    rising: jax.Array
    moves: jax.Array
    size: jax.Array
    area: jax.Array
    z: jax.Array
    before: jax.Array
    reads: jax.Array
    solves: jax.Array
    writes: jax.Array
    starts: jax.Array


class _Numbers(NamedTuple):
    """The numbers that go from visit to visit, in one vector, which is one kernel and not ten.

    Since the reference sample, with the output `z`, the model has risen by `rise` and the states
    have moved by `squared`; `rate` is what the last error found moves weights by. Rounding has
    taken `lost` from the sum `output` (Kahan), of which the `initial` weights make a part. Leakage
    has shrunk the distance from these by `factor`.
    """

    rise: jax.Array
    squared: jax.Array
    rate: jax.Array
    z: jax.Array
    output: jax.Array
    lost: jax.Array
    initial: jax.Array
    factor: jax.Array


class _Carry(NamedTuple):
    """What goes from visit to visit.

    With leakage `kept` is the distance of the weights from the initial ones over the factor;
    without it, the weights. The states and those at the reference are followed where outputs are
    missing.
    """

    kept: jax.Array
    states: jax.Array
    reference: jax.Array
    numbers: jax.Array


class _VisitRows(NamedTuple):
    """The model's output before and after what a visit learns, and what is to be taken from z."""

    output: jax.Array
    output_after: jax.Array
    base: jax.Array
    base_after: jax.Array
    switched: jax.Array


def levels_along(plane: Plane, x: ArrayLike, before: ArrayLike) -> Any:
    """(1 + time,) levels of an input, first that of the input before it.

    On which side of a threshold an input rests that has come from elsewhere is not known: the one
    from which it passes it again, which switches nothing that has switched.
    """
    known = not any(isinstance(each, Tracer) for each in (x, before, plane.thresholds))
    xp: Any = np if known else jnp
    course = xp.append(xp.asarray(before), xp.asarray(x))
    moves = course != course[0]
    falls = course[xp.argmax(moves)] < course[0]
    return relay_levels(plane, course, cast(int, xp.where(falls, plane.levels, 0)))


def room_for(plane: Plane, x: ArrayLike) -> Room:
    """Room that the event form needs for inputs (..., time), which are concrete."""
    most = Room.of(0)
    for row in np.asarray(x).reshape(-1, np.shape(x)[-1]):
        levels = levels_along(plane, row, row[0])
        until = relay_blocks(plane, levels).until
        done = visits_of(until, until, None).done
        needs = (np.abs(np.diff(levels)).sum(), until[-1], done[-1])
        most = Room(*(max(int(one), known) for one, known in zip(needs, most, strict=True)))
    return Room(*map(rounded_up, most))


def run_over_blocks(
    filt: Any,
    x: jax.Array,
    z: jax.Array,
    known: np.ndarray | None,
    state: FilterState | None,
    passes: int,
    adapt: bool,
    room: Room | int | None,
    missing: bool | None,
) -> FilterResult:
    """Run relays over the blocks of cells that the input switches, eq. (7), (8), (11), (12).

    `known` is the input as it was given, if it is known: inside a compiled function all that JAX
    has touched is traced. `missing` says whether outputs may be missing, if that is known.
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
    gaps = missing if gaps is None else gaps
    if known is None or any(isinstance(each, Tracer) for each in (before, filt.plane.thresholds)):
        room = room if isinstance(room, Room) else Room.of(room or len(x))
        return cast(Any, _run)(filt, x, z, state, passes, adapt, None, None, room, gaps)
    levels = levels_along(filt.plane, known.astype(x.dtype), np.asarray(before, x.dtype))
    blocks = relay_blocks(filt.plane, levels)
    visits = visits_of(blocks.until, blocks.until, None)
    return cast(Any, _run)(filt, x, z, state, passes, adapt, blocks, visits, None, gaps)


@partial(jax.jit, static_argnames=("passes", "adapt", "room", "gaps"))
def _run(
    filt: Any,
    x: jax.Array,
    z: jax.Array,
    state: FilterState | None,
    passes: int,
    adapt: bool,
    blocks: Blocks | None,
    visits: Visits | None,
    room: Room | None,
    gaps: bool | None,
) -> FilterResult:
    missing = jnp.isnan(x)
    if blocks is None:  # a sample without input changes nothing: the one before stands for it
        source = jax.lax.cummax(jnp.where(missing, 0, jnp.arange(len(x))))
        x, z = x[source], z[source]
    start = filt.init(x[0], z[0]) if state is None else state
    if blocks is None:
        blocks = relay_blocks(filt.plane, levels_along(filt.plane, x, start.input), room)
        if gaps is not True:
            visits = visits_of(blocks.until, blocks.until, cast(Room, room).visits)
    given = (filt, z, blocks, visits, start)
    run = partial(_rows_of_passes, passes, adapt, state is not None, room is None)
    if gaps is None:
        unlike = start.states != start.reference_states
        gaps_are = ~jnp.isfinite(z).all() | unlike.any() | ~jnp.isfinite(start.reference_output)
        rows = _whichever(run, gaps_are, given)
    else:
        rows = run(gaps, given)
    weights, states, reference, last_z, output, error, switched = rows
    error = jnp.where(missing, jnp.nan, error)
    final = FilterState(weights, states, x[-1], reference, last_z)
    return FilterResult(weights, output, error, switched, final)


def _rows_of_passes(
    passes: int, adapt: bool, goes_on: bool, full: bool, gaps: bool, given: Any
) -> tuple[jax.Array, ...]:
    """Weights, states, reference and its output at the end; output, error and area in time."""
    recursion = _BlockRecursion(*given, adapt=adapt, gaps=gaps, goes_on=goes_on, full=full)

    def learnt(_: int, weights: jax.Array) -> jax.Array:
        return recursion.run(weights)[0]

    weights = recursion.start.weights
    if passes > 1:
        weights = cast(jax.Array, jax.lax.fori_loop(1, passes, learnt, weights))
    return recursion.run(weights)


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

        first: Any = (gaps, nothing)
        return jax.lax.while_loop(lambda carry: carry[0], turn, first)[1]

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


class _BlockRecursion:
    """The recursion over visits, for one output.

    Plain runs have a way of their own. Missing outputs, leakage and nonnegative weights take the
    general one, which for N = 37 and 75 is still 8 to 25 times as quick as the scan of steps.

    With `gaps` outputs may be missing; with `goes_on` the start may lie behind its reference; with
    `full` there is hardly more room for visits than there are.
    """

    def __init__(
        self,
        filt: Any,
        z: jax.Array,
        blocks: Blocks,
        visits: Visits,
        start: FilterState,
        adapt: bool,
        gaps: bool,
        goes_on: bool,
        full: bool,
    ):
        self.plane, self.rule, self.adapt, self.gaps = filt.plane, filt.rule(z.dtype), adapt, gaps
        self.z, self.start, self.full = z, start, full and not gaps
        self.every_sample = filt.sampling == "sample"
        cells, until = blocks.cells(self.plane, start.states), jnp.asarray(blocks.until)
        room, size = len(cells), self.plane.cells
        rising, first_z = jnp.asarray(blocks.rising), start.reference_output
        moves = jnp.ones(room, bool)
        self.starts, now = jnp.array(-1), jnp.arange(len(z))
        if gaps:
            there = jnp.isfinite(z)
            self.starts = jnp.where(jnp.isfinite(first_z), -1, jnp.argmax(there))
            first_z = jnp.where(jnp.isfinite(first_z), first_z, z[self.starts])
            if goes_on:  # all cells may differ from the reference, and are read first of all
                every = jnp.arange(-(-size // WIDTH) * WIDTH).reshape(-1, WIDTH)
                cells = jnp.concatenate([jnp.minimum(every, size), cells])
                rising, moves = (
                    jnp.append(jnp.zeros(len(every), bool), one) for one in (rising, moves)
                )
                until = until + len(every)
            learnt = jax.lax.cummax(jnp.where(there, until, 0))
            visits = visits_of(until, learnt, 2 * len(cells))
        visits = Visits(*(jnp.asarray(each) for each in visits))
        self.lost = (jnp.asarray(blocks.until) > room) | (visits.done > len(visits.block))
        if not gaps and not self.every_sample:  # it was said that no output is missing
            self.lost = self.lost | (jnp.cumsum(jnp.isnan(z)) > 0)
        self.visits, self.blocks, self.now, self.first_z = visits, blocks, now, first_z
        count = jnp.cumsum(jnp.sum(cells < size, axis=1))
        upto = jnp.append(0, count)[jnp.minimum(until, len(cells))]
        area = jnp.diff(upto, prepend=0).at[visits.sample].get(mode="clip")
        self.before = jnp.append(start.reference_output, z[:-1])  # of each sample
        there = (visits.reads | visits.writes) & (visits.block < len(cells))
        index = jnp.where(there[:, None], cells.at[visits.block].get(mode="clip"), size)
        index = index.astype(jnp.uint32)  # never negative: nothing is to be counted from the end
        self.leakage = None if filt.leakage is None else jnp.asarray(filt.leakage, z.dtype)
        prior = jnp.zeros((), z.dtype) if self.leakage is None else filt.initial_weight
        self.prior = jnp.broadcast_to(jnp.asarray(prior, z.dtype), (size,))
        self.steps = _Step(
            cells=index,
            prior=self.prior.at[index].get(mode="fill", fill_value=0.0),
            rising=rising.at[visits.block].get(mode="clip"),
            moves=moves.at[visits.block].get(mode="clip"),
            size=jnp.sum(index < size, axis=1).astype(z.dtype),
            area=area.astype(z.dtype),
            z=z.at[visits.sample].get(mode="clip"),
            before=self.before.at[visits.sample].get(mode="clip"),
            reads=visits.reads,
            solves=visits.solves,
            writes=visits.writes,
            starts=visits.sample == self.starts,
        )

    def run(self, weights: jax.Array) -> tuple[jax.Array, ...]:
        """Weights, states, reference, its output, and (time,) output, error and area."""
        if not self.gaps and self.leakage is None and not self.rule.nonnegative:
            return self._run_plainly(weights)
        start, zero = self.start, jnp.zeros((), weights.dtype)
        states, reference = start.states, start.reference_states
        moved = states - reference if self.gaps else zero
        output, initial = jnp.sum(weights * states), jnp.sum(self.prior * states)
        rise, squared = jnp.sum(weights * moved), jnp.sum(moved * moved)
        one = jnp.ones((), weights.dtype)
        numbers = _Numbers(rise, squared, zero, self.first_z, output, zero, initial, one)
        carry = _Carry(
            kept=weights - self.prior,
            states=states if self.gaps else zero,
            reference=reference if self.gaps else zero,
            numbers=jnp.stack(numbers),
        )
        base = self.first_z + rise
        first = jnp.stack(_VisitRows(output, output, base, base, zero))
        carry, rows = self._scan(self._visit, carry, self.steps, self._multiplied_out)
        rows = _VisitRows(*jnp.concatenate([first[jnp.newaxis], rows]).T)
        numbers = _Numbers(*carry.numbers)
        weights = self.prior + numbers.factor * carry.kept
        ends = self.blocks.states_after(self.plane, start.states)
        found = self._rows(rows)
        weights = jnp.where(self.lost[-1], jnp.nan, weights)
        if self.every_sample:
            return weights, ends, ends, self.z[-1], *found
        if self.gaps:
            return weights, carry.states, carry.reference, numbers.z, *found
        return weights, ends, ends, numbers.z, *found

    def _run_plainly(self, weights: jax.Array) -> tuple[jax.Array, ...]:
        """The same with no output missing and nothing but relays' own cells to move.

        A CPU runs a loop of at most eight kernels four times as quickly as one of nine: the moves
        of a block have the shape that XLA scatters, and all else is found after the scan.
        """
        visits, steps, start = self.visits, self.steps, self.start
        # The measured output at the reference of each visit: where the visits before it learnt.
        measured = jnp.append(start.reference_output, steps.z)[visits.start]
        z = steps.before if self.every_sample else measured
        sign = jnp.where(steps.rising, 1.0, -1.0).astype(weights.dtype)
        area = jnp.maximum(steps.area, 1.0)
        begins = jnp.arange(len(sign)) == visits.start

        def rates(error: jax.Array) -> tuple[jax.Array, jax.Array]:
            learns = jnp.isfinite(error) & self.adapt & self.rule.learns(error)
            # The inner `where` keeps NaN out of the gradient, the outer one out of the update.
            rate = self.rule.rate(jnp.where(learns, error, 0.0), 1.0)
            return learns, jnp.where(learns, rate, 0.0)

        def visit(carry: Any, step: Any) -> tuple[Any, jax.Array]:
            weights, rise, moves = carry
            cells, sign, begins, reads, solves, writes, increment, share = step
            there = weights.at[cells].get(mode="fill", fill_value=0.0)
            rise = jnp.where(begins, 0.0, rise) + jnp.where(reads, sign * jnp.sum(there), 0.0)
            found = sign * share * rates(increment - rise)[1]
            moves = jnp.where(writes, jnp.where(solves, found, moves), 0.0)
            weights = jax.lax.scatter_add(
                weights,
                cells[:, None],
                moves,
                _BY_CELL,
                mode=jax.lax.GatherScatterMode.FILL_OR_DROP,
            )
            return (weights, rise, moves), rise

        zero = jnp.zeros((), weights.dtype)
        output = jnp.sum(weights * start.states)
        carry = (weights, zero, jnp.zeros((WIDTH, 1), weights.dtype))
        flags = (begins, steps.reads, steps.solves, steps.writes)
        given = (steps.cells, sign, *flags, steps.z - z, 1 / area)
        (weights, _, _), rise = self._scan(visit, carry, given)
        error = steps.z - z - rise
        learns, moved = rates(error)
        rises = jnp.append(0.0, jnp.cumsum(jnp.where(steps.solves, rise, 0.0)))
        gains = jnp.append(0.0, jnp.cumsum(jnp.where(steps.solves & steps.rising, moved, 0.0)))
        done = jnp.minimum(visits.done, len(sign))
        before = jnp.append(0, done[:-1])
        reference = jnp.append(start.reference_output, steps.z)
        at = jnp.minimum(done - jnp.maximum(visits.extra, 1), len(sign) - 1)
        base = self.before if self.every_sample else reference[before]
        found = (
            output + rises[done] + gains[before],
            self.z - base - jnp.where(visits.learns, rise[at], 0.0),
            jnp.where(visits.learns & learns[at], steps.area[at], 0.0),
        )
        rows = (jnp.where(self.lost, jnp.nan, one) for one in found)
        ends = self.blocks.states_after(self.plane, start.states)
        last_z = self.z[-1] if self.every_sample else reference[done[-1]]
        weights = jnp.where(self.lost[-1], jnp.nan, weights)
        return cast(Any, (weights, ends, ends, last_z, *rows))

    def _multiplied_out(self, carry: _Carry) -> _Carry:
        """The same weights with the common factor 1."""
        if self.leakage is None:
            return carry
        at = _Numbers._fields.index("factor")
        kept, numbers = carry.kept * carry.numbers[at], carry.numbers.at[at].set(1.0)
        return carry._replace(kept=kept, numbers=numbers)

    def _scan(
        self, visit: Any, carry: Any, steps: Any, begin: Callable[[Any], Any] = lambda carry: carry
    ) -> tuple[Any, jax.Array]:
        """A scan in stretches, each with a beginning; those without a visit are passed over."""
        room = len(self.visits.block)
        stretch = STRETCH if self.leakage is None else LEAKING_STRETCH
        if self.leakage is None and self.full:
            return jax.lax.scan(visit, carry, steps)

        def in_rows(one: jax.Array) -> jax.Array:
            end = jnp.zeros((-room % stretch, *one.shape[1:]), one.dtype)
            return jnp.concatenate([one, end]).reshape(-1, stretch, *one.shape[1:])

        def whole(carry: Any, given: Any) -> tuple[Any, jax.Array]:
            steps, first = given

            def go_on(carry: Any) -> tuple[Any, jax.Array]:
                return cast(Any, jax.lax.scan(visit, begin(carry), steps))

            def stay(carry: Any) -> tuple[Any, jax.Array]:
                rows = jax.eval_shape(go_on, carry)[1]
                return carry, jnp.zeros(rows.shape, rows.dtype)

            return cast(Any, jax.lax.cond(first < self.visits.done[-1], go_on, stay, carry))

        steps = jax.tree.map(in_rows, steps)
        starts = jnp.arange(0, room, stretch)
        carry, rows = jax.lax.scan(whole, carry, (steps, starts))
        return carry, rows.reshape(-1, *rows.shape[2:])[:room]

    def _visit(self, carry: _Carry, step: _Step) -> tuple[_Carry, jax.Array]:
        """Read a block, or write it, or both."""
        now = _Numbers(*carry.numbers)
        index, factor, initial = step.cells, now.factor, now.initial
        kept = carry.kept.at[index].get(mode="fill", fill_value=0.0)
        weight = kept if self.leakage is None else step.prior + factor * kept
        sign = jnp.where(step.rising, 1.0, -1.0).astype(weight.dtype)
        states, reference, was = carry.states, carry.reference, jnp.zeros(())
        if self.gaps:
            old = states.at[index].get(mode="fill", fill_value=0.0)
            was = reference.at[index].get(mode="fill", fill_value=0.0)
            turns = step.reads & step.moves & (index < self.plane.cells)
            on = jnp.where(turns, step.rising.astype(old.dtype), old)
            moved, move = on - was, on - old
            squared = now.squared + jnp.sum((2 * (old - was) + move) * move)
        else:
            squared, moved = step.area, sign
            move = jnp.where(step.reads, sign, 0.0)
            on = step.rising.astype(weight.dtype)
        rise = jnp.sum(weight * move)
        initial = initial + jnp.sum(step.prior * move)
        output, lost = _added(now.output, now.lost, rise)
        rise = now.rise + rise
        last_z = step.before if self.every_sample else now.z
        error = step.z - last_z - rise
        event = step.solves & jnp.isfinite(error)
        if self.gaps:
            event = event & (squared > 0)
        learns = event & self.adapt & self.rule.learns(error)
        if self.gaps:
            learns = learns & ~step.starts
        # The inner `where` keeps NaN out of the gradient, the outer one out of the update.
        rate = self.rule.rate(jnp.where(learns, error, 0.0), jnp.where(learns, squared, 1.0))
        rate = jnp.where(step.solves, jnp.where(learns, rate, 0.0), now.rate)
        after, lost_after = output, lost
        if self.leakage is not None:
            left = jnp.where(learns, 1.0 - self.leakage, 1.0).astype(weight.dtype)
            after, factor = initial + left * (output - initial), factor * left
            weight = step.prior + factor * kept
        change = jnp.where(step.writes, rate * moved, 0.0)
        new = weight + change
        if self.rule.nonnegative:
            new = jnp.where(change != 0, jnp.maximum(new, 0.0), new)
        if self.gaps or self.rule.nonnegative:
            gain = jnp.sum(jnp.where(index < self.plane.cells, (new - weight) * on, 0.0))
        else:
            gain = step.size * change * on
        after, lost_after = _added(after, lost_after, gain)
        renews = event if self.gaps else step.solves
        if self.leakage is not None:
            new = (new - step.prior) / factor
        base = last_z + rise
        switched = jnp.where(learns, squared, 0.0)
        z = jnp.where(renews, step.z, now.z)
        rise = jnp.where(renews, 0.0, rise)
        rows = _VisitRows(
            output, after, base, (step.z if self.every_sample else z) + rise, switched
        )
        squared = jnp.where(renews, 0.0, squared) if self.gaps else now.squared
        if self.gaps:
            states = states.at[index].set(on, mode="drop")
            reference = reference.at[index].set(jnp.where(step.writes, on, was), mode="drop")
        numbers = _Numbers(rise, squared, rate, z, after, lost_after, initial, factor)
        kept = carry.kept.at[index].set(new, mode="drop")
        return _Carry(kept, states, reference, jnp.stack(numbers)), jnp.stack(rows)

    def _rows(self, rows: _VisitRows) -> tuple[jax.Array, jax.Array, jax.Array]:
        """(time,) output, error and how many relays switched, at each sample."""
        done, learns = self.visits.done, self.visits.learns
        # Of a sample that learns, the visit which finds its error; else the last one before it.
        solve = done - jnp.maximum(self.visits.extra, 1) + 1
        at = jnp.minimum(jnp.where(learns, solve, done), len(rows.output) - 1)
        output = jnp.where(learns, rows.output[at], rows.output_after[at])
        base = jnp.where(learns, rows.base[at], rows.base_after[at])
        if self.every_sample:
            base = jnp.where(learns, base, self.before)
        error = jnp.where(self.now <= self.starts, jnp.nan, self.z - base)
        switched = jnp.where(learns, rows.switched[at], 0.0)
        found = (output, error, switched)
        return cast(Any, tuple(jnp.where(self.lost, jnp.nan, one) for one in found))


def _added(total: jax.Array, lost: jax.Array, more: jax.Array) -> tuple[jax.Array, jax.Array]:
    """A sum and what rounding has taken from it, with one more term (Kahan)."""
    more = more - lost
    new = total + more
    return new, (new - total) - more

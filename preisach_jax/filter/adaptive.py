"""The adaptive hysteresis filter, eq. (5)-(12)."""

from __future__ import annotations

import dataclasses
import math
from functools import partial
from typing import Any, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.typing import ArrayLike, DTypeLike

from preisach_jax.errors import InputError, whole_number
from preisach_jax.filter.relays import room_for, run_over_blocks
from preisach_jax.filter.state import (
    MOST_SAMPLES,
    FilterInfo,
    FilterResult,
    FilterState,
    check_start,
    checked_adapt,
    input_and_output,
    require_between,
    require_one_number,
    require_state,
    start_at,
)
from preisach_jax.operator.events import Room
from preisach_jax.operator.inputs import as_float
from preisach_jax.operator.moves import (
    EVENT_SIZE,
    RampMoves,
    RampRun,
    UpdateRule,
    adapt_over_moves,
    ramp_moves,
)
from preisach_jax.operator.plane import Plane, hysteron_step
from preisach_jax.operator.simulation import chosen_form

SAMPLINGS = ("event", "sample")

WITHOUT_VALUES = "for numbers without values, inside a compiled or differentiated function"

LEVELS_FOR_MOVES = 50
"""Levels from which ramps are quicker line by line than all at once; measured on a CPU."""


class AdaptiveFilter(eqx.Module):
    """Recursive identification of the Preisach weights from input and output, eq. (5)-(12).

    At each event, e = z - z_ref - R̂ᵀ(y - y_ref) with the current weights on both sides, and then
    R̂ ← R̂ + μ s·e/(sᵀs) with s = y - y_ref, where ref is the sample from which the difference runs.
    For relays and μ = 1 this is (8), (12) with A = sᵀs; for ramps, the normalised projection.

    A step size μ below 1 averages over noise, at the price of slower learning. With A = sᵀs,
    ΣE = sᵀE the signed sum of the weight errors E = R̂ - R, and ν the noise in the difference,
    e = ν - ΣE, and (15) becomes
    ‖E(k+1)‖² = ‖E(k)‖² - μ(2-μ)(ΣE)²/A + μ²ν²/A + 2μ(1-μ) ν ΣE/A.
    Without noise the error so never grows for 0 < μ < 2, and falls fastest for μ = 1.

    With `sampling="event"` the difference runs from the last event: the last sample at which
    hysterons switched (relays), or by which the states had moved by sᵀs ≥ 1/2 since the event
    before (ramps). So e holds all of the increment of the output that s must explain. With
    `sampling="sample"` it runs over one sample; for relays with an input slower than one level a
    sample, the output's movement between switches is then lost and the weights come out too small.

    A missing output (NaN) updates nothing. In event form the difference then runs on to the next
    measured sample and nothing is lost; in sample form the differences with it are left out.

    Only differences of the output are used, so z and the model's output may differ by a constant.

    For a filter that runs for long there are four more options, all off unless given. With all of
    them an update is R̂ ← R₀ + (1-λ)(R̂ - R₀) + μ s·ê/(sᵀs) with the initial weights R₀ and the used
    error ê, and then R̂ ← max(R̂, 0) where s ≠ 0. From e = ν - ΣE follows what becomes of (15):
    ‖E(k+1)‖² = ‖F‖² + (2μ ê sᵀF + μ² ê²)/A with F = (1-λ) E + λ (R₀ - R), and no more than
    that where a weight was set to 0.

    - `dead_zone` d: where |e| ≤ d nothing is updated (ê = 0), and the next difference begins there.
      An update takes μ e ((2-μ) e - 2ν)/A from ‖E‖², so ‖E‖ never grows if |ν| ≤ (1-μ/2) d. Noise
      in (15), (21) is μ²⟨ν²; |ν| > d⟩/A in place of μ²⟨ν²⟩/A, and none if all |ν| ≤ d and |e| ≤ d.
      What is left to learn stays: up to d an event.
    - `error_limit` c: ê = e cut off at ±c, so that no update moves R̂ by more than μc/√A, whatever
      the output does. Without noise ‖E(k+1)‖² ≤ ‖E(k)‖² - μ(2-μ) ê²/A, still never growing. A
      spike of one sample is in two differences.
    - `leakage` λ: each update takes so much of R̂ - R₀, of all cells. Then ‖R̂ - R₀‖ stays below
      μ |Δz - R₀ᵀs|/(λ√A), greatest over the events, if μ ≤ 2(1-λ), and forgets noise and faults in
      1/λ updates, also where the input never returns: (21) has 1-λ in place of the slowest
      contraction. In exchange, of an initial ΣE that is met again and again, λ/(λ+μ) remains.
    - `nonnegative`: a projection onto weights R̂ ≥ 0, which takes R̂ no farther from a truth R ≥ 0,
      so that (15) bounds ‖E(k+1)‖² from above, and (21) holds as it is.

    Arguments:
        plane: the Preisach plane.
        hysteron: "relay" or "ramp".
        sampling: "event" or "sample".
        initial_weight: () or (cells,) weights to start from, in the unit of the output.
        step_size: () step size μ, 0 < μ < 2; 1 is the paper's.
        dead_zone: () size d ≥ 0 of errors that update nothing, in the unit of the output. An error
            holds the noise of two samples: for noise of the deviation σ, 3√2 σ leaves 0.3 % of it.
        leakage: () share λ of the distance to the initial weights that an update takes, 0 ≤ λ < 1,
            λ + μ < 2.
        error_limit: () size c > 0 at which errors are cut off, in the unit of the output.
        nonnegative: whether weights that an update brings below 0 are set to 0.

    Raises:
        InputError: a name is unknown, an initial weight is not finite or has a wrong shape, or a
            setting is out of its range.

    Example:
        >>> import numpy as np
        >>> plane = Plane(levels=4, low=0.0, high=1.0)
        >>> x = np.abs(np.mod(np.linspace(0.0, 9.0, 400), 2.0) - 1.0)
        >>> result = AdaptiveFilter(plane).run(x, 3.0 * x)
        >>> result.weights.shape, result.output.shape
        ((10,), (400,))
    """

    plane: Plane
    hysteron: str = eqx.field(static=True, default="relay")
    sampling: str = eqx.field(static=True, default="event")
    initial_weight: ArrayLike = 1e-9
    step_size: ArrayLike = 1.0
    dead_zone: ArrayLike | None = None
    leakage: ArrayLike | None = None
    error_limit: ArrayLike | None = None
    nonnegative: bool = eqx.field(static=True, default=False)

    def __check_init__(self) -> None:
        check_start(self.plane, self.hysteron, self.initial_weight)
        if self.sampling not in SAMPLINGS:
            raise InputError(f"sampling is {self.sampling!r}: it must be 'event' or 'sample'")
        require_one_number("step_size", self.step_size)
        require_between("step_size", self.step_size, "between 0 and 2, both excluded")
        require_between("dead_zone", self.dead_zone, "of at least 0", least=True, high=math.inf)
        require_between("error_limit", self.error_limit, "above 0", high=math.inf)
        require_between("leakage", self.leakage, "from 0 to 1, 1 excluded", least=True, high=1.0)
        numbers = self.leakage, self.step_size
        if self.leakage is not None and not any(isinstance(one, Tracer) for one in numbers):
            leakage, step_size = (float(np.asarray(one)) for one in numbers)
            if leakage + step_size >= 2.0:
                raise InputError(
                    f"leakage is {leakage} and step_size {step_size}: make their sum less than 2"
                )
        if not isinstance(self.nonnegative, bool):
            raise InputError(f"nonnegative is {self.nonnegative!r}: give True or False")
        if self.nonnegative and not isinstance(self.initial_weight, Tracer):
            least = np.asarray(self.initial_weight).min()
            if least < 0:
                raise InputError(
                    f"initial_weight is {least} with nonnegative=True: give weights of at least 0"
                )

    def options(self) -> dict[str, float | bool]:
        """The options that are on, by their names; empty for the paper's filter."""
        given = {name: getattr(self, name) for name in ("dead_zone", "leakage", "error_limit")}
        numbers = {name: float(np.asarray(n)) for name, n in given.items() if n is not None}
        return numbers | ({"nonnegative": True} if self.nonnegative else {})

    def rule(self, dtype: DTypeLike) -> UpdateRule:
        """What an error does to the weights, leakage aside."""

        def typed(number: ArrayLike | None) -> jax.Array | None:
            return None if number is None else jnp.asarray(number, dtype)

        step_size = jnp.asarray(self.step_size, dtype)
        zone, limit = typed(self.dead_zone), typed(self.error_limit)
        return UpdateRule(step_size, zone, limit, self.nonnegative)

    def init(
        self, x0: ArrayLike, z0: ArrayLike, initial_memory: ArrayLike | str = "low"
    ) -> FilterState:
        """Start the filter at the first sample.

        Arguments:
            x0: () input, in the unit of the plane.
            z0: () measured output, in its unit; NaN if it is missing.
            initial_memory: (cells,) states before the first sample, or the name of an initial
                memory (see `Plane.initial_states`); then x0 forces what it forces, rule (1).

        Returns:
            The state after the first sample; step on with the second (or, which changes nothing,
            with the first).

        Raises:
            InputError: `x0` is not a number on the plane, `z0` is infinite, or the memory is
                unknown.
        """
        weights, states, x, z = start_at(
            self.plane, self.hysteron, self.initial_weight, x0, z0, initial_memory
        )
        return FilterState(weights, states, x, states, z)

    def step(
        self, state: FilterState, x: ArrayLike, z: ArrayLike, adapt: ArrayLike = True
    ) -> tuple[FilterState, FilterInfo]:
        """Take in one sample and adapt the weights.

        The error is taken with the weights R̂(k) on both sides of the difference; they are updated
        after it, at k + 0.5. Pure; values are not checked here.

        Arguments:
            state: the state after the sample before.
            x: () input, in the unit of the plane; beyond the plane it saturates, and a sample
                without it (NaN) changes nothing.
            z: () measured output, in its unit; NaN if it is missing.
            adapt: () whether to learn; without it the weights stay, and all else goes on.

        Returns:
            The state after this sample, and what to record of it.
        """
        dtype = state.weights.dtype
        x, z = jnp.asarray(x, dtype), jnp.asarray(z, dtype)
        there = ~jnp.isnan(x)
        x, z = jnp.where(there, x, state.input), jnp.where(there, z, jnp.nan)
        states = hysteron_step(self.plane, state.states, state.input, x, self.hysteron)
        output = jnp.sum(state.weights * states)

        s = states - state.reference_states
        squared = jnp.sum(s * s)
        error = z - state.reference_output - jnp.sum(state.weights * s)
        # In sample form, a move of the states below √eps may be rounding.
        least = EVENT_SIZE if self.sampling == "event" else cast(float, jnp.finfo(dtype).eps)
        event = jnp.isfinite(error) & (squared >= least)
        learns = event if adapt is True else event & adapt
        weights, learns = self._learnt(state.weights, s, squared, error, learns)

        starting = jnp.isfinite(z) & ~jnp.isfinite(state.reference_output)
        renew = (event | starting) if self.sampling == "event" else there
        following = FilterState(
            weights=weights,
            states=states,
            input=x,
            reference_states=jnp.where(renew, states, state.reference_states),
            reference_output=jnp.where(renew, z, state.reference_output),
        )
        info = FilterInfo(output=output, error=error, switched=jnp.where(learns, squared, 0.0))
        return following, info

    def _learnt(
        self,
        weights: jax.Array,
        s: jax.Array,
        squared: jax.Array,
        error: jax.Array,
        learns: jax.Array,
    ) -> tuple[jax.Array, jax.Array]:
        """Weights after an update with the difference s of the states, and whether there is one."""
        rule = self.rule(weights.dtype)
        learns = learns if self.dead_zone is None else learns & rule.learns(error)
        # The inner `where` keeps NaN and 0/0 out of the gradient, the outer one out of the update.
        rate = jnp.where(
            learns, rule.rate(jnp.where(learns, error, 0.0), jnp.where(learns, squared, 1.0)), 0.0
        )
        if self.leakage is not None:
            prior = jnp.asarray(self.initial_weight, weights.dtype)
            leakage = jnp.where(learns, jnp.asarray(self.leakage, weights.dtype), 0.0)
            weights = weights + leakage * (jnp.broadcast_to(prior, weights.shape) - weights)
        weights = weights + rate * s
        if self.nonnegative:
            weights = jnp.where(learns & (s != 0), jnp.maximum(weights, 0.0), weights)
        return weights, learns

    def run(
        self,
        x: ArrayLike,
        z: ArrayLike | None = None,
        state: FilterState | None = None,
        passes: int = 1,
        form: str = "auto",
        adapt: bool = True,
        room: Room | int | None = None,
        missing: bool | None = None,
    ) -> FilterResult:
        """Run the filter over a record, once or several times.

        Each pass starts from the memory at the beginning of the first one, and from the weights at
        the end of the one before. A noise-free record is so learnt to the end; with noise the
        weights settle on a cycle that fits the noise as well.

        Where values are traced none is checked: an input beyond the plane saturates, and one that
        is NaN, an infinite output or a step size out of its range is computed with.

        Arguments:
            x: (time,) input, in the unit of the plane.
            z: (time,) measured output, in its unit; NaN where it is missing.
            state: the state after an earlier part of the record, which this run continues; without
                it the filter starts from saturated low at the first sample.
            passes: how often the record is taken in, at least once.
            form: "dense", a scan of `step`; "event", the same with work only for the relays that
                switch, or O(N) for each sample of ramps; or "auto": the latter where it can be had
                and is quicker. Relays have it always, also under `jit`, `vmap` and `grad`; with
                leakage, nonnegative weights or missing outputs it takes several times as long as
                without. Ramps have it from saturated low with `sampling="event"`, a
                concrete record and no output missing, and are quicker by it from 50 levels.
            adapt: whether to learn; without it the weights stay, and output and error are those of
                them.
            room: how much there is room for in the event form of relays where the input is traced,
                as `room` finds it; by default as much as there are samples. From the sample on for
                which there is none, all is NaN.
            missing: whether outputs may be missing, if they are traced; without it, both cases are
                compiled for relays, in twice the time. From one that is missing all the same, all
                is NaN.

        Returns:
            The weights after the last sample, the rows of each sample and the final state, all of
            the last pass.

        Raises:
            InputError: lengths or types are wrong, an input leaves the plane or is not finite, an
                output is infinite, `passes` is below 1, `adapt` is not a truth value, or there is
                no event form.
        """
        given: Any = x
        known = None if isinstance(given, Tracer) else np.asarray(given)
        x, z = input_and_output(self.plane, x, z)
        if state is not None:
            require_state(self.plane, state, FilterState)
        try:
            count = int(passes)
        except (TypeError, ValueError, OverflowError):
            count = 0
        if count != passes or count < 1:
            raise InputError(f"passes is {passes!r}: give a whole number of at least 1")
        adapt = checked_adapt(adapt)
        if room is not None and not isinstance(room, Room):
            room = whole_number("room is", room, least=1, most=MOST_SAMPLES)
        chosen = chosen_form(form, self._why_no_events(x, z, state))
        few = form == "auto" and self.plane.levels < LEVELS_FOR_MOVES
        if chosen == "dense" or (self.hysteron == "ramp" and few):
            found = cast(FilterResult, _run_over_samples(self, x, z, state, count, adapt))
        elif self.hysteron == "relay":
            found = run_over_blocks(self, x, z, known, state, count, adapt, room, missing)
        else:
            moves = ramp_moves(self.plane, x)
            found = cast(FilterResult, _run_over_moves(self, x, z, moves, count, adapt))
        return found

    def room(self, x: ArrayLike) -> Room:
        """Count what `run` must have room for, to run relays along inputs that are traced.

        Arguments:
            x: (..., time) inputs, in the unit of the plane; concrete.

        Returns:
            `room` for `run`, enough for each of the inputs if no output is missing. Half of it is
            needed again at most where one is.

        Raises:
            InputError: an input is not a row of real numbers.

        Example:
            >>> filt = AdaptiveFilter(Plane(levels=4, low=0.0, high=1.0))
            >>> x = np.abs(np.mod(np.linspace(0.0, 9.0, 400), 2.0) - 1.0)
            >>> room = filt.room(x)
            >>> run = lambda x, z: filt.run(x, z, room=room, missing=False).weights
            >>> jax.jit(jax.vmap(run))(np.stack([x, x]), np.stack([x, 2.0 * x])).shape
            (2, 10)
        """
        return room_for(self.plane, as_float(x, "the input x"))

    def _why_no_events(self, x: jax.Array, z: jax.Array, state: FilterState | None) -> str:
        if self.hysteron == "relay":
            return ""
        if self.leakage is not None:
            return "of ramps with leakage"
        if self.sampling != "event":
            return "of ramps with sampling='sample'"
        if state is not None:
            return "of ramps from a state"
        if any(isinstance(each, Tracer) for each in (self.initial_weight, x, z)):
            return WITHOUT_VALUES
        return "" if np.isfinite(z).all() else "where outputs are missing"


@partial(jax.jit, static_argnames=("passes", "adapt"))
def _run_over_samples(
    filt: AdaptiveFilter,
    x: jax.Array,
    z: jax.Array,
    state: FilterState | None,
    passes: int,
    adapt: bool,
) -> FilterResult:
    """Run sample by sample, in a scan of the filter's step."""
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


@partial(jax.jit, static_argnames=("passes", "adapt"))
def _run_over_moves(
    filt: AdaptiveFilter, x: jax.Array, z: jax.Array, moves: RampMoves, passes: int, adapt: bool
) -> FilterResult:
    """Run ramps over the lines of the plane that each sample moves, O(N) a sample."""
    start = filt.init(x[0], z[0])
    rule = filt.rule(z.dtype)
    if not adapt:
        rule = dataclasses.replace(rule, step_size=jnp.zeros((), z.dtype))

    def one_pass(weights: jax.Array) -> RampRun:
        return adapt_over_moves(filt.plane, moves, z, weights, start.states, rule)

    def learnt(_: jax.Array, weights: jax.Array) -> jax.Array:
        return one_pass(weights).weights

    before = cast(jax.Array, jax.lax.fori_loop(1, passes, learnt, start.weights))
    found = one_pass(before)
    state = FilterState(found.weights, found.states, x[-1], found.reference_states, found.reference)
    switched = found.squared if adapt else jnp.zeros_like(found.squared)
    return FilterResult(found.weights, found.output, found.error, switched, state)

"""The Preisach model's output and the adaptive hysteresis filter, eq. (5)-(12)."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.typing import ArrayLike, DTypeLike

from preisach_jax.branches import output_along_branches
from preisach_jax.errors import InputError
from preisach_jax.events import (
    Switching,
    adapt_and_share,
    adapt_over_events,
    events_and_states,
    relays_between,
)
from preisach_jax.hysteron import (
    as_float,
    as_path,
    hysteron_step,
    path_and_start,
    require_finite,
    require_hysteron,
    require_on_plane,
)
from preisach_jax.moves import EVENT_SIZE, RampMoves, RampRun, adapt_over_moves, ramp_moves
from preisach_jax.plane import Plane
from preisach_jax.update import UpdateRule

SAMPLINGS = ("event", "sample")

FORMS = ("auto", "dense", "event")

MOST_SAMPLES = 2**31 - 1
"""Samples of one run: they are counted in 32 bits. An `OnlineFilter` takes any number of runs."""

WITHOUT_VALUES = "for numbers without values, inside a compiled or differentiated function"

LEVELS_FOR_MOVES = 50
"""Levels from which ramps are quicker line by line than all at once; measured on a CPU."""


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

    Args:
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
    """Choose between the dense form and the event form.

    Args:
        form: "auto", "dense" or "event".
        why_not: why there is no event form; empty if there is one.

    Returns:
        "dense" or "event".

    Raises:
        InputError: the form is unknown, or it is "event" and there is none.
    """
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


class FilterState(eqx.Module):
    """What the adaptive filter carries from one sample to the next (a pytree).

    Attributes:
        weights: (cells,) estimate R̂, in the unit of the output.
        states: (cells,) hysteron states in [0, 1].
        input: () input of the last sample.
        reference_states: (cells,) hysteron states at the sample from which differences run.
        reference_output: () measured output there; NaN while there is none.
    """

    weights: jax.Array
    states: jax.Array
    input: jax.Array
    reference_states: jax.Array
    reference_output: jax.Array


class FilterInfo(NamedTuple):
    """What the adaptive filter records of one sample.

    Attributes:
        output: () model output ẑ(k), eq. (6), with the weights before the update.
        error: () differential output error e(k), eq. (7), since the reference sample; NaN
            where there is no measured output.
        switched: () A(k), eq. (11): how many hysterons switched and were updated (ramps: sᵀs);
            0 without update.
    """

    output: jax.Array
    error: jax.Array
    switched: jax.Array


class FilterResult(NamedTuple):
    """What a run of the adaptive filter returns.

    Attributes:
        weights: (cells,) weights R̂ after the last sample, in the unit of the output.
        output: (time,) model output ẑ(k), with the weights of that time, before the update.
        error: (time,) differential output error e(k); NaN where there is no measured output.
        switched: (time,) A(k); 0 where nothing was updated.
        state: the filter's state after the last sample, from which a run can be continued.
    """

    weights: jax.Array
    output: jax.Array
    error: jax.Array
    switched: jax.Array
    state: FilterState


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

    Args:
        plane: the Preisach plane.
        hysteron: "relay" or "ramp".
        sampling: "event" or "sample".
        initial_weight: () or (cells,) weights to start from, in the unit of the output.
        step_size: () step size μ, 0 < μ < 2; 1 is the paper's.
        dead_zone: () size d ≥ 0 of errors that update nothing, in the unit of the output. An error
            holds the noise of two samples: for noise of the deviation σ, 3√2 σ leaves 0.3 % of it.
        leakage: () share λ of the distance to the initial weights that an update takes, 0 ≤ λ < 1,
            λ + μ < 2. It needs the dense form.
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
        _require_between("step_size", self.step_size, "between 0 and 2, both excluded")
        _require_between("dead_zone", self.dead_zone, "of at least 0", least=True, high=math.inf)
        _require_between("error_limit", self.error_limit, "above 0", high=math.inf)
        _require_between("leakage", self.leakage, "from 0 to 1, 1 excluded", least=True, high=1.0)
        numbers = self.leakage, self.step_size
        if self.leakage is not None and not any(isinstance(one, Tracer) for one in numbers):
            leakage, step_size = (float(np.asarray(one)) for one in numbers)
            if leakage + step_size >= 2.0:
                raise InputError(
                    f"leakage is {leakage} and step_size {step_size}: their sum must be below 2"
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
        """The options that are on, by their names; empty for the paper's filter.

        Returns:
            `dead_zone`, `leakage`, `error_limit` and `nonnegative`, as far as they were given.

        Example:
            >>> AdaptiveFilter(Plane(levels=4, low=0.0, high=1.0), leakage=1e-4).options()
            {'leakage': 0.0001}
        """
        given = {name: getattr(self, name) for name in ("dead_zone", "leakage", "error_limit")}
        numbers = {name: float(np.asarray(n)) for name, n in given.items() if n is not None}
        return numbers | ({"nonnegative": True} if self.nonnegative else {})

    def rule(self, dtype: DTypeLike) -> UpdateRule:
        """What an error does to the weights, leakage aside.

        Args:
            dtype: floating type to compute in.

        Returns:
            The rule, with numbers of that type.

        Example:
            >>> filt = AdaptiveFilter(Plane(levels=4, low=0.0, high=1.0), step_size=0.5)
            >>> float(filt.rule(float).rate(jnp.asarray(3.0), 2.0))
            0.75
        """

        def typed(number: ArrayLike | None) -> jax.Array | None:
            return None if number is None else jnp.asarray(number, dtype)

        step_size = jnp.asarray(self.step_size, dtype)
        zone, limit = typed(self.dead_zone), typed(self.error_limit)
        return UpdateRule(step_size, zone, limit, self.nonnegative)

    def init(
        self, x0: ArrayLike, z0: ArrayLike, initial_memory: ArrayLike | str = "low"
    ) -> FilterState:
        """Start the filter at the first sample.

        Args:
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

        Args:
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
        # In sample form, a move of the states below √eps is not told from rounding.
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
        info = FilterInfo(
            output=output,
            error=error,
            switched=jnp.where(learns, squared, 0.0),
        )
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
        # The inner `where` keeps 0/0 out of the gradient, the outer one out of the update.
        rate = jnp.where(learns, rule.rate(error, jnp.where(learns, squared, 1.0)), 0.0)
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
        z: ArrayLike,
        state: FilterState | None = None,
        passes: int = 1,
        form: str = "auto",
        adapt: bool = True,
    ) -> FilterResult:
        """Run the filter over a record, once or several times.

        Each pass starts from the memory at the beginning of the first one, and from the weights at
        the end of the one before. A noise-free record is so learnt to the end; with noise the
        weights settle on a cycle that fits the noise as well.

        Args:
            x: (time,) input, in the unit of the plane.
            z: (time,) measured output, in its unit; NaN where it is missing.
            state: the state after an earlier part of the record, which this run continues; without
                it the filter starts from saturated low at the first sample.
            passes: how often the record is taken in, at least once.
            form: "dense", a scan of `step`; "event", the same with O(N) work a switching event of
                relays or a sample of ramps; or "auto": the latter where it can be had, which is
                from saturated low with `sampling="event"`, without leakage, with a concrete record
                and no output missing, and where it is quicker, which ramps are from 50 levels.
            adapt: whether to learn; without it the weights stay, and output and error are those of
                them.

        Returns:
            The weights after the last sample, the rows of each sample and the final state, all of
            the last pass.

        Raises:
            InputError: lengths or types are wrong, an input leaves the plane or is not finite, an
                output is infinite, `passes` is below 1, `adapt` is not a truth value, or there is
                no event form.
        """
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
        chosen = chosen_form(form, self._why_no_events(x, z, state))
        few = form == "auto" and self.plane.levels < LEVELS_FOR_MOVES
        if chosen == "dense" or (self.hysteron == "ramp" and few):
            found = cast(FilterResult, _run(self, x, z, state, count, adapt))
        elif self.hysteron == "relay":
            found = _run_over_events(self, x, z, count, adapt)
        else:
            moves = ramp_moves(self.plane, x)
            found = cast(FilterResult, _run_over_moves(self, x, z, moves, count, adapt))
        return found

    def _why_no_events(self, x: jax.Array, z: jax.Array, state: FilterState | None) -> str:
        if self.sampling != "event":
            return "with sampling='sample'"
        if self.leakage is not None:
            return "with leakage"
        if state is not None:
            return "from a state"
        of_ramps = self.hysteron == "ramp" and isinstance(self.initial_weight, Tracer)
        if of_ramps or isinstance(x, Tracer) or isinstance(z, Tracer):
            return WITHOUT_VALUES
        return "" if np.isfinite(z).all() else "where outputs are missing"


def checked_adapt(adapt: Any) -> bool:
    """Refuse a switch between learning and not learning that is neither true nor false.

    Args:
        adapt: the switch.

    Returns:
        It.

    Raises:
        InputError: it is something else.
    """
    if not isinstance(adapt, bool | np.bool_):
        raise InputError(f"adapt is {adapt!r}: give True or False")
    return bool(cast(bool, adapt))


@partial(jax.jit, static_argnames=("passes", "adapt"))
def _run(
    filt: AdaptiveFilter,
    x: jax.Array,
    z: jax.Array,
    state: FilterState | None,
    passes: int,
    adapt: bool,
) -> FilterResult:
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


def _rule(filt: AdaptiveFilter, dtype: DTypeLike, adapt: bool) -> UpdateRule:
    rule = filt.rule(dtype)
    return rule if adapt else dataclasses.replace(rule, step_size=jnp.zeros((), dtype))


def _run_over_events(
    filt: AdaptiveFilter, x: jax.Array, z: jax.Array, passes: int, adapt: bool
) -> FilterResult:
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
    filt: AdaptiveFilter,
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
def _run_over_moves(
    filt: AdaptiveFilter,
    x: jax.Array,
    z: jax.Array,
    moves: RampMoves,
    passes: int,
    adapt: bool,
) -> FilterResult:
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


def require_plane(plane: Plane) -> None:
    """Refuse what is no plane.

    Args:
        plane: the Preisach plane.

    Raises:
        InputError: it is something else.
    """
    if not isinstance(plane, Plane):
        raise InputError(
            f"the plane is {plane!r}: give a Plane, as in Plane(levels=37, low=0.0, high=75.0)"
        )


def require_one_number(name: str, value: ArrayLike) -> None:
    """Refuse a setting that is not one real number; a traced one may be.

    Args:
        name: its name.
        value: () the setting.

    Raises:
        InputError: it has a shape, or is no number.
    """
    _require_numbers(name, value, "give one number")
    if np.shape(value) != ():
        raise InputError(f"{name} has the shape {np.shape(value)}: give one number")


def _require_between(
    name: str, value: ArrayLike | None, words: str, *, least: bool = False, high: float = 2.0
) -> None:
    """Refuse a setting that does not lie between 0, excluded unless it is `least`, and `high`."""
    if value is None:
        return
    require_one_number(name, value)
    if isinstance(value, Tracer):
        return
    number = np.asarray(value).item()
    if not (0.0 < number < high or (least and number == 0.0)):
        raise InputError(f"{name} is {value}: give a number {words}")


def require_state(plane: Plane, state: Any, kind: type[Any]) -> None:
    """Refuse a state from which a run on a plane cannot be continued.

    Args:
        plane: the Preisach plane.
        state: the state.
        kind: what it must be: `FilterState` for the adaptive filter.

    Raises:
        InputError: it is something else, or the state of another plane.
    """
    if not isinstance(state, kind):
        raise InputError(f"the state is {type(state).__name__}: give a {kind.__name__}")
    shape = state.weights.shape
    if shape != (plane.cells,):
        raise InputError(
            f"state has weights of the shape {shape}: give a state of this plane, ({plane.cells},)"
        )


def check_start(plane: Plane, hysteron: str, initial_weight: ArrayLike) -> None:
    """Refuse what no recursion for the weights can start from.

    Args:
        plane: the Preisach plane.
        hysteron: "relay" or "ramp".
        initial_weight: () or (cells,) weights to start from, in the unit of the output.

    Raises:
        InputError: there is no plane, the kind of hysteron is unknown, or the weights are no finite
            numbers or have a wrong shape.
    """
    require_plane(plane)
    require_hysteron(hysteron)
    remedy = f"give one number or ({plane.cells},)"
    _require_numbers("initial_weight", initial_weight, remedy)
    if np.shape(initial_weight) not in ((), (plane.cells,)):
        raise InputError(f"initial_weight has the shape {np.shape(initial_weight)}: {remedy}")
    require_finite(initial_weight, "initial_weight")


def _require_numbers(name: str, values: ArrayLike, remedy: str) -> None:
    if isinstance(values, Tracer):
        return
    dtype = np.asarray(values).dtype
    if not any(jnp.issubdtype(dtype, kind) for kind in (jnp.floating, jnp.integer)):
        raise InputError(f"{name} is {values!r}: {remedy}")


def start_at(
    plane: Plane,
    hysteron: str,
    initial_weight: ArrayLike,
    x0: ArrayLike,
    z0: ArrayLike,
    initial_memory: ArrayLike | str,
    dtype: DTypeLike | None = None,
) -> tuple[jax.Array, jax.Array, jax.Array, jax.Array]:
    """Bring weights and hysterons to the first sample of a record.

    Args:
        plane: the Preisach plane.
        hysteron: "relay" or "ramp".
        initial_weight: () or (cells,) weights to start from, in the unit of the output.
        x0: () input, in the unit of the plane.
        z0: () measured output, in its unit; NaN if it is missing.
        initial_memory: (cells,) states before the first sample, or the name of an initial memory.
        dtype: floating type to compute in; None is that of the sample.

    Returns:
        `(weights, states, x, z)`: (cells,) twice and () twice, of one floating type.

    Raises:
        InputError: `x0` is not a number on the plane, `z0` is infinite, or the memory is unknown.
    """
    path, output = input_and_output(plane, jnp.reshape(as_float(x0, "x0"), -1), z0)
    if dtype is not None:
        path, output = path.astype(dtype), output.astype(dtype)
    path, states = path_and_start(plane, path, initial_memory, hysteron)
    x = path[0]
    states = hysteron_step(plane, states, x, x, hysteron)
    weights = jnp.broadcast_to(jnp.asarray(initial_weight, x.dtype), states.shape)
    return weights, states, x, output[0]


def input_and_output(plane: Plane, x: ArrayLike, z: ArrayLike) -> tuple[jax.Array, jax.Array]:
    """Check an input and the measured output of it.

    Args:
        plane: the Preisach plane.
        x: (time,) input, in the unit of the plane.
        z: (time,) measured output, in its unit; NaN where it is missing.

    Returns:
        `(x, z)`, (time,) each, of one floating type.

    Raises:
        InputError: lengths or types are wrong, an input leaves the plane or is not finite, or an
            output is infinite.
    """
    require_plane(plane)
    if np.size(x) > MOST_SAMPLES:
        raise InputError(f"there are {np.size(x)} samples: give them in parts, each with its state")
    x, z = as_float(x, "the input x"), as_float(z, "the output z")
    if x.ndim == 1 and z.ndim == 0:
        z = z.reshape(-1)
    if x.ndim != 1 or x.shape != z.shape or x.shape[0] == 0:
        raise InputError(
            f"the input x has the shape {x.shape} and the output z {z.shape}: "
            "give both (time,), with time > 0"
        )
    require_on_plane(plane, x)
    require_finite(z, "the output z", missing=True)
    dtype = jnp.result_type(x, z)
    return x.astype(dtype), z.astype(dtype)

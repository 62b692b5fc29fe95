"""Recursive least squares beside the paper's rule, for the weights and the output's offset."""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.typing import ArrayLike

from preisach_jax.errors import InputError
from preisach_jax.filter.state import (
    FilterInfo,
    check_start,
    input_and_output,
    require_one_number,
    require_state,
    start_at,
)
from preisach_jax.operator.moves import EVENT_SIZE
from preisach_jax.operator.plane import Plane, hysteron_step

# What forgetting leaves of the prior of a cell before it is restored, λᴸ, is at least this, so that
# no variance passes 10⁴ times the initial one.
LEAST_PRIOR = 1e-4


class LeastSquaresState(eqx.Module):
    """What recursive least squares carries from one sample to the next (a pytree).

    Attributes:
        weights: (cells,) estimate R̂, in the unit of the output.
        offset: () estimate ĉ of the output's constant, same unit; NaN while no output was measured.
        covariance: (cells + 1, cells + 1) P, of the weights and the offset, in units of the noise's
            variance; symmetric to the last bit.
        turn: () whole number, the cell whose prior is restored at the next event.
        states: (cells,) hysteron states in [0, 1].
        input: () input of the last sample.
        reference_states: (cells,) hysteron states at the last event.
    """

    weights: jax.Array
    offset: jax.Array
    covariance: jax.Array
    turn: jax.Array
    states: jax.Array
    input: jax.Array
    reference_states: jax.Array


class LeastSquaresResult(NamedTuple):
    """What a run of recursive least squares returns.

    Attributes:
        weights: (cells,) weights R̂ after the last sample, in the unit of the output.
        offset: () offset ĉ after the last sample, same unit.
        output: (time,) model output R̂ᵀy + ĉ with the estimates of that time, before the update; NaN
            before the first measured output.
        error: (time,) a-priori error z - R̂ᵀy - ĉ; NaN where there is no output.
        switched: (time,) sᵀs, how far the states moved since the event before; 0 where nothing was
            updated.
        state: the state after the last sample, from which a run can be continued.
    """

    weights: jax.Array
    offset: jax.Array
    output: jax.Array
    error: jax.Array
    switched: jax.Array
    state: LeastSquaresState


class _EventWalk(NamedTuple):
    """Where a run is between two updates, and the rows that it has written."""

    sample: jax.Array
    states: jax.Array
    input: jax.Array
    is_event: jax.Array
    rows: FilterInfo


class RecursiveLeastSquares(eqx.Module):
    """Recursive least squares for the Preisach weights and the offset of the output.

    After n events the estimates minimise
    Σ_i λ^(n-i) (z_i - R·y_i - c)² + Σ_j q_j (R_j - R̂_j(0))²,
    with the states y of (6), which is exact (Ljung, System Identification, 1999, section 11.2). An
    event is a sample at which relays switched, or by which ramps moved by sᵀs ≥ 1/2; nothing new is
    seen between events. The offset c is free, with no prior of its own. It costs O(L²) an event.

    Forgetting λ < 1 alone would blow up the variance of cells that are not visited (wind-up). So
    each event also restores the prior of one cell, all in turn, by what λ takes from it in L
    events: a regularisation of the information matrix, spread over time. The strength of the prior
    so keeps λᴸ/v ≤ q_j ≤ 2/v with the initial variance v, no variance of a weight passes v/λᴸ, and
    the weight of a cell unvisited for long returns to its initial one. Without forgetting q_j is
    1/v.

    Rounding grows with the ratio of the variances, so it works in double precision only.

    Arguments:
        plane: the Preisach plane.
        hysteron: "relay" or "ramp".
        forgetting: () λ, 0 < λ ≤ 1, that an event leaves of the ones before; it remembers
            1/(1 - λ) events.
        initial_weight: () or (cells,) weights R̂(0) to start from, in the unit of the output.
        initial_variance: () v, variance of the weights about the initial ones, in units of the
            noise's variance. The larger it is, the less do the weights keep to the initial ones.

    Raises:
        InputError: a name is unknown, a number is out of its range or has a wrong shape, or the
            forgetting is too quick for the plane's cells.

    Example:
        >>> import jax, numpy as np
        >>> plane = Plane(levels=4, low=0.0, high=1.0)
        >>> x = np.abs(np.mod(np.linspace(0.0, 9.0, 400), 2.0) - 1.0)
        >>> with jax.enable_x64(True):
        ...     result = RecursiveLeastSquares(plane, "ramp").run(x, 3.0 * x + 5.0)
        >>> round(float(result.offset), 2), round(float(np.asarray(result.weights).sum()), 2)
        (5.0, 3.0)
    """

    plane: Plane
    hysteron: str = eqx.field(static=True, default="relay")
    forgetting: ArrayLike = 1.0
    initial_weight: ArrayLike = 1e-9
    initial_variance: ArrayLike = 100.0

    def __check_init__(self) -> None:
        check_start(self.plane, self.hysteron, self.initial_weight)
        require_one_number("forgetting", self.forgetting)
        require_one_number("initial_variance", self.initial_variance)
        if not isinstance(self.initial_variance, Tracer):
            variance = np.asarray(self.initial_variance).item()
            if not 0.0 < variance < math.inf:
                raise InputError(f"initial_variance is {variance}: give a number above 0")
        if not isinstance(self.forgetting, Tracer):
            cells = self.plane.cells
            forgetting, least = np.asarray(self.forgetting).item(), LEAST_PRIOR ** (1.0 / cells)
            if not least <= forgetting <= 1.0:
                raise InputError(
                    f"forgetting is {forgetting}: with {cells} cells give a number from "
                    f"{math.ceil(least * 1e6) / 1e6} to 1"
                )

    def init(
        self, x0: ArrayLike, z0: ArrayLike, initial_memory: ArrayLike | str = "low"
    ) -> LeastSquaresState:
        """Start at the first sample.

        Arguments:
            x0: () input, in the unit of the plane.
            z0: () measured output, in its unit; NaN if it is missing.
            initial_memory: (cells,) states before the first sample, or the name of an initial
                memory (see `Plane.initial_states`); then x0 forces what it forces, rule (1).

        Returns:
            The state after the first sample; step on with the second (or, which changes nothing,
            with the first).

        Raises:
            InputError: `x0` is not a number on the plane, `z0` is infinite, the memory is unknown,
                or JAX is set to single precision.
        """
        require_double()
        weights, states, x, z = start_at(
            self.plane, self.hysteron, self.initial_weight, x0, z0, initial_memory, float
        )
        nothing = jnp.zeros((self.plane.cells + 1,) * 2)
        turn, offset = jnp.zeros((), int), jnp.asarray(jnp.nan, float)
        state = LeastSquaresState(weights, offset, nothing, turn, states, x, states)
        # Where z0 is missing, so is the offset, and the first measured output begins anew.
        return _begin(self, state, z)

    def step(
        self, state: LeastSquaresState, x: ArrayLike, z: ArrayLike
    ) -> tuple[LeastSquaresState, FilterInfo]:
        """Take in one sample, and at an event improve the estimates.

        Pure; values are not checked here. `run` is quicker, as it goes from event to event.

        Arguments:
            state: the state after the sample before.
            x: () input, in the unit of the plane; finite, and beyond the plane it saturates.
            z: () measured output, in its unit; NaN if it is missing.

        Returns:
            The state after this sample, and what to record of it (see `LeastSquaresResult`).
        """
        x, z = jnp.asarray(x, float), jnp.asarray(z, float)
        states, info, is_event = _look(self, state, state.states, state.input, x, z)
        here = dataclasses.replace(state, states=states, input=x)

        def kept(
            _: RecursiveLeastSquares, state: LeastSquaresState, __: jax.Array
        ) -> LeastSquaresState:
            return state

        return cast(LeastSquaresState, jax.lax.cond(is_event, _update, kept, self, here, z)), info

    def run(
        self, x: ArrayLike, z: ArrayLike | None = None, state: LeastSquaresState | None = None
    ) -> LeastSquaresResult:
        """Run over a record, from event to event.

        Arguments:
            x: (time,) input, in the unit of the plane.
            z: (time,) measured output, in its unit; NaN where it is missing.
            state: the state after an earlier part of the record, which this run continues; without
                it the run starts from saturated low at the first sample.

        Returns:
            The estimates after the last sample, the rows of each sample and the final state; not
            differentiable backward.

        Raises:
            InputError: lengths or types are wrong, an input leaves the plane or is not finite, an
                output is infinite, or JAX is set to single precision.
        """
        require_double()
        x, z = input_and_output(self.plane, x, z)
        if state is not None:
            require_state(self.plane, state, LeastSquaresState)
        return cast(LeastSquaresResult, _run(self, x.astype(float), z.astype(float), state))


def _look(
    filt: RecursiveLeastSquares,
    state: LeastSquaresState,
    states: jax.Array,
    previous: jax.Array,
    x: jax.Array,
    z: jax.Array,
) -> tuple[jax.Array, FilterInfo, jax.Array]:
    """States after x, what to record, and whether the sample is an event."""
    states = hysteron_step(filt.plane, states, previous, x, filt.hysteron)
    output = jnp.sum(state.weights * states) + state.offset
    squared = jnp.sum((states - state.reference_states) ** 2)
    knows_offset = jnp.isfinite(state.offset)
    is_event = jnp.isfinite(z) & (~knows_offset | (squared >= EVENT_SIZE))
    switched = jnp.where(is_event & knows_offset, squared, 0.0)
    return states, FilterInfo(output, z - output, switched), is_event


def _update(
    filt: RecursiveLeastSquares, state: LeastSquaresState, z: jax.Array
) -> LeastSquaresState:
    unknown = jnp.isnan(state.offset)
    return cast(LeastSquaresState, jax.lax.cond(unknown, _begin, _learn, filt, state, z))


def _begin(
    filt: RecursiveLeastSquares, state: LeastSquaresState, z: jax.Array
) -> LeastSquaresState:
    """The first measured output: it makes the offset known as well as the weights are.

    Limit of an infinite variance of the offset: c = z - R·y - n with independent R and n.
    """
    cells, y = filt.plane.cells, state.states
    variance = jnp.asarray(filt.initial_variance, float)
    shared = -variance * y[:, None]
    corner = (variance * jnp.sum(y * y) + 1.0).reshape(1, 1)
    covariance = jnp.block([[variance * jnp.eye(cells), shared], [shared.T, corner]])
    return dataclasses.replace(
        state, offset=z - jnp.sum(state.weights * y), covariance=covariance, reference_states=y
    )


def _learn(
    filt: RecursiveLeastSquares, state: LeastSquaresState, z: jax.Array
) -> LeastSquaresState:
    """An event: two observations, the output, and one cell's initial weight for its prior."""
    cells, cell = filt.plane.cells, state.turn
    forgetting = jnp.asarray(filt.forgetting, float)
    lost = -jnp.expm1(cells * jnp.log(forgetting)) / jnp.asarray(filt.initial_variance, float)
    strength = jnp.sqrt(lost)
    initial = jnp.broadcast_to(jnp.asarray(filt.initial_weight, float), (cells,))[cell]
    old = jnp.append(state.weights, state.offset)
    y = jnp.append(state.states, 1.0)

    spread = (state.covariance @ y) / forgetting
    spread_cell = state.covariance[cell] * (strength / forgetting)
    # Cholesky factor of the observations' covariance; u uᵀ and v vᵀ are symmetric as rounded.
    first = jnp.sqrt(1.0 + jnp.sum(y * spread))
    u = spread / first
    shared = strength * u[cell]
    second = jnp.sqrt(1.0 + strength * spread_cell[cell] - shared**2)
    v = (spread_cell - shared * u) / second
    surprise = (z - jnp.sum(y * old)) / first
    surprise_cell = (strength * (initial - old[cell]) - shared * surprise) / second
    new = old + u * surprise + v * surprise_cell
    covariance = state.covariance / forgetting
    covariance = covariance - u[:, None] * u[None, :] - v[:, None] * v[None, :]
    return dataclasses.replace(
        state,
        weights=new[:cells],
        offset=new[cells],
        covariance=covariance,
        turn=(cell + 1) % cells,
        reference_states=state.states,
    )


@jax.jit
def _run(
    filt: RecursiveLeastSquares, x: jax.Array, z: jax.Array, state: LeastSquaresState | None
) -> LeastSquaresResult:
    if state is None:
        state = filt.init(x[0], z[0])

    def to_next_event(state: LeastSquaresState, walk: _EventWalk) -> _EventWalk:
        # The covariance stays outside of this loop, so that a sample costs O(L).
        def advance(walk: _EventWalk) -> _EventWalk:
            k = walk.sample
            states, info, is_event = _look(filt, state, walk.states, walk.input, x[k], z[k])
            rows = FilterInfo(
                *(row.at[k].set(value) for row, value in zip(walk.rows, info, strict=True))
            )
            return _EventWalk(k + 1, states, x[k], is_event, rows)

        def goes_on(walk: _EventWalk) -> jax.Array:
            return (walk.sample < x.shape[0]) & ~walk.is_event

        begin = walk._replace(is_event=jnp.asarray(False))
        return jax.lax.while_loop(goes_on, advance, begin)

    def at_event(carry: tuple[LeastSquaresState, _EventWalk]) -> jax.Array:
        return carry[1].is_event

    def take_event(
        carry: tuple[LeastSquaresState, _EventWalk],
    ) -> tuple[LeastSquaresState, _EventWalk]:
        state, walk = carry
        state = dataclasses.replace(state, states=walk.states, input=walk.input)
        state = _update(filt, state, z[walk.sample - 1])
        return state, to_next_event(state, walk)

    rows = FilterInfo(*[jnp.zeros(x.shape)] * len(FilterInfo._fields))
    start = _EventWalk(jnp.asarray(0), state.states, state.input, jnp.asarray(False), rows)
    begin = (state, to_next_event(state, start))
    state, walk = jax.lax.while_loop(at_event, take_event, begin)
    state = dataclasses.replace(state, states=walk.states, input=walk.input)
    return LeastSquaresResult(state.weights, state.offset, *walk.rows, state)


def require_double() -> None:
    """Refuse single precision, in which the covariance loses its meaning."""
    if jnp.result_type(float) != jnp.float64:
        raise InputError(
            "JAX computes in float32, and recursive least squares needs float64: "
            "call jax.config.update('jax_enable_x64', True) first"
        )

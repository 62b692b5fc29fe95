"""The paper's recursion over switching events."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike

from preisach_jax.operator.cells import laid_out
from preisach_jax.operator.plane import Plane
from preisach_jax.operator.switching import Switching
from preisach_jax.operator.update import UpdateRule


def _sums_of_rows(matrix: jax.Array) -> jax.Array:
    """(levels, levels + 1) sums of the first q cells of each row."""
    return jnp.cumsum(jnp.pad(matrix, ((0, 0), (1, 0))), axis=1)


def output_rises(plane: Plane, switching: Switching, weights: ArrayLike) -> jax.Array:
    """Rise of the model's output (6) at each event, Σ R on S⁺ less Σ R on S⁻.

    Sums along a line of the plane are differences of cumulated weights, so that an event costs as
    much as it has lines.

    Arguments:
        plane: the Preisach plane.
        switching: the events.
        weights: (cells,) weights R, in the unit of the output.

    Returns:
        (events,) rises, same unit; 0 where there is no event.

    Example:
        >>> from preisach_jax.operator.events import switching_events
        >>> plane = Plane(levels=2, low=0.0, high=2.0)
        >>> switching = switching_events(plane, [0.0, 2.0, 1.0])
        >>> output_rises(plane, switching, jnp.asarray([1.0, 2.0, 4.0])).tolist()
        [7.0, -4.0]
    """
    matrix = laid_out(plane, jnp.asarray(weights))
    rows, columns = _sums_of_rows(matrix), _sums_of_rows(matrix.T).T
    line, first, last = switching.line, switching.first, switching.last
    on = rows.at[line, last].get(mode="clip") - rows.at[line, first].get(mode="clip")
    off = columns.at[first, line].get(mode="clip") - columns.at[last, line].get(mode="clip")
    rises = jnp.where(jnp.expand_dims(switching.rising, -1), on, off)
    return jnp.sum(jnp.where(last > first, rises, 0.0), axis=-1)


def measured_rises(switching: Switching, z: jax.Array) -> jax.Array:
    """Rise of measured outputs from event to event, as `adapt_over_events` takes it.

    Arguments:
        switching: the events.
        z: (time, lanes) outputs.

    Returns:
        (events, lanes) rises; the first one since the start, and 0 where there is no event.

    Example:
        >>> from preisach_jax.operator.events import switching_events
        >>> switching = switching_events(Plane(levels=2, low=0.0, high=2.0), [0.0, 2.0, 1.0])
        >>> measured_rises(switching, jnp.asarray([[1.0], [8.0], [5.0]]))[:, 0].tolist()
        [7.0, -3.0]
    """
    return jnp.diff(jnp.concatenate([z[:1], z.at[switching.sample].get(mode="clip")]), axis=0)


def adapt_over_events(
    plane: Plane,
    switching: Switching,
    increments: ArrayLike,
    weights: ArrayLike,
    rule: UpdateRule | None = None,
) -> tuple[jax.Array, jax.Array]:
    """Run the paper's recursion over switching events, for many outputs of one input at once.

    At each event e = Δz - (Σ R̂ on S⁺ - Σ R̂ on S⁻), eq. (7), and then R̂ ← R̂ ± e/A on S±, eq. (8),
    (12), which touches only the cells that switch: O(N) an event. The same as `AdaptiveFilter`.

    Arguments:
        plane: the Preisach plane.
        switching: the events of the input that all lanes share.
        increments: (events, lanes) rise of the measured output since the event before (at the first
            one, since the start), in the unit of the output.
        weights: (cells, lanes) weights to start from, same unit.
        rule: what an error does; without it, the paper's rule.

    Returns:
        `(weights, errors)`: (cells, lanes) weights after the last event, and (events, lanes) errors
        e(k), 0 where there is no event.

    Example:
        >>> from preisach_jax.operator.events import switching_events
        >>> plane = Plane(levels=3, low=0.0, high=3.0)
        >>> switching = switching_events(plane, [0.0, 1.0, 2.0, 1.0, 0.0])
        >>> rises = jnp.asarray([[1.0], [2.0], [-2.0], [-1.0]])
        >>> weights, errors = adapt_over_events(plane, switching, rises, jnp.zeros((6, 1)))
        >>> weights[:, 0].tolist()
        [0.5, 0.5, 2.0, 0.0, 0.0, 0.0]
    """
    rule = UpdateRule() if rule is None else rule
    weights = jnp.asarray(weights)
    increments = jnp.asarray(increments, weights.dtype)
    sign, area = switching.sign.astype(weights.dtype), switching.area.astype(weights.dtype)

    def adapt(
        weights: jax.Array, event: tuple[Switching, jax.Array, jax.Array, jax.Array]
    ) -> tuple[jax.Array, jax.Array]:
        crossing, increment, sign, area = event
        cells = crossing.cells(plane)
        there = weights.at[cells].get(mode="fill", fill_value=0.0)
        error = jnp.where(area > 0, increment - sign * jnp.sum(there, axis=0), 0.0)
        move = sign * rule.rate(error, jnp.maximum(area, 1.0))
        if rule.dead_zone is not None:
            move = jnp.where(rule.learns(error), move, 0.0)
        move = jnp.broadcast_to(move, (cells.shape[0], move.shape[0]))
        # Fillings repeat an index, so that indices are not unique; they are dropped.
        if rule.nonnegative:
            return weights.at[cells].set(jnp.maximum(there + move, 0.0), mode="drop"), error
        return weights.at[cells].add(move, mode="drop"), error

    events = (switching, increments, sign, area)
    return jax.lax.scan(adapt, weights, events)

"""States of hysterons whose input depends on the output that they make."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import jax
import jax.numpy as jnp
import numpy as np

from preisach_jax.operator.plane import Plane
from preisach_jax.operator.states import Paths, step_of_paths

MOST_TRIALS = 60
"""Trials by which an output is found that agrees with itself; two or three are usual."""

_Bounds = tuple[jax.Array, jax.Array]
_FedBack = tuple[_Bounds, Paths, jax.Array]
_Trial = tuple[jax.Array | int, jax.Array, jax.Array, jax.Array, jax.Array]


def _first(course: jax.Array) -> jax.Array:
    return course[0]


def fed_back_states(
    plane: Plane,
    weights: jax.Array,
    memory: jax.Array,
    course: Any,
    seen: Callable[[Any, jax.Array, jax.Array], Paths],
    hysteron: str = "ramp",
) -> jax.Array:
    """Weigh the states of hysterons whose inputs depend on the output, as `weighted_states` does.

    At every sample the output is found that agrees with itself, by Newton steps kept inside a
    bracket: a hysteresis never falls with its input, and its output has bounds.

    Arguments:
        plane: the Preisach plane.
        weights: (cells,) weights R, not negative.
        memory: (cells,) output m that each unknown start adds, not negative.
        course: arrays whose first axis is time: what drives the hysterons beside their output.
        seen: inputs of thresholds α, of β, and of the diagonal, from a sample of the course, the
            output before it, and a trial of the output at it.
        hysteron: "relay" or "ramp".

    Returns:
        (time,) output h, in output units.

    Example:
        >>> from preisach_jax.operator.plane import Plane
        >>> plane, ones = Plane(levels=2, low=0.0, high=3.0), jnp.ones(3)
        >>> half = lambda x, before, output: (x - 0.5 * output,) * 3
        >>> fed_back_states(plane, ones, 0 * ones, jnp.array([0.0, 1.0]), half).tolist()
        [0.0, 0.5]
    """
    most = weights.sum() + memory.sum()
    close = 8 * cast(np.floating, jnp.finfo(weights.dtype).eps) * most

    def advance(carry: _FedBack, sample: Any) -> tuple[_FedBack, jax.Array]:
        states, previous, before = carry

        def moved(output: jax.Array) -> tuple[jax.Array, tuple[_Bounds, Paths]]:
            now = seen(sample, before, output)
            low, high = (step_of_paths(plane, each, previous, now, hysteron) for each in states)
            return low @ weights + (high - low) @ memory, ((low, high), now)

        def improved(trial: _Trial) -> _Trial:
            count, output, bottom, top, _ = trial
            answer, slope, _ = jax.jvp(moved, (output,), (jnp.ones_like(output),), has_aux=True)
            excess = answer - output
            bottom, top = jnp.where(excess > 0, output, bottom), jnp.where(excess > 0, top, output)
            newton = output + excess / jnp.where(slope < 1, 1 - slope, 1.0)
            # Where steps or corners keep Newton's from converging, halving the bracket does.
            good = (slope < 1) & (newton > bottom) & (newton < top) & (count % 4 != 3)
            after = jnp.where(good, newton, (bottom + top) / 2)
            done = (jnp.abs(excess) <= close) | (top - bottom <= close)
            return count + 1, jnp.where(done, output, after), bottom, top, done

        def unfinished(trial: _Trial) -> jax.Array:
            return ~trial[-1] & (trial[0] < MOST_TRIALS)

        begin: _Trial = (0, before, jnp.zeros_like(most), most, jnp.asarray(False))
        output = jax.lax.while_loop(unfinished, improved, begin)[1]
        output, after = moved(output)
        return (*after, output), output

    zero = jnp.zeros(plane.cells, weights.dtype)
    nothing = jnp.zeros((), weights.dtype)
    first = jax.tree.map(_first, course)
    paths: Paths = jax.eval_shape(seen, first, nothing, nothing)
    # An input before the first that is no number compares as one that does not move.
    previous = tuple(jnp.full_like(path, jnp.nan) for path in paths)
    return jax.lax.scan(advance, ((zero, zero + 1.0), previous, nothing), course)[1]

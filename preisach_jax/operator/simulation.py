"""The Preisach model's output along an input, eq. (6)."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any, cast

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.typing import ArrayLike

from preisach_jax.errors import InputError
from preisach_jax.operator.branches import output_along_branches
from preisach_jax.operator.checks import as_float
from preisach_jax.operator.hysteron import hysteron_step
from preisach_jax.operator.paths import as_path, path_and_start, require_plane
from preisach_jax.operator.plane import Plane

FORMS = ("auto", "dense", "event")


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

    Arguments:
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
    """Choose between the dense form and the event form."""
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

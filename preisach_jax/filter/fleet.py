"""A fleet of records: the adaptive filter on many stages at once, shared among all devices."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from preisach_jax.devices import compiled, evenly
from preisach_jax.errors import InputError, whole_number
from preisach_jax.filter.adaptive import AdaptiveFilter
from preisach_jax.filter.state import input_and_output
from preisach_jax.operator.events import Room
from preisach_jax.operator.simulation import simulate


class FleetResult(NamedTuple):
    """What the adaptive filter found of each record of a fleet.

    Attributes:
        weights: (records, cells) weights R̂ after the last sample, in the unit of the output.
        error: (records,) rms of the differential output error e(k) over the updates of the last
            pass, in the unit of the output; NaN without any.
        updates: (records,) how many samples of a pass updated weights.
        replay_error: (records,) rms of what `simulate` with the final weights leaves of the whole
            record beside the offset, in the unit of the output.
        offset: (records,) mean of what it leaves: the filter learns differences, and no constant.
    """

    weights: np.ndarray
    error: np.ndarray
    updates: np.ndarray
    replay_error: np.ndarray
    offset: np.ndarray


def run_fleet(
    adaptive: AdaptiveFilter,
    inputs: Sequence[ArrayLike] | ArrayLike,
    outputs: Sequence[ArrayLike] | ArrayLike,
    passes: int = 1,
) -> FleetResult:
    """Run one adaptive filter on each of many records, shared among the devices of this process.

    The same as `AdaptiveFilter.run` on one record after another, from saturated low. Relays go from
    one switching event to the next where no output is missing.

    Arguments:
        adaptive: the filter.
        inputs: (records, time) inputs, or a sequence of rows of any lengths, in the plane's unit.
        outputs: measured outputs of the same shapes; NaN where they are missing.
        passes: number of passes over each record.

    Returns:
        The weights and errors of each record.

    Raises:
        InputError: there is no record, one is not sound (the message has its number), or `passes`
            is below 1.

    Example:
        >>> from preisach_jax.operator.plane import Plane
        >>> rows = [np.abs(np.mod(np.linspace(0.0, n, 60 * n), 2.0) - 1.0) for n in (5, 9)]
        >>> adaptive = AdaptiveFilter(Plane(levels=4, low=0.0, high=1.0))
        >>> found = run_fleet(adaptive, rows, [3.0 * rows[0], 2.0 * rows[1]])
        >>> found.weights.shape, found.updates.tolist()
        ((2, 10), [20, 36])
    """
    passes = whole_number("passes is", passes, 1)
    if not isinstance(adaptive, AdaptiveFilter):
        raise InputError(
            f"the filter is {adaptive!r}: give an AdaptiveFilter, as of pj.AdaptiveFilter"
        )
    rows = _checked(adaptive, inputs, outputs)
    lengths = [len(x) for x, _ in rows]
    # A row that is shorter rests at its last value.
    x, z = (
        np.stack([np.pad(row, (0, max(lengths) - len(row)), mode="edge") for row in side])
        for side in zip(*rows, strict=True)
    )
    missing = not all(np.isfinite(own).all() for _, own in rows)
    if missing:  # else the output rests with the input
        z = np.where(np.arange(max(lengths)) < np.array(lengths)[:, None], z, np.nan)
    room = adaptive.room(x) if adaptive.hysteron == "relay" else None
    count = evenly(len(rows))
    x, z, until = (
        np.concatenate([side, side[-1:].repeat(count - len(rows), axis=0)])
        for side in (x, z, np.array(lengths))
    )
    numbers, structure = cast(
        tuple[list[np.ndarray], Any], jax.tree.flatten(jax.tree.map(np.asarray, adaptive))
    )
    kinds = tuple(
        jax.ShapeDtypeStruct(one.shape, jax.dtypes.canonicalize_dtype(one.dtype)) for one in numbers
    )
    run = _compiled_run(structure, kinds, room, missing, x.shape, x.dtype, passes)
    found = run(numbers, (x, z, until))
    return FleetResult(*(np.asarray(values)[: len(rows)] for values in found))


def _checked(
    adaptive: AdaptiveFilter, inputs: Any, outputs: Any
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Input and output of each record, of one floating type."""
    try:
        inputs, outputs = list(inputs), list(outputs)
    except TypeError:
        raise InputError(
            f"the inputs are {type(inputs).__name__} and the outputs {type(outputs).__name__}: "
            "give a sequence of rows each, outside of compiled functions"
        ) from None
    if len(inputs) != len(outputs) or not inputs:
        raise InputError(
            f"there are {len(inputs)} inputs and {len(outputs)} outputs: give one of each for "
            "every record, at least one"
        )
    rows: list[tuple[jax.Array, jax.Array]] = []
    for number, pair in enumerate(zip(inputs, outputs, strict=True)):
        try:
            rows.append(input_and_output(adaptive.plane, *pair))
        except InputError as error:
            raise InputError(f"record {number}: {error}") from None
    kind = jnp.result_type(*(side for row in rows for side in row))
    return [(np.asarray(x, kind), np.asarray(z, kind)) for x, z in rows]


_Found = tuple[jax.Array, jax.Array, jax.Array, jax.Array, jax.Array]


@functools.lru_cache(maxsize=8)
def _compiled_run(
    structure: Any,
    kinds: tuple[jax.ShapeDtypeStruct, ...],
    room: Room | None,
    missing: bool,
    shape: tuple[int, ...],
    dtype: np.dtype,
    passes: int,
) -> Callable[[Any, Any], Any]:
    def run(numbers: list[jax.Array], rows: tuple[jax.Array, jax.Array, jax.Array]) -> _Found:
        adaptive: AdaptiveFilter = jax.tree.unflatten(structure, numbers)

        def identify(x: jax.Array, z: jax.Array, until: jax.Array) -> _Found:
            found = adaptive.run(x, z, passes=passes, room=room, missing=missing)
            weights, _, errors, switched, _ = found
            updated = switched > 0
            measured = jnp.isfinite(z) & (jnp.arange(len(z)) < until)
            left = z - simulate(adaptive.plane, weights, x, adaptive.hysteron)
            offset = _mean(left, measured)
            replay_error = _rms(left - offset, measured)
            return weights, _rms(errors, updated), jnp.sum(updated), replay_error, offset

        return jax.vmap(identify)(*rows)

    side = jax.ShapeDtypeStruct(shape, dtype)
    return compiled(
        run,
        list(kinds),
        (side, side, jax.ShapeDtypeStruct(shape[:1], jax.dtypes.canonicalize_dtype(int))),
    )


def _mean(values: jax.Array, counted: jax.Array) -> jax.Array:
    return jnp.sum(jnp.where(counted, values, 0.0)) / jnp.sum(counted)


def _rms(values: jax.Array, counted: jax.Array) -> jax.Array:
    return jnp.sqrt(_mean(values**2, counted))

"""A fleet of records: the adaptive filter on many stages at once, shared among all devices."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from preisach_jax.devices import compiled, evenly, from_first, gathered, is_first
from preisach_jax.errors import InputError, whole_number
from preisach_jax.filter.adaptive import AdaptiveFilter
from preisach_jax.filter.checks import input_and_output
from preisach_jax.operator.blocks import Room
from preisach_jax.operator.simulation import simulate
from preisach_jax.work.chunks import Chunks, Values
from preisach_jax.work.manifest import read_manifest
from preisach_jax.work.run import Work, work_in_chunks


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
    """Run one adaptive filter on each of many records, shared among the devices of all processes.

    The same as `AdaptiveFilter.run` on one record after another, from saturated low. Relays go from
    one switching event to the next where no output is missing.

    Arguments:
        adaptive: the filter.
        inputs: (records, time) inputs, or a sequence of rows of any lengths, in the plane's unit.
        outputs: measured outputs of the same shapes; NaN where they are missing.
        passes: number of passes over each record.

    Returns:
        The weights and errors of each record, the same in every process.

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
    x, z = (
        np.stack([_lengthened(row, max(lengths)) for row in side])
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
    found = gathered(run(numbers, (x, z, until)))
    return FleetResult(*(values[: len(rows)] for values in found))


def fleet_to_folder(
    folder: str | Path,
    adaptive: AdaptiveFilter,
    records: Sequence[tuple[ArrayLike, ArrayLike]],
    names: Sequence[str] | None = None,
    passes: int = 1,
    chunk: int = 16,
    resume: bool = True,
    progress: Callable[[str, float], None] | None = None,
    announce: Callable[[str], object] | None = None,
) -> FleetResult | None:
    """Run one filter on each of many records by chunks into a folder, or go on with that.

    The folder holds `manifest.json`, and `fleet.zarr` with the fields of `FleetResult`.

    Arguments:
        folder: the folder; it need not exist.
        adaptive: the filter.
        records: input and output of each, as for `run_fleet`.
        names: a name of each, which the folder keeps; by default their numbers. Records that a
            folder holds are known again by a digest of their values, in any order, and more of them
            continue its fleet.
        passes: number of passes over each record.
        chunk: how many records are computed at once, and written when they are done.
        resume: keep the chunks that are there; otherwise start anew.
        progress: called with a text and the part that is done.
        announce: called with a note for each chunk that is there and must be computed again, and if
            memory is too small for a whole chunk at once.

    Returns:
        The results of all records; in processes other than the first, those that it computed with
        them, which may be none.

    Raises:
        InputError: as `run_fleet`, or the folder holds other work, or records that are not given,
            or cannot be written to.

    Example:
        >>> import tempfile
        >>> from preisach_jax.operator.plane import Plane
        >>> x = np.abs(np.mod(np.linspace(0.0, 9.0, 500), 2.0) - 1.0)
        >>> adaptive = AdaptiveFilter(Plane(levels=4, low=0.0, high=1.0))
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     found = fleet_to_folder(folder, adaptive, [(x, 3.0 * x), (x, 2.0 * x)])
        >>> found.weights.shape
        (2, 10)
    """
    whole_number("passes is", passes, 1)
    rows, names = _named_rows(adaptive, list(records), names)
    digests = [_digest(*row) for row in rows]
    order = _as_held(Path(folder), digests) if resume else np.arange(len(rows))
    rows = [rows[k] for k in order]
    settings = _settings(adaptive, [digests[k] for k in order], passes, chunk)
    about = {"names": [names[k] for k in order]}
    chunks = Chunks(Path(folder), "fleet", "record", settings, about=about)

    def compute(numbers: list[int]) -> FleetResult:
        inputs, outputs = zip(*(rows[k] for k in numbers), strict=True)
        return run_fleet(adaptive, inputs, outputs, passes)

    def read(numbers: list[int]) -> FleetResult:
        arrays, _ = chunks.read(numbers, FleetResult._fields)
        return FleetResult(**arrays)

    def write(numbers: list[int], part: FleetResult) -> None:
        axes = {"weights": ("record", "cell")}
        arrays = {
            name: Values(axes.get(name, ("record",)), values)
            for name, values in part._asdict().items()
        }
        chunks.write(numbers, arrays, {})

    work = Work(compute, read, write, _joined)
    found = work_in_chunks(chunks, work, resume, None, progress, announce)
    if found is None or len(found.updates) < len(rows):
        return found
    given = np.argsort(order)
    return FleetResult(*(values[given] for values in found))


def _named_rows(
    adaptive: AdaptiveFilter, pairs: Sequence[Any], names: Sequence[str] | None
) -> tuple[list[tuple[np.ndarray, np.ndarray]], list[str]]:
    """Input and output of each record, and its name."""
    if not all(_is_pair(pair) for pair in pairs):
        raise InputError("records: give input and output of each, as (record.input, record.output)")
    names = [str(number) for number in range(len(pairs))] if names is None else list(names)
    if len(names) != len(pairs):
        raise InputError(f"there are {len(names)} names of {len(pairs)} records: give one of each")
    return _checked(adaptive, [x for x, _ in pairs], [z for _, z in pairs]), names


def _is_pair(given: Any) -> bool:
    return isinstance(given, tuple | list) and len(cast(Sequence[Any], given)) == 2


def _as_held(folder: Path, digests: Sequence[str]) -> np.ndarray:
    """Positions of the records, those that a folder holds first, in its order."""
    # The folder may be out of sight of the other processes.
    manifest = read_manifest(folder, "fleet", "records") if is_first() else None
    left = list(range(len(digests)))
    first: list[int] = []
    for digest in manifest["settings"]["records"] if manifest is not None else ():
        known = [k for k in left if digests[k] == digest]
        first += known[:1]
        left = [k for k in left if k not in known[:1]]
    return from_first(np.array(first + left))


def _settings(
    adaptive: AdaptiveFilter, digests: Sequence[str], passes: int, chunk: int
) -> dict[str, Any]:
    """What the manifest of a fleet holds."""
    plane, start = adaptive.plane, np.asarray(adaptive.initial_weight, float)
    return {
        "records": list(digests),
        "chunk": whole_number("chunk is", chunk, 1),
        "levels": plane.levels,
        "low": plane.low,
        "high": plane.high,
        "hysteron": adaptive.hysteron,
        "sampling": adaptive.sampling,
        "passes": passes,
        "step_size": float(np.asarray(adaptive.step_size)),
        "initial_weight": start.item() if start.ndim == 0 else _digest(start),
        **adaptive.options(),
    }


def _joined(parts: Sequence[FleetResult]) -> FleetResult:
    return FleetResult(*(np.concatenate(rows) for rows in zip(*parts, strict=True)))


def _digest(*arrays: np.ndarray) -> str:
    digest = hashlib.sha256()
    for values in arrays:
        digest.update(np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()[:12]


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


def _lengthened(row: np.ndarray, length: int) -> np.ndarray:
    """A row that rests at its last value until a length."""
    return np.pad(row, (0, length - len(row)), mode="edge")


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

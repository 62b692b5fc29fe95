"""A batch shared among all devices: of one process, or of several on one or many hosts.

JAX itself shares the work: `connect` makes the devices of all processes known to each, a batch is
laid out along one axis of a mesh of them all, and every process runs the same program.
"""

from __future__ import annotations

import math
import os
import re
import sys
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from functools import partial
from typing import Any, cast

import jax
import numpy as np
from jax.experimental import multihost_utils
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from preisach_jax.cores import usable_cores
from preisach_jax.errors import InputError, whole_number

AXIS = "batch"

CONNECTING_S = 60
"""Seconds that a process waits for the others at the start."""

SILENT_S = 30
"""Seconds without a sign of life after which a process counts as dead, and the others end."""


def use_all_cores() -> None:
    """Give JAX one CPU device for each core that this process may use, to share a batch.

    It is a setting of the whole process, and one that JAX takes only before its first computation:
    after that, the devices stay as they are.

    Example:
        >>> use_all_cores()  # doctest: +SKIP
    """
    with suppress(RuntimeError):
        jax.config.update("jax_num_cpu_devices", usable_cores())


def connect(
    coordinator: str | None = None, processes: int | None = None, process: int | None = None
) -> None:
    """Join this process with others, so that all share their devices; before JAX computes.

    Under Slurm, Open MPI and the like JAX finds the others itself, and nothing need be given.

    Arguments:
        coordinator: address `HOST:PORT` of process 0, which the others can reach.
        processes: how many processes there are.
        process: which of them this is, from 0.

    Raises:
        InputError: the numbers do not fit, or the others were not reached within a minute.

    Example:
        >>> connect("localhost:1", processes=2, process=2)
        Traceback (most recent call last):
        ...
        preisach_jax.errors.InputError: process is 2 of 2 processes: give a number from 0 to 1
    """
    given = {"coordinator": coordinator, "processes": processes, "process": process}
    missing = [name for name, value in given.items() if value is None]
    if 0 < len(missing) < len(given):
        raise InputError(
            f"{' and '.join(missing)} is missing: give all three of {', '.join(given)}, or none "
            "where a scheduler such as Slurm tells them"
        )
    if coordinator is not None:
        host, _, port = coordinator.rpartition(":")
        if not (host and port.isdecimal()):
            raise InputError(f"coordinator is {coordinator!r}: give HOST:PORT, as node1:12345")
        count = whole_number("processes is", processes, 1)
        if whole_number("process is", process, 0) >= count:
            raise InputError(
                f"process is {process} of {count} processes: give a number from 0 to {count - 1}"
            )
    failure: list[Exception] = []

    def reach() -> None:
        try:
            jax.distributed.initialize(
                coordinator,
                processes,
                process,
                initialization_timeout=10 * CONNECTING_S,
                heartbeat_timeout_seconds=SILENT_S,
                shutdown_timeout_seconds=SILENT_S,
            )
        except Exception as error:  # of whatever kind: it is told by the thread that waits
            failure.append(error)

    # JAX aborts the process when its own patience ends, and nobody could be told why.
    attempt = threading.Thread(target=reach, daemon=True)
    attempt.start()
    attempt.join(CONNECTING_S)
    if failure and coordinator is None:
        raise InputError(
            f"no scheduler such as Slurm or Open MPI was found ({_first_line(failure[0])}): start "
            "the processes by srun or mpirun, or give coordinator, processes and process"
        )
    if failure or attempt.is_alive():
        why = _first_line(failure[0]) if failure else f"no answer in {CONNECTING_S} s"
        place = f"at {coordinator}" if coordinator else "through the scheduler"
        raise InputError(
            f"the other processes were not reached {place} ({why}): start as many processes as you "
            "say there are, each with its own number, and give an address of process 0 that all "
            "can reach"
        )


def disconnect() -> None:
    """Part from the other processes, if there are any; the last thing that a process does."""
    if jax.distributed.is_initialized():
        jax.distributed.shutdown()


def abandon(code: int) -> None:
    """End this process at once if it shares work with others, which then end too.

    A process that failed would else wait for all others at its end, and then be aborted.

    Arguments:
        code: exit code of the process.

    Example:
        >>> abandon(1)  # this one is alone, and goes on
    """
    if jax.distributed.is_initialized():
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


@contextmanager
def quiet_output() -> Generator[None]:
    """Redirect standard output to standard error while processes share work.

    Gloo, the transport between processes, prints a banner to the file descriptor itself, beyond the
    reach of `contextlib.redirect_stdout`.
    """
    if not jax.distributed.is_initialized():
        yield
        return
    sys.stdout.flush()
    kept = os.dup(1)
    os.dup2(2, 1)
    try:
        yield
    finally:
        sys.stdout.flush()
        os.dup2(kept, 1)
        os.close(kept)


def is_first() -> bool:
    """Tell whether this process is the one that writes and speaks."""
    return jax.process_index() == 0


def evenly(count: int) -> int:
    """The least number of batch entries, from a count on, that all devices share evenly.

    Arguments:
        count: how many entries there are.

    Example:
        >>> evenly(3) % jax.device_count()
        0
    """
    return math.ceil(count / jax.device_count()) * jax.device_count()


def compiled(
    function: Callable[[Any, Any], Any], common: Any, batch: Any
) -> Callable[[Any, Any], Any]:
    """Compile a function of what all entries of a batch have in common, and of their own.

    It is compiled ahead of time, so that compiling and running are measured apart. Each device
    computes its entries, which lie along the first axis of all that goes in and comes out.

    Arguments:
        function: called as `function(common, batch)` with a part of the batch; returns a pytree.
        common: example of the first argument, or its shapes.
        batch: example of the second, or its shapes; as many entries as `evenly` says.

    Returns:
        The function; all processes call it with the same arguments, or with what another gave.

    Raises:
        InputError: another process ended, when the function is called.

    Example:
        >>> count = evenly(4)
        >>> rows = jax.ShapeDtypeStruct((count,), np.float32)
        >>> double = compiled(lambda factor, row: factor * row, np.float32(0), rows)
        >>> gathered(double(np.float32(2), np.arange(count, dtype=np.float32)))[:4].tolist()
        [0.0, 2.0, 4.0, 6.0]
    """
    mesh = Mesh(np.array(cast(list[Any], jax.devices())), (AXIS,))
    specs = (PartitionSpec(), PartitionSpec(AXIS))
    shared: Callable[[Any, Any], Any] = jax.shard_map(
        function, mesh=mesh, in_specs=specs, out_specs=specs[1], check_vma=False
    )
    shardings = tuple(NamedSharding(mesh, spec) for spec in specs)
    lowered = jax.jit(shared, in_shardings=shardings).lower(common, batch)
    executable = cast(Callable[..., Any], lowered.compile())

    def run(common: Any, batch: Any) -> Any:
        with _failures_told():
            placed = [
                jax.tree.map(partial(_placed, where=where), argument)
                for argument, where in zip((common, batch), shardings, strict=True)
            ]
            return cast(Any, jax.block_until_ready(executable(*placed)))

    return run


def local(rows: jax.Array) -> np.ndarray:
    """The entries of a batch that lie on this process's own devices.

    Arguments:
        rows: what a function from `compiled` gave.
    """
    parts = sorted(rows.addressable_shards, key=lambda shard: shard.index[0].start or 0)
    return np.concatenate([np.asarray(shard.data) for shard in parts])


def gathered(tree: Any) -> Any:
    """All entries of batches, as NumPy arrays, for every process.

    Arguments:
        tree: what a function from `compiled` gave.

    Raises:
        InputError: another process ended.
    """
    if jax.process_count() == 1:
        return jax.tree.map(np.asarray, tree)
    with _failures_told():
        return multihost_utils.process_allgather(tree, tiled=True)


def greatest(values: np.ndarray) -> np.ndarray:
    """The greatest of each of some numbers over all processes.

    Arguments:
        values: this process's numbers; of one shape in all of them.

    Raises:
        InputError: another process ended.

    Example:
        >>> greatest(np.array([1.0, 2.0])).tolist()
        [1.0, 2.0]
    """
    if jax.process_count() == 1:
        return values
    with _failures_told():
        return multihost_utils.process_allgather(values).max(axis=0)


def from_first(values: np.ndarray) -> np.ndarray:
    """What the first process holds, for all.

    Arguments:
        values: numbers; of one shape and type in all processes.

    Raises:
        InputError: another process ended.

    Example:
        >>> from_first(np.array([True, False])).tolist()
        [True, False]
    """
    if jax.process_count() == 1:
        return values
    with _failures_told():
        return np.asarray(multihost_utils.broadcast_one_to_all(values))


def _placed(rows: Any, where: NamedSharding) -> jax.Array:
    if isinstance(rows, jax.Array) and rows.sharding.is_equivalent_to(where, rows.ndim):
        return rows
    rows = np.asarray(rows)
    return jax.make_array_from_callback(rows.shape, where, lambda index: rows[index])


@contextmanager
def _failures_told() -> Generator[None]:
    """Tell of another process that ended as such, and not as a broken connection."""
    try:
        yield
    except (RuntimeError, ValueError) as error:
        # JAX raises now one, now the other, from whatever waits for the connection.
        if jax.process_count() == 1 or not re.search("Gloo|coordination|heartbeat", str(error)):
            raise
        raise InputError(
            f"another process of the {jax.process_count()} ended or cannot be reached any more "
            f"({_first_line(error)}): start all of them again"
        ) from error


def _first_line(error: Exception) -> str:
    line = str(error).strip().splitlines()[0]
    return re.sub(r"\[external[^\]]*\]\s*", "", line)[:200]

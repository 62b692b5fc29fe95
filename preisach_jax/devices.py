"""A batch shared among the devices of this process: the cores of a processor, or its GPUs."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Any, cast

import jax
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from preisach_jax.cores import usable_cores

AXIS = "batch"


def use_all_cores() -> None:
    """Give JAX one CPU device for each core that this process may use, to share a batch.

    It is a setting of the whole process, and one that JAX takes only before its first computation:
    after that, the devices stay as they are.
    """
    with suppress(RuntimeError):
        jax.config.update("jax_num_cpu_devices", usable_cores())


def evenly(count: int) -> int:
    """The least number of batch entries, from a count on, that all devices share evenly."""
    return math.ceil(count / jax.device_count()) * jax.device_count()


def compiled(
    function: Callable[[Any, Any], Any], common: Any, batch: Any
) -> Callable[[Any, Any], Any]:
    """Compile a function of what all entries of a batch have in common, and of their own.

    It is compiled ahead of time, so that compiling and running are measured apart. Each device
    computes its entries, which lie along the first axis of all that goes in and comes out.

    Arguments:
        function: called as `function(common, batch)` with a part of the batch; returns a pytree.
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
        placed = [
            jax.tree.map(partial(jax.device_put, device=where), argument)
            for argument, where in zip((common, batch), shardings, strict=True)
        ]
        return cast(Any, jax.block_until_ready(executable(*placed)))

    return run

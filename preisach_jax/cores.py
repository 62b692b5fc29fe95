"""Work on the processor: on all its cores, and there where JAX would take an accelerator."""

from __future__ import annotations

import os
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any, TypeVar, cast

import jax
import jax.numpy as jnp

Item = TypeVar("Item")
Result = TypeVar("Result")


def usable_cores() -> int:
    """How many cores this process may use: those it is bound to, or fewer by `OMP_NUM_THREADS`."""
    affinity = getattr(os, "sched_getaffinity", None)  # on Linux only
    cores = len(affinity(0)) if affinity else os.cpu_count() or 1
    asked = os.environ.get("OMP_NUM_THREADS", "")
    return min(cores, int(asked)) if asked.isdecimal() and int(asked) > 0 else cores


@contextmanager
def on_processor() -> Generator[None]:
    """Compute in double precision, and on the processor where JAX has an accelerator beside it.

    What identifies, predicts and drives is a chain of many short steps, for each of which an
    accelerator waits: a diagnosis of 13 s on the processor did not end there in 80 s.  One that the
    caller has chosen, as JAX's default device or by `JAX_PLATFORMS=cuda`, is used all the same.
    """
    with jax.enable_x64(True), jax.default_device(_processor()):
        yield


def chosen_device() -> Any:
    """JAX's default device in this thread; None if nobody has chosen one."""
    return cast(Any, jax.config).jax_default_device


def _processor() -> Any:
    """The caller's default device, else the processor where it stands beside an accelerator."""
    if (chosen := chosen_device()) is not None or jax.default_backend() == "cpu":
        return chosen
    try:
        return cast(Any, jax.local_devices(backend="cpu")[0])
    except RuntimeError:  # JAX was told to use nothing but the accelerator
        return None


def on_all_cores(function: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
    """Results of a function of each item, in the order of the items, computed at the same time.

    Threads are enough where compiled code does the work.  They compute in the caller's precision,
    on the caller's device.
    """
    compute = _as_in_this_thread(function)
    with ThreadPoolExecutor(usable_cores()) as pool:
        futures = [pool.submit(compute, item) for item in items]
        try:
            for future in futures:
                yield future.result()
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def _as_in_this_thread(function: Callable[[Item], Result]) -> Callable[[Item], Result]:
    """The function as it computes in this thread: precision and device are settings of each."""
    double, device = jnp.result_type(float) == jnp.float64, chosen_device()

    def compute(item: Item) -> Result:
        with jax.enable_x64(double), jax.default_device(device):
            return function(item)

    return compute

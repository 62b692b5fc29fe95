"""Work on all cores of one machine."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

import jax
import jax.numpy as jnp

Item = TypeVar("Item")
Result = TypeVar("Result")


def usable_cores() -> int:
    """How many cores this process may use: those it is bound to, or fewer by `OMP_NUM_THREADS`.

    Example:
        >>> usable_cores() >= 1
        True
    """
    affinity = getattr(os, "sched_getaffinity", None)  # on Linux only
    cores = len(affinity(0)) if affinity else os.cpu_count() or 1
    asked = os.environ.get("OMP_NUM_THREADS", "")
    return min(cores, int(asked)) if asked.isdecimal() and int(asked) > 0 else cores


def on_all_cores(function: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
    """Results of a function of each item, in the order of the items, computed at the same time.

    Threads are enough where compiled code does the work.  They compute in the caller's precision.

    Arguments:
        function: what to compute; it must not change what its other calls use.
        items: what to compute it of.

    Raises:
        Exception: that of the first item whose function raised one; items not begun are left.

    Example:
        >>> list(on_all_cores(abs, [-1, 2, -3]))
        [1, 2, 3]
    """
    compute = _in_this_precision(function)
    with ThreadPoolExecutor(usable_cores()) as pool:
        futures = [pool.submit(compute, item) for item in items]
        try:
            for future in futures:
                yield future.result()
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


class Background:
    """Threads that compute while the caller goes on, in the caller's precision.

    Example:
        >>> background = Background()
        >>> background.begin(lambda: 2 + 2).result()
        4
        >>> background.close()
    """

    def __init__(self) -> None:
        self._pool = ThreadPoolExecutor(usable_cores())

    def begin(self, function: Callable[[], Result]) -> Future[Result]:
        """Compute something as soon as a thread is free; it must not change what others use."""

        def compute(_: None) -> Result:
            return function()

        return self._pool.submit(_in_this_precision(compute), None)

    def close(self) -> None:
        """Wait for nothing: what has not begun is left, what has begun ends unheard."""
        self._pool.shutdown(wait=False, cancel_futures=True)


def _in_this_precision(function: Callable[[Item], Result]) -> Callable[[Item], Result]:
    """The function as it computes in this thread: precision is a setting of each thread."""
    double = jnp.result_type(float) == jnp.float64

    def compute(item: Item) -> Result:
        with jax.enable_x64(double):
            return function(item)

    return compute

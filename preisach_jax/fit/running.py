"""How the work of a fit runs: its precision, and how it tells its progress."""

from __future__ import annotations

from collections.abc import Callable, Generator
from contextlib import contextmanager
from typing import TypeVar

from threadpoolctl import threadpool_limits

from preisach_jax.cores import on_processor

Progress = Callable[[str, float], None]

Found = TypeVar("Found")


def in_silence(text: str, done: float) -> None:
    """Discarded progress."""
    del text, done


@contextmanager
def double_precision() -> Generator[None]:
    """Work in double precision on the processor, with one thread for small factorisations.

    Several threads of the linear algebra library gain nothing at these sizes, and lose a factor
    of five where other processes want the cores.
    """
    with on_processor(), threadpool_limits(limits=1, user_api="blas"):
        yield

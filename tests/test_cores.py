"""Work on all cores keeps order, precision and errors."""

import time

import jax
import jax.numpy as jnp
import pytest

from preisach_jax.cores import on_all_cores, usable_cores


def test_results_come_in_the_order_of_the_items():
    def late(item):
        time.sleep(0.02 * (3 - item))
        return item

    assert list(on_all_cores(late, range(4))) == [0, 1, 2, 3]


@pytest.mark.parametrize("double", [False, True])
def test_threads_compute_in_the_precision_of_the_caller(double):
    with jax.enable_x64(double):
        found = list(on_all_cores(lambda item: jnp.asarray(float(item)).dtype, [1, 2]))
    assert found == [jnp.float64 if double else jnp.float32] * 2


def test_an_error_is_raised_and_what_was_not_begun_is_left(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    begun = []

    def fail_on_two(item):
        begun.append(item)
        time.sleep(0.05)
        if item == 2:
            raise ValueError("two")
        return item

    results = on_all_cores(fail_on_two, range(1, 50))
    assert next(results) == 1
    with pytest.raises(ValueError, match="two"):
        next(results)
    assert len(begun) < 10


@pytest.mark.parametrize(("asked", "expected"), [("1", 1), ("0", None), ("many", None)])
def test_the_number_of_threads_can_be_bounded(monkeypatch, asked, expected):
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    free = usable_cores()
    monkeypatch.setenv("OMP_NUM_THREADS", asked)
    assert usable_cores() == (expected or free)

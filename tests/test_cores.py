"""Work on all cores keeps order, precision and errors."""

import threading
import time
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import preisach_jax as pj
from preisach_jax.cores import on_all_cores, usable_cores
from preisach_jax.identify import Problem


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


def test_effects_that_are_tried_at_the_same_time_change_nothing_they_share(monkeypatch):
    written: list[str] = []

    class Watched(dict[Any, Any]):
        def __setitem__(self, slot, value):
            if threading.current_thread() is not threading.main_thread():
                written.append(str(slot[0]))
            super().__setitem__(slot, value)

    cut: Any = Problem.of
    reduced: Any = Problem.reduced

    def watched(problem):
        return replace(problem, cache=Watched(problem.cache))

    monkeypatch.setattr(Problem, "of", staticmethod(lambda *given: watched(cut(*given))))
    monkeypatch.setattr(Problem, "reduced", lambda *given: watched(reduced(*given)))
    t = np.arange(1000) / 33
    u = 5 - 5 * np.cos(t * (1 + t / 40))
    z = u**1.1 + 0.02 * t + 0.01 * np.random.default_rng(0).normal(size=1000)
    record = pj.Record.from_arrays(t, u, z)
    found = pj.diagnose(record, ["drift", "creep", "delay"], levels=5)
    assert found.effects == ("drift",)
    assert not written

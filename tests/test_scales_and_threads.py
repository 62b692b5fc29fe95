"""The verdict does not depend on units, nor the numbers on how many threads worked."""

import os
import subprocess
import sys
from dataclasses import replace

import found as made_once
import jax
import numpy as np
from found import LEVELS, LIKELIEST, record_of

import preisach_jax as pj
from preisach_jax.cores import chosen_device, on_all_cores
from preisach_jax.fit.stepwise import double_precision


def test_neither_units_nor_origins_change_verdict_or_fit():
    """The greatest and the least numbers and days, falling, and far origins, in ranges and in s."""
    factors, shifts = (1e56, -1e-60, 1 / 86_400), (1e2, -1e3, 1e2)
    plain, still = made_once.found("input_lag"), record_of("input_lag")
    record = pj.Record.from_arrays(
        factors[2] * still.time + shifts[2],
        factors[0] * (still.input + shifts[0] * np.ptp(still.input)),
        factors[1] * (still.output + shifts[1] * np.ptp(still.output)),
    )
    found = pj.diagnose(record, ("input_lag", *LIKELIEST["input_lag"]), levels=LEVELS)
    assert (found.verdict, found.effects) == (plain.verdict, ("input_lag",))
    fits, expected = ([r.fit_percent for r in each.ladder] for each in (found, plain))
    np.testing.assert_allclose(fits, expected, rtol=0, atol=1e-7)


def test_a_falling_input_from_the_other_saturation_gives_the_same_fit():
    low = replace(record_of("input_lag"), initial_memory="low")
    falling = replace(low, input=-1e56 * low.input, initial_memory="high")
    fit, other = (pj.fit(each, ["input_lag"], levels=LEVELS) for each in (low, falling))
    near = 1e-7 * np.ptp(fit.prediction)
    np.testing.assert_allclose(other.prediction, fit.prediction, rtol=0, atol=near)


POOLS = """
from threadpoolctl import threadpool_info
from preisach_jax.fit.stepwise import double_precision

with double_precision():
    import scipy.linalg

    pools = [pool for pool in threadpool_info() if pool["user_api"] == "blas"]
    print(*(pool["num_threads"] for pool in pools))
"""


def test_all_linear_algebra_of_a_fit_has_one_thread():
    # In a process of its own: here other tests have loaded all libraries long ago.
    environment = {key: value for key, value in os.environ.items() if "NUM_THREADS" not in key}
    done = subprocess.run(
        [sys.executable, "-c", POOLS], capture_output=True, text=True, env=environment, check=True
    )
    assert set(done.stdout.split()) == {"1"}


def test_fits_run_on_the_processor_beside_an_accelerator(monkeypatch):
    processor = jax.local_devices(backend="cpu")[0]
    with double_precision():
        assert chosen_device() is None
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    with double_precision():
        assert chosen_device() == processor
        assert jax.numpy.zeros(1).device == processor
        devices = on_all_cores(lambda _: chosen_device(), range(3))
        assert set(devices) == {processor}
    with jax.default_device("cpu"), double_precision():  # as the caller chose
        assert chosen_device() == "cpu"

    def nothing_but_the_accelerator(backend):
        raise RuntimeError(f"Unknown backend {backend}")

    monkeypatch.setattr(jax, "local_devices", nothing_but_the_accelerator)
    with double_precision():
        assert chosen_device() is None

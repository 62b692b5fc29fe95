"""The verdict does not depend on units, nor the numbers on how many threads worked."""

import json
import os
import subprocess
import sys
from pathlib import Path

import jax
import numpy as np
import pytest
import world

import preisach_jax as pj
from preisach_jax.cores import chosen_device, on_all_cores
from preisach_jax.fit import double_precision

ASKED = ["creep", "output_lag", "drift"]
SCALES = {
    "microvolts and days": (1e6, 1.0, 1 / 86_400),
    "megavolts and nanometres": (1e-6, 1e3, 1.0),
    "metres and microseconds": (1.0, 1e-6, 1e6),
    "an input that falls": (-1.0, 1.0, 1.0),
    "the greatest and the least": (1e58, 1e-60, 1.0),
    "the least and the greatest": (1e-60, 1e57, 1e50),
}
"""Factors on input, output and time."""

SHIFTS = (1e2, -1e3, 1e5)
"""Of input and output, in their ranges, and of time, in s."""


def diagnosed(factors=(1.0, 1.0, 1.0), shifts=(0.0, 0.0, 0.0)):
    made = world.hidden_record("output_lag", 321, 6.0, 500.0)
    x, z, t = (made[key] for key in "xzt")
    record = pj.Record.from_arrays(
        factors[2] * t + shifts[2],
        factors[0] * (x + shifts[0] * np.ptp(x)),
        factors[1] * (z + shifts[1] * np.ptp(z)),
    )
    return pj.diagnose(record, ASKED, levels=9)


@pytest.fixture(scope="module")
def plain():
    return diagnosed()


@pytest.mark.parametrize("scale", SCALES)
def test_units_change_neither_verdict_nor_fit(plain, scale):
    found = diagnosed(SCALES[scale])
    assert (found.verdict, found.effects) == (plain.verdict, plain.effects)
    for rung, other in zip(found.ladder, plain.ladder, strict=True):
        assert rung.fit_percent == pytest.approx(other.fit_percent, abs=1e-6 * 100)
    assert found.effects == ("output_lag",)


def test_nor_do_far_origins(plain):
    found = diagnosed(shifts=SHIFTS)
    assert (found.verdict, found.effects) == (plain.verdict, plain.effects)

    assert found.ladder[-1].fit_percent == pytest.approx(plain.ladder[-1].fit_percent, abs=1e-4)


SCRIPT = """
import json, sys
sys.path.insert(0, sys.argv[1])
import test_scales_and_threads as tested
found = tested.diagnosed()
print(json.dumps([found.verdict, found.effects, [rung.fit_percent for rung in found.ladder]]))
"""


def test_one_thread_and_many_give_the_same_to_rounding(plain):
    one = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NPROC"), "1")
    flags = {"XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false"}
    script = [sys.executable, "-c", SCRIPT, str(Path(__file__).parent)]
    done = subprocess.run(
        script, capture_output=True, text=True, check=True, timeout=300,
        env=os.environ | one | flags,
    )  # fmt: skip
    verdict, effects, fits = json.loads(done.stdout)
    assert (verdict, tuple(effects)) == (plain.verdict, plain.effects)
    np.testing.assert_allclose(fits, [rung.fit_percent for rung in plain.ladder], rtol=1e-7)


POOLS = """
from threadpoolctl import threadpool_info
from preisach_jax.fit import double_precision

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
    threads = done.stdout.split()
    assert threads
    assert set(threads) == {"1"}


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

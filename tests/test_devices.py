"""A batch shared among the devices of a process gives what one device gives."""

import os
import subprocess
import sys

import numpy as np
import pytest
from oracles import PLANE, wandering
from test_sweep import KEY, SETTINGS

import preisach_jax as pj
from preisach_jax.paper.sweep import Sweep

DEVICES = f"""
import sys
import jax
jax.config.update("jax_num_cpu_devices", 3)
jax.config.update("jax_enable_x64", True)
import numpy as np
import preisach_jax as pj
from preisach_jax.devices import compiled, evenly

assert evenly(5) == 6
where = compiled(lambda _, rows: rows, 0.0, jax.ShapeDtypeStruct((6,), np.float32))
shards = where(0.0, np.arange(6, dtype=np.float32)).addressable_shards
assert [len(one.data) for one in shards] == [2, 2, 2]
pj.sweep(jax.random.key(7), *{SETTINGS}).save(sys.argv[1])
x = np.load(sys.argv[2])
np.save(sys.argv[2], pj.run_fleet(pj.AdaptiveFilter(pj.Plane(5, -2.0, 8.0)), x, 2 * x).weights)
"""


@pytest.mark.slow
def test_three_devices_compute_what_one_does(x64, tmp_path):
    """A sweep and a fleet, whose entries the devices do not share evenly."""
    paths = tmp_path / "sweep.npz", tmp_path / "fleet.npy"
    x = np.stack([wandering(seed=seed) for seed in range(4)])
    np.save(paths[1], x)
    # Its devices are parts of the processor, whatever these tests run on.
    environment = {**os.environ, "JAX_PLATFORMS": "cpu"}
    command = [sys.executable, "-W", "error", "-c", DEVICES, *map(str, paths)]
    subprocess.run(command, check=True, env=environment)
    found, alone = Sweep.load(paths[0]), pj.sweep(KEY, *SETTINGS)
    for name in found.AXES:
        np.testing.assert_allclose(getattr(found, name), getattr(alone, name), rtol=1e-12)
    for one, other in zip(found.weights, alone.weights, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-10, atol=1e-12)
    here = [pj.AdaptiveFilter(PLANE).run(row, 2 * row).weights for row in x]
    np.testing.assert_allclose(np.load(paths[1]), here, atol=1e-12)

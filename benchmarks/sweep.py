"""Measure the noise sweep of Fig. 8: 5 planes, 8 noise levels, 8 seeds, 50,000 samples.

Compilation and run are measured apart.  A run is everything from the random key to the statistics:
drawing the inputs and the noise, the piezo stage, the switching events, and the recursion for
eighteen outputs of each seed (the stage's and the known truth's, without and with noise).  Each
core is one device, and the devices share the seeds.  Beside it stands the plain filter, a scan over
all samples, for one output of one input on one device.
"""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from common import spread, timed, write_results

from preisach_jax.devices import use_all_cores
from preisach_jax.filter.adaptive import AdaptiveFilter
from preisach_jax.operator.plane import Plane
from preisach_jax.paper.sweep import LEVELS, NOISE_UM, realisation, sweep
from preisach_jax.plant import RANGE_V
from preisach_jax.theory import propagate_error

SEEDS, SAMPLES, REPEATS = 8, 50_000, 11

use_all_cores()


def plain_filter(x: jax.Array, z: jax.Array) -> dict:
    """The scan over all samples for one output: compilation apart from repeated runs."""
    rows = {}
    for levels in LEVELS:
        plane = Plane(levels=levels, low=0.0, high=RANGE_V)
        dense = partial(AdaptiveFilter(plane).run, form="dense")
        first = timed(dense, x, z)
        runs = [timed(dense, x, z) for _ in range(3)]
        rows[str(levels)] = {"compile_s": first - min(runs), **spread(runs)}
    return rows


def covariance(x: jax.Array) -> dict[str, float]:
    """Seconds of the exact propagation of the covariance of the weight error."""
    seconds = {}
    for levels in LEVELS:
        plane = Plane(levels=levels, low=0.0, high=RANGE_V)
        propagate_error(plane, x, 0.0)  # compiles the search for events
        seconds[str(levels)] = timed(propagate_error, plane, x, 0.0)
    return seconds


def main() -> None:
    """Measure and write the results."""
    first = sweep(jax.random.key(0), seeds=SEEDS, samples=SAMPLES)
    runs = [
        sweep(jax.random.key(repeat), seeds=SEEDS, samples=SAMPLES) for repeat in range(REPEATS)
    ]
    whole = spread([run.run_s for run in runs])
    print(f"sweep: compiled in {first.compile_s:.1f} s, run in {whole['median_s']:.3f} s")
    with jax.enable_x64(True):
        drawn = realisation(jax.random.key(0), 0, SAMPLES, len(NOISE_UM))
        x, z = (jnp.asarray(np.asarray(row)) for row in (drawn.record[2], drawn.record[3]))
        plain = plain_filter(x, z)
        moments = covariance(x)
    lanes = SEEDS * (len(NOISE_UM) + 2)
    one_by_one = lanes * sum(row["median_s"] for row in plain.values())
    content = {
        "sweep": {
            "levels": LEVELS,
            "noise_levels": len(NOISE_UM),
            "seeds": SEEDS,
            "outputs": lanes,
            "samples": SAMPLES,
            "devices": len(jax.devices()),
            "compile_s": first.compile_s,
            "run": whole,
        },
        "plain_filter_one_output": plain,
        "plain_filter_all_outputs_extrapolated_s": one_by_one,
        "ratio": one_by_one / whole["median_s"],
        "exact_covariance_s": moments,
    }
    print(f"{one_by_one / whole['median_s']:.0f} times faster than the plain filter, one by one")
    write_results("sweep.json", content)


if __name__ == "__main__":
    main()

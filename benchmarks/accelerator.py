"""Measure what an accelerator does for each of the public drivers, beside the CPU of its machine.

    python benchmarks/accelerator.py                       # whatever JAX finds, beside the CPU
    python benchmarks/accelerator.py --tasks sweep fleet --platforms cuda cpu

Each task runs in a process of its own on each platform, all cores of the CPU being devices.  The
first call, which compiles, is told apart from the median of the calls after it, and the results
of the platforms are compared: their largest difference in parts of the largest value.  A task
that takes longer than `--patience` seconds is told as that.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

SAMPLES, RATE_HZ = 50_000, 2000.0
SEEDS, MANY_SEEDS, RECORDS, LANES, LEVELS = 32, 512, 256, 1024, 75


def sweep_of_noise(seeds: int = SEEDS) -> tuple[Callable[[], Any], dict[str, Any]]:
    """The sweep of Fig. 8, 32 seeds at once: 5 planes, 8 noise levels."""
    import jax

    from preisach_jax.paper.sweep import LEVELS as PLANES
    from preisach_jax.paper.sweep import sweep

    def run() -> np.ndarray:
        found = sweep(jax.random.key(0), seeds=seeds, samples=SAMPLES)
        return np.ravel(found.output_error)

    return run, {"seeds": seeds, "samples": SAMPLES, "levels": PLANES}


def lanes_of_one_input() -> tuple[Callable[[], Any], dict[str, Any]]:
    """The recursion over events, 1,024 outputs of one input at once."""
    import jax

    from preisach_jax.filter.adaptive import AdaptiveFilter

    plane, x, z = _measured(LEVELS, LANES)
    adaptive = AdaptiveFilter(plane)
    batch = jax.jit(jax.vmap(lambda z: adaptive.run(x, z, missing=False).weights))

    def run() -> np.ndarray:
        return np.asarray(batch(z.T))

    return run, {"lanes": LANES, "samples": SAMPLES, "levels": LEVELS}


def one_filter() -> tuple[Callable[[], Any], dict[str, Any]]:
    """The plain filter of one output: a scan of all relays at every sample."""
    from preisach_jax.filter.adaptive import AdaptiveFilter

    plane, x, z = _measured(LEVELS, 1)
    adaptive = AdaptiveFilter(plane)

    def run() -> np.ndarray:
        return np.asarray(adaptive.run(x, z[:, 0], form="dense").weights)

    return run, {"samples": SAMPLES, "levels": LEVELS}


def fleet_of_filters() -> tuple[Callable[[], Any], dict[str, Any]]:
    """256 filters of 256 stages, 10,000 samples each, all relays at every sample."""
    from preisach_jax.filter.adaptive import AdaptiveFilter
    from preisach_jax.filter.fleet import run_fleet

    plane, x, z = _measured(37, RECORDS)
    few = 10_000
    inputs = [np.roll(x[:few], 7 * number) for number in range(RECORDS)]
    outputs = [z[:few, number].copy() for number in range(RECORDS)]
    for output in outputs:
        output[::100] = np.nan  # asks for the form that takes every sample
    adaptive = AdaptiveFilter(plane)

    def run() -> np.ndarray:
        return np.asarray(run_fleet(adaptive, inputs, outputs).weights)

    return run, {"records": RECORDS, "samples": few, "levels": 37}


def model_of_weights() -> tuple[Callable[[], Any], dict[str, Any]]:
    """Output of a model and its gradient in all weights, over one record."""
    import jax
    import jax.numpy as jnp

    from preisach_jax.operator.simulation import simulate

    plane, x, _ = _measured(LEVELS, 1)
    weights, inputs = jnp.ones(plane.cells), jnp.asarray(x)

    @jax.jit
    def gradient(weights, x):
        return jax.grad(lambda w: jnp.sum(simulate(plane, w, x, "ramp") ** 2))(weights)

    return lambda: np.asarray(gradient(weights, inputs)), {"samples": SAMPLES, "levels": LEVELS}


def diagnosis() -> tuple[Callable[[], Any], dict[str, Any]]:
    """The diagnosis of a simulated stage with a hidden delay: 6,000 samples."""
    import preisach_jax as pj

    made = pj.simulate_stage(seed=3, seconds=6.0, effects=("delay",), rate_hz=1000.0)
    record = pj.Record.from_arrays(made.time, made.input, made.output)
    found: dict[str, Any] = {"rows": len(made.time)}

    def run() -> np.ndarray:
        said = pj.diagnose(record)
        found.update(verdict=said.verdict, effects=list(said.effects))
        return np.array([step.rms_validation for step in said.ladder])

    return run, found


TASKS = {
    "sweep": sweep_of_noise,
    "sweep_of_many": partial(sweep_of_noise, MANY_SEEDS),
    "lanes": lanes_of_one_input,
    "filter": one_filter,
    "fleet": fleet_of_filters,
    "gradient": model_of_weights,
    "diagnosis": diagnosis,
}


def _measured(levels: int, lanes: int) -> tuple[Any, np.ndarray, np.ndarray]:
    """A plane, an input over all of it, and noisy outputs of random weights, made by NumPy."""
    import jax

    from preisach_jax.operator.plane import Plane
    from preisach_jax.operator.simulation import simulate
    from preisach_jax.plant import RANGE_V
    from preisach_jax.signals import bernoulli_ramp

    plane = Plane(levels=levels, low=0.0, high=RANGE_V)
    x = np.asarray(bernoulli_ramp(jax.random.key(levels), SAMPLES, RATE_HZ, high=RANGE_V))
    rng = np.random.default_rng(levels)
    clean = np.asarray(simulate(plane, rng.uniform(0.1, 1.0, plane.cells), x, "relay"))
    return plane, x, clean[:, None] + 0.01 * rng.normal(size=(SAMPLES, lanes))


def child(task: str, repeats: int, results: Path) -> None:
    """Measure one task on the devices of this process, and leave figures and results in files."""
    import jax
    from common import spread, timed

    from preisach_jax.devices import use_all_cores

    use_all_cores()
    jax.config.update("jax_enable_x64", True)
    run, what = TASKS[task]()
    first = timed(run)
    seconds = spread([timed(run) for _ in range(repeats)])
    np.save(results.with_suffix(".npy"), run())
    devices = {"kind": jax.devices()[0].device_kind, "count": len(jax.devices())}
    told = {"devices": devices, "first_s": first, "run": seconds, "what": what}
    results.with_suffix(".json").write_text(json.dumps(told))


def measured(task: str, platform: str, folder: Path, asked: argparse.Namespace) -> dict[str, Any]:
    """What the process of one task on one platform told, or why it told nothing."""
    results = folder / f"{task}_{platform}"
    words = [__file__, "--child", task, "--repeats", str(asked.repeats), "--results", str(results)]
    platforms = ",".join(dict.fromkeys((platform, "cpu")))
    environment = os.environ | {"JAX_PLATFORMS": platforms}
    try:
        subprocess.run(
            [sys.executable, *words], env=environment, timeout=asked.patience, check=True
        )
    except subprocess.TimeoutExpired:
        return {"not finished in s": asked.patience}
    except subprocess.CalledProcessError as error:
        return {"ended with exit code": error.returncode}
    return json.loads(results.with_suffix(".json").read_text())


def compared(task: str, platforms: list[str], folder: Path) -> float | None:
    """The largest difference between two platforms' results, in parts of the largest value."""
    paths = [folder / f"{task}_{platform}.npy" for platform in platforms]
    if len(paths) < 2 or not all(path.exists() for path in paths):
        return None
    one, other = (np.load(path) for path in paths[:2])
    if one.shape != other.shape:
        return None
    return float(np.nanmax(np.abs(one - other)) / np.nanmax(np.abs(other)))


def main() -> None:
    """Measure the tasks on the platforms, and write the figures."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--tasks", nargs="*", default=list(TASKS), choices=list(TASKS))
    parser.add_argument("--platforms", nargs="*", default=["cuda", "cpu"])
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--patience", type=float, default=120.0, help="seconds a task may take")
    parser.add_argument("--child", choices=list(TASKS), help=argparse.SUPPRESS)
    parser.add_argument("--results", type=Path, help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.child:
        child(asked.child, asked.repeats, asked.results)
        return
    rows: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as place:
        for task in asked.tasks:
            row: dict[str, Any] = {}
            for platform in asked.platforms:
                row[platform] = measured(task, platform, Path(place), asked)
            rows[task] = row | {"difference": compared(task, asked.platforms, Path(place))}
            print(task, json.dumps(rows[task]), flush=True)
    os.environ["JAX_PLATFORMS"] = asked.platforms[0]
    from common import write_results

    write_results("accelerator.json", {"tasks": rows})


if __name__ == "__main__":
    main()

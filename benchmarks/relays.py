"""Measure relays from event to event: the model's output and the paper's recursion.

    python benchmarks/relays.py

Beside the package stands, in the same run and on the same core, C (`relays.c`, compiled here with
-O3 -march=native), whose weights are the same, which is checked.  Ramps, for which there is no
reference, stand beside their dense form.
One input, a Bernoulli ramp at 2 kHz; double precision; medians of repeated runs.  What finds the
switching events counts as part of the run.
"""

from __future__ import annotations

import ctypes
import os
import subprocess
import tempfile
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from common import REPEATS, measured, one_core, write_results

from preisach_jax.filter.adaptive import AdaptiveFilter
from preisach_jax.operator.events import switching
from preisach_jax.operator.plane import Plane
from preisach_jax.operator.simulation import simulate
from preisach_jax.plant import RANGE_V
from preisach_jax.signals import bernoulli_ramp

LEVELS, SAMPLES, RATE_HZ, LANES = (9, 13, 19, 37, 75), 50_000, 2000.0, 64
START = 1e-9  # weights before the first event
SOURCE = Path(__file__).with_name("relays.c")


class CReference:
    """The functions of `relays.c`."""

    def __init__(self, folder: str):
        library = Path(folder) / "relays.so"
        compiler = os.environ.get("CC", "cc")
        options = ["-O3", "-march=native", "-ffast-math", "-shared", "-fPIC"]
        subprocess.run([compiler, *options, str(SOURCE), "-o", str(library)], check=True)
        self.library = ctypes.CDLL(str(library))

    def adapt(self, plane: Plane, x: np.ndarray, z: np.ndarray) -> np.ndarray:
        """(cells, lanes) weights after the outputs (time, lanes) of one input."""
        weights = np.full((plane.cells, z.shape[1]), START)
        size = (plane.levels, ctypes.c_long(len(x)), z.shape[1])
        self.library.adapt(*size, *_limits(plane), *map(_pointer, (x, z, weights)))
        return weights

    def run(self, plane: Plane, x: np.ndarray, z: np.ndarray) -> np.ndarray:
        """(cells,) weights after the output (time,), with the model's output of every sample."""
        weights, output = np.full(plane.cells, START), np.empty(len(x))
        size = (plane.levels, ctypes.c_long(len(x)))
        self.library.run(*size, *_limits(plane), *map(_pointer, (x, z, weights, output)))
        return weights

    def simulate(self, plane: Plane, x: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """(time,) output."""
        output = np.empty(len(x))
        size = (plane.levels, ctypes.c_long(len(x)))
        self.library.simulate(*size, *_limits(plane), *map(_pointer, (x, weights, output)))
        return output


def _limits(plane: Plane) -> tuple[ctypes.c_double, ctypes.c_double]:
    return ctypes.c_double(plane.low), ctypes.c_double(plane.delta_x)


def _pointer(array: np.ndarray) -> ctypes.c_void_p:
    assert array.flags.c_contiguous
    assert array.dtype == np.float64
    return array.ctypes.data_as(ctypes.c_void_p)


def measure(levels: int, c: CReference) -> dict:
    """All variants on one plane."""
    plane = Plane(levels=levels, low=0.0, high=RANGE_V)
    x = np.asarray(bernoulli_ramp(jax.random.key(levels), SAMPLES, RATE_HZ, high=RANGE_V))
    rng = np.random.default_rng(levels)
    truth = rng.uniform(0.1, 1.0, plane.cells)
    clean = c.simulate(plane, x, truth)
    z = np.ascontiguousarray(clean[:, None] + 0.01 * rng.normal(size=(SAMPLES, LANES)))
    filt, inputs = AdaptiveFilter(plane, initial_weight=START), jnp.asarray(x)
    own = np.ascontiguousarray(z.T)
    batch = jax.jit(jax.vmap(lambda z: filt.run(x, z).weights))
    ramps, lanes, weights = AdaptiveFilter(plane, "ramp"), jnp.asarray(z), jnp.asarray(truth)
    check(plane, c, x, z, truth)

    def loss(weights, x=inputs, hysteron="relay"):
        return jnp.sum(simulate(plane, weights, x, hysteron) ** 2)

    gradient = jax.jit(jax.value_and_grad(loss))
    of_input = jax.jit(jax.value_and_grad(partial(loss, hysteron="ramp"), argnums=1))
    found = {
        "one_lane": {
            "event_form": measured(lambda: filt.run(x, own[0]).weights),
            "dense_form": measured(lambda: filt.run(x, own[0], form="dense").weights, 3),
            "c": measured(lambda: c.run(plane, x, own[0])),
        },
        "many_lanes": {
            "vmap_of_run": measured(lambda: batch(own)),
            "c": measured(lambda: [c.run(plane, x, one) for one in own]),
            "c_lanes_side_by_side": measured(lambda: c.adapt(plane, x, z)),
        },
        "simulate": {
            "event_form": measured(lambda: simulate(plane, weights, inputs, "relay")),
            "dense_form": measured(
                lambda: simulate(plane, weights, inputs, "relay", form="dense"), 3
            ),
            "value_and_gradient": measured(lambda: gradient(weights)),
            "c": measured(lambda: c.simulate(plane, x, truth)),
        },
        "ramps": {
            "simulate": measured(lambda: simulate(plane, weights, inputs)),
            "simulate_dense": measured(lambda: simulate(plane, weights, inputs, form="dense"), 3),
            "value_and_gradient_in_weights_and_input": measured(lambda: of_input(weights, inputs)),
            "one_lane": measured(lambda: ramps.run(inputs, lanes[:, 0], form="event").weights, 3),
            "one_lane_dense": measured(
                lambda: ramps.run(inputs, lanes[:, 0], form="dense").weights, 3
            ),
        },
    }
    return {"levels": levels, "events": len(switching(plane, x))} | found


def check(plane: Plane, c: CReference, x, z, truth) -> None:
    """Make sure that all find the same weights and outputs."""
    filt = AdaptiveFilter(plane, initial_weight=START)
    wanted, first = c.adapt(plane, x, z), np.ascontiguousarray(z[:, 0])
    batch = jax.jit(jax.vmap(lambda z: filt.run(x, z).weights))(z.T)
    np.testing.assert_allclose(batch.T, wanted, rtol=0, atol=1e-11)
    for got in (c.run(plane, x, first), filt.run(x, first).weights):
        np.testing.assert_allclose(got, wanted[:, 0], rtol=0, atol=1e-11)
    simulated = simulate(plane, truth, x, "relay")
    np.testing.assert_allclose(simulated, c.simulate(plane, x, truth), rtol=0, atol=1e-8)


def main() -> None:
    """Measure all planes and write the figures."""
    jax.config.update("jax_enable_x64", True)
    with one_core(), tempfile.TemporaryDirectory() as folder:
        rows = [measure(levels, CReference(folder)) for levels in LEVELS]
    for row in rows:
        for task in ("one_lane", "many_lanes", "simulate"):
            base = row[task]["c"]["median_s"]
            ratios = {name: round(each["median_s"] / base, 1) for name, each in row[task].items()}
            print(f"N = {row['levels']}, {task}, over C ({1e3 * base:.3g} ms): {ratios}")
        seconds = {name: f"{1e3 * each['median_s']:.3g}" for name, each in row["ramps"].items()}
        print(f"N = {row['levels']}, ramps (ms): {seconds}")
    settings = {"samples": SAMPLES, "lanes": LANES, "repeats": REPEATS, "cores": 1}
    write_results("relays.json", settings | {"planes": rows})


if __name__ == "__main__":
    main()

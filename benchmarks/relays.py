"""Measure relays from event to event: the model's output and the paper's recursion.

    python benchmarks/run.py relays

Beside the package stand, in the same run and on the same core, NumPy as one first writes it (all
relays at every sample), NumPy as one writes it for speed (lists of the relays that switch), numba
if it is installed, and C (`relays.c`, compiled here with -O3 -march=native).  All give the same
weights, which is checked.  Ramps, for which there is no reference, stand beside their dense form.
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
from conditions import write_results
from relays_numba import numba_functions
from timing import REPEATS, measured

from preisach_jax.filter.adaptive import AdaptiveFilter
from preisach_jax.operator.blocks import switching
from preisach_jax.operator.plane import Plane
from preisach_jax.operator.simulation import simulate
from preisach_jax.plant import RANGE_V
from preisach_jax.signals import bernoulli_ramp

LEVELS, SAMPLES, RATE_HZ, LANES = (9, 13, 19, 37, 75), 50_000, 2000.0, 64
START = 1e-9  # weights before the first event
NAIVE_SAMPLES = 2_000  # of the naive loop, whose time is extrapolated
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


class NumbaReference:
    """The functions of `relays_numba`; False where numba is not installed."""

    def __init__(self):
        self.functions = numba_functions()

    def __bool__(self) -> bool:
        return self.functions is not None

    def adapt(self, plane: Plane, x: np.ndarray, z: np.ndarray) -> np.ndarray:
        """(cells, lanes) weights after the outputs (time, lanes) of one input."""
        assert self.functions is not None
        weights = np.full((plane.cells, z.shape[1]), START)
        self.functions[0](plane.levels, plane.low, plane.delta_x, x, z, weights)
        return weights

    def simulate(self, plane: Plane, x: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """(time,) output."""
        assert self.functions is not None
        output = np.empty(len(x))
        self.functions[1](plane.levels, plane.low, plane.delta_x, x, weights, output)
        return output


def _limits(plane: Plane) -> tuple[ctypes.c_double, ctypes.c_double]:
    return ctypes.c_double(plane.low), ctypes.c_double(plane.delta_x)


def _pointer(array: np.ndarray) -> ctypes.c_void_p:
    assert array.flags.c_contiguous
    assert array.dtype == np.float64
    return array.ctypes.data_as(ctypes.c_void_p)


def naive_adapt(plane: Plane, x: np.ndarray, z: np.ndarray) -> np.ndarray:
    """All relays at every sample, eq. (3), (4), (7), (8), (12), for one lane."""
    alpha, beta = plane.alpha, plane.beta
    weights, states, reference = np.full(plane.cells, START), x[0] > alpha, z[0, 0]
    for k in range(1, len(x)):
        new = np.where(x[k] >= alpha, True, np.where(x[k] < beta, False, states))
        on, off = new & ~states, states & ~new
        area = on.sum() + off.sum()
        if area:
            error = z[k, 0] - reference - (weights[on].sum() - weights[off].sum())
            weights[on] += error / area
            weights[off] -= error / area
            reference = z[k, 0]
        states = new
    return weights[:, None]


def clever_adapt(plane: Plane, x: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Only samples that pass a threshold, and lists of the relays that they switch."""
    levels = np.floor((x - plane.low) / plane.delta_x + 0.5).astype(int)
    events = np.flatnonzero(np.diff(levels)) + 1
    weights = np.full((plane.cells, z.shape[1]), START)
    start = levels[0]
    lowest = np.where(np.arange(plane.levels) < start, start, 0)
    highest = np.full(plane.levels, start)
    first = np.arange(plane.levels) * (np.arange(plane.levels) + 1) // 2
    before, reference = start, z[0]
    for k in events:
        to = levels[k]
        if to > before:
            sign = 1.0
            parts = [first[i] + np.arange(lowest[i], i + 1) for i in range(before, to)]
        else:
            sign = -1.0
            parts = [first[j : highest[j]] + j for j in range(to, before)]
        cells = np.concatenate(parts) if len(parts) > 1 else parts[0]
        if len(cells):
            error = z[k] - reference - sign * weights[cells].sum(axis=0)
            weights[cells] += sign * error / len(cells)
            reference = z[k]
        lowest[before:to] = to
        highest[to:before] = to
        np.minimum(lowest, to, out=lowest)
        np.maximum(highest, to, out=highest)
        before = to
    return weights


def measure(levels: int, c: CReference, numba: NumbaReference) -> dict:
    """All variants on one plane."""
    plane = Plane(levels=levels, low=0.0, high=RANGE_V)
    x = np.asarray(bernoulli_ramp(jax.random.key(levels), SAMPLES, RATE_HZ, high=RANGE_V))
    rng = np.random.default_rng(levels)
    truth = rng.uniform(0.1, 1.0, plane.cells)
    clean = c.simulate(plane, x, truth)
    z = np.ascontiguousarray(clean[:, None] + 0.01 * rng.normal(size=(SAMPLES, LANES)))
    one = np.ascontiguousarray(z[:, :1])
    filt, inputs = AdaptiveFilter(plane, initial_weight=START), jnp.asarray(x)
    own = np.ascontiguousarray(z.T)
    batch = jax.jit(jax.vmap(lambda z: filt.run(x, z).weights))
    ramps, lanes, weights = AdaptiveFilter(plane, "ramp"), jnp.asarray(z), jnp.asarray(truth)
    wanted = c.adapt(plane, x, z)
    check(plane, c, numba, x, z, wanted, truth)

    def loss(weights, x=inputs, hysteron="relay"):
        return jnp.sum(simulate(plane, weights, x, hysteron) ** 2)

    few = slice(0, NAIVE_SAMPLES)
    naive, scale = (
        measured(lambda: naive_adapt(plane, x[few], one[few]), 3),
        SAMPLES / NAIVE_SAMPLES,
    )
    with_numba = {
        "one_lane": lambda: numba.adapt(plane, x, one),
        "many_lanes": lambda: numba.adapt(plane, x, z),
        "simulate": lambda: numba.simulate(plane, x, truth),
    }
    gradient = jax.jit(jax.value_and_grad(loss))
    of_input = jax.jit(jax.value_and_grad(partial(loss, hysteron="ramp"), argnums=1))
    found = {
        "one_lane": {
            "event_form": measured(lambda: filt.run(x, own[0]).weights),
            "dense_form": measured(lambda: filt.run(x, own[0], form="dense").weights, 3),
            "c": measured(lambda: c.run(plane, x, own[0])),
            "clever_numpy": measured(lambda: clever_adapt(plane, x, one), 3),
            "naive_numpy_extrapolated": {
                name: value if name == "repeats" else scale * value for name, value in naive.items()
            },
        },
        "many_lanes": {
            "vmap_of_run": measured(lambda: batch(own)),
            "c": measured(lambda: [c.run(plane, x, one) for one in own]),
            "c_lanes_side_by_side": measured(lambda: c.adapt(plane, x, z)),
            "clever_numpy": measured(lambda: clever_adapt(plane, x, z), 3),
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
    if numba:
        for task, call in with_numba.items():
            found[task]["numba"] = measured(call)
    return {"levels": levels, "events": len(switching(plane, x))} | found


def check(plane: Plane, c: CReference, numba: NumbaReference, x, z, wanted, truth) -> None:
    """Make sure that all variants find the same weights and outputs."""
    filt = AdaptiveFilter(plane, initial_weight=START)
    batch = jax.jit(jax.vmap(lambda z: filt.run(x, z).weights))(z.T)
    others = [batch.T, clever_adapt(plane, x, z)]
    simulated = [simulate(plane, truth, x, "relay")]
    if numba:
        others.append(numba.adapt(plane, x, z))
        simulated.append(numba.simulate(plane, x, truth))
    for got in others:
        np.testing.assert_allclose(got, wanted, rtol=0, atol=1e-11)
    for got in simulated:
        np.testing.assert_allclose(got, c.simulate(plane, x, truth), rtol=0, atol=1e-8)
    np.testing.assert_allclose(
        c.run(plane, x, np.ascontiguousarray(z[:, 0])), wanted[:, 0], atol=1e-11
    )
    np.testing.assert_allclose(filt.run(x, z[:, 0]).weights, wanted[:, 0], rtol=0, atol=1e-11)
    few = slice(0, NAIVE_SAMPLES)
    one = np.ascontiguousarray(z[few, :1])
    part = c.adapt(plane, x[few], one)
    np.testing.assert_allclose(naive_adapt(plane, x[few], one), part, rtol=0, atol=1e-11)


def main() -> None:
    """Measure all planes and write the figures."""
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    jax.config.update("jax_enable_x64", True)
    with tempfile.TemporaryDirectory() as folder:
        numba = NumbaReference()
        rows = [measure(levels, CReference(folder), numba) for levels in LEVELS]
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

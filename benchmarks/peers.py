"""Measure against what today's differentiable packages do: soft relays, trained with Adam.

    python benchmarks/peers.py

The peer is written here for the purpose, after the way such packages work: N (N+1)/2 relays whose
switching is smeared by a tanh, so that it has a slope, a dense scan over all samples in float32,
and all weights trained with Adam.  The stage has 300 levels of relays, on the grid of neither
model, and 0.15 % noise; errors are those against its clean output.  Beside both stands ridge
regression on the states of exact relays.  One core; medians of repeated runs.
"""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import optax
import scipy.linalg
from common import measured, one_core, write_results
from scipy import signal
from threadpoolctl import threadpool_limits

import preisach_jax as pj

SAMPLES, LEVELS, NOISE, ADAM_STEPS, WIDTH = 5_000, 37, 2e-3, 1_000, 0.01
RANGES = ((0.02, 0.98), (0.03, 0.97))  # of the record, and of the one held out


def stage_input(seed: int, low: float, high: float, samples: int = SAMPLES) -> np.ndarray:
    """(time,) smooth random input between two levels."""
    noise = np.random.default_rng(seed).normal(size=samples + 500)
    smooth = np.asarray(signal.lfilter(*signal.butter(2, 0.02), noise))[500:]
    return low + (high - low) * (smooth - smooth.min()) / np.ptp(smooth)


def stage_output(x: np.ndarray) -> np.ndarray:
    """(time,) output, about ±0.65, of relays much finer than those of the models."""
    fine = pj.Plane(levels=300, low=0.0, high=1.0)
    width, place = fine.alpha - fine.beta, fine.alpha + fine.beta
    density = np.exp(-(((width - 0.15) / 0.12) ** 2) - ((place - 1.05) / 0.5) ** 2)
    density += 0.1 * np.exp(-width / 0.3)
    weights = jnp.asarray(density / density.sum())
    return 1.3 * np.asarray(pj.simulate(fine, weights, jnp.asarray(x), "relay")) - 0.65


def soft_relays(plane: pj.Plane, weights, x, width: float = WIDTH):
    """(time,) output of relays that switch over a width of the input, all at every sample."""
    alpha, beta = jnp.asarray(plane.alpha, x.dtype), jnp.asarray(plane.beta, x.dtype)

    def step(carry, now):
        states, before = carry
        on = 0.5 + 0.5 * jnp.tanh((now - alpha) / width)
        off = 0.5 + 0.5 * jnp.tanh((now - beta) / width)
        states = jnp.where(now > before, jnp.maximum(states, on), jnp.minimum(states, off))
        return (states, now), states @ weights

    start = 0.5 + 0.5 * jnp.tanh((x[0] - alpha) / width)
    return jax.lax.scan(step, (start, x[0]), x)[1]


@partial(jax.jit, static_argnames="steps")
def trained(plane: pj.Plane, x, z, steps: int):
    """Weights and offset of soft relays, trained with Adam."""
    adam = optax.adam(optax.cosine_decay_schedule(3e-3, steps))
    start = (jnp.full(plane.cells, jnp.ptp(z) / plane.cells), jnp.min(z))

    def loss(numbers):
        weights, offset = numbers
        return jnp.mean((soft_relays(plane, weights, x) + offset - z) ** 2)

    def step(carry, _):
        numbers, state = carry
        updates, state = adam.update(jax.grad(loss)(numbers), state)
        return (optax.apply_updates(numbers, updates), state), None

    return jax.lax.scan(step, (start, adam.init(start)), length=steps)[0][0]


def relay_states(plane: pj.Plane, x: np.ndarray) -> np.ndarray:
    """(time, cells + 1) states of exact relays, and ones for the offset."""
    states, found = x[0] >= plane.alpha, []
    for value in x:
        states = (value >= plane.alpha) | (states & (value >= plane.beta))
        found.append(states)
    return np.column_stack([np.array(found, float), np.ones(len(x))])


def ridge(plane: pj.Plane, x: np.ndarray, z: np.ndarray, strength: float = 1e-2) -> np.ndarray:
    """(cells + 1,) weights and offset."""
    states = relay_states(plane, x)
    gram = states.T @ states + strength * np.eye(plane.cells + 1)
    return scipy.linalg.solve(gram, states.T @ z, assume_a="pos")


def identification() -> list[dict]:
    """Time and errors of each way to identify a model from one record."""
    plane = pj.Plane(levels=LEVELS, low=0.0, high=1.0)
    inputs = [stage_input(seed, *ends) for seed, ends in enumerate(RANGES, start=1)]
    clean = [stage_output(x) for x in inputs]
    readings = clean[0] + NOISE * np.random.default_rng(7).normal(size=SAMPLES)
    time = np.arange(SAMPLES) / 1000.0
    record = pj.Record.from_arrays(time, inputs[0], readings, initial_memory="low")
    single = [jnp.asarray(one, jnp.float32) for one in (*inputs, readings)]

    def errors(outputs):
        each = [float(np.sqrt(np.mean((z - c) ** 2))) for z, c in zip(outputs, clean, strict=True)]
        return {"rms_fitted": each[0], "rms_held_out": each[1]}

    def of_model(model):
        unread = np.full(SAMPLES, np.nan)
        return errors([
            model.predict(pj.Record.from_arrays(time, x, unread, initial_memory="low")).output
            for x in inputs
        ])  # fmt: skip

    rows = []
    for levels in (LEVELS, 25):
        seconds = measured(lambda N=levels: pj.fit(record, [], levels=N), 5)
        found = of_model(pj.fit(record, [], levels=levels).model)
        rows.append({"method": "preisach_jax.fit", "levels": levels} | seconds | found)
    weights = ridge(plane, inputs[0], readings)
    found = errors([relay_states(plane, x) @ weights for x in inputs])
    seconds = measured(lambda: ridge(plane, inputs[0], readings), 5)
    rows.append({"method": "ridge on relays, NumPy", "levels": LEVELS} | seconds | found)
    weights, offset = trained(plane, single[0], single[2], ADAM_STEPS)
    found = errors([np.asarray(soft_relays(plane, weights, x) + offset) for x in single[:2]])
    seconds = measured(lambda: trained(plane, single[0], single[2], ADAM_STEPS), 1)
    name = f"soft relays, Adam, {ADAM_STEPS} steps"
    return [*rows, {"method": name, "levels": LEVELS} | seconds | found]


def main() -> None:
    """Measure all and write the figures."""
    jax.config.update("jax_enable_x64", True)
    with one_core(), threadpool_limits(1):
        rows = identification()
    for row in rows:
        print({name: round(v, 5) if isinstance(v, float) else v for name, v in row.items()})
    settings = {"samples": SAMPLES, "noise": NOISE, "soft_width": WIDTH, "cores": 1}
    write_results("peers.json", settings | {"identification": rows})


if __name__ == "__main__":
    main()

"""A model in discrete time, sample by sample: for simulations that keep its state.

The effects act by their own laws; the hysterons are kept one by one, as the lowest and the highest
state that the unknown start leaves possible.
"""

from __future__ import annotations

from functools import partial
from typing import Any, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array

from preisach_jax.chain.coefficients import Coefficients
from preisach_jax.chain.driven import all_widen
from preisach_jax.chain.output import sensed
from preisach_jax.cores import on_processor
from preisach_jax.effects.base import (
    AddedEffect,
    HysteresisEffect,
    Place,
    Signals,
    Stepped,
    WeightEffect,
)
from preisach_jax.effects.speed import limited
from preisach_jax.export.description import Description, Part
from preisach_jax.operator.states import step_of_paths

State = dict[str, Any]
"""Numbers that a sample leaves to the next one, `(number,)` each, by their effect or meaning."""

TRIALS = 60
"""Halvings by which an output is found that agrees with itself."""


def start(model: Description) -> State:
    """State before the first sample, whose past is not known."""
    cells = len(model.weights)
    state = {"started": np.zeros(1), "samples": np.zeros(1), "low": np.zeros(cells)}
    state |= {"high": np.ones(cells), "seen": np.zeros(3), "path": np.zeros(2)}
    state |= {"input": np.zeros(1), "aux": np.zeros(len(model.aux)), "h": np.zeros(1)}
    for part in model.parts:
        if part.is_delay:
            state[part.name] = np.zeros(part.numbers["whole"] + 1)
        elif isinstance(part.effect, Stepped) and part.effect.is_stepped:
            own = jax.eval_shape(part.effect.init, jnp.zeros(()))
            size = sum(leaf.size for leaf in jax.tree.leaves(own))
            state |= {part.name: np.zeros(size)} if size else {}
        if part.numbers.get("arc"):
            state[f"{part.name}.arc"] = np.zeros(3)
    return state


def advance(model: Description, state: State, inputs: Array) -> tuple[State, Array]:
    """State after a sample, (1 + auxiliary columns,), and the output there."""
    none = jnp.zeros(())
    if model.chain.widens:
        second = state["started"][0] == 1
        anew: Any = partial(_first_anew, model, input_now=inputs[0])
        state = cast(State, jax.lax.cond(second, anew, dict, state))
    return _taken_in(model, state, inputs, none)


def sample_by_sample(model: Description, inputs: np.ndarray) -> np.ndarray:
    """Outputs along samples, `(time, 1 + auxiliary columns)`, from the first one on."""
    with on_processor():
        run: Any = jax.jit(partial(jax.lax.scan, partial(advance, model)))
        return np.asarray(run(start(model), jnp.asarray(inputs))[1])


def _first_anew(model: Description, state: State, input_now: Array) -> State:
    """State behind the first sample, at the speed that the second one gives."""
    path, _ = _driven(model, state, input_now)
    shift = _widening(model, state, path)
    first = jnp.concatenate([state["input"], state["aux"]])
    begin = start(model) | {"samples": state["samples"] - 1}
    again, _ = _taken_in(model, begin, first, shift)
    return {name: again[name] for name in state}


def _taken_in(
    model: Description, state: State, inputs: Array, first_shift: Array
) -> tuple[State, Array]:
    started = state["started"][0] > 0
    u = jnp.clip(inputs[0], model.input_low, model.input_high)
    path, new = _driven(model, state, u)
    shift = jnp.where(started, _widening(model, state, path), first_shift)
    h, hysterons = _hysterons(model, state, path, shift)
    new |= hysterons
    now = state["samples"] if model.by_path else model.step_s * state["samples"]
    aux = {c.name: inputs[1 + k, None] for k, c in enumerate(model.aux)}
    signals = Signals(now, u[None], aux, gone=now)
    moved = jnp.where(started, jnp.abs(u - state["input"]), 0.0)
    signal = h
    for effect in model.chain.at(WeightEffect):
        signal = signal * effect.factor(signals)[0]
    for part in model.at(Place.OUTPUT):
        follow = _delayed if part.is_delay else _stepped
        new[part.name], signal = follow(model, state, part, signal)
    signal = signal + model.offset
    for part in model.at(Place.ADDED):
        assert isinstance(part.effect, AddedEffect)
        if part.effect.is_stepped:
            driver = part.effect.driver(signals)[0]
            new[part.name], columns = _stepped(model, state, part, driver)
        else:
            columns = part.effect.columns(signals)[0]
        signal = signal + columns @ jnp.asarray(part.amounts)
    new |= {
        "started": jnp.minimum(state["started"] + 1, 2),
        "samples": state["samples"] + (moved if model.by_path else 1),
        "input": u[None],
        "aux": inputs[1:],
        "path": jnp.stack([path, jnp.where(started, state["path"][0], path)]),
    }
    return state | new, _read(model, signal)


def _stepped(model: Description, state: State, part: Part, value: Array) -> tuple[Array, Array]:
    """State and output of an effect after a sample; the first one finds it at rest."""
    effect: Any = part.effect
    rest = effect.init(value)
    vector, tree_of = ravel_pytree(rest)
    started = state["started"][0] > 0
    own = tree_of(jnp.where(started, state.get(part.name, vector), vector))
    after, output = effect.step(own, value, jnp.where(started, model.step_s, 0.0))
    return ravel_pytree(after)[0], output


def _delayed(model: Description, state: State, part: Part, value: Array) -> tuple[Array, Array]:
    own = jnp.where(state["started"][0] > 0, state[part.name], value)
    course = jnp.append(value, own)  # the newest first
    after, oldest = course[-2], course[-1]
    return course[:-1], after + part.numbers["part"] * (oldest - after)


def _driven(model: Description, state: State, u: Array) -> tuple[Array, State]:
    """What drives the hysterons, and what the effects of the input remember."""
    new: State = {}
    path, started = u, state["started"][0] > 0
    for part in model.at(Place.INPUT):
        if arc := part.numbers.get("arc"):
            rest = jnp.stack([path, path, jnp.zeros(())])
            last, earlier, bend = jnp.where(started, state[f"{part.name}.arc"], rest)
            now = path - 2 * last + earlier
            new[f"{part.name}.arc"] = jnp.stack([path, last, now])
            path = path - arc * limited(jnp.stack([bend, now]))[1]
        new[part.name], path = _stepped(model, state, part, path)
    return path, {name: own for name, own in new.items() if name in state}


def _widening(model: Description, state: State, path: Array) -> Array:
    """By how much thresholds move at the speed to a sample, by that one and those before."""
    last, earlier = state["path"]
    total = jnp.zeros(())
    for part in model.at(Place.HYSTERESIS):
        assert isinstance(part.effect, HysteresisEffect)
        way = path - last
        if not part.numbers.get("corners"):
            ahead = 1.5 * way - 0.5 * (last - earlier)
            way = jnp.where(state["started"][0] > 1, ahead, way)
        time = jnp.arange(3.0)
        total = total + part.effect.widening(way * time, model.step_s * time)[-1]
    return total


def _hysterons(model: Description, state: State, path: Array, shift: Array) -> tuple[Array, State]:
    """Output of the hysterons, and their state; one that agrees with itself if it is fed back."""
    inside = model.chain.at(HysteresisEffect)
    started = state["started"][0] > 0
    if not model.chain.feeds_back:
        return _switched(model, state, path, shift)
    paths = jnp.stack([jnp.where(started, state["path"][0], path), path])
    time = jnp.stack([jnp.zeros(()), jnp.where(started, model.step_s, 0.0)])

    def moved(output: Array) -> tuple[Array, State]:
        before = jnp.where(started, state["h"][0], output)
        seen, rising = paths, model.polarity * jnp.stack([before, output])
        for effect in inside:
            seen = effect.fed_back(seen, rising, time)
        return _switched(model, state, seen[1], shift)

    def closer(_: Any, ends: tuple[Array, Array]) -> tuple[Array, Array]:
        middle = (ends[0] + ends[1]) / 2
        above = moved(middle)[0] > middle
        return jnp.where(above, middle, ends[0]), jnp.where(above, ends[1], middle)

    most = jnp.asarray(1.5 * float(model.weights.sum()))
    ends = jnp.minimum(most, 0.0), jnp.maximum(most, 0.0)
    bottom, top = cast(tuple[Array, Array], jax.lax.fori_loop(0, TRIALS, closer, ends))
    h, new = moved((bottom + top) / 2)
    return h, new | {"h": h[None]}


def _switched(model: Description, state: State, path: Array, shift: Array) -> tuple[Array, State]:
    now = (jnp.stack([path - shift, path + shift, path]) - model.low) / (model.high - model.low)
    last = jnp.where(state["started"][0] > 0, state["seen"], now)
    count = 2 if all_widen(model.chain) else 3
    low, high = (
        step_of_paths(
            model.plane, state[bound], tuple(last[:count]), tuple(now[:count]), model.hysteron
        )
        for bound in ("low", "high")
    )
    return 0.5 * jnp.asarray(model.weights) @ (low + high), {"low": low, "high": high, "seen": now}


def _read(model: Description, signal: Array) -> Array:
    """What the sensor reads of the output of the rest of the model."""
    if not model.sensor:
        return signal
    chain = model.chain.with_effects(tuple(part.effect for part in model.sensor))
    amounts = np.concatenate([part.amounts for part in model.sensor])
    nothing = np.zeros(0)
    own = Coefficients(nothing, nothing, 0.0, amounts)
    values: dict[str, Any] = {part.name: {} for part in model.sensor}
    return sensed(chain, values, signal[None], own)[0]

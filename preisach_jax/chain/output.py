"""The output of a model, and its derivatives."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array

from preisach_jax.chain.coefficients import Coefficients
from preisach_jax.chain.compiled import (
    added_columns_of,
    apply_effect,
    as_arrays,
    converted_reading,
    factor_of,
    free_response_of,
    in_numpy,
    reading_of,
)
from preisach_jax.chain.description import PLACES, Chain, EffectValues
from preisach_jax.chain.driven import drive, unrounded_path
from preisach_jax.chain.hysteresis import first_run_output, hysteresis_output, operator_output
from preisach_jax.effects.base import (
    AddedEffect,
    InputEffect,
    OutputEffect,
    Parameter,
    SensorEffect,
    Signals,
    WeightEffect,
)

MANY = 3
"""Parameters of one effect from which on its derivatives are compiled: seven of a creep take 30 ms
then, and 100 by differences."""


# What is not finite passes in silence, as it does in JAX: who asked for it says so.
@np.errstate(over="ignore", invalid="ignore")
def behind_hysteresis(
    chain: Chain,
    values: EffectValues,
    signals: Signals,
    hysteresis: jax.Array,
    coefficients: Coefficients,
    known: Mapping[str, jax.Array] | None = None,
    gains: Sequence[jax.Array] | None = None,
    in_steps: bool = True,
) -> jax.Array:
    """From the output of the Preisach operator to that of the model, `(time,)`.

    Arguments:
        hysteresis: (time,) output of the operator.
        known, gains: `columns_beside` and `gains_of`, as far as they are known.
        in_steps: whether the reading has the steps of a converter.
    """
    signal = in_numpy(hysteresis)
    for factor in gains_of(chain, values, signals) if gains is None else gains:
        signal = signal * in_numpy(factor)
    for effect in chain.at(OutputEffect):
        own = as_arrays(values[effect.name])
        signal = in_numpy(apply_effect(effect, own, signal, signals.time))
    beside = tuple(columns_beside(chain, values, signals, known or {}).values())
    signal, first, added = signal + coefficients.offset, 0, in_numpy(coefficients.added)
    for columns in beside:
        last = first + columns.shape[1]
        signal, first = signal + in_numpy(columns) @ added[first:last], last
    return sensed(chain, values, signal, coefficients, in_steps)


def sensed(
    chain: Chain,
    values: EffectValues,
    signal: jax.Array,
    coefficients: Coefficients,
    in_steps: bool = True,
) -> jax.Array:
    """What the sensor reads of the output of the rest of the model, `(time,)`."""
    start = len(coefficients.added) - chain.sensor_coefficients
    for effect in chain.at(SensorEffect):
        stop = start + len(effect.coefficients())
        share = jnp.asarray(coefficients.added[start:stop])
        own = as_arrays(values[effect.name])
        signal = reading_of(effect, own, share, signal)
        if in_steps and effect.converts:
            signal = converted_reading(effect, own, signal)
        start = stop
    return signal


def columns_beside(
    chain: Chain, values: EffectValues, signals: Signals, known: Mapping[str, jax.Array]
) -> dict[str, jax.Array]:
    """What adds to the output beside the hysteresis, by effect: added ones, and free responses."""
    others = [*chain.at(WeightEffect), *chain.at(OutputEffect)]
    beside: dict[str, jax.Array] = {}
    inside, there = beside_the_loop(chain), signals
    if inside - known.keys():
        there = replace(signals, input=unrounded_path(chain, values, signals))
    for effect in (*chain.at(AddedEffect), *(other for other in others if other.coefficients())):
        count = len(effect.coefficients())
        if effect.name in known:
            beside[effect.name] = known[effect.name]
        elif isinstance(effect, OutputEffect):
            beside[effect.name] = free_response_of(effect, count, signals)
        else:
            own = as_arrays(values[effect.name])
            if effect.name in inside:
                columns = in_numpy(added_columns_of(effect, count, own, there))
                for factor in gains_of(chain, values, signals):
                    columns = columns * in_numpy(factor)[:, None]
            else:
                columns = added_columns_of(effect, count, own, signals)
            beside[effect.name] = columns
    return beside


def beside_the_loop(chain: Chain) -> set[str]:
    """Names of the effects whose additions are made where the loop is."""
    return {effect.name for effect in chain.at(AddedEffect) if effect.beside_the_loop}


def gains_of(chain: Chain, values: EffectValues, signals: Signals) -> list[jax.Array]:
    """Factors of the effects of the weights, `(time,)` each."""
    return [
        factor_of(effect, as_arrays(values[effect.name]), signals)
        for effect in chain.at(WeightEffect)
    ]


def _unmoved(chain: Chain, beside: Mapping[str, jax.Array], moved: str) -> dict[str, jax.Array]:
    """Those of the `columns_beside` that stay while the parameters of an effect move."""
    gone = {moved}
    if moved in {effect.name for effect in (*chain.at(InputEffect), *chain.at(WeightEffect))}:
        gone |= beside_the_loop(chain)
    return {name: columns for name, columns in beside.items() if name not in gone}


def response(
    chain: Chain, values: EffectValues, signals: Signals, coefficients: Coefficients
) -> jax.Array:
    """The output of a model, `(time,)`."""
    hysteresis = hysteresis_output(chain, values, signals, coefficients)
    return behind_hysteresis(chain, values, signals, hysteresis, coefficients)


def tangents(
    chain: Chain,
    values: EffectValues,
    signals: Signals,
    coefficients: Coefficients,
    parameters: list[tuple[str, str]],
) -> np.ndarray:
    """Derivatives of the output with respect to nonlinear parameters, `(time, parameters)`.

    Central differences, one-sided at a bound: a derivative through compiled code is compiled anew
    for each effect, which pays where it has many parameters (`MANY`).  Converters, which have no
    slope, are left out; their own steps are differentiated along each step.  What is fed back is
    held fixed, as it is in the `regressors`.
    """
    columns: dict[tuple[str, str], np.ndarray] = {}
    outputs: dict[bool, Callable[[str, Mapping[str, Any]], jax.Array]] = {}
    for effect in dict.fromkeys(effect for effect, _ in parameters):
        own = chain.effect(effect)
        names = [name for of, name in parameters if of == effect]
        rounds = isinstance(own, InputEffect) and own.rounds
        if rounds not in outputs:
            acting = chain if rounds else chain.unrounded
            outputs[rounds] = _moved_output(acting, values, signals, coefficients, parameters)
        output = partial(outputs[rounds], effect)
        at = {name: float(values[effect][name]) for name in names}
        if rounds or len(names) >= MANY:
            found = _forward(output, at)
        else:
            found = _by_differences(output, at, own.parameters())
        columns |= zip(((effect, name) for name in names), found, strict=True)
    empty = np.zeros((len(signals.time), 0))
    return np.stack([columns[each] for each in parameters], axis=1) if parameters else empty


def _forward(
    output: Callable[[Mapping[str, Any]], jax.Array], at: Mapping[str, float]
) -> np.ndarray:
    """Derivatives of an output with respect to each parameter, `(parameter, time)`."""
    steps = dict(zip(at, np.eye(len(at), dtype=jnp.result_type(float)), strict=True))
    place = {name: jnp.asarray(value, dtype=float) for name, value in at.items()}

    def derivative(step: Mapping[str, ArrayLike]) -> Array:
        return jax.jvp(output, (place,), (step,))[1]

    return np.asarray(jax.vmap(derivative)(steps))


def _by_differences(
    output: Callable[[Mapping[str, Any]], jax.Array],
    at: Mapping[str, float],
    declared: Sequence[Parameter],
) -> np.ndarray:
    """The same by central differences."""
    # Half the step at which rounding and curvature cost the same.
    small = float(np.finfo(np.dtype(jnp.result_type(float))).eps) ** (1 / 3)
    found: list[np.ndarray] = []
    by_name = {parameter.name: parameter for parameter in declared}
    for name, now in at.items():
        parameter = by_name[name]
        step = small * parameter.scale_at(now)
        low = max(now - step, min(parameter.low, now))
        high = min(now + step, max(parameter.high, now))
        first, last = (np.asarray(output({name: end})) for end in (low, high))
        found.append((last - first) / (high - low))
    return np.stack(found)


def _moved_output(
    chain: Chain,
    values: EffectValues,
    signals: Signals,
    coefficients: Coefficients,
    parameters: Sequence[tuple[str, str]],
) -> Callable[[str, Mapping[str, Any]], jax.Array]:
    """The output before a converter, as a function of an effect and its parameters' values."""
    before = {effect.name for place in PLACES[:2] for effect in chain.at(place)}
    hysteresis = None
    if chain.feeds_back or any(effect not in before for effect, _ in parameters):
        hysteresis = hysteresis_output(chain, values, signals, coefficients)
    beside, gains = columns_beside(chain, values, signals, {}), gains_of(chain, values, signals)

    def output(effect: str, own: Mapping[str, Any]) -> jax.Array:
        moved = cast(EffectValues, {**values, effect: {**values[effect], **own}})
        if effect in before:
            plain = course = drive(chain, moved, signals)
            if chain.feeds_back:
                course = drive(chain, moved, signals, hysteresis)
            given = operator_output(chain, course, coefficients)
            given = given + first_run_output(chain, plain, coefficients.first_run)
        else:
            assert hysteresis is not None
            given = hysteresis
        others = _unmoved(chain, beside, effect)
        factors = None if isinstance(chain.effect(effect), WeightEffect) else gains
        return behind_hysteresis(
            chain, moved, signals, given, coefficients, others, factors, in_steps=False
        )

    return output


def responses(
    chain: Chain,
    values: EffectValues,
    signals: Signals,
    coefficients: Coefficients,
    effect: str,
    many: list[dict[str, float]],
) -> np.ndarray:
    """Outputs of a model at several values of one effect's parameters, `(values, time)`."""
    before = {each.name for place in PLACES[:2] for each in chain.at(place)}
    if effect in before or chain.feeds_back:
        everything = [{**values, effect: own} for own in many]
        outputs = [response(chain, each, signals, coefficients) for each in everything]
        return np.stack([np.asarray(output) for output in outputs])
    hysteresis = hysteresis_output(chain, values, signals, coefficients)
    others = columns_beside(chain, {**values, effect: many[0]}, signals, {})
    others = _unmoved(chain, others, effect)
    outputs = [
        behind_hysteresis(chain, {**values, effect: own}, signals, hysteresis, coefficients, others)
        for own in many
    ]
    return np.stack([np.asarray(output) for output in outputs])

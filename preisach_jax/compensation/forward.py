"""A model along a drive that comes behind a past: everything that an inversion needs to know."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from preisach_jax.chain.coefficients import Coefficients
from preisach_jax.chain.compiled import as_arrays, fed_back_along, sensor_columns_of
from preisach_jax.chain.description import Chain, EffectValues
from preisach_jax.chain.driven import all_widen, drive, driven_path
from preisach_jax.chain.hysteresis import first_run_output, hysteresis_output
from preisach_jax.chain.output import behind_hysteresis, gains_of
from preisach_jax.compensation.branch import Operator
from preisach_jax.compensation.past import Past
from preisach_jax.effects.base import (
    AddedEffect,
    HysteresisEffect,
    InputEffect,
    SensorEffect,
    Signals,
)
from preisach_jax.model import Model


@dataclass(frozen=True)
class Course:
    """What happens in a model along the rows of a drive, `(time,)` each.

    Attributes:
        drive: the input.
        path: the input behind the effects of the input.
        seen: what the hysterons see, with what is fed back, in the middle of their widening.
        widening: by how much thresholds move outward.
        first_run: output of the hysterons of the first run.
        hysteresis: output of the operator, with that of the first run.
        output: the output before the sensor.
    """

    drive: np.ndarray
    path: np.ndarray
    seen: np.ndarray
    widening: np.ndarray
    first_run: np.ndarray
    hysteresis: np.ndarray
    output: np.ndarray


@dataclass(frozen=True, eq=False)
class Forward:
    """The model without its converters and its sensor, behind a past.

    Attributes:
        chain: its effects.
        values: their parameters.
        coefficients: its linear coefficients.
        past: what comes before.
        aux: the auxiliary columns along the course.
        sensors: the effects of the sensor, with their coefficients.
    """

    chain: Chain
    values: EffectValues
    coefficients: Coefficients
    past: Past
    aux: Mapping[str, np.ndarray]
    sensors: list[tuple[SensorEffect, np.ndarray]]

    @property
    def greatest_rate(self) -> float:
        """Greatest rate of a drive that passes the effects of the input, in input units per s."""
        acting = (e.at(self.values[e.name]) for e in self.chain.at(InputEffect))
        return min((float(e.greatest_rate) for e in acting), default=math.inf)

    def operator(self) -> Operator:
        """The operator with the model's own weights, which rises with its input."""
        chain, own = self.chain, self.coefficients
        return Operator.of(
            chain.plane,
            chain.polarity * own.weights,
            chain.polarity * own.memory,
            chain.hysteron == "relay",
            not chain.widens or all_widen(chain),
        )

    @staticmethod
    def of(model: Model, past: Past, aux: Mapping[str, np.ndarray]) -> Forward:
        """That of a model."""
        unrounded = model.chain.unrounded.effects
        kept = tuple(effect for effect in unrounded if not isinstance(effect, SensorEffect))
        chain, coefficients = model.chain, past.coefficients
        start = len(coefficients.added) - chain.sensor_coefficients
        sensors: list[tuple[SensorEffect, np.ndarray]] = []
        at = start
        for effect in chain.at(SensorEffect):
            stop = at + len(effect.coefficients())
            sensors.append((effect, coefficients.added[at:stop]))
            at = stop
        own = replace(coefficients, added=coefficients.added[:start])
        return Forward(chain.with_effects(kept), model.values, own, past, aux, sensors)

    def signals(self, along: np.ndarray) -> Signals:
        """The signals of the past and of a drive together."""
        whole = self.past.signals(along, self.aux)
        columns = {name: jnp.asarray(values) for name, values in whole.aux.items()}
        return Signals(jnp.asarray(whole.time), jnp.asarray(whole.input), columns)

    def path(self, along: np.ndarray) -> np.ndarray:
        """The input behind the effects of the input, in all rows, those of the past as well."""
        return np.asarray(driven_path(self.chain, self.values, self.signals(along)))

    def whole(self, along: np.ndarray) -> Course:
        """What happens in all rows, those of the past as well."""
        chain, values, signals = self.chain, self.values, self.signals(along)
        hysteresis = hysteresis_output(chain, values, signals, self.coefficients)
        plain = drive(chain, values, signals)
        first_run = first_run_output(chain, plain, self.coefficients.first_run)
        fed = drive(chain, values, signals, hysteresis) if chain.feeds_back else plain
        output = behind_hysteresis(chain, values, signals, hysteresis, self.coefficients)
        rising, falling = np.asarray(fed.rising), np.asarray(fed.rising)
        if fed.falling is not None:
            falling = np.asarray(fed.falling)
        return Course(
            np.asarray(signals.input),
            np.asarray(driven_path(chain, values, signals)),
            (rising + falling) / 2,
            (falling - rising) / 2,
            np.asarray(first_run),
            np.asarray(hysteresis),
            np.asarray(output),
        )

    def beyond_past(self, course: Course) -> Course:
        """The rows of the drive alone."""
        parts = {name: getattr(course, name)[self.past.count :] for name in vars(course)}
        return Course(**parts)

    def before_sensor(self, reading: Array) -> Array:
        """(time,) output of the rest of the model at which the sensor reads so."""
        for effect, share in reversed(self.sensors):
            own = as_arrays(self.values[effect.name])
            columns = sensor_columns_of(effect, len(share), own, reading)
            reading = reading - columns @ jnp.asarray(share)
        return reading

    def added(self) -> list[tuple[AddedEffect, np.ndarray]]:
        """The effects that add to the output, with their coefficients."""
        found: list[tuple[AddedEffect, np.ndarray]] = []
        at = 0
        for effect in self.chain.at(AddedEffect):
            stop = at + len(effect.coefficients())
            found.append((effect, self.coefficients.added[at:stop]))
            at = stop
        return found

    def gain(self, along: np.ndarray) -> np.ndarray:
        """Factor of ageing and its like on the weights in the rows of the drive."""
        signals = self.signals(along)
        factor = np.ones(len(signals.time))
        for each in gains_of(self.chain, self.values, signals):
            factor = factor * np.asarray(each)
        return factor[self.past.count :]

    def fed_back(self, path: np.ndarray, hysteresis: np.ndarray) -> np.ndarray:
        """What the hysterons see of an input in all rows and of the operator's output there."""
        time = self.signals(path[self.past.count :]).time
        seen, rising = jnp.asarray(path), jnp.asarray(self.chain.polarity * hysteresis)
        for effect in self.chain.at(HysteresisEffect):
            seen = fed_back_along(effect, as_arrays(self.values[effect.name]), seen, rising, time)
        return np.asarray(seen)

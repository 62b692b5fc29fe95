"""A model and its inverse from one sample to the next, with a state of fixed size.

What needs to look ahead is not in them: a delay, and added effects whose memory is no part of the
contract of an effect.  An effect of which no lead is stable at the rate is followed, but not led.
`left_out` names all of these.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from preisach_jax.chain.compiled import as_arrays, widening_of
from preisach_jax.chain.output import gains_of, sensed
from preisach_jax.compensation.branch import BranchBounds, follow, inverse_step
from preisach_jax.compensation.forward import Forward
from preisach_jax.compensation.past import past_of
from preisach_jax.compensation.search import Limits
from preisach_jax.compensation.series import Law, Series
from preisach_jax.effects.base import (
    AddedEffect,
    Effect,
    HysteresisEffect,
    InputEffect,
    OfColumn,
    OutputEffect,
    Signals,
    WeightEffect,
    auxiliary_columns,
)
from preisach_jax.errors import InputError
from preisach_jax.model import Model
from preisach_jax.record.core import Record

USUAL_PER_S = 20.0
"""Ranges of the input a second at which it is reckoned over how many samples a speed is taken."""


def check_causal(model: Model) -> None:
    """Refuse a model whose effects cannot be followed from one sample to the next."""
    for effect in model.effects:
        if isinstance(effect, WeightEffect) and not effect.of_time_alone:
            raise InputError(
                f"the effect {effect.name!r} cannot be followed from sample to sample: compute the "
                "drive beforehand (preisach compensate), or fit a model without it"
            )


class CausalState(NamedTuple):
    """Everything that a sample leaves to the next one.

    Attributes:
        time: s since the origin of the model's effects; without a clock, the path of the input.
        weights: (2, levels, levels) those of the operator.
        states: (2, levels, levels) of the hysterons.
        position: of the hysterons' input.
        path: (sample,) input behind the effects of the input, in the last samples.
        drive: the last input.
        before: states of the effects of the input.
        hysteresis: (2,) last outputs of the operator, rising with the input.
        behind: states of the effects of the output.
        signal: the last signal in front of these.
        aim: the last course behind these.
        aux: states of the effects of auxiliary columns.
        follow: what the measured output was last found to differ by.
    """

    time: Array
    weights: Array
    states: Array
    position: Array
    path: Array
    drive: Array
    before: tuple[Any, ...]
    hysteresis: Array
    behind: tuple[Any, ...]
    signal: Array
    aim: Array
    aux: tuple[Any, ...]
    follow: Array


def plain(leaf: Any) -> Array:
    """An array as a compiled step gives it back, of no weak type."""
    return jnp.asarray(np.asarray(leaf))


@dataclass(frozen=True, eq=False)
class Causal:
    """The numbers of a model at one sampling rate, and its two steps.

    Arguments:
        step_s: time between two samples, in s.
    """

    forward: Forward
    step_s: float
    limits: Limits

    @staticmethod
    def of(model: Model, rate_hz: float, limits: Limits, after: Record | None) -> Causal:
        """Those of a model behind what was played before."""
        check_causal(model)
        time = np.arange(2) / rate_hz
        aux = {
            name: np.full(2, 0.0 if after is None else after.aux[name][-1])
            for name in auxiliary_columns(model.effects)
        }
        past = past_of(model, Record.from_arrays(time, 0 * time, 0 * time, aux=aux), after)
        forward = Forward.of(
            model,
            replace(past, time=past.time[:1]),
            {name: values[:1] for name, values in aux.items()},
        )
        return Causal(forward, 1 / rate_hz, limits)

    @property
    def left_out(self) -> tuple[str, ...]:
        """Names of the model's effects that the inverse does not take away."""
        laws = zip((self._before, self._behind), self.laws, strict=True)
        led = [effects[i] for effects, law in laws for i in law.kept]
        kept = {e.name for e in (*led, *self._aux, *self._timed)}
        chain = self.forward.chain
        others = [*chain.at(InputEffect), *chain.at(OutputEffect), *chain.at(AddedEffect)]
        kept |= {e.name for e in chain.at(InputEffect) if e.limits_rate}
        converters = [e.name for e, _ in self.forward.sensors if e.converts]
        return (*(e.name for e in others if e.name not in kept), *converters)

    @property
    def _before(self) -> list[InputEffect]:
        return [e for e in self.forward.chain.at(InputEffect) if not e.limits_rate]

    @property
    def _behind(self) -> list[OutputEffect]:
        return [e for e in self.forward.chain.at(OutputEffect) if not e.is_delay]

    @property
    def _aux(self) -> list[Any]:
        added = self.forward.chain.at(AddedEffect)
        return [e for e in added if isinstance(e, OfColumn) and e.is_linear]

    @property
    def _timed(self) -> list[AddedEffect]:
        return [e for e in self.forward.chain.at(AddedEffect) if e.of_time_alone]

    @cached_property
    def laws(self) -> tuple[Law, Law]:
        """The leads of the effects of the input and of the output."""
        return self._in_front.law(), self.after.law()

    @property
    def delay(self) -> float:
        """Samples by which the reading is late."""
        values, effects = self.forward.values, self.forward.chain.at(OutputEffect)
        return sum(float(e.at(values[e.name]).late_s) for e in effects) / self.step_s

    @property
    def _in_front(self) -> Series:
        return Series(tuple(self._before), self.forward.values, self.step_s)

    @property
    def after(self) -> Series:
        """The effects of the output, without a delay."""
        return Series(tuple(self._behind), self.forward.values, self.step_s)

    @property
    def resolution(self) -> float:
        """Step of the converter of the reading; 0 where it has none."""
        values = self.forward.values
        return sum(float(e.at(values[e.name]).resolution) for e, _ in self.forward.sensors)

    def start(self) -> CausalState:
        """The state after the past of `forward`."""
        rest = np.full(1, self.forward.past.last_input)
        whole = self.forward.whole(rest)
        count = self.forward.past.count
        signals = self.forward.signals(rest)
        time = np.asarray(signals.time)[:count]
        dt = np.diff(time, prepend=time[:1])
        operator, chain = self.forward.operator(), self.forward.chain
        unit = (chain.plane.high - chain.plane.low) / chain.plane.levels
        seen = (whole.seen[:count] - chain.plane.low) / unit
        path = jnp.asarray(np.clip(seen, 0.0, chain.plane.levels))
        states, position = follow(operator, path, jnp.asarray(whole.widening[:count] / unit))
        before, _ = self._in_front.ran(np.asarray(signals.input)[:count], dt)
        signal = whole.hysteresis[:count]
        for factor in gains_of(chain, self.forward.values, signals):
            signal = signal * np.asarray(factor)[:count]
        behind, aim = self.after.ran(signal, dt)
        aux = [
            self._alone(effect).ran(np.asarray(signals.aux[effect.column])[:count], dt)[0]
            for effect in self._aux
        ]
        last = chain.polarity * whole.hysteresis[count - 1]
        state: Any = (
            np.asarray(signals.path)[count] if self.forward.chain.by_path else time[-1],
            operator.weights,
            states,
            position,
            np.full(self._samples_of_speed, whole.path[count - 1]),
            self.forward.past.last_input,
            before,
            np.full(2, last),
            behind,
            signal[-1],
            np.asarray(aim)[-1],
            tuple(aux),
            0.0,
        )
        return jax.tree.map(plain, CausalState(*state))

    def _alone(self, effect: Any) -> Series:
        return Series((effect,), self.forward.values, self.step_s)

    def gain(self, time: Array) -> Array:
        """Output of the operator at a time for one that rises by one with the input."""
        signals = self._at(time)
        gain = jnp.asarray(float(self.forward.chain.polarity))
        for effect in self.forward.chain.at(WeightEffect):
            gain = gain * effect.at(self.forward.values[effect.name]).factor(signals)[0]
        return gain

    def _at(self, time: Array) -> Signals:
        return Signals(time[None], jnp.zeros(1), {}, gone=time[None])

    def _now(self, state: CausalState) -> Array:
        """The time of the next sample, or the path of the input before it, which is known."""
        return state.time if self.forward.chain.by_path else state.time + self.step_s

    def beside(self, time: Array, aux: tuple[Any, ...]) -> Array:
        """What adds to the output at a time: offset, drift, hum, auxiliary columns, free parts."""
        chain, own = self.forward.chain, self.forward.coefficients
        value, at = jnp.asarray(own.offset), 0
        lags = dict(zip([e.name for e in self._aux], aux, strict=True))
        timed = {e.name for e in self._timed}
        for effect in [*chain.at(AddedEffect), *chain.at(OutputEffect)]:
            stop = at + len(effect.coefficients())
            share = jnp.asarray(own.added[at:stop])
            at = stop
            if effect.name in lags:
                ((states, last),) = lags[effect.name]
                law = effect.at(self.forward.values[effect.name]).state_space(time)
                value = value + law.output(states, last) @ share
            elif isinstance(effect, OutputEffect):
                value = value + effect.free_response(self._at(time))[0] @ share
            elif effect.name in timed:
                columns = effect.at(self.forward.values[effect.name]).columns(self._at(time))
                value = value + columns[0] @ share
        return value

    def _aux_after(self, state: CausalState, aux: Array) -> tuple[Any, ...]:
        columns = auxiliary_columns(self.forward.chain.effects)
        return tuple(
            self._alone(effect).passed(own, aux[columns.index(effect.column)])[0]
            for effect, own in zip(self._aux, state.aux, strict=True)
        )

    def _widening(self, path: Array) -> Array:
        """Widening at the last of three values of the input, by its speed to there."""
        time, width = jnp.asarray(self.step_s * np.arange(3.0)), jnp.zeros(())
        for effect in self.forward.chain.at(HysteresisEffect):
            own = as_arrays(self.forward.values[effect.name])
            width = width + widening_of(effect, own, path, time)[-1]
        return width

    def _seen(self, path: Array, hysteresis: Array) -> Array:
        time = jnp.asarray([0.0, self.step_s])
        for effect in self.forward.chain.at(HysteresisEffect):
            path = effect.at(self.forward.values[effect.name]).fed_back(path, hysteresis, time)
        return path[-1]

    def inverse(
        self, state: CausalState, wanted: Array, aux: Array
    ) -> tuple[CausalState, tuple[Array, Array, Array]]:
        """The drive for one more wanted reading; of it, the reading, and what is behind effects."""
        chain, past = self.forward.chain, state
        plane, time = chain.plane, self._now(state)
        unit = (plane.high - plane.low) / plane.levels
        lags = self._aux_after(state, aux)
        before, behind = self.laws
        aim = self.before_sensor(wanted) - self.beside(time, lags) - state.follow
        signal = behind(state.behind, state.signal, (state.aim, aim))
        gain = self.gain(time)
        operator = replace(self.forward.operator(), weights=state.weights)

        def found(width: Array) -> Array:
            target = signal / gain
            output = jnp.stack([state.hysteresis[1], target])
            ends = jnp.asarray([self.limits.low, self.limits.high])
            both = jnp.stack([self._seen(jnp.stack([past.path[-1], e]), output) for e in ends])
            low, high = jnp.clip((both - plane.low) / unit, 0.0, plane.levels)
            step = jnp.asarray(np.inf if chain.feeds_back else self._slew * self.step_s / unit)
            bounds = BranchBounds(low, high, step, jnp.asarray(np.nan))
            _, (position, given) = inverse_step(
                operator, (state.states, state.position), target, width / unit, bounds
            )
            seen = plane.low + unit * position
            output = jnp.stack([state.hysteresis[1], given])
            none = self._seen(jnp.stack([past.path[-1], jnp.zeros(())]), output)
            slope = self._seen(jnp.stack([past.path[-1], jnp.ones(())]), output) - none
            return (seen - none) / slope

        # A widening that grows faster than the input itself would chase it: its speed is that of
        # some samples that are known.
        move = (state.path[-1] - state.path[0]) / (len(state.path) - 1)
        line = state.path[-1] + move * jnp.arange(-2.0, 1.0)
        path = found(self._widening(line))
        drive = before(state.before, state.drive, (state.path[-1], path))
        reach = self._slew * self.step_s
        drive = jnp.clip(drive, self.limits.low, self.limits.high)
        drive = jnp.clip(drive, state.drive - reach, state.drive + reach)
        new, expected = self.step(state, drive, lags)
        return new._replace(aim=aim), (drive, expected, new.aim)

    @property
    def _samples_of_speed(self) -> int:
        plane = self.forward.chain.plane
        move = USUAL_PER_S * (plane.high - plane.low) * self.step_s
        steep = float(self._widening(jnp.asarray(move * np.arange(3.0)))) / move
        return 3 + int(np.ceil(4 * steep))

    @property
    def _slew(self) -> float:
        return min(self.limits.slew, self.forward.greatest_rate)

    def step(
        self, state: CausalState, drive: Array, lags: tuple[Any, ...]
    ) -> tuple[CausalState, Array]:
        """The state after a drive has been played, and the reading that the model expects."""
        chain = self.forward.chain
        plane, time = chain.plane, self._now(state)
        unit = (plane.high - plane.low) / plane.levels
        operator = replace(self.forward.operator(), weights=state.weights)
        reach = self._slew * self.step_s
        driven = jnp.clip(drive, state.drive - reach, state.drive + reach)
        before, path = self._in_front.passed(state.before, driven)
        width = self._widening(jnp.stack([*state.path[-2:], path])) / unit
        pair = jnp.stack([state.path[-1], path])

        def place(output: Array) -> Array:
            seen = self._seen(pair, jnp.stack([state.hysteresis[1], output]))
            return jnp.clip((seen - plane.low) / unit, 0.0, plane.levels)

        def moved(output: Array) -> Array:
            return operator.moved(state.states, place(output), width)[0]

        output = state.hysteresis[1]
        if chain.feeds_back:  # secant steps: what is fed back agrees with itself
            for _ in range(6):
                given, slope = jax.jvp(moved, (output,), (jnp.ones_like(output),))
                output = output + (given - output) / jnp.maximum(1 - slope, 0.2)
        position = place(output)
        output, states = operator.moved(state.states, position, width)
        signal = self.gain(time) * output
        behind, value = self.after.passed(state.behind, signal)
        reading = self._reading(value + self.beside(time, lags) + state.follow)
        new = state._replace(
            time=time + jnp.abs(driven - state.drive) if self.forward.chain.by_path else time,
            states=states,
            position=position,
            path=jnp.stack([*state.path[1:], path]),
            drive=driven,
            before=before,
            hysteresis=jnp.stack([state.hysteresis[1], output]),
            behind=behind,
            signal=signal,
            aim=value,
            aux=lags,
        )
        return new, reading

    def played(self, state: CausalState, sample: Array) -> tuple[CausalState, Array]:
        """The state after a sample of drive and auxiliary columns, and the reading there."""
        return self.step(state, sample[0], self._aux_after(state, sample[1:]))

    def before_sensor(self, reading: Array) -> Array:
        """The output at which the sensor reads a value."""
        return self.forward.before_sensor(reading[None])[0]

    def _reading(self, value: Array) -> Array:
        kept: tuple[Effect, ...] = tuple(e for e, _ in self.forward.sensors if not e.converts)
        if not kept:
            return value
        shares = [s for e, s in self.forward.sensors if not e.converts]
        chain = self.forward.chain.with_effects(kept)
        own = replace(self.forward.coefficients, added=np.concatenate(shares))
        return sensed(chain, self.forward.values, value[None], own)[0]

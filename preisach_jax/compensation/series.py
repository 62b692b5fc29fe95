"""Effects in series on one signal, from one sample to the next, and what must go into them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array

from preisach_jax.chain import EffectValues
from preisach_jax.effects.base import InputEffect, OutputEffect

PASSED = 0.25
"""Share of a straight course that effects must have passed at the sample by which a lead is
reckoned: nearer ones ask for a drive that swings from sample to sample."""

MOST_AHEAD = 8
"""Samples to which a lead looks ahead along the straight line on which the course runs."""

States = tuple[Any, ...]
"""State of each effect."""


@dataclass(frozen=True, eq=False)
class Series:
    """Effects of the input or of the output, in order.

    Arguments:
        effects: the effects.
        values: their parameters.
        step_s: time between two samples, in s.
    """

    effects: tuple[InputEffect | OutputEffect, ...]
    values: EffectValues
    step_s: float

    def ran(self, signal: Array, dt: Array) -> tuple[States, Array]:
        """States after a signal, `(time,)`, whose time steps are given, and what has come out."""
        ends: list[Any] = []
        for effect in self.effects:
            acting = effect.at(self.values[effect.name])

            def advance(state: Any, now: tuple[Array, Array], e: Any = acting) -> tuple[Any, Array]:
                return e.step(state, *now)

            end, signal = jax.lax.scan(advance, acting.init(signal[0]), (signal, dt))
            ends.append(end)
        return tuple(ends), signal

    def passed(self, states: States, value: Array) -> tuple[States, Array]:
        """States after one more sample, and what comes out."""
        after: list[Any] = []
        dt = jnp.asarray(self.step_s)
        for effect, state in zip(self.effects, states, strict=True):
            new, value = effect.at(self.values[effect.name]).step(state, value, dt)
            after.append(new)
        return tuple(after), value

    def ahead(self) -> int:
        """Samples ahead at which enough of a straight course has come through."""
        states = tuple(e.at(self.values[e.name]).init(jnp.zeros(())) for e in self.effects)
        for ahead in range(MOST_AHEAD):
            states, out = self.passed(states, jnp.asarray(ahead + 1.0))
            if float(out) >= PASSED * (ahead + 1):
                return ahead
        return MOST_AHEAD

    def led(self, states: States, before: Array, aims: tuple[Array, Array], ahead: int) -> Array:
        """What must go in now for a course to come out.

        Without a lag it is exact.  With one, the line on which the course runs is hit as nearly as
        a straight input can, from now to some samples ahead: least squares.

        Arguments:
            states: states of the effects after the sample before.
            before: what went in then.
            aims: the course then and now.
            ahead: how many samples ahead.
        """
        if not self.effects:
            return aims[1]

        def outputs(now: Array) -> Array:
            at, out = states, list[Array]()
            for j in range(ahead + 1):
                at, value = self.passed(at, before + (j + 1) * (now - before))
                out.append(value)
            return jnp.stack(out)

        none = outputs(before)
        slope = outputs(before + 1.0) - none
        line = aims[1] + jnp.arange(ahead + 1) * (aims[1] - aims[0])
        return before + slope @ (line - none) / (slope @ slope)

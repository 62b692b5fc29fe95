"""Effects in series on one signal, from one sample to the next, and what must go into them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jax.typing import ArrayLike
from jaxtyping import Array

from preisach_jax.chain.compiled import as_array, as_arrays
from preisach_jax.chain.description import EffectValues
from preisach_jax.effects.base import Stepped

PASSED = 0.1
"""Share of a straight course that effects must have passed at the sample by which a lead is
reckoned: nearer ones make more of every step of the course than a drive can follow."""

MOST_AHEAD = 4096
"""Samples to which a lead looks ahead at most along the line on which the course runs."""

STABLE = 1 + 1e-6
"""Greatest growth of a lead's own motion in a sample; that of a leakage neither grows nor falls."""

SWINGS = 0.75
"""Greatest of those that swing to the other side in each sample."""

States = tuple[Any, ...]
"""State of each effect."""


class Law(NamedTuple):
    """What must go in now: states, last input, course, and its rise since the last sample by gains.

    `kept` says which effects are led; the others are left out, as no lead of them is stable.
    """

    kept: tuple[int, ...]
    states: np.ndarray
    before: float
    course: float
    rise: float

    def __call__(self, states: States, before: Array, aims: tuple[Array, Array]) -> Array:
        """The next input; a course then and now in `aims`."""
        then, now = aims
        if not self.kept:
            return now
        own = ravel_pytree([states[i] for i in self.kept])[0]
        rise = self.rise * (now - then)
        return self.course * now + rise - self.states @ own - self.before * before


class _Matrices(NamedTuple):
    """One sample of the effects: new states A x + B v, and output C x + D v."""

    a: np.ndarray
    b: np.ndarray
    c: np.ndarray
    d: float


@dataclass(frozen=True, eq=False)
class Series:
    """Effects of the input or of the output, in order.

    Arguments:
        step_s: time between two samples, in s.
    """

    effects: tuple[Stepped, ...]
    values: EffectValues
    step_s: float

    def ran(self, signal: ArrayLike, dt: ArrayLike) -> tuple[States, Array]:
        """States after a signal, `(time,)`, whose time steps are given, and what has come out."""
        return _ran(*self._numbers, signal, dt)

    @property
    def _numbers(self) -> tuple[tuple[Stepped, ...], dict[str, Any]]:
        """Effects and values as arguments, so that what is compiled for some serves for others."""
        own = {e.name: as_arrays(self.values[e.name]) for e in self.effects}
        return jax.tree.map(as_array, self.effects), own

    def passed(self, states: States, value: Array) -> tuple[States, Array]:
        """States after one more sample, and what comes out."""
        after: list[Any] = []
        dt = jnp.asarray(self.step_s)
        for effect, state in zip(self.effects, states, strict=True):
            new, value = effect.at(self.values[effect.name]).step(state, value, dt)
            after.append(new)
        return tuple(after), value

    def rests(self, values: Array) -> tuple[States, Array]:
        """States at rest at many signals side by side, `(signal,)`, and what comes out."""

        def one(value: Array) -> tuple[States, Array]:
            states, output = self.ran(value[None], jnp.zeros(1))
            return states, output[0]

        return jax.vmap(one)(values)

    def passed_each(self, states: States, values: Array) -> tuple[States, Array]:
        """`passed` for many signals side by side, `(signal,)`."""
        return jax.vmap(self.passed)(states, values)

    @property
    def ringing_s(self) -> float:
        """Time constant in s with which the slowest mode dies away; 0 where nothing rings."""
        linear = self._linear()
        poles = np.linalg.eigvals(linear.a) if linear is not None else np.zeros(0)
        rings = np.abs(poles[np.abs(poles.imag) > 1e-6 * np.abs(poles)])
        return float(-self.step_s / np.log(rings.max())) if len(rings) else 0.0

    def law(self) -> Law:
        """The lead of as many of the effects as have a stable one together."""
        kept, found = tuple[int, ...](), Law((), np.zeros(0), 0.0, 1.0, 0.0)
        for i in range(len(self.effects)):
            tried = (*kept, i)
            linear = replace(self, effects=tuple(self.effects[j] for j in tried))._linear()
            law = None if linear is None else _stable_law(linear, tried)
            if law is not None:
                kept, found = tried, law
        return found

    def _linear(self) -> _Matrices | None:
        """The effects as matrices; None where they are not linear."""
        each = np.asarray(_samples(*self._numbers, np.asarray(self.step_s)))
        matrix, some = each[:, :-1], _some(len(each))
        if not np.allclose(each[:, -1], matrix @ some, rtol=1e-6):
            return None
        return _Matrices(matrix[:-1, :-1], matrix[:-1, -1], matrix[-1, :-1], float(matrix[-1, -1]))


@eqx.filter_jit
def _ran(
    effects: tuple[Stepped, ...], values: EffectValues, signal: ArrayLike, dt: ArrayLike
) -> tuple[States, Array]:
    signal, dt, ends = jnp.asarray(signal), jnp.asarray(dt), list[Any]()
    for effect in effects:
        acting = effect.at(values[effect.name])

        def advance(state: Any, now: tuple[Array, Array], e: Any = acting) -> tuple[Any, Array]:
            return e.step(state, *now)

        end, signal = jax.lax.scan(advance, acting.init(signal[0]), (signal, dt))
        ends.append(end)
    return tuple(ends), signal


@eqx.filter_jit
def _samples(effects: tuple[Stepped, ...], values: EffectValues, step_s: Any) -> Array:
    """States and output after one sample: from each unit of states and input, and from `_some`."""
    first = tuple(e.at(values[e.name]).init(jnp.zeros(())) for e in effects)
    rest, states_of = ravel_pytree(first)

    def sample(both: Array) -> Array:
        series = Series(effects, values, step_s)
        after, out = series.passed(states_of(both[:-1]), both[-1])
        return jnp.append(ravel_pytree(after)[0], out)

    size = len(rest) + 1
    starts = np.vstack([np.eye(size), _some(size)])
    return jax.vmap(sample, out_axes=1)(jnp.asarray(starts, rest.dtype))


def _some(size: int) -> np.ndarray:
    return 1 + np.arange(size) / size


def _stable_law(linear: _Matrices, kept: tuple[int, ...]) -> Law | None:
    r"""The lead that looks ahead least, of those for which enough passes and that are stable.

    A straight input, \(v_j = v_0 + (j + 1)(v - v_0)\), gives outputs \(y_j = F_j x + g_j v_0 +
    s_j (v - v_0)\); its slope is such that they hit the line of the course, least squares over
    all j.  With nothing to look ahead that is the exact inverse, whose poles are the zeros of the
    effects: those of a sampled mode lie outside the unit circle.
    """
    free, held, risen = np.eye(len(linear.b)), np.zeros(len(linear.b)), np.zeros(len(linear.b))
    rows, trial = list[tuple[np.ndarray, float, float]](), 0
    for ahead in range(MOST_AHEAD):
        slope = float(linear.c @ risen) + linear.d * (ahead + 1)
        rows.append((linear.c @ free, float(linear.c @ held) + linear.d, slope))
        free = linear.a @ free
        held = linear.a @ held + linear.b
        risen = linear.a @ risen + linear.b * (ahead + 1)
        if slope < PASSED * (ahead + 1) or ahead < trial:
            continue
        trial = ahead + 1 + ahead // 8
        of_states, of_held, slopes = (np.array(each) for each in zip(*rows, strict=True))
        share = slopes / (slopes @ slopes)
        states, before = share @ of_states, float(share @ of_held) - 1
        rise = float(share @ np.arange(ahead + 1))
        own = np.vstack([
            np.column_stack([linear.a - np.outer(linear.b, states), -before * linear.b]),
            np.append(-states, -before),
        ])  # fmt: skip
        poles = np.linalg.eigvals(own)
        swings = np.abs(poles[poles.real < 0]).max(initial=0.0)
        if np.abs(poles).max() <= STABLE and swings <= SWINGS:
            return Law(kept, states, before, float(share.sum()), rise)
    return None

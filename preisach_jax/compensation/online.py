"""The inverse for a running machine: one wanted sample in, one drive sample out."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cached_property, partial
from pathlib import Path
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from preisach_jax.compensation.causal import Causal, CausalState, plain
from preisach_jax.compensation.drive import limits_of
from preisach_jax.cores import on_processor
from preisach_jax.effects.base import Effect, auxiliary_columns
from preisach_jax.errors import ContentError, InputError
from preisach_jax.files import read_arrays, write_arrays
from preisach_jax.model import Model
from preisach_jax.record.core import Record

FORMAT = 2

LEAST_MOVED = 0.25
"""Hysterons, squared, that must have moved between two updates of the weights."""

_Carried = tuple[CausalState, "Learning"]
_Compiled = Callable[[_Carried, np.ndarray], tuple[CausalState, "Learning", Array]]


class Learning(NamedTuple):
    """What an update of the weights refers to: hysterons behind the linear effects of the output.

    Attributes:
        filtered: states of the effects for each hysteron by itself, `(cells, ...)` each.
        line: (sample, cells) what has come out of them, the latest first, over the delay.
        output: (sample,) what the model says of the sum there.
        behind: (cells,) what had come out of them at the last update, behind the delay.
        level: measured sum there; NaN before the first.
    """

    filtered: tuple[Any, ...]
    line: Array
    output: Array
    behind: Array
    level: Array


class OnlineInverse:
    r"""The inverse of a model for a running machine: one wanted sample in, one drive sample out.

    The chain of the model is inverted in its order at each sample, with the state of all its
    effects: what adds to the output is subtracted, creep and reversible parts are exact, and lags
    and modes are led along the straight line on which the course runs.  A delay is left out, as
    that would take samples that are still to come, and so is a mode for which no lead is stable at
    the rate; `left_out` names them and others.

    With a measured output beside it, the weights go on learning by the rule of the adaptive
    filter, eq. (7) to (11), \(R \leftarrow R + \mu\, e\, s / s^2\) with 0 ≤ R ≤ the stroke, where
    s has gone through the effects of the output as the reading has, its delay included
    (filtered-x: B. Widrow, S. D. Stearns, Adaptive Signal Processing, Prentice Hall 1985, ch. 11),
    and e is what the weights of now would miss of the increments of the reading.  Without noise no
    step leads away from weights that explain the readings, whatever the effects and the rate.  What
    is left is followed as a slow change of the output, such as a creep or a drift that the model
    does not know, and no faster than its modes die away.

    Arguments:
        model: the model.
        rate_hz: sampling rate of the machine.
        limits: lowest and highest value of the drive, by default the range of the plane.
        slew: greatest rate of the drive, in its unit per s; by default unlimited.
        after: what was played before; by default the record on which the model was identified.
        step_size: μ, from 0, which leaves the weights, to 1.
        follow_s: time constant in s with which slow changes are followed, at least that with which
            a mode of the model dies away; infinite for never.

    Raises:
        InputError: the model has weights of both signs; or the rate, the limits, the slew, the step
            size or the time constant is none.

    Example:
        >>> import preisach_jax as pj
        >>> t = np.arange(3000) / 100
        >>> u = 5 - 5 * np.cos(t * (1 + t / 40))
        >>> model = pj.fit(pj.Record.from_arrays(t, u, u**1.1), levels=9).model
        >>> inverse = OnlineInverse(model, rate_hz=100.0)
        >>> drive = inverse(6.0)
        >>> 3 < drive < 7, round(inverse.expected, 6), inverse.reached
        (True, 6.0, True)
    """

    def __init__(
        self,
        model: Model,
        rate_hz: float,
        limits: Sequence[float] | None = None,
        *,
        slew: float | None = None,
        after: Record | None = None,
        step_size: float = 0.1,
        follow_s: float = 1.0,
    ):
        if not 0 < rate_hz < math.inf:
            raise InputError(f"rate_hz is {rate_hz}: give the sampling rate in Hz, above 0")
        if not 0 <= step_size <= 1:
            raise InputError(f"step_size is {step_size}: give a number from 0 to 1")
        if not follow_s > 0:
            raise InputError(f"follow_s is {follow_s}: give a time in s above 0")
        self._model, self._rate, self._step_size = model, float(rate_hz), float(step_size)
        self._limits, self._follow_s = limits_of(model, limits, slew)[0], float(follow_s)
        model.check_invertible()
        self._aux_columns = auxiliary_columns(model.effects)
        with on_processor():
            self._causal = Causal.of(model, self._rate, self._limits, after)
            # Before the steps are traced, which read them: numbers of the model and the rate.
            _ = self._causal.laws, self._share
            start = self._causal.start()
            begun: Any = jax.jit(partial(_first_learning, self._causal))
            # Compiled here and not at the first sample, which a controller waits for.
            carried: _Carried = (start, jax.tree.map(plain, begun(start)))
            self._state, self._learning = carried
            stroke = float(np.abs(model.weights).sum())
            step = partial(_step, self._causal, self._step_size, self._share, stroke)
            sample = np.zeros(2 + len(self._aux_columns))
            compiled = jax.jit(step).lower(carried, sample).compile()
            self._step = cast(_Compiled, compiled)
        self.expected = self.drive = math.nan
        self.reached = True
        self._good = max(1.96 * model.rms_validation, 1e-6 * float(np.abs(model.weights).sum()))

    @cached_property
    def _share(self) -> float:
        # A mode that is a little other than the model's would take a faster change for its own.
        slowly = max(self._follow_s, self._causal.after.ringing_s)
        return -math.expm1(-1 / (self._rate * slowly))

    @property
    def left_out(self) -> tuple[str, ...]:
        """Names of effects that are not inverted from sample to sample."""
        return self._causal.left_out

    @property
    def weights(self) -> np.ndarray:
        """(cells,) weights of the operator as they have been learnt, in output units."""
        plane = self._model.plane
        whole = np.asarray(self._state.weights).sum(axis=0)
        return self._model.chain.polarity * whole[plane.alpha_index, plane.beta_index]

    def __call__(
        self, wanted: float, measured: float = math.nan, aux: Mapping[str, float] | None = None
    ) -> float:
        """The drive for one more sample.

        Arguments:
            wanted: wanted output at this sample, in its unit.
            measured: measured output at the sample before, which the last drive has made; NaN
                where there is none.
            aux: auxiliary columns that the model needs, at this sample.

        Returns:
            The drive, in its unit.  `expected` is the output that the model expects of it, and
            `reached` whether that is the wanted one to the model's held-out error.

        Raises:
            InputError: a value is missing or not finite; the state is then as before.
        """
        if not math.isfinite(wanted):
            raise InputError(f"the wanted output is {wanted}: give a finite number")
        if math.isinf(measured):
            raise InputError(f"the measured output is {measured}: give NaN where it is missing")
        given = aux or {}
        for name in self._aux_columns:
            if not math.isfinite(given.get(name, math.nan)):
                raise InputError(
                    f"the model needs the auxiliary column {name!r}: give aux={{{name!r}: ...}}"
                )
        sample = np.array([wanted, measured, *(given[n] for n in self._aux_columns)])
        with jax.enable_x64(True):  # the step was compiled for its device
            self._state, self._learning, out = self._step((self._state, self._learning), sample)
            self.drive, self.expected = np.asarray(out).tolist()
        self.reached = abs(self.expected - wanted) <= self._good
        return self.drive

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write model and state to a file; an existing one is replaced in one go.

        Arguments:
            path: the file, NumPy's `.npz` format whatever its name.

        Raises:
            InputError: the file cannot be written.
        """
        about = {
            "format": FORMAT,
            "model": self._model.to_json(),
            "rate_hz": self._rate,
            "limits": [self._limits.low, self._limits.high],
            "slew": None if math.isinf(self._limits.slew) else self._limits.slew,
            "step_size": self._step_size,
            "follow_s": None if math.isinf(self._follow_s) else self._follow_s,
        }
        leaves: list[Any] = jax.tree.leaves((self._state, self._learning))
        arrays = {f"leaf.{i}": np.asarray(leaf) for i, leaf in enumerate(leaves)}
        arrays["last"] = np.array([self.drive, self.expected])
        write_arrays(Path(path), about, arrays)

    @classmethod
    def load(cls, path: str | os.PathLike[str], effects: Iterable[Effect] = ()) -> OnlineInverse:
        """Read what `save` wrote.

        Arguments:
            path: the file.
            effects: effects of one's own that the model holds.

        Returns:
            An inverse that goes on as the saved one would have.

        Raises:
            InputError: the file is missing, broken, or written by a newer version.
        """
        remedy = "give a file that `save` wrote"
        with read_arrays(Path(path), FORMAT, "a saved inverse", remedy) as (about, stored):
            inverse = cls(
                Model.from_json(about["model"], effects),
                about["rate_hz"],
                about["limits"],
                slew=about["slew"],
                step_size=about["step_size"],
                follow_s=math.inf if about["follow_s"] is None else about["follow_s"],
            )
            places = iter(range(sys.maxsize))

            def kept(old: Array) -> Array:
                leaf = stored[f"leaf.{next(places)}"]
                if leaf.shape != old.shape:
                    raise ContentError("its state is that of another model")
                return jnp.asarray(leaf)

            with on_processor():
                state = (inverse._state, inverse._learning)
                inverse._state, inverse._learning = jax.tree.map(kept, state)
            inverse.drive, inverse.expected = stored["last"].tolist()
        return inverse


def _first_learning(causal: Causal, state: CausalState) -> Learning:
    """At rest where the hysterons are: what a past has left in the effects is in the increments."""
    states = _through(causal, state)
    late = math.ceil(causal.delay - 1e-9) + 1
    filtered, output = causal.after.rests(states)
    line = jnp.broadcast_to(output, (late, len(output)))
    unknown = jnp.full(late, jnp.nan)
    return Learning(filtered, line, unknown, line[0], jnp.asarray(jnp.nan))


def _through(causal: Causal, state: CausalState) -> Array:
    """(cells,) what each hysteron sends through the effects of the output, by its unit weight."""
    plane = causal.forward.chain.plane
    return causal.gain(state.time) * state.states[0][plane.alpha_index, plane.beta_index]


def _late(causal: Causal, values: Array) -> Array:
    """The value behind the delay, of those of the last samples, the latest first."""
    delay = causal.delay
    rows = np.arange(len(values))
    return jnp.asarray(np.maximum(1 - np.abs(rows - delay), 0.0)) @ values


def _learnt(
    causal: Causal, step_size: float, most: float, carried: _Carried, reading: Array
) -> _Carried:
    """State and learning after an output was measured at the sample before, if it was."""
    state, learning = carried
    output = _late(causal, learning.output)
    measured = jnp.isfinite(reading - output)
    behind = _late(causal, learning.line)
    moved = behind - learning.behind
    size = moved @ moved
    plane = causal.forward.chain.plane
    cells = (plane.alpha_index, plane.beta_index)
    before, of_start = state.weights[0][cells], state.weights[1][cells]
    missed = reading - learning.level - (before + of_start) @ moved
    # Two readings in steps of a converter differ by up to a step of what is there.
    missed = jnp.sign(missed) * jnp.maximum(jnp.abs(missed) - causal.resolution, 0.0)
    learns = measured & jnp.isfinite(missed) & (size >= LEAST_MOVED)
    rise = step_size * jnp.where(learns, missed, 0.0) / jnp.maximum(size, LEAST_MOVED)
    # Both starts share what is learnt: after the first reversals their states are the same.
    after = jnp.where(learns, jnp.clip(before + rise * moved, -of_start, most), before)
    change = after - before
    # All that the old weights have left in the model becomes what the new ones would have: else
    # the model would take what it learns for a jump of the stage, and ring with it.
    sent = _through(causal, state)

    def shifted(of_sum: Array, of_each: Array) -> Array:
        return of_sum + jnp.tensordot(change, of_each, 1)

    state = state._replace(
        weights=state.weights.at[0, *cells].set(after),
        hysteresis=state.hysteresis + change @ state.states[0][cells],
        signal=state.signal + change @ sent,
        behind=jax.tree.map(shifted, state.behind, learning.filtered),
        # What is expected where the reading was at the last update stays, and only the way from
        # there is learnt.
        follow=state.follow - change @ learning.behind,
    )
    renews = learns | (measured & ~jnp.isfinite(learning.level))
    learning = learning._replace(
        output=learning.output + learning.line @ change,
        behind=jnp.where(renews, behind, learning.behind),
        level=jnp.where(renews, reading, learning.level),
    )
    return state, learning


def _step(
    causal: Causal, step_size: float, share: float, most: float, carried: _Carried, sample: Array
) -> tuple[CausalState, Learning, Array]:
    """Learn from what was measured, and find the next drive."""
    state, _ = carried
    wanted, measured, aux = sample[0], sample[1], sample[2:]
    reading = causal.before_sensor(measured) - causal.beside(state.time, state.aux)
    state, learning = _learnt(causal, step_size, most, carried, reading)
    slow = reading - _late(causal, learning.output) - state.follow
    state = state._replace(follow=state.follow + share * jnp.where(jnp.isfinite(slow), slow, 0.0))
    state, (drive, expected, output) = causal.inverse(state, wanted, aux)
    filtered, line = causal.after.passed_each(learning.filtered, _through(causal, state))
    learning = learning._replace(
        filtered=filtered,
        line=jnp.concatenate([line[None], learning.line[:-1]]),
        output=jnp.append(output, learning.output[:-1]),
    )
    return state, learning, jnp.stack([drive, expected])
